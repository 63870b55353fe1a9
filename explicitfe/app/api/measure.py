"""``explicitfe.measure``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from explicitfe.app.api.source import Source, path_of

if TYPE_CHECKING:
    from explicitfe.results.measure.document import Measures


def measure(result: Source, time_s: float | None = None, *, formants: bool = False) -> Measures:
    """Measure a run in time: displacements of points, grooves, constriction, contact, speeds (docs/reference/measures.md).

    Parameters
    ----------
    result : path, name in ``outputs/``, open result, or summary of a run.
    time_s : time, s; the nearest stored time is measured; by default the last one.
    formants : also measure the airway and the formants F1 to F3.

    Returns
    -------
    The measures as attributes, such as ``measures.points["tip"].forward_mm``; ``measures.document`` is a dictionary with the
    same content.

    Raises
    ------
    InputError : no such result or time, an indentation, or formants of a model without an airway.
    """
    from explicitfe.fem.inputs.argument import finite_number
    from explicitfe.results.measure.measure import measure as measure_file

    time_s = None if time_s is None else finite_number("measure: time_s", time_s)
    return measure_file(path_of(result), time_s, formants)
