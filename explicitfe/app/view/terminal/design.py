"""The answer of ``design-test`` in the terminal: detectable and distinguishable effects of a planned test."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.words import bare, worth_of
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs
from explicitfe.results.documents.planned_test import EffectInTest, PlannedTest
from explicitfe.results.documents.proposed_tests import ProposedTests
from explicitfe.results.documents.units_of_keys import words_and_unit

# So many of the most probable causes are shown.
SHOWN_CAUSES = 6


def design_tables(planned: PlannedTest) -> Group:
    """Detectable effects, distinguishable effects, and why the others are not detectable."""
    shown = [row for row in planned.effects if row.shows]
    hidden = [row for row in planned.effects if not row.shows]
    tables: list[RenderableType] = [_shown(planned.protocol, shown), _apart(shown)] if shown else []
    if hidden:
        table = pairs("not detectable with this test" if shown else planned.protocol)
        for row in hidden:
            table.add_row(escape(row.effect), escape(row.reason))
        tables.append(table)
    return Group(*tables)


def proposal_tables(proposed: ProposedTests) -> Group:
    """Proposed tests with their expected information gain and duration."""
    head = pairs(proposed.dataset)
    sure = "" if proposed.sure is None else f" (probability {proposed.sure:.2f})"
    head.add_row("verdict", escape(f"{proposed.verdict}{sure}"))
    head.add_row("causes", escape(", ".join(f"{name} {p:.2f}" for name, p in list(proposed.posterior.items())[:SHOWN_CAUSES])))
    for test in proposed.tests:
        head.add_row("measure next", escape(f"{test.protocol}: {worth_of(test)}"))
    if not proposed.tests:
        head.add_row("measure next", "no test within the limits of the rig is informative enough")
    return Group(head, file_lines([("file", path) for path in proposed.files]))


def _shown(title: str, rows: list[EffectInTest]) -> Table:
    """The smallest detectable strength of each effect, and the change of constants that imitates a weaker one."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("effect", no_wrap=True)
    table.add_column("strength")
    for column in ("detected from", "plausible up to"):
        table.add_column(column, justify="right")
    table.add_column("imitated by constants")
    for row in rows:
        hides = ", ".join(f"{name.removesuffix('_Pa')} {100 * share:+.0f} %" for name, share in row.hides_in.items())
        table.add_row(escape(row.effect), escape(strength_in_words(row)), bare(row.smallest), bare(row.largest_plausible), hides)
    return table


def _apart(rows: list[EffectInTest]) -> Table:
    """Effects that each effect is and is not distinguishable from at its largest plausible strength."""
    table = Table(
        title="distinguishable effects at the largest plausible strength",
        title_justify="left",
        caption="separation: squared distance in units of the noise; about 20 is required",
        caption_justify="left",
    )
    table.add_column("effect", no_wrap=True)
    table.add_column("not distinguishable from")
    table.add_column("nearest distinguishable effect")
    table.add_column("separation", justify="right")
    for row in rows:
        is_distinct = row.nearest is not None and row.nearest not in row.cannot_tell_from
        rivals = ", ".join(row.cannot_tell_from)
        table.add_row(
            escape(row.effect),
            escape(rivals or "-"),
            escape(row.nearest or "") if is_distinct else "-",
            bare(row.separation) if is_distinct else "-",
        )
    return table


def strength_in_words(row: EffectInTest) -> str:
    """The parameter that is the strength of an effect, with its unit in brackets."""
    words, _ = words_and_unit(row.strength.rpartition(".")[2])
    return f"{words} ({row.unit})" if row.unit else words
