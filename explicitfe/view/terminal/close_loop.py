"""What ``close-loop`` and ``design-test`` say, in the terminal: the verdict, errors, candidates, what a test can show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from explicitfe.view.terminal.rows import pairs


def loop_tables(report: Mapping[str, Any]) -> Group:
    """What ``close-loop`` report: the verdict, errors before and after, candidates."""
    head = pairs(report["title"])
    head.add_row("verdict", f"[bold]{escape(report['verdict'])}[/bold], what is left: {report['remainder']}")
    head.add_row("", escape(report["sentence"]))
    if report["remainder_where"]:
        head.add_row("", escape(report["remainder_where"]))
    if report["verdict"] == "failed":
        return Group(head)
    for side, words in (("holdout", "held-out curves"), ("fit", "fitted curves")):
        before, after = report["baseline"]["error"][side], report["final"]["error"][side]
        if before and after:
            text = f"{100 * before['nrmse']:.2f} % of the largest value before, {100 * after['nrmse']:.2f} % after"
            head.add_row(f"error, {words}", text)
    for name, value in report["final"]["parameters"].items():
        for group, entry in value.items() if "value" not in value else [("", value)]:
            low, high = entry["ci95"]
            label = f"{name} {group}" if group not in ("", "all") else name
            head.add_row(escape(label), f"{entry['value']:.4g} ({low:.4g} to {high:.4g})")
    tables: list[Any] = [head]
    for number, step in enumerate(report["steps"], 1):
        table = Table(title=f"step {number}: what would explain the rest", title_justify="left")
        for column in ("effect", "status", "chi² drop", "p (Holm)", "cross-validated error"):
            table.add_column(column, no_wrap=column == "effect")
        shown = [row for row in step["candidates"] if row["status"] in ("significant", "not-significant", "failed")]
        for row in shown:
            chosen = " (added)" if row["effect"] == step["chosen"] else ""
            drop = row["chi2_drop"] if row["chi2_drop_refitted"] is None else row["chi2_drop_refitted"]
            error = "" if row["cv_nrmse"] is None else f"{100 * row['cv_nrmse']:.2f} %"
            table.add_row(row["effect"] + chosen, row["status"], f"{drop:.1f}", f"{row['p_holm']:.2g}", error)
        if shown:
            tables.append(table)
    end = pairs("")
    if report["next_experiment"]:
        entry = report["next_experiment"]
        text = f"{entry['protocol']}: tells {' from '.join(entry['separates'])} ({entry['separation']:.3g}, 25 is enough)"
        end.add_row("measure next", escape(text))
    for path in report.get("files", []):
        end.add_row("file", escape(path))
    return Group(*tables, end)


def design_table(design: Mapping[str, Any]) -> Table:
    """What a planned test can find and tell apart."""
    table = Table(title=design["protocol"], title_justify="left")
    for column in ("effect", "smallest that shows", "largest plausible", "hides in", "cannot be told from"):
        table.add_column(column, no_wrap=column == "effect", overflow="fold")
    for row in design["effects"]:
        if not row["shows"]:
            table.add_row(row["effect"], "no", "", escape(row["reason"]), "")
            continue
        hides = ", ".join(f"{name.removesuffix('_Pa')} {100 * share:+.0f} %" for name, share in row["hides_in"].items())
        smallest = "-" if row["smallest"] is None else f"{row['smallest']:.3g}"
        rivals = ", ".join(row["cannot_tell_from"]) or f"(nearest: {row['nearest']}, {row['separation']:.3g})"
        table.add_row(f"{row['effect']}", smallest, f"{row['largest_plausible']:.3g}", hides, rivals)
    return table
