"""Constriction and formants over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.results.files import Recorded
from explicitfe.results.measure.airway import airway_table
from explicitfe.results.measure.document import AirwaySection
from explicitfe.results.measure.formants import FORMANT_COUNT, cut_pieces, formants_of, joined, lips_at
from explicitfe.results.measure.measure import nearest_of
from explicitfe.results.measure.steps import last_step


class ConstrictionCourse(NamedTuple):
    """The constriction in the midsagittal plane over time: ``time`` (k,) s, ``width`` and ``place`` (k,) m.

    Width 0: they touch. The place is along the palate from the edge of the incisors.
    """

    time: np.ndarray
    width: np.ndarray
    place: np.ndarray


class FormantCourse(NamedTuple):
    """F1, F2 and F3 over time: ``time`` (k,) s and ``frequency`` (k, 3) Hz, NaN where the airway is closed.

    ``sections`` (k) are those of the airway at each time, from the glottis to the lips.
    """

    time: np.ndarray
    frequency: np.ndarray
    sections: list[list[AirwaySection]]


def constriction_course(result: Recorded, every: int = 1) -> ConstrictionCourse:
    """The constriction at every ``every``-th sample and at the last one; about 15 ms each.

    Raises
    ------
    InputError : the run had no bone called "palate", or the midsagittal plane misses it or the tongue.
    """
    steps = _steps(result, every)
    nearest = [nearest_of(result, step) for step in steps]
    met = [each for each in nearest if each is not None]
    if len(met) < len(nearest):
        raise InputError(f'{result.path} has no constriction: tongue and bone "palate" must cross the midsagittal plane.')
    return ConstrictionCourse(result.times[steps], np.array([each.width for each in met]), np.array([each.place for each in met]))


def formant_course(result: Recorded, every: int = 1, steps: Sequence[int] | None = None) -> FormantCourse:
    """The formants at some stored samples, by default at every ``every``-th and at the last one; about 0.1 s each.

    Raises
    ------
    InputError : as ``measure.formants.airway_of``.
    """
    steps = _steps(result, every) if steps is None else steps
    table, of_all = airway_table(result), []
    frequency = np.full((len(steps), FORMANT_COUNT), np.nan)
    for number, step in enumerate(steps):
        sections = joined(cut_pieces(result, step, table), table.larynx, lips_at(result, float(result.times[step]), table))
        if min(section.area_mm2 for section in sections) > 0.0:
            frequency[number] = [formant.frequency_hz for formant in formants_of(sections)]
        of_all.append(sections)
    return FormantCourse(result.times[list(steps)], frequency, of_all)


def _steps(result: Recorded, every: int) -> list[int]:
    last = last_step(result)
    return sorted({*range(0, last + 1, every), last})
