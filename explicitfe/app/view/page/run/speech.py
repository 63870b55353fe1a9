"""What a page shows of the speech of a run: contact with the palate, areas of the airway, formants, and muscle fibres."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from explicitfe.app.view.mouth import is_mouth
from explicitfe.app.view.muscles import activation, muscle_name, muscles_of
from explicitfe.app.view.page.chart import Chart, Line, chart
from explicitfe.app.view.page.run.packed import Packed
from explicitfe.app.view.scene.carried import CarriedPoints, joined
from explicitfe.platform.errors import InputError
from explicitfe.results.acoustics.speakers import spoken_vowels
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result
from explicitfe.results.measure.courses import FormantCourse, formant_course
from explicitfe.results.measure.document import AirwaySection
from explicitfe.results.measure.electrodes import ELECTRODE_COLUMNS
from explicitfe.results.measure.leak import leak_history
from explicitfe.results.measure.palatogram import TongueOnPalate, electrodes_of
from explicitfe.results.measure.tract import TOUCHING_GAP_M

# Formants are computed at so many samples at most: a sample takes about 0.1 s, and the rest of a page about 2 s.
MOST_ACOUSTIC_SAMPLES = 18
# Ellipses reach so many standard deviations from the mean: of a normal distribution, 68 % lie within.
ELLIPSE_DEVIATIONS = 1.515
# The path of the leak has so many points in each frame.
LEAK_POINTS = 64
# Numbers of the colours of the groups of speakers, of the path of the run, and of the two lines of an area function.
GROUP_COLOURS = {"men": 0, "women": 2, "children": 4}
PATH_COLOUR, AREA_COLOUR, COLOUR_OF_ASSUMED = 6, 0, 4


@dataclass(frozen=True)
class Speech:
    """The acoustics of a run in time.

    Attributes
    ----------
    times_ms, formants_hz : of the samples whose acoustics were computed: F1, F2 and F3, None where the airway is closed.
    areas : a chart with all area functions; two series a sample, of which the player of the page shows those of one sample.
    vowels : the chart of F1 and F2.
    groups : name and number of the colour of each group of speakers in it.
    """

    times_ms: list[float]
    formants_hz: list[list[float] | None]
    areas: Chart
    vowels: Chart
    groups: dict[str, int]

    @property
    def moments(self) -> str:
        """The times and formants as JSON, for the player."""
        return json.dumps({"times": self.times_ms, "formants": self.formants_hz})


def speech_of(result: Result, last: int) -> Speech | None:
    """The acoustics of a run up to a sample; None for a run without airway or palate."""
    if kind_of(result.model) != "transient" or not is_mouth(result):
        return None
    steps = np.unique(np.round(np.linspace(0, last, min(MOST_ACOUSTIC_SAMPLES, last + 1))).astype(int)).tolist()
    try:
        course = formant_course(result, steps=steps)
    except InputError:  # no palate, or nothing of the tongue lies across the airway
        return None
    areas, vowels = _areas(course), _vowels(course)
    if areas is None or vowels is None:
        return None
    formants = [None if np.isnan(row).any() else row.tolist() for row in course.frequency]
    return Speech((1e3 * course.time).tolist(), formants, areas, vowels, GROUP_COLOURS)


def _areas(course: FormantCourse) -> Chart | None:
    """The area functions as steps; what is assumed of each is an area below it."""
    series = []
    for number, sections in enumerate(course.sections):
        is_last = number == len(course.sections) - 1
        along, area = _steps(sections)
        assumed = np.repeat([section.source == "assumed" for section in sections], 2)
        series += [
            Line("assumed" if is_last else "", along, np.where(assumed, area, np.nan), "area", COLOUR_OF_ASSUMED),
            Line("area" if is_last else "", along, area, colour=AREA_COLOUR),
        ]
    return chart("Area function", series, x_label="distance from the glottis (mm)", y_label="mm²")


def _steps(sections: list[AirwaySection]) -> tuple[np.ndarray, np.ndarray]:
    """Corners of an area function: distances from the glottis, mm, and areas, mm2."""
    ends = np.array([[section.from_mm, section.to_mm] for section in sections])
    return ends.ravel(), np.repeat([section.area_mm2 for section in sections], 2)


def _vowels(course: FormantCourse) -> Chart | None:
    """F1 and F2 of the run over the ellipses of speakers, F2 to the left and F1 down."""
    spoken = spoken_vowels()
    ellipses = [(vowel, vowel.ellipse(ELLIPSE_DEVIATIONS)) for vowel in spoken]
    series = [Line("", points[:, 1], points[:, 0], colour=GROUP_COLOURS[vowel.group]) for vowel, points in ellipses]
    f1, f2, _ = course.frequency.T
    path = [Line("", f2, f1, drawn, PATH_COLOUR) for drawn in ("line", "dots")]
    return chart(
        "F1 and F2: this run (thick line; dot: now) and speakers",
        [*series, *path],
        x_label="F2 (Hz)",
        y_label="F1 (Hz)",
        reversed_axes=True,
        words=[(*vowel.mean_hz[::-1].tolist(), vowel.vowel, GROUP_COLOURS[vowel.group]) for vowel in spoken],
    )


def pack_contact(packed: Packed, result: Result, steps: np.ndarray) -> list[int] | None:
    """Add which electrodes are touched in each frame; returns their numbers in a grid of 8 rows of 8; None without electrodes."""
    at = electrodes_of(result)
    if at is None:
        return None
    tongue = TongueOnPalate(result, at)
    packed.add("contacts", np.stack([tongue.contact(int(step)).on for step in steps]), "<u1")
    numbers: list[int] = (ELECTRODE_COLUMNS * at.row + at.column).tolist()
    return numbers


def pack_leak(packed: Packed, result: Result, steps: np.ndarray) -> int | None:
    """Add the path of the leak in each frame, and whether it is closed; returns the number of its points, None without a roof."""
    history = leak_history(result, int(steps[-1])) if is_mouth(result) else None
    if history is None:
        return None
    ways = [history.widest(int(step)) for step in steps]
    packed.add("leak", 1e3 * np.stack([_evenly(one.path, LEAK_POINTS) for one in ways]), "<f4")
    packed.add("leak_closed", np.array([one.width_m <= TOUCHING_GAP_M for one in ways]), "<u1")
    return LEAK_POINTS


def _evenly(line: np.ndarray, count: int) -> np.ndarray:
    """Points (count, 3) on a line (k, 3), equally far apart along it."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], count)
    return np.column_stack([np.interp(at, length, along) for along in line.T])


def fibre_points(result: Result) -> tuple[list[int], CarriedPoints] | None:
    """Numbers of the muscles of a tongue that pull, and the points of all their fibres; None without fibres."""
    if not is_mouth(result):
        return None
    pulling = [number for number, muscle in enumerate(muscles_of(result)) if muscle["force_N"] > 0.0 and result.fibres[number]]
    lines = [CarriedPoints.of(result.mesh, line) for number in pulling for line in result.fibres[number]]
    return (pulling, joined(lines)) if lines else None


def pack_muscles(packed: Packed, result: Result, steps: np.ndarray, rounding_mm: float) -> list[dict[str, object]]:
    """Add the fibres of the muscles that pull and where they are in each frame; returns name, points, and force over time."""
    fibres = fibre_points(result)
    if fibres is None:
        return []
    pulling, points = fibres
    moved = np.stack([1e3 * points.values(result.displacement(int(step))) for step in steps])
    whole = np.round(moved / rounding_mm).astype(np.int32)
    packed.add("fibres", 1e3 * points.reference, "<f4")
    packed.add("fibres_moved", np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1])).transpose(0, 2, 1), "<i2")
    of_muscles, end_ms = [], 1e3 * float(result.times[steps[-1]])
    for number in pulling:
        muscle = muscles_of(result)[number]
        times, shares = activation(muscle, end_ms)
        lengths = [len(line) for line in result.fibres[number]]
        of_muscles.append({"name": muscle_name(muscle), "lines": lengths, "times": times.tolist(), "shares": shares.tolist()})
    return of_muscles
