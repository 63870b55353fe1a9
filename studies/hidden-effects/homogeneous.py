"""Family "closed": homogeneous tests in closed form, exactly incompressible; ramps, holds, cycles and sinusoids.

The tests are uniaxial compression and tension, simple shear, and platens without friction. Distances are computed with the same
closed forms, by a fit of each rival cause and of the constants.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from causes import cause_of
from laws import HiddenBench
from sealed import SMALLEST_IDENTIFIABLE_SD, Distance, Request, RowNoise, Sealed, truth_of

from studies.blind.case import Case, CaseCurve, Table
from studies.blind.draws import draw_constants, signed_strength, strength
from studies.blind.foreign import homogeneous_cases as drawn
from studies.blind.grid import Effects, HomogeneousRun, Mode, Parameters
from studies.blind.homogeneous_case import COLUMNS, PLATEN
from studies.blind.identifiable import CaseSizes, case_sizes, separation
from studies.blind.protocols import PROGRAMMES, Protocol, draw_protocol

FAMILY = "closed"
SINGLES = (
    "viscoelastic",
    "two-terms",
    "power-law",
    "fractional",
    "softening",
    "permanent-set",
    "payne",
    "third-yeoh",
    "fibres",
    "cycle-drift",
    "lag",
    "backlash",
    "stick-slip",
    "contact-offset",
    "compliance",
    "force-offset",
    "force-drift",
)
PAIRS = (
    ("viscoelastic", "softening"),
    ("viscoelastic", "third-yeoh"),
    ("two-terms", "force-offset"),
    ("softening", "third-yeoh"),
    ("viscoelastic", "compliance"),
    ("softening", "contact-offset"),
    ("fibres", "third-yeoh"),
    ("third-yeoh", "force-drift"),
    ("power-law", "third-yeoh"),
    ("fractional", "force-offset"),
)
# Law outside the library -> causes that describe its mechanism.
OUTSIDE = {
    "log-normal-relaxation": ("viscoelastic",),
    "viscous": ("viscoelastic",),
    "friction-spectrum": ("payne",),
    "plastic-flow": ("permanent-set",),
    "rate-softening": ("softening",),
    "ageing": (),
    "saturation": (),
    "threshold": (),
    "mooney": (),
}
UNLOADING = ("hold-unload-rest", "cycles-of-one", "cycles-in-one", "sinusoids")
SHOWN_BY = drawn.PROGRAMMES_SHOWING | {
    "viscoelastic": ("ramp-hold", "hold-unload-rest", "cycles-in-one", "sinusoids", "directions"),
    "two-terms": ("ramp-hold", "hold-unload-rest"),
    "fractional": ("ramp-hold", "hold-unload-rest"),
    "log-normal-relaxation": ("ramp-hold", "hold-unload-rest"),
    "softening": UNLOADING,
    "permanent-set": UNLOADING,
    "payne": UNLOADING,
    "friction-spectrum": UNLOADING,
    "plastic-flow": UNLOADING,
    "rate-softening": ("cycles-in-one", "cycles-of-one", "sinusoids"),
    "fibres": ("directions",),
    "cycle-drift": ("repeats", "cycles-of-one"),
    "lag": UNLOADING,
    "backlash": UNLOADING,
}
UNIAXIAL_ONLY = {"payne", "friction-spectrum"}
WITH_VOLUME_OR_LENGTH = {"compressible", "compliance", "mooney"}  # simple shear does not show them
MEASURED_LEVELS = (0.003, 0.01, 0.02)  # sd of a measured row, as a share of the largest value
STRETCH_SDS = (0.0002, 0.0005, 0.001)  # sd of an imposed row, as a strain
UNSTATED_SHARE = 0.15
SINUSOID_SHARE = 0.25  # of the datasets whose effects sinusoids can show
ROWS_PER_PERIOD = 24
MOST_DRAWS = 16  # of the strengths, until the effect is identifiable


def choices(kind: str) -> list[tuple[str, ...]]:
    """What a kind of case can hide."""
    if kind == "control":
        return [()]
    if kind == "pair":
        return list(PAIRS)
    return [(name,) for name in (SINGLES if kind == "single" else OUTSIDE)]


def draw(rng: np.random.Generator, request: Request) -> Sealed:
    """Draw a case; the strengths are drawn again until the effect is identifiable, or a limit is reached."""
    for _ in range(MOST_DRAWS):
        sealed, distance = _draw_once(rng, request)
        if distance is None or distance.identifiable:
            break
    return sealed


def _draw_once(rng: np.random.Generator, request: Request) -> tuple[Sealed, Distance | None]:
    protocol = _protocol(rng, request.subjects)
    C10, C20 = draw_constants(rng)
    bench = HiddenBench(protocol.plan, protocol.mode)
    plain = bench.values(C10, C20)
    size = case_sizes(bench, C10, C20, plain)
    effects = dict(_effect(rng, name, bench, size, (C10, C20)) for name in request.subjects)
    true = bench.values(C10, C20, effects)
    noise, sds = _noise(rng, bench, true)
    distance = _distance(bench, request, effects, (C10, C20), sds, size) if request.subjects else None
    case = _case(rng, protocol, bench, true, noise)
    truth = truth_of(
        request,
        setting="homogeneous",
        effects=effects,
        accepts=map(cause_of, OUTSIDE.get(request.subjects[0], ())) if request.subjects else (),
        constants=(C10, C20),
        noise=noise,
        distance=distance,
        protocol=f"{protocol.name}, {protocol.test}",
        rows=len(true),
    )
    return Sealed(case, truth), distance


# ---- loading protocols ----


def _protocol(rng: np.random.Generator, subjects: tuple[str, ...]) -> Protocol:
    possible = {*PROGRAMMES, "sinusoids"}
    for name in subjects:
        possible &= set(SHOWN_BY.get(name, possible))
    while True:
        if possible == {"sinusoids"} or ("sinusoids" in possible and rng.random() < SINUSOID_SHARE):
            protocol = _sinusoids(rng)
        else:
            protocol = draw_protocol(rng, only=sorted(possible - {"sinusoids"}))
        if protocol.mode == "shear" and (UNIAXIAL_ONLY | WITH_VOLUME_OR_LENGTH) & set(subjects):
            continue
        if protocol.mode == "platen" and UNIAXIAL_ONLY & set(subjects):
            continue
        return protocol


def _sinusoids(rng: np.random.Generator) -> Protocol:
    """Sinusoids about half of the largest strain at three frequencies, and a ramp with a hold."""
    test, mode = [("compression", "uniaxial"), ("tension", "uniaxial"), ("shear", "shear")][rng.integers(3)]
    strain = round(float(rng.uniform(0.15, 0.35)), 2)
    slow = float(f"{10.0 ** rng.uniform(-2.0, -0.7):.2g}")
    step = float(rng.choice([3.0, 5.0]))
    periods = int(rng.integers(3, 5))
    runs = []
    for k in range(3):
        f = float(f"{slow * step**k:.3g}")
        t = np.round(np.linspace(0.0, periods / f, periods * ROWS_PER_PERIOD + 1), 6)
        x = strain * 0.5 * (1.0 - np.cos(2.0 * np.pi * f * t))
        runs.append((t, x, {"max_strain": strain, "rate_per_s": float(f"{np.pi * f * strain:.3g}")}))
    up, hold = 0.2 / slow, 1.0 / slow
    share = np.expm1(np.linspace(0.0, 1.0, 41)[1:] * np.log(50.0)) / 49.0
    t = np.round(np.concatenate([np.linspace(0.0, up, 20), up + hold * share]), 6)
    held = {"max_strain": strain, "rate_per_s": float(f"{strain / up:.3g}"), "hold_s": float(f"{hold:.4g}")}
    runs.append((t, np.interp(t, [0.0, up, up + hold], [0.0, strain, strain]), held))
    side = -1.0 if test == "compression" else 1.0
    plan = tuple(
        HomogeneousRun(f"curve-{k + 1}", t, x if mode == "shear" else 1.0 + side * x, dict(conditions), k)
        for k, (t, x, conditions) in enumerate(runs)
    )
    kind: Mode = "shear" if mode == "shear" else "uniaxial"
    return Protocol("sinusoids", f"Sinusoids at three frequencies and a hold, {test}", test, kind, plan, ())


# ---- what is hidden ----


def _effect(
    rng: np.random.Generator, name: str, bench: HiddenBench, size: CaseSizes, constants: tuple[float, float]
) -> tuple[str, Parameters]:
    """The effect as the truth names it, with parameters from weak to strong."""
    span, W = size.longest_s, size.energy_Pa
    C10 = constants[0]
    own: dict[str, Parameters] = {
        "viscoelastic": {"g": [strength(rng, 0.03, 0.5)], "tau_s": [strength(rng, 0.02 * span, 0.4 * span)]},
        "fractional": {
            "g": strength(rng, 0.2, 0.9),
            "tau_s": strength(rng, 5e-3 * span, 0.1 * span),
            "alpha": _two(rng, 0.25, 0.6),
        },
        "softening": {
            "inverse_r": strength(rng, 0.05, 0.6),
            "m_Pa": strength(rng, 0.05 * W, 0.4 * W),
            "beta": float(rng.choice([0.0, 0.1, 0.15])),
        },
        "payne": {"modulus_Pa": strength(rng, 0.1 * C10, 1.5 * C10), "yield_shear": strength(rng, 0.02, 0.15)},
        "log-normal-relaxation": {
            "g": strength(rng, 0.1, 0.7),
            "tau_s": strength(rng, 0.01 * span, 0.2 * span),
            "decades": _two(rng, 0.6, 1.2),
        },
        "friction-spectrum": {
            "modulus_Pa": [float(f"{m:.4g}") for m in strength(rng, 0.1 * C10, 0.8 * C10) * np.ones(4)],
            "yield_shear": [0.02, 0.05, 0.1, 0.2],
        },
        "plastic-flow": {"yield_strain": strength(rng, 0.02, 0.12), "share": strength(rng, 0.03, 0.3)},
        "rate-softening": {
            "inverse_r": strength(rng, 0.15, 0.6),
            "m_Pa": strength(rng, 0.05 * W, 0.3 * W),
            "exponent": _two(rng, 0.2, 0.6),
        },
    }
    if name == "two-terms":
        early = strength(rng, 0.005 * span, 0.02 * span)
        terms = {"g": [strength(rng, 0.1, 0.3), strength(rng, 0.1, 0.3)], "tau_s": [early, float(f"{early * 20.0:.4g}")]}
        return "viscoelastic", terms
    if name in own:
        return name, own[name]
    if name == "cycle-drift":
        return name, {"per_cycle": signed_strength(rng, 0.01, 0.1)}
    return name, drawn._parameters(rng, name, bench, size, *constants)


def _two(rng: np.random.Generator, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 2)


# ---- noise and distances ----


def _noise(rng: np.random.Generator, bench: HiddenBench, true: np.ndarray) -> tuple[RowNoise, np.ndarray]:
    """The noise of the columns, and the standard deviation (n,) of the measured rows with what the imposed ones add.

    That of a held-out row is infinite: it determines nothing.
    """
    sd = float(f"{rng.choice(MEASURED_LEVELS) * np.abs(true).max():.3g}")
    strain_sd = float(rng.choice(STRETCH_SDS))
    slopes = []
    for run, values in zip(bench.plan, bench.curves(true), strict=True):
        order = np.argsort(run.imposed, kind="stable")
        line = np.polynomial.Polynomial.fit(run.imposed[order], values[order], 3)
        slopes.append(np.full(len(values), np.inf) if run.split == "holdout" else np.abs(line.deriv()(run.imposed)))
    height = max(run.height_m for run in bench.plan) if bench.mode == "platen" else 1.0
    sds = np.hypot(sd, strain_sd * height * np.concatenate(slopes))
    imposed = float(f"{1e3 * strain_sd * height:.3g}") if bench.mode == "platen" else strain_sd
    return RowNoise(sd, imposed, bool(rng.random() >= UNSTATED_SHARE)), sds


def _distance(
    bench: HiddenBench,
    request: Request,
    effects: Effects,
    constants: tuple[float, float],
    sds: np.ndarray,
    size: CaseSizes,
) -> Distance:
    """Distances from the elastic law and from each other single cause."""
    true = bench.values(*constants, effects, None, recovers=False)

    def whiten(difference: np.ndarray) -> np.ndarray:
        return difference / sds

    elastic = separation(bench, true, whiten, constants, (), {}).baseline ** 0.5
    if elastic < SMALLEST_IDENTIFIABLE_SD:
        return Distance(elastic, {})  # no rival can be farther away
    own = {cause_of(name) for name in effects} if len(effects) == 1 else set()
    own |= {cause_of(name) for name in OUTSIDE.get(request.subjects[0], ())}
    free = {name: p for name, p in drawn.rivals_of(bench, size, constants[0]).items() if cause_of(name) not in own}
    free.pop("power-law", None)  # two Prony terms stand for every relaxation
    free.pop("gauge-length" if bench.mode == "platen" else "drainage", None)  # the one needs strains, the other one a tool
    found = separation(bench, true, whiten, constants, (), free)
    rivals: dict[str, float] = {}
    for name, square in found.rivals.items():
        rivals[cause_of(name)] = min(rivals.get(cause_of(name), np.inf), square**0.5)
    return Distance(elastic, rivals)


# ---- the dataset ----


def _case(rng: np.random.Generator, protocol: Protocol, bench: HiddenBench, true: np.ndarray, noise: RowNoise) -> Case:
    platen = protocol.mode == "platen"
    first = protocol.plan[0]
    grouped = rng.random() < 0.5
    curves = []
    for run, values in zip(protocol.plan, bench.curves(true), strict=True):
        imposed, measured = noise.add(rng, 1e3 * run.imposed if platen else run.imposed, values)
        several = sum(other.test == run.test for other in protocol.plan) > 1
        group = f"specimen-{run.test + 1}" if several else "batch-1" if grouped else None
        own: dict[str, Table] = {}
        if run.height_m != first.height_m:
            own = {"specimen": {"height_mm": round(1e3 * run.height_m, 4)}}
        rows = np.column_stack([run.time_s, imposed, measured])
        curves.append(CaseCurve(run.id, rows, group, run.split, dict(run.conditions), own))
    specimen: Table = {"shape": "point"}
    if platen:
        assert protocol.radius_mm is not None
        specimen = {"shape": "cylinder", "radius_mm": protocol.radius_mm, "height_mm": round(1e3 * first.height_m, 6)}
        specimen["base"] = "frictionless"
    keys = ("force_sd_N", "displacement_sd_mm") if platen else ("stress_sd_Pa", "stretch_sd")
    empty: dict[str, Any] = {}
    return Case(
        title=protocol.title,
        test=protocol.test,
        columns=COLUMNS[protocol.mode],
        specimen=specimen,
        tool=PLATEN if platen else None,
        noise=dict(zip(keys, (noise.measured, noise.imposed), strict=True)) if noise.stated else {},
        curves=curves,
        truth=empty,  # type: ignore[typeddict-item]
    )
