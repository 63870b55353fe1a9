"""One case of a test under a tool, simulated; drawn at random as in :mod:`studies.blind.homogeneous`."""

from __future__ import annotations

import numpy as np

from explicitfe.platform.errors import RunError
from studies.blind.case import UNSTATED_NOISE_SHARE, Case, CaseCurve, CaseRequest, NoiseStatement, Table
from studies.blind.draws import C10_RANGE_PA, CORRELATED_NOISE_SHARE, LARGEST_C20_OVER_C10, ROW_CORRELATION_RANGE
from studies.blind.effect_draws import UNDER_A_TOOL, Scales, draw_effect, third_constant_Pa
from studies.blind.noise import Noise
from studies.blind.simulated import DATA_MESH, DENSITY_KG_M3, SCREENING_MESH, SimulatedTest, simulate
from studies.blind.tool_protocols import EFFECTS_SHOWN, ToolProtocol, draw_tool_protocol
from studies.blind.tool_separation import TYPICAL_I1_MINUS_3, largest_force_and_depth, tool_separation
from studies.blind.truth import Truth, WrongLength, common_truth

TOOL_CONTROLS = ("white", "correlated", "wrong-dimension")
TOOL_EFFECTS = tuple(dict.fromkeys(name for names in EFFECTS_SHOWN.values() for name in names))
LENGTHS = (("specimen", "radius_mm"), ("specimen", "height_mm"), ("tool", "radius_mm"))
ASSUMED_LENGTH_SHARE = 0.3  # In this share of the cases the dataset calls a length assumed that is right.
DRAWS_OF_A_CASE = 6  # A case that the simulator cannot follow is drawn again, so often at most.


def choices(kind: str) -> list[tuple[str, ...]]:
    """The subjects that a kind of case can have; the cases of a set take them in turn."""
    return [(name,) for name in (TOOL_CONTROLS if kind == "control" else TOOL_EFFECTS)]


def draw(rng: np.random.Generator, request: CaseRequest) -> Case:
    """Draw a case; draw again where the simulator does not reach a state."""
    for _ in range(DRAWS_OF_A_CASE - 1):
        try:
            return _draw(rng, request)
        except RunError:
            continue
    return _draw(rng, request)


def _draw(rng: np.random.Generator, request: CaseRequest) -> Case:
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_RANGE_PA))):.4g}")
    C20 = float(f"{rng.uniform(0.0, LARGEST_C20_OVER_C10) * C10:.4g}")
    protocol = draw_tool_protocol(rng, request, C10)
    screened = np.concatenate(simulate(protocol.curves, (C10, C20), {}, SCREENING_MESH))
    effects = (
        {}
        if request.kind == "control"
        else {request.subjects[0]: draw_effect(rng, request.subjects[0], UNDER_A_TOOL, _scales(protocol, screened, C10, C20))}
    )
    whole = simulate(protocol.curves, (C10, C20), effects, DATA_MESH)
    largest = float(np.abs(np.concatenate(whole)).max())
    correlated = request.subjects == ("correlated",) or (request.kind != "control" and rng.random() < CORRELATED_NOISE_SHARE)
    noise = Noise(
        request.level, request.level * largest, round(float(rng.uniform(*ROW_CORRELATION_RANGE)), 3) if correlated else 0.0
    )
    measured = noise.add_to(rng, whole)
    statement = NoiseStatement(rng.random() >= UNSTATED_NOISE_SHARE)
    wrong: WrongLength | None = None
    assumed = LENGTHS[rng.integers(len(LENGTHS))] if rng.random() < ASSUMED_LENGTH_SHARE else None
    if request.subjects == ("wrong-dimension",):
        assumed = LENGTHS[rng.integers(len(LENGTHS))]
        factor = float(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.10))
        wrong = {"where": assumed[0], "key": assumed[1], "factor": factor}
    distances = None if request.kind == "control" else tool_separation(protocol, (C10, C20), effects, screened, noise)
    keys = ("displacement_sd_mm", "force_sd_N") if protocol.by_force else ("force_sd_N", "displacement_sd_mm")
    specimen, tool, own = _tables(protocol, wrong, assumed)
    truth: Truth = {
        **common_truth(request.kind, request.subjects[0], effects, (C10, C20), statement.truth(noise), distances),
        "protocol": protocol.name,
        "mode": "indentation",
        "test": "indentation",
        "holdout": any(curve.split == "holdout" for curve in protocol.curves),
        "rows": {curve.id: len(curve.rows) for curve in protocol.curves},
        "wrong": wrong,
    }
    return Case(
        title=protocol.title,
        test="indentation",
        columns=("displacement_mm", "force_N"),
        specimen=specimen,
        tool=tool,
        noise=statement.table(noise, *keys, factor=1e3 if protocol.by_force else 1.0),
        curves=[_curve(curve, values, own[k]) for k, (curve, values) in enumerate(zip(protocol.curves, measured, strict=True))],
        truth=truth,
    )


def _curve(curve: SimulatedTest, values: np.ndarray, own: dict[str, Table]) -> CaseCurve:
    columns = (1e3 * values, curve.imposed) if curve.by_force else (curve.imposed, values)
    group = f"specimen-{curve.test + 1}"
    return CaseCurve(curve.id, np.column_stack([curve.rows, *columns]), group, curve.split, curve.conditions, own)


def _tables(
    protocol: ToolProtocol, wrong: WrongLength | None, assumed: tuple[str, str] | None
) -> tuple[Table, Table, list[dict[str, Table]]]:
    """The tables [specimen] and [tool] as the dataset states them, and the keys that differ from curve to curve."""

    def stated(curve: SimulatedTest) -> dict[str, dict[str, float]]:
        lengths = {"specimen": dict(curve.specimen), "tool": dict(curve.tool)}
        if wrong is not None:
            table, key = lengths[wrong["where"]], wrong["key"]
            table[key] = round(table[key] * wrong["factor"], 3)
        return lengths

    first, *_ = every = [stated(curve) for curve in protocol.curves]
    own: list[dict[str, Table]] = []
    for tables in every:
        differing = {where: {k: v for k, v in table.items() if v != first[where][k]} for where, table in tables.items()}
        own.append({where: dict(table) for where, table in differing.items() if table})
    specimen: Table = {"shape": "cylinder", **first["specimen"], "density_kg_m3": DENSITY_KG_M3, "base": "unknown"}
    control = "force" if protocol.by_force else "displacement"
    tool: Table = {"shape": protocol.curves[0].tool_shape, **first["tool"], "control": control}
    if assumed is not None:
        (specimen if assumed[0] == "specimen" else tool)["assumed"] = [assumed[1]]
    return specimen, tool, own


# ---- protocols ----


# ---- effects ----


def _scales(protocol: ToolProtocol, screened: np.ndarray, C10_Pa: float, C20_Pa: float) -> Scales:
    span = max(float(curve.rows[-1]) for curve in protocol.curves)
    force, depth = largest_force_and_depth(protocol, screened)
    height = max(curve.specimen["height_mm"] for curve in protocol.curves)
    return Scales(
        span_s=span,
        depth_mm=depth,
        force_N=force,
        energy_Pa=TYPICAL_I1_MINUS_3 * C10_Pa,
        shear_Pa=2.0 * C10_Pa,
        third_Pa=third_constant_Pa(C10_Pa, C20_Pa, TYPICAL_I1_MINUS_3),
        flexibility_mm_N=depth / force,
        rate_N_s=force / span,
        slip_mm_kPa=height / (2.0 * C10_Pa),
    )


# ---- separations, all as differences of runs on one coarse mesh ----
