"""Expected results of a scenario: numbers that a report compares with those of the run."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, WithJsonSchema

from explicitfe.platform.host.nested import leaves

ExpectedNumbers = Annotated[
    dict[str, float],
    BeforeValidator(lambda value: dict(leaves(value)) if isinstance(value, dict) else value),
    WithJsonSchema({"type": "object", "description": "measure -> number"}),
]
EXPECTED = "measures at one time, with the names of sweeps such as points.tip.up_mm; time_ms selects the sample, else the last"
