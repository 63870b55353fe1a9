"""What the tables of ``report.json`` have in common: a key that is null is read as if it were missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict

Side = Literal["fit", "holdout"]


def _without_nulls(value: object) -> object:
    """A list or a table without its null entries; an empty table where there is none."""
    if isinstance(value, Mapping):
        return {key: entry for key, entry in value.items() if entry is not None}
    return [entry for entry in value if entry is not None] if isinstance(value, list | tuple) else value


T = TypeVar("T")
Entries = Annotated[list[T], BeforeValidator(lambda value: [] if value is None else _without_nulls(value))]
TableOf = Annotated[dict[str, T], BeforeValidator(lambda value: {} if value is None else _without_nulls(value))]
PartOf = Annotated[T, BeforeValidator(lambda value: {} if value is None else value)]
TextOf = Annotated[str, BeforeValidator(lambda value: "" if value is None else value)]


class ReportPart(BaseModel):
    """A table of the report."""

    model_config = ConfigDict(extra="allow")
