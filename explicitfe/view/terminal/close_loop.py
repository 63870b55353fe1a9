"""What ``close-loop`` and ``design-test`` say, in the terminal: the verdict, errors, candidates, what a test can show."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.results.loop_report import LoopReport, ReportedCandidate, estimates
from explicitfe.results.planned_test import PlannedTest
from explicitfe.view.terminal.rows import pairs

SHOWN_STATUSES = ("significant", "not-significant", "failed")  # what was not tried says nothing


def loop_tables(report: LoopReport) -> Group:
    """What ``close-loop`` says: the verdict, errors before and after, candidates of each round."""
    head = pairs(report.title or "")
    head.add_row("verdict", f"[bold]{escape(report.verdict or '')}[/bold], what is left: {report.remainder}")
    head.add_row("", escape(report.sentence))
    if report.remainder_where:
        head.add_row("", escape(report.remainder_where))
    if report.verdict == "failed":
        return Group(head)
    before, after = report.baseline.error, report.final.error
    for words, errors in (("held-out curves", (before.holdout, after.holdout)), ("fitted curves", (before.fit, after.fit))):
        shares = [100.0 * error.nrmse for error in errors if error is not None and error.nrmse is not None]
        if len(shares) == 2:
            text = f"{shares[0]:.2f} % of the largest value before, {shares[1]:.2f} % after"
            head.add_row(f"error, {words}", text)
    for (name, group), estimate in estimates(report.final.parameters).items():
        label = f"{name} {group}" if group not in ("", "all") else name
        low, high = estimate.ci95
        head.add_row(escape(label), f"{estimate.value:.4g} ({low:.4g} to {high:.4g})")
    tables: list[RenderableType] = [head]
    for number, reported_round in enumerate(report.steps, 1):
        shown = [row for row in reported_round.candidates if row.status in SHOWN_STATUSES]
        if shown:
            tables.append(_round_table(number, shown, reported_round.chosen))
    end = pairs("")
    experiment = report.next_experiment
    if experiment is not None:
        text = f"{experiment.protocol}: tells {' from '.join(experiment.separates)} ({experiment.separation:.3g}, 25 is enough)"
        end.add_row("measure next", escape(text))
    for path in report.files:
        end.add_row("file", escape(path))
    return Group(*tables, end)


def _round_table(number: int, candidates: Sequence[ReportedCandidate], added: str | None) -> Table:
    """What would explain the residual of one round."""
    table = Table(title=f"round {number}: what would explain the rest", title_justify="left")
    for column in ("effect", "status", "chi² drop", "p (Holm)", "cross-validated error"):
        table.add_column(column, no_wrap=column == "effect")
    for row in candidates:
        drop = row.chi2_drop if row.chi2_drop_refitted is None else row.chi2_drop_refitted
        name = f"{row.effect} (added)" if row.effect == added else f"{row.effect}"
        error = "" if row.cv_nrmse is None else f"{100 * row.cv_nrmse:.2f} %"
        table.add_row(name, row.status, f"{drop:.1f}", f"{row.p_holm:.2g}", error)
    return table


def design_table(design: PlannedTest) -> Table:
    """What a planned test can find and tell apart."""
    table = Table(title=design.protocol, title_justify="left")
    for column in ("effect", "smallest that shows", "largest plausible", "hides in", "cannot be told from"):
        table.add_column(column, no_wrap=column == "effect", overflow="fold")
    for row in design.effects:
        if not row.shows:
            table.add_row(row.effect, "no", "", escape(row.reason), "")
            continue
        hides = ", ".join(f"{name.removesuffix('_Pa')} {100 * share:+.0f} %" for name, share in row.hides_in.items())
        smallest = "-" if row.smallest is None else f"{row.smallest:.3g}"
        rivals = ", ".join(row.cannot_tell_from) or f"(nearest: {row.nearest}, {row.separation or 0.0:.3g})"
        table.add_row(row.effect, smallest, f"{row.largest_plausible or 0.0:.3g}", hides, rivals)
    return table
