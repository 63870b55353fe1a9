"""The page of a planned test: detectable and distinguishable effects."""

from __future__ import annotations

import shlex

from explicitfe.app.view.page.frame import page_text
from explicitfe.app.view.page.tables import PageTable, bars, table
from explicitfe.app.view.page.words import bare, count, finite, plural
from explicitfe.results.documents.planned_test import EffectInTest, PlannedTest
from explicitfe.results.documents.units_of_keys import words_and_unit


def design_page(planned: PlannedTest) -> str:
    """The text of the page."""
    shown = [row for row in planned.effects if row.shows]
    hidden = [row for row in planned.effects if not row.shows]
    constants = [(name.removesuffix("_Pa"), f"{bare(value)} Pa") for name, value in planned.constants.items()]
    of_all = f"{len(shown)} of {plural(len(planned.effects), 'effect')} are detectable"
    return page_text(
        "page/design.html.j2",
        title=planned.protocol,
        summary=f"{of_all} with {count(planned.n_eff)} independent rows.",
        shown=shown_table(shown),
        apart=apart_table(shown),
        hidden=table(("effect", "reason"), [(row.effect, row.reason) for row in hidden], "tw"),
        constants=table(("constant", "expected"), constants, "tn"),
        command=f"explicitfe design-test {shlex.quote(planned.file)}",
    )


def shown_table(rows: list[EffectInTest]) -> PageTable | None:
    """The smallest detectable strength of each effect; the bar is its ratio to the largest plausible one."""
    head = ("effect", "strength", "detected from", "plausible up to", "ratio", "imitated by constants")
    return table(
        head,
        [
            (
                row.effect,
                strength_in_words(row),
                bare(row.smallest),
                bare(row.largest_plausible),
                bars([None, share], None, 1.0) if (share := _share(row)) is not None else "",
                ", ".join(f"{name.removesuffix('_Pa')} {100.0 * change:+.0f} %" for name, change in row.hides_in.items()),
            )
            for row in rows
        ],
        "ttnnbt",
    )


def strength_in_words(row: EffectInTest) -> str:
    """The parameter that is the strength of an effect, with its unit in brackets."""
    words, _ = words_and_unit(row.strength.rpartition(".")[2])
    return f"{words} ({row.unit})" if row.unit else words


def _share(row: EffectInTest) -> float | None:
    """The smallest detectable strength over the largest plausible one."""
    if not finite(row.smallest) or not finite(row.largest_plausible) or not row.largest_plausible:
        return None
    return min(1.0, abs(row.smallest / row.largest_plausible))


def apart_table(rows: list[EffectInTest]) -> PageTable | None:
    """Effects that each effect is and is not distinguishable from at its largest plausible strength."""
    cells = []
    for row in rows:
        is_distinct = row.nearest is not None and row.nearest not in row.cannot_tell_from
        nearest = (row.nearest, bare(row.separation)) if is_distinct else ("", "")
        cells.append((row.effect, ", ".join(row.cannot_tell_from), *nearest))
    return table(("effect", "not distinguishable from", "nearest distinguishable effect", "separation"), cells, "tttn")
