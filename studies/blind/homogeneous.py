"""One homogeneous case, drawn at random: a test, a tissue, the effect that is hidden in it, and the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from studies.blind.case import UNSTATED_NOISE_SHARE, Case, CaseRequest, NoiseStatement
from studies.blind.closed_forms import Bench
from studies.blind.draws import draw_constants, draw_noise
from studies.blind.effect_draws import HOMOGENEOUS, Scales, draw_effect, third_constant_Pa
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
    effects = (
        {}
        if request.kind == "control"
        else {name: draw_effect(rng, name, HOMOGENEOUS, _scales(bench, size, C10, C20)) for name in request.subjects}
    )
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


def _scales(bench: Bench, size: CaseSizes, C10_Pa: float, C20_Pa: float) -> Scales:
    ways = np.concatenate([curve.imposed / curve.height_m for curve in bench.plan])
    strain = float(np.abs(ways - 1.0).max()) if bench.mode == "uniaxial" else float(np.abs(ways).max())
    stretch = 1.0 + strain if bench.mode == "uniaxial" and ways.max() > 1.0 else 1.0 - strain
    x = strain**2 if bench.mode == "shear" else stretch**2 + 2.0 / stretch - 3.0
    return Scales(
        span_s=size.longest_s,
        depth_mm=size.depth_mm,
        force_N=size.force_N,
        energy_Pa=size.energy_Pa,
        strain=strain,
        modulus_Pa=C10_Pa,
        third_Pa=third_constant_Pa(C10_Pa, C20_Pa, x),
        flexibility_mm_N=size.depth_mm / size.force_N,
        rate_N_s=size.force_N / size.longest_s,
        stress=float(np.abs(bench.values(C10_Pa, C20_Pa)).max()),
        way=1e-3 * size.depth_mm if bench.mode == "platen" else strain,
        tangent_Pa=(2.0 if bench.mode == "shear" else 6.0) * C10_Pa,
    )
