"""Differences between scenarios, key by key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import JsonValue

# Keys that describe a scenario for a reader. They do not change the computation.
WORDS = ("title", "question", "expect", "expected")
# A table that only one scenario has is shown with this many of its keys.
SHOWN_KEYS = 3
# Its name stands in the key already.
NOT_SHOWN_KEYS = ("name",)


def differing_keys(scenarios: Sequence[Mapping[str, JsonValue]]) -> dict[str, list[JsonValue]]:
    """Return the keys whose values differ between scenarios, in the order of the first scenario that has them.

    Parameters
    ----------
    scenarios : with ``--set`` and defaults filled in, as in ``Result.model["scenario"]``.

    Returns
    -------
    Key -> its value in each scenario, None where it is absent. Keys are written as for ``--set``: an entry of a list of tables
    is named ``muscle.GGp.force_N``, or by its number from 1 where its name is not unique. A table that a scenario lacks is one
    row: the whole table, such as ``muscle.STY``, is the value where it is present.
    """
    return dict(_rows([{key: value for key, value in scenario.items() if key not in WORDS} for scenario in scenarios], ""))


def table_in_words(table: Mapping[str, Any]) -> str:
    """Summarize a table that only one scenario has, in one line: the force of a muscle, else its first keys."""
    if "force_N" in table:
        return f"{table['force_N']:g} N"
    values = {key: value for key, value in table.items() if key not in NOT_SHOWN_KEYS and value not in (None, [], {})}
    shown = [f"{key} = {_short(value)}" for key, value in list(values.items())[:SHOWN_KEYS]]
    more = len(values) - len(shown)
    return ", ".join(shown) + (f" and {more} more keys" if more > 0 else "") or "present"


def _short(value: object) -> str:
    return "{…}" if isinstance(value, Mapping) else f"{value:g}" if isinstance(value, float) else str(value)


def _rows(values: list[Any], key: str) -> Iterator[tuple[str, list[Any]]]:
    """The differing keys of one value in all scenarios; None stands for a key that is absent."""
    values = [None if value == {} else value for value in values]
    if all(value == values[0] for value in values):
        return
    if all(isinstance(value, Mapping) for value in values):
        tables: list[Mapping[str, Any]] = values
    elif any(map(_is_list_of_tables, values)) and all(_is_list_of_tables(value) or not value for value in values):
        tables = _by_name([value or [] for value in values])
    else:
        yield key, values
        return
    for name in dict.fromkeys(name for table in tables for name in table):
        yield from _rows([table.get(name) for table in tables], f"{key}.{name}" if key else name)


def _is_list_of_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _by_name(lists: list[list[Mapping[str, Any]]]) -> list[Mapping[str, Any]]:
    """Turn lists of tables into tables of them: by name where it is unique in every scenario, else by number from 1."""
    names = [[str(entry.get("name") or "") for entry in entries] for entries in lists]
    repeated = {name for own in names for name in own if not name or own.count(name) > 1}
    keys = [[str(number) if name in repeated else name for number, name in enumerate(own, 1)] for own in names]
    return [dict(zip(own, entries, strict=True)) for own, entries in zip(keys, lists, strict=True)]
