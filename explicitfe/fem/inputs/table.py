"""Base class and common types of the tables in text files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from explicitfe.fem.inputs.bounds import check_bounds
from explicitfe.fem.inputs.limits import ThreadCount
from explicitfe.platform.errors import InputError

LONGEST_TITLE_CHARACTERS = 300
LONGEST_NAME_CHARACTERS = 100
MOST_ROWS_OF_A_COURSE = 10_000
MOST_TABLES_OF_A_KIND = 1000


class Table(BaseModel):
    """A table of a text file. It is frozen, and refuses unknown keys and numbers outside the bounds of their unit.

    Raises
    ------
    InputError : a table that is created in Python has a wrong or missing key.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __init__(self, **keys: Any) -> None:
        try:
            super().__init__(**keys)
        except ValidationError as error:
            from explicitfe.fem.inputs.sentences import explain

            name = type(self).__name__
            raise InputError(f"{name}: {explain(error, keys, type(self)).removeprefix('the scenario: ')}") from None

    # Marks an ``__init__`` that only replaces the error: ``validated`` then keeps the place of a wrong key in a scenario.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @field_validator("*")
    @classmethod
    def _within_the_bounds_of_its_unit(cls, value: object, info: ValidationInfo) -> object:
        key = info.field_name or ""
        check_bounds(key, value, cls.model_fields[key].metadata)
        return value


AnyTable = TypeVar("AnyTable", bound=BaseModel)


def validated(table: type[AnyTable], data: Mapping[str, object]) -> AnyTable:
    """Parsed TOML as a table of the schema, strictly: "2" is no number. Strict JSON lets arrays be tuples, 2 be 2.0.

    Raises
    ------
    ValidationError : ``explain`` of ``fem/inputs/sentences.py`` makes a sentence of it.
    """
    return table.model_validate_json(json.dumps(data), strict=True)


def row_of(length: int, what: str) -> BeforeValidator:
    """A check that a value is a row of this length; ``what`` completes the sentence "must be ..."."""

    def check(value: object) -> tuple[object, ...]:
        if not isinstance(value, list | tuple) or len(value) != length:
            raise ValueError(f"must be {what}")
        return tuple(value)

    return BeforeValidator(check)


def _one_line(title: str) -> str:
    if "\n" in title or "\t" in title:
        raise ValueError("must be one line without tabs, because it is the heading of tables and pictures")
    return title


Title = Annotated[
    str,
    Field(max_length=LONGEST_TITLE_CHARACTERS, description="one line, the heading of tables and pictures"),
    AfterValidator(_one_line),
]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME_CHARACTERS)]
Names = Annotated[
    list[Name],
    BeforeValidator(lambda value: [value] if isinstance(value, str) else value, json_schema_input_type=str | list[Name]),
]
Vector = Annotated[tuple[float, float, float], row_of(3, "three numbers [x, y, z]")]
Cells = Annotated[tuple[int, int, int], row_of(3, "three whole numbers, such as [16, 8, 10]")]
Pair = Annotated[tuple[float, float], row_of(2, "a pair [time_ms, scale]")]
PathRow = Annotated[tuple[float, float, float, float], row_of(4, "a row [time_ms, x_mm, y_mm, z_mm]")]
Threads = Annotated[ThreadCount | None, Field(description="number of threads; chosen for the size of the mesh by default")]
Size = Annotated[tuple[float, float, float], row_of(3, "three lengths [x, y, z] in mm")]
