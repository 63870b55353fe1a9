"""Table of measures in the terminal: one row per measure, one column per result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.words import motion_at_end, number, reaction_in_words, speed
from explicitfe.app.view.terminal.rows import TIP, forward_up, moved, pairs
from explicitfe.results.measure.document import (
    Airway,
    BoneContact,
    Constriction,
    LeakFigures,
    Measures,
    PalatogramPattern,
    PointMotion,
)

# A point that has never moved farther is shown without its largest displacement.
SMALLEST_SHOWN_MM = 0.005


def measures_table(measured: Sequence[Measures]) -> Table:
    """One result as pairs of name and value; several as columns."""
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
    """Names and values of the measures; lengths in mm."""
    body = measures.body
    yield "time", f"{measures.time_ms:.4g} ms"
    is_tongue = TIP in measures.points
    for name, point in measures.points.items():
        yield escape(name), _motion(point, anatomical=is_tongue)
    highest = measures.highest
    if is_tongue and highest is not None:
        yield (
            "highest point",
            f"{forward_up(highest.forward_mm, highest.up_mm)} (now {highest.behind_tip_mm:.1f} mm behind and "
            f"{highest.above_tip_mm:.1f} mm above the tip at rest)",
        )
    if is_tongue and measures.grooves:
        depths = " / ".join(f"{groove.depth_mm:.1f}" for groove in measures.grooves.values())
        yield "groove depth", f"{depths} mm ({' / '.join(measures.grooves)})"
    if measures.constriction is not None:
        yield from _constriction_rows(measures.constriction)
    if measures.airway is not None:
        yield from _airway_rows(measures.airway)
    for name, reaction in measures.reactions.items():
        if reaction.displacement_mm is not None:
            yield f"reaction: {escape(name)}", reaction_in_words(reaction)
    for name, contact in measures.contact.items():
        yield f"contact: {escape(name)}", _contact(contact)
    if measures.palatogram is not None:
        yield "palatogram", _pattern(measures.palatogram.now)
    if measures.leak is not None:
        yield "leak", _leak(measures.leak)
    yield (
        "whole body",
        f"largest displacement {body.largest_displacement_mm:.2f} mm (so far {body.largest_so_far_mm:.2f} mm)"
        f"{_rise(body.time_to_90_ms)}; {motion_at_end(body.settled, body.fastest_mm_s)}",
    )
    yield "volume change", f"{body.volume_change_percent:+.2f} %"
    if body.left_right_mm is not None:
        yield "asymmetry", f"at most {body.left_right_mm:.2g} mm"
    passed = body.self_penetration
    if passed.nodes:
        place = passed.deepest_at_rest
        assert place is not None
        yield (
            "self-penetration",
            f"[red]{passed.nodes} nodes, at most {passed.deepest_mm:.1f} mm deep[/red], at rest near "
            f"({place.back_mm:.0f}, {place.right_mm:.0f}, {place.up_mm:.0f}) mm",
        )


def _motion(point: PointMotion, *, anatomical: bool) -> str:
    text = moved(point.forward_mm, point.up_mm, point.right_mm, anatomical=anatomical)
    # A movement that has returned is described by its largest displacement, any other by its rise time.
    has_returned = point.time_to_90_ms is None and point.largest_mm > SMALLEST_SHOWN_MM
    farthest = f"; largest {point.largest_mm:.2f} mm at {point.largest_at_ms:.0f} ms" if has_returned else ""
    return f"{text}{_rise(point.time_to_90_ms)}{farthest}; peak speed {speed(point.peak_speed_mm_s)} mm/s"


def _rise(time_ms: float | None) -> str:
    return "" if time_ms is None else f"; 90 % after {time_ms:.0f} ms"


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
        yield "areas, mm²", f"{areas} (every 5 mm, from {met[0].place_mm:.0f} mm behind the incisors)"


def _pattern(pattern: PalatogramPattern) -> str:
    """Eight rows from the front, a filled circle for an electrode in contact; the speaker's left is on the left."""
    rows = ("".join(" " if on is None else "●" if on else "○" for on in row) for row in pattern.electrodes)
    line = f"{pattern.contacts} of 62 contacts"
    if pattern.centre_of_gravity is not None:
        line += (
            f", anteriority {pattern.anteriority:.2f}, centrality {pattern.centrality:.2f}, "
            f"centre of gravity {pattern.centre_of_gravity:.2f}"
        )
        closed = ", ".join(str(row) for row in pattern.closed_rows)
        line += f"; closed rows: {closed}" if closed else "; no closed row"
    return "\n".join([line, *rows])


def _leak(leak: LeakFigures) -> str:
    """Size and place of the leak, and the closures so far."""
    side = "left" if leak.side_mm < 0.0 else "right"
    lines = [
        f"{'closed: ' if leak.closed else ''}{leak.width_mm:.1f} mm wide, {leak.area_mm2:.0f} mm²; narrowest "
        f"{leak.place_mm:.0f} mm behind the incisors, {abs(leak.side_mm):.0f} mm to the {side}; "
        f"over the plate {leak.over_plate_mm:.1f} mm, next to the molars {leak.beside_molars_mm:.1f} mm"
    ]
    closures = (f"{each.from_ms:.0f} to {each.to_ms:.0f} ms ({each.duration_ms:.0f} ms)" for each in leak.closures)
    return "\n".join([*lines, *(f"closed from {each}" for each in closures)])


def _airway_rows(airway: Airway) -> Iterator[tuple[str, str]]:
    """The airway, its formants, and their sensitivity to the assumed ends; frequencies in Hz."""
    assumed_mm = sum(section.to_mm - section.from_mm for section in airway.sections if section.source == "assumed")
    yield "airway", f"{airway.length_mm:.0f} mm from the glottis to the lips, {assumed_mm:.0f} mm of it assumed"
    yield "narrowest section", f"{airway.smallest_area_mm2:.0f} mm², {airway.smallest_area_place_mm:.0f} mm from the glottis"
    if airway.closed or airway.shifts is None:
        yield "formants", "none, because the airway is closed"
        return
    for order, formant in enumerate(airway.formants, 1):
        yield f"F{order}", f"{formant.frequency_hz:.0f} Hz (bandwidth {formant.bandwidth_hz:.0f} Hz)"
    shifts = airway.shifts
    rows = {
        "lip area × 0.5": shifts.lips_area_times_half,
        "lip area × 1.5": shifts.lips_area_times_one_and_a_half,
        "larynx 5 mm shorter": shifts.larynx_tube_5_mm_shorter,
        "larynx 5 mm longer": shifts.larynx_tube_5_mm_longer,
    }
    for name, frequencies in rows.items():
        yield name, ", ".join(f"{frequency:.0f}" for frequency in frequencies) + " Hz"


def _contact(contact: BoneContact) -> str:
    if not contact.area_mm2:
        return "none"
    resultant = [] if contact.resultant_N is None else [f"resultant force {number(contact.resultant_N)} N"]
    lines = [
        ", ".join([f"area {contact.area_mm2:.0f} mm²", *resultant, f"normal force sum {number(contact.force_N)} N"]),
        f"mean pressure {number(contact.mean_kPa, 2)} kPa, peak {number(contact.peak_kPa, 2)} kPa; "
        f"{'no ' if contact.midline_free else ''}contact within 3 mm of the midline",
        "areas, left / central / right third of the width:",
    ]
    for depth in next(iter(contact.cells.values())):
        areas = " / ".join(f"{cells[depth].area_mm2:.0f}" for cells in contact.cells.values())
        lines.append(f"{depth} third of the length: {areas} mm²")
    return "\n".join(lines)
