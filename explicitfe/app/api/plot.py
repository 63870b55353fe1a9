"""``explicitfe.plot``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from explicitfe.app.api.source import Source, is_sweep, path_of
from explicitfe.app.view.figure import figure_of
from explicitfe.fem.mesh.checked_arrays import number_array
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(result: Source, picture: str | None = None, *, times_s: Sequence[float] | None = None) -> Figure:
    """Draw a picture of a result or a sweep as a matplotlib figure.

    Parameters
    ----------
    result : path, name in ``outputs/``, open result, summary of a run, or folder of a sweep.
    picture : of a run in time "contour" (the default), "coronal", "probes", "energies", "palatogram", "airway" or
        "reaction:NAME", the force-displacement curve of a support or fixed node set; of an indentation "curve" (the default) or
        "section"; of a sweep "outlines" (the default), "effects", "maps", "indices", or two columns as "A:B".
    times_s : the times to draw, s; a picture of one time shows the last of them; by default the end.

    Returns
    -------
    The figure; ``figure.savefig("contour.pdf")`` stores it.

    Raises
    ------
    InputError : no such result, picture or time, nothing to show in it, or matplotlib is not installed.
    """
    path = path_of(result)
    if is_sweep(path):
        if times_s is not None:
            raise InputError(f"plot: {path} is a sweep, which has no times; omit times_s.")
        from explicitfe.app.view.page.sweep.figure import sweep_figure  # sweeps need the compiler, results do not
        from explicitfe.simulate.sweep.page_data import sweep_to_draw

        return sweep_figure(sweep_to_draw, path, picture)
    times = None if times_s is None else number_array("plot: times_s", times_s, ("k",)).tolist()
    with open_result(path) as opened:
        return figure_of(opened, picture, times)
