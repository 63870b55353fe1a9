"""Pictures and films of scenes as files: PNG, GIF, MP4."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from explicitfe.app.view.files import writing
from explicitfe.app.view.gif import gif_bytes
from explicitfe.app.view.scene.scene import Look, share_scenes
from explicitfe.app.view.scene.stage import FREE_MARGINS, Stage
from explicitfe.results.files import Result, open_result
from explicitfe.results.files.folder import whole_file
from explicitfe.results.measure.steps import common_steps

FRAMES_PER_S = 20
HOLD_S = 1.0  # duration of the last frame before a film repeats
MP4_QUALITY = 8.0  # 0 to 10


def film_steps(times: np.ndarray, last: int, frames: int) -> list[int]:
    """At most ``frames`` samples from the first to ``last``, equally spaced in time."""
    wanted = np.linspace(times[0], times[last], max(2, min(frames, last + 1)))
    return sorted({int(np.argmin(np.abs(times[: last + 1] - time))) for time in wanted})


def make_film(
    results: Sequence[str],
    look: Mapping[str, object],
    files: Mapping[str, str],
    size_px: Sequence[int],
    time_s: float | None,
    film_s: float,
    progress: Callable[[float], None],
) -> None:
    """Draw scenes into files; several results side by side, with the same camera, colours and times.

    Parameters
    ----------
    results : the result files.
    look : the fields of a :class:`Look`.
    files : "png", "gif" or "mp4" -> its file, which is replaced.
    size_px : width and height of the part of each result.
    time_s : time of the PNG, and end of a film; by default the last time that all results have.
    film_s : duration of a film, s.
    progress : called with the completed share.
    """
    kinds = {kind: Path(path) for kind, path in files.items()}
    size = (int(size_px[0]), int(size_px[1]))
    with ExitStack() as opened:
        of_all = [opened.enter_context(open_result(result)) for result in results]
        count = round(FRAMES_PER_S * film_s) if set(kinds) - {"png"} else 1
        steps = steps_side_by_side(of_all, time_s, count)
        stages = [
            Stage(result, sorted(set(own)), Look(**look), size)  # type: ignore[arg-type]
            for result, own in zip(of_all, steps, strict=True)
        ]
        share_scenes([stage.scene for stage in stages], FREE_MARGINS)
        frames: list[np.ndarray] = []
        for number, moment in enumerate(zip(*steps, strict=True)):
            for stage, step in zip(stages, moment, strict=True):
                stage.show(step)
            frames.append(np.concatenate([stage.picture() for stage in stages], axis=1))
            progress(0.8 * (number + 1) / len(steps[0]))
        for stage in stages:
            stage.plotter.close()
    # Fewer stored samples than frames: each is seen for longer.
    frame_s = film_s / len(frames)
    for kind, path in kinds.items():
        with writing(path):
            if kind == "png":
                whole_file(path, _png(frames[-1]))
            elif kind == "gif":
                whole_file(path, gif_bytes(frames, [*[frame_s] * (len(frames) - 1), HOLD_S]))
            else:
                _write_mp4(path, frames, frame_s)
    progress(1.0)


def steps_side_by_side(results: Sequence[Result], time_s: float | None, count: int) -> list[list[int]]:
    """The samples of each result that are shown together: those nearest to common times.

    Parameters
    ----------
    time_s : the last time, s; by default the last one that all results have.
    count : largest number of frames; 1 for the last time alone. No more are used than the result with most samples has.

    Returns
    -------
    For each result as many numbers of samples as there are frames; a sample is repeated where a result has fewer.
    """
    _, last = common_steps(results, time_s)
    if count < 2:
        return [[step] for step in last]
    wanted = [film_steps(result.times, step, count) for result, step in zip(results, last, strict=True)]
    finest = max(range(len(results)), key=lambda number: len(wanted[number]))
    times = [float(time) for time in results[finest].times[wanted[finest]]]
    return [[int(np.argmin(np.abs(result.times - time))) for time in times] for result in results]


def _png(frame: np.ndarray) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _write_mp4(path: Path, frames: Sequence[np.ndarray], frame_s: float) -> None:
    import imageio_ffmpeg  # type: ignore[import-untyped]

    height, width = frames[0].shape[:2]
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", suffix=".part", dir=path.parent) as folder:
        part = Path(folder) / path.name
        writer = imageio_ffmpeg.write_frames(
            str(part), (width, height), fps=1.0 / frame_s, quality=MP4_QUALITY, macro_block_size=2, ffmpeg_log_level="error"
        )
        writer.send(None)
        for frame in _held(frames, frame_s):
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        part.replace(path)


def _held(frames: Sequence[np.ndarray], frame_s: float) -> Iterator[np.ndarray]:
    yield from frames
    for _ in range(round(HOLD_S / frame_s)):
        yield frames[-1]
