"""Ranges and choices of settings that scenarios and Python callers share."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
RelativeResidual = Annotated[float, Field(ge=1e-9, le=1e-2)]
ThreadCount = Annotated[int, Field(ge=1, le=256)]
ElementName = Literal["hex8", "hex8-stiffness", "hex8-full"]
StressField = Literal[
    "stress", "von_mises", "pressure", "nodal_stress", "nodal_von_mises", "nodal_pressure", "strain", "stretches"
]
