"""Datasets in the terminal: a new dataset, and the check of a dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.page.tables import table
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table, text_of
from explicitfe.results.documents.dataset_check import MATERIAL_TESTS, ColumnRange, DatasetCheckReport


def new_dataset_table(dataset: Mapping[str, Any]) -> Group:
    """A new dataset: the origin of each column, and its curves."""
    table = pairs("")
    table.add_row("test", dataset["test"])
    for name, column in dataset["columns"].items():
        table.add_row(escape(name), escape(column if dataset["test"] == "trajectory" else f"from {column}"))
    for curve in dataset["curves"]:
        text = f"{curve['rows']} rows, {curve['duration_s']:.4g} s, from {Path(curve['source']).name}"
        table.add_row(f"curve {escape(curve['id'])}", escape(text))
    return Group(table, file_lines([("dataset", dataset["dataset"])]))


def dataset_check_tables(report: DatasetCheckReport) -> Group:
    """A dataset: specimen and tool or scenario and sensors, its curves, and the effects that they can show."""
    head = pairs(report["title"])
    head.add_row("test", report["test"])
    for name, tables in (("specimen", report["specimens"]), ("tool", report["tools"])):
        for described in tables:
            head.add_row(name, _described(described))
    if report["scenario"] is not None:
        head.add_row("scenario", escape(Path(report["scenario"]).name))
    if report["sensors"]:
        head.add_row("sensors", escape(", ".join(f"{sensor} on {point}" for sensor, point in report["sensors"].items())))
    head.add_row("held out", escape(report["rule"]))
    if report["can_show"]:
        head.add_row("can show", escape(", ".join(report["can_show"])))
    for hidden in report["cannot_show"]:
        head.add_row("cannot show", escape(f"{hidden['effect']}: requires {hidden['needs']}"))
    for name, words in (("source", report["source"]), ("license", report["license"])):
        if words:
            head.add_row(name, escape(words))
    of_material, rows = report["test"] in MATERIAL_TESTS, []
    for curve in report["curves"]:
        imposed = [column for column in curve["columns"] if column["column"] == curve["imposed"]]
        read = [column for column in curve["columns"] if column not in imposed]
        noise = curve["noise_sd"]
        rows.append(
            (
                curve["id"],
                f"{curve['side']}: {curve['why']}" if curve["why"] else curve["side"],
                str(curve["rows"]),
                f"{curve['duration_s']:.4g} s",
                _ranges(imposed) if of_material else "",
                _ranges(read),
                "not stated" if noise is None else f"{noise:.3g} {read[0]['unit']}" if read else f"{noise:.3g}",
            )
        )
    columns = ("curve", "use", "rows", "time", "imposed", "measured" if of_material else "movement", "noise")
    return Group(head, terminal_table("curves", table(columns, rows, "ttnnttn")))


def _described(table: Mapping[str, Any]) -> str:
    """A table of a specimen or a tool: its shape first, without default values."""
    shown = {key: value for key, value in table.items() if key not in ("shape", "assumed") and value not in (0.0, 1.0)}
    text = ", ".join([str(table["shape"]), text_of(shown)]) if shown else str(table["shape"])
    return text + (f"; assumed: {escape(', '.join(table['assumed']))}" if table.get("assumed") else "")


def _ranges(columns: Sequence[ColumnRange]) -> str:
    return "\n".join(_range(column) for column in columns)


def _range(column: ColumnRange) -> str:
    """Range of a column. N, mm and Pa identify it; a number without a unit and a sensor are named."""
    extent = f"{column['least']:.4g} to {column['largest']:.4g}"
    if column["unit"] == "1":
        return f"{column['column'].replace('_', ' ')} {extent}"
    named = "" if column["column"].endswith(("_m", "_N", "_Pa")) else f"{column['column'].partition(' ')[0]} "
    return f"{named}{extent} {column['unit']}"
