"""Whether an effect can be told from all others by the data of a case: how far the best rival stays from the true curves.

The separation from a rival is the least |y_true - y_rival|^2 in the metric of the true noise, over the rival's own parameters
and the two constants. It is computed with the generator's numerics, before any tool sees the case.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from explicitfe.blind.closed_forms import Bench
from explicitfe.blind.noise import Whitener
from explicitfe.effects.material.drainage import Drainage
from explicitfe.errors import RunError
from explicitfe.materials.yeoh import Yeoh
from explicitfe.solve import point

ENOUGH = 25.0
COARSE = 3  # increments from row to row, of true curves and rivals alike; enough for a distance
STEPS = 60  # evaluations of one start
LARGEST_RATIO = 100.0  # of C20 to the true C10
CONSTANTS_SCALE = 30.0  # C10 lies within this factor of the true one
TINY = 1e-9
GIVEN_UP = 1e3  # sds: a state that a rival cannot reach


@dataclass(frozen=True)
class Free:
    """One free parameter of a rival: its bounds, on a logarithmic scale if so, and where searches start."""

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
    """Of the true curves from what can stand for them.

    Attributes
    ----------
    baseline : from the law alone.
    rivals : from each other effect.
    """

    baseline: float
    rivals: dict[str, float]

    @property
    def nearest(self) -> str | None:
        return min(self.rivals, key=self.rivals.__getitem__) if self.rivals else None

    @property
    def identifiable(self) -> bool:
        return min([self.baseline, *self.rivals.values()]) >= ENOUGH


@dataclass(frozen=True)
class Scales:
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


def scales(bench: Bench, C10_Pa: float, C20_Pa: float, values: np.ndarray) -> Scales:
    """Sizes of a case with these constants and true values (n,)."""
    strain = np.concatenate([curve.imposed / curve.height_m for curve in bench.plan])
    if bench.mode == "shear":
        x = strain**2
    else:
        stretch = 1.0 - strain if bench.mode == "platen" else strain
        x = stretch**2 + 2.0 / stretch - 3.0
    steps = np.concatenate([np.diff(curve.time_s) for curve in bench.plan])
    return Scales(
        energy_Pa=float(((C10_Pa + C20_Pa * x) * x).max()),
        shortest_s=float(np.median(steps)),
        longest_s=float(max(curve.time_s[-1] for curve in bench.plan)),
        height_mm=1e3 * min(curve.height_m for curve in bench.plan),
        depth_mm=1e3 * float(max(curve.imposed.max() for curve in bench.plan)),
        force_N=float(np.abs(values).max()),
    )


def carried(bench: Bench) -> tuple[str, ...]:
    """Effects of the library that a test can carry at all: the rivals of each other."""
    conditions = [curve.conditions for curve in bench.plan]
    found = ["viscoelastic", "softening", "third-yeoh"]
    if bench.mode != "shear":
        found += ["compressible", "drainage"]
    if len({c.get("direction") for c in conditions}) > 1:
        found.append("fibres")
    if len({c.get("repeat", c.get("cycle", 1)) for c in conditions}) > 1:
        found.append("cycle-drift")
    if bench.mode == "platen":
        found += ["contact-offset", "compliance", "force-offset", "force-drift", "preload", "layer", "stiffness-gradient"]
    return tuple(found)


def free_parameters(name: str, size: Scales, C10_Pa: float) -> list[Free]:
    """Parameters of a rival that are searched."""
    short, long = size.shortest_s, size.longest_s
    middle = (short * long) ** 0.5
    if name == "viscoelastic":
        return [
            Free("g0", TINY, 0.9, (0.2, 0.2)),
            Free("tau0", 0.3 * short, 10.0 * long, ((short * middle) ** 0.5, middle)),
            Free("g1", TINY, 0.9, (0.1, 0.1)),
            Free("tau1", 0.3 * short, 10.0 * long, ((long * middle) ** 0.5, long)),
        ]
    W, F = size.energy_Pa, size.force_N
    table = {
        "softening": [Free("inverse_r", TINY, 0.95, (0.2, 0.2)), Free("m_Pa", 1e-3 * W, 10.0 * W, (0.05 * W, 0.5 * W))],
        "third-yeoh": [Free("C30_Pa", TINY, 1e5, (0.1 * C10_Pa, 0.001 * C10_Pa))],
        "fibres": [
            Free("k1_Pa", TINY, 1e5, (0.5 * C10_Pa, 0.05 * C10_Pa)),
            Free("k2", 0.01, 10.0, (0.5, 5.0)),
        ],
        "compressible": [Free("poisson", 0.2, 0.49999, (0.45, 0.3), log=False)],
        "drainage": [Free("share", 0.5, 0.999, (0.99, 0.998), log=False), Free("tau_s", short, 10.0 * long, (middle, long))],
        "cycle-drift": [Free("per_cycle", -0.3, 0.3, (0.02, -0.02), log=False)],
        "contact-offset": [Free("offset_mm", -0.3 * size.depth_mm, 0.3 * size.depth_mm, (0.05, -0.05), log=False)],
        "compliance": [Free("compliance_mm_N", TINY, size.depth_mm / F, (0.05 * size.depth_mm / F, 1e-3 * size.depth_mm / F))],
        "force-offset": [Free("offset_N", -0.5 * F, 0.5 * F, (0.01 * F, -0.01 * F), log=False)],
        "force-drift": [Free("rate_N_s", -F / long, F / long, (0.01 * F / long, -0.01 * F / long), log=False)],
        "preload": [Free("force_N", 1e-6 * F, 0.3 * F, (0.02 * F, 0.002 * F))],
        "layer": [
            Free("thickness_mm", 0.02 * size.height_mm, 0.45 * size.height_mm, (0.1 * size.height_mm,) * 2),
            Free("ratio", 0.1, 20.0, (3.0, 0.4)),
        ],
        "stiffness-gradient": [Free("g", -0.9, 0.9, (0.4, 0.7), log=False)],
    }
    return table[name]


def separation(
    bench: Bench,
    true: np.ndarray,
    whiten: Whitener,
    constants: tuple[float, float],
    hidden: Sequence[str],
) -> Separation:
    """How far true curves stay from the law alone, and from each single effect that is not hidden in them.

    Parameters
    ----------
    true : (n,) values without noise, by :data:`COARSE` increments, in the quicker way of the rivals.
    constants : C10, C20 [Pa] that they were made with; searches start there.
    hidden : effects that are in them. Where there are two, each of them alone is a rival.
    """
    size = scales(bench, *constants, true)
    names = [name for name in carried(bench) if [name] != list(hidden)]
    baseline = _nearest(bench, true, whiten, constants, lambda values: {}, [])
    found = {}
    # What cannot beat the law alone by enough needs no search for where it would do best: it could only come nearer.
    for name in names:
        free = free_parameters(name, size, constants[0])
        found[name] = min(baseline, _nearest(bench, true, whiten, constants, _maker(name, free), free))
    return Separation(baseline, found)


def _maker(name: str, free: Sequence[Free]) -> Callable[[Sequence[float]], dict[str, dict[str, Any]]]:
    """Coordinates of the free parameters -> the effect as a model file states it."""

    def made(at: Sequence[float]) -> dict[str, dict[str, Any]]:
        values = {f.name: f.value(x) for f, x in zip(free, at, strict=True)}
        if name == "viscoelastic":
            whole = max(1.0, (values["g0"] + values["g1"]) / 0.98)
            shares = [values["g0"] / whole, values["g1"] / whole]
            return {name: {"g": shares, "tau_s": [values["tau0"], values["tau1"]]}}
        return {name: values}

    return made


def _nearest(
    bench: Bench,
    true: np.ndarray,
    whiten: Whitener,
    constants: tuple[float, float],
    made: Callable[[Sequence[float]], Mapping[str, Mapping[str, Any]]],
    free: Sequence[Free],
) -> float:
    """Least squared distance over the constants and the free parameters, from several starts."""
    C10, C20 = constants
    low = [np.log(C10 / CONSTANTS_SCALE), 0.0, *(f.coordinate(f.low) for f in free)]
    high = [np.log(C10 * CONSTANTS_SCALE), LARGEST_RATIO, *(f.coordinate(f.high) for f in free)]

    def wrong(at: np.ndarray) -> np.ndarray:
        effects = made(at[2:])
        first, second = float(np.exp(at[0])), float(at[1] * C10)
        try:
            parts = COARSE if "viscoelastic" in effects else None
            values = bench.values(first, second, {k: v for k, v in effects.items() if k != "drainage"}, parts, False)
            if "drainage" in effects:
                values = values + drained(bench, first, second, effects["drainage"])
        except (RunError, FloatingPointError):
            values = np.full_like(true, np.nan)
        difference = whiten(true - values)
        return np.where(np.isfinite(difference), difference, GIVEN_UP)

    best = np.inf
    for k in range(max((len(f.starts) for f in free), default=1)):
        start = [np.log(C10), min(C20 / C10 + 1e-3, 10.0), *(f.coordinate(f.starts[k]) for f in free)]
        with np.errstate(all="ignore"):
            found = least_squares(wrong, np.clip(start, low, high), bounds=(low, high), x_scale="jac", max_nfev=STEPS)
        best = min(best, 2.0 * float(found.cost))
    return best


def drained(bench: Bench, C10_Pa: float, C20_Pa: float, effect: Mapping[str, float]) -> np.ndarray:
    """What drainage changes (n,), in the unit of the rows: the difference of two runs of the simulator's own point."""
    law = Yeoh(C10_Pa=C10_Pa, C20_Pa=C20_Pa, poisson=bench.poisson)
    found = []
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
        found.append(-curves[0].area_m2 * change if bench.mode == "platen" else change)
    return np.concatenate(found)
