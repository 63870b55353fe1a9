"""Answer of ``identify`` in the terminal: constants, comparison of laws, curves, and sensitivity to the assumptions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.words import number
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs
from explicitfe.results.documents.identification import Identification, IdentifiedGroup, changes_of


def identification_tables(identification: Identification) -> Group:
    """Tables of each group: constants, laws, curves, and sensitivity to the assumptions."""
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
        if len(group["laws"]) > 1:
            tables.append(_laws(group))
        tables.append(_curves(group))
        if group["hides"]:
            tables.append(_hides(group))
    end = pairs("")
    end.add_row("simulations", f"{identification['forward_runs']}, {identification['wall_s']:.1f} s in total")
    return Group(*tables, end, file_lines([("file", path) for path in identification["files"]]))


def identification_notes(identification: Identification) -> Iterator[str]:
    """Warnings, sentence by sentence."""
    several = len(identification["groups"]) > 1
    for name, group in identification["groups"].items():
        for warning in group["warnings"]:
            yield f"{name}: {warning}" if several else warning
    yield from identification["warnings"]


def _constants(title: str, group: IdentifiedGroup) -> Table:
    table = pairs(title)
    others = [row["law"] for row in group["laws"] if row["law"] != group["law"]]
    compared = f"; compared with {', '.join(others)}" if others else "; other laws: --law"
    if "headline" in group:
        table.add_row("conclusion", escape(group["headline"]))
    table.add_row("law", group["law"] + (compared if "paper" not in group else ""))
    for name, entry in group["constants"].items():
        unit = " Pa" if name.endswith("_Pa") else ""
        text = f"{entry['value']:.5g}{unit}"
        if "total95" in entry:
            text += f"  (95 %: {_interval(entry['total95'])})"
        if name in group["at_bound"]:
            text += "  [yellow]at its bound[/yellow]"
        table.add_row(name.removesuffix("_Pa"), text)
    for name, modulus in (("shear modulus", group["shear_modulus"]), ("Young's modulus", group["youngs_modulus"])):
        interval = f"  (95 %: {_interval(modulus['total95'])})" if "total95" in modulus else ""
        table.add_row(f"{name}, small strain", f"{modulus['value']:.5g} Pa{interval}")
    if group["widened_by"] > 1.0 and "paper" not in group:
        wider = f"{number(group['widened_by'], 2)} times wider than from independent noise alone"
        table.add_row("intervals", f"{wider}, before what was assumed is added")
    misfit = group["misfit"]
    text = f"{misfit['rms']:.3g} {group['unit']} rms, {100.0 * misfit['nrmse']:.2f} % of the largest value"
    if misfit["reduced_chi2"] is not None:
        text += f"; reduced χ² {misfit['reduced_chi2']:.3g}"
    table.add_row("misfit of the law", text)
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


def _laws(group: IdentifiedGroup) -> Table:
    table = Table(
        title="comparison of laws",
        title_justify="left",
        caption="ΔAICc, ΔBIC: difference from the best law; a law with ΔAICc above 10 has practically no support",
        caption_justify="left",
    )
    table.add_column("law", no_wrap=True)
    for head in ("shear modulus", "misfit", "held-out error", "ΔAICc", "ΔBIC"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in group["laws"]:
        if "problem" in row:
            table.add_row(row["law"], escape(row["problem"]), "", "", "", "")
            continue
        held_out = row["held_out_nrmse"]
        table.add_row(
            row["law"],
            f"{row['shear_modulus_Pa']:.5g} Pa",
            f"{100.0 * row['nrmse']:.2f} %",
            "" if held_out is None else f"{100.0 * held_out:.2f} %",
            f"{row['aicc_difference']:.1f}",
            f"{row['bic_difference']:.1f}",
        )
    return table


def _curves(group: IdentifiedGroup) -> Table:
    table = Table(title="curves", title_justify="left", caption="relative: rmse over the largest value", caption_justify="left")
    table.add_column("curve", no_wrap=True)
    for head in ("", "rows", "not used", "rmse", "relative", "max. error"):
        table.add_column(head, justify="right" if head else "left", no_wrap=True)
    for name, row in group["curves"].items():
        table.add_row(
            escape(name),
            "fitted" if row["split"] == "fit" else "held out",
            str(row["rows"]),
            str(row["rows_left_out"]),
            f"{row['rmse']:.3g} {row['unit']}",
            f"{100.0 * row['nrmse']:.2f} %",
            f"{row['largest_error']:.3g} {row['unit']}",
        )
    return table


def _hides(group: IdentifiedGroup) -> Table:
    symbols = [name.removesuffix("_Pa") for name in group["constants"]]
    table = Table(
        title="sensitivity to the assumptions: change of the constants with another assumption and the same data",
        title_justify="left",
        caption="residual: rms misfit that the constants cannot compensate; in noise: in standard deviations of a row; "
        "*: left open by the dataset, and included in the 95 % intervals",
        caption_justify="left",
    )
    table.add_column("other assumption")
    for head in (*symbols, "residual", "in noise"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in group["hides"]:
        if "problem" in row:
            table.add_row(escape(row["if"]), escape(row["problem"]), *("" for _ in range(len(symbols) + 1)))
            continue
        left = f"{1e3 * row['left']:.2g} µm" if group["unit"] == "mm" else f"{row['left']:.2g} {group['unit']}"
        changes = (f"{100.0 * change:+.1f} %" for change in changes_of(row, symbols))
        table.add_row(escape(row["if"]) + (" *" if row["left_open"] else ""), *changes, left, f"{row['left_in_noise']:.2g}")
    return table


def _interval(limits: Sequence[float | None]) -> str:
    low, high = limits
    return f"{_number(low)} to {_number(high)}"


def _number(value: float | None) -> str:
    return f"{value:.5g}" if value is not None and abs(value) < float("inf") else "no limit"
