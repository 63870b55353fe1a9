"""Answer of ``identify`` in the terminal: constants, comparison of laws, curves, and sensitivity to the assumptions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.identify import curves_table, facts_of, hides_table, laws_table
from explicitfe.app.view.page.words import number
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table
from explicitfe.results.documents.identification import Identification, IdentifiedGroup

LAWS_CAPTION = "ΔAICc, ΔBIC: difference from the best law; a law with ΔAICc above 10 has practically no support"
HIDES_CAPTION = (
    "residual: rms misfit that the constants cannot compensate; in noise: in standard deviations of a row; "
    "*: left open by the dataset, and included in the 95 % intervals"
)


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
        for heading, shown, caption in (
            ("comparison of laws", laws_table(group), LAWS_CAPTION),
            ("curves", curves_table(group), ""),
            ("sensitivity to the assumptions: change of the constants with the same data", hides_table(group), HIDES_CAPTION),
        ):
            if shown is not None:
                tables.append(terminal_table(heading, shown, caption))
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
    for name, text in facts_of(group):
        table.add_row(name, escape(text))
    return table


def _interval(limits: Sequence[float | None]) -> str:
    low, high = limits
    return f"{_number(low)} to {_number(high)}"


def _number(value: float | None) -> str:
    return f"{value:.5g}" if value is not None and abs(value) < float("inf") else "no limit"
