"""Draws a result as pictures: of a tongue, or of an indentation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.errors import InputError, MachineError, Progress, nearest, silent
from explicitfe.host.extras import has_extra, how_to_install, require
from explicitfe.measure.steps import last_step, step_at
from explicitfe.results import Result, open_result
from explicitfe.results.drawn import DrawnPictures
from explicitfe.results.run_summary import kind_of
from explicitfe.view.airway import airway_figure
from explicitfe.view.files import new_files
from explicitfe.view.hourglass import hourglass_map
from explicitfe.view.indentation import curve_figure, section_figure, step_of_largest_force
from explicitfe.view.over_time import energies_figure, probes_figure
from explicitfe.view.palatogram import palatogram_figure
from explicitfe.view.palette import FORMATS, save
from explicitfe.view.rendering import rendering
from explicitfe.view.tongue import contour_figure, coronal_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Picture = Callable[[Result, int, Sequence[int] | None], "Figure | None"]
"""Draws a result at a step; where it shows several times, these are the last argument, or what suits the result if None."""

# Kind of analysis -> name of a picture -> what draws it. A picture is None where the result has nothing to show in it.
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
# Kind of analysis -> name of a picture that is drawn in a process of its own -> whether the result has something to show in it.
RENDERED: dict[str, dict[str, Callable[[Result, int], bool]]] = {
    "transient": {"3d": lambda result, step: True, "hourglass": lambda result, step: hourglass_map(result, step) is not None},
    "relaxation": {},
}
DRAW_SHARE = 0.9  # of the work: the others than those that are rendered at the same time


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
    folder : where the pictures go; beside the result if left out.
    only : names of pictures, see ``PICTURES`` and ``RENDERED``; all if left out.
    file_format : "png", "pdf" or "svg".
    times_s : that are drawn where a picture shows several times; the others show the last of them. The end if left out.
    overwrite : whether files may be replaced.

    Returns
    -------
    The files. A picture for which the result has nothing to show is left out, with a sentence where ``only`` names it; those in
    three dimensions, with a sentence, where the machine cannot render.

    Raises
    ------
    InputError : the file cannot be read, no step is stored in it, a name or a time cannot be used, or a file exists.
    """
    require("plots", "drawing pictures")
    result_path = Path(result_path)
    folder = result_path.parent if folder is None else Path(folder)
    if file_format not in FORMATS:
        raise InputError(f'pictures cannot be drawn as "{file_format}"; {nearest(file_format, FORMATS)}')
    with open_result(result_path) as result, ExitStack() as processes:
        kind = kind_of(result.model)
        names = _chosen([*PICTURES[kind], *RENDERED[kind]], only, result)
        step, steps = _steps(result, kind, times_s)
        targets = {name: folder / f"{result_path.stem}-{name}.{file_format}" for name in names}
        new_files(targets.values(), overwrite)
        notes: list[str] = []
        drawn: list[str] = []
        rendered = [name for name in names if name in RENDERED[kind] and RENDERED[kind][name](result, step)]
        if rendered and not has_extra("view"):
            notes.append(f"{_listed(rendered)} left out: that needs {how_to_install('view')}")
            rendered = []
        process = None
        if rendered:
            files = {name: str(targets[name].absolute()) for name in rendered}
            process = processes.enter_context(rendering("figures", result=str(result_path.absolute()), step=step, files=files))
        figures = [name for name in names if name in PICTURES[kind]]
        for number, name in enumerate(figures):
            progress("draw", DRAW_SHARE * number / len(figures))
            figure = PICTURES[kind][name](result, step, steps)
            if figure is not None:
                save(figure, targets[name])
                drawn.append(name)
        if process is not None:
            try:
                process.wait(lambda share: progress("draw", DRAW_SHARE))
                drawn += rendered
            except MachineError as error:
                notes.append(f"{_listed(rendered)} left out: {error}")
        empty = [name for name in names if name not in drawn and name not in rendered]
        if only is not None and empty:
            notes.append(f"{result_path} has nothing to show in: {', '.join(empty)}")
    progress("draw", 1.0)
    return {"result": str(result_path), "files": [str(targets[name]) for name in names if name in drawn], "warnings": notes}


def _chosen(names: Sequence[str], only: Sequence[str] | None, result: Result) -> list[str]:
    """The pictures to draw, in the order of ``names``."""
    for name in only or ():
        if name not in names:
            raise InputError(f'{result.path} has no picture "{name}"; {nearest(name, names)}')
    return [name for name in names if only is None or name in only]


def _steps(result: Result, kind: str, times_s: Sequence[float] | None) -> tuple[int, list[int] | None]:
    """The step that pictures of one time show, and those of several times where they were asked for."""
    last = last_step(result)
    if kind == "relaxation":
        if times_s:
            raise InputError(f"{result.path} is an indentation, whose pictures show its loads and no times; leave --times out")
        return step_of_largest_force(result, last), None
    if not times_s:
        return last, None
    steps = sorted({step_at(result, time_s) for time_s in times_s})
    return steps[-1], steps


def _listed(names: Sequence[str]) -> str:
    """Pictures as the beginning of a sentence on them."""
    return f"the picture{'s' * (len(names) > 1)} {' and '.join(names)} {'were' if len(names) > 1 else 'was'}"
