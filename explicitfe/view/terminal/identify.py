"""What ``identify`` found, in the terminal: constants, curves, and what the fit hides."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.results.identification import Identification, IdentifiedGroup
from explicitfe.view.report.words import number
from explicitfe.view.terminal.files import file_lines
from explicitfe.view.terminal.rows import pairs


def identification_tables(identification: Identification) -> Group:
    """What ``identify`` returned: constants, curves, what the fit hides, group after group."""
    tables: list[RenderableType] = []
    for name, group in identification["groups"].items():
        several = len(identification["groups"]) > 1
        title = f"{identification['title']}: {name}" if several else identification["title"]
        if "constants" not in group:
            failed = pairs(title)
            failed.add_row("[red]failed[/red]", escape(group["message"]))
            tables.append(failed)
            continue
        tables.append(_constants(title, group))
        tables.append(_curves(group))
        if group["hides"]:
            tables.append(_hides(group))
    end = pairs("")
    end.add_row("forward runs", f"{identification['forward_runs']}, {identification['wall_s']:.1f} s in all")
    return Group(*tables, end, file_lines([("file", path) for path in identification["files"]]))


def identification_notes(identification: Identification) -> Iterator[str]:
    """What a reader must know, sentence by sentence."""
    several = len(identification["groups"]) > 1
    for name, group in identification["groups"].items():
        for warning in group["warnings"]:
            yield f"{name}: {warning}" if several else warning
    yield from identification["warnings"]


def _constants(title: str, group: IdentifiedGroup) -> Table:
    table = pairs(title)
    for name, entry in group["constants"].items():
        text = f"{entry['value']:.5g} Pa"
        if "ci95" in entry:
            low, high = entry["ci95"]
            text += f"  (95 %: {low:.5g} to {_number(high)}"
            if group["widened_by"] > 1.0:
                text += f", {number(group['widened_by'], 2)} times as wide as from noise alone"
            text += ")"
        if name in group["at_bound"]:
            text += "  [yellow]at its bound[/yellow]"
        table.add_row(name.removesuffix("_Pa"), text)
    if group["correlation"] is not None:
        table.add_row("correlation", f"{group['correlation']:+.2f}")
    unit = group["unit"]
    noise = f"{group['noise_sd']:.2g} {unit} ({group['noise']}); numerical {group['numerical_sd']:.2g} {unit}"
    table.add_row("noise", noise)
    if group["chi2"] is not None:
        table.add_row("χ²", f"{group['chi2']:.4g} with {group['degrees_of_freedom']} degrees of freedom")
    if "paper" in group:
        paper = group["paper"]
        table.add_row(
            "paper's method",
            f"{group['status']} in {len(paper['trace'])} runs "
            f"(α {1e3 * paper['alpha_mm']:g} µm, β {1e3 * paper['beta_mm']:g} µm)",
        )
        table.add_row(
            "verdict",
            f"{sum(paper['within'])} of {len(paper['within'])} points within {paper['tolerance']}; "
            f"largest error {100.0 * paper['largest_relative_error']:.2g} %",
        )
    table.add_row("assumed", escape(", ".join(group["assumed"])))
    return table


def _curves(group: IdentifiedGroup) -> Table:
    table = Table(title="curves", title_justify="left")
    table.add_column("curve", no_wrap=True)
    for head in ("", "rows", "rmse", "of the largest value", "largest error"):
        table.add_column(head, justify="right" if head else "left")
    for name, row in group["curves"].items():
        left = f" (+{row['rows_left_out']} not used)" if row["rows_left_out"] else ""
        table.add_row(
            escape(name),
            "fitted" if row["split"] == "fit" else "predicted",
            f"{row['rows']}{left}",
            f"{row['rmse']:.3g} {row['unit']}",
            f"{100.0 * row['nrmse']:.2f} %",
            f"{row['largest_error']:.3g} {row['unit']}",
        )
    return table


def _hides(group: IdentifiedGroup) -> Table:
    table = Table(
        title="what the fit hides: with this instead of what was assumed, the same data would give",
        title_justify="left",
        caption="left: rms of the residual by which it could be told",
        caption_justify="left",
    )
    table.add_column("if")
    for head in ("C10", "C20", "left", "in noise"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in group["hides"]:
        if "problem" in row:
            table.add_row(escape(row["if"]), escape(row["problem"]), "", "", "")
            continue
        left = f"{1e3 * row['left']:.2g} µm" if group["unit"] == "mm" else f"{row['left']:.2g} {group['unit']}"
        changes = (f"{100.0 * change:+.1f} %" for change in (row["C10_change"], row["C20_change"]))
        table.add_row(escape(row["if"]), *changes, left, f"{row['left_in_noise']:.2g}")
    return table


def _number(value: float) -> str:
    return f"{value:.5g}" if value < float("inf") else "no limit"
