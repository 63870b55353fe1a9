"""Measured quantities, their units, and common names of their columns."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

Quantity = Literal["time", "displacement", "force", "stretch", "stress", "shear-strain", "shear-stress"]


@dataclass(frozen=True)
class Measured:
    """Units and names of a quantity.

    Attributes
    ----------
    units : unit -> factor to the unit of a dataset, which comes first.
    names : parts of column names, in English, German, French, Spanish and Italian.
    column : name in a CSV of a dataset.
    """

    units: dict[str, float]
    names: re.Pattern[str]
    column: str


def _words(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern, re.IGNORECASE)


_POUND_FORCE_N, _GRAM_FORCE_N, _PSI_PA = 4.4482216152605, 9.80665e-3, 6894.757293168
_TIMES = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "min": 60.0, "h": 3600.0}
_LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1e3, "µm": 1e-3, "nm": 1e-6, "in": 25.4, "mil": 0.0254}
_FORCES = {"N": 1.0, "mN": 1e-3, "µN": 1e-6, "nN": 1e-9, "kN": 1e3, "gf": _GRAM_FORCE_N, "kgf": 1e3 * _GRAM_FORCE_N}
_FORCES |= {"cN": 1e-2, "daN": 10.0, "lbf": _POUND_FORCE_N, "ozf": _POUND_FORCE_N / 16.0, "dyn": 1e-5}
_STRESSES = {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "psi": _PSI_PA, "bar": 1e5, "mbar": 1e2}
_STRESSES |= {"N/mm2": 1e6, "N/m2": 1.0, "N/cm2": 1e4, "mN/mm2": 1e3, "kN/m2": 1e3, "kgf/cm2": 1e7 * _GRAM_FORCE_N}
_STRESSES |= {
    "kgf/mm2": 1e9 * _GRAM_FORCE_N,
    "gf/mm2": 1e6 * _GRAM_FORCE_N,
    "mmHg": 133.322387415,
    "dyn/cm2": 0.1,
    "ksi": 1e3 * _PSI_PA,
}
_SHARES = {"1": 1.0, "%": 0.01, "‰": 1e-3, "µε": 1e-6}

QUANTITIES: dict[Quantity, Measured] = {
    "time": Measured(_TIMES, _words(r"^t$|time|zeit|temps|tiempo|tempo|sec|clock"), "time_s"),
    "displacement": Measured(
        _LENGTHS,
        _words(
            r"disp|depl|despl|sposta|exten|crosshead|traverse|weg$|^weg|compression|indent|depth|stroke|travel|position|^z$|^u$"
        ),
        "displacement_mm",
    ),
    "force": Measured(_FORCES, _words(r"force|kraft|load|last$|carico|fuerza|carga|^fz?$"), "force_N"),
    "stretch": Measured(_SHARES, _words(r"stretch|strain|dehnung|stauchung|lambda|deformation"), "stretch"),
    "stress": Measured(_STRESSES, _words(r"stress|spannung|contrainte|sforzo|tension|sigma"), "nominal_stress_Pa"),
    "shear-strain": Measured(_SHARES, _words(r"shear.?strain|gamma|scherung|strain"), "shear_strain"),
    "shear-stress": Measured(_STRESSES, _words(r"shear.?stress|tau|schub|stress"), "shear_stress_Pa"),
}
# Other ways to write a unit, after :func:`_plain_unit`.
_SPELLINGS = {
    "sec": "s", "secs": "s", "sek": "s", "second": "s", "seconds": "s", "sekunden": "s", "msec": "ms", "usec": "µs",
    "minute": "min", "minutes": "min", "hr": "h", "hour": "h", "hours": "h", "newton": "N", "newtons": "N", "millinewton": "mN",
    "micron": "µm", "microns": "µm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "meter": "m", "metre": "m",
    "inch": "in", "inches": "in", "mils": "mil", "gram": "gf", "g": "gf", "kg": "kgf", "kp": "kgf", "lb": "lbf", "lbs": "lbf",
    "oz": "ozf", "kg/cm2": "kgf/cm2", "kg/mm2": "kgf/mm2", "g/mm2": "gf/mm2", "lbf/in2": "psi", "lb/in2": "psi",
    "percent": "%", "pct": "%", "mm/mm": "1", "m/m": "1", "in/in": "1", "-": "1", "none": "1", "permille": "‰",
    "ustrain": "µε", "microstrain": "µε", "µm/m": "µε", "mm/m": "‰",
    '"': "in", "\u2032\u2032": "in", "meters": "m", "centimeters": "cm",
}  # fmt: skip


def _plain_unit(word: str) -> str:
    """A unit in one spelling: "N·mm⁻²", "N mm^-2" and "N/mm²" are "N/mm2"; "uN" is "µN"."""
    plain = unicodedata.normalize("NFKC", word.strip()).replace("μ", "µ").replace("\u2212", "-")
    plain = re.sub(r"[\s·⋅*^'’.]+", "", plain)
    plain = re.sub(r"^(.+?)([a-z]+)-(\d)$", r"\1/\2\3", plain) if "/" not in plain else plain
    return re.sub(r"^u(?=[mNs]$)", "µ", plain).replace("/µm2", "/um2")


def unit_of(quantity: Quantity, word: str) -> str | None:
    """Return the unit that a word denotes, in the spelling of QUANTITIES; None if it is no unit of the quantity."""
    units = QUANTITIES[quantity].units
    if word.strip() in units:
        return word.strip()
    if not word.strip():
        return None
    plain = _plain_unit(word)
    for candidate in (plain, _SPELLINGS.get(plain.lower(), plain)):
        if candidate in units:
            return candidate
    by_lower = {unit.lower(): unit for unit in units}
    # "MPA" and "n" are unambiguous, but mN and MN differ.
    return by_lower.get(plain.lower()) if plain.lower() not in ("mn", "nm") else None


def is_unit(word: str) -> bool:
    """Whether a word is a unit of any quantity."""
    return any(unit_of(quantity, word) is not None for quantity in QUANTITIES)


def is_name(word: str, quantity: Quantity | None = None) -> bool:
    """Whether a word is a usual name of a column of a quantity, or of any."""
    kinds = QUANTITIES.values() if quantity is None else [QUANTITIES[quantity]]
    return any(kind.names.search(word) is not None for kind in kinds)


@dataclass(frozen=True)
class Measure:
    """A measure of strain or stress other than the stretch and the nominal stress of a dataset.

    Attributes
    ----------
    title : its name in a sentence.
    convert : values (k,) and, for a stress, the stretches (k,) -> stretch, or nominal stress [the unit of the values].
    formula : of the conversion.
    """

    title: str
    words: re.Pattern[str]
    convert: Callable[[np.ndarray, np.ndarray], np.ndarray]
    formula: str


# A name has the words of a measure: "True strain", "Hencky strain", "Cauchy stress". The stresses are of an incompressible body.
_TRUE = r"\btrue\b|wahre|\bvrai|\bvero?\b|verdader"
MEASURES: dict[Literal["stretch", "stress"], tuple[Measure, ...]] = {
    "stretch": (
        Measure("logarithmic strain", _words(rf"{_TRUE}|\blog|hencky|\bln\b|natural"), lambda e, _: np.exp(e), "exp(strain)"),
        Measure("Green-Lagrange strain", _words(r"green|lagrang"), lambda e, _: np.sqrt(1.0 + 2.0 * e), "sqrt(1 + 2 strain)"),
        Measure("Almansi strain", _words(r"almansi|euler"), lambda e, _: 1.0 / np.sqrt(1.0 - 2.0 * e), "1 / sqrt(1 - 2 strain)"),
    ),
    "stress": (
        Measure("Cauchy stress", _words(rf"{_TRUE}|cauchy|^(?!.*piola).*kirchhoff"), lambda s, x: s / x, "stress / stretch"),
        Measure("second Piola stress", _words(r"(second|2nd|ii\b).*piola|\bs?pk\s?2\b"), lambda s, x: s * x, "stress * stretch"),
    ),
}  # fmt: skip


def measure_of(quantity: Quantity, name: str) -> Measure | None:
    """Return the measure that a column's name states; None for stretch, engineering strain and nominal stress."""
    measures = MEASURES["stretch"] if quantity == "stretch" else MEASURES["stress"] if quantity == "stress" else ()
    return next((measure for measure in measures if measure.words.search(name)), None)


def is_measure(word: str) -> bool:
    """Whether a word in brackets states a measure, as in "Strain (true)", and is no unit."""
    return bool(re.search(r"engineering|nominal|^eng\.?$", word, re.IGNORECASE)) or any(
        measure.words.search(word) for kind in MEASURES.values() for measure in kind
    )
