"""What ``design-test`` says, in the terminal: what a planned test can show and tell apart, and what it cannot."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.results.planned_test import EffectInTest, PlannedTest
from explicitfe.results.proposed_tests import ProposedTests
from explicitfe.results.units_of_keys import words_and_unit
from explicitfe.view.report.words import bare, worth_of
from explicitfe.view.terminal.files import file_lines
from explicitfe.view.terminal.rows import pairs

# So many of the most probable causes are shown.
SHOWN_CAUSES = 6


def design_tables(planned: PlannedTest) -> Group:
    """What a planned test can show, what it tells apart, and why it cannot show the other effects."""
    shown = [row for row in planned.effects if row.shows]
    hidden = [row for row in planned.effects if not row.shows]
    tables: list[RenderableType] = [_shown(planned.protocol, shown), _apart(shown)] if shown else []
    if hidden:
        table = pairs("what it cannot show, however strong it plausibly is" if shown else planned.protocol)
        for row in hidden:
            table.add_row(escape(row.effect), escape(row.reason))
        tables.append(table)
    return Group(*tables)


def proposal_tables(proposed: ProposedTests) -> Group:
    """Which tests should come next, what each is expected to tell and what it costs."""
    head = pairs(proposed.dataset)
    sure = "" if proposed.sure is None else f", right with a probability of {proposed.sure:.2f}"
    head.add_row("verdict", escape(f"{proposed.verdict}{sure}"))
    head.add_row("causes", escape(", ".join(f"{name} {p:.2f}" for name, p in list(proposed.posterior.items())[:SHOWN_CAUSES])))
    for test in proposed.tests:
        head.add_row("measure next", escape(f"{test.protocol}: {worth_of(test)}"))
    if not proposed.tests:
        head.add_row("measure next", "no test within the limits of the rig is expected to tell much of what is open")
    return Group(head, file_lines([("file", path) for path in proposed.files]))


def _shown(title: str, rows: list[EffectInTest]) -> Table:
    """How strong each effect has to be, and what the constants would take for it up to there."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("effect", no_wrap=True)
    table.add_column("strength")
    for column in ("shows from", "plausible up to"):
        table.add_column(column, justify="right")
    table.add_column("weaker it hides in")
    for row in rows:
        hides = ", ".join(f"{name.removesuffix('_Pa')} {100 * share:+.0f} %" for name, share in row.hides_in.items())
        table.add_row(escape(row.effect), escape(strength_in_words(row)), bare(row.smallest), bare(row.largest_plausible), hides)
    return table


def _apart(rows: list[EffectInTest]) -> Table:
    """What each effect can be taken for at its largest plausible strength."""
    table = Table(
        title="what it tells apart, at the largest plausible strength",
        title_justify="left",
        caption="distance: squared, over the noise; 25 is enough",
        caption_justify="left",
    )
    table.add_column("effect", no_wrap=True)
    table.add_column("cannot be told from")
    table.add_column("nearest that it is told from")
    table.add_column("distance", justify="right")
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
