"""The answer of ``close-loop`` in the terminal: verdict, errors, candidates."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.results.loop_report import LoopReport, ReportedCandidate, estimates
from explicitfe.view.report.words import FITTED_DROP, STATUSES, TRIAL_DROP, chance, how_sure, number, percent, worth_of
from explicitfe.view.terminal.files import file_lines
from explicitfe.view.terminal.rows import pairs

SHOWN_STATUSES = ("significant", "not-significant", "failed")  # candidates that were not tried are not listed


def loop_tables(report: LoopReport) -> Group:
    """The verdict, errors before and after, and the candidates of each round."""
    head = pairs(report.title or "")
    head.add_row("verdict", f"[bold]{escape(report.verdict or '')}[/bold]")
    head.add_row("", escape(report.sentence))
    if report.remainder_where:
        head.add_row("", escape(report.remainder_where))
    if report.verdict == "failed":
        return Group(head)
    if report.sure is not None:
        head.add_row("posterior", escape(how_sure(report)))
    before, after = report.baseline.error, report.final.error
    for words, errors in (("held-out curves", (before.holdout, after.holdout)), ("fitted curves", (before.fit, after.fit))):
        shares = [100.0 * error.nrmse for error in errors if error is not None and error.nrmse is not None]
        if len(shares) == 2:
            text = f"{shares[0]:.2f} % of the largest value before, {shares[1]:.2f} % after"
            head.add_row(f"error, {words}", text)
    for (name, group), estimate in estimates(report.final.parameters).items():
        label = f"{name} {group}" if group not in ("", "all") else name
        low, high = estimate.ci95
        doubt = f"; not determined: {report.undetermined[name]}" if name in report.undetermined else ""
        head.add_row(escape(label), f"{estimate.value:.4g} ({low:.4g} to {high:.4g}){doubt}")
    tables: list[RenderableType] = [head]
    for turn, reported_round in enumerate(report.steps, 1):
        shown = [row for row in reported_round.candidates if row.status in SHOWN_STATUSES]
        if shown:
            tables.append(_round_table(turn, shown, reported_round.chosen))
    end = pairs("")
    for reason in _reasons(report):
        end.add_row("not added", escape(reason))
    for test in report.proposed_tests or ([report.next_experiment] if report.next_experiment else []):
        end.add_row("measure next", escape(f"{test.protocol}: {worth_of(test)}"))
    if end.row_count:
        tables.append(end)
    return Group(*tables, file_lines([("file", path) for path in report.files]))


def _round_table(turn: int, candidates: Sequence[ReportedCandidate], added: str | None) -> Table:
    """The candidates of one round."""
    table = Table(title=f"round {turn}: decrease of χ² by each candidate", title_justify="left")
    table.add_column("effect", no_wrap=True)
    table.add_column("status", min_width=len("significant"))
    for column in (TRIAL_DROP, FITTED_DROP, "p (Holm)", "cross-validated error"):
        table.add_column(column, justify="right")
    for row in candidates:
        error = "" if row.cv_nrmse is None else percent(row.cv_nrmse)
        fitted = "" if row.chi2_drop_refitted is None else number(row.chi2_drop_refitted)
        table.add_row(
            escape(row.effect or ""),
            "added" if row.effect == added else STATUSES.get(row.status or "", ""),
            number(row.chi2_drop),
            fitted,
            chance(row.p_holm, row.p_is_bound),
            error,
        )
    return table


def _reasons(report: LoopReport) -> list[str]:
    """Why significant effects of each round were not added."""
    return [
        f"round {turn}: {row.effect} is significant, {row.reason}"
        for turn, one in enumerate(report.steps, 1)
        for row in one.candidates
        if row.status == "significant" and row.effect != one.chosen and row.reason
    ]
