"""Family "glued": a cylinder between glued plates, by the spectral solver; the force or the displacement of a plate is imposed.

The plates are of the cylinder's own radius, two specimens have two heights, and the nominal strain stays below 6 %. There
the solver errs by less than 0.2 % of the force (README.md); the noise is 1 % or more. Distances come from secants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from causes import cause_of
from glued_solver import GluedCylinder, GluedSolver
from laws import log_normal_terms
from scipy.interpolate import make_interp_spline
from scipy.optimize import nnls
from scipy.special import erf
from sealed import Distance, Request, RowNoise, Sealed, truth_of

from studies.blind.case import Case, CaseCurve
from studies.blind.draws import C10_RANGE_PA, signed_strength, strength
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.tool_tests import RigReading
from studies.blind.grid import Parameters
from studies.blind.protocols import programme

SINGLES = (
    "viscoelastic",
    "two-terms",
    "softening",
    "compressible",
    "layer",
    "compliance",
    "force-offset",
    "force-drift",
    "lag",
)
PAIRS = (
    ("viscoelastic", "softening"),
    ("viscoelastic", "compliance"),
    ("softening", "force-offset"),
    ("compressible", "force-drift"),
)
OUTSIDE = {"log-normal-relaxation": ("viscoelastic",), "ring": (), "saturation": (), "soft-core": ()}
LARGEST_STRAIN = 0.06
LEVELS = (0.01, 0.02)  # sd of a row of the measured column, as a share of its largest value
IMPOSED_LEVELS = (0.001, 0.003)
UNSTATED_SHARE = 0.15
BY_FORCE_SHARE = 0.5
CURVE_POINTS = 7  # equilibria of an elastic curve on each side of rest
INSTANTS_OF_A_SEGMENT = 8  # of a history
RIVAL_DEGREE, RIVAL_LAYERS = 3, 1  # of the solver for distances
MOST_DRAWS = 6
STEP = 0.02  # of secants of sensors, as a share of the largest value


@dataclass(frozen=True, eq=False)
class GluedTest:
    """One curve: its specimen, the corners (time [s], displacement [mm] or force [N]) of its protocol, and its rows [s]."""

    specimen: GluedCylinder
    corners: tuple[tuple[float, float], ...]
    rows: np.ndarray
    hold_s: float

    def imposed(self, time_s: np.ndarray) -> np.ndarray:
        """The protocol at times."""
        t, x = np.array(self.corners).T
        return np.interp(time_s, t, x)


class ElasticCurve:
    """Force [N] against depth [mm] of a tissue without history, pulls included: a spline through equilibria."""

    def __init__(self, specimen: GluedCylinder, tissue: HiddenTissue, coarse: bool) -> None:
        self.reach_mm = 1.3 * LARGEST_STRAIN * specimen.height_mm
        sides = []
        for sign in (1.0, -1.0):
            solver = GluedSolver(specimen, tissue, RIVAL_DEGREE, RIVAL_LAYERS) if coarse else GluedSolver(specimen, tissue)
            places = sign * self.reach_mm * np.arange(1, CURVE_POINTS + 1) / CURVE_POINTS * (1.0 if sign > 0.0 else 0.3)
            sides.append([(d, solver.advance(0.0, by_depth=True, target=float(d))[1]) for d in places])
        d, F = np.array([*sides[1][::-1], (0.0, 0.0), *sides[0]]).T
        self.force = make_interp_spline(d, F, k=5)
        self.depth = make_interp_spline(F, d, k=5)


def choices(kind: str) -> list[tuple[str, ...]]:
    """What a kind of case can hide."""
    if kind == "control":
        return [()]
    if kind == "pair":
        return list(PAIRS)
    return [(name,) for name in (SINGLES if kind == "single" else OUTSIDE)]


def draw(rng: np.random.Generator, request: Request) -> Sealed:
    """Draw a case.

    Raises
    ------
    RunError : the solver does not reach a state.
    """
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_RANGE_PA))):.4g}")
    tissue = HiddenTissue(C10, float(f"{rng.uniform(0.0, 0.5) * C10:.4g}"))
    by_force = bool(rng.random() < BY_FORCE_SHARE) and not {"lag", "force-offset", "force-drift"} & set(request.subjects)
    tests, curves = plan_tests(rng, tissue, by_force)
    plain = [_elastic(test, curve, RigReading(), by_force) for test, curve in zip(tests, curves, strict=True)]
    largest = max(float(np.abs(values).max()) for values in plain)
    imposed = max(abs(x) for test in tests for _, x in test.corners)
    noise = RowNoise(
        float(f"{rng.choice(LEVELS) * largest:.3g}"),
        float(f"{rng.choice(IMPOSED_LEVELS) * imposed:.3g}"),
        bool(rng.random() >= UNSTATED_SHARE),
    )
    effects, distance = identifiable(rng, request, Rivals(tests, curves, tissue, by_force, noise))
    columns = answers(tests, *hide(tissue, effects), by_force)
    truth = truth_of(
        request,
        setting="tool",
        effects=effects,
        accepts=map(cause_of, OUTSIDE.get(request.subjects[0], ())) if request.subjects else (),
        constants=(tissue.C10_Pa, tissue.C20_Pa),
        noise=noise,
        distance=distance,
        protocol=f"glued plates, {'force' if by_force else 'displacement'} imposed",
        rows=sum(map(len, columns)),
    )
    return Sealed(dataset(rng, tests, columns, noise, by_force), truth)


def plan_tests(rng: np.random.Generator, tissue: HiddenTissue, by_force: bool) -> tuple[list[GluedTest], list[ElasticCurve]]:
    """Ramp, hold, unloading and rest at two rates on a specimen, and once on one of half its height."""
    radius, height = round(float(rng.uniform(12.0, 20.0)), 1), round(float(rng.uniform(16.0, 24.0)), 1)
    rate, hold = float(f"{10.0 ** rng.uniform(-2.0, -1.0):.2g}"), float(rng.choice([10.0, 20.0, 40.0]))
    tests, curves = [], []
    elastic: dict[float, ElasticCurve] = {}
    for own, faster in ((height, 1.0), (height, 5.0), (0.5 * height, 1.0)):
        specimen = GluedCylinder(radius, own)
        if own not in elastic:
            elastic[own] = ElasticCurve(specimen, tissue, coarse=True)
        top = 0.9 * LARGEST_STRAIN * own
        value = float(f"{(float(elastic[own].force(top)) if by_force else top):.3g}")
        ramp = LARGEST_STRAIN / (rate * faster)
        corners = ((0.0, 0.0), (ramp, value), (ramp + hold, value), (2.0 * ramp + hold, 0.0), (2.0 * ramp + 1.5 * hold, 0.0))
        rows, _ = programme(corners, int(rng.integers(60, 100)))
        tests.append(GluedTest(specimen, corners, rows, hold))
        curves.append(elastic[own])
    return tests, curves


# ---- what is hidden ----


def strengths(rng: np.random.Generator, name: str, sizes: _Sizes) -> tuple[str, Parameters]:
    """The effect as the truth names it, with parameters from weak to strong."""
    F, d, span, C10 = sizes.force_N, sizes.depth_mm, sizes.longest_s, sizes.C10_Pa
    one = strength(rng, 0.1, 0.5)
    early = strength(rng, 0.01 * span, 0.03 * span)
    drawn: dict[str, tuple[str, Parameters]] = {
        "viscoelastic": (name, {"g": [one], "tau_s": [strength(rng, 0.03 * span, 0.3 * span)]}),
        "two-terms": ("viscoelastic", {"g": [0.6 * one, 0.6 * one], "tau_s": [early, float(f"{early * 15.0:.4g}")]}),
        "softening": (name, {"inverse_r": strength(rng, 0.15, 0.6), "m_Pa": C10 * strength(rng, 1e-3, 1e-2), "beta": 0.1}),
        "third-yeoh": (name, {"C30_Pa": strength(rng, 5.0 * C10, 100.0 * C10)}),
        "compressible": (name, {"poisson": round(0.5 * (1.0 - strength(rng, 0.02, 0.2)), 5)}),
        "stiffness-gradient": (name, {"g": signed_strength(rng, 0.3, 0.8)}),
        "layer": (
            name,
            {"thickness_mm": strength(rng, 1.0, 3.0), "ratio": strength(rng, 2.0, 6.0) ** float(rng.choice([-1, 1]))},
        ),
        "compliance": (name, {"compliance_mm_N": strength(rng, 0.03 * d / F, 0.3 * d / F)}),
        "force-offset": (name, {"offset_N": signed_strength(rng, 0.03 * F, 0.2 * F)}),
        "force-drift": (name, {"rate_N_s": signed_strength(rng, 0.05 * F / span, 0.3 * F / span)}),
        "lag": (name, {"lag_s": strength(rng, 0.003 * span, 0.03 * span)}),
        "saturation": (name, {"limit_N": F * strength(rng, 1.5, 8.0)}),
        "log-normal-relaxation": (name, {"g": one, "tau_s": strength(rng, 0.02 * span, 0.2 * span), "decades": 0.8}),
        "ring": (name, {"ratio": strength(rng, 2.0, 6.0), "at_share": round(float(rng.uniform(0.4, 0.8)), 2)}),
        "soft-core": (name, {"change": strength(rng, 0.3, 0.8), "reach_share": round(float(rng.uniform(0.3, 0.6)), 2)}),
    }
    return drawn[name]


def hide(tissue: HiddenTissue, effects: dict[str, Parameters]) -> tuple[HiddenTissue, RigReading]:
    """Tissue and reading with effects."""
    reading = RigReading()
    for name, p in effects.items():
        terms = list(zip(p["g"], p["tau_s"], strict=True)) if name == "viscoelastic" else []
        if name == "log-normal-relaxation":
            terms = log_normal_terms(p)
        changed: dict[str, dict[str, Any]] = {
            "viscoelastic": {"prony": tuple(terms)},
            "log-normal-relaxation": {"prony": tuple(terms)},
            "softening": {"softening": (p.get("inverse_r"), p.get("m_Pa"), p.get("beta"))},
            "third-yeoh": {"C30_Pa": p.get("C30_Pa")},
            "compressible": {"poisson": p.get("poisson")},
            "stiffness-gradient": {"gradient": p.get("g")},
            "layer": {"layer": (p.get("thickness_mm"), p.get("ratio"))},
            "ring": {"factor": partial(_ring, p)},
            "soft-core": {"factor": partial(_soft_core, p)},
        }
        read: dict[str, dict[str, Any]] = {
            "compliance": {"compliance_mm_N": p.get("compliance_mm_N")},
            "force-offset": {"force_offset_N": p.get("offset_N")},
            "force-drift": {"force_drift_N_s": p.get("rate_N_s")},
            "lag": {"lag_s": p.get("lag_s")},
            "saturation": {"saturation_N": p.get("limit_N")},
        }
        tissue = replace(tissue, **changed.get(name, {}))
        reading = replace(reading, **read.get(name, {}))
    return tissue, reading


def _ring(p: Parameters, r: np.ndarray, z: np.ndarray, height_mm: float) -> np.ndarray:
    """A stiff ring at mid-height, a share of the radius of 16 mm away from the axis."""
    away = ((r - 16.0 * p["at_share"]) / 3.0) ** 2 + ((z - 0.5 * height_mm) / (0.2 * height_mm)) ** 2
    return np.asarray(1.0 + (p["ratio"] - 1.0) * np.exp(-away))


def _soft_core(p: Parameters, r: np.ndarray, z: np.ndarray, height_mm: float) -> np.ndarray:
    """A core along the axis that is softer."""
    return np.asarray(1.0 - p["change"] * np.exp(-((r / (16.0 * p["reach_share"])) ** 2)))


# ---- answers ----


def answers(tests: Sequence[GluedTest], tissue: HiddenTissue, reading: RigReading, by_force: bool) -> list[np.ndarray]:
    """The measured column of each test at its rows: depth [mm] where the force is imposed, else force [N]."""
    if tissue.prony or tissue.softening is not None:
        return [_history(test, tissue, reading, by_force) for test in tests]
    curves: dict[GluedCylinder, ElasticCurve] = {}
    for test in tests:
        if test.specimen not in curves:
            curves[test.specimen] = ElasticCurve(test.specimen, tissue, coarse=False)
    return [_elastic(test, curves[test.specimen], reading, by_force) for test in tests]


def _elastic(test: GluedTest, curve: ElasticCurve, reading: RigReading, by_force: bool) -> np.ndarray:
    if by_force:
        force = _true_force(test.imposed(test.rows), reading, test.rows)
        return np.asarray(curve.depth(force) + reading.compliance_mm_N * force)
    machine = test.imposed(test.rows - reading.lag_s)
    depth = machine.copy()
    for _ in range(30 if reading.compliance_mm_N else 0):
        wrong = depth + reading.compliance_mm_N * curve.force(depth) - machine
        depth = depth - wrong / (1.0 + reading.compliance_mm_N * curve.force.derivative()(depth))
    return reading.read(np.asarray(curve.force(depth)), test.rows)


def _true_force(read: np.ndarray, reading: RigReading, time_s: np.ndarray) -> np.ndarray:
    """The force on the specimen where the load cell reads an imposed one: the inverse of ``RigReading.read``."""
    F = read - reading.force_offset_N - reading.force_drift_N_s * time_s
    return np.asarray(F / (1.0 - F / reading.saturation_N))


def _history(test: GluedTest, tissue: HiddenTissue, reading: RigReading, by_force: bool) -> np.ndarray:
    solver = GluedSolver(test.specimen, tissue)
    share = np.expm1(np.linspace(0.0, 1.0, INSTANTS_OF_A_SEGMENT + 1)[1:] * np.log(30.0)) / 29.0
    even = np.arange(1, INSTANTS_OF_A_SEGMENT + 1) / INSTANTS_OF_A_SEGMENT
    times = [0.0]
    for (t0, x0), (t1, x1) in zip(test.corners, test.corners[1:], strict=False):
        times += list(t0 + (t1 - t0) * (share if x0 == x1 else even))
    t = np.array(times)
    targets = test.imposed(t)
    if by_force:
        targets = _true_force(targets, reading, t)
    seen = [0.0]
    for time_s, target in zip(t[1:], targets[1:], strict=True):
        c = 0.0 if by_force else reading.compliance_mm_N
        depth, force = solver.advance(float(time_s), by_depth=not by_force, target=float(target), compliance_mm_N=c)
        seen.append(depth + reading.compliance_mm_N * force if by_force else force)
    column = np.concatenate([[0.0], _between_corners(test, t, np.array(seen))(test.rows[1:] - reading.lag_s)])
    return column if by_force else reading.read(column, test.rows)


def _between_corners(test: GluedTest, t: np.ndarray, seen: np.ndarray) -> Any:
    """A function of time: a cubic spline on each segment of the protocol through what was computed."""
    splines = []
    for (t0, _), (t1, _) in zip(test.corners, test.corners[1:], strict=False):
        inside = (t >= t0) & (t <= t1)
        splines.append((t1, make_interp_spline(t[inside], seen[inside], k=3)))

    def at(times: np.ndarray) -> np.ndarray:
        number = np.minimum(np.searchsorted([end for end, _ in splines], times), len(splines) - 1)
        return np.array([float(splines[k][1](max(x, 0.0))) for k, x in zip(number, times, strict=True)])

    return at


# ---- distances ----


@dataclass(frozen=True)
class _Sizes:
    """Sizes of the tests, of which strengths are multiples."""

    force_N: float
    depth_mm: float
    longest_s: float
    C10_Pa: float


class Rivals:
    """Secants of every cause on the planned tests, as forces at the true depths."""

    def __init__(
        self, tests: list[GluedTest], curves: list[ElasticCurve], tissue: HiddenTissue, by_force: bool, noise: RowNoise
    ) -> None:
        self.tests, self.curves, self.tissue = tests, curves, tissue
        imposed = [test.imposed(test.rows) for test in tests]
        self.depths = [np.asarray(c.depth(x)) if by_force else x for x, c in zip(imposed, curves, strict=True)]
        self.forces = [np.asarray(c.force(d)) for c, d in zip(curves, self.depths, strict=True)]
        slopes = np.concatenate([c.force.derivative()(d) for c, d in zip(curves, self.depths, strict=True)])
        force_sd, depth_sd = (noise.imposed, noise.measured) if by_force else (noise.measured, noise.imposed)
        self.sd = np.hypot(force_sd, depth_sd * slopes)
        self.sizes = _Sizes(
            max(float(np.abs(f).max()) for f in self.forces),
            max(float(np.abs(d).max()) for d in self.depths),
            max(float(t.rows[-1]) for t in tests),
            tissue.C10_Pa,
        )
        self._changes: dict[str, np.ndarray] = {}

    def change(self, effects: dict[str, Parameters]) -> np.ndarray:
        """Change of the forces (n,) [N]; of what has a history by a factor on the elastic force."""
        key = repr(effects)
        if key not in self._changes:
            tissue, reading = hide(self.tissue, effects)
            still = replace(tissue, prony=(), softening=None)
            parts, curves = [], {}
            for test, d, F in zip(self.tests, self.depths, self.forces, strict=True):
                if still != self.tissue and test.specimen not in curves:
                    curves[test.specimen] = ElasticCurve(test.specimen, still, coarse=True)
                curve = curves.get(test.specimen, self.curves[self.tests.index(test)])
                at = d
                for _ in range(20 if reading.compliance_mm_N else 0):
                    at = d - reading.compliance_mm_N * curve.force(at)
                now = np.asarray(curve.force(at))
                now = self._with_history(now, test.rows, tissue)
                if reading.lag_s:
                    now = np.interp(test.rows - reading.lag_s, test.rows, now)
                parts.append(reading.read(now, test.rows) - F)
            self._changes[key] = np.concatenate(parts)
        return self._changes[key]

    def _with_history(self, force: np.ndarray, t: np.ndarray, tissue: HiddenTissue) -> np.ndarray:
        """The force (k,) with softening and relaxation as factors of it."""
        if tissue.softening is not None:
            inverse_r, m, beta = tissue.softening
            # The energy grows as the square of the force, up to that of a mean strain at the largest force.
            W = 3.0 * tissue.C10_Pa * LARGEST_STRAIN**2 * (force / self.sizes.force_N) ** 2
            largest = np.maximum.accumulate(W)
            force = force * (1.0 - inverse_r * erf((largest - W) / (m + beta * largest)))
        lost = np.zeros(len(force))
        for g, tau in tissue.prony:
            Q = 0.0
            for k in range(1, len(t)):
                y = (t[k] - t[k - 1]) / tau
                Q = np.exp(-y) * Q - np.expm1(-y) / y * g * (force[k] - force[k - 1])
                lost[k] += Q - g * force[k]
        return np.asarray(force + lost)

    def causes(self) -> list[tuple[str, dict[str, Parameters]]]:
        """Trial values of every rival."""
        F, d, span, C10 = self.sizes.force_N, self.sizes.depth_mm, self.sizes.longest_s, self.sizes.C10_Pa
        several: list[tuple[str, list[Parameters]]] = [
            ("third-yeoh", [{"C30_Pa": 20.0 * C10}]),
            ("compressible", [{"poisson": 0.49}, {"poisson": 0.45}]),
            ("stiffness-gradient", [{"g": 0.5}, {"g": -0.5}]),
            ("layer", [{"thickness_mm": 1.5, "ratio": 3.0}, {"thickness_mm": 1.5, "ratio": 0.4}]),
            ("compliance", [{"compliance_mm_N": STEP * d / F}, {"compliance_mm_N": 0.2 * d / F}]),
            ("force-offset", [{"offset_N": sign * STEP * F} for sign in (1.0, -1.0)]),
            ("force-drift", [{"rate_N_s": sign * STEP * F / span} for sign in (1.0, -1.0)]),
            ("lag", [{"lag_s": 0.005 * span}]),
            ("softening", [{"inverse_r": 0.3, "m_Pa": m * C10, "beta": 0.1} for m in (1e-3, 1e-2)]),
            ("viscoelastic", [{"g": [0.2], "tau_s": [share * span]} for share in (0.003, 0.02, 0.1, 0.5)]),
        ]
        return [(name, {name: p}) for name, trials in several for p in trials]

    def distance(self, effects: dict[str, Parameters], own: set[str]) -> Distance:
        """Distance of the true rows from any constants, and from the best sum of secants of each other cause."""
        stiffer = replace(self.tissue, C20_Pa=self.tissue.C20_Pa + 0.1 * self.tissue.C10_Pa)
        constants = [np.concatenate(self.forces), self._tissue_change(stiffer)]
        Q, _ = np.linalg.qr(np.column_stack(constants) / self.sd[:, None])
        target = self.change(effects) / self.sd
        target = target - Q @ (Q.T @ target)
        columns: dict[str, list[np.ndarray]] = {}
        for name, trial in self.causes():
            if cause_of(name) not in own:
                columns.setdefault(cause_of(name), []).append(self.change(trial) / self.sd)
        rivals = {}
        for name, several in columns.items():
            X = np.column_stack(several)
            X = X - Q @ (Q.T @ X)
            rivals[name] = float(nnls(X / np.maximum(np.linalg.norm(X, axis=0), 1e-12), target)[1])
        return Distance(float(np.linalg.norm(target)), rivals)

    def _tissue_change(self, tissue: HiddenTissue) -> np.ndarray:
        curves = {test.specimen: ElasticCurve(test.specimen, tissue, coarse=True) for test in self.tests}
        parts = [curves[t.specimen].force(d) - F for t, d, F in zip(self.tests, self.depths, self.forces, strict=True)]
        return np.concatenate(parts)


def identifiable(rng: np.random.Generator, request: Request, rivals: Rivals) -> tuple[dict[str, Parameters], Distance | None]:
    """Effects that are identifiable, or the last ones that were drawn, with their distances."""
    if not request.subjects:
        return {}, None
    for _ in range(MOST_DRAWS):
        effects = dict(strengths(rng, name, rivals.sizes) for name in request.subjects)
        own = {cause_of(name) for name in effects} if request.kind == "single" else set()
        own |= {cause_of(name) for name in OUTSIDE.get(request.subjects[0], ())}
        distance = rivals.distance(effects, own)
        if distance.identifiable:
            break
    return effects, distance


def dataset(
    rng: np.random.Generator, tests: Sequence[GluedTest], columns: Sequence[np.ndarray], noise: RowNoise, by_force: bool
) -> Case:
    first = tests[0].specimen
    curves = []
    for k, (test, values) in enumerate(zip(tests, columns, strict=True)):
        imposed, measured = noise.add(rng, test.imposed(test.rows), values)
        depth, force = (measured, imposed) if by_force else (imposed, measured)
        own: Any = {} if test.specimen.height_mm == first.height_mm else {"specimen": {"height_mm": test.specimen.height_mm}}
        rows = np.column_stack([test.rows, depth, force])
        curves.append(CaseCurve(f"curve-{k + 1}", rows, "batch-1", None, {"hold_s": test.hold_s, "sample": "ABC"[k]}, own))
    force_sd, depth_sd = (noise.imposed, noise.measured) if by_force else (noise.measured, noise.imposed)
    return Case(
        title="Cylinder between glued plates: ramp, hold, unloading and rest",
        test="indentation",
        columns=("displacement_mm", "force_N"),
        specimen={"shape": "cylinder", "radius_mm": first.radius_mm, "height_mm": first.height_mm, "base": "bonded"},
        tool={"shape": "bonded-disc", "radius_mm": first.radius_mm, "control": "force" if by_force else "displacement"},
        noise={"force_sd_N": force_sd, "displacement_sd_mm": depth_sd} if noise.stated else {},
        curves=curves,
        truth={},  # type: ignore[typeddict-item]
    )
