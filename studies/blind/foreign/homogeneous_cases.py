"""A homogeneous case of the foreign family: exactly incompressible closed forms, sensors that err, laws that no library has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.blind.case import UNSTATED_NOISE_SHARE, Case, CaseRequest, NoiseStatement
from studies.blind.draws import LARGEST_STRENGTHS, draw_constants, draw_noise, signed_strength, strength
from studies.blind.foreign.closed import REMEMBER, ForeignBench
from studies.blind.grid import Effects, Parameters
from studies.blind.homogeneous_case import CaseReadings, draw_group, homogeneous_case, specimen_of
from studies.blind.identifiable import (
    COARSE_INCREMENTS_PER_ROW,
    CaseSizes,
    FreeParameter,
    Separation,
    case_sizes,
    free_parameters,
    possible_effects,
    separation,
)
from studies.blind.noise import Noise, Whitener
from studies.blind.protocols import PROGRAMMES, Protocol, draw_protocol

HOMOGENEOUS_CONTROLS = ("white", "correlated", "scatter", "wrong-dimension")
READINGS = ("contact-offset", "compliance", "force-offset", "force-drift")
HOMOGENEOUS_SINGLES = (
    "viscoelastic",
    "power-law",
    "softening",
    "permanent-set",
    "third-yeoh",
    "fibres",
    "cycle-drift",
    "compressible",
    "stick-slip",
    "lag",
    "backlash",
    *READINGS,
)
HOMOGENEOUS_DOUBLES = (
    ("viscoelastic", "third-yeoh"),
    ("viscoelastic", "force-offset"),
    ("softening", "third-yeoh"),
    ("third-yeoh", "force-drift"),
    ("viscoelastic", "compliance"),
    ("softening", "contact-offset"),
    ("fibres", "third-yeoh"),
)
HOMOGENEOUS_OUTSIDE = ("threshold", "mooney", "viscous", "ageing", "saturation")
# What an outsider or a reading needs to show.
PROGRAMMES_SHOWING = {
    "force-drift": ("ramp-hold", "hold-unload-rest", "cycles-of-one", "cycles-in-one", "repeats"),
    "compressible": ("ramps", "ramp-hold", "hold-unload-rest"),
    "power-law": ("ramp-hold", "hold-unload-rest"),
    "permanent-set": ("hold-unload-rest", "cycles-of-one", "cycles-in-one"),
    "lag": ("hold-unload-rest", "cycles-of-one", "cycles-in-one"),
    "backlash": ("hold-unload-rest", "cycles-of-one", "cycles-in-one"),
    "stick-slip": ("ramps", "hold-unload-rest", "cycles-in-one"),
    "threshold": ("ramps", "ramp-hold", "hold-unload-rest", "cycles-in-one"),
    "mooney": ("ramps", "ramp-hold", "hold-unload-rest"),
    "viscous": ("ramp-hold", "cycles-in-one", "hold-unload-rest"),
    "ageing": ("hold-unload-rest", "ramp-hold", "cycles-in-one"),
    "saturation": ("ramps", "ramp-hold", "hold-unload-rest"),
}
SHOWN_BY_NAME = ("viscoelastic", "softening", "third-yeoh", "fibres", "cycle-drift")


def draw_homogeneous(rng: np.random.Generator, request: CaseRequest) -> Case:
    """Draw a case of homogeneous tests."""
    protocol = _protocol(rng, request)
    C10, C20 = draw_constants(rng)
    bench = ForeignBench(protocol.plan, protocol.mode)
    plain = bench.values(C10, C20)
    size = case_sizes(bench, C10, C20, plain)
    names = () if request.kind == "control" else request.subjects
    effects = {name: _parameters(rng, name, bench, size, C10, C20) for name in names}
    whole = bench.values(C10, C20, effects)
    noise = draw_noise(rng, request, float(np.abs(whole).max()))
    statement = NoiseStatement(rng.random() >= UNSTATED_NOISE_SHARE, noise.scale_sd > 0.0 and rng.random() < 0.5)
    measured = noise.add_to(rng, bench.curves(whole))
    specimen = specimen_of(rng, protocol, request)
    readings = CaseReadings(measured, noise, statement, specimen, draw_group(rng, noise))
    distances = None if request.kind == "control" else _distances(bench, request, effects, (C10, C20), noise, size)
    return homogeneous_case(request, protocol, (C10, C20), effects, readings, distances)


def _protocol(rng: np.random.Generator, request: CaseRequest) -> Protocol:
    if request.kind == "control":
        only = ("repeats",) if request.subjects == ("scatter",) else tuple(PROGRAMMES)
        return draw_protocol(rng, only=only, platen=request.subjects == ("wrong-dimension",))
    possible = set(PROGRAMMES)
    for name in request.subjects:
        possible &= set(PROGRAMMES_SHOWING.get(name, PROGRAMMES))
    needs = [name for name in request.subjects if name in SHOWN_BY_NAME]
    while True:
        protocol = draw_protocol(rng, needs, sorted(possible))
        # A volume cannot change in shear, and a shear test has no thickness that a compliance could be told by.
        if protocol.mode == "shear" and {"compressible", "compliance", "mooney"} & set(request.subjects):
            continue
        return protocol


def _distances(
    bench: ForeignBench,
    request: CaseRequest,
    effects: Effects,
    constants: tuple[float, float],
    noise: Noise,
    size: CaseSizes,
) -> Separation:
    parts = COARSE_INCREMENTS_PER_ROW if set(REMEMBER) & set(effects) else None
    true = bench.values(*constants, effects, parts, recovers=False)
    whiten = Whitener(noise, bench.curves(true), [curve.split != "holdout" for curve in bench.plan])
    hidden: Sequence[str] = () if request.kind == "outside" else request.subjects
    return separation(bench, true, whiten, constants, hidden, rivals_of(bench, size, constants[0]))


def rivals_of(bench: ForeignBench, size: CaseSizes, C10_Pa: float) -> dict[str, list[FreeParameter]]:
    """The effects that these tests could be explained by, with what is free in them."""
    rivals = {name: free_parameters(name, size, C10_Pa) for name in possible_effects(bench)}
    long, F = size.longest_s, size.force_N
    rivals["gauge-length"] = [FreeParameter("error", -0.2, 0.2, (0.05, -0.05), log=False)]
    rivals["lag"] = [FreeParameter("lag_s", -0.1 * long, 0.1 * long, (0.01 * long, -0.01 * long), log=False)]
    rivals["power-law"] = [
        FreeParameter("exponent", 1e-6, 0.9, (0.1, 0.02)),
        FreeParameter("tau_s", 1e-4 * long, long, (1e-3 * long, 1e-2 * long)),
    ]
    play = "play_mm" if bench.mode == "platen" else "play_strain"
    reach = size.depth_mm if bench.mode == "platen" else _largest_strain(bench)
    rivals["backlash"] = [FreeParameter(play, 0.0, 0.3 * reach, (0.02 * reach,), log=False)]
    if bench.mode != "platen":
        strain = _largest_strain(bench)
        rivals["contact-offset"] = [FreeParameter("offset_strain", -0.3 * strain, 0.3 * strain, (0.02, -0.02), log=False)]
        rivals["force-offset"] = [FreeParameter("offset_Pa", -0.5 * F, 0.5 * F, (0.01 * F, -0.01 * F), log=False)]
        rivals["force-drift"] = [FreeParameter("rate_Pa_s", -F / long, F / long, (0.01 * F / long, -0.01 * F / long), log=False)]
        give = 1e3 * strain / F
        rivals["compliance"] = [FreeParameter("strain_per_kPa", 0.0, 0.9 * give, (0.05 * give, 0.3 * give), log=False)]
    return rivals


def _largest_strain(bench: ForeignBench) -> float:
    places = np.concatenate([curve.imposed / curve.height_m for curve in bench.plan])
    return float(np.abs(places - 1.0).max() if bench.mode == "uniaxial" else np.abs(places).max())


# ---- what is hidden, from weak to strong ----


def _parameters(
    rng: np.random.Generator, name: str, bench: ForeignBench, size: CaseSizes, C10_Pa: float, C20_Pa: float
) -> Parameters:
    """Parameters of an effect as a model file states them, or of a law that has none."""
    strain = _largest_strain(bench)
    stretched = bench.mode == "uniaxial" and bench.side > 0.0
    stretch = 1.0 + strain if stretched else 1.0 - strain
    x = strain**2 if bench.mode == "shear" else stretch**2 + 2.0 / stretch - 3.0
    F, span, W = size.force_N, size.longest_s, size.energy_Pa
    platen = bench.mode == "platen"
    depth = size.depth_mm if platen else strain
    key = {
        "contact-offset": "offset_mm" if platen else "offset_strain",
        "compliance": "compliance_mm_N" if platen else "strain_per_kPa",
        "force-offset": "offset_N" if platen else "offset_Pa",
        "force-drift": "rate_N_s" if platen else "rate_Pa_s",
    }.get(name, "")
    most = LARGEST_STRENGTHS.get(name, np.inf) if platen or name in ("third-yeoh", "fibres") else np.inf
    if name == "viscoelastic":
        return {"g": [strength(rng, 0.02, 0.6)], "tau_s": [strength(rng, 0.01 * span, 0.5 * span)]}
    if name == "softening":
        return {"inverse_r": strength(rng, 0.03, 0.7), "m_Pa": strength(rng, 0.05 * W, 0.5 * W)}
    if name == "third-yeoh":
        whole = (C10_Pa + 2.0 * C20_Pa * x) / (3.0 * x**2)  # as much as the slope of the energy without it
        return {"C30_Pa": strength(rng, 0.02 * whole, whole, most)}
    if name == "fibres":
        return {"k1_Pa": strength(rng, 0.02 * C10_Pa, 5.0 * C10_Pa, most), "k2": strength(rng, 0.3, 3.0)}
    if name == "cycle-drift":
        return {"per_cycle": signed_strength(rng, 0.003, 0.1)}
    if name == "compressible":
        return {"poisson": round(0.5 * (1.0 - strength(rng, 0.02, 0.4)), 5)}
    if name == "contact-offset":
        return {key: signed_strength(rng, 0.005 * depth, 0.15 * depth, most)}
    if name == "compliance":
        give = depth / F if platen else 1e3 * depth / F
        return {key: strength(rng, 0.005 * give, 0.3 * give, most)}
    if name == "force-offset":
        return {key: signed_strength(rng, 0.005 * F, 0.2 * F, most)}
    if name == "force-drift":
        return {key: signed_strength(rng, 0.005 * F / span, 0.2 * F / span, most)}
    if name == "power-law":
        return {"exponent": strength(rng, 0.02, 0.3), "tau_s": strength(rng, 3e-4 * span, 0.02 * span)}
    if name == "lag":
        return {"lag_s": signed_strength(rng, 0.002 * span, 0.03 * span)}
    if name == "backlash":
        return {"play_mm" if platen else "play_strain": strength(rng, 0.01 * depth, 0.1 * depth)}
    if name == "permanent-set":
        return {"share": strength(rng, 0.03, 0.3)}
    if name == "threshold":
        E = (2.0 if bench.mode == "shear" else 6.0) * C10_Pa
        return {"strain": round(float(rng.uniform(0.3, 0.7) * strain), 4), "modulus_Pa": strength(rng, 0.5 * E, 6.0 * E)}
    if name == "mooney":
        return {"C01_Pa": strength(rng, 0.05 * C10_Pa, 0.6 * C10_Pa)}
    if name == "viscous":
        paces = [np.abs(np.diff(c.imposed / c.height_m) / np.diff(c.time_s)).max() for c in bench.plan]
        stress = F / max(c.area_m2 for c in bench.plan)
        return {"eta_Pa_s": strength(rng, 0.02, 0.3) * stress / float(max(paces))}
    if name == "ageing":
        return {"per_s": signed_strength(rng, 0.02, 0.3) / span}
    if name == "saturation":
        return {"limit": F * strength(rng, 2.0, 20.0)}
    assert name == "stick-slip"
    stress = F / max(c.area_m2 for c in bench.plan)
    return {"length": strength(rng, 0.08 * strain, 0.25 * strain), "drag": strength(rng, 0.02, 0.12) * stress}
