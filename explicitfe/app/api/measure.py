"""``explicitfe.measure``."""

from __future__ import annotations

from explicitfe.app.api.source import Source, path_of
from explicitfe.fem.inputs.argument import finite_number
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.measure import measure as measure_file


def measure(result: Source, time_s: float | None = None, *, formants: bool = False) -> Measures:
    """Measure a run in time: displacements of points, grooves, constriction, contact, speeds (docs/reference/measures.md).

    Parameters
    ----------
    result : path, name in ``outputs/``, open result, or summary of a run.
    time_s : the stored time nearest to it is measured, s; the last one if left out.
    formants : whether to compute the airway and the formants F1 to F3 too.

    Returns
    -------
    The measures as attributes, such as ``measures.points["tip"].forward_mm``; ``measures.document`` is a dictionary with the
    same content.

    Raises
    ------
    InputError : no such result or time, an indentation, or formants of a model without an airway.
    """
    time_s = None if time_s is None else finite_number("measure: time_s", time_s)
    return measure_file(path_of(result), time_s, formants)
