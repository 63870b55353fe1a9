"""Draws all pictures of a result as PNG files: of a tongue, or of an indentation."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

from explicitfe.measure.steps import last_step
from explicitfe.results import Result, open_result
from explicitfe.results.run_summary import kind_of
from explicitfe.view.airway import airway_figure
from explicitfe.view.hourglass import hourglass_map
from explicitfe.view.indentation import draw_indentation
from explicitfe.view.over_time import energies_figure, probes_figure
from explicitfe.view.palatogram import palatogram_figure
from explicitfe.view.palette import save
from explicitfe.view.render import end_rendering, start_rendering
from explicitfe.view.tongue import contour_figure, coronal_figure


def draw(result_path: Path, folder: Path | None = None) -> list[Path]:
    """Draw a result.

    Parameters
    ----------
    result_path : the result, of a run that finished, failed or was killed.
    folder : where the pictures go; beside the result if left out.

    Returns
    -------
    The PNG files: ``<stem>-contour.png``, ``-coronal``, ``-probes``, ``-energies``, ``-palatogram``, ``-airway``, ``-3d`` and
    ``-hourglass``; of an indentation ``<stem>-curve.png`` and ``-section``. A picture for which the result has nothing to show is
    left out; the 3D view and the hourglass map, with a warning, where the machine cannot render.

    Raises
    ------
    InputError : the file cannot be read or no step is stored in it.
    """
    result_path = Path(result_path)
    folder = result_path.parent if folder is None else Path(folder)
    with open_result(result_path) as result:
        step = last_step(result)
        folder.mkdir(parents=True, exist_ok=True)
        return PICTURES[kind_of(result.model)](result, step, folder)


def draw_transient(result: Result, step: int, folder: Path) -> list[Path]:
    """Pictures of a run in time up to a step; see :func:`draw`."""

    def target(name: str) -> Path:
        return folder / f"{result.path.stem}-{name}.png"

    paths = []
    rendered = [target("3d")] + [target("hourglass")] * (hourglass_map(result, step) is not None)
    rendering = start_rendering(result.path, rendered)
    try:
        for name, picture in (
            ("contour", contour_figure),
            ("coronal", coronal_figure),
            ("probes", probes_figure),
            ("energies", energies_figure),
            ("palatogram", palatogram_figure),
            ("airway", airway_figure),
        ):
            figure = picture(result, step)
            if figure is not None:
                save(figure, target(name))
                paths.append(target(name))
        problem = end_rendering(rendering, rendered)
    finally:
        rendering.kill()
    if problem:
        warnings.warn(problem, stacklevel=2)
    else:
        paths += rendered
    return paths


# The kind of analysis -> what draws its results.
PICTURES: dict[str, Callable[[Result, int, Path], list[Path]]] = {"transient": draw_transient, "relaxation": draw_indentation}
