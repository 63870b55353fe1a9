"""Numbers, names and the verdict of a report in words."""

from __future__ import annotations

import math
import re
from typing import TypeGuard

import numpy as np

from explicitfe.results.documents.loop_report import Estimate, LoopReport, NextExperiment, Parameters, estimates
from explicitfe.results.documents.units_of_keys import words_and_unit
from explicitfe.results.documents.verdict_text import JOINED_BY, effect_title, joined, probability, set_in_words
from explicitfe.results.measure.document import Reaction

DASH = "–"
NO_BREAK = "\u00a0"
VERDICTS = {
    "failed": "the fit failed",
    "no-missing-effect": "no missing effect",
    "limited-by-numerics": "limited by the discretization error",
    "unexplained": "unexplained",
    "ambiguous": "ambiguous",
    "effect-found": "found",
}
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Below this p-value only its smallness is said: no data tell one smaller chance from another.
SMALLEST_SAID_P = 1e-4
# Speeds below this have two significant digits, mm/s.
WHOLE_SPEED_MM_S = 10.0
# Below this share, 0.01 %, only its smallness is said.
SMALLEST_SAID_SHARE = 1e-4


def finite(value: object) -> TypeGuard[float]:
    """Whether there is a number, and not NaN nor infinity."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def number(value: object, digits: int = 3) -> str:
    """A number rounded to some digits, as a power of ten only where that is shorter; a dash where there is none."""
    if not finite(value):
        return DASH
    value = float(f"{value:.{digits - 1}e}")
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -4 < exponent < 6:
        return f"{value / 10.0**exponent:.{digits - 1}f}·10{str(exponent).translate(SUPERSCRIPTS)}"
    return f"{value:,.{max(digits - 1 - exponent, 0)}f}".replace(",", NO_BREAK)


def bare(value: object) -> str:
    """A number rounded to three digits, without zeros at the end."""
    text = number(value)
    return text.rstrip("0").rstrip(".") if "." in text and "·" not in text else text


def count(value: object) -> str:
    """A number of data: whole from ten on."""
    if finite(value) and (value >= 10.0 or value == int(value)):
        return f"{value:,.0f}".replace(",", NO_BREAK)
    return number(value, 2)


def plural(how_many: int, noun: str) -> str:
    """Such as "1 curve" and "2 curves"."""
    return f"{how_many} {noun}{'' if how_many == 1 else 's'}"


def speed(mm_s: float) -> str:
    """A speed in mm/s without its unit: whole from 10 mm/s on, and with two digits below, so that 0 means no motion at all."""
    return f"{mm_s:.0f}" if mm_s >= WHOLE_SPEED_MM_S else number(mm_s, 2)


def steps_in_words(steps: int, shortest_s: float) -> str:
    """Such as "10 407 steps of 18.4 µs or more"."""
    return f"{steps:,} steps of {1e6 * shortest_s:.3g} µs or more".replace(",", NO_BREAK)


def motion_at_end(settled: bool, fastest_mm_s: float) -> str:
    """Whether a body moves at the end of a run, with the speed of its fastest node."""
    if settled and fastest_mm_s == 0.0:
        return "at rest"
    return f"{'settled' if settled else 'still moving'}, fastest node {speed(fastest_mm_s)} mm/s"


def paragraphs(text: str) -> list[str]:
    """The paragraphs of a text, which empty lines separate, each on one line: the page breaks lines where it needs to."""
    return [" ".join(part.split()) for part in re.split(r"\n\s*\n", text) if part.strip()]


def percent(share: object) -> str:
    """A share of one in per cent, to two digits."""
    if not finite(share):
        return DASH
    return f"< 0.01{NO_BREAK}%" if 0.0 <= share < SMALLEST_SAID_SHARE else f"{number(100.0 * share, 2)}{NO_BREAK}%"


def chance(p: object, is_bound: bool | None = False, equals: str = "") -> str:
    """A p-value; ``equals`` stands before it where it is no bound.

    Parameters
    ----------
    is_bound : p is an upper bound, such as the least that a bootstrap can give; it is rounded up.
    """
    if not finite(p):
        return number(p)
    if p < SMALLEST_SAID_P:
        return f"< {SMALLEST_SAID_P:.4f}"
    if is_bound and p < 1.0:
        places = 1 - math.floor(math.log10(p))
        return f"< {math.ceil(round(p * 10.0**places, 6)) / 10.0**places:.{places}f}"
    return equals + number(p, 2)


def with_interval(estimate: Estimate | None) -> str:
    """A value and its 95 % interval, rounded to two digits of the interval's width."""
    if estimate is None or not finite(estimate.value):
        return DASH
    if len(estimate.ci95) != 2 or not all(map(finite, estimate.ci95)):
        return number(estimate.value)
    low, high = estimate.ci95
    width = high - low
    if 1e-4 < width < 1e6:
        places = 1 - math.floor(math.log10(width))
        shown = [f"{round(x, places):,.{max(places, 0)}f}".replace(",", NO_BREAK) for x in (estimate.value, low, high)]
    else:
        shown = [number(x) for x in (estimate.value, low, high)]
    return f"{shown[0]} ({shown[1]} to {shown[2]})"


def name_and_unit(report: LoopReport, key: str) -> tuple[str, str]:
    """``viscoelastic.tau_s`` in words and its unit: "viscoelastic relaxation: tau" and "s"."""
    owner, _, name = key.rpartition(".")
    words, unit = words_and_unit(name)
    return f"{effect_title(report, owner)}: {words}" if owner else words, unit


def quantity(report: LoopReport, key: str) -> str:
    """A key in words, with its unit in brackets."""
    words, unit = name_and_unit(report, key)
    return f"{words} ({unit})" if unit else words


def values_in_words(report: LoopReport, parameters: Parameters) -> str:
    """All values of some parameters in one line."""
    parts = []
    for (key, group), estimate in estimates(parameters).items():
        words, unit = name_and_unit(report, key)
        parts.append(f"{words}{f' of {group}' if group else ''} {bare(estimate.value)} {unit}".rstrip())
    return "; ".join(parts)


def sentence(text: str | None) -> str:
    """A text with a capital at its start and a full stop at its end."""
    text = (text or "").strip()
    return f"{text[0].upper()}{text[1:].rstrip('.')}." if text else ""


def shortened(name: object, most: int) -> str:
    """A name with at most so many letters; what is left out in the middle is an ellipsis."""
    name = str(name)
    return name if len(name) <= most else f"{name[: most // 2]}…{name[-(most - most // 2 - 1) :]}"


def baseline_name(report: LoopReport) -> str:
    """What the baseline is: the law of a specimen, or the scenario of sensors that moved."""
    return "elastic model" if "C10_Pa" in report.baseline.parameters else "model as it was"


def model_names(report: LoopReport) -> tuple[str, str]:
    """What the model is before and after."""
    effects = [effect_title(report, name) for name in report.effects or report.nearest]
    return baseline_name(report), f"with {joined(effects)}" if effects else "with the best candidate"


def how_sure(report: LoopReport, most: int = 4) -> str:
    """Probabilities of sets of causes, which an ambiguous verdict has already, and how many hypotheses were compared."""
    shown = [] if report.verdict == "ambiguous" else list(report.posterior.items())[:most]
    sets = ", ".join(f"{set_in_words(report, name)} {probability(p)}" for name, p in shown)
    compared = f"{report.compared} hypotheses were compared, {report.fitted or 0} of them fitted." if report.compared else ""
    return " ".join(filter(None, (f"Most probable sets of causes: {sets}." if sets else "", compared)))


def smooth_part(report: LoopReport) -> str:
    """The discrepancy: how large the smooth part of the residual is, and whether noise alone explains it; "" if not known."""
    lack, test = report.lack_of_fit, ""
    if lack and finite(lack.chi2) and lack.free:
        test = f" (χ² = {number(lack.chi2)} for {plural(lack.free, 'function')}, p {chance(lack.p, equals='= ')})"
    if not finite(report.discrepancy):
        return f"Test of the residual for a smooth misfit{test}." if test else ""
    if report.discrepancy == 0.0:
        return f"No smooth misfit remains after the fit{test}."
    return f"The smooth misfit that remains after the fit is {number(report.discrepancy, 2)} times the noise{test}."


def worth_of(test: NextExperiment, report: LoopReport | None = None) -> str:
    """What a proposed test distinguishes, its expected information gain and its duration; ``report`` has names in words."""
    sets = [set(name.split(JOINED_BY)) for name in test.separates]
    words = [set_in_words(report or LoopReport(), name).replace(" and ", " plus ") for name in test.separates]
    names = [f'"{text}{" alone" if any(own < other for other in sets) else ""}"' for text, own in zip(words, sets, strict=True)]
    pair = f"separates {' from '.join(names)}" if names else ""
    sds = f" (by {number(math.sqrt(test.separation), 2)} standard deviations)" if pair and finite(test.separation) else ""
    parts = [pair + sds]
    if finite(test.information_bits) and finite(test.minutes):
        parts.append(f"expected information gain: {test.information_bits:.2g} bits; duration: about {test.minutes:.2g} min")
    return "; ".join(filter(None, parts))


def reaction_in_words(reaction: Reaction) -> str:
    """Such as "0.505 N (x -0.505, y 0, z 0); moved by 8.00 mm"."""
    parts = [value if abs(value) > 1e-9 * reaction.magnitude_N else 0.0 for value in reaction.force_N]
    axes = ", ".join(f"{axis} {number(part)}" for axis, part in zip("xyz", parts, strict=True))
    moved_mm = float(np.linalg.norm(reaction.displacement_mm or 0.0))
    return f"{number(reaction.magnitude_N)} N ({axes}){f'; moved by {moved_mm:.2f} mm' if moved_mm else ''}"
