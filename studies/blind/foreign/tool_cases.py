"""A case under a tool of the foreign family: the implicit solver makes the tests of one or two geometries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from studies.blind.case import UNSTATED_NOISE_SHARE, Case, CaseCurve, CaseRequest, Table
from studies.blind.draws import C10_RANGE_PA, LARGEST_STRENGTHS, signed_strength, strength
from studies.blind.foreign.axisymmetric import RoundSpecimen
from studies.blind.foreign.contact import RigidTool
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.secants import Secants
from studies.blind.foreign.tool_tests import ColumnNoise, RigReading, ToolTest, answers
from studies.blind.grid import Conditions, Parameters
from studies.blind.protocols import programme
from studies.blind.truth import Truth, common_truth

TOOL_PROTOCOLS = ("two-heights", "two-radii", "sphere", "force-steps", "force-two-heights", "sharp")
TWO_GEOMETRIES = ("two-heights", "two-radii", "sphere")
TOOL_SINGLES = {  # effect -> protocols that can show it
    "friction": ("two-heights", "two-radii", "force-two-heights"),
    "base-slip": ("two-heights",),
    "compressible": TWO_GEOMETRIES,
    "stiffness-gradient": TWO_GEOMETRIES,
    "layer": TWO_GEOMETRIES,
    "gravity": ("two-heights",),
    "third-yeoh": TWO_GEOMETRIES,
    "viscoelastic": (*TWO_GEOMETRIES, "force-steps"),
    "softening": TWO_GEOMETRIES,
    "compliance": (*TWO_GEOMETRIES, "force-two-heights"),
    "contact-offset": (*TWO_GEOMETRIES, "force-two-heights"),
    "force-offset": TWO_GEOMETRIES,
    "force-drift": TWO_GEOMETRIES,
    "lag": TWO_GEOMETRIES,
    "inclusion": TWO_GEOMETRIES,
}
TOOL_DOUBLES = (
    ("compliance", "third-yeoh"),
    ("contact-offset", "third-yeoh"),
    ("compressible", "force-offset"),
    ("contact-offset", "viscoelastic"),
)
TOOL_OUTSIDE = ("radial-gradient", "stiff-ring", "saturation")
DATA_FINENESS = {"sphere": 1.6}  # else 0.8: errors of 0.02 % of the force, and ripples of 0.01 %
FLAT_FINENESS = 0.8
LARGEST_C20_OF_TOOL_CASES = 1.0  # over C10
EXACT_IMPOSED_SHARE = 0.3  # In this share of the cases the imposed column is exact.
DISPLACEMENT_SD_MM = {0.003: 0.005, 0.01: 0.01, 0.03: 0.02}
FORCE_SD_SHARE = 0.4  # of the level, of the largest force
LIFT_MM = 0.4  # So far above the specimen the tool is lifted at the end.
STEP_RAMP_S = 1.0


@dataclass(frozen=True)
class PlannedTests:
    """Tests under a tool, and the depth that each reaches, about."""

    name: str
    title: str
    tests: list[ToolTest]
    depth_mm: list[float]


def draw_under_a_tool(rng: np.random.Generator, request: CaseRequest, subjects: tuple[str, ...], protocol: str | None) -> Case:
    """Draw a case with the effects ``subjects`` hidden.

    Raises
    ------
    RunError : the solver does not reach a state.
    """
    names = subjects if request.kind != "control" else ()
    if protocol is None:
        possible = set(TOOL_SINGLES.get(names[0], TWO_GEOMETRIES))
        for name in names[1:]:
            possible &= set(TOOL_SINGLES[name])
        protocol = str(rng.choice(sorted(possible)))
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_RANGE_PA))):.4g}")
    C20 = float(f"{rng.uniform(0.0, LARGEST_C20_OF_TOOL_CASES) * C10:.4g}")
    tissue = HiddenTissue(C10, C20)
    planned = plan_tests(rng, protocol, C10)
    secants = Secants(planned.tests, tissue, planned.depth_mm) if names else None
    effects = {name: _strengths(rng, name, secants) for name in names} if secants else {}
    hidden, reading, friction = tissue, RigReading(), 0.0
    for name, parameters in effects.items():
        hidden, reading, friction = hide(name, parameters, hidden, reading, friction)
    tests = [replace(test, tool=replace(test.tool, friction=friction)) for test in planned.tests]
    columns = answers(tests, hidden, reading, planned.depth_mm, DATA_FINENESS.get(protocol, FLAT_FINENESS))
    by_force = tests[0].by_force
    force = max(test.largest if by_force else float(np.abs(column).max()) for test, column in zip(tests, columns, strict=True))
    noise = ColumnNoise(float(f"{FORCE_SD_SHARE * request.level * force:.3g}"), DISPLACEMENT_SD_MM[request.level])
    if rng.random() < EXACT_IMPOSED_SHARE:
        noise = replace(noise, **({"force_N": 0.0} if by_force else {"displacement_mm": 0.0}))
    stated = bool(rng.random() >= UNSTATED_NOISE_SHARE)
    distances = None
    if secants is not None:
        total = sum(_secant(secants, name, effects[name]) for name in names)
        distances = secants.separation(np.asarray(total), () if request.kind == "outside" else names, noise)
    truth: Truth = {
        **common_truth(
            request.kind,
            subjects[0],
            effects,
            (C10, C20),
            {
                "level": request.level,
                "sd": noise.displacement_mm if by_force else noise.force_N,
                "rho": 0.0,
                "scale_sd": 0.0,
                "offset_sd": 0.0,
                "stated": stated,
                "repeats_stated": False,
            },
            distances,
        ),
        "protocol": protocol,
        "mode": "indentation",
        "test": "indentation",
        "holdout": False,
        "rows": {test.id: len(test.rows) for test in tests},
        "wrong": None,
    }
    first = tests[0]
    tool: Table = {"shape": first.tool.shape, "radius_mm": first.tool.radius_mm}
    if first.tool.edge_mm:
        tool["edge_radius_mm"] = first.tool.edge_mm
    tool["control"] = "force" if by_force else "displacement"
    return Case(
        title=planned.title,
        test="indentation",
        columns=("displacement_mm", "force_N"),
        specimen={
            "shape": "cylinder",
            "radius_mm": first.specimen.radius_mm,
            "height_mm": first.specimen.height_mm,
            "density_kg_m3": tissue.density_kg_m3,
            "base": "unknown",
        },
        tool=tool,
        noise={"force_sd_N": noise.force_N, "displacement_sd_mm": noise.displacement_mm} if stated else {},
        curves=[_curve(rng, test, column, first, noise) for test, column in zip(tests, columns, strict=True)],
        truth=truth,
    )


def _curve(rng: np.random.Generator, test: ToolTest, column: np.ndarray, first: ToolTest, noise: ColumnNoise) -> CaseCurve:
    depth, force = (column, test.imposed(test.rows)) if test.by_force else (test.imposed(test.rows), column)
    depth = depth + noise.displacement_mm * rng.standard_normal(len(depth))
    force = force + noise.force_N * rng.standard_normal(len(force))
    own: dict[str, Table] = {}
    if test.specimen.height_mm != first.specimen.height_mm:
        own["specimen"] = {"height_mm": test.specimen.height_mm}
    if test.tool.radius_mm != first.tool.radius_mm:
        own["tool"] = {"radius_mm": test.tool.radius_mm}
    rows = np.column_stack([test.rows, depth, force])
    return CaseCurve(test.id, rows, f"specimen-{test.test + 1}", test.split, test.conditions, own)


# ---- programmes ----


def plan_tests(rng: np.random.Generator, name: str, C10_Pa: float) -> PlannedTests:
    """Draw the tests of a protocol."""
    if name.startswith("force"):
        return _force_steps(rng, name, C10_Pa)
    sphere = name == "sphere"
    R, H = (30.0, 25.0) if sphere else (35.0, 20.0)
    a = 10.0 if sphere else 12.0
    radii, heights = ((a, 0.5 * a), (H, H)) if name in ("two-radii", "sphere") else ((a, a), (H, 0.5 * H))
    edge = 0.0 if sphere or name == "sharp" else float(rng.choice([0.5, 1.0]))
    rate, hold = float(rng.choice([0.2, 0.5, 1.0])), float(rng.choice([10.0, 20.0, 40.0]))
    tests: list[ToolTest] = []
    depths: list[float] = []
    for radius, height in zip(radii, heights, strict=True):
        depth = round(float(min(0.12 * height, 0.2 * radius) if name == "sharp" else min(0.25 * height, 0.5 * radius)), 2)
        up, down = depth / rate, (depth + LIFT_MM) / rate
        corners = ((0.0, 0.0), (up, depth), (up + hold, depth), (up + hold + down, -LIFT_MM))
        rows, _ = programme(corners, int(rng.integers(30, 55)))
        conditions: Conditions = {"rate_mm_per_s": rate, "max_displacement_mm": depth, "hold_s": hold}
        tool = RigidTool("sphere" if sphere else "flat-cylinder", radius, edge)
        k = len(tests)
        tests.append(ToolTest(f"curve-{k + 1}", RoundSpecimen(R, height), tool, corners, False, rows, conditions, k))
        depths.append(depth)
    what = "specimens of two heights" if heights[0] != heights[1] else "two tools"
    return PlannedTests(name, f"Indentation, {what}: ramp, hold, unloading", tests, depths)


def _force_steps(rng: np.random.Generator, name: str, C10_Pa: float) -> PlannedTests:
    """Eight dwelled force steps up and down: two cycles on a specimen, or one on each of two heights."""
    a, largest = (14.0, 0.7 * C10_Pa / 191.5) if name == "force-steps" else (12.0, 0.45 * C10_Pa / 200.0)
    dwell = float(rng.choice([5.0, 10.0, 30.0]))
    loads = float(f"{largest:.3g}") * np.array([1, 2, 3, 4, 5, 6, 7, 8, 7, 6, 5, 4, 3, 2, 1, 0]) / 8.0
    corners = [(0.0, 0.0)]
    for load in loads:
        corners += [(corners[-1][0] + STEP_RAMP_S, float(load)), (corners[-1][0] + STEP_RAMP_S + dwell, float(load))]
    rows = np.array([t for t, _ in corners])
    tests: list[ToolTest] = []
    for k in range(2):
        height, cycle, test = (20.0, k + 1, 0) if name == "force-steps" else ((20.0, 10.0)[k], 1, k)
        conditions: Conditions = {"hold_s": dwell, "cycle": cycle}
        tool = RigidTool("flat-cylinder", a, 1.0)
        tests.append(ToolTest(f"curve-{k + 1}", RoundSpecimen(35.0, height), tool, tuple(corners), True, rows, conditions, test))
    return PlannedTests(name, "Indentation by dwelled force steps", tests, [0.33 * t.specimen.height_mm for t in tests])


# ---- what is hidden ----


def hide(
    name: str, parameters: Parameters, tissue: HiddenTissue, reading: RigReading, friction: float
) -> tuple[HiddenTissue, RigReading, float]:
    """Tissue, reading and friction with an effect, as a model file states it, or with what no library has."""
    value = next(iter(parameters.values()))
    plain: dict[str, Callable[[], tuple[HiddenTissue, RigReading, float]]] = {
        "friction": lambda: (tissue, reading, value),
        "base-slip": lambda: (replace(tissue, base_compliance_mm_kPa=value), reading, friction),
        "compressible": lambda: (replace(tissue, poisson=value), reading, friction),
        "stiffness-gradient": lambda: (replace(tissue, gradient=value), reading, friction),
        "layer": lambda: (replace(tissue, layer=(parameters["thickness_mm"], parameters["ratio"])), reading, friction),
        "gravity": lambda: (replace(tissue, gravity_m_s2=value), reading, friction),
        "third-yeoh": lambda: (replace(tissue, C30_Pa=value), reading, friction),
        "viscoelastic": lambda: (
            replace(tissue, prony=tuple(zip(parameters["g"], parameters["tau_s"], strict=True))),
            reading,
            friction,
        ),
        "softening": lambda: (
            replace(tissue, softening=(parameters["inverse_r"], parameters["m_Pa"], 0.1)),
            reading,
            friction,
        ),
        "compliance": lambda: (tissue, replace(reading, compliance_mm_N=value), friction),
        "contact-offset": lambda: (tissue, replace(reading, offset_mm=value), friction),
        "force-offset": lambda: (tissue, replace(reading, force_offset_N=value), friction),
        "force-drift": lambda: (tissue, replace(reading, force_drift_N_s=value), friction),
        "lag": lambda: (tissue, replace(reading, lag_s=value), friction),
        "saturation": lambda: (tissue, replace(reading, saturation_N=value), friction),
        "inclusion": lambda: (replace(tissue, factor=partial(_inclusion, **parameters)), reading, friction),
        "radial-gradient": lambda: (replace(tissue, factor=partial(_radial, **parameters)), reading, friction),
        "stiff-ring": lambda: (replace(tissue, factor=partial(_ring, **parameters)), reading, friction),
    }
    return plain[name]()


def _inclusion(r: np.ndarray, z: np.ndarray, height_mm: float, ratio: float, radius_mm: float, depth_mm: float) -> np.ndarray:
    away = np.hypot(r, z - (height_mm - depth_mm * height_mm / 20.0)) / radius_mm
    return np.asarray(1.0 + (ratio - 1.0) * 0.5 * (1.0 - np.tanh(6.0 * (away - 1.0))))


def _radial(r: np.ndarray, z: np.ndarray, height_mm: float, change: float, reach_mm: float) -> np.ndarray:
    return np.asarray(1.0 + change * (2.0 * np.exp(-((r / reach_mm) ** 2)) - 1.0))


def _ring(r: np.ndarray, z: np.ndarray, height_mm: float, ratio: float, at_mm: float) -> np.ndarray:
    return np.asarray(1.0 + (ratio - 1.0) * np.exp(-(((r - at_mm) / 2.0) ** 2)))


def _strengths(rng: np.random.Generator, name: str, secants: Secants) -> Parameters:
    """Parameters from weak to strong."""
    F, d, span, H = secants.largest_force_N, secants.largest_depth_mm, secants.longest_s, max(secants.height_mm)
    C10, most = secants.tissue.C10_Pa, LARGEST_STRENGTHS.get(name, np.inf)
    draws: dict[str, Callable[[], Parameters]] = {
        "friction": lambda: {"coefficient": strength(rng, 0.05, 0.8)},
        "base-slip": lambda: {"compliance_mm_kPa": strength(rng, 50.0 * H / (2.0 * C10), 5e3 * H / (2.0 * C10), most)},
        "compressible": lambda: {"poisson": round(0.5 * (1.0 - strength(rng, 0.01, 0.1)), 5)},
        "stiffness-gradient": lambda: {"g": signed_strength(rng, 0.1, 0.7)},
        "layer": lambda: {
            "thickness_mm": strength(rng, 0.8, 3.0),
            "ratio": strength(rng, 1.5, 5.0) ** float(rng.choice([-1, 1])),
        },
        "gravity": lambda: {"acceleration_m_s2": 9.81},
        "third-yeoh": lambda: {"C30_Pa": strength(rng, 0.2 * C10, 3.0 * C10, most)},
        "viscoelastic": lambda: {"g": [strength(rng, 0.05, 0.5)], "tau_s": [strength(rng, 0.02 * span, 0.5 * span)]},
        "softening": lambda: {"inverse_r": strength(rng, 0.1, 0.6), "m_Pa": strength(rng, 0.05 * C10, 0.3 * C10)},
        "compliance": lambda: {"compliance_mm_N": strength(rng, 0.01 * d / F, 0.2 * d / F, most)},
        "contact-offset": lambda: {"offset_mm": signed_strength(rng, 0.01 * d, 0.12 * d, most)},
        "force-offset": lambda: {"offset_N": signed_strength(rng, 0.01 * F, 0.2 * F, most)},
        "force-drift": lambda: {"rate_N_s": signed_strength(rng, 0.02 * F / span, 0.2 * F / span, most)},
        "lag": lambda: {"lag_s": signed_strength(rng, 0.002 * span, 0.03 * span)},
        "saturation": lambda: {"limit_N": F * strength(rng, 2.0, 20.0)},
        "inclusion": lambda: {
            "ratio": strength(rng, 2.0, 6.0) ** float(rng.choice([-1, 1])),
            "radius_mm": round(float(rng.uniform(2.0, 4.0)), 2),
            "depth_mm": round(float(rng.uniform(5.0, 9.0)), 2),
        },
        "radial-gradient": lambda: {
            "change": signed_strength(rng, 0.15, 0.6),
            "reach_mm": round(float(rng.uniform(8.0, 16.0)), 2),
        },
        "stiff-ring": lambda: {"ratio": strength(rng, 1.5, 5.0), "at_mm": round(float(rng.uniform(6.0, 16.0)), 2)},
    }
    return draws[name]()


def _secant(secants: Secants, name: str, parameters: Parameters) -> np.ndarray:
    """The change by what is hidden, on the mesh of the rivals."""
    if name == "viscoelastic":
        return sum((secants.relaxation(g, tau) for g, tau in zip(parameters["g"], parameters["tau_s"], strict=True)), np.zeros(1))
    if name == "softening":
        return secants.softening(parameters["inverse_r"], parameters["m_Pa"] / secants.tissue.C10_Pa)
    tissue, reading, friction = hide(name, parameters, secants.tissue, RigReading(), 0.0)
    if reading != RigReading():
        return secants.reading_change(reading)
    return secants.tissue_change(tissue, friction)
