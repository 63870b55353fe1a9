"""Homogeneous tests in closed form, exactly incompressible: a library of its own, which shares no code with the simulator.

The pressure follows from the free sides. What relaxes is a Prony series of the second Piola-Kirchhoff stress (Simo, 1987), a
power law of time as many terms of one. A platen that leaves tissue which has not recovered is followed instant by instant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import gamma

import numpy as np
from scipy.linalg import solve_banded
from scipy.special import erf

from studies.blind.grid import Effects, Grid, HomogeneousRun, Mode, Parameters

RELAXING_PARTS = 8  # increments from row to row, where the past counts
POWER_LAW_NODES = 90  # of the sum of Prony terms that stands for a power law
POWER_LAW_RANGE = (-40.0, 4.0)  # of the logarithm of rate times tau
SUM_OF_SHARES = 0.9999  # of the terms: something is left for ever
BALANCE_ITERATIONS = 60  # of Newton's method for sides, volumes and rigs
BALANCE_TOLERANCE = 1e-11
STRAIN_STEP = 1e-6  # of differences
PREPARED_STRETCHES = 600  # of a law in a stack of slices
STACK_SLICES = 16
REMEMBER = ("viscoelastic", "power-law")
VOLUME_TERM = 0.5  # Poisson's ratio that keeps the volume


@dataclass(frozen=True)
class PointLaw:
    """What the material of a point is."""

    C10_Pa: float
    C20_Pa: float
    effects: Effects

    def number(self, effect: str, key: str) -> float:
        """A parameter of an effect, 0 where there is none."""
        return float(self.effects.get(effect, {}).get(key, 0.0))

    def slope(self, x: np.ndarray) -> np.ndarray:
        """dW/dI1 at I1 - 3 [Pa]."""
        return self.C10_Pa + (2.0 * self.C20_Pa + 3.0 * self.number("third-yeoh", "C30_Pa") * x) * x

    def energy(self, x: np.ndarray) -> np.ndarray:
        """W at I1 - 3 [Pa]."""
        return (self.C10_Pa + (self.C20_Pa + self.number("third-yeoh", "C30_Pa") * x) * x) * x

    @property
    def terms(self) -> list[tuple[float, float]]:
        """Shares and relaxation times."""
        relaxing = self.effects.get("viscoelastic", {"g": (), "tau_s": ()})
        terms = list(zip(relaxing["g"], relaxing["tau_s"], strict=True))
        if "power-law" in self.effects:
            terms += power_law_terms(self.effects["power-law"])
        return terms


def power_law_terms(parameters: Parameters) -> list[tuple[float, float]]:
    """Prony terms of 1 - (1 + t/tau)^-n: a gamma distribution of rates (Laplace's integral)."""
    n, tau = parameters["exponent"], parameters["tau_s"]
    logs = np.linspace(*POWER_LAW_RANGE, POWER_LAW_NODES)
    weights = np.exp(n * logs - np.exp(logs)) * (logs[1] - logs[0]) / gamma(n)
    weights *= SUM_OF_SHARES / weights.sum()
    return [(float(g), float(tau * np.exp(-y))) for g, y in zip(weights, logs, strict=True)]


class ForeignBench:
    """A test bench: the planned curves for any constants and effects, as :class:`studies.blind.closed_forms.Bench` has them.

    Parameters
    ----------
    plan : curves, those of one test side by side.
    mode : what is imposed.
    """

    poisson = VOLUME_TERM

    def __init__(self, plan: Sequence[HomogeneousRun], mode: Mode) -> None:
        self.plan, self.mode = tuple(plan), mode
        self.lengths = [len(curve.time_s) for curve in plan]
        self.time_s = np.concatenate([curve.time_s for curve in plan])
        self._repeat = np.repeat([curve.repeat for curve in plan], self.lengths)
        self._grids: dict[int, Grid] = {}
        strain = np.concatenate([self._strain(curve.imposed, curve.height_m) for curve in plan])
        self.side = 1.0 if strain.max() >= -strain.min() else -1.0

    def _strain(self, imposed: np.ndarray, height_m: np.ndarray | float) -> np.ndarray:
        """The imposed quantity as a strain, compression of a platen positive."""
        return imposed / height_m if self.mode == "platen" else imposed - (1.0 if self.mode == "uniaxial" else 0.0)

    def curves(self, values: np.ndarray) -> list[np.ndarray]:
        """Rows of all curves (n,), curve by curve."""
        return np.split(values, np.cumsum(self.lengths)[:-1])

    def values(
        self, C10_Pa: float, C20_Pa: float, effects: Effects | None = None, parts: int | None = None, recovers: bool = True
    ) -> np.ndarray:
        """The predicted column at all rows (n,): nominal stress or shear stress [Pa], or the force of a platen [N].

        Parameters
        ----------
        parts : increments from row to row.
        recovers : tissue that relaxes recovers freely when a platen has left it; otherwise it follows the platen without a force.
        """
        law = PointLaw(C10_Pa, C20_Pa, effects or {})
        late = law.number("lag", "lag_s")
        fine = RELAXING_PARTS if law.terms or late or "stick-slip" in law.effects else 1
        parts = parts or fine
        if parts not in self._grids:
            self._grids[parts] = Grid(self.plan, parts, self.mode)
        grid = self._grids[parts]
        strain = self._moved(law, grid)
        column = self._loads(law, grid, strain, recovers)
        column = column + self._drag(law, grid, strain)
        if self.mode == "platen":
            column = grid.area_m2 * column
        time_s = np.concatenate([np.cumsum(grid.increment_s[test]) for test in grid.tests])
        if late:
            column = np.concatenate([np.interp(time_s[test] - late, time_s[test], column[test]) for test in grid.tests])
        column = column[grid.rows]
        column = column * (1.0 + law.number("cycle-drift", "per_cycle") * (self._repeat - 1.0))
        column = column * (1.0 + law.number("ageing", "per_s") * self.time_s)
        limit = law.number("saturation", "limit")
        if limit:
            column = column / (1.0 + np.abs(column) / limit)
        column = column + law.number("force-offset", "offset_N") + law.number("force-offset", "offset_Pa")
        drift = law.number("force-drift", "rate_N_s") + law.number("force-drift", "rate_Pa_s")
        return column + drift * self.time_s

    # ---- what moves ----

    def _moved(self, law: PointLaw, grid: Grid) -> np.ndarray:
        """Strains at the instants, as the machine has them before the rig gives way; in the test's direction positive."""
        offset = 1e-3 * law.number("contact-offset", "offset_mm") / grid.height_m
        offset = offset + law.number("contact-offset", "offset_strain")
        if "preload" in law.effects:
            offset = offset + self._touch(law, grid)
        if self.mode == "platen":
            strain = grid.approach_with(offset * grid.height_m) / grid.height_m
        else:
            strain = self.side * self._strain(grid.imposed, 1.0) + offset
        strain = strain * (1.0 + law.number("gauge-length", "error"))
        play = 1e-3 * law.number("backlash", "play_mm") / grid.height_m + law.number("backlash", "play_strain")
        if np.any(play > 0.0):
            followed = np.empty_like(strain)
            for test in grid.tests:
                now = strain[test.start]
                for k in range(test.start, test.stop):
                    now = min(max(now, strain[k]), strain[k] + play[k])
                    followed[k] = now
            strain = followed
        kept = law.number("permanent-set", "share")
        if kept:
            largest = np.concatenate([np.maximum.accumulate(np.maximum(strain[test], 0.0)) for test in grid.tests])
            strain = strain - kept * largest
        return np.maximum(strain, 0.0) if offset.min() < 0.0 and self.mode == "uniaxial" else strain

    def _touch(self, law: PointLaw, grid: Grid) -> np.ndarray:
        """The strain at which the platen bears the preload."""
        wanted = law.effects["preload"]["force_N"] / grid.area_m2
        strain = np.zeros(len(wanted))
        for _ in range(BALANCE_ITERATIONS):
            strain = strain + (wanted + uniaxial(law, 1.0 - strain)) / (6.0 * law.slope(np.zeros(1)))
        return strain

    def _drag(self, law: PointLaw, grid: Grid, strain: np.ndarray) -> np.ndarray:
        """Stress of a tool that sticks and slips: it grows with the way and drops each time a length has been gone."""
        if "stick-slip" not in law.effects:
            return np.zeros(len(strain))
        length, height = law.effects["stick-slip"]["length"], law.effects["stick-slip"]["drag"]
        drags = np.zeros(len(strain))
        for test in grid.tests:
            gone = np.cumsum(np.diff(strain[test], prepend=strain[test.start]))
            drags[test] = height * (np.abs(gone) / length % 1.0) * (np.abs(gone) > 0.0)
        scale = -1.0 if self.side < 0.0 else 1.0
        return scale * drags * (strain > 0.0)

    # ---- what answers ----

    def _loads(self, law: PointLaw, grid: Grid, strain: np.ndarray, recovers: bool) -> np.ndarray:
        """Stress at the instants [Pa], of a platen positive in compression."""
        give = 1e-3 * law.number("compliance", "compliance_mm_N") * grid.area_m2 / grid.height_m
        give = give + 1e-3 * law.number("compliance", "strain_per_kPa")
        if self.mode == "platen" and recovers and law.terms:
            return _followed(law, grid, strain, give)
        contact = self.mode == "platen"

        def stress(e: np.ndarray, sudden: bool = False) -> np.ndarray:
            e = np.maximum(e, 0.0) if contact else e
            return self._stress(law, grid, e, sudden)

        tool = strain
        for _ in range(BALANCE_ITERATIONS if np.any(give > 0.0) else 0):
            sign = 1.0 if contact else self.side
            load = sign * stress(tool)
            load = np.maximum(load, 0.0) if contact else load
            rise = sign * (stress(tool + STRAIN_STEP, True) - stress(tool - STRAIN_STEP, True)) / (2.0 * STRAIN_STEP)
            change = (strain - tool - give * load) / (1.0 + give * np.maximum(rise, 0.0))
            tool = tool + change
            if np.abs(change).max() < BALANCE_TOLERANCE:
                break
        column = stress(tool)
        return np.maximum(column, 0.0) if contact else column

    def _stress(self, law: PointLaw, grid: Grid, strain: np.ndarray, sudden: bool) -> np.ndarray:
        """Stress at strains in the test's direction; of a platen positive in compression."""
        relax = (lambda S: S) if sudden else _relaxing(law, grid)
        if self.mode == "shear":
            return shear(law, self.side * strain, grid, relax)
        stretch = 1.0 - strain if self.mode == "platen" else 1.0 + self.side * strain
        factors = _factors(law, grid)
        stress = uniaxial(law, stretch, grid, relax) if factors is None else _stacked(law, stretch, factors)
        stress = stress + law.number("viscous", "eta_Pa_s") * _rate(grid, stretch)
        return -stress if self.mode == "platen" else stress


def _rate(grid: Grid, strain: np.ndarray) -> np.ndarray:
    """Change of a strain in time (m,) [1/s], backwards."""
    steps = np.diff(strain, prepend=strain[0])
    return np.divide(steps, grid.increment_s, out=np.zeros_like(steps), where=grid.increment_s > 0.0)


def _softened(law: PointLaw, x: np.ndarray, grid: Grid | None) -> np.ndarray:
    """2 dW/dI1 at I1 - 3, less what past load has softened."""
    slope = 2.0 * law.slope(x)
    if grid is None or "softening" not in law.effects:
        return slope
    W = law.energy(x)
    largest = np.concatenate([np.maximum.accumulate(W[test]) for test in grid.tests])
    width = law.number("softening", "m_Pa") + law.effects["softening"].get("beta", 0.1) * largest
    return slope * (1.0 - law.number("softening", "inverse_r") * erf((largest - W) / width))


def shear(law: PointLaw, amount: np.ndarray, grid: Grid, relax: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Shear stress [Pa] of F = 1 + k e1 e3: S13 + k S33, in which the pressure has no part."""
    x = amount**2
    a = _softened(law, x, grid)
    S = relax(np.stack([a * (3.0 + x) * amount / 3.0, -a * x / 3.0], axis=1))
    extra = law.number("threshold", "modulus_Pa") * np.sign(amount)
    stress = S[:, 0] + amount * S[:, 1] + extra * np.maximum(np.abs(amount) - law.number("threshold", "strain"), 0.0)
    return stress + 2.0 * law.number("mooney", "C01_Pa") * amount + law.number("viscous", "eta_Pa_s") * _rate(grid, amount)


def uniaxial(
    law: PointLaw,
    stretch: np.ndarray,
    grid: Grid | None = None,
    relax: Callable[[np.ndarray], np.ndarray] = lambda S: S,
) -> np.ndarray:
    """Nominal stress [Pa] along a stretch, the sides free."""
    z, J = stretch**2, np.ones_like(stretch)
    across = np.zeros(len(z), dtype=bool) if grid is None else grid.across
    u = -0.5 * np.log(z)  # logarithm of the squared stretch across
    poisson = float(law.effects.get("compressible", {}).get("poisson", VOLUME_TERM))
    fibred = "fibres" in law.effects and across.any()

    def squares(u: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.exp(u)
        return x, J**2 / (x * z)

    def second_piola(u: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Along x, y and z (m, 3), isochoric."""
        x, y = squares(u, J)
        C = np.stack([x, y, z], axis=1) * J[:, None] ** (-2.0 / 3.0)
        I1 = C.sum(axis=1)
        S = _softened(law, I1 - 3.0, grid)[:, None] * (1.0 - I1[:, None] / (3.0 * C))
        if "fibres" in law.effects:
            along = np.where(across, 0, 2)
            I4 = C[np.arange(len(C)), along]
            more = np.maximum(I4 - 1.0, 0.0)
            pull = 2.0 * law.number("fibres", "k1_Pa") * more * np.exp(law.effects["fibres"].get("k2", 1.0) * more**2)
            S = S + pull[:, None] * ((np.arange(3) == along[:, None]) - I4[:, None] / (3.0 * C))
        return S * J[:, None] ** (-2.0 / 3.0)

    for _ in range(BALANCE_ITERATIONS):
        change = np.zeros(1)
        if fibred:  # both sides are free of stress: S_x x = S_y y

            def excess(u: np.ndarray, J: np.ndarray = J) -> np.ndarray:
                S = second_piola(u, J)
                x, y = squares(u, J)
                return S[:, 0] * x - S[:, 1] * y

            slope = (excess(u + STRAIN_STEP) - excess(u - STRAIN_STEP)) / (2.0 * STRAIN_STEP)
            change = np.where(across, -excess(u) / slope, 0.0)
            u = u + np.clip(change, -0.3, 0.3)
            u = np.where(across, u, np.log(J / stretch))
        else:
            u = np.log(J / stretch)
        moved = np.zeros(1)
        if poisson < VOLUME_TERM:
            S = relax(second_piola(u, J))
            G = 2.0 * law.C10_Pa
            K = 2.0 * G * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson))
            # K ln J / J is the pressure that the free sides need.
            moved = (-S[:, 0] * np.exp(u) / J - K * np.log(J) / J) / (K + G)
            J = J + moved
        if max(np.abs(change).max(), np.abs(moved).max()) < BALANCE_TOLERANCE:
            break
    S = relax(second_piola(u, J))
    stress = stretch * S[:, 2] - S[:, 0] * np.exp(u) / stretch
    strain = stretch - 1.0
    stress = stress + law.number("threshold", "modulus_Pa") * np.sign(strain) * np.maximum(
        np.abs(strain) - law.number("threshold", "strain"), 0.0
    )
    return stress + 2.0 * law.number("mooney", "C01_Pa") * (1.0 - stretch**-3)


# ---- what relaxes ----


def _relaxing(law: PointLaw, grid: Grid) -> Callable[[np.ndarray], np.ndarray]:
    """A function of the law's stresses at all instants (m, k) that gives what is left of them."""
    terms = law.terms

    def relax(S: np.ndarray) -> np.ndarray:
        steps = np.diff(S, axis=0, prepend=0.0)
        starts = [test.start for test in grid.tests]
        steps[starts] = S[starts]
        left = (1.0 - sum(g for g, _ in terms)) * S
        for g, tau in terms:
            y = grid.increment_s / tau
            mean = np.divide(-np.expm1(-y), y, out=np.ones_like(y), where=y > 0.0)
            fade = np.exp(-y)
            fade[starts] = 0.0
            band = np.ones((2, len(S)))
            band[1, :-1] = -fade[1:]
            left = left + solve_banded((1, 0), band, g * mean[:, None] * steps)
        return left

    return relax if terms else lambda S: S


def _followed(law: PointLaw, grid: Grid, strain: np.ndarray, give: np.ndarray) -> np.ndarray:
    """Stress under a platen that may leave tissue which relaxes, instant by instant."""
    terms = law.terms
    base = 1.0 - sum(g for g, _ in terms)
    g = np.array([share for share, _ in terms])
    column = np.zeros(len(strain))
    inverse_r, m_Pa = law.number("softening", "inverse_r"), law.number("softening", "m_Pa")
    beta = law.effects.get("softening", {}).get("beta", 0.1)
    for test in grid.tests:
        Q, old, largest, e = np.zeros((len(terms), 2)), np.zeros(2), 0.0, 0.0
        for k in range(test.start, test.stop):
            y = grid.increment_s[k] / np.array([tau for _, tau in terms])
            fade, mean = np.exp(-y), np.where(y > 0.0, -np.expm1(-y) / np.where(y > 0.0, y, 1.0), 1.0)
            share, past = base + float(g @ mean), fade @ Q - (g @ mean) * old

            def state(
                e: float, share: float = share, past: np.ndarray = past, largest: float = largest
            ) -> tuple[float, np.ndarray, float]:
                """Compressive stress, the law's stress across and along, and the energy."""
                stretch = 1.0 - e
                z, x = stretch**2, 1.0 / stretch
                I1 = z + 2.0 * x
                slope = 2.0 * float(law.slope(np.float64(I1 - 3.0)))  # type: ignore[arg-type]
                W = float(law.energy(np.float64(I1 - 3.0)))  # type: ignore[arg-type]
                if inverse_r and largest > W:
                    slope *= 1.0 - inverse_r * float(erf((largest - W) / (m_Pa + beta * largest)))
                S = slope * np.array([1.0 - I1 / (3.0 * x), 1.0 - I1 / (3.0 * z)])
                T = share * S + past
                return float(-(stretch * T[1] - T[0] * x / stretch)), S, W

            touching, free = strain[k], False
            for solve_free in (False, True):
                at = e if solve_free else touching
                for _ in range(BALANCE_ITERATIONS):
                    stress = state(at)[0]
                    rise = (state(at + STRAIN_STEP)[0] - state(at - STRAIN_STEP)[0]) / (2.0 * STRAIN_STEP)
                    wrong = stress if solve_free else at + give[k] * stress - strain[k]
                    change = -wrong / (rise if solve_free else 1.0 + give[k] * rise)
                    at += change
                    if abs(change) < BALANCE_TOLERANCE or (not solve_free and give[k] == 0.0):
                        break
                stress, S, W = state(at)
                free = solve_free
                if stress >= 0.0:
                    break
            e, column[k] = at, 0.0 if free else stress
            Q = fade[:, None] * Q + (g * mean)[:, None] * (S - old)
            old, largest = S, max(largest, W)
    return column


# ---- slices on each other ----


def _factors(law: PointLaw, grid: Grid) -> list[tuple[np.ndarray, np.ndarray]] | None:
    """Shares of the height (m,) and factors of the moduli (m,) of the slices; None where there is one."""
    height_mm = 1e3 * grid.height_m
    if "layer" in law.effects:
        share = np.minimum(law.effects["layer"]["thickness_mm"] / height_mm, 1.0)
        return [(share, np.full_like(share, law.effects["layer"]["ratio"])), (1.0 - share, np.ones_like(share))]
    if "stiffness-gradient" in law.effects:
        at = (np.arange(STACK_SLICES) + 0.5) / STACK_SLICES
        ones = np.ones_like(height_mm)
        return [(ones / STACK_SLICES, ones * (1.0 + law.effects["stiffness-gradient"]["g"] * (1.0 - 2.0 * s))) for s in at]
    return None


def _stacked(law: PointLaw, stretch: np.ndarray, slices: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Nominal stress of slices that bear the same force (m,) [Pa]."""
    table = np.geomspace(0.1, 8.0, PREPARED_STRETCHES)
    stress = uniaxial(law, table)
    now = uniaxial(law, stretch)
    for _ in range(BALANCE_ITERATIONS):
        total, rise = np.zeros_like(stretch), np.zeros_like(stretch)
        for share, factor in slices:
            at = np.interp(now / factor, stress, table)
            total += share * at
            modulus = (uniaxial(law, at + STRAIN_STEP) - uniaxial(law, at - STRAIN_STEP)) / (2.0 * STRAIN_STEP)
            rise += share / (factor * modulus)
        change = (stretch - total) / rise
        now = now + change
        if np.abs(change).max() < 1e-7 * max(np.abs(now).max(), 1.0):
            break
    return now
