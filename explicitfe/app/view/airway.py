"""Picture of the airway: its midline and sections, area function, transfer function and formants."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.app.view.bones import fill_bones, keep_to_tongue
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.palette import COLOURS, CONSTRICTION, plain
from explicitfe.results.acoustics.formants import flow_ratio
from explicitfe.results.acoustics.losses import ALL_LOSSES
from explicitfe.results.files import Result
from explicitfe.results.measure.airway import airway_midline, airway_table, cut_sections, surroundings
from explicitfe.results.measure.courses import constriction_course, formant_course
from explicitfe.results.measure.document import Airway
from explicitfe.results.measure.formants import airway_of, tube_of
from explicitfe.results.measure.sections import X, Z, midsagittal
from explicitfe.results.measure.tract import PALATE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REGION_COLOURS = {"pharynx": COLOURS[2], "mouth": COLOURS[0]}
ASSUMED_COLOUR, TONGUE_COLOUR = "0.72", "#440154"
HIGHEST_SHOWN_HZ, SPECTRUM_STEP_HZ = 4500.0, 5.0
# Every so-manieth section has its distance from the glottis written beside it, so far away.
NAMED_MARKS, NAME_APART_MM = 5, 4.0
# The area function's panel is higher than its largest area by this share, for the legend.
LEGEND_ROOM_SHARE = 1.2
# About so many samples are drawn over time.
SAMPLES_OVER_TIME = 20


def airway_figure(result: Result, step: int, over_time: bool = False) -> Figure | None:
    """The airway at a step, its areas and its transfer function; None if the run has no airway or no palate.

    Parameters
    ----------
    over_time : draw formants and constriction over the whole run too, which takes some seconds.
    """
    if result.model.get("airway") is None or PALATE not in result.bones:
        return None
    airway = airway_of(result, step)
    figure = result_figure(result, 12.2 if over_time else 9.2, f"Airway at {1e3 * result.times[step]:.0f} ms")
    rows: list[Any] = [["side", "side"], ["areas", "spectrum"], ["formants", "constriction"]][: 3 if over_time else 2]
    panels = figure.subplot_mosaic(rows, height_ratios=[1.5, 1.0, 0.9][: len(rows)])
    _draw_side(panels["side"], result, step, airway)
    _draw_areas(panels["areas"], airway)
    _draw_spectrum(panels["spectrum"], airway)
    if over_time:
        _draw_formants(panels["formants"], result)
        _draw_constriction(panels["constriction"], result)
    return figure


def _draw_side(axes: Axes, result: Result, step: int, airway: Airway) -> None:
    """The midsagittal plane: what bounds the air, the midline, and where sections are cut."""
    mesh = result.mesh
    around = surroundings(result, step, airway_table(result))
    plain(axes)
    axes.set_aspect("equal")
    fill_bones(axes, result, step, np.array([0.0, around.middle, 0.0]), np.array([0.0, 1.0, 0.0]), X, label=None)
    cut = midsagittal(mesh)
    tongue = outline_mm(result, cut, mesh.points + result.displacement(step))
    axes.plot(tongue[:, X], tongue[:, Z], color=TONGUE_COLOUR, lw=2.0, label="tongue")
    axes.plot(*(1e3 * around.line.T), color="black", lw=1.5, label="palate, velum, wall of the pharynx")
    line = airway_midline(around)
    axes.plot(*(1e3 * line.T), color=CONSTRICTION, lw=1.8, label="midline")
    sections = [section for section in airway.sections if section.region in REGION_COLOURS]
    for number, (section, cut_here) in enumerate(zip(sections, cut_sections(line, around), strict=True)):
        if not np.isfinite(cut_here.span).all():
            continue
        point, across = 1e3 * cut_here.plane.point[[X, Z]], cut_here.plane.down[[X, Z]]
        low, high = (point + 1e3 * end * across for end in cut_here.span)
        axes.plot(*np.stack([low, high]).T, color=REGION_COLOURS[section.region], lw=1.0)
        if number % NAMED_MARKS == 0:
            x, z = low - NAME_APART_MM * across
            place_mm = 0.5 * (section.from_mm + section.to_mm)
            axes.text(x, z, f"{place_mm:.0f}", fontsize=8, ha="center", va="center", color="0.25")
    keep_to_tongue(axes, np.concatenate([tongue[:, [X, Z]], 1e3 * around.line]))
    axes.set_xlabel("forward  ←   mm   →  back")
    axes.set_ylabel("up (mm)")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    axes.set_title(
        "midsagittal plane: sections across the midline, with their distances from the glottis in mm", loc="left", fontsize=10
    )


def _draw_areas(axes: Axes, airway: Airway) -> None:
    """The area function: a bar for each section, grey where it is assumed."""
    plain(axes)
    labels: set[str] = set()
    for section in airway.sections:
        assumed = section.source == "assumed"
        label = "assumed" if assumed else section.region
        colour = ASSUMED_COLOUR if assumed else REGION_COLOURS[section.region]
        axes.bar(
            section.from_mm,
            section.area_mm2,
            section.to_mm - section.from_mm,
            align="edge",
            color=colour,
            edgecolor="white",
            linewidth=0.4,
            label=None if label in labels else label,
        )
        labels.add(label)
    axes.set_ylim(0.0, LEGEND_ROOM_SHARE * max(section.area_mm2 for section in airway.sections))
    axes.set_xlabel("from the glottis to the lips (mm)")
    axes.set_ylabel("area (mm²)")
    axes.legend(frameon=False, fontsize=9, ncol=3, loc="upper center")
    axes.set_title("area function", loc="left", fontsize=10)


def _draw_spectrum(axes: Axes, airway: Airway) -> None:
    """The transfer function from the flow at the glottis to that at the lips, with the formants."""
    plain(axes)
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("lips over glottis (dB)")
    axes.set_xlim(0.0, HIGHEST_SHOWN_HZ)
    if airway.closed:
        axes.set_title("closed: no formants", loc="left", fontsize=10)
        return
    frequency = np.arange(SPECTRUM_STEP_HZ, HIGHEST_SHOWN_HZ, SPECTRUM_STEP_HZ)
    gain = -20.0 * np.log10(np.abs(flow_ratio(2j * np.pi * frequency, tube_of(airway.sections), ALL_LOSSES)))
    axes.plot(frequency, gain, color="black", lw=1.4)
    top = gain.max() + 0.28 * float(np.ptp(gain))
    axes.set_ylim(gain.min(), top)
    for number, formant in enumerate(airway.formants, 1):
        colour = COLOURS[number - 1]
        axes.axvline(formant.frequency_hz, color=colour, lw=1.2, ls="--")
        axes.annotate(
            f"F{number}\n{formant.frequency_hz:.0f}",
            (formant.frequency_hz, top),
            (3, -3),
            textcoords="offset points",
            va="top",
            fontsize=9,
            color=colour,
        )
    axes.set_title("transfer function and formants", loc="left", fontsize=10)


def _draw_formants(axes: Axes, result: Result) -> None:
    """F1, F2 and F3 over time; a gap where the airway is closed."""
    plain(axes)
    course = formant_course(result, max(1, len(result.times) // SAMPLES_OVER_TIME))
    for number, frequency in enumerate(course.frequency.T):
        axes.plot(1e3 * course.time, frequency, "-o", ms=3.0, color=COLOURS[number], label=f"F{number + 1}")
    axes.set_ylim(0.0, HIGHEST_SHOWN_HZ)
    axes.set_xlabel("time (ms)")
    axes.set_ylabel("frequency (Hz)")
    axes.legend(frameon=False, fontsize=9, ncol=3, loc="upper right")
    axes.set_title("formants over time", loc="left", fontsize=10)


def _draw_constriction(axes: Axes, result: Result) -> None:
    """Width of the constriction under the palate over time, and its place."""
    plain(axes)
    course = constriction_course(result, max(1, len(result.times) // (2 * SAMPLES_OVER_TIME)))
    axes.plot(1e3 * course.time, 1e3 * course.width, color=CONSTRICTION, lw=1.8)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time (ms)")
    axes.set_ylabel("width (mm)", color=CONSTRICTION)
    other = axes.twinx()
    other.spines[["top"]].set_visible(False)
    other.plot(1e3 * course.time, 1e3 * course.place, color=COLOURS[0], lw=1.4, ls="--")
    other.set_ylim(bottom=0.0)
    other.set_ylabel("place behind the incisors (mm)", color=COLOURS[0])
    axes.set_title("constriction under the palate over time", loc="left", fontsize=10)
