"""The answer of ``design-test`` in the terminal: detectable and distinguishable effects of a planned test."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.markup import escape

from explicitfe.app.view.page.design import apart_table, shown_table
from explicitfe.app.view.page.words import worth_of
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table
from explicitfe.results.documents.planned_test import PlannedTest, ProposedTests

# So many of the most probable causes are shown.
SHOWN_CAUSES = 6
APART_CAPTION = "separation: squared distance in units of the noise; about 20 is required"


def design_tables(planned: PlannedTest) -> Group:
    """Detectable effects, distinguishable effects, and why the others are not detectable."""
    shown = [row for row in planned.effects if row.shows]
    hidden = [row for row in planned.effects if not row.shows]
    tables: list[RenderableType] = []
    if shown:
        apart = terminal_table("distinguishable effects at the largest plausible strength", apart_table(shown), APART_CAPTION)
        tables = [terminal_table(planned.protocol, shown_table(shown)), apart]
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
