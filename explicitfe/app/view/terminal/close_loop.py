"""The answer of ``close-loop`` in the terminal: verdict, causes, errors, parameters and the next test."""

from __future__ import annotations

from dataclasses import replace

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.close_loop.motion_tables import error_table
from explicitfe.app.view.page.close_loop.parts import SHARE_HEAD, causes
from explicitfe.app.view.page.close_loop.reading import has_changed
from explicitfe.app.view.page.words import how_sure, percent, with_interval, worth_of
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table
from explicitfe.results.documents.loop_report import LoopReport, estimates
from explicitfe.results.documents.verdict_text import sentence

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
        tables.append(terminal_table("rms distance of the markers", error_table(report)))
    return Group(*tables, file_lines([("file", path) for path in report.files]))


def _causes(report: LoopReport) -> Table:
    """The most probable causes, and how many others are absent or cannot be tested."""
    tested = [one for one in report.causes.values() if one.decision != "not-testable"]
    shown = [k for k, one in enumerate(tested) if k < MOST_CAUSES_PRINTED or one.decision != "absent"]
    more, untested = len(tested) - len(shown), len(report.causes) - len(tested)
    notes = [f"{more} more absent" if more else "", f"{untested} not testable with these data" if untested else ""]
    all_causes = causes(report)
    few = None if all_causes is None else replace(all_causes, rows=[all_causes.rows[k] for k in shown])
    return terminal_table("causes", few, "; ".join(filter(None, notes)), without=SHARE_HEAD)
