"""How a test is computed: by its own course, or by one ramp off which all tests of its kind are read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.close_loop.specimens.simulator import Job
from explicitfe.effects import Effect
from explicitfe.effects.effect import MaterialEffect, Measurement
from explicitfe.effects.tool.adhesion import Adhesion
from explicitfe.effects.tool.friction import Friction
from explicitfe.measured.curve import Curve, programme_of
from explicitfe.predict.reading import reading, true_programme

RAMP = 49  # rows of a ramp that stands for all courses


@dataclass(frozen=True)
class _Plan:
    """A run, and how the curves of a test are read off it: directly, or from a ramp by their own way."""

    job: Job
    test: tuple[Curve, ...]
    readings: tuple[Measurement, ...] = ()
    by_force: bool = False

    def read(self, answer: list[np.ndarray]) -> dict[str, np.ndarray]:
        """Curve -> what it would measure, SI."""
        (run, *_), _ = self.job
        if run is self.test[0]:
            return {c.id: reading(values, c, self.readings, self.by_force) for c, values in zip(self.test, answer, strict=True)}
        line = PchipInterpolator(programme_of(run), answer[0])
        found = {}
        for curve in self.test:
            way = np.clip(true_programme(programme_of(curve), curve, self.readings, self.by_force), 0.0, programme_of(run)[-1])
            found[curve.id] = reading(line(way), curve, self.readings, self.by_force)
        return found


def _depends_on_way_only(curve: Curve, effects: Iterable[Effect]) -> bool:
    """Whether neither time nor what came before changes the answer; a tied disc pulls too, and is left to the whole course."""
    by_path = any(_has_memory(e) or isinstance(e, Friction | Adhesion) for e in effects)
    return not by_path and curve.tool.shape != "bonded-disc" and curve.tool.friction in (0.0, "unknown", "stick")


@lru_cache(maxsize=10_000)
def _kind_of(curve: Curve) -> str:
    """Equal for tests that differ in their course only."""
    known = [curve.conditions.get(key) for key in ("preload_N", "direction")]
    return f"{curve.specimen!r} {curve.tool!r} {curve.constants} {known}"


def _has_memory(effect: Effect) -> bool:
    return isinstance(effect, MaterialEffect) and effect.memory > 0
