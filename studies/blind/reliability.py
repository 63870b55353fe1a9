"""How well the probability of a verdict is calibrated: of verdicts that are given with 0.8, eight in ten should be right."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest
from typing_extensions import TypedDict

from studies.blind.identifiable import SMALLEST_IDENTIFIABLE_DISTANCE
from studies.blind.report import ScoredCase

BIN_COUNT = 10
# What verdicts claim comes true in these outcomes.
RIGHT = (
    "no-missing-effect",
    "right",
    "ambiguous, true named",
    "both",
    "one, remainder says so",
    "an effect that predicts at the floor",
)


class ReliabilityBin(TypedDict):
    """Verdicts whose probability lies between two numbers, and the share of them that is right, with its 95 % interval."""

    low: float
    high: float
    cases: int
    mean_probability: float | None
    right: float | None
    ci95: list[float] | None


def is_right(row: ScoredCase) -> bool:
    """Whether what a verdict claims is true of the case.

    An effect that the data cannot show is not there for them: so "nothing" is right of it, and one effect of two where that one
    alone stays within 25 of the truth.
    """
    truth, word = row["truth"], row["outcome"]
    if word == "unexplained":
        return truth["kind"] == "outside"
    separation = truth["separation"]
    if word == "missed" and separation is not None:
        return separation["baseline"] < SMALLEST_IDENTIFIABLE_DISTANCE
    if word == "one, said to be all" and separation is not None:
        (named,) = row["report"]["effects"]
        return separation["rivals"].get(named, np.inf) < SMALLEST_IDENTIFIABLE_DISTANCE
    return word in RIGHT


def reliability(rows: Sequence[ScoredCase]) -> list[ReliabilityBin]:
    """Ten bins of the probability that reports give their verdict."""
    pairs = [(sure, is_right(row)) for row in rows if (sure := row["report"].get("sure")) is not None]
    bins: list[ReliabilityBin] = []
    for k in range(BIN_COUNT):
        inside = [(p, right) for p, right in pairs if min(int(p * BIN_COUNT), BIN_COUNT - 1) == k]
        entry: ReliabilityBin = {
            "low": k / BIN_COUNT,
            "high": (k + 1) / BIN_COUNT,
            "cases": len(inside),
            "mean_probability": None,
            "right": None,
            "ci95": None,
        }
        if inside:
            count = sum(right for _, right in inside)
            interval = binomtest(count, len(inside)).proportion_ci(confidence_level=0.95, method="exact")
            entry["mean_probability"] = float(np.mean([p for p, _ in inside]))
            entry["right"] = count / len(inside)
            entry["ci95"] = [float(interval.low), float(interval.high)]
        bins.append(entry)
    return bins


def reliability_lines(bins: Sequence[ReliabilityBin]) -> list[str]:
    """The bins as a Markdown table; nothing where no report says how sure it is."""
    if not any(one["cases"] for one in bins):
        return []
    lines = ["", "## How sure the verdicts were", "", "The probability that reports give, and the share that was right."]
    lines += ["", "| probability | cases | mean | right | 95 % interval | inside |", "|---|---|---|---|---|---|"]
    for one in bins:
        mean, right, interval = one["mean_probability"], one["right"], one["ci95"]
        if mean is not None and right is not None and interval is not None:
            inside = "yes" if interval[0] <= mean <= interval[1] else "no"
            cells = f"{one['low']:.1f} to {one['high']:.1f} | {one['cases']} | {mean:.2f} | {right:.2f}"
            lines.append(f"| {cells} | {interval[0]:.2f} to {interval[1]:.2f} | {inside} |")
    return lines


def reliability_picture(bins: Sequence[ReliabilityBin]) -> bytes:
    """The reliability diagram as PNG: the share that was right, with its interval, over the probability."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], color="0.7", lw=1.0)
    for one in bins:
        mean, right, interval = one["mean_probability"], one["right"], one["ci95"]
        if mean is None or right is None or interval is None:
            continue
        axes.plot([mean, mean], interval, color="tab:blue", lw=1.5)
        axes.plot(mean, right, "o", color="tab:blue", ms=5)
        axes.annotate(str(one["cases"]), (mean, right), xytext=(5, -10), textcoords="offset points", fontsize=8)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), xlabel="probability of the verdict", ylabel="share that was right")
    axes.set_title("How sure the verdicts were, and how often they were right", loc="left", fontsize=9)
    png = io.BytesIO()
    figure.savefig(png, dpi=150, format="png")
    return png.getvalue()
