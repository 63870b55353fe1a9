"""Tables of an indentation in the terminal: its summary, its check before the run, and its stored result."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group

from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import StoredTimes, add_mesh_rows, inverted_text, pairs, size_text, with_files
from explicitfe.results.documents.run_summary import IndentationCheckReport, IndentationSummary


def summary_table(summary: IndentationSummary) -> Group:
    """Summary of an indentation."""
    table = pairs(summary["title"])
    table.add_row("status", summary["status"])
    table.add_row(
        "mesh",
        f"{summary['hexes']} hexahedra, {summary['nodes']} nodes; the specimen consists of {summary['copies']:g} symmetric parts",
    )
    for load, point in zip(summary["loads"], summary["curve"], strict=True):
        table.add_row(
            f"{point['force_N']:.4g} N",
            f"{point['displacement_mm']:.4f} mm after {load['iterations']} iterations, residual {load['residual']:.1e}",
        )
    if summary["touch_mm"]:
        table.add_row("gravity", f"first contact {summary['touch_mm']:.3f} mm below the reference height")
    table.add_row(
        "speed", f"{summary['iterations']} iterations in {summary['wall_s']:.2f} s (compilation: {summary['compile_s']:.1f} s)"
    )
    table.add_row("base reaction", f"differs from the tool force by {summary['reaction_error']:.1e} (relative)")
    table.add_row("penetration", f"at most {summary['penetration_ratio']:.1e} of the indentation")
    table.add_row(
        "energy balance", f"relative error {summary['energy_balance_error']:.1e}: stored energy against the area under the curve"
    )
    table.add_row("hourglass share", f"at most {100 * summary['hourglass_share']:.1f} % of the elastic energy")
    table.add_row("minimum J", f"{summary['min_J']:.3f}")
    table.add_row("inverted", inverted_text(summary))
    return with_files(table, summary)


def check_table(file: str, report: IndentationCheckReport) -> Group:
    """Check of an indentation, before it is run."""
    table = pairs(str(report["scenario"].get("title", "")))
    add_mesh_rows(table, report)
    table.add_row(
        "prediction",
        f"{report['predicted_iterations']} iterations in about {report['predicted_wall_s']:.2g} s for {report['loads']} loads",
    )
    table.add_row("size", size_text(report))
    return Group(table, file_lines([("scenario", file)]))


def times_text(times: StoredTimes) -> str:
    """Number of stored equilibria, and their first and last time."""
    return f"{times.samples} equilibria, {times.first_s:.4g} to {times.last_s:.4g} s"


def stored_rows(summary: IndentationSummary) -> Iterator[tuple[str, str]]:
    """The load steps that a stored run reached."""
    points = [f"{point['force_N']:.4g} N at {point['displacement_mm']:.4f} mm" for point in summary["curve"]]
    yield "loads", "\n".join(points) or "none"
