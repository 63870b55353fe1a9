"""The answer of a homogeneous specimen, by numerics of its own: closed forms in numpy and scipy.

Nothing here shares code with the simulator. The pressure follows from the free sides, and the small change of volume from the
pressure. Relaxation is one banded solve over fine increments of all tests. Where there is no closed form (fibres across the
load, a rig with compliance), Newton's method solves for all instants together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.linalg import solve_banded
from scipy.special import erf

from studies.blind.grid import Effects, Grid, HomogeneousRun, Mode

INCREMENTS_PER_ROW = 8  # from one row to the next, where the material remembers
NEWTON_ITERATIONS = 200  # at most; a handful is usual
NEWTON_TOLERANCE = 1e-10  # Newton's method stops at this change of a stretch or of a volume ratio.
PLATEN_TOLERANCE_SHARE = 1e-8  # of the largest displacement: the change of a platen's depth at which Newton's method stops
SMALLEST_SLOPE_N_M = 1e-300  # avoids a division by zero where nothing touches
SLICES_OVER_HEIGHT = 12  # of a specimen whose moduli change with depth
TABLE_STRETCHES = 3000  # of a tabulated law
SMALLEST_TABLE_STRETCH = 0.15  # No test compresses as far as this.


Series = Callable[[float], list[tuple[float, float]]]  # height [m] -> slices: share of the height, factor of the moduli


class Bench:
    """A test bench: the planned curves, computed for any constants and effects.

    Parameters
    ----------
    plan : curves, those of one test side by side.
    mode : what is imposed.
    poisson : of the material at small strains; 0.5 keeps the volume.
    """

    def __init__(self, plan: Sequence[HomogeneousRun], mode: Mode, poisson: float = 0.499) -> None:
        self.poisson = poisson
        self.plan = tuple(plan)
        self.mode = mode
        self.lengths = [len(curve.time_s) for curve in plan]
        self.time_s = np.concatenate([curve.time_s for curve in plan])
        self._repeat = np.repeat([curve.repeat for curve in plan], self.lengths)
        self._grids = {parts: Grid(self.plan, parts, mode) for parts in (1, INCREMENTS_PER_ROW)}

    def curves(self, values: np.ndarray) -> list[np.ndarray]:
        """Rows of all curves (n,), curve by curve."""
        return np.split(values, np.cumsum(self.lengths)[:-1])

    def values(
        self,
        C10_Pa: float,
        C20_Pa: float,
        effects: Effects | None = None,
        parts: int | None = None,
        recovers: bool = True,
    ) -> np.ndarray:
        """The predicted column at all rows (n,): nominal stress or shear stress [Pa], or the force of a platen [N].

        Parameters
        ----------
        parts : increments from row to row; 1 where nothing relaxes.
        recovers : tissue that relaxes recovers freely when a platen has left it. Otherwise it follows the platen all the same,
            without a force, which is much quicker.
        """
        effects = effects or {}
        remembers = "viscoelastic" in effects or "power-law" in effects
        parts = parts or (INCREMENTS_PER_ROW if remembers else 1)
        if parts not in self._grids:
            self._grids[parts] = Grid(self.plan, parts, self.mode)
        grid = self._grids[parts]
        poisson = effects.get("compressible", {}).get("poisson", self.poisson)
        law = _Law(C10_Pa, C20_Pa, poisson, effects, grid)
        if self.mode == "platen":
            column = _platen(law, effects, recovers)[grid.rows]
        else:
            column = (law.shear if self.mode == "shear" else law.uniaxial)(grid.imposed)[grid.rows]
        drift = effects.get("cycle-drift", {}).get("per_cycle", 0.0)
        column = column * (1.0 + drift * (self._repeat - 1.0))
        if "stick-slip" in effects:
            column = column + _jumps(self, effects["stick-slip"])
        column = column + effects.get("force-offset", {}).get("offset_N", 0.0)
        return column + effects.get("force-drift", {}).get("rate_N_s", 0.0) * self.time_s


def _platen(law: _Law, effects: Effects, recovers: bool) -> np.ndarray:
    """Force [N] at the instants of the law's grid."""
    grid = law.grid
    offset: float | np.ndarray = 1e-3 * effects.get("contact-offset", {}).get("offset_mm", 0.0)
    if "preload" in effects:
        offset = _touch_at(law, effects["preload"]["force_N"])
    imposed = depth = grid.approach_with(offset)
    compliance = 1e-3 * effects.get("compliance", {}).get("compliance_mm_N", 0.0)
    lifts = law.relaxes and recovers
    if compliance == 0.0 and not lifts:
        return np.maximum(law.force(np.maximum(imposed, 0.0)), 0.0)
    step = 1e-6 * grid.height_m
    for _ in range(NEWTON_ITERATIONS):
        depth = depth if lifts else np.maximum(depth, 0.0)
        force = law.force(depth)
        slope = (law.force(depth + step, at_once=True) - law.force(depth - step, at_once=True)) / (2.0 * step)
        if not lifts:
            force, slope = np.maximum(force, 0.0), np.where(force > 0.0, slope, 0.0)
        gap = depth - imposed + compliance * force
        # Where the platen touches the gap is zero, elsewhere the force.
        touches = (force > slope * gap) if lifts else np.ones(len(imposed), dtype=bool)
        change = np.where(touches, -gap / (1.0 + compliance * slope), -force / np.maximum(slope, SMALLEST_SLOPE_N_M))
        depth = depth + change
        if np.abs(change).max() <= PLATEN_TOLERANCE_SHARE * np.abs(imposed).max():
            break
    return np.where(touches, np.maximum(law.force(depth if lifts else np.maximum(depth, 0.0)), 0.0), 0.0)


class _Law:
    """The material with its effects, over the instants of a grid; it begins at rest in each test."""

    def __init__(self, C10_Pa: float, C20_Pa: float, poisson: float, effects: Effects, grid: Grid) -> None:
        self.poisson = poisson
        self.constants = C10_Pa, C20_Pa, effects.get("third-yeoh", {}).get("C30_Pa", 0.0)
        self.softening = effects.get("softening")
        self.fibres = effects.get("fibres")
        relaxing = effects.get("viscoelastic", {"g": (), "tau_s": ()})
        self.terms = list(zip(relaxing["g"], relaxing["tau_s"], strict=True))
        self.power = effects.get("power-law")
        self.threshold = effects.get("threshold")
        self.series = _series(effects)
        self.grid = grid

    # ---- what is measured ----

    def shear(self, amount: np.ndarray) -> np.ndarray:
        """Shear stress P_xz (m,) [Pa] at F_xz: T_xz + k T_zz, in which the pressure has no part."""
        I1 = 3.0 + amount**2
        a = self._isotropic(I1)
        T13, T33 = self._relax(np.stack([a * I1 * amount / 3.0, a * (1.0 - I1 / 3.0)], axis=1)).T
        return T13 + amount * T33 + self._beyond(amount)

    def uniaxial(self, stretch: np.ndarray, *, at_once: bool = False) -> np.ndarray:
        """Nominal stress (m,) [Pa]; ``at_once``: nothing relaxes."""
        if self.series is not None:
            return self._in_series(self.series, stretch)
        z = stretch**2
        J = np.ones_like(stretch)
        turned = self.fibres is not None and self.grid.across.any()
        u = -0.5 * np.log(z)  # log of the squared stretch along x
        for _ in range(NEWTON_ITERATIONS):
            free = np.log(J / stretch)
            u = self._lateral(np.where(self.grid.across, u, free), z, J, at_once) if turned else free
            x = np.exp(u)
            S = self._second_piola(x, z, J)
            Tx, Tz = (S if at_once else self._relax(S))[:, ::2].T
            wanted = self._volume(-Tx * x / J, J)
            done = np.abs(wanted - J).max() <= NEWTON_TOLERANCE
            J = wanted
            if done:
                break
        return stretch * Tz - Tx * x / stretch + self._beyond(stretch - 1.0)

    def force(self, depth_m: np.ndarray, *, at_once: bool = False) -> np.ndarray:
        """Force (m,) [N] at a depth; below 0 where a platen would have to pull."""
        return -self.grid.area_m2 * self.uniaxial(1.0 - depth_m / self.grid.height_m, at_once=at_once)

    @property
    def relaxes(self) -> bool:
        return bool(self.terms) or self.power is not None

    # ---- the material ----

    def _volume(self, pressure: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Volume ratio (m,) nearer to K/2 (J - 1/J) = pressure [Pa]."""
        if self.poisson == 0.5:
            return J
        G = 2.0 * self.constants[0]
        K = 2.0 * G * (1.0 + self.poisson) / (3.0 * (1.0 - 2.0 * self.poisson))
        # The pressure falls by about G where J grows by 1.
        return J + (pressure - 0.5 * K * (J - 1.0 / J)) / (K + G)

    def _isotropic(self, I1: np.ndarray) -> np.ndarray:
        """2 dW/dI1 [Pa], softened by the largest past energy of the test."""
        C10, C20, C30 = self.constants
        x = I1 - 3.0
        slope = C10 + (2.0 * C20 + 3.0 * C30 * x) * x
        if self.softening is not None:
            W = (C10 + (C20 + C30 * x) * x) * x
            largest = np.concatenate([np.maximum.accumulate(W[test]) for test in self.grid.tests])
            width = self.softening["m_Pa"] + self.softening.get("beta", 0.1) * largest
            slope = slope * (1.0 - self.softening["inverse_r"] * erf((largest - W) / width))
        return 2.0 * slope

    def _second_piola(self, x: np.ndarray, z: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Isochoric second Piola-Kirchhoff stress along x, y, z (m, 3) [Pa] at squared stretches and volume ratios."""
        C = np.stack([x, J**2 / (x * z), z], axis=1)
        square = J[:, None] ** (-2.0 / 3.0)
        I1 = C.sum(axis=1, keepdims=True)
        S = square * self._isotropic((square * I1)[:, 0])[:, None] * (1.0 - I1 / (3.0 * C))
        if self.fibres is not None:
            along = np.where(self.grid.across, 0, 2)[:, None]
            I4 = np.take_along_axis(C, along, axis=1)
            more = np.maximum(square * I4 - 1.0, 0.0)
            pull = 2.0 * self.fibres["k1_Pa"] * more * np.exp(self.fibres.get("k2", 1.0) * more**2) * square
            S = S + pull * ((np.arange(3) == along) - I4 / (3.0 * C))
        return S

    def _lateral(self, u: np.ndarray, z: np.ndarray, J: np.ndarray, at_once: bool) -> np.ndarray:
        """Log of the squared stretch along x (m,) at which both sides are free of stress: T_x x = T_y y."""

        def wrong(u: np.ndarray, at_once: bool) -> np.ndarray:
            S = self._second_piola(np.exp(u), z, J)
            T = S if at_once else self._relax(S)
            return np.where(self.grid.across, T[:, 0] * np.exp(u) - T[:, 1] * J**2 * np.exp(-u) / z, 0.0)

        for _ in range(NEWTON_ITERATIONS):
            slope = (wrong(u + 1e-6, True) - wrong(u - 1e-6, True)) / 2e-6
            change = wrong(u, at_once) / np.where(self.grid.across, slope, 1.0)
            u = u - np.clip(change, -0.3, 0.3)
            if np.abs(change).max() <= NEWTON_TOLERANCE:
                break
        return u

    def _relax(self, S: np.ndarray) -> np.ndarray:
        """The elastic stress (m, k) [Pa] after relaxation."""
        left = S
        for g, tau in self.terms:
            left = left - g * self._fade(S, tau)
        if self.power is not None:
            left = np.concatenate([_power_law(self.power, self.grid.increment_s[test], S[test]) for test in self.grid.tests])
        return left

    def _fade(self, S: np.ndarray, tau_s: float) -> np.ndarray:
        """Y of tau dY/dt = S - Y, where S is linear between instants."""
        x = self.grid.increment_s / tau_s
        kept = np.exp(-x)
        with np.errstate(invalid="ignore"):
            mean = np.where(x > 0.0, -np.expm1(-x) / x, 1.0)
        gain = (1.0 - mean)[:, None] * S
        gain[1:] += (mean - kept)[1:, None] * S[:-1]
        for test in self.grid.tests:
            gain[test.start] = 0.0
            kept[test.start] = 0.0
        bands = np.ones((2, len(x)))
        bands[1, :-1] = -kept[1:]
        return solve_banded((1, 0), bands, gain, check_finite=False)

    def _beyond(self, strain: np.ndarray) -> np.ndarray:
        """Stress [Pa] of a network that is slack below a threshold."""
        if self.threshold is None:
            return np.zeros_like(strain)
        return self.threshold["modulus_Pa"] * np.sign(strain) * np.maximum(np.abs(strain) - self.threshold["strain"], 0.0)

    def table(self) -> tuple[np.ndarray, np.ndarray]:
        """Stretches in compression, and the nominal stress [Pa] of the law alone, without relaxation."""
        stretch = np.linspace(SMALLEST_TABLE_STRETCH, 1.0, TABLE_STRETCHES)
        return stretch, _Law(*self.constants[:2], self.poisson, {}, self.grid).uniaxial(stretch)

    def _in_series(self, series: Series, stretch: np.ndarray) -> np.ndarray:
        """Nominal stress of a stack of slices of different moduli, each free to widen."""
        table, stress = self.table()
        stresses = np.empty_like(stretch)
        for height in np.unique(self.grid.height_m):
            whole = sum(share * np.interp(stress / factor, stress, table) for share, factor in series(height))
            here = self.grid.height_m == height
            stresses[here] = np.interp(stretch[here], whole, stress)
        return stresses


def _series(effects: Effects) -> Series | None:
    """The slices of a specimen whose moduli change with depth; None where they are the same everywhere."""
    if "layer" in effects:
        thickness, ratio = 1e-3 * effects["layer"]["thickness_mm"], effects["layer"]["ratio"]
        return lambda height: [(thickness / height, ratio), (1.0 - thickness / height, 1.0)]
    if "stiffness-gradient" in effects:
        depths = (np.arange(SLICES_OVER_HEIGHT) + 0.5) / SLICES_OVER_HEIGHT
        factors = 1.0 + effects["stiffness-gradient"]["g"] * (1.0 - 2.0 * depths)
        return lambda height: [(1.0 / SLICES_OVER_HEIGHT, float(factor)) for factor in factors]
    return None


def _power_law(power: Mapping[str, float], increment_s: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Relaxation without a time of its own: R(t) = 1 - s + s / (1 + (t / t0)^a), summed over all increments of a test."""
    t = np.cumsum(increment_s)
    since = np.maximum(t[:, None] - t[None, :], 0.0)
    left = 1.0 - power["share"] + power["share"] / (1.0 + (since / power["t0_s"]) ** power["exponent"])
    past = 0.5 * (left[:, 1:] + left[:, :-1]) * (np.arange(len(t))[:, None] >= np.arange(1, len(t))[None, :])
    return past @ np.diff(S, axis=0)


def _jumps(bench: Bench, slip: Mapping[str, float]) -> np.ndarray:
    """The drag of a rig that sticks and slips: it grows with the distance and lets go at once, at random distances."""
    rng = np.random.default_rng(int(slip["seed"]))
    drags = []
    for curve in bench.plan:
        bent, limit, drag = 0.0, slip["way"] * rng.uniform(0.2, 1.0), np.zeros(len(curve.time_s))
        for row, step in enumerate(np.diff(curve.imposed), 1):
            bent += step
            if abs(bent) > limit:
                bent, limit = -0.5 * np.sign(bent) * slip["way"] * rng.uniform(0.0, 0.4), slip["way"] * rng.uniform(0.5, 1.5)
            drag[row] = bent
        drags.append(slip["drag"] * drag / slip["way"])
    return np.concatenate(drags)


def _touch_at(law: _Law, force_N: float) -> np.ndarray:
    """Depth (m,) [m] at which a platen carries a force, without relaxation."""
    table, stress = law.table()
    return law.grid.height_m * (1.0 - np.interp(-force_N / law.grid.area_m2, stress, table))
