"""Shipped files, this installation and its speed, in the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, Group, RenderResult
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.tables import table
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table, text_of
from explicitfe.platform.host.load import is_busy

if TYPE_CHECKING:
    from explicitfe.results.documents.examination import Examination
    from explicitfe.results.documents.mesh_contents import MeshContents
    from explicitfe.results.documents.run_summary import SpeedReport

# Columns with long texts, which only programs need.
ONLY_IN_JSON = ("source", "file", "folder")
MOST_LINES_PER_ROW = 3  # on average, in a table with one column per key
LINES_OF_A_FRAME = 2


class ListTable:
    """A list of the built-in objects of one kind. The first column, the name that a user types, is never cut.

    If the terminal is so narrow that most rows need many lines, the other columns are written below each other in one column.
    """

    def __init__(self, title: str, rows: Sequence[Mapping[str, object]]) -> None:
        self._title, self._rows = title, rows
        given = list(rows[0]) if rows else []
        self._columns = [column for column in given if column not in ONLY_IN_JSON]
        omitted = " and ".join(f"{column}s" for column in given if column in ONLY_IN_JSON)
        self._caption = f"{omitted}: add --json" if omitted else None

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        wide = self._wide()
        lines = len(console.render_lines(wide, options, pad=False))
        yield wide if lines <= MOST_LINES_PER_ROW * (len(self._rows) + LINES_OF_A_FRAME) else self._narrow()

    def _wide(self) -> Table:
        """One column per key."""
        table = self._table(self._columns)
        for row in self._rows:
            table.add_row(*(text_of(row[column]) for column in self._columns))
        return table

    def _narrow(self) -> Table:
        """The name, and everything else."""
        name, first, *others = self._columns
        table = self._table([name, ", ".join([first, *others])])
        for row in self._rows:
            lines = [f"{column}: {text_of(row[column])}" for column in others if row[column]]
            table.add_row(text_of(row[name]), "\n".join([text_of(row[first]), *lines]), end_section=True)
        return table

    def _table(self, columns: Sequence[str]) -> Table:
        table = Table(title=self._title, title_justify="left", caption=self._caption, caption_justify="left")
        for number, column in enumerate(columns):
            table.add_column(column, no_wrap=number == 0, overflow="fold")
        return table


def kernels_table(seconds_of: dict[str, float]) -> Table:
    """The kernels that were compiled or loaded, and the time of each."""
    rows = [(name, f"{seconds:.1f}") for name, seconds in seconds_of.items()]
    return terminal_table("compiled kernels", table(("kernels", "seconds"), rows, "tn"))


def new_scenario_table(scenario: Mapping[str, Any]) -> Group:
    """A new scenario file."""
    table = pairs(scenario["title"])
    if scenario["like"]:
        table.add_row("copy of", escape(scenario["like"]))
    for name, force_N in scenario["muscles"].items():
        table.add_row(f"muscle {escape(name)}", f"{force_N:g} N")
    return Group(table, file_lines([("file", scenario["scenario"])]))


# State of a finding -> its markup.
_STATES = {"good": "[green]good[/green]", "attention": "[yellow]attention[/yellow]", "absent": "[dim]absent[/dim]"}


def examination_table(examination: Examination) -> Table:
    """Findings on this installation."""
    table = Table(title="this installation", title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for one in examination["findings"]:
        table.add_row(escape(one["name"]), _STATES[one["state"]], escape(one["value"]))
    return table


def speed_tables(speed: SpeedReport) -> Group:
    """Speed of the kernels and of a scenario on this machine."""
    threads = max((row["threads"] or 1 for row in speed["rows"]), default=1)
    rows = []
    for row in speed["rows"]:
        known, shared = row["reference_ns"], row["ns_threads"]
        documented = ("", "") if known is None else (f"{known:.0f}", f"{row['ns'] / known:.2f}")
        faster = ("", "") if shared is None else (f"{shared:.1f}", f"{row['ns'] / shared:.2f}")
        rows.append((str(row["elements"]), row["element"], f"{row['ns']:.1f}", *documented, *faster))
    head = ("hexes", "element", "1 thread", "documented", "ratio", f"{threads} threads", "faster")
    title = f"ns per element and step, float64, {speed['lanes']} lanes, {speed['cores']} cores"
    shown = terminal_table(title, table(head, rows, "ntnnnnn"))
    spoken = speed["scenario"]
    line = (
        f"{spoken['name']}: {spoken['hexes']} hexahedra, {spoken['steps']} time steps in {1e3 * spoken['loop_s']:.0f} ms, "
        f"{spoken['real_time_factor']:.2f} × real time"
    )
    return Group(shown, line)


def speed_notes(speed: SpeedReport) -> list[str]:
    """Notes on the measured times: whether other processes used the processor."""
    if speed["load"] is None or not is_busy(speed["load"]):
        return []
    return [
        f"the machine was busy: load average {speed['load']:.1f} on {speed['cores']} cores. The times are longer than on an idle "
        "machine; repeat the measurement when it is idle."
    ]


def mesh_table(contents: MeshContents) -> Table:
    """Contents of a mesh file."""
    table = pairs(escape(contents["mesh"]))
    cells = ", ".join(f"{count} {name}" for name, count in contents["cells"].items())
    cut = "" if "hexahedra" in cells and len(contents["cells"]) == 1 else f", cut into {contents['hexahedra']} hexahedra"
    table.add_row("elements", f"{cells}{cut}")
    table.add_row("nodes", str(contents["nodes"]))
    low, high = contents["lowest"], contents["highest"]
    table.add_row("extent", ", ".join(f"{axis} {a:g} to {b:g}" for axis, a, b in zip("xyz", low, high, strict=True)))
    table.add_row("volume", f"{contents['volume']:.6g} (cubed unit of the file)")
    table.add_row("worst element", f"scaled Jacobian {contents['smallest_scaled_jacobian']:.3g}")
    if contents["fault"]:
        table.add_row("cannot be computed", escape(contents["fault"]))
    for what, sets in (("node sets", contents["node_sets"]), ("element sets", contents["element_sets"])):
        table.add_row(what, escape("\n".join(f"{name} ({count})" for name, count in sets.items())) or "none")
    for array in contents["arrays"]:
        if array["name"] in contents["node_sets"] or array["name"] in contents["element_sets"]:
            continue
        values = ", ".join(f"{value} ({count})" for value, count in array["counts"].items())
        span = values or f"{array['lowest']:g} to {array['highest']:g}"
        table.add_row(f"{array['of']} array", escape(f"{array['name']}: {span}"))
    return table


def new_model_table(model: str, scenario: str, contents: MeshContents, volume_ratio: float | None) -> Group:
    """A new model: what is in its mesh, and its files."""
    table = mesh_table(contents)
    if volume_ratio is not None:
        table.add_row("volume", f"{100.0 * volume_ratio:.1f} % of that inside the surface; smaller elements follow it closer")
    files = [("mesh", contents["mesh"]), ("model", model), ("scenario", scenario)]
    return Group(table, file_lines(files))
