"""Rows and numbers of tables in the terminal, with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.terminal.files import file_lines

if TYPE_CHECKING:
    from explicitfe.app.view.page.tables import PageTable
    from explicitfe.results.documents.run_summary import CheckReport, RunSummary


# Names in the first column of a table are not folded up to this length, words of other columns and heads not up to those.
LONGEST_NAME_NOT_FOLDED, LONGEST_WORD_NOT_FOLDED, LONGEST_HEAD = 24, 10, 12


class StoredTimes(NamedTuple):
    """Times of the stored samples: their number, the first, the last and the interval, s."""

    samples: int
    first_s: float
    last_s: float
    every_s: float | None


def pairs(title: str) -> Table:
    """An empty table of names and values."""
    table = Table(title=escape(title), title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    return table


def terminal_table(title: str, shown: PageTable | None, caption: str = "", without: str = "") -> Table:
    """A table of a page in the terminal, without its bars and a column; numbers and short names are not folded."""
    table = Table(title=escape(title), title_justify="left", caption=escape(caption) or None, caption_justify="left")
    if shown is None:
        return table
    columns = [(k, one) for k, one in enumerate(shown.columns) if one.kind != "bar" and (not without or one.head != without)]
    rows = [([str(row.cells[k]) for k, _ in columns], row.chosen) for row in shown.rows]
    for place, (_, column) in enumerate(columns):
        width = max(len(line) for cells, _ in rows for line in cells[place].split("\n"))
        is_whole = column.kind == "n" or width <= (LONGEST_WORD_NOT_FOLDED if place else LONGEST_NAME_NOT_FOLDED)
        lines = wrap(column.head, max(width, LONGEST_HEAD)) if is_whole and "\n" not in column.head else [column.head]
        justify: Literal["right", "left"] = "right" if column.kind == "n" else "left"
        table.add_column(escape("\n".join(lines)), justify=justify, no_wrap=is_whole, overflow="fold")
    for cells, chosen in rows:
        table.add_row(*map(escape, cells), style="bold" if chosen else None)
    return table


def physics_rows(model: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Rows on tissue, damping, muscles and bones."""
    if "material" in model:
        material = {key: value for key, value in model["material"].items() if key != "source"}
        yield "material", f"{escape(material.pop('law'))}: {text_of(material)}"
    if "tool" in model:
        yield "tool", text_of(model["tool"])
    if "alpha_per_s" in model:
        beta_s = model.get("beta_s", 0.0)
        yield "damping", f"alpha {model['alpha_per_s']:g} 1/s" + (f", beta {beta_s:g} s" if beta_s else "")
    if "muscles" in model:
        yield "muscles", escape("\n".join(_muscle(muscle) for muscle in model["muscles"])) or "none"
    if "bones" in model:
        yield "bones", escape(", ".join(model["bones"])) or "none"
    if model.get("held_area_mm2"):
        held = (f"{name} {area_mm2:.0f} mm²" for name, area_mm2 in model["held_area_mm2"].items())
        yield "attachment areas", escape(", ".join(held))
    if model.get("surgery"):
        yield "surgery", escape(_surgery(model["surgery"]))


def _surgery(report: Mapping[str, Any]) -> str:
    """Volumes that surgery removed, grafted and stiffened, and the loss of muscle force."""
    parts = [f"{report['removed_elements']} hexahedra removed, {report['removed_mm3']:.0f} mm³"]
    if report["graft_elements"]:
        parts.append(f"{report['graft_elements']} hexahedra of grafts, {report['graft_mm3']:.0f} mm³")
    if report["scar_mm3"]:
        parts.append(f"{report['scar_mm3']:.0f} mm³ of scar")
    lost = [f"{name} {percent:.1f} %" for name, percent in report["muscle_loss_percent"].items()]
    return "; ".join(parts) + (f"\nmuscle force lost: {', '.join(lost)}" if lost else "")


def _muscle(muscle: Mapping[str, Any]) -> str:
    if muscle["profile"] == "table":
        course = f"table of {len(muscle['table'])} pairs"
    else:
        course = f"{muscle['profile']} from {muscle['start_ms']:g} ms"
        course += f" in {muscle['rise_ms']:g} ms" if muscle["rise_ms"] else ""
        course += f" to {muscle['end_ms']:g} ms" if muscle["end_ms"] is not None else ""
    how = muscle["distribution"] + ("" if muscle["distribution"] == "stress" else f", {muscle['direction']}")
    how += "" if muscle["side"] == "both" else f", {muscle['side']} side"
    return f"{muscle['name']} {muscle['force_N']:g} N: {course}; {how}"


def size_text(report: CheckReport) -> str:
    """Memory of a run and size of its result."""
    return f"{report['kernel_memory_MB']:.3g} MB in memory, {report['result_size_MB']:.3g} MB in the result"


def add_mesh_rows(table: Table, report: CheckReport) -> None:
    """Rows on model, mesh and tissue of a check."""
    table.add_row("model", escape(report["name"]))
    table.add_row(
        "mesh",
        f"{report['hexes']} hexahedra, {report['nodes']} nodes, {report['fixed_nodes']} of them fixed; "
        f"{1e-3 * report['volume_mm3']:.4g} cm³, {report['mass_g']:.4g} g",
    )
    table.add_row("edge lengths", f"{report['smallest_edge_mm']:.3g} to {report['largest_edge_mm']:.3g} mm")
    table.add_row("worst element", f"{report['worst_element']}, scaled Jacobian {report['smallest_scaled_jacobian']:.3g}")
    table.add_row("inverted", inverted_text(report))
    for row in physics_rows(report):
        table.add_row(*row)


def inverted_text(report: CheckReport | RunSummary) -> str:
    """Number of inverted elements, and whether it is certified that the others are not inverted."""
    elements, undecided = report["folded"]["elements"], report["folded"]["undecided"]
    text = f"{elements} of {report['hexes']} elements"
    return f"{text}, not certified: {undecided} more are undecided" if undecided else f"{text} (certified)"


def with_files(table: Table, summary: RunSummary) -> Group:
    """The summary of a run, with its pictures and its result file below."""
    return Group(table, file_lines([*(("plot", path) for path in summary.get("plots", [])), ("result", summary["result"])]))


TIP = "tip"  # a named point that only a tongue has
# Lateral motion below this share of the other components is omitted.
SIDEWAYS_SHARE_OF_MOTION = 0.01


def moved(forward_mm: float, up_mm: float, right_mm: float, *, anatomical: bool = True) -> str:
    """A displacement in anatomical directions, "forward 4.27, up 1.55 mm", or along the axes, "x -4.27, y 0.00, z 1.55 mm"."""
    if not anatomical:
        return f"x {-forward_mm:z.2f}, y {right_mm:z.2f}, z {up_mm:z.2f} mm"
    if abs(right_mm) > SIDEWAYS_SHARE_OF_MOTION * max(abs(forward_mm), abs(up_mm)):
        sideways = f", {'right' if right_mm > 0.0 else 'left'} {abs(right_mm):.2f}"
    else:
        sideways = ""
    return f"{_forward_up(forward_mm, up_mm)}{sideways} mm"


def forward_up(forward_mm: float, up_mm: float) -> str:
    """A displacement forward (-x) and up (+z), in words."""
    return f"{_forward_up(forward_mm, up_mm)} mm"


def _forward_up(forward_mm: float, up_mm: float) -> str:
    along, above = "forward" if forward_mm >= 0.0 else "back", "up" if up_mm >= 0.0 else "down"
    return f"{along} {abs(forward_mm):.2f}, {above} {abs(up_mm):.2f}"


def spaced(name: str) -> str:
    """The name of a column as words."""
    return name.replace("_", " ")


def text_of(value: object) -> str:
    """A value in short; a table of constants as 'C10 191.5 Pa, b 2', with the units that end its keys."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        from explicitfe.results.documents.units_of_keys import terms_of  # here: lists of names do not wait for h5py

        own_first = sorted(terms_of(value), key=lambda key: key in ("poisson", "density_kg_m3"))
        return ", ".join(_quantity(key, value[key]) for key in own_first)
    if isinstance(value, list | tuple):
        return ", ".join(text_of(inner) for inner in value)
    return "" if value is None else escape(str(value))


def _quantity(key: str, value: object) -> str:
    for ending, unit in (("_Pa", "Pa"), ("_kg_m3", "kg/m³"), ("_mm", "mm")):
        if key.endswith(ending):
            return f"{escape(key.removesuffix(ending))} {text_of(value)} {unit}"
    return f"{escape(key)} {text_of(value)}"
