"""Tissue between platens without friction: a homogeneous state; the platen may lose contact, and the rig may give way.

The unknown is the shortening of the tissue. It is found for all instants together, with the stiffness of the tissue in a sudden
small change: where the platen touches, shortening + compliance x force is what the machine went; where it does not touch, the
tissue is free and bears nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.effects import Effect, MaterialEffect
from explicitfe.fem.effects.effect import Rig, with_leaves
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.inverse.measured.course import Course
from explicitfe.inverse.predict.mixing import Mixing
from explicitfe.platform.errors import RunError

MOST_CORRECTIONS = 100  # The search for a state is given up after this many.
# A state is known no better than to this share of the height: the tolerance of the law's own solver.
SHORTENING_TOLERANCE_HEIGHT_SHARE = 1e-9
# The stiffness is a central difference over this change of the stretch.
STIFFNESS_STRETCH_CHANGE = 1e-5
# The stiffness is computed again after the shortening has changed by this share of the height.
STIFFNESS_VALID_HEIGHT_SHARE = 1e-2
# The step in which contact is lost or found is cut into this many.
STEPS_TO_LOSS_OF_CONTACT = 4


@dataclass(frozen=True)
class Platens:
    """A specimen between two platens.

    Attributes
    ----------
    law, effects : the tissue.
    height_m, area_m2 : the specimen.
    rig : compliance, and the preload where the displacement counts from; the preload has come on in no time.
    """

    law: Yeoh
    effects: tuple[MaterialEffect, ...]
    height_m: float
    area_m2: float
    rig: Rig

    @staticmethod
    def of(law: Yeoh, effects: Sequence[Effect], height_m: float, area_m2: float) -> Platens:
        """With effects that keep the state homogeneous."""
        rig = Rig()
        for effect in effects:
            law, rig = effect.in_law(law), effect.on_rig(rig)
        return Platens(law, with_leaves(effects), height_m, area_m2, rig)

    def follow(self, course: Course) -> tuple[Course, np.ndarray, bool]:
        """Answer to a course.

        Returns
        -------
        course : finer than the given one where contact is lost or found between instants.
        force_N : (n,) at its instants.
        loses_contact : whether contact is lost or found between instants.

        Raises
        ------
        RunError : no state is found.
        """
        shortening, force, free = self._solve(course, np.maximum(course.imposed, 0.0))
        changes = (force[:-1] > 0.0) & free[1:] | free[:-1] & (force[1:] > 0.0)
        if not changes.any():
            return course, force, False
        finer = course
        for number in np.flatnonzero(changes)[::-1] + 1:
            finer = finer.split(int(number), STEPS_TO_LOSS_OF_CONTACT)
        return finer, self._solve(finer, np.interp(finer.time_s, course.time_s, shortening))[1], True

    def _solve(self, course: Course, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shortening of the tissue [m], force [N], and whether the platen is off the tissue, (n,) each."""
        compliance = self.rig.compliance_m_N
        preloaded = self._preloaded()
        machine = course.imposed + preloaded + compliance * self.rig.preload_N  # Here it counts from first touch.
        tolerance = SHORTENING_TOLERANCE_HEIGHT_SHARE * self.height_m
        shortening, stiffness_at, stiffness = guess, guess, self._stiffness(guess)
        mixing = Mixing()
        for _ in range(MOST_CORRECTIONS):
            force = self._force(course.time_s, shortening, preloaded)
            if np.abs(shortening - stiffness_at).max() > STIFFNESS_VALID_HEIGHT_SHARE * self.height_m:
                stiffness_at, stiffness = shortening, self._stiffness(shortening)
            if_touching = (machine - compliance * force - shortening) / (1.0 + compliance * stiffness)
            if_free = -force / stiffness
            off = if_touching < if_free - tolerance
            change = np.maximum(if_touching, if_free)
            change[len(shortening) - int(np.argmin(off[::-1])) :] = 0.0  # After the last contact the tissue bears nothing.
            if np.abs(change).max() <= tolerance:
                return shortening, np.where(off, 0.0, np.maximum(force, 0.0)), off
            last = shortening
            shortening = mixing.next(shortening, change)
            shortening = np.clip(shortening, 0.0, 0.5 * (last + self.height_m))
        raise RunError(
            f"the way of the tissue is not found: after {MOST_CORRECTIONS} turns it still changes by "
            f"{1e3 * np.abs(change).max():.2g} mm; take a smaller compliance of the rig."
        )

    def _preloaded(self) -> float:
        """Shortening [m] at which tissue that is pressed in no time bears the preload."""
        shortening, now = np.zeros(1), np.zeros(1)
        for _ in range(MOST_CORRECTIONS):
            change = (self.rig.preload_N - self._force(now, shortening)) / self._stiffness(shortening)
            shortening = np.minimum(shortening + change, 0.5 * (shortening + self.height_m))
            if abs(change[0]) <= SHORTENING_TOLERANCE_HEIGHT_SHARE * self.height_m:
                return float(shortening[0])
        raise RunError(f"the tissue does not bear a preload of {self.rig.preload_N:g} N; take a smaller one.")

    def _force(self, time_s: np.ndarray, shortening: np.ndarray, preloaded: float = 0.0) -> np.ndarray:
        """Force (n,) N of tissue, which is shortened suddenly by ``preloaded`` before all instants; negative in tension."""
        times = np.concatenate([time_s[:1], time_s[:1], time_s])
        stretches = 1.0 - np.concatenate([[0.0, preloaded], shortening]) / self.height_m
        return -self.area_m2 * point.uniaxial(self.law, self.effects, times, stretches)[2:]

    def _stiffness(self, shortening: np.ndarray) -> np.ndarray:
        """Slope (n,) N/m of the force in a sudden change, in which nothing is remembered."""
        sudden = [effect for effect in self.effects if not effect.memory]
        stretch = 1.0 - shortening / self.height_m
        both = np.concatenate([stretch - STIFFNESS_STRETCH_CHANGE, stretch + STIFFNESS_STRETCH_CHANGE])
        low, high = np.split(point.uniaxial(self.law, sudden, np.zeros(len(both)), both), 2)
        return self.area_m2 / self.height_m * (high - low) / (2.0 * STIFFNESS_STRETCH_CHANGE)
