"""A sweep on the terminal."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.markup import escape

from explicitfe.app.view.page.tables import table
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table
from explicitfe.platform.host.shipped import name_of
from explicitfe.results.documents.sweep_summary import SweepMembers, SweepReport, SweepSummary

MOST_CAUSES_SHOWN = 8


def sweep_table(summary: SweepSummary) -> RenderableType:
    """The progress of a sweep: stored runs, their statuses, causes of failures, throughput, files."""
    table = pairs(f"sweep of {name_of(summary['scenario'])}")
    table.add_row("runs", f"{summary['stored']} of {summary['members']}" + ("" if summary["complete"] else ", not complete"))
    table.add_row("status", escape(", ".join(f"{count} {status}" for status, count in summary["statuses"].items())) or "none yet")
    for cause, count in list(summary["failures"].items())[:MOST_CAUSES_SHOWN]:
        table.add_row("failures", f"{count} {'time' if count == 1 else 'times'}: {escape(cause)}")
    if summary["added_muscles"]:
        words = ", ".join(summary["added_muscles"])
        table.add_row("added", escape(f"{words}: not in the scenario, with the time course of its first muscle"))
    if summary["computed"]:
        busy = summary["worker_s"] / (summary["workers"] * summary["wall_s"])
        table.add_row("computed now", f"{summary['computed']} in {summary['wall_s']:.1f} s")
        rate = f"{summary['members_per_minute']:.0f} runs per minute"
        table.add_row("throughput", f"{rate}; workers {summary['workers']}, {100 * busy:.0f} % busy")
    table.add_row("files", escape("\n".join(summary["files"])))
    return table


def runs_table(listed: SweepMembers) -> RenderableType:
    """The runs that are not computed yet."""
    rows = [(str(run["member"]), run["name"], " ".join(run["settings"])) for run in listed["members"]]
    return terminal_table(f"runs to compute for {listed['sweep']}", table(("run", "name", "settings"), rows, "ntt"))


def sweep_report_table(answer: SweepReport) -> RenderableType:
    """The page of a sweep, and the number of runs that it shows."""
    table = pairs("report of a sweep")
    table.add_row("runs", f"{answer['stored']} of {answer['members']} stored, {answer['finished']} finished")
    table.add_row("shown", f"{answer['outlines']} outlines, {answer['scattered']} points")
    table.add_row("size", f"{answer['size_MB']:.1f} MB")
    return Group(table, file_lines([("sweep", answer["sweep"]), ("page", answer["report"])]))
