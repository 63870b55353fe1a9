"""The contact point of a curve under a tool: rows of the approach, and the displacement at first contact.

From first contact on the force is a power of the depth, 1.5 for a ball (Hertz) and 1 for a flat face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from explicitfe.inverse.measured.curve import Curve, sd_of

CONTACT_POWERS = {"sphere": 1.5}  # of the force, by the shape of the tool; 1 for all others
# The power of the tool holds for small depths: rows above this share of the largest force are not used.
SMALL_FORCE_SHARE = 0.3
FEWEST_ROWS_OF_CONTACT = 5
TRIED_CONTACTS = 60
# Rows are an approach if contact after them lowers chi2 by more than this, and the slope of their force is below so many errors.
CONTACT_CHI2 = 25.0
LARGEST_SLOPE_SDS = 3.0


@dataclass(frozen=True)
class Approach:
    """First rows of a curve in which the tool does not touch.

    Attributes
    ----------
    rows : number of rows.
    contact : displacement at first contact, in the unit of the displacements.
    force, sd : mean of the force in these rows, and its standard deviation.
    """

    rows: int
    contact: float
    force: float
    sd: float


def approach_of(displacement: np.ndarray, force: np.ndarray, power: float, sd: float = 0.0) -> Approach | None:
    """Recognize the approach of a tool that moves into the specimen; None if it touches from the first row on.

    Parameters
    ----------
    displacement, force : (k,) positive into the specimen and in compression.
    power : of the force at small depths.
    sd : noise of the force, if it is known.
    """
    end = int(displacement.argmax()) + 1
    low = np.median(force[: max(end // 10, 1)])
    small = np.flatnonzero(force[:end] - low > SMALL_FORCE_SHARE * (force[:end].max() - low))
    end = max(int(small[0]) if len(small) else end, min(end, 3 * FEWEST_ROWS_OF_CONTACT))
    x, y = displacement[:end], force[:end]
    if end < 2 * FEWEST_ROWS_OF_CONTACT or np.ptp(x) == 0.0:
        return None
    contact, error = _contact(x, y, power, float(x[0]), float(x.max()))
    before = int(np.argmax(x > contact))
    if before < FEWEST_ROWS_OF_CONTACT:
        return None
    idle, moved = y[:before], x[:before] - x[:before].mean()
    slope = float(moved @ idle) / max(float(moved @ moved), 1e-300)
    noise = max(float(np.std(idle - slope * moved, ddof=2)), sd, 1e-9 * float(np.abs(force).max()))
    _, first_error = _contact(x, y, power, float(x[0] - np.ptp(x)), float(x[0]))
    if first_error - error < CONTACT_CHI2 * noise**2 or abs(slope) * np.sqrt(moved @ moved) > LARGEST_SLOPE_SDS * noise:
        return None
    return Approach(before, contact, float(idle.mean()), noise)


def contact_before(displacement: np.ndarray, force: np.ndarray, power: float) -> float:
    """Displacement at first contact of a curve whose tool touches in the first row, by the power of the tool."""
    small = np.flatnonzero(force > max(SMALL_FORCE_SHARE * force.max(), 2.0 * force[0]))
    end = max(int(small[0]) if len(small) else len(force), min(len(force), FEWEST_ROWS_OF_CONTACT))
    x, y = displacement[:end], force[:end]
    # The force doubles at least in these rows: contact is no farther before them than 1.7 times their range, for a ball.
    return _contact(x, y, power, float(x[0] - 2.0 * np.ptp(x)), float(x[0]), offset=False)[0]


def _contact(x: np.ndarray, y: np.ndarray, power: float, low: float, high: float, *, offset: bool = True) -> tuple[float, float]:
    """Place of contact from low to high with the smallest sum of squares of y - a - b (x - contact)^power, and this sum."""

    def error(contact: float) -> float:
        depth = np.maximum(x - contact, 0.0) ** power
        basis = np.stack([depth, np.ones(len(x))] if offset else [depth], axis=1)
        return float(((y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]) ** 2).sum())

    places = np.linspace(low, high, TRIED_CONTACTS)
    best = int(np.argmin([error(place) for place in places]))
    around = places[max(best - 1, 0)], places[min(best + 1, TRIED_CONTACTS - 1)]
    least = minimize_scalar(error, bounds=around, method="bounded", options={"xatol": 1e-6 * (high - low)})
    return float(least.x), float(least.fun)


def approach_of_curve(curve: Curve) -> Approach | None:
    """The approach in a curve of a tool that presses and is not tied to the specimen, in SI; None if there is none."""
    if curve.tool is None or curve.tool.shape == "bonded-disc" or curve.displacement_m.max() <= 0.0:
        return None
    power = CONTACT_POWERS.get(curve.tool.shape, 1.0)
    return approach_of(curve.displacement_m, curve.force_N, power, sd_of(curve, "force_N") or 0.0)


def contact_start(curve: Curve) -> float | None:
    """Displacement from which the contact of a curve is fitted [m]; None if it is not fitted."""
    if not curve.fit_contact:
        return None
    approach = approach_of_curve(curve)
    return 0.0 if approach is None else approach.contact


def about_contact(curve: Curve) -> str | None:
    """A sentence on rows that are measured before contact; None if there are none."""
    approach = approach_of_curve(curve)
    if approach is None:
        return None
    rows = f"the tool does not touch in the first {approach.rows} rows of {curve.id}: their force is within its noise"
    place = f"and contact is at about {1e3 * approach.contact:.3g} mm"
    if curve.fit_contact:
        return f"{rows}; identify fits the displacement of contact."
    if abs(approach.contact) < np.ptp(curve.displacement_m[: approach.rows]) / max(approach.rows - 1, 1):
        return f"{rows}."
    return f'{rows}, {place}; subtract it, or set contact = "fit" in [[curve]], so that identify fits it.'
