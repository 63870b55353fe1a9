"""One homogeneous case, drawn at random: a test, a tissue, the effect that is hidden in it, and the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from studies.blind.case import UNSTATED_NOISE_SHARE, Case, CaseRequest, NoiseStatement
from studies.blind.closed_forms import Bench
from studies.blind.draws import LARGEST_STRENGTHS, draw_constants, draw_noise, signed_strength, strength
from studies.blind.grid import Parameters
from studies.blind.homogeneous_case import CaseReadings, draw_group, homogeneous_case, specimen_of
from studies.blind.identifiable import COARSE_INCREMENTS_PER_ROW, CaseSizes, Separation, case_sizes, separation
from studies.blind.noise import Noise, Whitener
from studies.blind.protocols import DEFORMATIONS, EFFECTS, PROGRAMMES, Protocol, draw_protocol, shows

CONTROLS = ("white", "correlated", "scatter", "wrong-dimension")
OUTSIDE = ("power-law", "threshold", "stick-slip")
POISSON_RATIO = 0.499  # the default of the simulator, so that Poisson's ratio alone is no hidden effect


def pairs() -> list[tuple[str, str]]:
    """Pairs of effects that some protocol can show together, in a fixed order."""
    together: set[tuple[str, str]] = set()
    for name, deformations in DEFORMATIONS.items():
        for deformation in deformations:
            together.update(_pairs(shows(name, deformation)))
    return sorted(together)


def _pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    order = sorted(names)
    return [(a, b) for k, a in enumerate(order) for b in order[k + 1 :]]


def choices(kind: str) -> list[tuple[str, ...]]:
    """The subjects that a kind of case can have; the cases of a set take them in turn."""
    if kind == "double":
        return list(pairs())
    return [(name,) for name in {"control": CONTROLS, "single": EFFECTS, "outside": OUTSIDE}[kind]]


def draw(rng: np.random.Generator, request: CaseRequest) -> Case:
    """Draw a case."""
    protocol = _protocol(rng, request)
    C10, C20 = draw_constants(rng)
    bench = Bench(protocol.plan, protocol.mode, POISSON_RATIO)
    size = case_sizes(bench, C10, C20, bench.values(C10, C20))
    effects = {} if request.kind == "control" else {name: _effect(rng, name, bench, size, C10, C20) for name in request.subjects}
    whole = bench.values(C10, C20, effects, COARSE_INCREMENTS_PER_ROW if "power-law" in effects else None)
    noise = draw_noise(rng, request, float(np.abs(whole).max()))
    measured = noise.add_to(rng, bench.curves(whole))
    specimen = specimen_of(rng, protocol, request)
    statement = NoiseStatement(rng.random() >= UNSTATED_NOISE_SHARE, noise.scale_sd > 0.0 and rng.random() < 0.5)
    readings = CaseReadings(measured, noise, statement, specimen, draw_group(rng, noise))
    distances = _distances(bench, request, effects, (C10, C20), noise)
    return homogeneous_case(request, protocol, (C10, C20), effects, readings, distances)


def _protocol(rng: np.random.Generator, request: CaseRequest) -> Protocol:
    if request.kind != "control":
        needs = request.subjects if request.kind != "outside" else ()
        only = {
            "power-law": ("ramp-hold", "hold-unload-rest"),
            "threshold": ("ramps", "ramp-hold", "hold-unload-rest", "cycles-in-one"),
            "stick-slip": ("ramps", "hold-unload-rest", "cycles-in-one"),
        }.get(request.subjects[0], ())
        return draw_protocol(rng, needs, only)
    if request.subjects == ("scatter",):
        return draw_protocol(rng, only=("repeats",))
    return draw_protocol(rng, only=tuple(PROGRAMMES), platen=request.subjects == ("wrong-dimension",))


def _distances(
    bench: Bench, request: CaseRequest, effects: Mapping[str, Parameters], constants: tuple[float, float], noise: Noise
) -> Separation | None:
    """The separations, by the curves that a tool may fit: those that the dataset holds out do not count."""
    if request.kind == "control":
        return None
    remembers = {"viscoelastic", "power-law"} & set(effects)
    true = bench.values(*constants, effects, COARSE_INCREMENTS_PER_ROW if remembers else None, recovers=False)
    whiten = Whitener(noise, bench.curves(true), [curve.split != "holdout" for curve in bench.plan])
    return separation(bench, true, whiten, constants, () if request.kind == "outside" else request.subjects)


# ---- effects, from weak to strong ----


def _effect(rng: np.random.Generator, name: str, bench: Bench, size: CaseSizes, C10_Pa: float, C20_Pa: float) -> Parameters:
    """Parameters of an effect as a model file states them."""
    ways = np.concatenate([curve.imposed / curve.height_m for curve in bench.plan])
    strain = float(np.abs(ways - 1.0).max()) if bench.mode == "uniaxial" else float(np.abs(ways).max())
    stretch = 1.0 + strain if bench.mode == "uniaxial" and ways.max() > 1.0 else 1.0 - strain
    x = strain**2 if bench.mode == "shear" else stretch**2 + 2.0 / stretch - 3.0
    F, depth, span, W = size.force_N, size.depth_mm, size.longest_s, size.energy_Pa
    most = LARGEST_STRENGTHS.get(name, np.inf)
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
    if name == "contact-offset":
        return {"offset_mm": signed_strength(rng, 0.005 * depth, 0.15 * depth, most)}
    if name == "compliance":
        return {"compliance_mm_N": strength(rng, 0.005 * depth / F, 0.3 * depth / F, most)}
    if name == "force-offset":
        return {"offset_N": signed_strength(rng, 0.005 * F, 0.2 * F, most)}
    if name == "force-drift":
        return {"rate_N_s": signed_strength(rng, 0.005 * F / span, 0.2 * F / span, most)}
    if name == "power-law":
        t0 = strength(rng, 3e-4 * span, 0.02 * span)
        return {"share": strength(rng, 0.3, 0.9), "exponent": strength(rng, 0.15, 0.35), "t0_s": t0}
    if name == "threshold":
        E = (2.0 if bench.mode == "shear" else 6.0) * C10_Pa
        return {"strain": round(float(rng.uniform(0.3, 0.7) * strain), 4), "modulus_Pa": strength(rng, 0.5 * E, 6.0 * E)}
    assert name == "stick-slip"
    reach = 1e-3 * depth if bench.mode == "platen" else strain
    whole = float(np.abs(bench.values(C10_Pa, C20_Pa)).max())
    length, drag = strength(rng, 0.08 * reach, 0.25 * reach), strength(rng, 0.02 * whole, 0.12 * whole)
    return {"way": length, "drag": drag, "seed": int(rng.integers(1 << 31))}
