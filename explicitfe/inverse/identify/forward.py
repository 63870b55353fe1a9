"""Response of an elastic law in the test of a measured curve, for any constants.

Homogeneous tests have closed forms for every law. Tests under a tool need the simulator. Without gravity all moduli scale
together, contact included, so F = C10 Phi(d; C20 / C10) is exact: one run gives the force at all depths for one ratio of two
constants, and any size of them. A response stores a few runs as smooth functions of depth and interpolates between the ratios by
a cubic spline in q = C20 / (C10 + C20). For the Mooney-Rivlin law C01 takes the place of C20; for the neo-Hooke law q is 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import CubicSpline

from explicitfe.fem.materials.homogeneous import Mode, nominal_slope, nominal_stress
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.inverse.identify.laws import YEOH, ConstantsLike, FitLaw
from explicitfe.inverse.predict.setup import Setup
from explicitfe.platform.errors import RunError

ShareDone = Callable[[float], None]

REFERENCE_PA = 200.0  # All runs have this C10 + C20; any value would do.
DEPTHS_OF_A_RUN = 16
DEPTH_POWER = 1.5  # Depths go with this power of their number: the polynomial needs some near 0.
# A simpler polynomial is taken when its error is no more than this times that of the best.
SIMPLER_ERROR_FACTOR = 1.3
DEGREES = range(4, 9)  # These degrees of the polynomial of F / d are tried; no more than half the number of depths.
# The variable of the polynomial is (d / largest) to one of these powers; the force of a ball begins with d^1.5.
VARIABLE_POWERS = (1.0, 0.5)
# q = C20 / (C10 + C20) of the first runs, the largest q, and the smallest distance of two runs.
FIRST_Q = (0.0, 0.3, 0.6)
LARGEST_Q = 0.95
CLOSEST_Q = 0.01
# A response is inverted by a table of so many depths, and so many steps of Newton from there.
INVERSION_DEPTHS = 400
INVERSION_STEPS = 3
# Platens are not closer than this share of the height.
LARGEST_SHORTENING_SHARE = 0.95


def forces(
    setup: Setup, constants: ConstantsLike, depths_m: Iterable[float], progress: ShareDone = lambda share: None
) -> np.ndarray:
    """Forces of the tool [N] at increasing depths, computed by the simulator; ``constants`` are those of the setup's law.

    Raises
    ------
    RunError : a depth is not reached.
    """
    body = setup.relaxation(*map(float, constants))
    depths_to_reach = list(depths_m)
    answers: list[float] = []
    for depth in depths_to_reach:
        reached = body.move(float(depth))
        if not isinstance(reached, Equilibrium):
            place = ", ".join(f"{1e3 * x:.3g}" for x in reached.place_m)
            raise RunError(
                f"the forward model stops at {1e3 * reached.reached:.3g} mm of {1e3 * depths_to_reach[-1]:.3g} mm "
                f"(constants {', '.join(f'{c:.4g}' for c in constants)} Pa; {reached.reason} at {place} mm): "
                "fit a smaller part of the curve, or use another `refinement`."
            )
        answers.append(reached.force_N)
        progress(len(answers) / len(depths_to_reach))
    return np.array(answers)


# ---- smooth in depth ----


@dataclass(frozen=True)
class Smooth:
    """F / d as a Chebyshev polynomial of (d / largest)^power, fitted to a run; beyond the run it goes on along its tangent.

    A run differs from such a polynomial by the roughness of contact on a mesh: forces rise in small steps as one point of the
    surface after the other comes into contact.
    """

    largest_m: float
    power: float
    degree: int

    def coefficients(self, depths_m: np.ndarray, force_N: np.ndarray) -> tuple[np.ndarray, float]:
        """Coefficients, and the relative rms deviation of the run from them."""
        secant = force_N / depths_m
        mean = np.abs(secant).mean()
        basis = chebyshev.chebvander(self._x(depths_m), self.degree) * (mean / secant)[:, None]
        c, *_ = np.linalg.lstsq(basis, np.full(len(secant), mean), rcond=None)
        residual = basis @ c / mean - 1.0
        return c, float(np.sqrt((residual**2).sum() / (len(residual) - self.degree - 1)))

    def at(self, c: np.ndarray, depth_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F [N] and dF/dd [N/m]; the force is 0 where the tool does not touch."""
        d = np.clip(depth_m, 0.0, self.largest_m)
        x = self._x(d)
        secant = chebyshev.chebval(x, c)
        slope = secant + chebyshev.chebval(x, chebyshev.chebder(c)) * self.power * (x + 1.0)
        return np.where(depth_m > 0.0, secant * d + slope * (depth_m - d), 0.0), np.where(depth_m > 0.0, slope, secant)

    def inverse(self, c: np.ndarray, force_N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """d [m] at a force, and dd/dF [m/N]; where the force does not rise, the depth is the one at which it last did."""
        table = np.linspace(0.0, self.largest_m, INVERSION_DEPTHS)
        values, slopes = self.at(c, table)
        rising = np.maximum.accumulate(values)
        depth = np.interp(force_N, rising, table)
        depth += np.maximum(force_N - rising[-1], 0.0) / max(slopes[-1], 1e-3 * rising[-1] / table[-1])
        for _ in range(INVERSION_STEPS):
            value, slope = self.at(c, depth)
            safe = np.where(slope > 0.0, slope, np.inf)
            depth = np.where(force_N > 0.0, np.maximum(depth + (force_N - value) / safe, 0.0), 0.0)
        slope = self.at(c, depth)[1]
        return depth, np.where(slope > 0.0, 1.0 / np.where(slope > 0.0, slope, 1.0), 0.0)

    def _x(self, depth_m: np.ndarray) -> np.ndarray:
        return 2.0 * (depth_m / self.largest_m) ** self.power - 1.0


def depths(largest_m: float, count: int) -> np.ndarray:
    """Depths of a run (count,) m."""
    return largest_m * (np.arange(1, count + 1) / count) ** DEPTH_POWER


def smoothest(depths_m: np.ndarray, runs: Iterable[np.ndarray]) -> Smooth:
    """The simplest polynomial that is about as good as the best one by generalised cross-validation.

    Roughness is no white noise: neighbouring depths share it, and a polynomial of a high degree would follow it.
    """
    runs = list(runs)
    count = len(depths_m)

    def error(smooth: Smooth) -> float:
        squares = [smooth.coefficients(depths_m, run)[1] ** 2 for run in runs]
        return float(np.sqrt(sum(squares) / (1.0 - (smooth.degree + 1) / count)))

    kinds = [Smooth(float(depths_m[-1]), power, degree) for degree in DEGREES for power in VARIABLE_POWERS if 2 * degree <= count]
    errors = [error(kind) for kind in kinds]
    return next(kind for kind, e in zip(kinds, errors, strict=True) if e <= SIMPLER_ERROR_FACTOR * min(errors))


# ---- responses ----


class ToolResponse:
    """Force of a tool for any constants and depth, from a few runs.

    Parameters
    ----------
    setup : the test.
    largest_m : largest depth of the runs.

    Attributes
    ----------
    runs : simulations so far.
    """

    def __init__(self, setup: Setup, largest_m: float, points: int = DEPTHS_OF_A_RUN) -> None:
        self.setup = setup
        self.depths_m = depths(largest_m, points)
        self.runs = 0
        self.smooth: Smooth | None = None
        self._runs: dict[float, np.ndarray] = {}
        self._spline: CubicSpline | None = None

    @property
    def ratios(self) -> list[float]:
        """q of the runs, increasing."""
        return sorted(self._runs)

    @property
    def roughness(self) -> float:
        """Numerical noise: the relative rms deviation of the runs' forces from the smooth polynomial."""
        assert self.smooth is not None
        deviations = [self.smooth.coefficients(self.depths_m, run)[1] for run in self._runs.values()]
        return float(np.sqrt(np.mean(np.square(deviations))))

    def add(self, ratios: Iterable[float], progress: ShareDone = lambda share: None) -> None:
        """Run the simulator for these q, unless a run is near enough."""
        wanted: list[float] = []
        for q in ratios:
            q = float(np.clip(q, 0.0, LARGEST_Q))
            if all(abs(q - other) > CLOSEST_Q for other in [*self._runs, *wanted]):
                wanted.append(q)
        for k, q in enumerate(wanted):
            C10, C20 = REFERENCE_PA * (1.0 - q), REFERENCE_PA * q
            self._runs[q] = forces(self.setup, (C10, C20), self.depths_m, _part_of(progress, k, len(wanted)))
            self.runs += 1
        if wanted and len(self._runs) >= len(FIRST_Q):
            self._interpolate()
        progress(1.0)

    def check(self, q: float, progress: ShareDone = lambda share: None) -> float:
        """Run the simulator at q too; the largest deviation of the interpolated response from that run, relative to the force."""
        q = float(np.clip(q, 0.0, LARGEST_Q))
        assert self.smooth is not None
        if q in self._runs:
            return 0.0
        before = self.smooth.at(self._coefficients(q), self.depths_m)[0]
        run = forces(self.setup, (REFERENCE_PA * (1.0 - q), REFERENCE_PA * q), self.depths_m, progress) / REFERENCE_PA
        self.runs += 1
        now = self.smooth.at(self.smooth.coefficients(self.depths_m, run)[0], self.depths_m)[0]
        for other in [r for r in self._runs if 0.0 < abs(r - q) < CLOSEST_Q]:
            del self._runs[other]
        self._runs[q] = REFERENCE_PA * run
        self._interpolate()
        return float(np.abs(before / now - 1.0).max())

    def at_depth(self, depth_m: np.ndarray, C10_Pa: float, C20_Pa: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and its slope [N/m]."""
        assert self.smooth is not None
        scale = C10_Pa + C20_Pa
        force, slope = self.smooth.at(self._coefficients(C20_Pa / scale), np.asarray(depth_m, dtype=float))
        return scale * force, scale * slope

    def at_force(self, force_N: np.ndarray, C10_Pa: float, C20_Pa: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Depth [m] and its slope [m/N]."""
        assert self.smooth is not None
        scale = C10_Pa + C20_Pa
        return self.smooth.inverse(scale * self._coefficients(C20_Pa / scale), np.asarray(force_N, dtype=float))

    def _interpolate(self) -> None:
        q = self.ratios
        if self.smooth is None:
            self.smooth = smoothest(self.depths_m, self._runs.values())
        rows = [self.smooth.coefficients(self.depths_m, self._runs[r] / REFERENCE_PA)[0] for r in q]
        self._spline = CubicSpline(q, rows, axis=0)

    def _coefficients(self, q: float) -> np.ndarray:
        assert self._spline is not None
        inside = float(np.clip(q, self._spline.x[0], self._spline.x[-1]))
        return self._spline(inside) + (q - inside) * self._spline(inside, 1)


class UniformResponse:
    """Force between frictionless platens on a sliding base: the state is homogeneous, so the closed form of the law is exact.

    The simulator agrees within 1e-3 until the free sides buckle, below a stretch of 0.44 (Biot's surface instability).
    """

    runs = 0
    roughness = 0.0

    def __init__(self, setup: Setup, poisson: float, law: FitLaw = YEOH) -> None:
        self.height_m = 1e-3 * setup.height_mm
        self.area_m2 = 1e-6 * setup.area_mm2
        self._point = PointResponse("uniaxial", poisson, law)

    def value(self, depth_m: np.ndarray, *constants: float) -> np.ndarray:
        """Force [N] at a depth."""
        return -self.area_m2 * self._point.value(1.0 - np.maximum(depth_m, 0.0) / self.height_m, *constants)

    def at_depth(self, depth_m: np.ndarray, *constants: float) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and its slope [N/m]; the force is 0 where the platen does not touch."""
        depth_m = np.asarray(depth_m, dtype=float)
        stress, slope = self._point.at(1.0 - np.maximum(depth_m, 0.0) / self.height_m, *constants)
        return -self.area_m2 * stress, self.area_m2 * slope / self.height_m

    def at_force(self, force_N: np.ndarray, *constants: float) -> tuple[np.ndarray, np.ndarray]:
        """Depth [m] and its slope [m/N]."""
        force_N = np.asarray(force_N, dtype=float)
        table = self.height_m * np.linspace(0.0, LARGEST_SHORTENING_SHARE, INVERSION_DEPTHS)
        depth = np.interp(force_N, self.at_depth(table, *constants)[0], table)
        for _ in range(INVERSION_STEPS):
            value, slope = self.at_depth(depth, *constants)
            depth = np.clip(depth + (force_N - value) / slope, 0.0, LARGEST_SHORTENING_SHARE * self.height_m)
        return depth, 1.0 / self.at_depth(depth, *constants)[1]


class PointResponse:
    """Stress of a law in a homogeneous state: uniaxial, equibiaxial or planar load with free sides, or simple shear."""

    runs = 0
    roughness = 0.0

    def __init__(self, kind: Mode, poisson: float, law: FitLaw = YEOH) -> None:
        self.kind = kind
        self.poisson = poisson
        self.law = law

    def value(self, imposed: np.ndarray, *constants: float) -> np.ndarray:
        """Stress [Pa] at a stretch, or at an amount of shear."""
        return nominal_stress(self.law.at(constants, self.poisson), self.kind, np.asarray(imposed, dtype=float))

    def at(self, imposed: np.ndarray, *constants: float) -> tuple[np.ndarray, np.ndarray]:
        """Stress [Pa] at a stretch, or at an amount of shear, and its slope."""
        return nominal_slope(self.law.at(constants, self.poisson), self.kind, imposed)


def _part_of(progress: ShareDone, number: int, count: int) -> ShareDone:
    """Progress of one run of several."""
    return lambda share: progress((number + share) / count)


Response = ToolResponse | UniformResponse | PointResponse


@dataclass(frozen=True)
class CurveModel:
    """Prediction of one curve from its imposed column."""

    response: Response
    by_force: bool = False

    def __call__(self, imposed: np.ndarray, *constants: float) -> np.ndarray:
        if not self.by_force and not isinstance(self.response, ToolResponse):
            return self.response.value(imposed, *constants)  # much faster than with the slope
        return self.with_slope(imposed, *constants)[0]

    def with_slope(self, imposed: np.ndarray, *constants: float) -> tuple[np.ndarray, np.ndarray]:
        """The predicted column in SI, and its derivative with respect to the imposed one."""
        if isinstance(self.response, PointResponse):
            return self.response.at(imposed, *constants)
        if self.by_force:
            return self.response.at_force(imposed, *constants)
        return self.response.at_depth(imposed, *constants)


def ratio(C10_Pa: float, C20_Pa: float = 0.0) -> float:
    """q = C20 / (C10 + C20)."""
    return C20_Pa / (C10_Pa + C20_Pa) if math.isfinite(C20_Pa) else 1.0
