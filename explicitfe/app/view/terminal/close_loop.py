"""The answer of ``close-loop`` in the terminal: verdict, causes, errors, parameters and the next test."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.close_loop.motion_tables import motion_errors
from explicitfe.app.view.page.close_loop.reading import has_changed
from explicitfe.app.view.page.words import how_sure, number, percent, with_interval, worth_of
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs
from explicitfe.results.documents.loop_report import LoopReport, estimates
from explicitfe.results.documents.verdict_text import cause_title, named_forms, probability, sentence, strength

# Absent causes are listed until the table has so many rows.
MOST_CAUSES_PRINTED = 8


def loop_tables(report: LoopReport) -> Group:
    """The verdict, the causes with their probabilities, the best model and its errors, and the next test."""
    head = pairs(report.title or "")
    head.add_row("verdict", f"[bold]{escape(report.verdict or '')}[/bold]")
    head.add_row("", escape(sentence(report)))
    if report.remainder_where:
        head.add_row("", escape(report.remainder_where))
    if report.verdict == "failed":
        return Group(head)
    if sure := how_sure(report):
        head.add_row("", escape(sure))
    tables: list[RenderableType] = [head]
    if report.causes:
        tables.append(_causes(report))
    end = pairs("")
    for (name, group), estimate in estimates(report.final.parameters).items():
        label = f"{name} {group}" if group not in ("", "all") else name
        doubt = f"; not determined: {report.undetermined[name]}" if name in report.undetermined else ""
        end.add_row(escape(label), escape(f"{with_interval(estimate)}{doubt}"))
    before, after = report.baseline.error, report.final.error
    for words, errors in (("held-out curves", (before.holdout, after.holdout)), ("fitted curves", (before.fit, after.fit))):
        shares = [percent(error.nrmse) for error in errors if error is not None and error.nrmse is not None]
        if shares:
            end.add_row(f"error, {words}", " → ".join(shares if has_changed(report) else shares[:1]))
    for test in report.proposed_tests or ([report.next_experiment] if report.next_experiment else []):
        end.add_row("measure next", escape(": ".join(filter(None, (test.protocol, worth_of(test, report))))))
    if end.row_count:
        tables.append(end)
    if report.motion:
        tables.append(_motion_errors(report))
    return Group(*tables, file_lines([("file", path) for path in report.files]))


def _causes(report: LoopReport) -> Table:
    """The most probable causes, and how many others are absent or cannot be tested."""
    table = Table(title="causes", title_justify="left")
    for column in ("cause", "probability", "decision", "forms", "detectable from"):
        table.add_column(column, justify="right" if column == "probability" else "left", overflow="fold")
    tested = [(name, one) for name, one in report.causes.items() if one.decision != "not-testable"]
    for position, (name, one) in enumerate(tested):
        if position < MOST_CAUSES_PRINTED or one.decision != "absent":
            forms = ", ".join(f"{form} {probability(p)}" for form, p in named_forms(report, name).items())
            cells = (cause_title(report, name), probability(one.probability), one.decision or "", forms, strength(one))
            table.add_row(*map(escape, cells))
    more = len(tested) - table.row_count
    untested = len(report.causes) - len(tested)
    notes = [f"{more} more absent" if more else "", f"{untested} not testable with these data" if untested else ""]
    table.caption = "; ".join(filter(None, notes)) or None
    return table


def _motion_errors(report: LoopReport) -> Table:
    """The errors of curves with markers, next to the scatter of repeats."""
    changed = has_changed(report)
    table = Table(title="rms distance of the markers (mm)", title_justify="left")
    table.add_column("curve", overflow="fold")
    for column in (*(("before", "after") if changed else ("model",)), "two repeats"):
        table.add_column(column, justify="right")
    for row in motion_errors(report):
        errors = (row.before, row.after) if changed else (row.before,)
        name = f"{row.curve}, held out" if row.held_out else row.curve
        table.add_row(escape(name), *(number(x) for x in (*errors, row.repeats)))
    return table
