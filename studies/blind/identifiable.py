"""Whether the data of a case can tell an effect from all others: how far the best rival stays from the true curves.

The separation from a rival is the least |y_true - y_rival|^2 in the metric of the true noise, over the rival's own parameters
and the two constants. It is computed with the generator's numerics, before any tool sees the case.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from explicitfe.fem.effects.material.drainage import Drainage
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.platform.errors import RunError
from studies.blind.grid import Effects, HomogeneousRun, Mode
from studies.blind.mechanism import mechanism

SMALLEST_IDENTIFIABLE_DISTANCE = 25.0  # A squared distance of 25 is 5 standard deviations of the noise.
COARSE_INCREMENTS_PER_ROW = 3  # of true curves and rivals alike; enough for a distance
EVALUATIONS_PER_START = 60  # of the search for a rival's parameters
LARGEST_RIVAL_C20_OVER_C10 = 100.0  # C20 of a rival over the true C10
LARGEST_C10_FACTOR = 30.0  # C10 of a rival lies within this factor of the true one.
SMALLEST_STRENGTH = 1e-9  # as good as no effect, where a logarithm needs a positive bound
UNREACHED_STATE_SDS = 1e3  # the distance, in standard deviations, of a state that a rival cannot reach


LARGEST_POISSON = 0.499  # of a law whose volume may drain


class PlannedBench(Protocol):
    """Planned curves that can be computed for any constants and effects, such as :class:`studies.blind.closed_forms.Bench`."""

    poisson: float
    plan: tuple[HomogeneousRun, ...]
    mode: Mode

    def values(
        self, C10_Pa: float, C20_Pa: float, effects: Effects | None = None, parts: int | None = None, recovers: bool = True
    ) -> np.ndarray:
        """The predicted column at all rows (n,)."""
        ...


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter of a rival.

    Attributes
    ----------
    low, high : bounds.
    starts : values at which the searches start.
    log : whether the scale is logarithmic.
    """

    name: str
    low: float
    high: float
    starts: tuple[float, ...]
    log: bool = True

    def coordinate(self, value: float) -> float:
        return float(np.log(value)) if self.log else value / self.high

    def value(self, coordinate: float) -> float:
        return float(np.exp(coordinate)) if self.log else coordinate * self.high


@dataclass(frozen=True)
class Separation:
    """The distances of the true curves from what could stand for them.

    Attributes
    ----------
    baseline : distance from the law alone.
    rivals : distance from each other effect.
    """

    baseline: float
    rivals: dict[str, float]

    @property
    def nearest(self) -> str | None:
        return min(self.rivals, key=self.rivals.__getitem__) if self.rivals else None

    @property
    def identifiable(self) -> bool:
        return min([self.baseline, *self.rivals.values()]) >= SMALLEST_IDENTIFIABLE_DISTANCE


@dataclass(frozen=True)
class CaseSizes:
    """Sizes of a case, from which the plausible ranges of rivals follow.

    Attributes
    ----------
    energy_Pa : largest elastic energy; shortest_s, longest_s : of its times.
    height_mm, depth_mm, force_N, duration_s : of tests between platens.
    """

    energy_Pa: float
    shortest_s: float
    longest_s: float
    height_mm: float
    depth_mm: float
    force_N: float


def case_sizes(bench: PlannedBench, C10_Pa: float, C20_Pa: float, values: np.ndarray) -> CaseSizes:
    """Sizes of a case with these constants and true values (n,)."""
    strain = np.concatenate([curve.imposed / curve.height_m for curve in bench.plan])
    if bench.mode == "shear":
        x = strain**2
    else:
        stretch = 1.0 - strain if bench.mode == "platen" else strain
        x = stretch**2 + 2.0 / stretch - 3.0
    steps = np.concatenate([np.diff(curve.time_s) for curve in bench.plan])
    return CaseSizes(
        energy_Pa=float(((C10_Pa + C20_Pa * x) * x).max()),
        shortest_s=float(np.median(steps)),
        longest_s=float(max(curve.time_s[-1] for curve in bench.plan)),
        height_mm=1e3 * min(curve.height_m for curve in bench.plan),
        depth_mm=1e3 * float(max(curve.imposed.max() for curve in bench.plan)),
        force_N=float(np.abs(values).max()),
    )


def possible_effects(bench: PlannedBench) -> tuple[str, ...]:
    """The effects of the library that a test can show at all; they are the rivals of each other."""
    conditions = [curve.conditions for curve in bench.plan]
    names = ["viscoelastic", "softening", "third-yeoh"]
    if bench.mode != "shear":
        names += ["compressible", "drainage"]
    if len({c.get("direction") for c in conditions}) > 1:
        names.append("fibres")
    if len({c.get("repeat", c.get("cycle", 1)) for c in conditions}) > 1:
        names.append("cycle-drift")
    if bench.mode == "platen":
        names += ["contact-offset", "compliance", "force-offset", "force-drift", "preload", "layer", "stiffness-gradient"]
    return tuple(names)


def free_parameters(name: str, size: CaseSizes, C10_Pa: float) -> list[FreeParameter]:
    """The parameters of a rival that are searched for."""
    short, long = size.shortest_s, size.longest_s
    middle = (short * long) ** 0.5
    if name == "viscoelastic":
        return [
            FreeParameter("g0", SMALLEST_STRENGTH, 0.9, (0.2, 0.2)),
            FreeParameter("tau0", 0.3 * short, 10.0 * long, ((short * middle) ** 0.5, middle)),
            FreeParameter("g1", SMALLEST_STRENGTH, 0.9, (0.1, 0.1)),
            FreeParameter("tau1", 0.3 * short, 10.0 * long, ((long * middle) ** 0.5, long)),
        ]
    W, F = size.energy_Pa, size.force_N
    table = {
        "softening": [
            FreeParameter("inverse_r", SMALLEST_STRENGTH, 0.95, (0.2, 0.2)),
            FreeParameter("m_Pa", 1e-3 * W, 10.0 * W, (0.05 * W, 0.5 * W)),
        ],
        "third-yeoh": [FreeParameter("C30_Pa", SMALLEST_STRENGTH, 1e5, (0.1 * C10_Pa, 0.001 * C10_Pa))],
        "fibres": [
            FreeParameter("k1_Pa", SMALLEST_STRENGTH, 1e5, (0.5 * C10_Pa, 0.05 * C10_Pa)),
            FreeParameter("k2", 0.01, 10.0, (0.5, 5.0)),
        ],
        "compressible": [FreeParameter("poisson", 0.2, 0.49999, (0.45, 0.3), log=False)],
        "drainage": [
            FreeParameter("share", 0.5, 0.999, (0.99, 0.998), log=False),
            FreeParameter("tau_s", short, 10.0 * long, (middle, long)),
        ],
        "cycle-drift": [FreeParameter("per_cycle", -0.3, 0.3, (0.02, -0.02), log=False)],
        "contact-offset": [FreeParameter("offset_mm", -0.3 * size.depth_mm, 0.3 * size.depth_mm, (0.05, -0.05), log=False)],
        "compliance": [
            FreeParameter(
                "compliance_mm_N", SMALLEST_STRENGTH, size.depth_mm / F, (0.05 * size.depth_mm / F, 1e-3 * size.depth_mm / F)
            )
        ],
        "force-offset": [FreeParameter("offset_N", -0.5 * F, 0.5 * F, (0.01 * F, -0.01 * F), log=False)],
        "force-drift": [FreeParameter("rate_N_s", -F / long, F / long, (0.01 * F / long, -0.01 * F / long), log=False)],
        "preload": [FreeParameter("force_N", 1e-6 * F, 0.3 * F, (0.02 * F, 0.002 * F))],
        "layer": [
            FreeParameter("thickness_mm", 0.02 * size.height_mm, 0.45 * size.height_mm, (0.1 * size.height_mm,) * 2),
            FreeParameter("ratio", 0.1, 20.0, (3.0, 0.4)),
        ],
        "stiffness-gradient": [FreeParameter("g", -0.9, 0.9, (0.4, 0.7), log=False)],
    }
    return table[name]


def separation(
    bench: PlannedBench,
    true: np.ndarray,
    whiten: Callable[[np.ndarray], np.ndarray],
    constants: tuple[float, float],
    hidden: Sequence[str],
    free: Mapping[str, Sequence[FreeParameter]] | None = None,
) -> Separation:
    """How far true curves stay from the law alone, and from each single effect that is not hidden in them.

    Parameters
    ----------
    true : (n,) values without noise, computed as quickly as those of the rivals (:data:`COARSE_INCREMENTS_PER_ROW`).
    constants : true C10, C20 [Pa]; searches start there.
    hidden : effects in the true values. Where there are two, each of them alone is a rival.
    free : the rivals and their parameters; without it those that the bench can show.
    """
    if free is None:
        size = case_sizes(bench, *constants, true)
        free = {name: free_parameters(name, size, constants[0]) for name in possible_effects(bench)}
    baseline = _nearest(bench, true, whiten, constants, lambda values: {}, [])
    rivals = {}
    # Every rival contains the law alone, as the effect without strength, and cannot be farther away.
    for name, parameters in free.items():
        if [mechanism(name)] != [mechanism(effect) for effect in hidden]:
            rivals[name] = min(baseline, _nearest(bench, true, whiten, constants, _maker(name, parameters), parameters))
    return Separation(baseline, rivals)


def _maker(name: str, free: Sequence[FreeParameter]) -> Callable[[np.ndarray], Effects]:
    """A function of the coordinates of the free parameters, which gives the effect as a model file states it."""

    def effect_at(at: np.ndarray) -> Effects:
        values = {f.name: f.value(x) for f, x in zip(free, at, strict=True)}
        if name == "viscoelastic":
            whole = max(1.0, (values["g0"] + values["g1"]) / 0.98)
            shares = [values["g0"] / whole, values["g1"] / whole]
            return {name: {"g": shares, "tau_s": [values["tau0"], values["tau1"]]}}
        return {name: values}

    return effect_at


def _nearest(
    bench: PlannedBench,
    true: np.ndarray,
    whiten: Callable[[np.ndarray], np.ndarray],
    constants: tuple[float, float],
    effect_at: Callable[[np.ndarray], Effects],
    free: Sequence[FreeParameter],
) -> float:
    """The least squared distance over the constants and the free parameters, from several starts."""
    C10, C20 = constants
    low = [np.log(C10 / LARGEST_C10_FACTOR), 0.0, *(f.coordinate(f.low) for f in free)]
    high = [np.log(C10 * LARGEST_C10_FACTOR), LARGEST_RIVAL_C20_OVER_C10, *(f.coordinate(f.high) for f in free)]

    def wrong(at: np.ndarray) -> np.ndarray:
        effects = effect_at(at[2:])
        first, second = float(np.exp(at[0])), float(at[1] * C10)
        try:
            parts = COARSE_INCREMENTS_PER_ROW if "viscoelastic" in effects else None
            values = bench.values(first, second, {k: v for k, v in effects.items() if k != "drainage"}, parts, False)
            if "drainage" in effects:
                values = values + drainage_change(bench, first, second, effects["drainage"])
        except (RunError, FloatingPointError):
            values = np.full_like(true, np.nan)
        difference = whiten(true - values)
        return np.where(np.isfinite(difference), difference, UNREACHED_STATE_SDS)

    best = np.inf
    for k in range(max((len(f.starts) for f in free), default=1)):
        start = [np.log(C10), min(C20 / C10 + 1e-3, 10.0), *(f.coordinate(f.starts[k]) for f in free)]
        with np.errstate(all="ignore"):
            fit = least_squares(
                wrong, np.clip(start, low, high), bounds=(low, high), x_scale="jac", max_nfev=EVALUATIONS_PER_START
            )
        best = min(best, 2.0 * float(fit.cost))
    return best


def drainage_change(bench: PlannedBench, C10_Pa: float, C20_Pa: float, effect: Mapping[str, float]) -> np.ndarray:
    """The change by drainage (n,), in the unit of the rows: the difference of two runs of the simulator's own point."""
    law = Yeoh(C10_Pa=C10_Pa, C20_Pa=C20_Pa, poisson=min(bench.poisson, LARGEST_POISSON))
    changes = []
    tests: dict[int, list[int]] = {}
    for number, curve in enumerate(bench.plan):
        tests.setdefault(curve.test, []).append(number)
    for numbers in tests.values():
        curves = [bench.plan[k] for k in numbers]
        start, time_s = 0.0, []
        for k, curve in enumerate(curves):
            time_s.append(curve.time_s + start)
            start = time_s[-1][-1] + (curves[k + 1].time_s[1] if k + 1 < len(curves) else 0.0)
        stretch = np.concatenate([1.0 - c.imposed / c.height_m if bench.mode == "platen" else c.imposed for c in curves])
        times = np.concatenate(time_s)
        change = point.uniaxial(law, [Drainage(**effect)], times, stretch) - point.uniaxial(law, [], times, stretch)
        changes.append(-curves[0].area_m2 * change if bench.mode == "platen" else change)
    return np.concatenate(changes)
