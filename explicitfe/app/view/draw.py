"""Pictures of a result: of a run in time, or of an indentation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.view.airway import airway_figure
from explicitfe.app.view.files import new_files, writing
from explicitfe.app.view.hourglass import hourglass_map
from explicitfe.app.view.indentation import curve_figure, section_figure, step_of_largest_force
from explicitfe.app.view.over_time import energies_figure, probes_figure, reaction_figure
from explicitfe.app.view.palatogram import palatogram_figure
from explicitfe.app.view.palette import FORMATS, save
from explicitfe.app.view.rendering import CannotRenderError, rendering
from explicitfe.app.view.tongue import contour_figure, coronal_figure
from explicitfe.platform.errors import InputError, Progress, nearest, silent
from explicitfe.platform.host.extras import has_extra, how_to_install, require
from explicitfe.results.documents.drawn import DrawnPictures
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.steps import last_step, step_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = Callable[[Result, int, Sequence[int] | None], "Figure | None"]
"""Draws a result at a sample. The last argument has the samples of pictures that show several times; None: a default choice."""

# Kind of analysis -> name of a picture -> its function, which returns None if the result lacks the data.
PICTURES: dict[str, dict[str, Picture]] = {
    "transient": {
        "contour": contour_figure,
        "coronal": coronal_figure,
        "probes": lambda result, step, steps: probes_figure(result, step),
        "energies": lambda result, step, steps: energies_figure(result, step),
        "palatogram": palatogram_figure,
        "airway": lambda result, step, steps: airway_figure(result, step),
    },
    "relaxation": {
        "curve": lambda result, step, steps: curve_figure(result, step),
        "section": lambda result, step, steps: section_figure(result, step),
    },
}
REACTION = "reaction:"  # followed by the name of a reaction force


def picture_of(result: Result, name: str) -> Picture | None:
    """The function that draws a picture of a result as a matplotlib figure; None where there is no such picture."""
    if name.startswith(REACTION) and result.reaction_names:
        return lambda opened, step, steps: reaction_figure(opened, name.removeprefix(REACTION))
    return PICTURES[kind_of(result.model)].get(name)


# Kind of analysis -> name of a picture that is rendered in a separate process -> whether the result has the data.
RENDERED: dict[str, dict[str, Callable[[Result, int], bool]]] = {
    "transient": {"3d": lambda result, step: True, "hourglass": lambda result, step: hourglass_map(result, step) is not None},
    "relaxation": {},
}
DRAW_SHARE = 0.9  # of the work: pictures that are not rendered in the separate process


def draw(
    result_path: Path,
    folder: Path | None = None,
    *,
    only: Sequence[str] | None = None,
    file_format: str = "png",
    times_s: Sequence[float] | None = None,
    overwrite: bool = True,
    progress: Progress = silent,
) -> DrawnPictures:
    """Draw a result, as files ``<stem>-<picture>.<format>``.

    Parameters
    ----------
    result_path : the result, of a run that finished, failed or was killed.
    folder : output folder; that of the result by default.
    only : names of pictures, see ``PICTURES`` and ``RENDERED``; all by default.
    file_format : "png", "pdf" or "svg".
    times_s : times for pictures that show several times; the others show the last of them. The end by default.
    overwrite : replace existing files.

    Returns
    -------
    The files. Pictures for which the result lacks the data are omitted, with a warning if ``only`` names them. Pictures in three
    dimensions are omitted with a warning if this machine cannot render.

    Raises
    ------
    InputError : the file cannot be read or has no sample, a name or a time cannot be used, or a file exists.
    MachineError : the disk is full.
    """
    require("plots", "drawing pictures")
    result_path = Path(result_path)
    folder = result_path.parent if folder is None else Path(folder)
    if file_format not in FORMATS:
        raise InputError(f'--format "{file_format}" is not a file format of pictures; {nearest(file_format, FORMATS)}')
    with open_result(result_path) as result, ExitStack() as processes:
        kind = kind_of(result.model)
        names = _chosen([*PICTURES[kind], *RENDERED[kind]], only, result)
        step, steps = _steps(result, kind, times_s)
        targets = {name: folder / f"{result_path.stem}-{name.replace(':', '-')}.{file_format}" for name in names}
        new_files(targets.values(), overwrite)
        notes: list[str] = []
        drawn: list[str] = []
        rendered = [name for name in names if name in RENDERED[kind] and RENDERED[kind][name](result, step)]
        if rendered and not has_extra("view"):
            notes.append(f"{_listed(rendered)} not drawn: this requires {how_to_install('view')}")
            rendered = []
        process = None
        if rendered:
            files = {name: str(targets[name].absolute()) for name in rendered}
            process = processes.enter_context(rendering("figures", result=str(result_path.absolute()), step=step, files=files))
        figures = {name: drawing for name in names if (drawing := picture_of(result, name)) is not None}
        for number, (name, drawing) in enumerate(figures.items()):
            progress("draw", DRAW_SHARE * number / len(figures))
            figure = drawing(result, step, steps)
            if figure is not None:
                with writing(targets[name]):
                    save(figure, targets[name])
                drawn.append(name)
        if process is not None:
            try:
                process.wait(lambda share: progress("draw", DRAW_SHARE))
                drawn += rendered
            except CannotRenderError as error:
                notes.append(f"{_listed(rendered)} not drawn: {error}")
        empty = [name for name in names if name not in drawn and name not in rendered]
        if only is not None and empty:
            notes.append(f"{result_path} has no data for: {', '.join(empty)}.")
    progress("draw", 1.0)
    return {"result": str(result_path), "files": [str(targets[name]) for name in names if name in drawn], "warnings": notes}


def _chosen(names: Sequence[str], only: Sequence[str] | None, result: Result) -> list[str]:
    """The pictures to draw, in the order of ``names``."""
    reactions = [f"{REACTION}{name}" for name in result.reaction_names]
    for name in only or ():
        if name not in names and name not in reactions:
            raise InputError(f'{result.path} has no picture "{name}"; {nearest(name, [*names, *reactions])}')
    return [*names] if only is None else [name for name in [*names, *reactions] if name in only]


def _steps(result: Result, kind: str, times_s: Sequence[float] | None) -> tuple[int, list[int] | None]:
    """The sample of pictures of one time, and the samples of pictures of several times if times are given."""
    last = last_step(result)
    if kind == "relaxation":
        if times_s:
            raise InputError(f"{result.path} is an indentation, which has load steps and no times; leave out --times.")
        return step_of_largest_force(result, last), None
    if not times_s:
        return last, None
    steps = sorted({step_at(result, time_s) for time_s in times_s})
    return steps[-1], steps


def _listed(names: Sequence[str]) -> str:
    """Names of pictures as the subject of a sentence."""
    return f"the picture{'s' * (len(names) > 1)} {' and '.join(names)} {'were' if len(names) > 1 else 'was'}"
