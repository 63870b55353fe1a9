"""What differs between scenarios, key by key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import JsonValue

# Keys of a scenario that are words for people: they change nothing that is computed.
WORDS = ("title", "question", "expect")


def differing_keys(scenarios: Sequence[Mapping[str, JsonValue]]) -> dict[str, list[JsonValue]]:
    """The keys whose values are not the same in all scenarios, in the order of the first that has them.

    Parameters
    ----------
    scenarios : with ``--set`` and defaults filled in, as ``Result.model["scenario"]`` has them.

    Returns
    -------
    Key -> its value in each scenario, None where it is not given. Keys are written as ``--set`` takes them: a table of a list
    goes by its name, ``muscle.GGp.force_N``, or by its number where it has none of its own.
    """
    flat = [dict(_leaves({key: value for key, value in scenario.items() if key not in WORDS})) for scenario in scenarios]
    keys = dict.fromkeys(key for leaves in flat for key in leaves)
    rows = {key: [leaves.get(key) for leaves in flat] for key in keys}
    return {key: values for key, values in rows.items() if any(value != values[0] for value in values)}


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, JsonValue]]:
    """The values in nested tables and lists of tables, each with its key."""
    if isinstance(value, Mapping):
        inner = list(value.items())
    elif isinstance(value, list) and value and all(isinstance(entry, Mapping) for entry in value):
        names = [str(entry.get("name", "")) for entry in value]
        own = [name if name and names.count(name) == 1 else str(number) for number, name in enumerate(names)]
        inner = list(zip(own, value, strict=True))
    else:
        yield key, value
        return
    for name, entry in inner:
        yield from _leaves(entry, f"{key}.{name}" if key else str(name))
