"""Family "press": a flat cylinder or a sphere on a round specimen, by the axisymmetric solver of the blind study.

The solver needs scikit-fem. Distances are computed on a coarse mesh from secants of each rival, before the data are made.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from causes import cause_of
from sealed import Distance, Request, RowNoise, Sealed, truth_of

from studies.blind.case import Case, Table
from studies.blind.draws import C10_RANGE_PA
from studies.blind.foreign import tool_cases as tool
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.secants import Secants
from studies.blind.foreign.tool_tests import ColumnNoise, RigReading, answers
from studies.blind.grid import Parameters

LEVELS = (0.003, 0.01, 0.02)
UNSTATED_SHARE = 0.15
MOST_DRAWS = 6  # of the strengths, until the effect is identifiable
LARGEST_C20_OVER_C10 = 1.0
# Of the mesh, as the solver states it: errors of 0.05 % of the force, where the noise is 0.12 % or more.
FINENESS, FLAT_FINENESS = {"sphere": 1.2}, 0.6


def choices(kind: str) -> list[tuple[str, ...]]:
    """What a kind of case can hide."""
    if kind == "control":
        return [()]
    if kind == "pair":
        return list(tool.TOOL_DOUBLES)
    return [(name,) for name in (tool.TOOL_SINGLES if kind == "single" else tool.TOOL_OUTSIDE)]


def draw(rng: np.random.Generator, request: Request) -> Sealed:
    """Draw a case.

    Raises
    ------
    RunError : the solver does not reach a state.
    """
    names = request.subjects
    possible = set(tool.TOOL_PROTOCOLS) if not names else set(tool.TOOL_SINGLES.get(names[0], tool.TWO_GEOMETRIES))
    for name in names[1:]:
        possible &= set(tool.TOOL_SINGLES[name])
    protocol = str(rng.choice(sorted(possible)))
    C10 = float(f"{np.exp(rng.uniform(*np.log(C10_RANGE_PA))):.4g}")
    tissue = HiddenTissue(C10, float(f"{rng.uniform(0.0, LARGEST_C20_OVER_C10) * C10:.4g}"))
    planned = tool.plan_tests(rng, protocol, C10)
    level = float(rng.choice(LEVELS))
    secants = Secants(planned.tests, tissue, planned.depth_mm)
    sd = ColumnNoise(
        float(f"{tool.FORCE_SD_SHARE * level * secants.largest_force_N:.3g}"),
        float(f"{level * 0.1 * secants.largest_depth_mm:.3g}"),
    )
    effects, distance = _effects(rng, request, secants, sd)
    hidden, reading, friction = tissue, RigReading(), 0.0
    for name, parameters in effects.items():
        hidden, reading, friction = tool.hide(name, parameters, hidden, reading, friction)
    tests = [replace(test, tool=replace(test.tool, friction=friction)) for test in planned.tests]
    columns = answers(tests, hidden, reading, planned.depth_mm, FINENESS.get(protocol, FLAT_FINENESS))
    first = tests[0]
    by_force = first.by_force
    measured, imposed = (sd.displacement_mm, sd.force_N) if by_force else (sd.force_N, sd.displacement_mm)
    noise = RowNoise(measured, imposed, bool(rng.random() >= UNSTATED_SHARE))
    specimen: Table = {
        "shape": "cylinder",
        "radius_mm": first.specimen.radius_mm,
        "height_mm": first.specimen.height_mm,
        "density_kg_m3": tissue.density_kg_m3,
        "base": "unknown" if "base-slip" in effects else "bonded",
    }
    stated_tool: Table = {"shape": first.tool.shape, "radius_mm": first.tool.radius_mm}
    if first.tool.edge_mm:
        stated_tool["edge_radius_mm"] = first.tool.edge_mm
    stated_tool["control"] = "force" if by_force else "displacement"
    case = Case(
        title=planned.title,
        test="indentation",
        columns=("displacement_mm", "force_N"),
        specimen=specimen,
        tool=stated_tool,
        noise={"force_sd_N": sd.force_N, "displacement_sd_mm": sd.displacement_mm} if noise.stated else {},
        curves=[tool._curve(rng, test, column, first, sd) for test, column in zip(tests, columns, strict=True)],
        truth={},  # type: ignore[typeddict-item]
    )
    truth = truth_of(
        request,
        setting="tool",
        effects=effects,
        accepts=(),
        constants=(tissue.C10_Pa, tissue.C20_Pa),
        noise=noise,
        distance=distance,
        protocol=f"{protocol}, {'force' if by_force else 'displacement'} imposed",
        rows=sum(map(len, columns)),
    )
    return Sealed(case, truth)


def _effects(
    rng: np.random.Generator, request: Request, secants: Secants, sd: ColumnNoise
) -> tuple[dict[str, Parameters], Distance | None]:
    """The hidden effects, drawn until they are identifiable or a limit is reached, and their distances."""
    if not request.subjects:
        return {}, None
    for _ in range(MOST_DRAWS):
        effects = {name: tool._strengths(rng, name, secants) for name in request.subjects}
        change = sum((tool._secant(secants, name, effects[name]) for name in effects), np.zeros(1))
        found = secants.separation(change, (), sd)
        own = {cause_of(name) for name in effects} if request.kind == "single" else set()
        rivals: dict[str, float] = {}
        for name, square in found.rivals.items():
            if cause_of(name) not in own:
                rivals[cause_of(name)] = min(rivals.get(cause_of(name), np.inf), square**0.5)
        distance = Distance(found.baseline**0.5, rivals)
        if distance.identifiable:
            break
    return effects, distance
