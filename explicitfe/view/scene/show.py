"""Shows a result in three dimensions: in a window, or as files where there is none."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Literal

from explicitfe.errors import InputError, Progress, silent
from explicitfe.host.extras import require
from explicitfe.measure.steps import step_at
from explicitfe.results import Result, open_result
from explicitfe.results.drawn import ShownScene
from explicitfe.results.run_summary import kind_of
from explicitfe.view.files import new_files
from explicitfe.view.muscles import muscles_of
from explicitfe.view.rendering import rendering
from explicitfe.view.scene.scene import Look
from explicitfe.view.scene.shown_field import check_field
from explicitfe.view.scene.viewpoint import viewpoint

FileKind = Literal["png", "gif", "mp4"]
SIZE_PX = (960, 720)
FILM_S = 4.0
SMALLEST_PX, LARGEST_PX = 64, 8192
SHORTEST_FILM_S, LONGEST_FILM_S = 0.1, 60.0
# Where the speaker's plane of symmetry means nothing.
VIEW_OF_SPECIMEN = "oblique"


def show(
    result_path: Path,
    view: str | None = None,
    *,
    field: str = "displacement",
    bones: bool = True,
    fibres: bool = True,
    at_rest: bool = True,
    files: Sequence[FileKind] = (),
    folder: Path | None = None,
    time_s: float | None = None,
    size_px: tuple[int, int] = SIZE_PX,
    film_s: float = FILM_S,
    overwrite: bool = False,
    progress: Progress = silent,
) -> ShownScene:
    """Show a result: in a window, or, where ``files`` names kinds of them, as ``<stem>-<view>.<kind>``.

    Parameters
    ----------
    view : from where, a name of ``VIEWPOINTS``; the midsagittal cut if left out, "oblique" of a specimen.
    field : a stored field that colours the body, or "none"; other than displacement, its name is part of the files' names.
    bones, fibres, at_rest : whether these are shown too.
    folder : where files go; beside the result if left out.
    time_s : when a picture is, and up to when a film goes; the end if left out.
    size_px : width and height.
    film_s : how long a film takes.
    overwrite : whether files may be replaced.

    Raises
    ------
    InputError : the result, a name, a time or a size cannot be used, a file exists, a package is missing, or there is no screen
        for a window.
    MachineError : this machine cannot render, or not write.
    """
    require("view", "a view in three dimensions")
    _check_sizes(size_px, film_s)
    with open_result(result_path) as result:
        check_field(result, field)
        view = view or (VIEW_OF_SPECIMEN if kind_of(result.model) == "relaxation" else Look.view)
        viewpoint(view)
        step = step_at(result, time_s)
        time_ms = 1e3 * float(result.times[step])
        notes = _notes(result, fibres)
    look = Look(view, field, bones, fibres, at_rest)
    folder = Path(result_path).parent if folder is None else Path(folder)
    ending = view if field in ("displacement", "none") else f"{view}-{field}"
    targets = {kind: folder / f"{Path(result_path).stem}-{ending}.{kind}" for kind in files}
    common = {"result": str(Path(result_path).absolute()), "look": asdict(look), "size_px": size_px, "time_s": time_s}
    if targets:
        new_files(targets.values(), overwrite)
        given = {"files": {kind: str(path) for kind, path in targets.items()}, "film_s": film_s}
        with rendering("film", **common, **given) as process:
            process.wait(lambda share: progress("draw", share))
    else:
        if not has_screen():
            raise InputError("there is no screen for a window (DISPLAY is not set); add --png, --gif or --mp4 to draw a file")
        with rendering("window", **common) as process:
            process.wait()
    return {
        "result": str(result_path),
        "files": [str(path) for path in targets.values()],
        "warnings": notes,
        "view": view,
        "field": field,
        "time_ms": time_ms,
    }


def has_screen() -> bool:
    """Whether this process can open a window."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _check_sizes(size_px: tuple[int, int], film_s: float) -> None:
    if not all(SMALLEST_PX <= dots <= LARGEST_PX for dots in size_px):
        raise InputError(
            f"a picture of {size_px[0]}x{size_px[1]} dots cannot be drawn; give {SMALLEST_PX} to {LARGEST_PX} each way"
        )
    if not SHORTEST_FILM_S <= film_s <= LONGEST_FILM_S:
        raise InputError(f"a film of {film_s:g} s cannot be drawn; give {SHORTEST_FILM_S:g} to {LONGEST_FILM_S:g} s")


def _notes(result: Result, fibres: bool) -> list[str]:
    """What of the scene is missing, in sentences."""
    if fibres and muscles_of(result) and not any(result.fibres):
        return [
            f"{result.path} holds no muscle fibres, as it was written by an earlier version; run the scenario again to see them"
        ]
    return []
