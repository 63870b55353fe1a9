"""The work of a tool from the equilibria that it passed, how well these tell it, and whether it is where the energy is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from explicitfe.fem.solve.load_outcome import Equilibrium

# A tool that moves by less than this share of all that it moves rests.
_REST_SHARE = 1e-6


class Work(NamedTuple):
    """Work, and by how much what is known of it may be wrong."""

    work_J: float
    doubt_J: float


class Balance(NamedTuple):
    """Energy that is missing or too much, and the doubt in the work: relative to the largest of stored energy and work."""

    error: float
    doubt: float


def external_work(curve: Sequence[Equilibrium]) -> Work:
    """Work of tool and dead loads since the first equilibrium.

    The force between two equilibria is not known: it is taken from a spline along each stretch in one direction, and from a
    straight line where a stretch is a single load. The doubt of a spline is by how much it changes to leave out every other load.
    That of a line is half of what lies between the forces at its ends: a force that rises all along stays there.
    """
    force = np.array([point.force_N for point in curve])
    displacement = np.array([point.displacement_m for point in curve])
    work, doubt = curve[-1].dead_work_J - curve[0].dead_work_J, 0.0
    moves = np.diff(displacement)
    direction = np.where(np.abs(moves) > _REST_SHARE * np.ptp(displacement), np.sign(moves), 0.0)
    ends = np.append(np.flatnonzero(np.diff(direction)) + 1, len(moves))
    start = 0
    for end in ends[ends > 0]:
        stretch = slice(start, end + 1)
        area, unsure = _area(displacement[stretch], force[stretch], float(direction[start]))
        work, doubt = work + area, doubt + unsure
        start = end
    return Work(work, doubt)


def _area(d: np.ndarray, f: np.ndarray, direction: float) -> Work:
    """The area under a stretch of the curve, in the direction of the tool; direction 0: it rests."""
    if direction == 0.0:
        return Work(0.5 * float(np.sum((f[1:] + f[:-1]) * np.diff(d))), 0.0)
    if len(d) == 2:
        return Work(0.5 * float((f[0] + f[1]) * (d[1] - d[0])), 0.5 * float(abs((f[1] - f[0]) * (d[1] - d[0]))))
    kept = np.unique([*range(0, len(d), 2), len(d) - 1])
    area, fewer = (direction * _under_spline(d[some], f[some]) for some in (np.arange(len(d)), kept))
    return Work(area, abs(area - fewer))


def _under_spline(d: np.ndarray, f: np.ndarray) -> float:
    if len(d) == 2:
        return 0.5 * float((f[0] + f[1]) * abs(d[1] - d[0]))
    order = np.argsort(d)
    return float(scipy.interpolate.CubicSpline(d[order], f[order]).integrate(d[order][0], d[order][-1]))


def balance_of(curve: Sequence[Equilibrium]) -> Balance:
    """Energy stored and lost since the first equilibrium, against the work."""
    if len(curve) < 2:
        return Balance(0.0, 0.0)
    first, last = curve[0], curve[-1]
    stored = sum(
        getattr(last, name) - getattr(first, name)
        for name in ("internal_J", "hourglass_J", "contact_J", "friction_loss_J", "material_loss_J")
    )
    work, doubt = external_work(curve)
    largest = max(max(point.internal_J for point in curve), abs(work))
    return Balance(abs(stored - work) / largest, doubt / largest) if largest > 0.0 else Balance(0.0, 0.0)
