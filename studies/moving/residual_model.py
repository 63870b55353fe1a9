"""A residual model without names: a Gaussian process on the residual acceleration of the first mode of a beam.

As residual physics does (Gao et al. 2024), it corrects a simulation by a force that is learnt from the difference between data
and simulation, as a function of the state. The state is the amplitude of the beam's first mode, its velocity, and the load. The
amplitude is read from the measured markers along the shape in which the simulation moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import UnivariateSpline
from scipy.optimize import minimize

from explicitfe.results.documents.motion_report import MovingMarkers

TRAINED_ROWS = 120  # of each curve: the cost of a Gaussian process grows with the cube of their number


class _Process:
    """Gaussian process with a squared exponential kernel, whose numbers maximize the marginal likelihood."""

    def __init__(self, x: np.ndarray, y: np.ndarray) -> None:
        self.x, self.y = x, y
        best = minimize(self._cost, np.array([0.0] * x.shape[1] + [0.0, -2.0]), method="Nelder-Mead", options={"maxiter": 300})
        self.p = best.x
        self.weights = np.linalg.solve(self._kernel(x, x) + np.exp(2.0 * self.p[-1]) * np.eye(len(x)), y)

    def _kernel(self, a: np.ndarray, b: np.ndarray, p: np.ndarray | None = None) -> np.ndarray:
        p = self.p if p is None else p
        scale = np.exp(p[: a.shape[1]])
        square = np.sum(((a[:, None] - b[None]) / scale) ** 2, axis=2)
        return np.exp(2.0 * p[-2] - 0.5 * square)

    def _cost(self, p: np.ndarray) -> float:
        K = self._kernel(self.x, self.x, p) + (np.exp(2.0 * p[-1]) + 1e-8) * np.eye(len(self.x))
        try:
            factor = np.linalg.cholesky(K)
        except np.linalg.LinAlgError:
            return 1e12
        white = np.linalg.solve(factor, self.y)
        return float(0.5 * white @ white + np.log(np.diag(factor)).sum() + 0.05 * np.sum(p**2))

    def __call__(self, x: np.ndarray) -> float:
        return float(self._kernel(x[None], self.x)[0] @ self.weights)


def predict_with_residual(curves: Sequence[MovingMarkers], loads_N: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Paths (k, s, 3) mm of the markers of each curve, by a model that is trained on those that are fitted."""
    largest = max(max(loads_N.values()), 1e-9)
    shape = curves[0].after.reshape(len(curves[0].time_s), -1)
    direction = np.linalg.svd(shape, full_matrices=False)[2][0]
    states, residuals = [], []
    # The simulation's own equation of motion in this amplitude: q'' = a + b q + c q' for each load.
    own = {one.curve: _own_equation(one, direction) for one in curves}
    for one in curves:
        if one.split != "fit":
            continue
        t = one.time_s
        q = one.measured.reshape(len(t), -1) @ direction
        spline = UnivariateSpline(t, q, k=5, s=len(t) * 0.01**2)
        velocity, acceleration = spline.derivative(1)(t), spline.derivative(2)(t)
        a, b, c = own[one.curve]
        rows = np.unique(np.linspace(2, len(t) - 3, TRAINED_ROWS).astype(int))
        states.append(np.column_stack([q[rows], velocity[rows], np.full(len(rows), loads_N[one.curve] / largest)]))
        residuals.append((acceleration - (a + b * q + c * velocity))[rows])
    x, y = np.concatenate(states), np.concatenate(residuals)
    scale, size = np.maximum(np.abs(x).max(axis=0), 1e-9), float(np.std(y))
    process = _Process(x / scale, y / size)
    paths = {}
    for one in curves:
        a, b, c = own[one.curve]
        load = loads_N[one.curve] / largest

        def motion(t: float, s: np.ndarray, a: float = a, b: float = b, c: float = c, load: float = load) -> list[float]:
            more = size * process(np.array([s[0], s[1], load]) / scale)
            return [s[1], a + b * s[0] + c * s[1] + more]

        t = one.time_s
        first = float(one.after.reshape(len(t), -1)[0] @ direction)
        solved = solve_ivp(motion, (0.0, float(t[-1])), [first, 0.0], t_eval=t, max_step=0.01, rtol=1e-4)
        q = solved.y[0] if solved.success and solved.y.shape[1] == len(t) else np.zeros(len(t))
        reached = one.after.reshape(len(t), -1)
        amplitude = reached @ direction
        # what the amplitude does not describe is taken from the simulation
        paths[one.curve] = (reached + np.outer(q - amplitude, direction)).reshape(one.after.shape)
    return paths


def _own_equation(one: MovingMarkers, direction: np.ndarray) -> np.ndarray:
    """Coefficients of q'' = a + b q + c q' of the simulation of a curve."""
    t = one.time_s
    q = one.after.reshape(len(t), -1) @ direction
    spline = UnivariateSpline(t, q, k=5, s=0.0)
    rows = slice(3, -3)
    design = np.column_stack([np.ones(len(t)), q, spline.derivative(1)(t)])[rows]
    return np.linalg.lstsq(design, spline.derivative(2)(t)[rows], rcond=None)[0]
