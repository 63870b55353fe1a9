"""What all tables of text files have in common: strictness, and rows of numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


class Table(BaseModel):
    """A table of a text file: it cannot be changed, refuses keys that it does not know, and refuses infinite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


AnyTable = TypeVar("AnyTable", bound=BaseModel)


def validated(table: type[AnyTable], data: Mapping[str, object]) -> AnyTable:
    """Parsed TOML as a table of the schema, strictly: "2" is no number. Strict JSON lets arrays be tuples, 2 be 2.0.

    Raises
    ------
    ValidationError : ``explain`` of ``scenario/sentences.py`` makes a sentence of it.
    """
    return table.model_validate_json(json.dumps(data, default=str), strict=True)


def row_of(length: int, what: str) -> BeforeValidator:
    """A check that a value is a row of this length; ``what`` completes the sentence "must be ..."."""

    def check(value: object) -> tuple[object, ...]:
        if not isinstance(value, list | tuple) or len(value) != length:
            raise ValueError(f"must be {what}")
        return tuple(value)

    return BeforeValidator(check)


Vector = Annotated[tuple[float, float, float], row_of(3, "three numbers [x, y, z]")]
Cells = Annotated[tuple[int, int, int], row_of(3, "three whole numbers, such as [16, 8, 10]")]
Pair = Annotated[tuple[float, float], row_of(2, "a pair [time_ms, scale]")]
Threads = Annotated[
    int | None, Field(ge=1, le=256, description="that share a step; as many as pay for a mesh of this size if left out")
]
Size = Annotated[tuple[float, float, float], row_of(3, "three lengths [x, y, z] in mm")]
