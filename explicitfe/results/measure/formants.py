"""Formants of a result: its airway from the glottis to the lips as a tube, and the sensitivity to the assumed ends."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.results.acoustics.formants import Tube, formants
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Recorded, open_result
from explicitfe.results.files.airway_table import AirwayTable, LarynxTable
from explicitfe.results.measure.airway import Surroundings, airway_midline, airway_table, cut_sections, surroundings
from explicitfe.results.measure.document import Airway, AirwayRegion, AirwaySection, AreaSource, FormantFigures, FormantShifts
from explicitfe.results.measure.leak import leak_history
from explicitfe.results.measure.steps import step_at
from explicitfe.results.measure.tract import lengths_along

FORMANT_COUNT = 3
# A midline has at least so many points.
FEWEST_POINTS = 10
# Between the last section that was cut and the incisors: what is shorter is none.
SHORTEST_GAP_MM = 1.0
# What is assumed is given in pieces no longer than this.
ASSUMED_PIECE_MM = 3.0
# By how much the assumed ends are changed to see what they do.
LIPS_AREA_SHARES = (0.5, 1.5)
LARYNX_CHANGES_MM = (-5.0, 5.0)


class Piece(NamedTuple):
    """A piece of the airway, approximated by a cylinder."""

    region: AirwayRegion
    source: AreaSource
    length_mm: float
    area_mm2: float


def airway(path: Path, time_s: float | None = None) -> Airway:
    """The airway of a result and its formants, at the sample nearest to a time; at the last one by default.

    Raises
    ------
    InputError : the file cannot be read, holds no such time, or its run had no palate or no built-in tongue.
    """
    with open_result(path) as result:
        if kind_of(result.model) != "transient":
            raise InputError(f"{path} is the result of an indentation: it has no airway.")
        return airway_of(result, step_at(result, time_s))


def airway_of(result: Recorded, step: int) -> Airway:
    """The airway at one stored step, with its formants.

    Raises
    ------
    InputError : the run had no palate or no built-in tongue.
    """
    table = airway_table(result)
    lips = lips_at(result, float(result.times[step]), table)
    middle = cut_pieces(result, step, table)
    sections = joined(middle, table.larynx, lips)
    measured = [section for section in sections if section.source == "geometry"]
    narrowest = min(measured, key=lambda section: section.area_mm2)
    closed = min(section.area_mm2 for section in sections) <= 0.0
    return Airway(
        sections=sections,
        length_mm=sections[-1].to_mm,
        smallest_area_mm2=narrowest.area_mm2,
        smallest_area_place_mm=0.5 * (narrowest.from_mm + narrowest.to_mm),
        closed=closed,
        formants=[] if closed else formants_of(sections),
        shifts=None if closed else _shifts(middle, table.larynx, lips),
    )


def formants_of(sections: Sequence[AirwaySection]) -> list[FormantFigures]:
    """F1, F2 and F3 of sections from the glottis to the lips, none of them closed."""
    return [
        FormantFigures(frequency_hz=each.frequency_hz, bandwidth_hz=each.bandwidth_hz)
        for each in formants(tube_of(sections), FORMANT_COUNT)
    ]


def tube_of(sections: Sequence[AirwaySection]) -> Tube:
    """The sections as a tube, in SI units."""
    lengths = np.array([section.to_mm - section.from_mm for section in sections])
    return Tube(1e-3 * lengths, 1e-6 * np.array([section.area_mm2 for section in sections]))


def lips_at(result: Recorded, time_s: float, table: AirwayTable) -> tuple[float, float]:
    """Area mm2 and length mm of the lips at a time: of the scenario, else the neutral opening of the model."""
    lips = result.model["scenario"].get("lips")
    if lips is None:
        return table.lips.area_mm2, table.lips.length_mm
    if not lips.get("table"):
        return float(lips["area_mm2"]), float(lips["length_mm"])
    times, areas, lengths = np.array(lips["table"], dtype=float).T
    return float(np.interp(1e3 * time_s, times, areas)), float(np.interp(1e3 * time_s, times, lengths))


def cut_pieces(result: Recorded, step: int, table: AirwayTable) -> list[Piece]:
    """Pieces from the lowest section to the incisors, cut out of the surfaces, or interpolated where a surface is not met."""
    pieces = pieces_between(surroundings(result, step, table))
    if not pieces:
        raise InputError(f"{result.path} has no airway: nothing of the tongue lies across it.")
    leak = leak_history(result, step)
    return pieces if leak is None else limit_by_leak(pieces, 1e6 * leak.widest(step).area_m2)


def limit_by_leak(pieces: Sequence[Piece], leak_mm2: float) -> list[Piece]:
    """The pieces, closed in the mouth if and only if the leak is.

    A closure in the shape of a horseshoe closes no plane section: then the narrowest piece of the mouth has no area. And a plane
    section that ends at the side of the tongue leaves out what passes beside the molars: if one is closed though the leak is not,
    no piece of the mouth is narrower than the leak.
    """
    areas = [piece.area_mm2 for piece in pieces]
    mouth = [number for number, piece in enumerate(pieces) if piece.region == "mouth"]
    if leak_mm2 == 0.0 and mouth:
        areas[min(mouth, key=areas.__getitem__)] = 0.0
    elif any(areas[number] == 0.0 for number in mouth):
        for number in mouth:
            areas[number] = max(areas[number], leak_mm2)
    return [piece._replace(area_mm2=area) for piece, area in zip(pieces, areas, strict=True)]


def pieces_between(around: Surroundings) -> list[Piece]:
    """Pieces from the lowest section to the incisors; none if nothing of the tongue lies across the airway."""
    line = airway_midline(around)
    cuts = cut_sections(line, around) if len(line) >= FEWEST_POINTS else []
    met = [number for number, cut in enumerate(cuts) if cut.area is not None]
    if not met:
        return []
    areas = 1e6 * np.interp(np.arange(len(cuts)), met, [cut.area for cut in cuts if cut.area is not None])
    part_mm = 1e3 * float(lengths_along(line)[-1]) / len(cuts)
    pieces = [
        Piece(cut.region, "assumed" if cut.area is None else "geometry", part_mm, float(area))
        for cut, area in zip(cuts, areas, strict=True)
    ]
    # Without a jaw the midline may end before the edge of the upper incisors.
    gap_mm = 0.0 if around.incisors is not None else 1e3 * float(line[-1, 0] - around.line[-1, 0])
    return [*pieces, Piece("teeth", "assumed", gap_mm, pieces[-1].area_mm2)] if gap_mm > SHORTEST_GAP_MM else pieces


def joined(middle: Sequence[Piece], larynx: LarynxTable, lips: tuple[float, float]) -> list[AirwaySection]:
    """All sections from the glottis to the lips: the larynx and what is above it, ``middle``, and the lips."""
    above_mm = larynx.lowest_section_mm - larynx.opening_mm
    count = int(np.ceil(above_mm / ASSUMED_PIECE_MM))
    areas = larynx.tube_area_mm2 + (middle[0].area_mm2 - larynx.tube_area_mm2) * (np.arange(count) + 0.5) / count
    lips_area_mm2, lips_length_mm = lips
    pieces = [
        Piece("larynx", "assumed", larynx.tube_length_mm, larynx.tube_area_mm2),
        *(Piece("epiglottis", "assumed", above_mm / count, float(area)) for area in areas),
        *middle,
        Piece("lips", "assumed", lips_length_mm, lips_area_mm2),
    ]
    ends = np.cumsum([piece.length_mm for piece in pieces])
    return [
        AirwaySection(
            region=piece.region,
            source=piece.source,
            from_mm=float(end - piece.length_mm),
            to_mm=float(end),
            area_mm2=piece.area_mm2,
        )
        for piece, end in zip(pieces, ends, strict=True)
    ]


def _shifts(middle: Sequence[Piece], larynx: LarynxTable, lips: tuple[float, float]) -> FormantShifts:
    """F1 to F3 with the assumed ends changed one at a time."""

    def frequencies(changed: LarynxTable, opening: tuple[float, float]) -> list[float]:
        return [formant.frequency_hz for formant in formants_of(joined(middle, changed, opening))]

    less, more = ((share * lips[0], lips[1]) for share in LIPS_AREA_SHARES)
    shorter, longer = (
        larynx.model_copy(update={"tube_length_mm": larynx.tube_length_mm + change}) for change in LARYNX_CHANGES_MM
    )
    return FormantShifts(
        lips_area_times_half=frequencies(larynx, less),
        lips_area_times_one_and_a_half=frequencies(larynx, more),
        larynx_tube_5_mm_shorter=frequencies(shorter, lips),
        larynx_tube_5_mm_longer=frequencies(longer, lips),
    )
