"""A sweep on the terminal."""

from __future__ import annotations

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.results.sweep_summary import SweepMembers, SweepSummary
from explicitfe.view.terminal.rows import pairs

MOST_CAUSES_SHOWN = 8


def sweep_table(summary: SweepSummary) -> RenderableType:
    """What a sweep came to."""
    table = pairs(f"sweep of {summary['scenario']}")
    table.add_row("members", f"{summary['stored']} of {summary['members']}" + ("" if summary["complete"] else ", not complete"))
    table.add_row("ended", escape(", ".join(f"{count} {status}" for status, count in summary["statuses"].items())) or "none yet")
    for cause, count in list(summary["failures"].items())[:MOST_CAUSES_SHOWN]:
        table.add_row("why not", f"{count} times: {escape(cause)}")
    if summary["computed"]:
        busy = summary["worker_s"] / (summary["workers"] * summary["wall_s"])
        table.add_row("computed now", f"{summary['computed']} in {summary['wall_s']:.1f} s")
        table.add_row(
            "pace", f"{summary['members_per_minute']:.0f} a minute; workers {summary['workers']}, {100 * busy:.0f} % busy"
        )
    table.add_row("files", escape("\n".join(summary["files"])))
    return table


def members_table(listed: SweepMembers) -> RenderableType:
    """The members that are to be computed."""
    table = Table(title=escape(f"to compute for {listed['sweep']}"), title_justify="left")
    table.add_column("member", justify="right")
    table.add_column("name")
    table.add_column("settings", overflow="fold")
    for member in listed["members"]:
        table.add_row(str(member["member"]), member["name"], escape(" ".join(member["settings"])))
    return table
