"""What ``explicitfe report`` wrote, in the terminal."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from explicitfe.view.run_page.write import ReportAnswer
from explicitfe.view.terminal.rows import pairs


def report_table(answer: ReportAnswer) -> Table:
    """The page, and whether each result may be quoted."""
    table = pairs("report")
    table.add_row("page", f"{escape(answer['report'])} ({answer['size_MB']:.1f} MB)")
    for run in answer["results"]:
        reasons = "\n".join(f"- {reason}" for reason in run["reasons"])
        verdict = "quotable" if run["quotable"] else f"not quotable, because\n{escape(reasons)}"
        table.add_row(escape(run["result"]), verdict)
    if len(answer["results"]) > 1:
        table.add_row("scenarios differ in", escape(", ".join(answer["differing_keys"])) or "nothing")
    return table
