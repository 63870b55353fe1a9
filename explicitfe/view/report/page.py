"""The report of a closed loop: one page that a person understands in a minute, with its figures as PNG files beside it.

From plain dicts: what ``report.json`` holds, and the curves in the units of their axes. Any key may be missing or null, any
number not finite: then a dash stands there, or nothing. The page needs neither network nor script.
"""

from __future__ import annotations

import json
import math
import re
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.view.fit import COLOURS, GRID

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = "report.html"
DPI = 180
BEFORE, AFTER, LIGHT, GREY = COLOURS[1], COLOURS[0], COLOURS[5], "0.6"
SHORT_RAMP = 0.15  # share of the time: a shorter loading is stretched
STRETCHED = 0.36  # share of the width that a short loading gets
SHOWN = 4  # curves of the first picture
FEW = 30  # rows: drawn as larger dots
FACTS = 8  # lines beside it
MANY = 200  # rows: the residual of a longer curve is drawn as its running mean, every row faint behind it
SEPARABLE = 25.0
DASH = "–"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
UNIT = re.compile(r"_(kg_m3|(?:\w+_)?per_\w+|k?Pa|m?N|mm|m|s|ms|deg)$")
STATUS = {
    "significant": "significant",
    "not-significant": "not significant",
    "not-testable": "not testable",
    "failed": "its fit failed",
}
VERDICTS = {
    "failed": "the fit failed",
    "no-missing-effect": "nothing missing",
    "unexplained": "unexplained",
    "ambiguous": "ambiguous",
    "effect-found": "found",
}
LEFT = {
    "at-floor": "What is left is at the floor: noise and numerics explain it.",
    "unexplained": "What is left is not explained.",
    "ambiguous": "What is left is ambiguous: two effects may be at work and one was found.",
}
STYLE = """
:root { color-scheme: light; --before: #D55E00; --after: #0072B2; --ink: #1b1b1b; --soft: #5c5c5c; --line: #dcdcdc; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); font: 15px/1.45 "Helvetica Neue", Helvetica, Arial, "Liberation Sans",
  sans-serif; font-variant-numeric: tabular-nums; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
main { max-width: 1190px; margin: 0 auto; padding: 20px 24px 60px; }
p { margin: 0 0 6px; max-width: 88ch; }
.eyebrow { color: var(--soft); font-size: 13px; margin-bottom: 2px; max-width: none; }
h1 { font-size: 34px; line-height: 1.15; letter-spacing: -0.01em; font-weight: 700; margin: 0 0 8px; text-wrap: balance; }
h1.long { font-size: 27px; }
.lede { font-size: 17px; margin-bottom: 4px; max-width: 120ch; }
.left { color: var(--soft); margin: 0; max-width: 130ch; }
.screen { display: flex; flex-direction: column; min-height: min(100vh - 24px, 780px); }
.first { flex: 1; display: grid; grid-template-columns: 300px minmax(0, 1fr); gap: 32px; margin-top: 14px; }
.score { border-top: 3px solid var(--ink); padding-top: 10px; }
.score h2 { font-size: 16px; margin: 0; }
.note, figcaption { color: var(--soft); font-size: 13px; }
.numbers { display: flex; gap: 28px; margin: 14px 0 8px; }
.numbers b { display: block; font-size: 42px; line-height: 1.05; font-weight: 700; white-space: nowrap; }
.numbers span { display: block; font-size: 13px; line-height: 1.25; color: var(--soft); margin-top: 3px; }
.before b { color: var(--before); } .after b { color: var(--after); }
.bars { position: relative; margin: 0 0 10px; padding: 3px 0; }
.bars i { display: block; height: 9px; margin: 3px 0; min-width: 1px; }
.bars .b, td .b { background: var(--before); }
.bars .a, td .a { background: var(--after); }
.bars u, td u { position: absolute; top: 0; bottom: 0; width: 0; border-left: 2px solid var(--ink); }
.facts { margin: 12px 0 0; padding: 10px 0 0; border-top: 1px solid var(--line); list-style: none; font-size: 14px; }
.facts li { margin-bottom: 5px; }
figure { margin: 0; break-inside: avoid; } figure img { max-width: 100%; height: auto; display: block; }
section { border-top: 1px solid var(--line); margin-top: 30px; padding-top: 16px; }
section h2 { font-size: 21px; margin: 0 0 6px; } section h3 { font-size: 16px; margin: 20px 0 4px; }
section figure { margin: 10px 0; }
table { border-collapse: collapse; font-size: 14px; margin: 8px 0 12px; }
th { text-align: left; font-weight: 600; color: var(--soft); font-size: 13px; border-bottom: 1px solid #999;
  vertical-align: bottom; }
th, td { padding: 4px 18px 4px 0; } td { border-bottom: 1px solid #ececec; vertical-align: top; }
th.n, td.n { text-align: right; } td.n { white-space: nowrap; }
td.why { color: var(--soft); max-width: 52ch; overflow-wrap: anywhere; }
tr { break-inside: avoid; } tr.chosen td { font-weight: 700; color: var(--after); } tr.chosen td.why { font-weight: 400; }
td.bar { min-width: 170px; } td .track { position: relative; height: 15px; margin-top: 3px; }
td .track i { position: absolute; left: 0; height: 6px; min-width: 1px; } td .track .a { top: 8px; } td .track .b { top: 1px; }
ul { margin: 4px 0; padding-left: 20px; }
a { color: inherit; }
.provenance { font-size: 12px; color: var(--soft); } .provenance table { font-size: 12px; }
.provenance td { overflow-wrap: anywhere; }
.first figure { position: relative; min-height: 380px; }
.first img { position: absolute; width: 100% !important; height: 100%; object-fit: contain; object-position: left top; }
@media (max-width: 900px), print { .screen { min-height: 0; } .first figure { min-height: 0; }
  .first img { position: static; height: auto; } }
@media screen and (max-width: 900px) { .first { grid-template-columns: 1fr; } }
@media print { .first { grid-template-columns: 185px minmax(0, 1fr); gap: 14px; } .numbers { gap: 14px; }
  .numbers b { font-size: 26px; } .facts { font-size: 8.5pt; }
  body { font-size: 10pt; } main { padding: 0; max-width: none; } h1 { font-size: 22pt; } .lede { font-size: 11pt; }
  section { margin-top: 16px; } h2, h3 { break-after: avoid; } table { font-size: 8.5pt; } th, td { padding-right: 10px; } }
@page { margin: 14mm; }
"""


class Html(str):
    """Text that is markup already; every other string is escaped where it enters the page."""

    __slots__ = ()


def write(folder: Path, report: Mapping[str, Any], curves: Sequence[Mapping[str, Any]]) -> list[str]:
    """Write the page and its figures into ``folder``, and return the names of the files.

    Parameters
    ----------
    report : as in report.json; ``nrmse``, ``floor``, ``cv_nrmse``, ``error_fit``, ``scale_sd`` and ``share_of_noise`` are
        fractions, ``rmse``, ``sd`` and ``offset_sd`` in ``unit``. A parameter is {"value", "ci95"}, or such a one for each group.
    curves : each with id, split, x_label, y_label, time_s, x (what is imposed), measured, before, after, sd, in the axes' units.
    """
    from matplotlib import rc_context

    curves = _in_order(curves)
    with rc_context({"text.parse_math": False}):  # a dollar in a name is a dollar
        figures = {
            "before-after.png": _before_after(report, curves),
            "residuals.png": _residuals(report, curves),
            "ranking.png": _ranking(report),
        }
        if _assumed(report):
            figures["sensitivity.png"] = _sensitivity(report)
        for name, figure in figures.items():
            figure.savefig(folder / name, dpi=DPI)
    pictures = {name: _image((folder / name).read_bytes(), figure.get_figwidth()) for name, figure in figures.items()}
    (folder / PAGE).write_text(_page(report, curves, pictures), encoding="utf-8")
    return [PAGE, *figures]


def headline(report: Mapping[str, Any]) -> str:
    """The verdict in a few plain words."""
    effects, rivals, sure = _effects(report)
    match report.get("verdict"):
        case "failed":
            return "The fit failed: nothing can be said about the model"
        case "no-missing-effect":
            return "Nothing is missing that these data can show"
        case "unexplained":
            return "Something is missing, and none of the known effects explains it"
        case "effect-found" if effects:
            return f"Missing: {_joined(effects)}"
        case "ambiguous" if not rivals:
            return "These data cannot tell what is missing"
        case "ambiguous" if sure:
            return f"Missing: {_joined(sure)}; then {_joined(rivals, 'or')}, these data cannot tell which"
        case "ambiguous" if len(rivals) == 1:
            return f"Perhaps missing: {rivals[0]}; these data cannot confirm it"
        case "ambiguous" if len(rivals) == 2:
            return f"These data cannot tell {rivals[0]} from {rivals[1]}"
        case "ambiguous":
            return f"These data cannot tell apart {_joined(rivals)}"
    return f"Verdict: {report.get('verdict') or 'none'}"


# ---- reading what may be missing ----


def _at(value: Any, *keys: str) -> Any:
    """Down a tree of mappings; None where a branch is missing."""
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def _list(value: Any, *keys: str) -> list[Any]:
    found = _at(value, *keys)
    return list(found) if isinstance(found, Iterable) and not isinstance(found, str | Mapping) else []


def _table_of(value: Any, *keys: str) -> dict[str, Any]:
    found = _at(value, *keys)
    return dict(found) if isinstance(found, Mapping) else {}


def _finite(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)


def _column(curve: Mapping[str, Any], key: str) -> np.ndarray | None:
    """A column of a curve (n,), NaN where a number is missing; None where all are."""
    values = np.asarray([] if curve.get(key) is None else curve[key], dtype=float)
    return values if np.isfinite(values).any() else None


def _title(report: Mapping[str, Any], effect: str | None) -> str:
    """The name of an effect in words."""
    return _at(report, "effect_titles", effect) or str(effect or "").replace("-", " ")


def _effects(report: Mapping[str, Any]) -> tuple[list[str], list[str], list[str]]:
    """Titles of the effects in the final model, of those among which it cannot be chosen, and of those beyond doubt."""
    names = _list(report, "effects")
    rivals = list(dict.fromkeys([*names[-1:], *_list(report, "ambiguous_with")]))
    sure = [name for name in names if name not in rivals]
    return tuple([_title(report, name) for name in group] for group in (names, rivals, sure))  # type: ignore[return-value]


def _changed(report: Mapping[str, Any]) -> bool:
    """Whether a model with more in it than the baseline was fitted."""
    errors = [[_at(report, stage, "error", side, "nrmse") for side in ("fit", "holdout")] for stage in ("baseline", "final")]
    return any(map(_finite, errors[1])) and errors[0] != errors[1]


def _labels(report: Mapping[str, Any]) -> tuple[str, str]:
    """What the model is before and after."""
    effects = _effects(report)[0]
    return _base(report), f"with {_joined(effects)}" if effects else "with the best candidate"


def _base(report: Mapping[str, Any]) -> str:
    """What the baseline is: the law of a specimen, or the scenario of sensors that moved."""
    return "elastic model" if "C10_Pa" in (_at(report, "baseline", "parameters") or {}) else "model as it was"


def _parameters(parameters: Mapping[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """(parameter, group) -> {"value", "ci95"}; the group is "" where there is but one value."""
    found = {}
    for name, entry in parameters.items():
        grouped = isinstance(entry, Mapping) and "value" not in entry
        for group, inner in entry.items() if grouped else [("", entry)]:
            found[name, str(group)] = dict(inner) if isinstance(inner, Mapping) else {"value": inner}
    return found


def _in_order(curves: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Held-out curves first, then those that tell most: where the models differ most, or else the misfit is largest."""

    def telling(curve: Mapping[str, Any]) -> tuple[bool, float]:
        measured, before, after = (_column(curve, key) for key in ("measured", "before", "after"))
        score = 0.0
        if measured is not None and before is not None:
            other = measured if after is None or np.allclose(after, before, equal_nan=True) else after
            score = float(np.nanmean((before - other) ** 2) / (np.nanmax(np.abs(measured)) ** 2 or 1.0))
        return curve.get("split") != "holdout", -score if math.isfinite(score) else 0.0

    return sorted((curve for curve in curves if _column(curve, "measured") is not None), key=telling)


def _assumed(report: Mapping[str, Any]) -> dict[str, list[Mapping[str, Any]]]:
    """Assumed quantity -> its rows, where there are any."""
    tables = _table_of(report, "sensitivity_to_assumed")
    found = {key: [row for row in rows or [] if isinstance(row, Mapping)] for key, rows in tables.items()}
    return {key: rows for key, rows in found.items() if rows}


# ---- words and numbers ----


def _number(value: Any, digits: int = 3) -> str:
    """Rounded to some digits; a power of ten only where it is shorter."""
    if not _finite(value):
        return DASH
    value = float(f"{value:.{digits - 1}e}")
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -4 < exponent < 6:
        return f"{value / 10.0**exponent:.{max(digits - 2, 0)}f}·10{str(exponent).translate(SUPERSCRIPTS)}"
    return f"{value:,.{max(digits - 1 - exponent, 0)}f}".replace(",", "\u00a0")


def _bare(value: Any) -> str:
    """Rounded, without zeros at the end."""
    said = _number(value)
    return said.rstrip("0").rstrip(".") if "." in said and "·" not in said else said


def _count(value: Any) -> str:
    """A number of data, whole from ten on."""
    whole = _finite(value) and (value >= 10.0 or value == int(value))
    return f"{value:,.0f}".replace(",", "\u00a0") if whole else _number(value, 2)


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _percent(fraction: Any) -> str:
    """A fraction in per cent, to two digits."""
    if not _finite(fraction):
        return DASH
    return "< 0.01\u00a0%" if 0.0 <= fraction < 1e-4 else f"{_number(100.0 * fraction, 2)}\u00a0%"


def _chance(p: Any, equals: str = "") -> str:
    return "< 0.0001" if _finite(p) and p < 1e-4 else equals + _number(p, 2)


def _with_interval(entry: Mapping[str, Any] | None) -> str:
    """A value and its 95 % interval, rounded to two digits of the interval's width."""
    value, ends = _at(entry, "value"), _list(entry, "ci95")
    if isinstance(value, list | tuple):
        pairs = [*ends, *[None] * len(value)]
        return "; ".join(_with_interval({"value": v, "ci95": ends}) for v, ends in zip(value, pairs, strict=False))
    if not _finite(value):
        return DASH if value is None or isinstance(value, float) else str(value)
    if len(ends) != 2 or not all(map(_finite, ends)):
        return _number(value)
    width = ends[1] - ends[0]
    if 1e-4 < width < 1e6:
        places = 1 - math.floor(math.log10(width))
        shown = [f"{round(x, places):,.{max(places, 0)}f}".replace(",", "\u00a0") for x in (value, *ends)]
    else:
        shown = [_number(x) for x in (value, *ends)]
    return f"{shown[0]} ({shown[1]} to {shown[2]})"


def _named(report: Mapping[str, Any], name: str) -> tuple[str, str]:
    """'viscoelastic.tau_s' in words and its unit: 'viscoelastic relaxation: tau' and 's'."""
    owner, _, key = name.rpartition(".")
    unit = UNIT.search(key)
    words = (key[: unit.start()] if unit else key).replace("_", " ")
    measure = re.sub(r"^/", "1/", re.sub(r"_?per_", "/", unit[1])).replace("kg_m3", "kg/m³") if unit else ""
    return f"{_title(report, owner)}: {words}" if owner else words, measure


def _quantity(report: Mapping[str, Any], name: str) -> str:
    words, unit = _named(report, name)
    return f"{words} ({unit})" if unit else words


def _brief(report: Mapping[str, Any], parameters: Mapping[str, Any]) -> str:
    """All values of some parameters in one line."""
    parts = []
    for (name, group), entry in _parameters(parameters).items():
        value, (words, unit) = entry.get("value"), _named(report, name)
        shown = ", ".join(_bare(v) for v in value) if isinstance(value, list | tuple) else _bare(value)
        parts.append(f"{words}{f' of {group}' if group else ''} {shown} {unit}".rstrip())
    return "; ".join(parts)


def _sentence(text: Any) -> str:
    text = str(text or "").strip()
    return f"{text[0].upper()}{text[1:].rstrip('.')}." if text else ""


def _joined(names: Sequence[str], word: str = "and") -> str:
    return f"{', '.join(names[:-1])} {word} {names[-1]}" if len(names) > 1 else "".join(names)


def _short(name: Any, most: int) -> str:
    name = str(name)
    return name if len(name) <= most else f"{name[: most // 2]}…{name[-(most - most // 2 - 1) :]}"


# ---- the page ----


def tag(name: str, *inside: Any, **attributes: Any) -> Html:
    """An element; what is not markup is escaped, None and empty strings inside are left out."""
    text = "".join(part if isinstance(part, Html) else escape(str(part)) for part in inside if part not in (None, ""))
    marks = "".join(f' {key.rstrip("_")}="{escape(str(value))}"' for key, value in attributes.items() if value)
    return Html(f"<{name}{marks}>{text}</{name}>")


def _rows(head: Sequence[str], rows: Iterable[Sequence[Any]], kinds: str, chosen: Sequence[bool] = ()) -> Html:
    """A table; ``kinds`` has a letter a column: t text, n number, w words that explain, b bars. Columns without content go."""
    rows = [list(row) for row in rows]
    keep = [k for k in range(len(head)) if any(row[k] not in (None, "", DASH) for row in rows)]
    names = {"t": "", "n": "n", "w": "why", "b": "bar"}

    def line(cell: str, row: Sequence[Any]) -> Html:
        return Html("".join(tag(cell, row[k], class_=names[kinds[k]]) for k in keep))

    marks = [*chosen, *[False] * len(rows)]
    body = [tag("tr", line("td", row), class_="chosen" if mark else "") for row, mark in zip(rows, marks, strict=False)]
    return tag("table", tag("thead", tag("tr", line("th", head))), tag("tbody", *body)) if rows else Html("")


def _image(png: bytes, width_in: float) -> Html:
    return Html(f'<img alt="" style="width: {96 * width_in:.0f}px" src="data:image/png;base64,{b64encode(png).decode()}">')


def _picture(image: Html | None, words: str, caption: str = "") -> Html:
    """A figure with words for those who do not see it."""
    if image is None:
        return Html("")
    image = Html(image.replace('alt=""', f'alt="{escape(words)}"', 1))
    return tag("figure", image, tag("figcaption", caption) if caption else None)


def _section(title: str, *inside: Any, name: str = "", class_: str = "") -> Html:
    """A part of the page, or nothing where it would be empty."""
    return tag("section", tag("h2", title), *inside, id=name, class_=class_) if any(inside) else Html("")


def _page(report: Mapping[str, Any], curves: Sequence[Mapping[str, Any]], pictures: dict[str, Html]) -> str:
    body = tag(
        "main",
        _first(report, curves, pictures),
        _left(report, curves, pictures),
        _tried(report, pictures),
        _apart(report),
        _errors(report),
        _constants(report),
        _floors(report),
        _what_if(report, pictures),
        _split(report),
        _warnings(report),
        _provenance(report),
    )
    name = report.get("dataset") or report.get("title") or "closed loop"
    head = Html('<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">')
    head = tag("head", head, tag("title", f"{name}: {headline(report)}"), tag("style", Html(STYLE)))
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', body), lang='en')}\n"


def _first(report: Mapping[str, Any], curves: Sequence[Mapping[str, Any]], pictures: dict[str, Html]) -> Html:
    """What is seen without scrolling."""
    head = headline(report)
    names = [report.get("dataset"), report.get("title")]
    eyebrow = ": ".join(_short(name, 130) for name in names if name)
    following = _table_of(report, "next_experiment").get("protocol") if report.get("verdict") == "ambiguous" else None
    left = " ".join(filter(None, (LEFT.get(str(report.get("remainder"))), _sentence(report.get("remainder_where")))))
    before, after = _labels(report)
    words = f"Measured curves against the {before}" + (f" and the model {after}." if _changed(report) else ".")
    picture = _picture(pictures.get("before-after.png"), words) if curves else None
    return tag(
        "header",
        tag("p", eyebrow or "closed loop", class_="eyebrow"),
        tag("h1", head, class_="long" if len(head) > 62 else ""),
        tag("p", report["sentence"], class_="lede") if report.get("sentence") else None,
        tag("p", tag("b", "Measure next: "), _sentence(following), class_="lede") if following else None,
        tag("p", left, class_="left") if left else None,
        tag("div", _score(report), picture, class_="first"),
        class_="screen",
    )


def _score(report: Mapping[str, Any]) -> Html:
    """Error before and after, and the floor, on held-out curves where there are any."""
    held = _finite(_at(report, "baseline", "error", "holdout", "nrmse"))
    side = "holdout" if held else "fit"
    changed = _changed(report)
    stages = ("baseline", "final") if changed else ("baseline",)
    errors = [_at(report, stage, "error", side, "nrmse") for stage in stages]
    rmse = [_at(report, stage, "error", side, "rmse") for stage in stages]
    rows = {name: row for name, row in _table_of(report, "baseline", "error", "curves").items() if _at(row, "split") == side}
    floors = [row["floor"] for row in rows.values() if _finite(row.get("floor"))]
    floor = float(np.mean(floors)) if floors else None
    count = len(rows) or len(_list(report, "split", side))
    title = f"Error on {_plural(count, 'held-out curve' if held else 'fitted curve') if count else 'the curves'}"
    note = "whole curves that the fit did not see" if held else "no curve was held out: this shows the fit, not a prediction"
    labels = [f"before: {_labels(report)[0]}", f"after: {_labels(report)[1]}"] if changed else [_labels(report)[0]]
    numbers = [
        tag("div", tag("b", _percent(error)), tag("span", label), class_=kind)
        for error, label, kind in zip(errors, labels, ("before", "after"), strict=False)
    ]
    facts = []
    if any(map(_finite, rmse)):
        facts.append(f"That is {' → '.join(_number(x, 2) for x in rmse)} {report.get('unit') or ''} root mean square.")
    if _finite(floor):
        facts.append(f"Floor {_percent(floor)}: noise and numerics; no model can be expected to get below it.")
    if held and _finite(_at(report, "baseline", "error", "fit", "nrmse")):
        fitted = [_percent(_at(report, stage, "error", "fit", "nrmse")) for stage in stages]
        facts.append(f"{_plural(len(_list(report, 'split', 'fit')), 'fitted curve')}: {' → '.join(fitted)}.")
    if _finite(report.get("n_eff")):
        facts.append(f"The fit rests on {_count(report['n_eff'])} independent data{_of_rows(report)}.")
    for (name, group), entry in _parameters(_table_of(report, "final", "parameters")).items():
        if changed and "." in name and len(facts) < FACTS:
            words, unit = _named(report, name)
            facts.append(f"{words}{f' of {group}' if group else ''} {_with_interval(entry)} {unit}".rstrip() + ".")
    if left_out := _table_of(report, "split", "left_out"):
        facts.append(tag("a", f"{_plural(len(left_out), 'curve')} left out", href="#split"))
    if warnings := list(filter(None, _list(report, "warnings"))):
        facts.append(tag("a", _plural(len(warnings), "warning"), href="#warnings"))
    return tag(
        "div",
        tag("h2", title),
        tag("p", note, class_="note"),
        tag("div", *numbers, class_="numbers") if any(map(_finite, errors)) else tag("p", "No error could be computed."),
        _bars(errors, floor, max([x for x in (*errors, floor) if _finite(x)], default=0.0), "bars"),
        tag("ul", *(tag("li", fact) for fact in facts), class_="facts") if facts else None,
        class_="score",
    )


def _of_rows(report: Mapping[str, Any]) -> str:
    fitted = _list(report, "split", "fit")
    rows = [_at(row, "n") for row in _list(report, "noise", "rows") if not fitted or _at(row, "curve") in fitted]
    return f" in {_count(sum(rows))} rows" if rows and all(map(_finite, rows)) else ""


def _bars(errors: Sequence[Any], floor: Any, largest: float, class_: str) -> Html:
    """Bars of the error before and after, and a line where the floor is."""
    if not largest > 0.0:
        return Html("")

    def bar(kind: str, value: float) -> Html:
        return tag("i", class_=kind, style=f"width: {100.0 * value / largest:.1f}%")

    bars = [bar(kind, value) for kind, value in zip("ba", errors, strict=False) if _finite(value)]
    mark = tag("u", style=f"left: {100.0 * floor / largest:.1f}%") if _finite(floor) else None
    return tag("div", *bars, mark, class_=class_)


def _left(report: Mapping[str, Any], curves: Sequence[Mapping[str, Any]], pictures: dict[str, Html]) -> Html:
    if not curves:
        return Html("")
    unit = "standard deviations of the noise" if _whitened(curves) else "per cent of the largest measured value"
    caption = f"Measured minus model, in {unit}, over time; held-out curves first."
    if _whitened(curves):
        caption += " Grey: two standard deviations; beyond them the scale is logarithmic where the misfit is large."
    if any(len(curve["measured"]) > MANY for curve in curves):
        caption += " Long curves: faint every row, bold the mean over a sixtieth of them."
    return _section(
        "What is left, curve by curve", _picture(pictures.get("residuals.png"), "Residuals before and after.", caption)
    )


def _tried(report: Mapping[str, Any], pictures: dict[str, Html]) -> Html:
    """The candidates of every step."""
    parts: list[Any] = []
    added: list[str] = []
    before = None
    for number, step in enumerate(_list(report, "steps"), 1):
        chosen = _at(step, "chosen")
        model = f"the {_base(report)}{f' with {_joined(added)}' if added else ''}"
        end = f"Added: {_title(report, chosen)}." if chosen else "Nothing was added."
        p = _at(step, "p_residual")
        said = f"What {model} leaves would come from noise alone with p {_chance(p, '= ')}. " if _finite(p) else f"To {model}: "
        parts += [tag("h3", f"Step {number}"), tag("p", said, tag("b", end))]
        rows = [row for row in _list(step, "candidates") if isinstance(row, Mapping)]
        shown = sorted((row for row in rows if _drawn(row)), key=_by_drop)
        head = ("effect", "status", "drop of χ²", "p (Holm)", "cross-validated error", "its parameters", "why")
        cells = [
            (
                _title(report, row.get("effect")),
                STATUS.get(row.get("status"), row.get("status")),
                _number(row.get("chi2_drop")),
                _chance(row.get("p_holm")),
                _percent(row.get("cv_nrmse")),
                _brief(report, _table_of(row, "parameters")),
                row.get("reason"),
            )
            for row in shown
        ]
        parts.append(_rows(head, cells, "ttnnnww", [chosen is not None and row.get("effect") == chosen for row in shown]))
        others = [
            (_title(report, row.get("effect")), STATUS.get(row.get("status")), row.get("reason"))
            for row in rows
            if not _drawn(row)
        ]
        if others and others == before:
            parts.append(tag("p", f"Not scored: the same {len(others)} as before.", class_="note"))
        elif others:
            before = others
            parts += [
                tag("p", tag("b", "Not scored, which does not mean absent:")),
                _rows(("effect", "status", "why"), sorted(others, key=lambda x: str(x[1])), "ttw"),
            ]
        added += [_title(report, chosen)] if chosen else []
    if not parts:
        return Html("")
    caption = "Drop of χ² by adding one effect, with Holm's p. Blue: added. Light blue: significant. Grey: not significant."
    drawn = any(_drawn(row) for step in _list(report, "steps") for row in _list(step, "candidates"))
    picture = _picture(pictures.get("ranking.png"), "Candidates by drop of chi squared.", caption) if drawn else None
    return _section("What was tried", picture, *parts)


def _drawn(row: Any) -> bool:
    """Whether a candidate could be scored."""
    return _at(row, "status") in ("significant", "not-significant")


def _by_drop(row: Mapping[str, Any]) -> tuple[bool, float]:
    drop = row.get("chi2_drop")
    return row.get("status") != "significant", -drop if _finite(drop) else 0.0


def _apart(report: Mapping[str, Any]) -> Html:
    """Separability, and what to measure next."""
    rows = [
        (
            f"{_title(report, row.get('a'))} and {_title(report, row.get('b'))}",
            _number(row.get("separation")),
            ("told apart" if row["separation"] >= SEPARABLE else "not told apart") if _finite(row.get("separation")) else None,
        )
        for row in _list(report, "separations")
        if isinstance(row, Mapping)
    ]
    following = _table_of(report, "next_experiment")
    proposal = None
    if following.get("protocol"):
        pair = [_title(report, name) for name in _list(following, "separates")]
        said = f" This would tell {' from '.join(pair)}" if pair else ""
        size = f" (predicted separation {_number(following['separation'])})" if _finite(following.get("separation")) else ""
        proposal = tag("p", tag("b", "Measure next: "), _sentence(following["protocol"]), said and f"{said}{size}.")
    note = tag(
        "p", f"Told apart from a separation of {SEPARABLE:.0f} on, in units of the noise squared, all other parameters refitted."
    )
    table = _rows(("effects", "separation", ""), rows, "tnt")
    return _section("Can the effects be told apart?", note if rows else None, table, proposal)


def _errors(report: Mapping[str, Any]) -> Html:
    """Every curve, held-out ones first."""
    before, after = (_table_of(report, stage, "error", "curves") for stage in ("baseline", "final"))
    changed = _changed(report)
    names = sorted(before | after, key=lambda name: _at(before.get(name) or after.get(name), "split") != "holdout")
    stages = (before, after) if changed else (before,)
    values = {name: [_at(stage, name, "nrmse") for stage in stages] for name in names}
    floors = {
        name: next((x for x in (_at(after, name, "floor"), _at(before, name, "floor")) if _finite(x)), None) for name in names
    }
    largest = max((x for name in names for x in (*values[name], floors[name]) if _finite(x)), default=0.0)
    rows = [
        (
            name,
            "held out" if _at(before.get(name) or after.get(name), "split") == "holdout" else "fitted",
            _percent(values[name][0]),
            _percent(values[name][-1]) if changed else None,
            _percent(floors[name]),
            _number(_at(stages[-1], name, "rmse"), 2),
            _bars(values[name], floors[name], largest, "track"),
        )
        for name in names
    ]
    unit = report.get("unit") or "unit of the data"
    last = f"rmse {'after ' if changed else ''}({unit})"
    head = (
        "curve",
        "",
        "before" if changed else "error",
        "after",
        "floor",
        last,
        Html("before, after; line: floor" if changed else "line: floor"),
    )
    note = "Error: root mean square over the largest measured magnitude of the curve."
    return _section("Error on every curve", tag("p", note, class_="note"), _rows(head, rows, "ttnnnnb")) if rows else Html("")


def _constants(report: Mapping[str, Any]) -> Html:
    before, after = (_parameters(_table_of(report, stage, "parameters")) for stage in ("baseline", "final"))
    changed = _changed(report)
    rows = [
        (
            _quantity(report, name),
            group,
            _with_interval(before.get((name, group))),
            _with_interval(after.get((name, group))) if changed else None,
        )
        for name, group in dict.fromkeys([*before, *after])
    ]
    head = ("", "of", "before (95 % interval)" if changed else "value (95 % interval)", "after (95 % interval)")
    return _section("Constants", _rows(head, rows, "ttnn")) if rows else Html("")


def _floors(report: Mapping[str, Any]) -> Html:
    """Noise, numerics and the number of independent data."""
    noise, unit = _table_of(report, "noise"), report.get("unit") or ""
    said = {True: "stated with the data", False: "estimated"}
    rows = [
        (
            row.get("curve"),
            _number(row.get("sd"), 2),
            _number(row.get("rho"), 2),
            said.get(row["stated"], str(row["stated"]))
            if isinstance(row.get("stated"), bool | str)
            else _number(row.get("stated"), 2),
            _count(row.get("n")),
            _count(row.get("n_eff")),
        )
        for row in _list(noise, "rows")
        if isinstance(row, Mapping)
    ]
    head = (
        "curve",
        f"noise of a row, sd ({unit})" if unit else "noise of a row, sd",
        "correlation of rows",
        "noise is",
        "rows",
        "independent data",
    )
    numerical = [
        (row.get("what"), _percent(row.get("share_of_noise"))) for row in _list(noise, "numerical") if isinstance(row, Mapping)
    ]
    facts = []
    if _finite(report.get("n_eff")):
        facts.append(tag("li", tag("b", f"{_count(report['n_eff'])} independent data{_of_rows(report)}.")))
    if _finite(noise.get("scale_sd")):
        facts.append(tag("li", f"Scatter of whole curves in scale: {_percent(noise['scale_sd'])}."))
    if _finite(noise.get("offset_sd")):
        facts.append(tag("li", f"Scatter of whole curves in offset: {_number(noise['offset_sd'], 2)} {unit}."))
    return _section(
        "Noise and floors",
        tag("p", noise["text"]) if noise.get("text") else None,
        tag("ul", *facts) if facts else None,
        _rows(head, rows, "tnntnn"),
        _rows(("numerics: change of the prediction with", "share of the noise"), numerical, "tn"),
    )


def _what_if(report: Mapping[str, Any], pictures: dict[str, Html]) -> Html:
    rows = [
        (
            _quantity(report, key) if number == 0 else "",
            _bare(row.get("value")) if _finite(row.get("value")) else row.get("value"),
            VERDICTS.get(row.get("verdict"), row.get("verdict")),
            _joined([_title(report, name) for name in _list(row, "effects")]),
            _percent(row.get("error_fit")),
            _brief(report, _table_of(row, "parameters")),
        )
        for key, table in _assumed(report).items()
        for number, row in enumerate(table)
    ]
    note = tag(
        "p", "The dataset assumes these and does not state them. Each was set to other values and everything fitted again."
    )
    caption = "Filled: the same verdict and effects as above. Open, vermillion: another verdict."
    head = ("assumed", "value", "verdict", "effects", "error of the fit", "parameters")
    picture = _picture(pictures.get("sensitivity.png"), "Constants and error over what is assumed.", caption)
    return _section("If what is assumed were otherwise", note, picture, _rows(head, rows, "tnttnw")) if rows else Html("")


def _split(report: Mapping[str, Any]) -> Html:
    split = _table_of(report, "split")
    parts: list[Any] = [tag("p", split["rule"])] if split.get("rule") else []
    for key, words in (("fit", "Fitted"), ("holdout", "Held out")):
        if names := _list(split, key):
            parts.append(tag("p", tag("b", f"{words} ({len(names)}): "), ", ".join(map(str, names))))
    if left_out := _table_of(split, "left_out"):
        parts += [tag("p", tag("b", f"Left out ({len(left_out)}):")), _rows(("curve", "why"), left_out.items(), "tw")]
    return _section("Which curves were fitted, held out, left out", *parts, name="split")


def _warnings(report: Mapping[str, Any]) -> Html:
    points = [tag("li", text) for text in _list(report, "warnings") if text]
    return _section("Warnings", tag("ul", *points), name="warnings") if points else Html("")


def _provenance(report: Mapping[str, Any]) -> Html:
    rows = [
        (key, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str))
        for key, value in _table_of(report, "provenance").items()
        if value is not None
    ]
    return _section("Provenance", _rows(("", ""), rows, "tt"), class_="provenance") if rows else Html("")


# ---- the figures ----


def _before_after(report: Mapping[str, Any], curves: Sequence[Mapping[str, Any]]) -> Figure:
    """The most telling curve large, up to three more beside it."""
    figure = _figure(9.2, 6.1)
    curves = curves[:SHOWN]
    if not curves:
        return _nothing(figure, "No curve to show.")
    changed = _changed(report)
    grid = figure.add_gridspec(max(len(curves) - 1, 1), 2 if len(curves) > 1 else 1, width_ratios=[1.75, 1.0][: len(curves)])
    names = _labels(report)
    for number, curve in enumerate(curves):
        large = number == 0
        axes = figure.add_subplot(grid[:, 0] if large else grid[number - 1, 1])
        at, measured = _axis(axes, curve, ticks=5 if large else 4), _column(curve, "measured")
        for key, colour, line, name in (("before", BEFORE, "--", names[0]), ("after", AFTER, "-", names[1])):
            values = _column(curve, key)
            if values is not None and (changed or key == "before"):
                axes.plot(at, values, line, color=colour, lw=2.2 if large else 1.5, label=f"{key}: {name}" if changed else name)
        dots = _spread(at, measured, 70 if large else 36)
        axes.plot(
            at[dots],
            measured[dots],
            "o",
            color="black",
            ms=(3.4 if large else 2.2) + 2.0 * (len(at) <= FEW),
            mew=0,
            label="measured",
            zorder=3,
        )
        if large or curve.get("y_label") != curves[0].get("y_label"):
            axes.set_ylabel(str(curve.get("y_label") or ""), fontsize=10 if large else 8)
        axes.set_title(
            _short(curve.get("id", ""), 58 if large else 36) + _score_of(report, curve, changed),
            loc="left",
            fontsize=10 if large else 8,
        )
        axes.tick_params(labelsize=9 if large else 7.5)
        axes.xaxis.label.set_size(10 if large else 8)
        _plain(axes)
        axes.margins(y=0.06)
    for axes, below in zip(figure.axes[1:], figure.axes[2:], strict=False):
        if axes.get_xlabel() == below.get_xlabel():
            axes.set_xlabel("")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(
        handles[::-1][:1] + handles[:-1],
        labels[::-1][:1] + labels[:-1],
        loc="outside upper left",
        ncols=3,
        frameon=False,
        fontsize=10,
    )
    return figure


def _score_of(report: Mapping[str, Any], curve: Mapping[str, Any], changed: bool) -> str:
    """Second line of a panel's title: its part, and its error."""
    stages = ("baseline", "final") if changed else ("baseline",)
    errors = [_at(report, stage, "error", "curves", curve.get("id"), "nrmse") for stage in stages]
    said = f": error {' → '.join(_percent(x) for x in errors)}" if all(map(_finite, errors)) else ""
    return f"\n{'held out' if curve.get('split') == 'holdout' else 'fitted'}{said}"


def _residuals(report: Mapping[str, Any], curves: Sequence[Mapping[str, Any]]) -> Figure:
    """Measured minus model of all curves over time, in standard deviations of the noise where all are known."""
    columns = min(4, max(len(curves), 1))
    rows = -(-len(curves) // columns)
    figure = _figure(11.8, 0.8 + 1.45 * rows if len(curves) > 2 else 3.2)
    if not curves:
        return _nothing(figure, "No curve to show.")
    changed, whitened = _changed(report), _whitened(curves)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    worst = 0.0
    for axes, curve in zip(grid.flat, curves, strict=False):
        at, measured = _axis(axes, curve, ticks=4, over_time=True), _column(curve, "measured")
        scale = _column(curve, "sd") if whitened else np.nanmax(np.abs(measured)) / 100.0 or 1.0
        for key, colour, line in (("before", BEFORE, "--"), ("after", AFTER, "-")):
            model = _column(curve, key)
            if model is None or (key == "after" and not changed):
                continue
            rest = (measured - model) / scale
            worst = max(worst, float(np.nanmax(np.abs(rest))) if np.isfinite(rest).any() else 0.0)
            if len(at) > MANY:
                axes.plot(at, rest, color=colour, lw=0.5, alpha=0.25)
                rest = _running(rest, len(at) // 60)
            axes.plot(at, rest, line, color=colour, lw=1.3, label=key if changed else _labels(report)[0])
        if whitened:
            axes.axhspan(-2.0, 2.0, color="0.9", lw=0, zorder=-1)
        axes.axhline(0.0, color="black", lw=0.7)
        held = "held out: " if curve.get("split") == "holdout" else ""
        axes.set_title(
            held + _short(curve.get("id", ""), 38 - len(held)), loc="left", fontsize=8, weight="bold" if held else "normal"
        )
        axes.tick_params(labelsize=7.5)
        axes.xaxis.label.set_size(8)
        _plain(axes)
    for axes in grid.flat[len(curves) :]:
        axes.remove()
    for above, below in zip(grid.flat, grid.flat[columns : len(curves)], strict=False):
        if above.get_xlabel() == below.get_xlabel():
            above.set_xlabel("")
    if whitened:
        _by_noise(grid[0, 0], worst)
    for axes in grid[:, 0]:
        axes.set_ylabel("left (sd of noise)" if whitened else "left (%)", fontsize=8)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure


def _running(values: np.ndarray, width: int) -> np.ndarray:
    """Running mean over ``width`` rows, over fewer at the ends."""
    weights = np.ones(width)
    return np.convolve(values, weights, "same") / np.convolve(np.ones(len(values)), weights, "same")


def _whitened(curves: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the noise of every row of every curve is known."""
    columns = [_column(curve, "sd") for curve in curves]
    return all(column is not None and bool((column > 0.0).all()) for column in columns)


def _by_noise(axes: Axes, worst: float) -> None:
    """A scale that shows both two standard deviations and the worst misfit."""
    if worst <= 20.0:
        axes.set_ylim(-1.1 * max(worst, 3.0), 1.1 * max(worst, 3.0))
        return
    decades = range(1, math.ceil(math.log10(worst)) + 1)
    ticks = [0.0, 2.0, *(10.0**k for k in decades)]
    ticks = [t for t in ticks if t <= 1.6 * worst]
    axes.set_yscale("symlog", linthresh=2.0, linscale=0.8)
    axes.set_ylim(-1.6 * worst, 1.6 * worst)
    shown = [*(-t for t in ticks[:0:-1]), *ticks]
    axes.set_yticks(shown, [_bare(t) for t in shown])
    axes.minorticks_off()


def _ranking(report: Mapping[str, Any]) -> Figure:
    """Drop of chi squared of all candidates that could be tested, a column a step."""
    steps = [
        [row for row in _list(step, "candidates") if _drawn(row) and row.get("effect") and _finite(row.get("chi2_drop"))]
        for step in _list(report, "steps")
    ]
    names = list(dict.fromkeys(row.get("effect") for rows in steps for row in sorted(rows, key=_by_drop)))
    columns = [k for k, rows in enumerate(steps) if rows]
    figure = _figure(5.2 + 2.6 * max(len(columns) - 1, 0), 1.1 + 0.3 * max(len(names), 3))
    if not columns:
        return _nothing(figure, "No candidate was tested.")
    panels = figure.subplots(1, len(columns), sharey=True, sharex=True, squeeze=False)[0]
    top = max(max(row["chi2_drop"] for row in steps[k]) for k in columns)
    for axes, k in zip(panels, columns, strict=True):
        for row in steps[k]:
            chosen = row["effect"] == _at(_list(report, "steps")[k], "chosen")
            colour = AFTER if chosen else LIGHT if row.get("status") == "significant" else GREY
            y, drop = names.index(row["effect"]), max(row["chi2_drop"], 1.0)
            axes.plot([1.0, drop], [y, y], color=colour, lw=3.0 if chosen else 2.0, solid_capstyle="butt")
            axes.plot([drop], [y], "o", color=colour, ms=8 if chosen else 6)
            p = row.get("p_holm")
            if _finite(p):
                said = f"p {_chance(p, '= ')}{', added' if chosen else ''}"
                axes.annotate(said, (drop, y), xytext=(7, 0), textcoords="offset points", va="center", fontsize=8, color="0.25")
        axes.set_xscale("log")
        axes.set_xlim(1.0, max(top, 10.0) ** 1.5 * 1.5)
        powers = [10.0**n for n in range(math.ceil(math.log10(max(top, 10.0))) + 1)]
        axes.set_xticks(powers, ["1", "10", *(f"10{str(n).translate(SUPERSCRIPTS)}" for n in range(2, len(powers)))], fontsize=8)
        axes.minorticks_off()
        axes.set_title(f"step {k + 1}", loc="left", fontsize=10)
        axes.set_xlabel("drop of χ²", fontsize=9)
        _plain(axes)
        axes.grid(axis="y", visible=False)
    panels[0].set_yticks(range(len(names)), [_short(_title(report, name), 40) for name in names], fontsize=9)
    panels[0].set_ylim(len(names) - 0.4, -0.6)
    return figure


def _sensitivity(report: Mapping[str, Any]) -> Figure:
    """Constants (times those of the report) and the error of the fit over each assumed quantity."""
    tables = {key: sorted(rows, key=_place) for key, rows in _assumed(report).items()}
    reference = _parameters(_table_of(report, "final", "parameters") or _table_of(report, "baseline", "parameters"))
    columns = min(len(tables), 4)
    rows = -(-len(tables) // columns)
    figure = _figure(max(3.2 * columns, 4.6), 3.9 * rows)
    grid = figure.subplots(2 * rows, columns, squeeze=False, sharey="row", height_ratios=[1.4, 1.0] * rows)
    colours = [COLOURS[0], COLOURS[2], COLOURS[3], COLOURS[4], COLOURS[5], "black"]
    order = [key for key in reference if "." not in key[0]] or list(reference)
    for number, (key, table) in enumerate(tables.items()):
        upper, lower = (grid[2 * (number // columns) + k, number % columns] for k in (0, 1))
        values = [row.get("value") for row in table]
        numeric = all(map(_finite, values))
        at = np.asarray(values, dtype=float) if numeric else np.arange(len(values), dtype=float)
        same = np.array(
            [(row.get("verdict"), row.get("effects")) == (report.get("verdict"), report.get("effects")) for row in table]
        )
        fits = [_parameters(_table_of(row, "parameters")) for row in table]
        for k, name in enumerate(order[: len(colours)]):
            base = reference[name].get("value")
            found = [fit.get(name, {}).get("value") for fit in fits]
            if _finite(base) and base and any(map(_finite, found)):
                times = np.array([x / base if _finite(x) else np.nan for x in found])
                label = f"{_quantity(report, name[0]).split(' (')[0]}{f', {name[1]}' if name[1] else ''}"
                _marked(upper, at, times, same, colours[k], _short(label, 24))
        errors = np.array([100.0 * row["error_fit"] if _finite(row.get("error_fit")) else np.nan for row in table])
        _marked(lower, at, errors, same, "black", "")
        upper.axhline(1.0, color="0.5", lw=0.8)
        lower.set_xlabel(_quantity(report, key), fontsize=9)
        for axes in (upper, lower):
            axes.set_xticks(at, [_bare(v) if numeric else _short(v, 14) for v in values] if axes is lower else [""] * len(at))
            axes.tick_params(labelsize=8)
            axes.margins(x=0.1)
            _plain(axes)
    for axes in grid[::2, 0]:
        axes.set_ylabel("constant, times\nthe one above", fontsize=9)
        axes.set_ylim(min(0.9, axes.get_ylim()[0]), max(1.1, axes.get_ylim()[1]))  # a change of one per cent looks small
    for axes in grid[1::2, 0]:
        axes.set_ylabel("error of\nthe fit (%)", fontsize=9)
        axes.set_ylim(bottom=0.0)
    for number in range(len(tables), rows * columns):
        for k in (0, 1):
            grid[2 * (number // columns) + k, number % columns].remove()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), 3), frameon=False, fontsize=8)
    return figure


def _place(row: Mapping[str, Any]) -> float:
    """Where a row stands among others: words after numbers, in their own order."""
    return float(row["value"]) if _finite(row.get("value")) else math.inf


def _marked(axes: Axes, at: np.ndarray, values: np.ndarray, same: np.ndarray, colour: str, label: str) -> None:
    """A line with filled marks, and open ones where the verdict is another."""
    axes.plot(at, values, "-", color=colour, lw=1.2)
    axes.plot(at[same], values[same], "o", color=colour, ms=5, label=label or None)
    axes.plot(at[~same], values[~same], "o", color=BEFORE, mfc="white", mew=1.6, ms=6, zorder=3)


def _axis(axes: Axes, curve: Mapping[str, Any], ticks: int, over_time: bool = False) -> np.ndarray:
    """Where the rows of a curve lie across: over what is imposed, or over time, of which a short loading is stretched.

    Time is taken where ``over_time`` asks for it, the imposed quantity turns back or is held, or it is not given.
    """
    from matplotlib.ticker import MaxNLocator

    count = len(_column(curve, "measured"))  # type: ignore[arg-type]
    time, imposed = _column(curve, "time_s"), _column(curve, "x")
    if time is None or (imposed is not None and not over_time and _one_way(time, imposed)):
        axes.xaxis.set_major_locator(MaxNLocator(ticks))
        axes.set_xlabel(str(curve.get("x_label") or "") if imposed is not None else "row")
        return np.arange(count, dtype=float) if imposed is None else imposed
    axes.set_xlabel("time (s)")
    start, end = float(np.nanmin(time)), float(np.nanmax(time))
    loaded = _loaded(time, imposed) if imposed is not None else end
    if not 0.0 < loaded - start < SHORT_RAMP * (end - start):
        axes.xaxis.set_major_locator(MaxNLocator(ticks))
        return time
    knots, places = [start, loaded, end], [0.0, STRETCHED, 1.0]
    later = [t for t in MaxNLocator(ticks - 1).tick_values(loaded, end) if loaded + 0.15 * (end - loaded) < t <= end]
    axes.set_xticks(np.interp([start, loaded, *later], knots, places), [_bare(t) for t in (start, loaded, *later)])
    axes.axvspan(0.0, STRETCHED, color="0.96", lw=0, zorder=-2)
    axes.set_xlim(-0.015, 1.015)
    axes.set_xlabel("time (s), loading (grey) stretched")
    return np.interp(time, knots, places)


def _one_way(time: np.ndarray, imposed: np.ndarray) -> bool:
    """Whether the imposed quantity goes one way without a stop of more than a tenth of the time."""
    steps, span = np.diff(imposed), float(np.ptp(imposed))
    still = np.diff(time)[np.abs(steps) < 1e-3 * span].sum() if len(imposed) > 20 else 0.0
    back = min(steps[steps < 0.0].sum(), -steps[steps > 0.0].sum(), key=abs)
    return abs(back) <= 0.01 * span and still <= 0.1 * np.ptp(time)


def _loaded(time: np.ndarray, imposed: np.ndarray) -> float:
    """The time [s] at which the loading is over: 99 % of the largest change is reached."""
    way = np.abs(imposed - imposed[0])
    return float(time[int(np.argmax(way >= 0.99 * np.nanmax(way)))])


def _spread(at: np.ndarray, values: np.ndarray, most: int) -> np.ndarray:
    """Some rows of a long curve, evenly along its drawn length."""
    if len(at) <= most:
        return np.arange(len(at))
    steps = np.hypot(np.diff(at) / (np.ptp(at) or 1.0), np.diff(values) / (np.nanmax(values) - np.nanmin(values) or 1.0))
    length = np.concatenate([[0.0], np.nan_to_num(steps).cumsum()])
    return np.unique(np.searchsorted(length, np.linspace(0.0, length[-1], most)).clip(0, len(at) - 1))


def _figure(width_in: float, height_in: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")


def _nothing(figure: Figure, words: str) -> Figure:
    figure.text(0.5, 0.5, words, ha="center", va="center", color="0.4")
    return figure


def _plain(axes: Axes) -> None:
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
