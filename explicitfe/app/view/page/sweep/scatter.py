"""Any two columns of a sweep against each other: one picture without a script, and the numbers for a script that draws others."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from explicitfe.app.view.page.chart import Chart, Line, chart
from explicitfe.app.view.page.run.packed import Packed
from explicitfe.app.view.page.sweep.effects import main_effect
from explicitfe.results.documents.sweep_to_draw import SweepColumn, SweepToDraw

# Maximum number of runs on a page; fewer if there are many columns, as each number takes two bytes.
MOST_SCATTERED_MEMBERS = 3000
MOST_SCATTERED_NUMBERS = 400_000
SEED_OF_THE_SAMPLE = 0
# Numbers are stored as whole steps from the lowest to the highest of their column; one more says that there is none.
STEPS_OF_A_COLUMN = 65534
NO_NUMBER = 65535
# What a column of a drop-down stands under.
GROUP_WORDS = {
    "points": "named points",
    "grooves": "grooves",
    "constriction": "constriction",
    "contact": "contact",
    "highest": "highest point",
    "body": "whole body",
    "load": "loads",
    "palatogram": "palatogram",
    "leak": "leak",
    "airway": "airway",
}

Choice = tuple[int, str, bool, bool]


@dataclass(frozen=True)
class ColumnScatter:
    """The section of the page.

    Attributes
    ----------
    picture : of two columns, without any script.
    groups : words above entries of the drop-downs: number and title of a column, and whether it is along and up at first.
    data : packed, for scatter.js.
    drawn, stored : how many runs are in it, of how many.
    """

    picture: Chart
    groups: list[tuple[str, list[Choice]]]
    data: str
    drawn: int
    stored: int


def scatter_of(sweep: SweepToDraw) -> ColumnScatter | None:
    """The scatter of a sweep; None if no run has numbers in two columns."""
    columns = [*sweep.factors, *sweep.measures, *sweep.checks]
    if not sweep.factors or not sweep.measures or not columns:
        return None
    y = next((m for m in sweep.measures if m.name in sweep.main_measures[:1]), sweep.measures[0])
    effects = [effect for factor in sweep.factors if (effect := main_effect(factor, y)) is not None]
    if not effects:
        return None
    x = max(effects, key=lambda effect: np.nan_to_num(effect.share)).factor
    sample = sample_of(len(sweep.statuses), len(columns))
    picture, statuses = scatter_chart(sweep, x, y, sample), statuses_of(sweep)
    if picture is None:
        return None
    packed = Packed()
    packed.add("member", sweep.numbers[sample], "<u4")
    packed.add("status", np.array([statuses.index(sweep.statuses[row]) for row in sample], dtype=int), "<u1")
    entries: list[dict[str, object]] = []
    for number, column in enumerate(columns):
        values = column.values[sample]
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
        size = high - low or 1.0
        steps = np.where(np.isfinite(values), np.rint((np.nan_to_num(values) - low) / size * STEPS_OF_A_COLUMN), NO_NUMBER)
        packed.add(f"column_{number}", steps, "<u2")
        entries.append({"title": column.title, "low": low, "size": size, "levels": list(column.levels)})
    data = packed.text({"columns": entries, "statuses": statuses, "steps": STEPS_OF_A_COLUMN})
    return ColumnScatter(picture, _groups(sweep, x, y), data, len(sample), len(sweep.statuses))


def sample_of(stored: int, columns: int) -> np.ndarray:
    """Rows that the page has of so many: all, or as many as it holds, drawn at random and the same each time."""
    most = max(1, min(MOST_SCATTERED_MEMBERS, MOST_SCATTERED_NUMBERS // max(1, columns)))
    if stored <= most:
        return np.arange(stored)
    return np.sort(np.random.default_rng(SEED_OF_THE_SAMPLE).choice(stored, most, replace=False))


def statuses_of(sweep: SweepToDraw) -> list[str]:
    """The statuses of the runs: that of a finished run first, then by frequency."""
    statuses = [status for status, _ in Counter(sweep.statuses).most_common()]
    return sorted(statuses, key=lambda status: status != sweep.finished)


def scatter_chart(sweep: SweepToDraw, x: SweepColumn, y: SweepColumn, rows: np.ndarray | None = None) -> Chart | None:
    """Two columns against each other, coloured by status; ``rows`` are those of the runs that are drawn, all if left out."""
    rows = np.arange(len(sweep.statuses)) if rows is None else rows
    own = np.array(sweep.statuses)[rows]
    lines = [
        Line(status, x.values[rows[own == status]], y.values[rows[own == status]], "dots", colour=number)
        for number, status in enumerate(statuses_of(sweep))
    ]
    x_range = (-0.5, len(x.levels) - 0.5) if x.levels else None
    marks = (list(enumerate(x.levels)), list(enumerate(y.levels)))
    return chart("", lines, x_label=x.title, y_label=y.title, x_range=x_range, marks=marks)


def _groups(sweep: SweepToDraw, x: SweepColumn, y: SweepColumn) -> list[tuple[str, list[Choice]]]:
    columns = [*sweep.factors, *sweep.measures, *sweep.checks]
    groups: dict[str, list[Choice]] = {}
    for number, column in enumerate(columns):
        owner = column.name.partition(".")[0]
        if column in sweep.factors:
            words = "what was varied"
        elif column in sweep.checks:
            words = "whether to believe it"
        else:
            words = GROUP_WORDS.get(owner, owner)
        groups.setdefault(words, []).append((number, column.title, column is x, column is y))
    return list(groups.items())
