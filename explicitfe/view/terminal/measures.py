"""The measures of results in the terminal: a row for each measure, a column for each result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from explicitfe.measure.document import Airway, BoneContact, Constriction, Measures, PalatogramPattern, PointMotion
from explicitfe.view.terminal.rows import forward_up, moved, pairs


def measures_table(measured: Sequence[Measures]) -> Table:
    """One result as pairs, several side by side."""
    if len(measured) == 1:
        table = pairs(measured[0].title or Path(measured[0].result).stem)
        for row in measure_rows(measured[0]):
            table.add_row(*row)
        return table
    table = Table()
    table.add_column(no_wrap=True)
    rows = [dict(measure_rows(measures)) for measures in measured]
    for measures in measured:
        table.add_column(escape(Path(measures.result).stem), overflow="fold")
    # In the order of the first result that has the row, after what precedes it there.
    names: list[str] = []
    for of in rows:
        place = 0
        for name in of:
            if name in names:
                place = names.index(name) + 1
            else:
                names.insert(place, name)
                place += 1
    for name in names:
        table.add_row(name, *(of.get(name, "") for of in rows))
    return table


def measure_rows(measures: Measures) -> Iterator[tuple[str, str]]:
    """Names and values of what was measured; lengths in mm."""
    body = measures.body
    yield "measured at", f"{measures.time_ms:.4g} ms"
    for name, point in measures.points.items():
        yield escape(name), _motion(point)
    if measures.highest is not None:
        highest = measures.highest
        yield (
            "highest point",
            f"{forward_up(highest.forward_mm, highest.up_mm)} (now {highest.behind_tip_mm:.1f} behind and "
            f"{highest.above_tip_mm:.1f} above the tip at rest)",
        )
    if measures.grooves:
        depths = " / ".join(f"{groove.depth_mm:.1f}" for groove in measures.grooves.values())
        yield "groove", f"{depths} mm ({' / '.join(measures.grooves)})"
    if measures.constriction is not None:
        yield from _constriction_rows(measures.constriction)
    if measures.airway is not None:
        yield from _airway_rows(measures.airway)
    for name, contact in measures.contact.items():
        yield f"contact: {escape(name)}", _contact(contact)
    if measures.palatogram is not None:
        yield "palatogram", _pattern(measures.palatogram.now)
    yield (
        "whole body",
        f"moved by up to {body.largest_displacement_mm:.1f} mm{_rise(body.time_to_90_ms)}; "
        f"{'settled' if body.settled else 'still moving'}, fastest node {body.fastest_mm_s:.0f} mm/s",
    )
    yield "volume", f"{body.volume_change_percent:+.2f} %"
    if body.left_right_mm is not None:
        yield "left, right", f"differ by up to {body.left_right_mm:.2g} mm"
    passed = body.self_penetration
    if passed.nodes:
        place = passed.deepest_at_rest
        assert place is not None
        yield (
            "passes through itself",
            f"[red]{passed.nodes} nodes, up to {passed.deepest_mm:.1f} mm deep[/red], at rest near "
            f"({place.back_mm:.0f}, {place.right_mm:.0f}, {place.up_mm:.0f}) mm",
        )


def _motion(point: PointMotion) -> str:
    text = moved(point.forward_mm, point.up_mm, point.right_mm)
    return f"{text}{_rise(point.time_to_90_ms)}, peak {point.peak_speed_mm_s:.0f} mm/s"


def _rise(time_ms: float | None) -> str:
    return "" if time_ms is None else f"; 90 % at {time_ms:.0f} ms"


def _constriction_rows(constriction: Constriction) -> Iterator[tuple[str, str]]:
    yield (
        "constriction",
        f"{constriction.width_mm:.1f} mm wide, {constriction.place_mm:.0f} mm behind the incisors "
        f"(at rest {constriction.width_at_rest_mm:.1f} mm, at {constriction.place_at_rest_mm:.0f} mm)",
    )
    if constriction.smallest_channel_mm2 is not None:
        yield (
            "narrowest channel",
            f"{constriction.smallest_channel_mm2:.0f} mm² at {constriction.smallest_channel_place_mm:.0f} mm",
        )
        met = [section for section in constriction.sections if section.area_mm2 is not None]
        areas = " ".join(f"{section.area_mm2:.0f}" for section in met)
        yield "areas, mm²", f"{areas} (from {met[0].place_mm:.0f} mm on, every 5 mm)"


def _pattern(pattern: PalatogramPattern) -> str:
    """Eight rows from the front, a filled circle for an electrode that is on; the speaker's left is at the left."""
    rows = ("".join(" " if on is None else "●" if on else "○" for on in row) for row in pattern.electrodes)
    line = f"{pattern.contacts} of 62 contacts"
    if pattern.centre_of_gravity is not None:
        line += (
            f", anteriority {pattern.anteriority:.2f}, centrality {pattern.centrality:.2f}, "
            f"centre of gravity {pattern.centre_of_gravity:.2f}"
        )
        closed = ", ".join(str(row) for row in pattern.closed_rows)
        line += f"; closed in row {closed}" if closed else "; no row closed"
    return "\n".join([line, *rows])


def _airway_rows(airway: Airway) -> Iterator[tuple[str, str]]:
    """The airway and its formants, and what the assumed ends would change; frequencies in Hz."""
    assumed_mm = sum(section.to_mm - section.from_mm for section in airway.sections if section.source == "assumed")
    yield "airway", f"{airway.length_mm:.0f} mm from the glottis to the lips, {assumed_mm:.0f} of it assumed"
    yield "narrowest in it", f"{airway.smallest_area_mm2:.0f} mm², {airway.smallest_area_place_mm:.0f} mm from the glottis"
    if airway.closed or airway.shifts is None:
        yield "formants", "none: the airway is closed"
        return
    for number, formant in enumerate(airway.formants, 1):
        yield f"F{number}", f"{formant.frequency_hz:.0f} Hz (bandwidth {formant.bandwidth_hz:.0f} Hz)"
    shifts = airway.shifts
    rows = {
        "with half the lips": shifts.lips_area_times_half,
        "with 1.5 times": shifts.lips_area_times_one_and_a_half,
        "larynx 5 mm shorter": shifts.larynx_tube_5_mm_shorter,
        "larynx 5 mm longer": shifts.larynx_tube_5_mm_longer,
    }
    for name, frequencies in rows.items():
        yield name, ", ".join(f"{frequency:.0f}" for frequency in frequencies) + " Hz"


def _contact(contact: BoneContact) -> str:
    if not contact.area_mm2:
        return "none"
    lines = [
        f"{contact.area_mm2:.0f} mm², {contact.force_N:.2f} N, {contact.mean_kPa:.2f} kPa (peak {contact.peak_kPa:.2f}), "
        f"midline {'free' if contact.midline_free else 'touched'}"
    ]
    for depth in next(iter(contact.cells.values())):
        areas = [f"{side} {cells[depth].area_mm2:.0f}" for side, cells in contact.cells.items()]
        lines.append(f"{depth}: {', '.join(areas)} mm²")
    return "\n".join(lines)
