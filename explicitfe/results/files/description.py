"""A result in a few lines of text, as an interactive session shows it."""

from __future__ import annotations

from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files.recorded import Recorded

MOST_NAMES_SHOWN = 12


def description_of(result: Recorded) -> str:
    """What a result is, and what can be read from it."""
    scenario = result.model.get("scenario", {})
    times_ms = 1e3 * result.times
    lines = [f"Result {str(result.path)!r}: {result.status}"]
    if title := scenario.get("title"):
        lines.append(f"  {title}")
    samples = f"{len(times_ms)} samples"
    if len(times_ms):
        unit = "ms" if kind_of(result.model) == "transient" else "ms of test time"
        samples += f" from {times_ms[0]:g} to {times_ms[-1]:g} {unit}"
    lines.append(f"  {result.mesh.element_count} elements, {result.mesh.node_count} nodes; {samples}")
    for words, names in (
        ("fields", result.fields),
        ("named points", result.mesh.named_points),
        ("node sets", result.mesh.node_sets),
        ("bones", result.bones),
    ):
        if names:
            listed = [*names][:MOST_NAMES_SHOWN]
            more = f" and {len(names) - len(listed)} more" if len(names) > len(listed) else ""
            lines.append(f"  {words}: {', '.join(listed)}{more}")
    return "\n".join(lines)
