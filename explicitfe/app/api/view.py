"""``explicitfe.view``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from explicitfe.app.api.source import Source, folder_of, path_of
from explicitfe.platform.errors import InputError, Progress, shortened, silent

if TYPE_CHECKING:
    import pyvista

    from explicitfe.app.view.scene.show import FileKind


def view(
    result: Source,
    viewpoint: str | None = None,
    *,
    field: str = "displacement",
    time_s: float | None = None,
    without: Sequence[str] = (),
    size_px: tuple[int, int] = (960, 720),
    file: FileKind | None = None,
    folder: Path | str | None = None,
    film_s: float = 4.0,
    overwrite: bool = False,
    progress: Progress = silent,
) -> pyvista.Plotter | Path:
    """Show a result in three dimensions: as a plotter of pyvista, or as an image or a film in a file.

    Parameters
    ----------
    result : path, name in ``outputs/``, open result, or summary of a run.
    viewpoint : name of the viewpoint: midsagittal (cut in half), side, oblique, top or front; by default midsagittal, of a
        specimen oblique.
    field : stored field that colours the body, or none.
    time_s : time of a picture and end of a film, s; by default the last one.
    without : parts to hide: bones, fibres (of muscles), rest (the shape at rest) or context (lips, hyoid bone and larynx).
    size_px : width and height, pixels.
    file : "png", "gif" or "mp4" to write a file instead.
    folder : output folder; by default that of the result.
    film_s : duration of a film, s.
    overwrite : replace existing files.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    A plotter with the scene, whose ``show()`` opens a window or an image in a notebook; or the path of the file.

    Raises
    ------
    InputError : no such result, field, viewpoint or time, the file exists, or pyvista is not installed.
    MachineError : this machine cannot render.
    """
    from explicitfe.app.view.scene.plotter import plotter_of
    from explicitfe.app.view.scene.show import FileKind, check_sizes, show
    from explicitfe.fem.inputs.argument import finite_number

    path = path_of(result)
    time_s = None if time_s is None else finite_number("view: time_s", time_s)
    check_sizes(size_px, finite_number("view: film_s", film_s))
    if file is None:
        return plotter_of(path, viewpoint, field=field, without=without, time_s=time_s, size_px=size_px)
    if file not in get_args(FileKind):
        raise InputError(f'view: file = {shortened(repr(file))} is not possible: it must be "png", "gif" or "mp4".')
    shown = show(
        path,
        viewpoint,
        field=field,
        without=without,
        files=[file],
        folder=None if folder is None else folder_of(folder, "view: folder"),
        time_s=time_s,
        size_px=size_px,
        film_s=film_s,
        overwrite=overwrite,
        progress=progress,
    )
    return Path(shown["files"][0])
