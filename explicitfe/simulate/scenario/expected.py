"""Expected results of a scenario: numbers that a report compares with those of the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, WithJsonSchema


def _dotted(value: object) -> object:
    """Nested tables as one table with dotted names."""
    if not isinstance(value, Mapping):
        return value
    rows: dict[str, object] = {}
    for name, part in value.items():
        inner = _dotted(part)
        rows |= {f"{name}.{key}": number for key, number in inner.items()} if isinstance(inner, Mapping) else {name: inner}
    return rows


ExpectedNumbers = Annotated[
    dict[str, float], BeforeValidator(_dotted), WithJsonSchema({"type": "object", "description": "measure -> number"})
]
EXPECTED = "measures at one time, with the names of sweeps such as points.tip.up_mm; time_ms selects the sample, else the last"
