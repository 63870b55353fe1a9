"""The outlines of some runs of a sweep, as a page shows them, with the outline at rest and the midline of the palate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.results.documents.sweep_to_draw import DrawnMember, SweepColumn
from explicitfe.results.measure.sections import X, Z, middle, midsagittal
from explicitfe.results.measure.tract import PALATE, palate_midline
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.read import scenario_in
from explicitfe.simulate.scenario.transient import TransientScenario
from explicitfe.simulate.sweep.journal import Stored
from explicitfe.simulate.sweep.members import Members
from explicitfe.simulate.sweep.repeating import BegunSweep
from explicitfe.simulate.sweep.rows import CONTOUR, CONTOUR_UNIT_M, Row, number_of

MOST_MEMBERS_DRAWN = 24
MOST_OUTLINES_ON_EACH_OTHER = 150
# Of more runs than this only some, evenly distributed over all, are candidates for drawing.
MOST_MEMBERS_COMPARED = 20_000
MM_PER_M = 1e3
FEWEST_NUMBERS_OF_AN_OUTLINE = 6


def outline_of(row: Row) -> np.ndarray:
    """The outline of a row, (k, 2) mm, x backwards and z up; no points if it has none."""
    numbers = row.get(CONTOUR)
    if not isinstance(numbers, list) or len(numbers) < FEWEST_NUMBERS_OF_AN_OUTLINE or len(numbers) % 2:
        return np.zeros((0, 2))
    return MM_PER_M * CONTOUR_UNIT_M * np.array(numbers, dtype=float).reshape(-1, 2)


def many_outlines(stored: Stored, numbers: Sequence[int]) -> list[np.ndarray]:
    """Outlines for the overlay, evenly distributed over ``numbers``, the runs that have one."""
    return [outline_of(row) for row in stored.rows(evenly(numbers, MOST_OUTLINES_ON_EACH_OTHER))]


def drawn_members(
    begun: BegunSweep, members: Members, stored: Stored, numbers: Sequence[int], factors: Sequence[SweepColumn]
) -> list[DrawnMember]:
    """The runs that are drawn individually: as far from each other in the factors as possible, in the order of the first factor.

    Parameters
    ----------
    numbers : of the runs that have an outline, in their order.
    factors : columns, (len(numbers),) each.
    """
    if not len(numbers):
        return []
    compared = np.array(evenly(range(len(numbers)), MOST_MEMBERS_COMPARED))
    places = np.column_stack([_scaled(factor.values[compared], bool(factor.levels)) for factor in factors])
    chosen = compared[spread_out(places, MOST_MEMBERS_DRAWN)]
    chosen = chosen[np.lexsort([factor.values[chosen] for factor in reversed(factors)])]
    path = Path(begun.scenario)
    drawn = []
    for place, row in zip(map(int, chosen), stored.rows([numbers[place] for place in chosen]), strict=True):
        number = number_of(row)
        at_rest, palate = surroundings(begun, path, members.settings(number))
        settings = _settings(factors, place)
        drawn.append(DrawnMember(number, outline_of(row), at_rest, palate, settings, _remark(row)))
    return drawn


def surroundings(begun: BegunSweep, path: Path, settings: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """The outline at rest (j, 2) and the midline of the palate (p, 2) of a run, mm; no points where they are unknown.

    The model is built now, from the stored text of the scenario and the files that it names.
    """
    nothing = np.zeros((0, 2))
    try:
        scenario, _ = scenario_in(begun.scenario_text, path, (*begun.settings, *settings))
        if not isinstance(scenario, TransientScenario):
            return nothing, nothing
        model = assemble(scenario, path.parent).model
    except InputError:  # a file that the scenario names has been moved
        return nothing, nothing
    cut = midsagittal(model.mesh)
    at_rest = cut.at(model.mesh.points)[max(cut.loops, key=len)][:, [X, Z]] if cut.loops else nothing
    for bone in model.bones:
        if bone.name == PALATE:
            line = palate_midline(bone.surface.corners, middle(model.mesh))
            return MM_PER_M * at_rest, nothing if line is None else MM_PER_M * line.points
    return MM_PER_M * at_rest, nothing


def spread_out(places: np.ndarray, most: int) -> np.ndarray:
    """Rows of points (n, d) that are far from each other: each has the largest distance from those chosen before.

    The first is nearest to the lower end of all axes; of equal points one is taken.
    """
    chosen = [int(np.argmin((places**2).sum(axis=1)))]
    distance = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < most:
        farthest = int(np.argmax(distance))
        if not distance[farthest] > 0.0:
            break
        chosen.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(places - places[farthest], axis=1))
    return np.array(chosen)


def evenly(numbers: Sequence[int], most: int) -> list[int]:
    """At most ``most`` of some numbers, evenly distributed, with both ends."""
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[int(place)] for place in np.unique(np.rint(np.linspace(0, len(numbers) - 1, most)).astype(int))]


def _scaled(values: np.ndarray, are_words: bool) -> np.ndarray:
    """Values scaled to 0 to 1 over their range; texts have the distance of half a range."""
    low, size = float(np.nanmin(values)), float(np.ptp(values))
    scaled = np.nan_to_num((values - low) / size) if size > 0.0 else np.zeros(len(values))
    return 0.5 * scaled if are_words else scaled


def _remark(row: Row) -> str:
    if folded := row.get("folded_elements"):
        return f"{folded} inverted element{'' if folded == 1 else 's'}"
    warnings = row.get("warnings")
    return f"{warnings} warning{'' if warnings == 1 else 's'}" if warnings else ""


def _settings(factors: Sequence[SweepColumn], place: int) -> list[tuple[str, str]]:
    settings = []
    for factor in factors:
        value = factor.values[place]
        text = factor.levels[int(value)] if factor.levels else f"{value:.3g} {factor.unit}".rstrip()
        settings.append((factor.words, text.replace("e-0", "e-").replace("e+0", "e")))
    return settings
