"""Closed forms of the benchmark: those of the blind study, and laws that it does not have.

Relaxation of a fractional Zener solid and of a log-normal spectrum of times are sums of Prony terms (Mainardi 2010, Fractional
Calculus and Waves in Linear Viscoelasticity, eq. 3.35 for the spectrum of the former), taken by the trapezoidal rule in the
logarithm of the rate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import erf

from studies.blind.foreign.closed import ForeignBench, PointLaw
from studies.blind.grid import Effects, Grid, Parameters

LOG_STEP = 0.4  # of the trapezoidal rule
SPECTRUM_DECADES = 9.0  # on either side of tau; what relaxes faster is lost at once, what relaxes slower stays
SERIES = ("viscoelastic", "fractional", "log-normal-relaxation")


def fractional_terms(parameters: Parameters) -> list[tuple[float, float]]:
    """Prony terms (g, tau [s]) of g E_alpha(-(t / tau)^alpha), the relaxing part of a fractional Zener solid."""
    g, tau, alpha = parameters["g"], parameters["tau_s"], parameters["alpha"]
    reach = SPECTRUM_DECADES * np.log(10.0)
    y = np.arange(-reach, reach + LOG_STEP, LOG_STEP)
    # With the rate e^y / tau the spectrum over y is sin(pi a) / (2 pi (cosh(a y) + cos(pi a))).
    weights = LOG_STEP * np.sin(np.pi * alpha) / (2.0 * np.pi * (np.cosh(alpha * y) + np.cos(np.pi * alpha)))
    # The tail of fast rates relaxes with the fastest term; that of slow rates never does.
    weights[-1] += 0.5 * (1.0 - weights.sum())
    return [(float(g * w), float(tau * np.exp(-at))) for w, at in zip(weights, y, strict=True)]


def log_normal_terms(parameters: Parameters) -> list[tuple[float, float]]:
    """Prony terms of a log-normal spectrum of relaxation times about tau, with a width in decades."""
    width = parameters["decades"] * np.log(10.0)
    y = np.arange(-4.0 * width, 4.0 * width + LOG_STEP, LOG_STEP)
    weights = np.exp(-0.5 * (y / width) ** 2)
    weights *= parameters["g"] / weights.sum()
    return [(float(w), float(parameters["tau_s"] * np.exp(at))) for w, at in zip(weights, y, strict=True)]


class HiddenBench(ForeignBench):
    """A bench whose tissue may follow a law of this module, see :class:`studies.blind.foreign.closed.ForeignBench`."""

    def values(
        self, C10_Pa: float, C20_Pa: float, effects: Effects | None = None, parts: int | None = None, recovers: bool = True
    ) -> np.ndarray:
        """The predicted column at all rows (n,)."""
        effects = dict(effects or {})
        terms: list[tuple[float, float]] = []
        for name, series in (("fractional", fractional_terms), ("log-normal-relaxation", log_normal_terms)):
            if name in effects:
                terms += series(effects.pop(name))
        if terms:
            effects["viscoelastic"] = {"g": [g for g, _ in terms], "tau_s": [tau for _, tau in terms]}
        return super().values(C10_Pa, C20_Pa, effects, parts, recovers)

    def _moved(self, law: PointLaw, grid: Grid) -> np.ndarray:
        strain = super()._moved(law, grid)
        flow = law.effects.get("plastic-flow")
        return strain if flow is None else strain - _plastic(grid, strain, flow["yield_strain"], flow["share"])

    def _stress(self, law: PointLaw, grid: Grid, strain: np.ndarray, sudden: bool) -> np.ndarray:
        stress = super()._stress(law, grid, strain, sudden)
        if "rate-softening" in law.effects:
            stress = stress * self._rate_softening(law, grid, strain)
        sliding = [*_sliding(law.effects)]
        if sliding:
            stretch = 1.0 - strain if self.mode == "platen" else 1.0 + self.side * strain
            friction = sum((_friction(grid, stretch, G, y) for G, y in sliding), np.zeros(len(strain)))
            stress = stress - friction if self.mode == "platen" else stress + friction
        return stress

    def _rate_softening(self, law: PointLaw, grid: Grid, strain: np.ndarray) -> np.ndarray:
        """Factor (m,) of the stress: what a faster test has loaded it softens more."""
        p = law.effects["rate-softening"]
        stretch = 1.0 - strain if self.mode == "platen" else 1.0 + self.side * strain
        x = strain**2 if self.mode == "shear" else stretch**2 + 2.0 / stretch - 3.0
        W = law.energy(x)
        pace = np.divide(
            np.abs(np.diff(strain, prepend=strain[0])), grid.increment_s, out=np.zeros(len(W)), where=grid.increment_s > 0.0
        )
        paces = [float(pace[test].max()) for test in grid.tests]
        factor = np.ones(len(W))
        for test, own in zip(grid.tests, paces, strict=True):
            largest = np.maximum.accumulate(W[test])
            lost = p["inverse_r"] * (own / max(paces)) ** p["exponent"]
            factor[test] = 1.0 - lost * erf((largest - W[test]) / (p["m_Pa"] + 0.1 * largest))
        return factor


def _sliding(effects: Effects) -> Iterator[tuple[float, float]]:
    """Modulus [Pa] and yield shear of each branch that slides."""
    if "payne" in effects:
        yield effects["payne"]["modulus_Pa"], effects["payne"]["yield_shear"]
    if "friction-spectrum" in effects:
        p = effects["friction-spectrum"]
        yield from zip(p["modulus_Pa"], p["yield_shear"], strict=True)


def _friction(grid: Grid, stretch: np.ndarray, G_Pa: float, yield_shear: float) -> np.ndarray:
    """Nominal stress (m,) of a neo-Hookean branch that slides at the stress G y (Kaliske and Rothert 1998), the sides free."""
    z, x = stretch**2, 1.0 / stretch
    I1 = z + 2.0 * x
    S = G_Pa * np.stack([1.0 - I1 / (3.0 * x), 1.0 - I1 / (3.0 * z)], axis=1)
    out = np.empty(len(stretch))
    for test in grid.tests:
        Qx = Qz = oldx = oldz = 0.0
        for k in range(test.start, test.stop):
            Qx, Qz = Qx + S[k, 0] - oldx, Qz + S[k, 1] - oldz
            size = (0.5 * (2.0 * (Qx * x[k]) ** 2 + (Qz * z[k]) ** 2)) ** 0.5
            if size > G_Pa * yield_shear:
                Qx, Qz = Qx * G_Pa * yield_shear / size, Qz * G_Pa * yield_shear / size
            oldx, oldz = S[k]
            out[k] = stretch[k] * Qz - Qx * x[k] / stretch[k]
    return out


def _plastic(grid: Grid, strain: np.ndarray, yield_strain: float, share: float) -> np.ndarray:
    """Plastic strain (m,): of what exceeds the yield strain a share flows, and the rest hardens, in either direction."""
    flowed = np.empty(len(strain))
    for test in grid.tests:
        p = 0.0
        for k in range(test.start, test.stop):
            beyond = abs(strain[k] - p) - yield_strain - abs(p) * (1.0 - share) / share
            if beyond > 0.0:
                p += share * beyond * (1.0 if strain[k] > p else -1.0)
            flowed[k] = p
    return flowed
