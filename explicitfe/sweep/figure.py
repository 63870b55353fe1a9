"""One picture of a sweep as a matplotlib figure, for Python."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.errors import InputError, nearest
from explicitfe.host.extras import require
from explicitfe.sweep.page_data import sweep_to_draw
from explicitfe.sweep.pictures import AGAINST, PICTURES, against
from explicitfe.view.palette import use_plain_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def sweep_figure(folder: Path, picture: str | None = None) -> Figure:
    """Draw one picture of a sweep.

    Parameters
    ----------
    folder : of the sweep.
    picture : a name of ``PICTURES``, or two columns as "A:B"; "outlines" if left out.

    Raises
    ------
    InputError : matplotlib is not installed, the folder is no sweep, or there is no such picture or column, or nothing to show.
    """
    require("plots", "drawing pictures")
    name = next(iter(PICTURES)) if picture is None else picture
    if name not in PICTURES and AGAINST not in name:
        raise InputError(f'picture "{name}" does not exist for a sweep; {nearest(name, PICTURES)} Or two columns: A{AGAINST}B.')
    sweep = sweep_to_draw(folder)
    figure = PICTURES[name](sweep) if name in PICTURES else against(sweep, *name.split(AGAINST, 1))
    if figure is None:
        raise InputError(f'picture "{name}": {folder} has no data for it.')
    use_plain_text(figure)
    return figure
