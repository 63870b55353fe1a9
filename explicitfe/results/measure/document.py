"""Output of ``explicitfe measure``; docs/reference/measures.md defines each number.

Lengths in mm, areas in mm2, times in ms, speeds in mm/s, pressures in kPa, forces in N, frequencies in Hz. Forward is towards the
lips, up towards the palate, right that of the speaker. All keys are always present; None: the quantity does not exist.
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

from explicitfe.results.documents.document import Document

Side = Literal["left", "centre", "right"]
Depth = Literal["front", "middle", "back"]
AirwayRegion = Literal["larynx", "epiglottis", "pharynx", "mouth", "teeth", "lips"]
AreaSource = Literal["geometry", "assumed"]


class MeasuredPart(BaseModel):
    """A table of the document."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class PointMotion(MeasuredPart):
    """Displacement of a named point from rest, and its speed.

    Attributes
    ----------
    largest_mm, largest_at_ms : largest distance from its place at rest so far, and when.
    time_to_90_ms : None where it has not moved, or where it has returned to less than half of the largest distance.
    """

    forward_mm: float
    up_mm: float
    right_mm: float
    largest_mm: float
    largest_at_ms: float
    time_to_90_ms: float | None
    peak_speed_mm_s: float
    speed_mm_s: float


class Groove(MeasuredPart):
    """Groove of a coronal section: its depth relative to rest, its depth at rest, and its place behind the tip."""

    depth_mm: float
    at_rest_mm: float
    behind_tip_mm: float


class HighestPoint(MeasuredPart):
    """The highest point of the midsagittal outline, relative to that at rest, and relative to the tip at rest."""

    forward_mm: float
    up_mm: float
    behind_tip_mm: float
    above_tip_mm: float


class MaterialPlace(MeasuredPart):
    """A place in the reference shape, in the frame of the model."""

    back_mm: float
    right_mm: float
    up_mm: float


class SelfPenetrationFigures(MeasuredPart):
    """Self-penetration: surface nodes inside another part of the body, and the deepest of them."""

    nodes: int
    deepest_mm: float
    deepest_at_rest: MaterialPlace | None


class BodyMotion(MeasuredPart):
    """The whole body.

    Attributes
    ----------
    largest_displacement_mm, fastest_mm_s : of all nodes, at the time that is measured.
    largest_so_far_mm : largest displacement of any node at any sample up to then.
    settled : whether no node would move by 5 % of ``largest_so_far_mm`` in another 100 ms at its present speed.
    time_to_90_ms : None where nothing has moved, or where the body has returned to less than half of its largest displacement.
    volume_change_percent : positive where it has grown.
    left_right_mm : largest difference between the motion of a node and the mirrored motion of its mirror image; None for a mesh
        that is not its own mirror image.
    """

    largest_displacement_mm: float
    largest_so_far_mm: float
    fastest_mm_s: float
    settled: bool
    time_to_90_ms: float | None
    volume_change_percent: float
    left_right_mm: float | None
    self_penetration: SelfPenetrationFigures


class TractSection(MeasuredPart):
    """Air between tongue and palate in a plane across the palate's midline.

    Attributes
    ----------
    place_mm : from the incisor edge along the midline of the palate.
    height_mm : of the air in the midline, 0 where they touch; None where the plane does not meet the tongue.
    area_mm2 : of all the air inside the dental arch.
    channel_mm2 : of the part over the midline, out to where the tongue first touches; 0 where it touches in the midline.
    """

    place_mm: float
    height_mm: float | None
    area_mm2: float | None
    channel_mm2: float | None


class Constriction(MeasuredPart):
    """The constriction between tongue and palate.

    Attributes
    ----------
    width_mm, place_mm : smallest midsagittal distance, and the place along the palate; width 0: they touch.
    width_at_rest_mm, place_at_rest_mm : the same at rest.
    smallest_channel_mm2, smallest_channel_place_mm : of the sections that meet the tongue; None where none does.
    sections : every 5 mm along the palate.
    """

    width_mm: float
    place_mm: float
    width_at_rest_mm: float
    place_at_rest_mm: float
    smallest_channel_mm2: float | None
    smallest_channel_place_mm: float | None
    sections: list[TractSection]


class ContactPart(MeasuredPart):
    """Contact with a part of a bone.

    Attributes
    ----------
    area_mm2 : area of the surface in contact.
    force_N : normal force sum: the integral of the contact pressure over that area.
    mean_kPa : mean pressure over that area.
    """

    area_mm2: float
    force_N: float
    mean_kPa: float


class BoneContact(ContactPart):
    """Contact with a bone.

    The normal force sum ``force_N`` adds magnitudes, the resultant adds vectors. They differ where the bone pushes from several
    sides, so that forces cancel in the resultant, and by damping and friction, which only the resultant contains.

    Attributes
    ----------
    resultant_N : resultant contact force: the magnitude of the bone's force on the body.
    peak_kPa : largest pressure at a node.
    midline_free : whether no node touches within 3 mm of the midsagittal plane.
    forward_N, up_N, right_N : components of the resultant. As ``resultant_N`` None where the run did not store them.
    cells : thirds across and along the bone.
    """

    resultant_N: float | None
    peak_kPa: float
    midline_free: bool
    forward_N: float | None
    up_N: float | None
    right_N: float | None
    cells: dict[Side, dict[Depth, ContactPart]]


class Reaction(MeasuredPart):
    """Force on the body of a fixed or prescribed node set, a support or a bone, along the axes of the model.

    Attributes
    ----------
    magnitude_N : of the force.
    displacement_mm : how far it has moved; None for a bone that only touches.
    """

    force_N: list[float]
    magnitude_N: float
    displacement_mm: list[float] | None


class PalatogramPattern(MeasuredPart):
    """Electrodes of the palate in contact at one time, and the indices of that pattern.

    Attributes
    ----------
    electrodes : eight rows from the front, each from the speaker's left to the right; None where there is no electrode.
    contacts : number of electrodes in contact, of 62.
    anteriority, centrality : 0 to 1, extent of the contact towards the front, and towards the midline.
    dorsopalatal : share of the electrodes of rows 6 to 8 in contact.
    centre_of_gravity : 0.5 in the last row to 7.5 in the first; None without contact.
    closed_rows : numbers, from 1 in front, of the rows of which all electrodes are in contact.
    """

    time_ms: float
    electrodes: list[list[bool | None]]
    contacts: int
    anteriority: float
    centrality: float
    dorsopalatal: float
    centre_of_gravity: float | None
    closed_rows: list[int]


class ContactCourse(MeasuredPart):
    """Contact with the whole palate at every sample: electrodes in contact, contact area, and normal force sum ``force_N``."""

    time_ms: list[float]
    contacts: list[int]
    area_mm2: list[float]
    force_N: list[float]


class Palatogram(MeasuredPart):
    """Contact of tongue and palate as in electropalatography.

    Attributes
    ----------
    now, most : the pattern at the measured time, and the first one with the largest number of contacts so far.
    pressure_kPa : on each electrode at the measured time; 0 without contact.
    first_contact_ms, duration_ms : time of the first contact of each electrode, None: never; and duration of its contact.
    row_places_mm : of the rows, along the midline of the palate from the edge of the incisors.
    """

    now: PalatogramPattern
    most: PalatogramPattern
    pressure_kPa: list[list[float | None]]
    first_contact_ms: list[list[float | None]]
    duration_ms: list[list[float | None]]
    row_places_mm: list[float]
    course: ContactCourse


class LeakCourse(MeasuredPart):
    """The leak at every sample: its width and its area."""

    time_ms: list[float]
    width_mm: list[float]
    area_mm2: list[float]


class Closure(MeasuredPart):
    """A time in which the leak is closed, linear between samples."""

    from_ms: float
    to_ms: float
    duration_ms: float


class LeakFigures(MeasuredPart):
    """The widest way for air along the roof of the mouth, from behind the incisors to the pharynx, inside the dental arch.

    Attributes
    ----------
    width_mm : largest gap between tongue and roof that a way keeps everywhere.
    area_mm2 : of the smallest open cross-section; 0 if and only if it is closed.
    closed : whether the width is at most 0.3 mm.
    place_mm, side_mm : narrowest place of the widest way, along the midline from the edge of the incisors, and to the right of
        the midsagittal plane; negative to the left.
    over_plate_mm, beside_molars_mm : width of the widest way inside of the edge of the gum, and of the widest one that is outside
        of it from the first row of electrodes on.
    closures : times in which it is closed.
    """

    width_mm: float
    area_mm2: float
    closed: bool
    place_mm: float
    side_mm: float
    over_plate_mm: float
    beside_molars_mm: float
    course: LeakCourse
    closures: list[Closure]


class AirwaySection(MeasuredPart):
    """A piece of the airway, approximated by a cylinder.

    Attributes
    ----------
    from_mm, to_mm : its ends, from the glottis.
    source : "geometry" where the area is cut out of surfaces, "assumed" where not.
    """

    region: AirwayRegion
    source: AreaSource
    from_mm: float
    to_mm: float
    area_mm2: float


class FormantFigures(MeasuredPart):
    """A formant: its frequency, and the width of its peak 3 dB below the top."""

    frequency_hz: float
    bandwidth_hz: float


class FormantShifts(MeasuredPart):
    """F1, F2 and F3, Hz, with one assumption changed at a time."""

    lips_area_times_half: list[float]
    lips_area_times_one_and_a_half: list[float]
    larynx_tube_5_mm_shorter: list[float]
    larynx_tube_5_mm_longer: list[float]


class Airway(MeasuredPart):
    """The airway at one time, and its formants. Distances are in mm from the glottis along the midline.

    Attributes
    ----------
    sections : from the glottis to the lips, one after the other.
    length_mm : of all.
    smallest_area_mm2, smallest_area_place_mm : of the sections of source "geometry", and the middle of the narrowest.
    closed : whether the leak is closed, or a section outside of the mouth or the opening of the lips has no area: then there are
        no formants.
    formants : F1, F2 and F3.
    shifts : what the assumed ends do to them; None where it is closed.
    """

    sections: list[AirwaySection]
    length_mm: float
    smallest_area_mm2: float
    smallest_area_place_mm: float
    closed: bool
    formants: list[FormantFigures]
    shifts: FormantShifts | None


class Measures(Document, MeasuredPart):
    """The measures of a result at one time.

    Attributes
    ----------
    result, title, status : file, title of the scenario, how the run ended.
    time_ms : of the sample that was measured.
    grooves : at the stations "front", "dorsum" and "back"; those that cut the mesh.
    constriction : None where no bone is called "palate".
    reactions : name -> reaction force; empty where the run stored none.
    contact : bone -> contact, of those whose pressure the run stored.
    palatogram : None where no bone is called "palate", its pressure was not stored, or it has no room for the electrodes.
    leak : None where no bone is called "palate", or it does not lie on both sides of the midsagittal plane.
    airway : None unless it was asked for.
    """

    result: str
    title: str
    status: str
    time_ms: float
    points: dict[str, PointMotion]
    highest: HighestPoint | None
    grooves: dict[str, Groove]
    constriction: Constriction | None
    reactions: dict[str, Reaction]
    contact: dict[str, BoneContact]
    palatogram: Palatogram | None
    leak: LeakFigures | None
    body: BodyMotion
    airway: Airway | None = None
