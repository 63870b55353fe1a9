"""One picture of a sweep as a matplotlib figure, for Python."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from explicitfe.app.view.page.sweep.pictures import AGAINST, PICTURES, against
from explicitfe.app.view.palette import use_plain_text
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.sweep_to_draw import SweepToDraw

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def sweep_figure(read: Callable[[Path], SweepToDraw], folder: Path, picture: str | None = None) -> Figure:
    """Draw one picture of a sweep.

    Parameters
    ----------
    read : reads the data of a sweep from its folder.
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
    sweep = read(folder)
    figure = PICTURES[name](sweep) if name in PICTURES else against(sweep, *name.split(AGAINST, 1))
    if figure is None:
        raise InputError(f'picture "{name}": {folder} has no data for it.')
    use_plain_text(figure)
    return figure
