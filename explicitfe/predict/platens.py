"""Tissue between platens without friction: a homogeneous state; the platen may lose contact, the rig may give way.

The way of the tissue is found for all instants together, with the slope of a sudden small change: where the platen
touches, way + compliance x force is what the machine went; where it does not, the tissue is free, and bears nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.effects import Effect, MaterialEffect
from explicitfe.effects.material.compressible import Compressible
from explicitfe.effects.tool.compliance import Compliance
from explicitfe.effects.tool.preload import Preload
from explicitfe.errors import RunError
from explicitfe.materials.yeoh import Yeoh
from explicitfe.measured.course import Course
from explicitfe.solve import point

UNIFORM = (MaterialEffect, Compressible, Compliance, Preload)  # that leave the state homogeneous
TURNS = 100
DEPTH = 6  # turns that the next one is made from
CLOSE = point.TOLERANCE  # of the height: a state is not known better
STEP = 1e-5  # of the stretch, for the slope
FAR = 1e-2  # of the height: the slope is found anew after so much of a change
CAREFUL = 4  # parts of a step in which contact is lost or found


@dataclass(frozen=True)
class Platens:
    """A specimen between two platens.

    Attributes
    ----------
    law, effects : the tissue.
    height_m, area_m2 : the specimen.
    compliance_m_N : of the rig.
    preload_N : force where the displacement counts from; it has come on in no time.
    """

    law: Yeoh
    effects: tuple[MaterialEffect, ...]
    height_m: float
    area_m2: float
    compliance_m_N: float = 0.0
    preload_N: float = 0.0

    @staticmethod
    def of(law: Yeoh, effects: Sequence[Effect], height_m: float, area_m2: float) -> Platens:
        """With effects of ``UNIFORM``."""
        rig = {}
        for effect in effects:
            if isinstance(effect, Compressible):
                law = law.model_copy(update={"poisson": effect.poisson})
            elif isinstance(effect, Compliance):
                rig["compliance_m_N"] = 1e-3 * effect.compliance_mm_N
            elif isinstance(effect, Preload):
                rig["preload_N"] = effect.force_N
        material = tuple(effect for effect in effects if isinstance(effect, MaterialEffect))
        return Platens(law, material, height_m, area_m2, **rig)

    def followed(self, course: Course) -> tuple[Course, np.ndarray, bool]:
        """The course, finer where contact is lost or found between instants; force (n,) N; whether it is so lost or found.

        Raises
        ------
        RunError : no state is found.
        """
        way, force, free = self._solved(course, np.maximum(course.imposed, 0.0))
        lost = (force[:-1] > 0.0) & free[1:] | free[:-1] & (force[1:] > 0.0)
        if not lost.any():
            return course, force, False
        finer = course
        for number in np.flatnonzero(lost)[::-1] + 1:
            finer = finer.split(int(number), CAREFUL)
        return finer, self._solved(finer, np.interp(finer.time_s, course.time_s, way))[1], True

    def _solved(self, course: Course, way: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Way of the tissue [m], force [N], and whether the platen does not touch, (n,) each, from a guess of the way."""
        start = self._preloaded()
        machine = course.imposed + start + self.compliance_m_N * self.preload_N  # since first touch
        small = CLOSE * self.height_m
        at, slope = way, self._slope(way)
        ways: list[np.ndarray] = []
        changes: list[np.ndarray] = []
        for _ in range(TURNS):
            force = self._force(course.time_s, way, start)
            if np.abs(way - at).max() > FAR * self.height_m:
                at, slope = way, self._slope(way)
            touching = (machine - self.compliance_m_N * force - way) / (1.0 + self.compliance_m_N * slope)
            free = -force / slope
            loose = touching < free - small
            change = np.maximum(touching, free)
            change[len(way) - int(np.argmin(loose[::-1])) :] = 0.0  # after the last contact nothing is borne
            if np.abs(change).max() <= small:
                return way, np.where(loose, 0.0, np.maximum(force, 0.0)), loose
            if changes and np.abs(change).max() > np.abs(changes[-1]).max():
                ways, changes = [], []  # it has led astray: a plain step
            # Anderson's mixing: the combination of the last turns that leaves least to change
            ways, changes = [*ways[-DEPTH:], way], [*changes[-DEPTH:], change]
            moved, left = np.diff(ways, axis=0).T, np.diff(changes, axis=0).T
            way = way + change - (moved + left) @ np.linalg.lstsq(left, change, rcond=None)[0]
            way = np.clip(way, 0.0, 0.5 * (ways[-1] + self.height_m))
        raise RunError(
            f"the way of the tissue is not found: after {TURNS} turns it still changes by {1e3 * np.abs(change).max():.2g} mm; "
            "take a smaller compliance of the rig."
        )

    def _preloaded(self) -> float:
        """Way [m] at which tissue that is pressed in no time bears the preload."""
        way, now = np.zeros(1), np.zeros(1)
        for _ in range(TURNS):
            change = (self.preload_N - self._force(now, way)) / self._slope(way)
            way = np.minimum(way + change, 0.5 * (way + self.height_m))
            if abs(change[0]) <= CLOSE * self.height_m:
                return float(way[0])
        raise RunError(f"the tissue does not bear a preload of {self.preload_N:g} N; take a smaller one.")

    def _force(self, time_s: np.ndarray, way: np.ndarray, start: float = 0.0) -> np.ndarray:
        """Force (n,) N of tissue that is shortened by ``way``, suddenly by ``start`` before; negative where it is pulled."""
        times, ways = np.concatenate([time_s[:1], time_s[:1], time_s]), np.concatenate([[0.0, start], way])
        return -self.area_m2 * point.uniaxial(self.law, self.effects, times, 1.0 - ways / self.height_m)[2:]

    def _slope(self, way: np.ndarray) -> np.ndarray:
        """Slope (n,) N/m of the force in a sudden change, in which nothing is remembered."""
        sudden = [effect for effect in self.effects if not effect.memory]
        stretch = 1.0 - way / self.height_m
        both = np.concatenate([stretch - STEP, stretch + STEP])
        low, high = np.split(point.uniaxial(self.law, sudden, np.zeros(len(both)), both), 2)
        return self.area_m2 / self.height_m * (high - low) / (2.0 * STEP)
