"""Bounds on the numbers in text files, by the unit at the end of their key.

They contain every specimen or organ on a bench. A number outside them has most probably a wrong unit or digit, and would lead to
an overflow or to an endless run.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from annotated_types import Gt
from pydantic import BaseModel
from pydantic_core import PydanticCustomError

# Nearer to 0 than this a number is lost where it is squared or multiplied with others.
SMALLEST_MAGNITUDE = 1e-100


@dataclass(frozen=True)
class Bounds:
    """Of a unit.

    Attributes
    ----------
    smallest : that is possible where a key asks for more than 0.
    largest : that is possible at all, of either sign.
    reason : completes the sentence "... is not possible: ".
    """

    smallest: float
    largest: float
    reason: str


# The first unit that a key ends with counts, so longer ones stand first.
BOUNDS = {
    "_kg_m3": Bounds(1.0, 3e4, "densities lie between 1 kg/m^3, lighter than foam, and 30 000 kg/m^3, heavier than metal"),
    "_m_s2": Bounds(1e-6, 1e4, "accelerations end at 10 000 m/s^2, a thousand times that of gravity"),
    "_N_per_mm": Bounds(1e-9, 1e6, "springs lie between 1 nN/mm and 1 MN/mm"),
    "_kPa_per_mm": Bounds(1e-6, 1e6, "foundations lie between 1 mPa/mm and 1 GPa/mm"),
    "_mm_kPa": Bounds(1e-9, 1e4, "compliances end at 10 m/kPa"),
    "_mm_N": Bounds(1e-9, 1e4, "compliances end at 10 m/N"),
    "_m_s": Bounds(1e-9, 1e3, "velocities end at 1000 m/s"),
    "_N_s": Bounds(1e-9, 1e3, "drifts of a force end at 1 kN/s"),
    "_per_s": Bounds(1e-6, 1e6, "rates end at one in a microsecond"),
    "_mm2": Bounds(1e-6, 1e8, "areas lie between (1 micrometre)^2 and (10 m)^2"),
    "_mm": Bounds(1e-3, 1e4, "lengths lie between 1 micrometre and 10 m"),
    "_us": Bounds(1e-6, 1e6, "steps lie between 1 picosecond and 1 second"),
    "_ms": Bounds(1e-3, 3.6e6, "times in ms lie between 1 microsecond and 1 hour"),
    "_s": Bounds(1e-6, 1e7, "times in s lie between 1 microsecond and four months"),
    "_N": Bounds(1e-9, 1e3, "forces end at 1 kN"),
    "_Pa": Bounds(1e-2, 1e9, "moduli and stresses lie between 0.01 Pa, softer than any gel, and 1 GPa, stiffer than tendon"),
    "_g": Bounds(1e-6, 1e6, "masses lie between 1 microgram and 1 tonne"),
    "_deg": Bounds(1e-6, 360.0, "angles end at a full turn"),
    "_ratio": Bounds(1e-4, 1e4, "ratios of stiffness lie between 1 : 10 000 and 10 000 : 1"),
    "": Bounds(1e-9, 1e12, "the allowed range is 1e-9 to 1e12"),
}


def bounds_of(key: str) -> Bounds:
    """Of the numbers that stand under a key."""
    return next(bounds for unit, bounds in BOUNDS.items() if key.endswith(unit))


def check_bounds(key: str, value: object, metadata: Iterable[object]) -> None:
    """Refuse a value, or a list with an entry, out of the bounds of its key; ``metadata`` of the field says if it is above 0.

    Raises
    ------
    PydanticCustomError : of the type "out_of_bounds", with the number and its place in the list.
    """
    if isinstance(value, float | int | list | tuple):
        bounds = bounds_of(key)
        smallest = max([SMALLEST_MAGNITUDE, *(bounds.smallest for rule in metadata if isinstance(rule, Gt) and rule.gt == 0.0)])
        for number, place in _numbers(value, ()):
            size = abs(number)
            if size > bounds.largest or 0.0 < size < smallest:
                raise PydanticCustomError(
                    "out_of_bounds", "{reason}", {"reason": bounds.reason, "number": number, "place": place}
                )


def check_fields(value: object) -> object:
    """The same for all numbers of a law or an effect, whose classes bound only what their mechanics needs."""
    if isinstance(value, BaseModel):
        for key, field in type(value).model_fields.items():
            try:
                check_bounds(key, getattr(value, key), field.metadata)
            except PydanticCustomError as error:
                raise PydanticCustomError("out_of_bounds", "{reason}", {**(error.context or {}), "key": key}) from None
    return value


def _numbers(value: object, place: tuple[int, ...]) -> Iterator[tuple[float, tuple[int, ...]]]:
    if isinstance(value, list | tuple):
        for number, entry in enumerate(value):
            yield from _numbers(entry, (*place, number))
    elif isinstance(value, float | int) and not isinstance(value, bool) and math.isfinite(value):
        yield value, place


def with_bounds(schema: dict[str, object]) -> dict[str, object]:
    """A JSON schema of tables in which every number has the bounds of its key, and its description the reason."""
    bounded = json.loads(json.dumps(schema))
    waiting = [bounded]
    while waiting:
        part = waiting.pop()
        if isinstance(part, list):
            waiting += part
        elif isinstance(part, dict):
            properties = part.get("properties")
            for key, inner in (properties if isinstance(properties, dict) else {}).items():
                if _bound(inner, bounds_of(key)):
                    reason = bounds_of(key).reason
                    inner["description"] = f"{inner['description']} ({reason})" if "description" in inner else reason
            waiting += part.values()
    return bounded


def _bound(part: object, bounds: Bounds) -> bool:
    """Put bounds on the numbers of a part of a schema; whether there are any."""
    if isinstance(part, list):
        return any([_bound(inner, bounds) for inner in part])
    if not isinstance(part, dict):
        return False
    if part.get("type") in ("number", "integer"):
        whole = int if part["type"] == "integer" else float
        if part.get("exclusiveMinimum") == 0:
            del part["exclusiveMinimum"]
            part["minimum"] = whole(math.ceil(bounds.smallest)) if whole is int else bounds.smallest
        elif "minimum" not in part and "exclusiveMinimum" not in part:
            part["minimum"] = whole(-bounds.largest)
        if "maximum" not in part and "exclusiveMaximum" not in part:
            part["maximum"] = whole(bounds.largest)
            return True
        return False
    return any([_bound(part.get(name), bounds) for name in ("anyOf", "items", "prefixItems", "oneOf")])
