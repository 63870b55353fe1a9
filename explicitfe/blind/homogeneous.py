"""One homogeneous case, drawn from its own random numbers: a test, a tissue, what is hidden in it, its noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from explicitfe.blind.case import UNSTATED, Case, Measured, Told, Wanted, sealed
from explicitfe.blind.closed_forms import Bench
from explicitfe.blind.identifiable import COARSE, Scales, Separation, scales, separation
from explicitfe.blind.noise import Noise, Whitener
from explicitfe.blind.protocols import EFFECTS, PROGRAMMES, WAYS, Protocol, draw_protocol, shows

CONTROLS = ("white", "correlated", "scatter", "wrong-dimension")
OUTSIDE = ("power-law", "threshold", "stick-slip")
POISSON = 0.499
C10_PA = (100.0, 3000.0)
RATIO = 1.5  # largest C20 / C10
CORRELATED = 0.2  # share of the cases with an effect whose noise is correlated
RHO = (0.5, 0.95)
COLUMNS = {
    "uniaxial": ("stretch", "nominal_stress_Pa"),
    "shear": ("shear_strain", "shear_stress_Pa"),
    "platen": ("displacement_mm", "force_N"),
}
# keys of the noise of what is predicted and of what is imposed
NOISE = {
    "uniaxial": ("stress_sd_Pa", "stretch_sd"),
    "shear": ("stress_sd_Pa", None),
    "platen": ("force_sd_N", "displacement_sd_mm"),
}
# largest plausible strengths of the library, which no hidden effect exceeds
LARGEST = {
    "third-yeoh": 1000.0,
    "fibres": 20000.0,
    "contact-offset": 1.0,
    "compliance": 1.0,
    "force-offset": 0.1,
    "force-drift": 0.001,
    "base-slip": 100.0,
    "adhesion": 500.0,
}


def pairs() -> list[tuple[str, str]]:
    """Pairs of effects that some protocol can show together, in a fixed order."""
    together = {pair for name, ways in WAYS.items() for way in ways for pair in _pairs(shows(name, way))}
    return sorted(together)


def _pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    order = sorted(names)
    return [(a, b) for k, a in enumerate(order) for b in order[k + 1 :]]


def choices(kind: str) -> list[tuple[str, ...]]:
    """What a kind can be; cases go round this list."""
    if kind == "double":
        return list(pairs())
    return [(name,) for name in {"control": CONTROLS, "single": EFFECTS, "outside": OUTSIDE}[kind]]


def draw(rng: np.random.Generator, wanted: Wanted) -> Case:
    """A case of that kind."""
    protocol = _protocol(rng, wanted)
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_PA))):.4g}")
    C20 = 0.0 if rng.random() < 0.1 else float(f"{rng.uniform(0.0, RATIO) * C10:.4g}")
    bench = Bench(protocol.plan, protocol.mode, POISSON)
    size = scales(bench, C10, C20, bench.values(C10, C20))
    effects = {} if wanted.kind == "control" else {name: _effect(rng, name, bench, size, C10, C20) for name in wanted.what}
    whole = bench.values(C10, C20, effects, COARSE if "power-law" in effects else None)
    noise = _noise(rng, wanted, float(np.abs(whole).max()))
    measured = noise.added(rng, bench.curves(whole))
    specimen, wrong = _specimen(rng, protocol, wanted)
    told = Told(rng.random() >= UNSTATED, noise.scale_sd > 0.0 and rng.random() < 0.5)
    group = "specimen-1" if noise.scale_sd == 0.0 and rng.random() < 0.5 else None
    apart = _apart(bench, wanted, effects, (C10, C20), noise)
    truth = sealed(wanted, effects, (C10, C20), noise, told, apart) | {
        "protocol": protocol.name,
        "mode": protocol.mode,
        "test": protocol.test,
        "holdout": any(curve.split == "holdout" for curve in protocol.plan),
        "rows": {curve.id: len(curve.time_s) for curve in protocol.plan},
        "wrong": wrong,
    }
    platen = protocol.mode == "platen"
    return Case(
        title=protocol.title,
        test=protocol.test,
        columns=COLUMNS[protocol.mode],
        specimen=specimen,
        tool={"shape": "platen", "control": "displacement", "friction": 0.0} if platen else None,
        noise=told.table(noise, *NOISE[protocol.mode]),
        curves=[_measured(protocol, k, values, specimen, group) for k, values in enumerate(measured)],
        truth=truth,
    )


def _measured(protocol: Protocol, number: int, values: np.ndarray, specimen: dict[str, Any], group: str | None) -> Measured:
    curve, first = protocol.plan[number], protocol.plan[0]
    if sum(other.test == curve.test for other in protocol.plan) > 1:
        group = f"specimen-{curve.test + 1}"
    own = {}
    if curve.height_m != first.height_m:  # a length that is stated wrongly is so by the same factor everywhere
        own = {"specimen": {"height_mm": round(specimen["height_mm"] * curve.height_m / first.height_m, 4)}}
    imposed = 1e3 * curve.imposed if protocol.mode == "platen" else curve.imposed
    rows = np.column_stack([curve.time_s, imposed, values])
    return Measured(curve.id, rows, group, curve.split, curve.conditions, own)


def _protocol(rng: np.random.Generator, wanted: Wanted) -> Protocol:
    if wanted.kind != "control":
        needs = wanted.what if wanted.kind != "outside" else ()
        only = {
            "power-law": ("ramp-hold", "hold-unload-rest"),
            "threshold": ("ramps", "ramp-hold", "hold-unload-rest", "cycles-in-one"),
            "stick-slip": ("ramps", "hold-unload-rest", "cycles-in-one"),
        }.get(wanted.what[0], ())
        return draw_protocol(rng, needs, only)
    if wanted.what == ("scatter",):
        return draw_protocol(rng, only=("repeats",))
    return draw_protocol(rng, only=tuple(PROGRAMMES), platen=wanted.what == ("wrong-dimension",))


def _noise(rng: np.random.Generator, wanted: Wanted, largest: float) -> Noise:
    correlated = wanted.what == ("correlated",) or (wanted.kind != "control" and rng.random() < CORRELATED)
    rho = round(float(rng.uniform(*RHO)), 3) if correlated else 0.0
    scatter = wanted.what == ("scatter",)
    scale = round(float(rng.uniform(0.03, 0.10)), 4) if scatter else 0.0
    return Noise(wanted.level, wanted.level * largest, rho, scale, 0.01 * largest if scatter else 0.0)


def _specimen(rng: np.random.Generator, protocol: Protocol, wanted: Wanted) -> tuple[dict[str, Any], dict[str, float] | None]:
    """The table as the dataset states it, and by what factor which length of it is wrong."""
    if protocol.radius_mm is None:
        return {"shape": "point"}, None
    heights = [1e3 * curve.height_m for curve in protocol.plan]
    table: dict[str, Any] = {"shape": "cylinder", "radius_mm": protocol.radius_mm, "height_mm": round(heights[0], 6)}
    wrong = None
    if wanted.what == ("wrong-dimension",):
        key = str(rng.choice(["radius_mm", "height_mm"]))
        factor = 1.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.10))
        table[key] = round(table[key] * factor, 3)
        wrong = {"key": key, "factor": factor}
        table["assumed"] = [key]
    elif rng.random() < 0.3:
        table["assumed"] = [str(rng.choice(["radius_mm", "height_mm"]))]
    return table | {"base": "frictionless"}, wrong


def _apart(
    bench: Bench, wanted: Wanted, effects: Mapping[str, Mapping[str, Any]], constants: tuple[float, float], noise: Noise
) -> Separation | None:
    """Separations, by the curves that a tool may use: not those that the dataset holds out."""
    if wanted.kind == "control":
        return None
    remembers = {"viscoelastic", "power-law"} & set(effects)
    true = bench.values(*constants, effects, COARSE if remembers else None, recovers=False)
    whiten = Whitener(noise, bench.curves(true), [curve.split != "holdout" for curve in bench.plan])
    return separation(bench, true, whiten, constants, () if wanted.kind == "outside" else wanted.what)


# ---- effects, from weak to strong ----


def strength(rng: np.random.Generator, low: float, high: float, largest: float = np.inf) -> float:
    """Between two values, logarithmic, but not above the largest plausible one."""
    high = min(high, largest)
    low = min(low, high)
    return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")


def signed(rng: np.random.Generator, low: float, high: float, largest: float = np.inf) -> float:
    """The same, of either sign."""
    return float(rng.choice([-1.0, 1.0])) * strength(rng, low, high, largest)


def _effect(rng: np.random.Generator, name: str, bench: Bench, size: Scales, C10_Pa: float, C20_Pa: float) -> dict[str, Any]:
    """Parameters of an effect as a model file states them."""
    ways = np.concatenate([curve.imposed / curve.height_m for curve in bench.plan])
    strain = float(np.abs(ways - 1.0).max()) if bench.mode == "uniaxial" else float(np.abs(ways).max())
    stretch = 1.0 + strain if bench.mode == "uniaxial" and ways.max() > 1.0 else 1.0 - strain
    x = strain**2 if bench.mode == "shear" else stretch**2 + 2.0 / stretch - 3.0
    F, depth, span, W = size.force_N, size.depth_mm, size.longest_s, size.energy_Pa
    most = LARGEST.get(name, np.inf)
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
        return {"per_cycle": signed(rng, 0.003, 0.1)}
    if name == "contact-offset":
        return {"offset_mm": signed(rng, 0.005 * depth, 0.15 * depth, most)}
    if name == "compliance":
        return {"compliance_mm_N": strength(rng, 0.005 * depth / F, 0.3 * depth / F, most)}
    if name == "force-offset":
        return {"offset_N": signed(rng, 0.005 * F, 0.2 * F, most)}
    if name == "force-drift":
        return {"rate_N_s": signed(rng, 0.005 * F / span, 0.2 * F / span, most)}
    if name == "power-law":
        t0 = strength(rng, 3e-4 * span, 0.02 * span)
        return {"share": strength(rng, 0.3, 0.9), "exponent": strength(rng, 0.15, 0.35), "t0_s": t0}
    if name == "threshold":
        E = (2.0 if bench.mode == "shear" else 6.0) * C10_Pa
        return {"strain": round(float(rng.uniform(0.3, 0.7) * strain), 4), "modulus_Pa": strength(rng, 0.5 * E, 6.0 * E)}
    assert name == "stick-slip"
    reach = 1e-3 * depth if bench.mode == "platen" else strain
    whole = float(np.abs(bench.values(C10_Pa, C20_Pa)).max())
    way, drag = strength(rng, 0.08 * reach, 0.25 * reach), strength(rng, 0.02 * whole, 0.12 * whole)
    return {"way": way, "drag": drag, "seed": int(rng.integers(1 << 31))}
