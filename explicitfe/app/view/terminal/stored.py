"""Contents of a result file in the terminal: the output of ``explicitfe inspect``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.kinds import KINDS
from explicitfe.app.view.terminal.measures import measure_rows
from explicitfe.app.view.terminal.rows import StoredTimes, pairs, physics_rows, spaced
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.measure.document import Measures

PACKAGES = ("explicitfe", "python", "numpy", "numba", "h5py")
ENERGIES = (
    "internal_energy",
    "hourglass_energy",
    "barrier_energy",
    "kinetic_energy",
    "contact_energy",
    "tied_energy",
    "external_work",
    "damping_loss",
    "material_loss",
    "contact_loss",
)


def result_table(held: Mapping[str, Any], measures: Measures | None = None) -> Group:
    """Contents of a result file, with the measures at its end."""
    table = pairs(held["model"].get("scenario", {}).get("title", ""))
    run, last = held["summary"], held["last"]
    kind = KINDS[kind_of(held["model"])]
    state = held["status"]
    if state == "running":
        state += " (in progress)" if held["live"] else " (killed)"
    message = held["message"] or state
    table.add_row("status", escape(message if message.startswith(state) else f"{state}: {message}"))
    if held["restart"] is not None:
        restart = held["restart"]
        moment = f", stored at {restart['stored_utc']}" if restart["stored_utc"] else ""
        table.add_row("resumable", escape(f"after {restart['samples']} samples{moment}: {restart['command']}"))
    table.add_row("mesh", f"{held['elements']} hexahedra, {held['nodes']} nodes")
    table.add_row("node sets", escape(", ".join(f"{name} ({count})" for name, count in held["node_sets"].items())) or "none")
    for row in physics_rows(held["model"]):
        table.add_row(*row)
    times = "no sample"
    if held["steps"]:
        first_s, last_s = held["time_s"]
        times = kind.times_text(StoredTimes(held["steps"], first_s, last_s, held["every_s"]))
    table.add_row("times", times)
    table.add_row("fields", escape(", ".join(f"{field['name']} ({field['unit']})" for field in held["fields"])))
    energies = [f"{spaced(name)} {1e3 * last[name]:.4g} mJ" for name in ENERGIES if last.get(name)]
    if energies:
        table.add_row("last energies", "\n".join(energies))
    if "balance_error" in last:
        table.add_row("energy balance", f"relative error at most {last['balance_error']:.1e}")
    if run:
        table.add_row("hourglass share", f"at most {100 * run['hourglass_share']:.1f} % of the elastic energy")
        for row in kind.stored_rows(run):
            table.add_row(*row)
    if measures is not None:
        for row in measure_rows(measures):
            table.add_row(*row)
    provenance = held["provenance"]
    packages = ", ".join(f"{name} {provenance[name]}" for name in PACKAGES if provenance.get(name))
    commit = provenance.get("commit") and f"commit {provenance['commit']}"
    rows = [packages, commit, provenance.get("processor"), provenance.get("started_utc")]
    table.add_row("provenance", escape("\n".join(row for row in rows if row)))
    table.add_row("scenario", f"sha256 {held['scenario_sha256'][:16]}…")
    return Group(table, file_lines([("result", held["path"])]))
