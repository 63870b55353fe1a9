"""The unit at the end of a key, such as C10_Pa or compliance_mm_kPa, as people write it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

# A compound unit comes before the unit that it ends with.
_UNITS = {
    "kg_m3": "kg/m³",
    "m_s2": "m/s²",
    "mm_kPa": "mm/kPa",
    "mm_N": "mm/N",
    "mm_s": "mm/s",
    "mm2": "mm²",
    "N_s": "N/s",
    "kPa": "kPa",
    "Pa": "Pa",
    "mN": "mN",
    "N": "N",
    "mm": "mm",
    "m": "m",
    "ms": "ms",
    "s": "s",
    "rad": "rad",
    "deg": "°",
    "hz": "Hz",
    "percent": "%",
}
_AT_THE_END = re.compile(rf"_(?:(?P<unit>{'|'.join(_UNITS)})|(?:(?P<over>[A-Za-z]+)_)?per_(?P<under>[A-Za-z0-9]+))$")


def words_and_unit(key: str) -> tuple[str, str]:
    """``tau_s`` as "tau" and "s", ``rate_N_s`` as "rate" and "N/s", ``k_per_s`` as "k" and "1/s"; a unit of "" is none."""
    match = _AT_THE_END.search(key)
    if match is None:
        return key.replace("_", " "), ""
    unit = _UNITS[match["unit"]] if match["unit"] else f"{match['over'] or 1}/{match['under']}"
    return key[: match.start()].replace("_", " "), unit


def terms_of(constants: Mapping[str, Any]) -> list[str]:
    """Keys of a table of constants to be shown: a term whose constant [Pa] is zero, such as C30_Pa, is omitted."""
    return [key for key, value in constants.items() if value != 0.0 or not key.endswith("_Pa")]
