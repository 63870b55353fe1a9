"""What factors of a sweep do to a measure: its mean and scatter against each factor, and which share of it follows the factor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.app.view.page.chart import Chart, Line, chart
from explicitfe.app.view.page.words import NO_BREAK
from explicitfe.results.documents.sweep_to_draw import SweepColumn

# A factor with more values than this is binned; maximum number of bins, and approximate number of runs per bin.
MOST_VALUES_NOT_BINNED = 12
MOST_BINS_OF_A_FACTOR, FEWEST_BINS_OF_A_FACTOR, MEMBERS_PER_BIN = 12, 3, 8
# Number of factors whose effects are drawn for each measure, the strongest first.
MOST_FACTORS_ON_PAGE = 8
MEAN_COLOUR, BAR_COLOUR = 0, 0


@dataclass(frozen=True, eq=False)
class MainEffect:
    """A measure against one factor.

    Attributes
    ----------
    x : (b,) of each value or bin, the mean of the factor there.
    mean, sd : (b,) of the measure there; a standard deviation of NaN: one run only.
    share : of the measure's variance that the means explain, 0 to 1, less what chance explains; NaN where that is not known.
    binned : whether x are bins.
    """

    factor: SweepColumn
    x: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    share: float
    binned: bool


def main_effect(factor: SweepColumn, measure: SweepColumn) -> MainEffect | None:
    """A measure against a factor; None where runs that have both are at one value only."""
    usable = np.isfinite(factor.values) & np.isfinite(measure.values)
    if len(np.unique(factor.values[usable])) < 2:
        return None
    at, y = factor.values[usable], measure.values[usable]
    distinct = np.unique(at)
    binned = len(distinct) > MOST_VALUES_NOT_BINNED and not factor.levels
    if binned:
        bins = int(np.clip(len(at) // MEMBERS_PER_BIN, FEWEST_BINS_OF_A_FACTOR, MOST_BINS_OF_A_FACTOR))
        edges = np.linspace(at.min(), at.max(), bins + 1)
        place = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, bins - 1)
    else:
        place = np.searchsorted(distinct, at)
    groups = [np.flatnonzero(place == k) for k in np.unique(place)]
    mean = np.array([y[group].mean() for group in groups])
    sd = np.array([y[group].std(ddof=1) if len(group) > 1 else np.nan for group in groups])
    return MainEffect(factor, np.array([at[group].mean() for group in groups]), mean, sd, _share(y, groups), binned)


def effects_on(measure: SweepColumn, factors: Sequence[SweepColumn], *, with_shares: bool) -> list[Chart]:
    """The charts of a measure, with one range of y for all, so that effects can be compared.

    Parameters
    ----------
    with_shares : whether the titles say which share of the variance follows each factor.
    """
    effects = [effect for factor in factors if (effect := main_effect(factor, measure)) is not None]
    if len(effects) > MOST_FACTORS_ON_PAGE:
        strongest = sorted(effects, key=lambda effect: -np.nan_to_num(effect.share))[:MOST_FACTORS_ON_PAGE]
        effects = [effect for effect in effects if effect in strongest]
    if not effects:
        return []
    reached = np.concatenate([[e.mean - np.nan_to_num(e.sd), e.mean + np.nan_to_num(e.sd)] for e in effects], axis=1)
    y_range = (float(reached.min()), float(reached.max()))
    return [drawn for effect in effects if (drawn := _chart(effect, measure, y_range, with_shares)) is not None]


def shares_of(measure: SweepColumn, factors: Sequence[SweepColumn]) -> list[str]:
    """Which share of a measure's variance follows each factor, in words."""
    effects = [main_effect(factor, measure) for factor in factors]
    return ["" if effect is None else share_in_words(effect.share) for effect in effects]


def share_in_words(share: float) -> str:
    """A share in whole per cent; "" where it is not known."""
    return f"{100.0 * share:.0f}{NO_BREAK}%" if np.isfinite(share) else ""


def _share(y: np.ndarray, groups: Sequence[np.ndarray]) -> float:
    """Between the groups, of the whole variance, without what as many groups of chance would take (epsilon squared)."""
    within_count = len(y) - len(groups)
    total = float(((y - y.mean()) ** 2).sum())
    if within_count < 1 or not total > 0.0:
        return float("nan")
    within = sum(float(((y[group] - y[group].mean()) ** 2).sum()) for group in groups)
    return float(np.clip((total - within - (len(groups) - 1) * within / within_count) / total, 0.0, 1.0))


def _chart(effect: MainEffect, measure: SweepColumn, y_range: tuple[float, float], with_shares: bool) -> Chart | None:
    factor = effect.factor
    share = share_in_words(effect.share) if with_shares else ""
    return chart(
        f"{factor.words}{f', {share} of the variance' if share else ''}",
        list(_lines(effect)),
        x_label=factor.title,
        y_label=measure.title,
        x_range=(-0.5, len(factor.levels) - 0.5) if factor.levels else None,
        y_range=y_range,
        marks=(list(enumerate(factor.levels)), ()),
    )


def _lines(effect: MainEffect) -> Iterator[Line]:
    low, high = effect.mean - effect.sd, effect.mean + effect.sd
    if effect.factor.levels:
        gaps = np.full(len(effect.x), np.nan)
        yield Line("", np.repeat(effect.x, 3), np.column_stack([low, high, gaps]).ravel(), colour=BAR_COLOUR)
    else:
        known = np.isfinite(low)
        if np.count_nonzero(known) > 1:
            yield Line("", effect.x[known], low[known], drawn="band", colour=MEAN_COLOUR, y_high=high[known])
        yield Line("", effect.x, effect.mean, colour=MEAN_COLOUR)
    yield Line("", effect.x, effect.mean, drawn="dots", colour=MEAN_COLOUR)
