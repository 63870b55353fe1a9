"""Results in three dimensions: in a window, or as pictures and films in files."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Literal

from explicitfe.app.view.files import new_files
from explicitfe.app.view.heading import common_stem
from explicitfe.app.view.muscles import muscles_of
from explicitfe.app.view.rendering import rendering
from explicitfe.app.view.scene.scene import look_of
from explicitfe.app.view.scene.shown_field import check_field
from explicitfe.app.view.several import check_count, same_kind
from explicitfe.platform.errors import InputError, Progress, shortened, silent
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.drawn import ShownScene
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.steps import common_steps

FileKind = Literal["png", "gif", "mp4"]
SIZE_PX = (960, 720)
FILM_S = 4.0
SMALLEST_PX, LARGEST_PX = 64, 8192
SHORTEST_FILM_S, LONGEST_FILM_S = 0.1, 60.0
MOST_SIDE_BY_SIDE = 4  # more pictures are too wide for a screen


def show(
    results: Path | Sequence[Path],
    view: str | None = None,
    *,
    field: str = "displacement",
    without: Sequence[str] = (),
    files: Sequence[FileKind] = (),
    folder: Path | None = None,
    time_s: float | None = None,
    size_px: tuple[int, int] = SIZE_PX,
    film_s: float = FILM_S,
    overwrite: bool = False,
    progress: Progress = silent,
) -> ShownScene:
    """Show a result in a window, or, where ``files`` names kinds of them, in files ``<stem>-<view>.<kind>``.

    Several results are shown side by side in files, with the same camera, colours and times.

    Parameters
    ----------
    results : a result, or several of the same kind of analysis.
    view : a name of ``VIEWPOINTS``; by default the midsagittal cut, "oblique" for a specimen.
    field : a stored field that colours the body, or "none"; other than displacement, it is part of the names of the files.
    without : parts that are hidden: "bones", "fibres", "rest", the shape at rest, or "context": lips, hyoid bone and larynx.
    folder : output folder; that of the first result by default.
    time_s : time of a picture and end of a film; by default the last time that all results have.
    size_px : width and height of the picture of each result.
    film_s : duration of a film, s.
    overwrite : replace existing files.

    Raises
    ------
    InputError : a result, a name, a time or a size cannot be used, a file exists, a package is missing, there is no screen for a
        window, or a window is requested for several results.
    MachineError : this machine cannot render, or the disk is full.
    """
    require("view", "a view in three dimensions")
    check_sizes(size_px, film_s)
    paths = [Path(results)] if isinstance(results, str | Path) else [Path(path) for path in results]
    check_count(paths, MOST_SIDE_BY_SIDE)
    notes: list[str] = []
    with ExitStack() as opened:
        of_all = [opened.enter_context(open_result(path)) for path in paths]
        look = look_of(view, same_kind(of_all), field, without)
        for result in of_all:
            check_field(result, field)
            notes += _notes(result, look.fibres)
        time_ms = 1e3 * float(of_all[0].times[common_steps(of_all, time_s)[1][0]])
    folder = paths[0].parent if folder is None else Path(folder)
    ending = look.view if field in ("displacement", "none") else f"{look.view}-{field}"
    targets = {kind: folder / f"{common_stem(paths)}-{ending}.{kind}" for kind in files}
    common = {"look": asdict(look), "size_px": size_px, "time_s": time_s}
    if targets:
        new_files(targets.values(), overwrite)
        given = {"files": {kind: str(path) for kind, path in targets.items()}, "film_s": film_s}
        with rendering("film", results=[str(path.absolute()) for path in paths], **common, **given) as process:
            process.wait(lambda share: progress("draw", share))
    elif len(paths) > 1:
        raise InputError("a window shows one result; add --png, --gif or --mp4 to show several results side by side in a file.")
    else:
        if not has_screen():
            raise InputError("there is no screen for a window (DISPLAY is not set); add --png, --gif or --mp4 to draw a file.")
        with rendering("window", result=str(paths[0].absolute()), **common) as process:
            process.wait()
    answer: ShownScene = {
        "result": str(paths[0]),
        "files": [str(path) for path in targets.values()],
        "warnings": notes,
        "view": look.view,
        "field": field,
        "time_ms": time_ms,
    }
    return answer if len(paths) == 1 else {**answer, "results": [str(path) for path in paths]}


def has_screen() -> bool:
    """Whether this process can open a window."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_sizes(size_px: tuple[int, int], film_s: float) -> None:
    """Refuse a size of a picture or a duration of a film that is out of range.

    Raises
    ------
    InputError : it is.
    """
    if not isinstance(size_px, list | tuple) or len(size_px) != 2 or not all(isinstance(dots, int) for dots in size_px):
        raise InputError(f"size_px must be width and height in pixels, such as (960, 720), not {shortened(repr(size_px))}.")
    if not all(SMALLEST_PX <= dots <= LARGEST_PX for dots in size_px):
        raise InputError(
            f"a picture of {size_px[0]}x{size_px[1]} pixels is not possible; give {SMALLEST_PX} to {LARGEST_PX} pixels each way."
        )
    if not SHORTEST_FILM_S <= film_s <= LONGEST_FILM_S:
        raise InputError(f"a film of {film_s:g} s is not possible; give {SHORTEST_FILM_S:g} to {LONGEST_FILM_S:g} s.")


def _notes(result: Result, fibres: bool) -> list[str]:
    """A sentence for each part of the scene that is missing."""
    if fibres and muscles_of(result) and not any(result.fibres):
        return [f"{result.path} has no muscle fibres, because an earlier version wrote it; run the scenario again to see them."]
    return []
