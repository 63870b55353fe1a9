"""Programmes of tests under a tool: which tools press which specimens, and how."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.blind.case import CaseRequest
from studies.blind.grid import Conditions
from studies.blind.protocols import programme
from studies.blind.simulated import SimulatedTest

EFFECTS_SHOWN = {
    "force-steps": ("viscoelastic", "softening", "friction", "compliance"),
    "two-radii": (
        "viscoelastic",
        "softening",
        "friction",
        "third-yeoh",
        "compressible",
        "layer",
        "stiffness-gradient",
        "adhesion",
        "contact-offset",
        "compliance",
        "force-offset",
        "force-drift",
    ),
    "two-heights": (
        "viscoelastic",
        "softening",
        "third-yeoh",
        "compressible",
        "layer",
        "stiffness-gradient",
        "base-slip",
        "adhesion",
        "contact-offset",
        "compliance",
        "force-offset",
        "force-drift",
        "gravity",
    ),
}


LIFT_OFF_MM = 0.4  # So far above the specimen the tool is lifted at the end.


@dataclass(frozen=True)
class ToolProtocol:
    """A protocol under a tool, and how it is named."""

    name: str
    title: str
    curves: tuple[SimulatedTest, ...]

    @property
    def by_force(self) -> bool:
        return self.curves[0].by_force


def draw_tool_protocol(rng: np.random.Generator, request: CaseRequest, C10_Pa: float) -> ToolProtocol:
    names = [name for name, shown in EFFECTS_SHOWN.items() if request.kind == "control" or request.subjects[0] in shown]
    name = names[rng.integers(len(names))]
    if name == "force-steps":
        return _force_steps(rng, C10_Pa)
    flat = rng.random() < 0.6
    radius, height = (35.0, 20.0) if flat else (30.0, 25.0)
    first = 12.0 if flat else 10.0
    sizes = (first, 0.5 * first) if name == "two-radii" else (first, first)
    heights = (height, height) if name == "two-radii" else (height, 0.5 * height)
    rate = float(rng.choice([0.2, 0.5, 1.0]))
    hold = float(rng.choice([10.0, 20.0, 40.0]))
    curves: list[SimulatedTest] = []
    # the same two tests at two rates, or once
    rates = (rate, 5.0 * rate) if rng.random() < 0.5 else (rate,)
    for r in rates:
        for size, h in zip(sizes, heights, strict=True):
            depth = round(float(min(0.3 * h, 0.5 * size)), 2)
            up, down = depth / r, (depth + LIFT_OFF_MM) / r
            corners = ((0.0, 0.0), (up, depth), (up + hold, depth), (up + hold + down, -LIFT_OFF_MM))
            rows, _ = programme(corners, int(rng.integers(30, 55)))
            shape, edge = ("flat-cylinder", {"edge_radius_mm": 1.0}) if flat else ("sphere", {})
            tool = {"radius_mm": size, **edge}
            conditions: Conditions = {"rate_mm_per_s": r, "max_displacement_mm": depth, "hold_s": hold}
            table = {"radius_mm": radius, "height_mm": h}
            number = len(curves)
            curves.append(
                SimulatedTest(f"curve-{number + 1}", table, shape, tool, corners, False, rows, conditions, number, None)
            )
    title = (
        f"Indentation with {'two tools' if name == 'two-radii' else 'one tool, specimens of two heights'}: ramp, hold, unloading"
    )
    return ToolProtocol(name, title, tuple(curves))


def _force_steps(rng: np.random.Generator, C10_Pa: float) -> ToolProtocol:
    """Eight dwelled force steps up and down, two cycles; two rows a step: when it begins to dwell, and when it is left."""
    step = float(f"{0.1 * C10_Pa / 191.5:.3g}")
    ramp, dwell = 1.0, float(rng.choice([5.0, 10.0, 30.0]))
    loads = step * np.array([1, 2, 3, 4, 5, 6, 7, 8, 7, 6, 5, 4, 3, 2, 1, 0], dtype=float)
    corners = [(0.0, 0.0)]
    for load in loads:
        corners += [(corners[-1][0] + ramp, float(load)), (corners[-1][0] + ramp + dwell, float(load))]
    rows = np.array([t for t, _ in corners])
    specimen, tool = {"radius_mm": 35.0, "height_mm": 20.0}, {"radius_mm": 14.0, "edge_radius_mm": 1.0}
    curves = []
    for cycle in (1, 2):
        conditions: Conditions = {"hold_s": dwell, "cycle": cycle}
        curve = SimulatedTest(f"cycle-{cycle}", specimen, "flat-cylinder", tool, tuple(corners), True, rows, conditions, 0, None)
        curves.append(curve)
    return ToolProtocol("force-steps", "Indentation by dwelled force steps, up and down, two cycles", tuple(curves))
