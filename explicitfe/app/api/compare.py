"""``explicitfe.compare``."""

from __future__ import annotations

from explicitfe.app.api.source import Source, path_of
from explicitfe.fem.inputs.argument import finite_number
from explicitfe.platform.errors import Progress, silent
from explicitfe.results.measure.compare import compare as compare_files
from explicitfe.results.measure.comparison import Comparison


def compare(a: Source, b: Source, tolerance: float | None = None, progress: Progress = silent) -> Comparison:
    """Compare two results, on different meshes too: scenarios, fields, points, energies and measures.

    A difference is b minus a. On different meshes b is interpolated at the nodes and the element centres of a, and linearly in
    time (docs/how-to/compare.md).

    Parameters
    ----------
    a, b : path, name in ``outputs/``, open result, or summary of a run.
    tolerance : the largest difference of displacements, as a share of the largest displacement, for which
        ``within_tolerance`` is true.
    progress : called with the stage and the share of it that is done.

    Returns
    -------
    The comparison as attributes, such as ``comparison.identical`` and ``comparison.fields``; ``comparison.document`` is a
    dictionary with the same content.

    Raises
    ------
    InputError : no such result, results of different kinds or bodies, or without a common time.
    """
    if tolerance is not None:
        tolerance = finite_number("compare: tolerance", tolerance)
    return compare_files(path_of(a, "a"), path_of(b, "b"), tolerance, progress)
