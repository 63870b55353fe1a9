"""The page of a sweep: outlines, main effects, heat maps, sensitivity indices, a scatter plot of any two columns, failed runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.sweep.effects import MOST_FACTORS_ON_PAGE, effects_on, shares_of
from explicitfe.app.view.page.sweep.heat_map import heat_maps
from explicitfe.app.view.page.sweep.scatter import scatter_of
from explicitfe.app.view.page.tables import PageTable, table
from explicitfe.app.view.page.words import bare, count, finite, number, plural
from explicitfe.results.documents.sweep_to_draw import MeasureIndices, SweepColumn, SweepToDraw

# Margin around the outlines, as a share of their extent.
AROUND_OUTLINES_SHARE = 0.04
# The part of the palate that is shown in front of and behind the tongue.
BESIDE_THE_TONGUE_MM = 8.0
# Overlaid lines have an opacity that decreases with their number, within these limits.
OPACITY_OF_ONE_LINE, OPACITY_RANGE = 2.4, (0.25, 0.8)
# Number of settings below an outline; members.csv has all of them.
MOST_SETTINGS_SHOWN = 8
# Limits of a drawn interval, in lengths of the scale.
REACH_OF_AN_INTERVAL = (-1.0, 2.0)
ROUNDING_OF_A_BAR = 1e-9
# Run numbers in the table of failures, and texts of a factor in the table of factors.
MOST_NUMBERS_SAID, MOST_LEVELS_SAID = 6, 8
# Factors in the table of shares; a table with more columns is unreadable.
MOST_FACTORS_TABLED = 12
KINDS_OF_INDICES = ("total", "first", "effect")


@dataclass(frozen=True)
class IntervalBar:
    """A bar of an index with its interval, all in % of the width, and the number in words."""

    kind: str
    percent: str
    low: str
    width: str
    words: str


def sweep_page(sweep: SweepToDraw) -> tuple[str, int]:
    """The text of the page, and the number of runs in its scatter plot."""
    scatter = scatter_of(sweep)
    charts = [(one.title, effects_on(one, sweep.factors, with_shares=sweep.is_balanced)) for one in sweep.shown_measures]
    effects = [(title, of_measure) for title, of_measure in charts if of_measure]
    text = page_text(
        "page/sweep/sweep.html.j2",
        styles=["page/sweep/sweep.css"],
        scripts=["page/sweep/scatter.js"],
        title=sweep.title,
        sweep=sweep,
        numbers=list(_numbers(sweep)),
        factors=_factors(sweep.factors),
        box=_box(sweep),
        path=_path,
        opacity=f"{np.clip(OPACITY_OF_ONE_LINE / max(1, len(sweep.outlines)) ** 0.5, *OPACITY_RANGE):.2f}",
        has_rest=any(len(member.at_rest) for member in sweep.drawn),
        most_settings=MOST_SETTINGS_SHOWN,
        effects=effects,
        # With one factor there is one chart per measure, and all of them are visible at once.
        single=[replace(shown[0], title=title, y_label="") for title, shown in effects] if len(sweep.factors) == 1 else [],
        maps=list(heat_maps(sweep)),
        shares=_shares(sweep),
        factors_left_out=max(0, len(sweep.factors) - MOST_FACTORS_ON_PAGE),
        indices=[_indices(one) for one in sweep.indices],
        has_shares=any(not one.unit for one in sweep.indices)
        and any("total" in f.values for o in sweep.indices for f in o.factors),
        scatter=scatter,
        causes=table(
            ("status", "runs", "cause (message of the first run)", "numbers"),
            [(cause.status, count(cause.count), cause.message, _which(cause.members, cause.count)) for cause in sweep.causes],
            "tnwt",
        ),
        facts=table(("", ""), sweep.facts, "tt"),
    )
    return text, 0 if scatter is None else scatter.drawn


def _numbers(sweep: SweepToDraw) -> Iterator[tuple[str, str, str]]:
    """The large numbers at the top: class, number, and label."""
    finished = sweep.statuses.count(sweep.finished)
    failed = sweep.stored - finished
    yield "after", count(finished), f"of {plural(sweep.members, 'run')} finished"
    yield ("before" if failed else ""), count(failed), "did not finish"
    if sweep.stored < sweep.members:
        yield "", count(sweep.members - sweep.stored), "are not computed yet"
    if sweep.warned:
        yield "", count(sweep.warned), "finished with warnings"
    came_to_end = np.array([status == sweep.finished for status in sweep.statuses], dtype=bool)
    seconds = sweep.member_s[np.isfinite(sweep.member_s) & came_to_end]
    if len(seconds) and float(np.median(seconds)) > 0.0:
        median = float(np.median(seconds))
        yield "", count(60.0 / median), f"runs per minute and worker (median {number(median, 2)} s per run)"


def _factors(factors: Sequence[SweepColumn]) -> PageTable | None:
    rows = []
    for factor in factors:
        known = factor.values[np.isfinite(factor.values)]
        distinct = len(np.unique(known))
        if factor.levels:
            words = ", ".join(factor.levels[:MOST_LEVELS_SAID])
            low, high = f"{words}{', …' if len(factor.levels) > MOST_LEVELS_SAID else ''}", ""
        else:
            low, high = (bare(known.min()), bare(known.max())) if len(known) else ("", "")
        rows.append((factor.title, low, high, count(distinct), factor.name))
    return table(("factor", "from", "to", "values", "key"), rows, "ttttt")


def _shares(sweep: SweepToDraw) -> PageTable | None:
    """The share of variance of each factor; None for a single factor or an unbalanced design."""
    factors = sweep.factors[:MOST_FACTORS_TABLED]
    if len(sweep.factors) < 2 or not sweep.is_balanced:
        return None
    rows = [(measure.title, *shares_of(measure, factors)) for measure in sweep.shown_measures]
    head = ("measure", *(factor.words for factor in factors))
    return table(head, [row for row in rows if any(row[1:])], "t" + "n" * len(factors))


def _box(sweep: SweepToDraw) -> str:
    """The view box of all outlines, with the nearby parts of the palates; "" without outlines."""
    if not sweep.drawn:
        return ""
    bodies = [member.outline for member in sweep.drawn] + [m.at_rest for m in sweep.drawn if len(m.at_rest)] + sweep.outlines
    points = np.concatenate(bodies)
    low, high = points.min(axis=0), points.max(axis=0)
    for palate in [member.palate for member in sweep.drawn if len(member.palate)]:
        near = palate[(palate[:, 0] > low[0] - BESIDE_THE_TONGUE_MM) & (palate[:, 0] < high[0] + BESIDE_THE_TONGUE_MM)]
        if len(near):
            low, high = np.minimum(low, near.min(axis=0)), np.maximum(high, near.max(axis=0))
    around = AROUND_OUTLINES_SHARE * float((high - low).max())
    low, high = low - around, high + around
    return f"{low[0]:.2f} {-high[1]:.2f} {high[0] - low[0]:.2f} {high[1] - low[1]:.2f}"


def _path(points: np.ndarray, closed: bool = True) -> str:
    """Points (k, 2) mm as an SVG path, whose y axis points down; "" without points."""
    if not len(points):
        return ""
    return "M" + "L".join(f"{x:.2f} {-z:.2f}" for x, z in points) + ("Z" if closed else "")


def _indices(measure: MeasureIndices) -> tuple[str, list[tuple[str, list[IntervalBar]]], str]:
    """Title, factors with their bars, and the value at the right end of the bars: 1 for shares, or the longest interval."""
    is_share = all("effect" not in factor.values for factor in measure.factors)
    reach = max((abs(value) + half for factor in measure.factors for value, half in factor.values.values()), default=0.0)
    whole = 1.0 if is_share or not (finite(reach) and reach > ROUNDING_OF_A_BAR) else reach
    rows = [
        (
            factor.factor,
            [_bar(kind, *factor.values[kind], whole) for kind in KINDS_OF_INDICES if kind in factor.values],
        )
        for factor in measure.factors
    ]
    return measure.measure, rows, f"{bare(whole)}{f' {measure.unit}' if measure.unit else ''}"


def _bar(kind: str, value: float, half: float, whole: float) -> IntervalBar:
    """A bar and its interval; parts beyond the scale are clipped."""
    half = half if finite(half) else 0.0
    low, high = np.clip([(value - half) / whole, (value + half) / whole], *REACH_OF_AN_INTERVAL)
    places = 2 if kind != "effect" else _places(half)
    return IntervalBar(
        kind,
        f"{100.0 * float(np.clip(value / whole, 0.0, 1.0)):.1f}",
        f"{100.0 * low:.1f}",
        f"{100.0 * (high - low):.1f}",
        f"{round(value, places) + 0.0:.{places}f} ± {half:.{places}f}".replace("-", "\N{MINUS SIGN}"),
    )


def _places(half: float) -> int:
    """Decimal places that show two digits of a half width."""
    return max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 2


def _which(members: Sequence[int], of: int) -> str:
    shown = ", ".join(map(str, members[:MOST_NUMBERS_SAID]))
    return f"{shown}, …" if of > min(len(members), MOST_NUMBERS_SAID) else shown
