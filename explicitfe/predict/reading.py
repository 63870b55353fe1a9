"""Between what happens and what a machine reads: effects of the reading applied, and undone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.effects import Measurement
from explicitfe.measured.curve import Curve
from explicitfe.predict.experiment import cycle_of


def true_programme(read: np.ndarray, curve: Curve, readings: Sequence[Measurement], by_force: bool) -> np.ndarray:
    """The programme that was really imposed (k,), from the one that the machine read."""
    for effect in reversed(readings):
        if by_force:
            # What is read is linear in the force.
            zero, one = (effect.read_force(np.full(len(read), x), curve.time_s, cycle_of(curve)) for x in (0.0, 1.0))
            read = (read - zero) / (one - zero)
        else:
            read = effect.true_displacement(read)
    if by_force and (curve.tool is None or curve.tool.shape != "bonded-disc"):
        return np.maximum(read, 0.0)
    return read


def reading(true: np.ndarray, curve: Curve, readings: Sequence[Measurement], by_force: bool) -> np.ndarray:
    """What the machine reads (k,), from the answer that is really there."""
    for effect in readings:
        if by_force:
            true = true - (effect.true_displacement(true) - true)  # An offset of displacement is the same in both directions.
        else:
            true = effect.read_force(true, curve.time_s, cycle_of(curve))
    return true
