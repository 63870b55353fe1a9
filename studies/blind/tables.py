"""Tables of the outcomes: proportions with their Clopper-Pearson intervals, in JSON and in Markdown, and one picture."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import binomtest
from typing_extensions import TypedDict

from studies.blind import outcome as words
from studies.blind.reliability import ReliabilityBin, reliability, reliability_lines
from studies.blind.report import ReportedHoldout, ScoredCase, ToolReport

OTHER = ("several", "ambiguous", "unexplained", "none", words.LIMITED, "failed")  # columns of the confusion matrix beside effects


class Proportion(TypedDict):
    """A count, and its share with the 95 % interval; None where nothing could be counted."""

    count: int
    of: int
    share: float | None
    ci95: list[float] | None


class ParameterCoverage(Proportion):
    """How often the interval of a parameter covers the truth, and its median width relative to the true value."""

    median_width: float | None


class HeldOut(TypedDict):
    """Median errors of the held-out curves with the first and with the last model."""

    cases: int
    before: float | None
    after: float | None


class Seconds(TypedDict):
    """How long the cases took [s]."""

    median: float | None
    largest: float | None
    sum: float | None


Outcomes = dict[str, dict[str, Proportion]]  # key of the cases -> word -> proportion
Tables = TypedDict(
    "Tables",
    {
        "headline": dict[str, Proportion],
        "controls": Outcomes,
        "identifiable singles": Outcomes,
        "other singles": Outcomes,
        "identifiable singles, by noise": Outcomes,
        "controls, by noise": Outcomes,
        "identifiable singles, noise stated or not": Outcomes,
        "doubles": Outcomes,
        "outside the library": Outcomes,
        "confusion": dict[str, dict[str, int]],
        "held-out error": dict[str, HeldOut],
        "intervals": dict[str, ParameterCoverage],
        "seconds": Seconds,
        "reliability": list[ReliabilityBin],
    },
)


def proportion(count: int, of: int) -> Proportion:
    """A count, its share and the 95 % interval of that share (Clopper & Pearson 1934)."""
    if of == 0:
        return {"count": 0, "of": 0, "share": None, "ci95": None}
    interval = binomtest(count, of).proportion_ci(confidence_level=0.95, method="exact")
    return {"count": count, "of": of, "share": count / of, "ci95": [float(interval.low), float(interval.high)]}


def tables_of(rows: Sequence[ScoredCase]) -> Tables:
    """All tables of a scored set."""
    kinds = {kind: [row for row in rows if row["truth"]["kind"] == kind] for kind in words.WORDS}
    singles = kinds["single"]
    clear = [row for row in singles if row["truth"]["identifiable"]]
    unclear = [row for row in singles if not row["truth"]["identifiable"]]
    alarms = [row for row in kinds["control"] if row["outcome"] in words.ALARMS]
    wrong = "confidently wrong"
    return {
        "headline": {
            **_by_source(rows),
            "false alarms in controls": proportion(len(alarms), len(kinds["control"])),
            "right, identifiable singles": _count(clear, "right"),
            "confidently wrong, identifiable singles": _count(clear, wrong),
            "confidently wrong, other singles": _count(unclear, wrong),
            "confidently wrong, all with an effect": _count([*singles, *kinds["double"], *kinds["outside"]], wrong),
        },
        "controls": _by(kinds["control"], _subject, words.CONTROL),
        "identifiable singles": _by(clear, _effect, words.SINGLE),
        "other singles": _by(unclear, _effect, words.SINGLE),
        "identifiable singles, by noise": _by(clear, _level, words.SINGLE),
        "controls, by noise": _by(kinds["control"], _level, words.CONTROL),
        "identifiable singles, noise stated or not": _by(clear, _stated, words.SINGLE),
        "doubles": _by(kinds["double"], _clear, words.DOUBLE),
        "outside the library": _by(kinds["outside"], lambda row: f"{_subject(row)}, {_clear(row)}", words.OUTSIDE),
        "confusion": confusion(rows),
        "held-out error": {kind: _held_out(group) for kind, group in kinds.items() if group},
        "intervals": _coverage(rows),
        "seconds": _seconds(rows),
        "reliability": reliability(rows),
    }


def _by_source(rows: Sequence[ScoredCase]) -> dict[str, Proportion]:
    """The headline of homogeneous tests and of tests under a tool apart, where a set has both."""
    sources = {"under a tool": [row for row in rows if row["truth"]["mode"] == "indentation"]}
    sources["homogeneous"] = [row for row in rows if row["truth"]["mode"] != "indentation"]
    if not all(sources.values()):
        return {}
    headline: dict[str, Proportion] = {}
    for source, several in sources.items():
        controls = [row for row in several if row["truth"]["kind"] == "control"]
        clear = [row for row in several if row["truth"]["kind"] == "single" and row["truth"]["identifiable"]]
        outside = [row for row in several if row["truth"]["kind"] == "outside"]
        doubles = [row for row in several if row["truth"]["kind"] == "double" and row["truth"]["identifiable"]]
        alarms = sum(row["outcome"] in words.ALARMS for row in controls)
        headline[f"{source}: false alarms in controls"] = proportion(alarms, len(controls))
        headline[f"{source}: right, identifiable singles"] = _count(clear, "right")
        headline[f"{source}: confidently wrong, identifiable singles"] = _count(clear, "confidently wrong")
        headline[f"{source}: both, identifiable doubles"] = _count(doubles, "both")
        headline[f"{source}: confidently wrong, outside the library"] = _count(outside, "confidently wrong")
        covered = [
            interval["covers"]
            for row in several
            if words.recovers_truth(row["report"], row["truth"])
            for interval in words.intervals(row["report"], row["truth"])
        ]
        headline[f"{source}: 95 % intervals that cover"] = proportion(sum(covered), len(covered))
    return headline


def _subject(row: ScoredCase) -> str:
    return str(row["truth"]["sub"])


def _effect(row: ScoredCase) -> str:
    return next(iter(row["truth"]["effects"]))


def _level(row: ScoredCase) -> str:
    return f"{100.0 * row['truth']['noise']['level']:g} %"


def _stated(row: ScoredCase) -> str:
    return "stated" if row["truth"]["noise"]["stated"] else "not stated"


def _clear(row: ScoredCase) -> str:
    return "identifiable" if row["truth"]["identifiable"] else "not identifiable"


def _count(rows: Sequence[ScoredCase], word: str) -> Proportion:
    return proportion(sum(row["outcome"] == word for row in rows), len(rows))


def _by(rows: Sequence[ScoredCase], key: Callable[[ScoredCase], str], possible: Sequence[str]) -> Outcomes:
    """The proportions of the words, by a key of the cases; the last line is for all of them."""
    table: Outcomes = {}
    for name in sorted({key(row) for row in rows}):
        group = [row for row in rows if key(row) == name]
        table[name] = {word: _count(group, word) for word in possible}
    return table | {"all": {word: _count(rows, word) for word in possible}}


def confusion(rows: Sequence[ScoredCase]) -> dict[str, dict[str, int]]:
    """The number of cases by what was in the data and what the tool found.

    Controls, identifiable singles, and laws that are not in the library.
    """
    counts: dict[str, Counter[str]] = {}
    for row in rows:
        truth = row["truth"]
        if truth["kind"] == "control":
            name = "none (control)"
        elif truth["kind"] == "single" and truth["identifiable"]:
            name = _effect(row)
        elif truth["kind"] == "outside":
            name = f"outside: {truth['sub']}"
        else:
            continue
        counts.setdefault(name, Counter())[_verdict_word(row["report"])] += 1
    order = sorted(counts, key=lambda name: (name.startswith("outside"), name.startswith("none"), name))
    return {name: dict(counts[name]) for name in order}


def _verdict_word(report: ToolReport) -> str:
    verdict = report.get("verdict", "failed")
    if verdict != "effect-found":
        return {"no-missing-effect": "none"}.get(verdict, verdict)
    effects = list(report["effects"])
    return effects[0] if len(effects) == 1 else "several"


def _held_out(rows: Sequence[ScoredCase]) -> HeldOut:
    """The median nrmse of the held-out curves, of the cases that have it before and after."""
    pairs: list[list[float]] = []
    for row in rows:
        fits = row["report"].get("baseline", {}), row["report"].get("final", {})
        empty: ReportedHoldout = {}
        errors = [(fit.get("error", {}).get("holdout") or empty).get("nrmse") for fit in fits]
        numbers = [error for error in errors if error is not None]
        if len(numbers) == len(fits):
            pairs.append(numbers)
    before, after = np.median(pairs, axis=0).tolist() if pairs else (None, None)
    return {"cases": len(pairs), "before": before, "after": after}


def _coverage(rows: Sequence[ScoredCase]) -> dict[str, ParameterCoverage]:
    """How often the interval of each parameter covers the truth; only of models that have the effects of the truth."""
    intervals: dict[str, list[words.Coverage]] = {}
    for row in rows:
        if words.recovers_truth(row["report"], row["truth"]):
            for interval in words.intervals(row["report"], row["truth"]):
                intervals.setdefault(interval["name"], []).append(interval)
    entries: dict[str, ParameterCoverage] = {}
    for name in sorted(intervals, key=lambda name: (name not in ("C10_Pa", "C20_Pa"), name)):
        widths = [interval["width"] for interval in intervals[name] if interval["width"] is not None]
        covered = proportion(sum(interval["covers"] for interval in intervals[name]), len(intervals[name]))
        entries[name] = {**covered, "median_width": float(np.median(widths)) if widths else None}
    return entries


def _seconds(rows: Sequence[ScoredCase]) -> Seconds:
    times = [row["wall_s"] for row in rows if row["wall_s"] is not None]
    if not times:
        return {"median": None, "largest": None, "sum": None}
    return {"median": float(np.median(times)), "largest": max(times), "sum": sum(times)}


# ---- for people ----


def markdown(tables: Tables) -> str:
    """The tables as text."""
    parts = ["# Blind study", ""]
    parts += _table(["", "share", "95 % interval", "cases"], ([name, *_cells(p)] for name, p in tables["headline"].items()))
    for name, table in (
        ("controls", tables["controls"]),
        ("controls, by noise", tables["controls, by noise"]),
        ("identifiable singles", tables["identifiable singles"]),
        ("other singles", tables["other singles"]),
        ("identifiable singles, by noise", tables["identifiable singles, by noise"]),
        ("identifiable singles, noise stated or not", tables["identifiable singles, noise stated or not"]),
        ("doubles", tables["doubles"]),
        ("outside the library", tables["outside the library"]),
    ):
        if table["all"] and next(iter(table["all"].values()))["of"] == 0:
            continue
        heads = list(table["all"])
        parts += ["", f"## {name[0].upper()}{name[1:]}", ""]
        parts += _table(
            ["", "cases", *heads],
            ([key, str(next(iter(row.values()))["of"]), *(_short(p) for p in row.values())] for key, row in table.items()),
        )
    parts += ["", "## Confusion matrix", "", "Controls, identifiable singles, and what is outside the library.", ""]
    columns = _columns(tables["confusion"])
    parts += _table(
        ["effect in the data", *columns],
        ([name, *(str(row.get(c, "")) for c in columns)] for name, row in tables["confusion"].items()),
    )
    parts += ["", "## Held-out error", "", "Median nrmse of the held-out curves, in % of their peak.", ""]
    parts += _table(
        ["", "cases", "before", "after"],
        (
            [kind, str(e["cases"]), _percent(e["before"], 2), _percent(e["after"], 2)]
            for kind, e in tables["held-out error"].items()
        ),
    )
    parts += ["", "## 95 % intervals", "", "Of the models that have the effects of the truth.", ""]
    parts += _table(
        ["parameter", "coverage", "95 % interval", "cases", "median width / value"],
        ([name, *_cells(entry), _percent(entry["median_width"], 1)] for name, entry in tables["intervals"].items()),
    )
    parts += reliability_lines(tables["reliability"])
    seconds = tables["seconds"]
    if seconds["median"] is not None:
        line = f"Seconds a case: median {seconds['median']:.0f}, largest {seconds['largest']:.0f}; all {seconds['sum']:.0f}."
        parts += ["", line]
    return "\n".join(parts) + "\n"


def _columns(matrix: Mapping[str, Mapping[str, int]]) -> list[str]:
    """The effects that were in the data or in a verdict, and the other answers."""
    effects = [name for name in matrix if not name.startswith(("none (", "outside: "))]
    more = sorted({c for row in matrix.values() for c in row} - set(effects) - set(OTHER))
    return [*effects, *more, *OTHER]


def _table(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> list[str]:
    lines = [f"| {' | '.join(cells)} |" for cells in (heads, *rows)]
    return [lines[0], "|" + "---|" * len(heads), *lines[1:]]


def _percent(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{100.0 * value:.{digits}f} %"


def _cells(p: Proportion) -> list[str]:
    if p["share"] is None or p["ci95"] is None:
        return ["-", "-", "0"]
    low, high = p["ci95"]
    return [_percent(p["share"], 1), f"{100.0 * low:.1f} to {100.0 * high:.1f} %", str(p["of"])]


def _short(p: Proportion) -> str:
    if p["share"] is None or p["ci95"] is None or p["count"] == 0:
        return "0"
    low, high = p["ci95"]
    return f"{p['count']} ({100.0 * p['share']:.0f} %, {100.0 * low:.0f} to {100.0 * high:.0f})"


def picture(matrix: Mapping[str, Mapping[str, int]]) -> bytes:
    """The confusion matrix, shaded by the share of its row, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = _columns(matrix)
    counts = np.array([[row.get(c, 0) for c in columns] for row in matrix.values()], dtype=float).reshape(-1, len(columns))
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    figure = Figure(figsize=(2.6 + 0.55 * len(columns), 2.2 + 0.42 * len(matrix)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, j), count in np.ndenumerate(counts):
        if count > 0:
            colour = "white" if shares[i, j] > 0.6 else "black"
            axes.text(j, i, f"{count:.0f}", ha="center", va="center", fontsize=9, color=colour)
    axes.set_xticks(range(len(columns)), columns, rotation=45, ha="right", fontsize=9)
    axes.set_yticks(range(len(matrix)), list(matrix), fontsize=9)
    axes.axvline(len(columns) - len(OTHER) - 0.5, color="0.6", lw=0.8)
    axes.set_xlabel("found")
    axes.set_ylabel("effect in the data")
    axes.set_title("Cases by what was in the data and what was found", loc="left", fontsize=10)
    png = io.BytesIO()
    figure.savefig(png, dpi=150, format="png")
    return png.getvalue()
