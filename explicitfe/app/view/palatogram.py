"""Picture of the contact of tongue and palate as in electropalatography: patterns, contact area and force over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.palette import COLOURS, GRID, plain
from explicitfe.app.view.times import DRAWN_TIMES, milliseconds
from explicitfe.results.files import Result
from explicitfe.results.measure.document import ContactCourse, PalatogramPattern
from explicitfe.results.measure.electrodes import ELECTRODE_COLUMNS, ELECTRODE_ROWS
from explicitfe.results.measure.palatogram import ContactHistory, contact_history

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TOUCHED, FREE = "black", "white"
# Half the edge of the square of an electrode, of which one has an edge of 1 to itself.
HALF_SQUARE = 0.44


def palatogram_figure(result: Result, step: int, steps: Sequence[int] | None = None) -> Figure | None:
    """The pattern of most contact, patterns over time, contact area and force; None without electrodes.

    ``steps`` have a pattern each; by default some from the first contact to the last.
    """
    history = contact_history(result, step)
    if history is None:
        return None
    figure = result_figure(result, 7.6, "Contact with the palate as in electropalatography")
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.15, 1.0])[:, 0]
    large, series = upper.subfigures(1, 2, squeeze=False, width_ratios=[1.0, 1.35])[0]
    most = history.most
    axes = large.subplots()
    _draw_pattern(axes, history.pattern(most))
    _name_sides(axes, history)
    time = milliseconds(result.times[[most]], result.times[step])[0]
    count = history.course.contacts[most]
    axes.set_title(
        f"most contact: {count} of 62 electrodes in contact, first at {time}" if count else "no electrode in contact", fontsize=10
    )

    steps = _drawn_steps(history) if steps is None else steps
    for each, number in zip(np.ravel(series.subplots(2, (len(steps) + 1) // 2, squeeze=False)), steps, strict=False):
        _draw_pattern(each, history.pattern(number))
        each.set_title(milliseconds(result.times[[number]], result.times[step])[0], fontsize=9)
    for each in series.axes[len(steps) :]:
        each.set_axis_off()
    _draw_course(lower.subplots(3, 1, sharex=True), history.course)
    return figure


def _drawn_steps(history: ContactHistory) -> list[int]:
    """Steps equally far apart from the last before the first contact to the first after the last contact; of none over all."""
    touched = np.flatnonzero(history.on.any(axis=1))
    first, last = (max(0, touched[0] - 1), touched[-1] + 1) if len(touched) else (0, len(history.on) - 1)
    return sorted({round(step) for step in np.linspace(first, min(last, len(history.on) - 1), DRAWN_TIMES)})


def _draw_pattern(axes: Axes, pattern: PalatogramPattern) -> None:
    """Draw a pattern with the front up and the speaker's left at the left: a square for each electrode, filled where it is on."""
    from matplotlib.patches import Rectangle

    for row, states in enumerate(pattern.electrodes):
        for column, on in enumerate(states):
            if on is None:
                continue
            corner = (column - HALF_SQUARE, row - HALF_SQUARE)
            square = Rectangle(corner, 2 * HALF_SQUARE, 2 * HALF_SQUARE, fc=TOUCHED if on else FREE, ec="0.6", lw=0.6)
            axes.add_patch(square)
    axes.set_xlim(-0.7, ELECTRODE_COLUMNS - 0.3)
    axes.set_ylim(ELECTRODE_ROWS - 0.3, -0.7)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)


def _name_sides(axes: Axes, history: ContactHistory) -> None:
    """Name the sides of a pattern and the rows, with how far these lie behind the edge of the incisors."""
    labels = [f"{row + 1}   {1e3 * place:.0f} mm" for row, place in enumerate(history.at.row_places)]
    axes.set_yticks(range(ELECTRODE_ROWS), labels, fontsize=8)
    axes.tick_params(length=0)
    axes.set_ylabel("row, and its distance behind the incisors", fontsize=9)
    axes.set_xlabel("left  ←   speaker   →  right\n(top: behind the incisors; bottom: end of the hard palate)", fontsize=9)


def _draw_course(panels: np.ndarray, course: ContactCourse) -> None:
    """Draw contacts, area and force over time."""
    lines = (
        (np.array(course.contacts), "electrodes\nin contact"),
        (np.array(course.area_mm2), "contact\narea (mm²)"),
        (np.array(course.force_N), "normal force\nsum (N)"),
    )
    for axes, (values, label), colour in zip(panels, lines, COLOURS, strict=False):
        plain(axes)
        axes.fill_between(course.time_ms, values, color=GRID, lw=0, zorder=0)
        axes.plot(course.time_ms, values, color=colour, lw=1.6)
        axes.set_ylabel(label, fontsize=9)
        axes.set_xlim(0.0, course.time_ms[-1])
        axes.set_ylim(0.0, 1.1 * values.max() if values.any() else 1.0)
    panels[0].set_title("contact area and normal force sum of the whole palate, including teeth and velum", fontsize=10)
    panels[-1].set_xlabel("time (ms)")
