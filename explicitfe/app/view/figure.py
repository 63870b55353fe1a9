"""One picture of a result as a matplotlib figure, for Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from explicitfe.app.view.draw import PICTURES, RENDERED, picture_of
from explicitfe.app.view.indentation import step_of_largest_force
from explicitfe.app.view.palette import use_plain_text
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result
from explicitfe.results.measure.steps import last_step, step_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def figure_of(result: Result, picture: str | None = None, times_s: Sequence[float] | None = None) -> Figure:
    """Draw one picture of a result.

    Parameters
    ----------
    result : an open result.
    picture : a name of ``PICTURES``; the first one for its kind of analysis if left out.
    times_s : the times to draw, s; a picture of one time shows the last of them. The end if left out.

    Raises
    ------
    InputError : matplotlib is not installed, or there is no such picture or time, or nothing to show in it.
    """
    require("plots", "drawing pictures")
    kind = kind_of(result.model)
    name = next(iter(PICTURES[kind])) if picture is None else picture
    if name in RENDERED[kind]:
        raise InputError(
            f'picture "{name}" is rendered by VTK and is no matplotlib figure; use view(...), or explicitfe plot --only {name}.'
        )
    drawing = picture_of(result, name)
    if drawing is None:
        raise InputError(f'picture "{name}" does not exist for {result.path}; {nearest(str(name), PICTURES[kind])}')
    step, steps = last_step(result), None
    if kind == "relaxation":
        if times_s is not None:
            raise InputError(f"times_s: {result.path} is an indentation, which has load steps and no times; omit times_s.")
        step = step_of_largest_force(result, step)
    elif times_s is not None and len(times_s):
        steps = sorted({step_at(result, time_s) for time_s in times_s})
        step = steps[-1]
    figure = drawing(result, step, steps)
    if figure is None:
        raise InputError(f'picture "{name}": {result.path} has no data for it.')
    use_plain_text(figure)
    return figure
