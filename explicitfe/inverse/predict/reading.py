"""Between what happens and what a machine reads: effects of the reading applied, and undone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from explicitfe.fem.effects import Measurement, Rig
from explicitfe.fem.effects.record import MaterialKind, Record
from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.inverse.predict.experiment import cycle_of, start_times
from explicitfe.inverse.predict.tissue import Tissue

# A test is one-sided if it goes to the other side by no more than this share of its largest motion: sensors are not at zero.
OTHER_SIDE_SHARE = 0.05


def record_of(curve: Curve) -> Record:
    """A curve as effects of the reading see it."""
    if curve.tool is not None:
        return Record("force-displacement", curve.time_s, curve.displacement_m, cycle_of(curve))
    motion = programme_of(curve) - undeformed(curve)
    side = -1.0 if -motion.min() > motion.max() else 1.0
    one_sided = -(side * motion).min() <= OTHER_SIDE_SHARE * (side * motion).max()
    return Record(cast(MaterialKind, curve.kind), curve.time_s, motion, cycle_of(curve), side, bool(one_sided))


def undeformed(curve: Curve) -> float:
    """The imposed column of the specimen at rest: a stretch of 1, and 0 of all others."""
    return 1.0 if curve.imposed == "stretch" else 0.0


def true_programme(read: np.ndarray, curve: Curve, readings: Sequence[Measurement], by_force: bool) -> np.ndarray:
    """The programme that was really imposed (k,), from the one that the machine read."""
    if not readings:
        return np.maximum(read, 0.0) if by_force and _touches(curve) else read
    record, zero = record_of(curve), undeformed(curve)
    for effect in reversed(readings):
        read = effect.true_load(read, record) if by_force else effect.true_motion(read - zero, record) + zero
    return np.maximum(read, 0.0) if by_force and _touches(curve) else read


def as_it_is(curve: Curve, readings: Sequence[Measurement]) -> Curve:
    """A curve with the programme that was really imposed."""
    read = programme_of(curve)
    programme = true_programme(read, curve, readings, curve.imposed == "force_N")
    return curve if np.array_equal(programme, read) else replace(curve, columns=curve.columns | {curve.imposed: programme})


def reading(
    true: Sequence[np.ndarray], test: Sequence[Curve], readings: Sequence[Measurement], by_force: bool
) -> list[np.ndarray]:
    """What the machine reads in each curve of a test (k,), from the answers that are really there."""
    if not readings:
        return list(true)
    columns, records, starts = list(true), [record_of(curve) for curve in test], start_times(test)
    time_s = np.concatenate([record.time_s + start for record, start in zip(records, starts, strict=True)])
    for effect in readings:
        if len(test) > 1:
            whole = np.concatenate(columns)
            records = [replace(one, whole=(time_s - start, whole)) for one, start in zip(records, starts, strict=True)]
        read = effect.read_motion if by_force else effect.read_load
        columns = [read(column, record) for column, record in zip(columns, records, strict=True)]
    return columns


def _touches(curve: Curve) -> bool:
    """Whether the tool can leave the tissue, so that it cannot pull at it."""
    return curve.tool is not None and curve.tool.shape != "bonded-disc"


def without_compliance(tissue: Tissue) -> tuple[Tissue, float]:
    """The tissue without the compliance of the rig, and this compliance [m/N], which is in series with the tissue.

    With a preload it stays, since displacements then count from a state of both.
    """
    rig = Rig()
    for effect in tissue.effects.chosen:
        rig = effect.on_rig(rig)
    if rig.compliance_m_N == 0.0 or rig.preload_N > 0.0:
        return tissue, 0.0
    own = tuple(effect for effect in tissue.effects.chosen if effect.on_rig(Rig()).compliance_m_N > 0.0)
    return tissue.model_copy(update={"effects": tissue.effects.without(own)}), rig.compliance_m_N
