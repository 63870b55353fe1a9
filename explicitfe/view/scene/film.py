"""Pictures and films of a scene as files: PNG, GIF, MP4."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from explicitfe.measure.steps import step_at
from explicitfe.results import open_result
from explicitfe.results.folder import whole_file
from explicitfe.view.scene.scene import Look
from explicitfe.view.scene.stage import Stage

FRAMES_PER_S = 20
HOLD_S = 1.0  # the end is seen for so long before a film begins again
# Colours of a GIF, and rounds in which they are fitted to the frames.
PALETTE_COLOURS, PALETTE_ROUNDS = 255, 2
PALETTE_FROM_FRAMES, PALETTE_EVERY = 6, 3  # so many frames, equally far apart, and of them every third dot, have all colours
MP4_QUALITY = 8.0  # 0 to 10


def film_steps(times: np.ndarray, last: int, frames: int) -> list[int]:
    """Up to so many steps from the first to ``last``, equally far apart in time."""
    wanted = np.linspace(times[0], times[last], max(2, min(frames, last + 1)))
    return sorted({int(np.argmin(np.abs(times[: last + 1] - time))) for time in wanted})


def make_film(
    result: str,
    look: Mapping[str, object],
    files: Mapping[str, str],
    size_px: Sequence[int],
    time_s: float | None,
    film_s: float,
    progress: Callable[[float], None],
) -> None:
    """Draw a scene into files.

    Parameters
    ----------
    result : the result file.
    look : the fields of a :class:`Look`.
    files : "png", "gif" or "mp4" -> where it goes; a file there is replaced.
    size_px : width and height.
    time_s : when the PNG is; at the end if None. A film goes up to there.
    film_s : how long a film takes.
    progress : called with the share that is done.
    """
    with open_result(result) as opened:
        end = step_at(opened, time_s)
        films = {kind: Path(path) for kind, path in files.items() if kind != "png"}
        steps = film_steps(opened.times, end, round(FRAMES_PER_S * film_s)) if films else [end]
        stage = Stage(opened, steps, Look(**look), (int(size_px[0]), int(size_px[1])))  # type: ignore[arg-type]
        frames: list[np.ndarray] = []
        for number, step in enumerate(steps):
            stage.show(step)
            frames.append(stage.picture())
            progress(0.8 * (number + 1) / len(steps))
        stage.plotter.close()
    if "png" in files:
        whole_file(Path(files["png"]), _png(frames[-1]))
    # Fewer stored steps than frames: each is seen for longer.
    frame_s = film_s / len(frames)
    if "gif" in films:
        whole_file(films["gif"], _gif(frames, frame_s))
    if "mp4" in films:
        _write_mp4(films["mp4"], frames, frame_s)
    progress(1.0)


def _png(frame: np.ndarray) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _gif(frames: Sequence[np.ndarray], frame_s: float) -> bytes:
    """All frames with the same colours: what does not move takes no room."""
    from PIL import Image

    some = np.linspace(0, len(frames) - 1, min(len(frames), PALETTE_FROM_FRAMES)).round().astype(int)
    samples = Image.fromarray(np.concatenate([frames[number][::PALETTE_EVERY, ::PALETTE_EVERY] for number in some]))
    palette = samples.quantize(PALETTE_COLOURS, method=Image.Quantize.MEDIANCUT, kmeans=PALETTE_ROUNDS)
    few = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [round(1e3 * frame_s)] * (len(few) - 1) + [round(1e3 * HOLD_S)]
    buffer = io.BytesIO()
    few[0].save(buffer, format="GIF", save_all=True, append_images=few[1:], duration=durations, loop=0, optimize=True, disposal=1)
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
