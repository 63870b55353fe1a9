"""Terminal output of ``verify``: claims, references, deviations."""

from __future__ import annotations

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.words import bare
from explicitfe.app.view.terminal.rows import pairs
from explicitfe.results.documents.verification import Verification


def verification_tables(verification: Verification) -> Group:
    """One row per claim, and the number of claims that hold."""
    table = Table(title=f"explicitfe {escape(verification['version'] or '')}: validation", title_justify="left", show_lines=True)
    table.add_column("claim and reference", overflow="fold")
    table.add_column("result", overflow="fold")
    table.add_column("deviation", max_width=11)
    table.add_column("allowed", max_width=11)
    table.add_column("", no_wrap=True)
    for row in verification["claims"]:
        evidence = f"[dim]{escape(row['evidence'])}: {escape(row['reference'])}[/dim]"
        table.add_row(
            f"[bold]{escape(row['name'])}[/bold] {escape(row['claim'])}\n{evidence}",
            escape(row["measured"] or row["message"]),
            "-" if row["off"] is None else escape(deviation_in_words(row["off"], row["unit"])),
            escape(deviation_in_words(row["allowed"], row["unit"])),
            "[green]holds[/green]" if row["holds"] else "[bold red]fails[/bold red]",
        )
    end = pairs("")
    end.add_row("claims that hold", f"{verification['holding']} of {len(verification['claims'])}")
    end.add_row("duration", f"{verification['wall_s']:.0f} s")
    return Group(table, end)


def deviation_in_words(off: float, unit: str) -> str:
    """A deviation with its unit; a share in per cent unless it is below 1e-4."""
    if unit and not unit.startswith("of "):
        return f"{bare(off)} {unit}"
    return f"{bare(100.0 * off)} %" if off >= 1e-4 or off == 0.0 else bare(off)
