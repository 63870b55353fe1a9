"""What is wrong with a table, as a sentence for whoever wrote it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from explicitfe.errors import nearest
from explicitfe.materials import LAWS


def explain(error: ValidationError, data: object, table: type[BaseModel]) -> str:
    """The first thing that is wrong with ``data`` as a ``table``, as one sentence with the key and what to do."""
    # A misspelt key is named before the key that is missing because of it.
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    problem = problems[0]
    keys = [key for key in problem["loc"] if key not in {"name", *LAWS} or key == problem["loc"][-1]]
    where = _where(keys, data)
    if problem["type"] == "extra_forbidden":
        valid = _valid_keys(table, problem["loc"][:-1])
        sentence = f'unknown key "{keys[-1]}"{_inside(where[:-1])}; {nearest(str(keys[-1]), valid)}'
    elif problem["type"] == "missing":
        sentence = f'the key "{keys[-1]}" is missing{_inside(where[:-1])}; add it'
    elif problem["type"] == "union_tag_invalid":
        sentence = f"unknown law{_inside(where)}; {nearest(str(problem['ctx']['tag']), LAWS)}"
    elif problem["type"] == "literal_error":
        sentence = f"{'.'.join(where)} = {problem['input']!r} is not possible; it must be {problem['ctx']['expected']}"
    elif problem["type"] == "value_error":
        sentence = f"{'.'.join(where) or 'the scenario'}: {problem['ctx']['error']}"
    else:
        message = problem["msg"][0].lower() + problem["msg"][1:]
        sentence = f"{'.'.join(where) or 'the whole'} = {problem['input']!r} is not possible: {message}"
    more = f" ({len(problems) - 1} more after this one)" if len(problems) > 1 else ""
    return f"{sentence.rstrip('.')}{more}" + ("" if sentence.endswith("?") and not more else ".")


def _where(keys: Iterable[int | str], data: object) -> list[str]:
    """The path of a key as a user would say it: entries of an array by their name."""
    path: list[str] = []
    part: Any = data
    for key in keys:
        try:
            part = part[key]
        except (KeyError, IndexError, TypeError):
            part = None
        if isinstance(part, dict) and isinstance(key, int) and path:
            # A table of an array goes by its name, or else by its number, from 1 as a person counts.
            name = part.get("name")
            path[-1:] = [path[-1], name] if isinstance(name, str) else [f"{path[-1]} {key + 1}"]
        else:
            path.append(str(key))
    return path


def _inside(path: list[str]) -> str:
    return f" in [{'.'.join(path)}]" if path else ""


def _valid_keys(table: type[BaseModel], keys: Sequence[int | str]) -> list[str]:
    """Keys that the table at this place knows; a material has those of its law."""
    current: type[BaseModel] | None = table
    for key in keys:
        if isinstance(key, int) or current is None:
            continue
        if key in LAWS:
            current = LAWS[key][0]
            continue
        named = {field.alias or name: field for name, field in current.model_fields.items()}
        inner = named[key].annotation if key in named else None
        current = next((t for t in _tables(inner)), None)
    return [field.alias or name for name, field in current.model_fields.items()] if current is not None else []


def _tables(annotation: object) -> Iterable[type[BaseModel]]:
    """The tables that an annotation names, such as SpecimenTable in ``list[SpecimenTable] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _tables(inner)
