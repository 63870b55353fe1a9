"""A residual model without names: a small network that corrects the acceleration of a beam in its first mode.

As residual physics does (Gao et al. 2024), it adds to a simulation a force that is learnt from data as a function of the state:
the amplitude of the motion, its velocity, and the load. It consists of radial basis functions and linear terms, and is trained on
whole motions, with a penalty that is chosen by leaving out each fitted curve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline, UnivariateSpline
from scipy.optimize import least_squares

from explicitfe.results.documents.motion_report import MovingMarkers

STEP_S, LATEST_START_S = 0.0025, 0.03
# Levels of the scaled amplitude, velocity and load at which basis functions sit, and their width.
LEVELS, WIDTH = ((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (0.0, 1.0)), 1.0
PENALTIES = (1e-3, 1e-2, 1e-1, 1.0)
LARGEST_STATE = 5.0  # beyond it a motion is none


@dataclass(frozen=True, eq=False)
class _Curve:
    """A curve in one amplitude.

    Attributes
    ----------
    time_s, measured, simulated : (k,) times, and amplitudes.
    own : coefficients of the simulation's own equation q'' = a + b q + c q'.
    load : relative to the largest.
    start_s : time at which the simulated motion begins.
    """

    time_s: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    own: np.ndarray
    load: float
    start_s: float = 0.0


@dataclass(frozen=True, eq=False)
class _Network:
    """Scales of amplitude and velocity, and where the basis functions sit."""

    scales: np.ndarray
    centres: np.ndarray

    @property
    def size(self) -> int:
        return len(self.centres) + self.centres.shape[1] + 1

    def motion(self, curve: _Curve, weights: np.ndarray) -> np.ndarray:
        """Amplitudes (m, k) from rest at the times of a curve, for weights (m, size); by the method of Runge and Kutta."""
        a, b, c = curve.own
        steps = int(np.ceil((curve.time_s[-1] + LATEST_START_S) / STEP_S)) + 1
        unit = self.scales[1] * np.sqrt(max(-b, 1.0))  # of an acceleration

        def rate(state: np.ndarray) -> np.ndarray:
            q, v = np.clip(state, -LARGEST_STATE * self.scales, LARGEST_STATE * self.scales).T
            s = np.column_stack([q / self.scales[0], v / self.scales[1], np.full(len(q), curve.load)])
            bumps = np.exp(-0.5 * np.sum(((s[:, None] - self.centres) / WIDTH) ** 2, axis=2))
            learnt = np.sum(weights * np.column_stack([bumps, s, np.ones(len(s))]), axis=1)
            return np.column_stack([state[:, 1], a + b * state[:, 0] + c * state[:, 1] + unit * learnt])

        state = np.zeros((len(weights), 2))
        path = [state[:, 0]]
        for _ in range(steps):
            one = rate(state)
            two = rate(state + 0.5 * STEP_S * one)
            three = rate(state + 0.5 * STEP_S * two)
            four = rate(state + STEP_S * three)
            state = state + STEP_S / 6.0 * (one + 2.0 * two + 2.0 * three + four)
            path.append(state[:, 0])
        since = np.maximum(curve.time_s - curve.start_s, 0.0)
        return np.asarray(CubicSpline(STEP_S * np.arange(steps + 1), np.array(path))(since).T)

    def with_equation(self, curves: Sequence[_Curve]) -> list[_Curve]:
        """Curves of one load with the equation, which they share, and the starts that describe their simulations best."""

        def changed(x: np.ndarray) -> list[_Curve]:
            return [
                replace(one, own=curves[0].own * (1.0 + x[:3]), start_s=start) for one, start in zip(curves, x[3:], strict=True)
            ]

        def misfit(x: np.ndarray) -> np.ndarray:
            none = np.zeros((1, self.size))
            return np.concatenate([self.motion(one, none)[0] - one.simulated for one in changed(x)])

        latest = np.array([0.5, 0.5, 0.9, *(LATEST_START_S for _ in curves)])
        return changed(least_squares(misfit, np.zeros(3 + len(curves)), bounds=(-latest, latest), x_scale=0.1 * latest).x)

    def trained(self, curves: Sequence[_Curve], penalty: float) -> np.ndarray:
        """Weights (size,) that bring whole motions to the measured ones."""

        def left(w: np.ndarray) -> np.ndarray:
            return every(w[None])[0]

        def every(w: np.ndarray) -> np.ndarray:
            misfits = [(self.motion(c, w) - c.measured) / self.scales[0] for c in curves]
            return np.column_stack([*misfits, np.sqrt(penalty) * w])

        def slopes(w: np.ndarray) -> np.ndarray:
            step = 1e-5
            rows = every(np.concatenate([w[None], w + step * np.eye(len(w))]))
            return np.asarray((rows[1:] - rows[0]).T / step)

        return np.asarray(least_squares(left, np.zeros(self.size), jac=slopes, max_nfev=60).x)

    def error(self, curve: _Curve, weights: np.ndarray) -> float:
        return float(np.mean((self.motion(curve, weights[None])[0] - curve.measured) ** 2))


def predict_with_residual(curves: Sequence[MovingMarkers], loads_N: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Paths (k, s, 3) mm of the markers of each curve, by a model that is trained on those that are fitted."""
    largest = max(max(loads_N.values()), 1e-9)
    # the shape in which the simulation moves
    direction = np.linalg.svd(curves[0].after.reshape(len(curves[0].time_s), -1), full_matrices=False)[2][0]
    own = {one.curve: _in_amplitude(one, direction, loads_N[one.curve] / largest) for one in curves}
    first = next(own[one.curve] for one in curves if one.split == "fit")
    scales = 0.5 * float(np.ptp(first.measured)) * np.array([1.0, np.sqrt(max(-first.own[1], 1.0))])
    network = _Network(scales, np.array(list(product(*LEVELS))))
    for load in {curve.load for curve in own.values()}:
        names = [name for name, curve in own.items() if curve.load == load]
        own |= dict(zip(names, network.with_equation([own[name] for name in names]), strict=True))
    fitted = [own[one.curve] for one in curves if one.split == "fit"]
    scores = {
        penalty: sum(
            network.error(one, network.trained([c for c in fitted if c is not one], penalty)) for one in fitted if len(fitted) > 1
        )
        for penalty in PENALTIES
    }
    weights = network.trained(fitted, min(scores, key=lambda penalty: scores[penalty]))
    paths = {}
    for one in curves:
        reached = one.after.reshape(len(one.time_s), -1)
        q = network.motion(own[one.curve], weights[None])[0]
        # what the amplitude does not describe is taken from the simulation
        paths[one.curve] = (reached + np.outer(q - reached @ direction, direction)).reshape(one.after.shape)
    return paths


def _in_amplitude(one: MovingMarkers, direction: np.ndarray, load: float) -> _Curve:
    """A curve in one amplitude, with the equation q'' = a + b q + c q' that describes its simulation."""
    t = one.time_s
    q = one.after.reshape(len(t), -1) @ direction
    spline = UnivariateSpline(t, q, k=5, s=0.0)
    rows = slice(3, -3)
    design = np.column_stack([np.ones(len(t)), q, spline.derivative(1)(t)])[rows]
    own = np.linalg.lstsq(design, spline.derivative(2)(t)[rows], rcond=None)[0]
    return _Curve(t, one.measured.reshape(len(t), -1) @ direction, q, own, load)
