"""A result as a plotter of pyvista in this process, for Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.view.opengl import tried_renderer
from explicitfe.app.view.rendering import HOW_TO_RENDER
from explicitfe.app.view.scene.scene import look_of
from explicitfe.app.view.scene.show import has_screen
from explicitfe.app.view.scene.shown_field import check_field
from explicitfe.app.view.scene.stage import Stage
from explicitfe.platform.errors import MachineError
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import open_result
from explicitfe.results.measure.steps import step_at

if TYPE_CHECKING:
    import pyvista


def plotter_of(
    result_path: Path,
    view: str | None = None,
    *,
    field: str = "displacement",
    without: Sequence[str] = (),
    time_s: float | None = None,
    size_px: tuple[int, int],
) -> pyvista.Plotter:
    """A plotter with the scene of a result at one time; parameters as of :func:`explicitfe.app.view.scene.show.show`.

    Raises
    ------
    InputError : the result, a name or a time cannot be used, or pyvista is not installed.
    MachineError : this machine cannot render.
    """
    require("view", "a view in three dimensions")
    with open_result(result_path) as result:
        check_field(result, field)
        look = look_of(view, kind_of(result.model), field, without)
        step = step_at(result, time_s)
        if why_not := _why_not_rendered():
            raise MachineError(f"this machine cannot render ({why_not}); {HOW_TO_RENDER}.")
        stage = Stage(result, [step], look, size_px, window=has_screen())
        stage.show(step)
        return stage.plotter


@cache
def _why_not_rendered() -> str:
    """Why VTK cannot render here, tried once in a separate process, as it would end this one; empty if it can."""
    return tried_renderer().why_not
