"""How a test is computed: by its own course, or by one ramp off which all tests of its kind are read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.close_loop.specimens.simulator import Job
from explicitfe.effects import Effect, Measurement, readings_of
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.predict.reading import reading, true_programme
from explicitfe.predict.tissue import Tissue

# Rows of the ramp that stands for all courses: between two of them an answer is nearly straight.
RAMP_ROWS = 49


@dataclass(frozen=True)
class Plan:
    """A run, and how the curves of a test are read off it: directly, or from a ramp by their own programme."""

    job: Job
    test: tuple[Curve, ...]
    readings: tuple[Measurement, ...] = ()
    by_force: bool = False

    def read(self, answer: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
        """Curve -> what it would measure, SI."""
        (run, *_), _ = self.job
        if run is self.test[0]:
            return {c.id: reading(values, c, self.readings, self.by_force) for c, values in zip(self.test, answer, strict=True)}
        line = PchipInterpolator(programme_of(run), answer[0])
        by_curve = {}
        for curve in self.test:
            programme = true_programme(programme_of(curve), curve, self.readings, self.by_force)
            inside = np.clip(programme, 0.0, programme_of(run)[-1])
            by_curve[curve.id] = reading(line(inside), curve, self.readings, self.by_force)
        return by_curve


def plan_of(tissue: Tissue, test: tuple[Curve, ...], curves: Sequence[Curve], homogeneous: bool) -> Plan:
    """How a test is computed: by one ramp for all tests of its kind, where the answer does not depend on the past.

    Parameters
    ----------
    test : curves that are measured one after the other.
    curves : all that are asked for.
    homogeneous : the tests are homogeneous states where no effect speaks against it.
    """
    first = test[0]
    if first.tool is None:
        return Plan((test, tissue.text), test)
    effects = tissue.effects.chosen
    readings = readings_of(effects)
    by_force = first.tool.control == "force"
    by_point = homogeneous and all(effect.pointwise for effect in effects)
    # What a mesh changes in a state that is homogeneous without it is small, so a ramp does for friction too.
    by_ramp = _forgets_its_past(first, effects) or (homogeneous and not any(effect.remembers for effect in effects))
    plain = tissue.model_copy(update={"effects": tissue.effects.without(readings)})
    if by_point or not by_ramp:
        as_read = [programme_of(c) for c in test]
        same = all(np.array_equal(true_programme(p, c, readings, by_force), p) for p, c in zip(as_read, test, strict=True))
        if not readings or not same:
            return Plan((test, tissue.text), test)
        # Effects of the reading alone are read off the run without them.
        return Plan((test, plain.text), test, readings, by_force)
    alike = [c for c in curves if _kind_of(c) == _kind_of(first)]
    top = max(float(true_programme(programme_of(c), c, readings, by_force).max()) for c in alike)
    share = np.linspace(0.0, 1.0, RAMP_ROWS)
    guess = max(float(np.abs(c.columns[first.predicted]).max()) for c in alike)
    columns = {first.imposed: share * top, first.predicted: share * guess}
    ramp = replace(first, time_s=share, columns={name: columns[name] for name in first.columns})
    return Plan(((ramp,), plain.text), test, readings, by_force)


def _forgets_its_past(curve: Curve, effects: Sequence[Effect]) -> bool:
    """Whether neither time nor what came before changes the answer; a tied disc pulls too, and needs its whole course."""
    assert curve.tool is not None
    by_path = any(effect.depends_on_path for effect in effects)
    return not by_path and curve.tool.shape != "bonded-disc" and curve.tool.friction in (0.0, "unknown", "stick")


@lru_cache(maxsize=10_000)
def _kind_of(curve: Curve) -> str:
    """Equal for tests that differ in their course only."""
    known = [curve.conditions.get(key) for key in ("preload_N", "direction")]
    return f"{curve.specimen!r} {curve.tool!r} {curve.constants} {known}"
