"""Nested tables and lists as one table with dotted names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel


def leaves(value: object, name: str = "", with_lists: bool = True) -> Iterator[tuple[str, Any]]:
    """Values of nested tables, and of lists if wanted, with dotted names such as ``points.tip.up_mm``; entries count from 0."""
    value = value.model_dump() if isinstance(value, BaseModel) else value
    if not isinstance(value, Mapping | list):
        yield name, value
    elif with_lists or isinstance(value, Mapping):
        for key, part in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from leaves(part, f"{name}.{key}" if name else str(key), with_lists)
