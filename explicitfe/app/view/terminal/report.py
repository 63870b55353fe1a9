"""Output of ``explicitfe report`` in the terminal."""

from __future__ import annotations

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.page.run.write import ReportAnswer
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs


def report_table(answer: ReportAnswer) -> Group:
    """The page, and the checks of each result."""
    table = pairs("report")
    several = len(answer["results"]) > 1
    labels = [f"result {number}" if several else "result" for number in range(1, len(answer["results"]) + 1)]
    for label, run in zip(labels, answer["results"], strict=True):
        reasons = "\n".join(f"- {reason}" for reason in run["reasons"])
        table.add_row(
            f"checks{label.removeprefix('result')}", "all passed" if run["checks_passed"] else f"failed:\n{escape(reasons)}"
        )
    if several:
        table.add_row("differing keys", escape(", ".join(answer["differing_keys"])) or "none")
    table.add_row("size", f"{answer['size_MB']:.1f} MB")
    return Group(
        table,
        file_lines(
            [*((label, run["result"]) for label, run in zip(labels, answer["results"], strict=True)), ("page", answer["report"])]
        ),
    )
