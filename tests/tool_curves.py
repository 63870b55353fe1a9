"""Curves of a round specimen under a tool, for tests."""

from __future__ import annotations

import numpy as np

from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool

SPECIMEN = MeasuredSpecimen(shape="cylinder", radius_mm=35.0, height_mm=20.0, base="bonded")


def tool_curve(
    name: str,
    time_s: np.ndarray,
    displacement_m: np.ndarray,
    force_N: np.ndarray,
    *,
    control: str = "displacement",
    noise: MeasuredNoise | None = None,
    **tool,
) -> Curve:
    """A curve under a tool of radius 14 mm; a flat one without further keys has an edge of 1 mm and no friction."""
    shape = tool.setdefault("shape", "flat-cylinder")
    if shape != "bonded-disc":
        tool.setdefault("friction", 0.0)
    if shape == "flat-cylinder":
        tool.setdefault("edge_radius_mm", 1.0)
    return Curve(
        id=name,
        file=f"{name}.csv",
        kind="force-displacement",
        constants="all",
        group="a",
        split=None,
        specimen=SPECIMEN,
        tool=MeasuredTool(radius_mm=14.0, control=control, **tool),
        noise=noise or MeasuredNoise(),
        conditions={},
        time_s=time_s,
        columns={"displacement_m": displacement_m, "force_N": force_N},
    )
