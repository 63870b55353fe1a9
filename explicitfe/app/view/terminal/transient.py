"""Tables of a run in time in the terminal: its summary, its check before the run, and its stored result."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.page.words import motion_at_end, speed, steps_in_words
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import TIP, StoredTimes, add_mesh_rows, inverted_text, moved, pairs, size_text, with_files
from explicitfe.results.documents.run_summary import TransientCheckReport, TransientSummary


def summary_table(summary: TransientSummary) -> Group:
    """Summary of a run in time."""
    table = pairs(summary["title"])
    table.add_row("status", summary["status"])
    table.add_row("mesh", f"{summary['hexes']} hexahedra, {summary['nodes']} nodes")
    limit = f"at most {100 * summary['dt_fraction_of_limit']:.0f} % of the stability limit"
    exceeded = "[red], which is exceeded[/red]" if (summary["dt_fraction_of_limit"] or 0.0) > 1.0 else ""
    table.add_row("time steps", f"{steps_in_words(summary['steps'], summary['dt_s'])} ({limit}{exceeded})")
    table.add_row(
        "speed",
        f"{1e3 * summary['simulated_s']:.1f} ms in {summary['wall_s']:.2f} s: "
        f"{summary['real_time_factor']:.2g} × real time, "
        f"time steps alone {summary['simulated_s'] / max(summary['loop_s'], 1e-9):.2g} × "
        f"(compilation: {summary['compile_s']:.1f} s)",
    )
    table.add_row("energy balance", f"relative error at most {summary['energy_balance_error']:.1e}")
    table.add_row("hourglass share", f"at most {100 * summary['hourglass_share']:.1f} % of the elastic energy")
    table.add_row("minimum J", f"{summary['min_J']:.3f}")
    table.add_row("inverted", inverted_text(summary))
    table.add_row("at the end", motion_at_end(summary["settled"], summary["largest_speed_mm_s"]))
    for name, probe in summary["probes"].items():
        motion = moved(probe["forward_mm"], probe["up_mm"], probe["right_mm"], anatomical=TIP in summary["probes"])
        table.add_row(escape(name), f"{motion}, at {speed(probe['speed_mm_s'])} mm/s")
    return with_files(table, summary)


def check_table(file: str, report: TransientCheckReport) -> Group:
    """Check of a run in time, before it is run."""
    table = pairs(str(report["scenario"].get("title", "")))
    add_mesh_rows(table, report)
    table.add_row("probes", escape(", ".join(report["probes"])) or "none")
    table.add_row(
        "time step",
        f"{report['step_us']:.4g} µs, {'stable' if report['stable'] else '[red]unstable[/red]'}: the limit is "
        f"{report['stable_step_us']:.4g} µs\n"
        f"(at least {report['stable_step_bound_us']:.4g} µs, by element {report['limiting_element']})",
    )
    table.add_row("prediction", f"{report['predicted_steps']} steps in {report['predicted_wall_s']:.2g} s at this time step")
    table.add_row("size", size_text(report))
    return Group(table, file_lines([("scenario", file)]))


def times_text(times: StoredTimes) -> str:
    """Number of stored samples, their first and last time, and their interval."""
    first_ms, last_ms = 1e3 * times.first_s, 1e3 * times.last_s
    text = f"{times.samples} sample{'s' if times.samples > 1 else ''}, {first_ms:.4g} to {last_ms:.4g} ms"
    return text if times.every_s is None else f"{text}, every {1e3 * times.every_s:.3g} ms"


def stored_rows(summary: TransientSummary) -> Iterator[tuple[str, str]]:
    """Motion of a stored run at its end."""
    yield "at the end", motion_at_end(summary["settled"], summary["largest_speed_mm_s"])
