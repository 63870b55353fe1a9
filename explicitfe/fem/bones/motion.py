"""Rigid motion of a bone over time: rotation about a fixed axis, and translation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RigidMotion:
    """A rotation about a fixed axis with a shift, both in proportion to one course in time.

    Attributes
    ----------
    centre_m : (3,) m. A point of the axis at rest.
    turn_rad : (3,) rad. Axis times angle at course 1, by the right-hand rule.
    shift_m : (3,) m. Shift of the axis at course 1; or (k, 3) m, the shift at each time whatever the course.
    time_s, course : (k,), (k,). Piecewise linear; before the first time and after the last the first and the last value.
    """

    centre_m: np.ndarray
    turn_rad: np.ndarray
    shift_m: np.ndarray
    time_s: np.ndarray
    course: np.ndarray

    def placement(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations R (t, 3, 3) and shifts s (t, 3) m at times (t,): a point X of the bone at rest is at R X + s.

        R is that of Rodrigues' formula (1840).
        """
        share = np.interp(np.asarray(times_s, dtype=float), self.time_s, self.course)
        angle = float(np.linalg.norm(self.turn_rad))
        axis = self.turn_rad / angle if angle > 0.0 else np.array([0.0, 1.0, 0.0])
        cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        sine, cosine = np.sin(share * angle), np.cos(share * angle)
        rotation = np.eye(3) + sine[:, None, None] * cross + (1.0 - cosine)[:, None, None] * (cross @ cross)
        shift = share[:, None] * self.shift_m if self.shift_m.ndim == 1 else along(self.time_s, self.shift_m, times_s)
        return rotation, self.centre_m + shift - rotation @ self.centre_m

    @property
    def edges_s(self) -> np.ndarray:
        """Times at which the speed jumps: they are put on step boundaries."""
        return np.unique(self.time_s)


def along(time_s: np.ndarray, path_m: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """Places (t, 3) m at times (t,) s on a path (k, 3) m with the times (k,) s, linear in between and constant outside."""
    return np.stack([np.interp(times_s, time_s, path_m[:, axis]) for axis in range(3)], axis=1)
