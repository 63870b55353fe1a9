"""Error messages for tables that do not fit their schema."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from explicitfe.fem.materials import LAWS
from explicitfe.platform.errors import nearest, shortened

# Requirements in the user's words where those of pydantic are about Python; other errors keep pydantic's words.
_KINDS = {
    "model_type": "it must be a table",
    "model_attributes_type": "it must be a table",
    "dict_type": "it must be a table",
    "list_type": "it must be a list, in brackets",
    "tuple_type": "it must be a list, in brackets",
    "string_type": "it must be text, in quotes",
    "bool_type": "it must be true or false",
    "finite_number": "it must be a finite number",
    "int_parsing_size": "it must be a whole number of at most 64 bits",
}


MOST_OTHERS_NAMED = 3


def explain(error: ValidationError, data: object, table: type[BaseModel]) -> str:
    """The first error in ``data`` as one sentence with the key and what to do."""
    # A misspelt key is named before the key that is missing because of it.
    problems = sorted(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    problem = problems[0]
    keys = _keys(problem, data)
    where = _where(keys, data)
    sentence = _sentence(problem, keys, where, table)
    # A value that fits none of several types has one problem for each type.
    others = list(dict.fromkeys(".".join(_where(_keys(other, data), data)) for other in problems if _keys(other, data) != keys))
    more, left = len(others), len(others) - MOST_OTHERS_NAMED
    named = ", ".join(others[:MOST_OTHERS_NAMED]) + (f" and {left} more" if left > 0 else "")
    after = f" ({more} more error{'s' * (more > 1)}: {shortened(named)})" if more else ""
    return f"{sentence.rstrip('.')}{after}" + ("" if sentence.endswith("?") and not more else ".")


def _sentence(problem: ErrorDetails, keys: Sequence[int | str], where: Sequence[str], table: type[BaseModel]) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    place = ".".join(where)
    if kind == "extra_forbidden":
        valid = _valid_keys(table, problem["loc"][:-1])
        return f'unknown key "{shortened(str(keys[-1]))}"{_inside(where[:-1])}; {nearest(str(keys[-1]), valid)}'
    if kind == "missing":
        return f'the key "{keys[-1]}" is missing{_inside(where[:-1])}; add it'
    if kind == "union_tag_invalid":
        return f"unknown law{_inside(where)}; {nearest(str(context['tag']), LAWS)}"
    if kind == "literal_error":
        return f"{place} = {written(problem['input'])} is not possible; it must be {context['expected']}"
    if kind == "value_error":
        return f"{place or 'the scenario'}: {context['error']}"
    if kind == "out_of_bounds":
        place = ".".join([*where, *([context["key"]] if "key" in context else [])])
        place += "".join(f" {number + 1}" for number in context["place"])
        return f"{place} = {context['number']:g} is not possible: {context['reason']}"
    message = _KINDS.get(kind, problem["msg"][0].lower() + problem["msg"][1:])
    return f"{place or 'the scenario'} = {written(problem['input'])} is not possible: {message}"


def written(value: object) -> str:
    """A value approximately as written in the file, shortened if it is long."""
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else str(value).lower()
    if isinstance(value, Mapping):
        return shortened("{" + ", ".join(f"{key} = {written(inner)}" for key, inner in _first(value.items())) + "}")
    if isinstance(value, list | tuple):
        return shortened("[" + ", ".join(written(inner) for inner in _first(value)) + "]")
    return shortened(repr(value))


def _first(values: Iterable[Any]) -> list[Any]:
    """The first values, as many as a sentence can show."""
    return [value for _, value in zip(range(40), values, strict=False)]


def _keys(problem: ErrorDetails, data: object) -> list[int | str]:
    """Keys of a problem in the data, without the names of the types that were tried."""
    keys: list[int | str] = []
    at: Any = data
    named = problem["loc"][:-1] if problem["type"] in ("missing", "extra_forbidden") else problem["loc"]
    for key in named:
        try:
            at = at[key]
        except (KeyError, IndexError, TypeError):
            continue
        keys.append(key)
    return [*keys, *problem["loc"][len(named) :]]


def _where(keys: Iterable[int | str], data: object) -> list[str]:
    """Path of a key for messages: entries of an array by their name, or else by their number from 1."""
    path: list[str] = []
    part: Any = data
    for key in keys:
        try:
            part = part[key]
        except (KeyError, IndexError, TypeError):
            part = None
        if isinstance(part, dict) and isinstance(key, int) and path:
            name = part.get("name")
            path[-1:] = [path[-1], shortened(name)] if isinstance(name, str) else [f"{path[-1]} {key + 1}"]
        elif isinstance(key, int) and path:
            path[-1] += f" {key + 1}"
        else:
            path.append(shortened(str(key)))
    return path


def _inside(path: Sequence[str]) -> str:
    return f" in [{'.'.join(path)}]" if path else ""


def _valid_keys(table: type[BaseModel], keys: Sequence[int | str]) -> list[str]:
    """Valid keys of the table at this place; a material has those of its law."""
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
    """Table classes in an annotation, such as SpecimenTable in ``list[SpecimenTable] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _tables(inner)
