"""How a result differs from a recording, in the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Group
from rich.markup import escape

from explicitfe.app.view.page.tables import table
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import pairs, terminal_table
from explicitfe.results.measure.recording import ComparedAxis, ComparedSensor, RecordingComparison


def recording_tables(comparison: RecordingComparison) -> Group:
    """Registration and alignment, then the distance and the correlation of each sensor."""
    registration = comparison.registration
    head = pairs("result and recording")
    head.add_row("difference", difference_in_words(comparison))
    head.add_row("registration", escape(registration.what))
    if registration.residual_mm is not None:
        shift = ", ".join(f"{value:.2f}" for value in registration.translation_mm)
        residual = f"residual {registration.residual_mm:.2f} mm rms"
        head.add_row("", f"rotation {registration.rotation_deg:.2f}°, translation ({shift}) mm, {residual}")
    if registration.head_sensors:
        head.add_row("", escape(f"motion of {', '.join(registration.head_sensors)} removed first"))
    fitted = " (fitted)" if comparison.offset_fitted else ""
    span = f"{comparison.first_ms:.4g} to {comparison.last_ms:.4g} ms"
    head.add_row(
        "time", f"{comparison.rows} rows, {span}; the simulation starts at {comparison.offset_s:.4f} s{fitted} of the recording"
    )
    axes = ("forward\n(mm, r)", "up\n(mm, r)", "right\n(mm, r)")
    rows = [(name, point.sensor, *_cells(point)) for name, point in comparison.points.items()]
    shown = terminal_table(
        "rms distance, and rms after centring the paths; rms and correlation r of coordinates",
        table(("point", "sensor", "rms\n(mm)", "centred\n(mm)", *axes), rows, "ttnnnnn"),
    )
    files = [("result", comparison.result.result), ("recording", comparison.recording)]
    if comparison.picture is not None:
        files.append(("picture", comparison.picture))
    return Group(head, shown, file_lines(files))


def difference_in_words(comparison: RecordingComparison) -> str:
    """The distance of model and recording in one sentence."""
    centred = f"{comparison.centred_rms_mm:.2f} mm after each path is shifted to its mean"
    movement = f"the recorded positions vary by {comparison.movement_rms_mm:.2f} mm"
    return f"{comparison.rms_mm:.2f} mm rms over all sensors, {centred}; {movement}"


def _cells(point: ComparedSensor) -> Iterator[str]:
    yield f"{point.rms_mm:.2f}"
    yield f"{point.centred_rms_mm:.2f}"
    for axis in (point.forward, point.up, point.right):
        yield "" if axis is None else _axis(axis)


def _axis(axis: ComparedAxis) -> str:
    """Rms in mm and correlation of a coordinate; a dash for a coordinate that does not move."""
    return f"{axis.rms_mm:.2f}, " + ("–" if axis.correlation is None else f"{axis.correlation:.3f}")
