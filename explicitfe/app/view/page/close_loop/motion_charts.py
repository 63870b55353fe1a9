"""The picture of the residuals of markers: over time, and their spectrum next to that of the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.page.close_loop.motion_film import AXES_OF_MODEL, largest_coordinate, largest_motion
from explicitfe.app.view.page.close_loop.pictures import PAGE_DOTS_PER_INCH
from explicitfe.app.view.page.close_loop.reading import has_changed
from explicitfe.app.view.page.words import finite, model_names, shortened
from explicitfe.app.view.palette import AFTER, BEFORE, new_figure, plain
from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.motion_report import MovingMarkers

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The picture has a row for each curve and a column for each marker, those that move most; the tables have all of them.
MOST_CURVES_WITH_MARKERS, MOST_MARKERS_OF_A_CURVE = 6, 4
# The spectrum is drawn up to the highest frequency with this share of the largest amplitude, times a factor.
HIGH_AMPLITUDE_SHARE, FREQUENCY_MARGIN_FACTOR = 0.1, 2.5
# Amplitudes below this share of the largest one are not drawn.
SMALLEST_AMPLITUDE_SHARE = 1e-4
FEWEST_ROWS_OF_SPECTRUM = 8


def marker_charts(report: LoopReport, markers: Sequence[MovingMarkers]) -> Figure | None:
    """Distance of model and data of each marker over time, and amplitude spectra; None if no marker was measured."""
    drawn = [one for one in markers if len(one.time_s) > 1 and np.isfinite(one.measured).any()]
    drawn = sorted(drawn, key=lambda one: (one.split != "holdout", -largest_motion(one)))[:MOST_CURVES_WITH_MARKERS]
    if not drawn:
        return None
    columns = min(max(len(one.names) for one in drawn), MOST_MARKERS_OF_A_CURVE)
    figure = new_figure(11.8, 0.9 + 1.9 * len(drawn), PAGE_DOTS_PER_INCH)
    grid = figure.subplots(len(drawn), columns + 1, squeeze=False, width_ratios=[1.0] * columns + [1.5])
    for row, one in zip(grid, drawn, strict=True):
        _draw_distances(row[:-1], report, one)
        _draw_spectrum(row[-1], report, one)
    for axes in grid[:-1].flat:
        axes.set_xlabel("")
    entries: dict[str, Artist] = {}
    for axes in grid.T[::-1].flat:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(list(entries.values()), list(entries), loc="outside upper left", ncols=4, frameon=False, fontsize=9)
    return figure


def _models(report: LoopReport, one: MovingMarkers) -> list[tuple[str, np.ndarray, str, str]]:
    """Legend, displacements (k, s, 3), colour and kind of line of each model."""
    names = model_names(report)
    if not has_changed(report):
        return [(names[0], one.before, BEFORE, "--")]
    pairs = ((f"before: {names[0]}", one.before, BEFORE, "--"), (f"after: {names[1]}", one.after, AFTER, "-"))
    return [(shortened(name, 60), path, colour, line) for name, path, colour, line in pairs]


def _draw_distances(panels: Sequence[Axes], report: LoopReport, one: MovingMarkers) -> None:
    """The distance of model and data over time, a panel for each marker."""
    motion = np.nan_to_num(np.linalg.norm(one.measured, axis=2)).max(axis=0)
    shown = sorted(np.argsort(-motion)[: len(panels)])
    repeats = report.repeats.rms.get(one.curve) if report.repeats else None
    highest = 0.0
    for axes, number in zip(panels, shown, strict=False):
        for name, path, colour, line in _models(report, one):
            distance = np.linalg.norm(path[:, number] - one.measured[:, number], axis=1)
            highest = max(highest, float(np.nanmax(distance, initial=0.0)))
            axes.plot(one.time_s, distance, line, color=colour, lw=1.2, label=name)
        if finite(repeats):
            axes.axhline(repeats, color="0.35", lw=1.0, ls=":", label="rms distance of two repeats")
        first = number == shown[0]
        held = "held out: " if one.split == "holdout" else ""
        curve = f"{held}{shortened(one.curve, 30)}\n" if first else "\n"
        axes.set_title(
            f"{curve}{shortened(one.names[number], 24)}", loc="left", fontsize=8.5, weight="bold" if first and held else "normal"
        )
        axes.set_xlabel("time (s)", fontsize=8)
        axes.tick_params(labelsize=7.5, labelleft=first)
        plain(axes)
    for axes in panels:
        axes.set_ylim(0.0, 1.08 * max(highest, repeats if finite(repeats) else 0.0) or 1.0)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    panels[0].set_ylabel("distance of model\nand data (mm)", fontsize=8)


def _draw_spectrum(axes: Axes, report: LoopReport, one: MovingMarkers) -> None:
    """Amplitude spectra of the data and of the residuals of the coordinate with the largest motion."""
    marker, axis = largest_coordinate(one)
    measured = one.measured[:, marker, axis]
    frequency, amplitude = amplitude_spectrum(one.time_s, measured)
    plain(axes)
    where = f"{shortened(one.names[marker], 24)} along {AXES_OF_MODEL[axis]}"
    axes.set_title(f"{where}: spectrum of the data,\nand of the residual before and after", loc="left", fontsize=8.5)
    axes.tick_params(labelsize=7.5)
    if not len(frequency):
        return
    axes.plot(frequency, amplitude, color="black", lw=1.6, label="measured")
    for name, path, colour, line in _models(report, one):
        residual = amplitude_spectrum(one.time_s, path[:, marker, axis] - measured)
        axes.plot(*residual, line, color=colour, lw=1.2, label=name)
    last = frequency[np.flatnonzero(amplitude >= HIGH_AMPLITUDE_SHARE * amplitude.max())[-1]]
    axes.set_xlim(0.0, min(FREQUENCY_MARGIN_FACTOR * last, frequency[-1]))
    if amplitude.max() > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(bottom=max(SMALLEST_AMPLITUDE_SHARE * amplitude.max(), axes.get_ylim()[0]))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel("frequency (Hz)", fontsize=8)
    axes.set_ylabel("amplitude (mm)", fontsize=8)


def amplitude_spectrum(time_s: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes of the harmonic parts of a coordinate without its mean.

    Missing values are interpolated.

    Returns
    -------
    Frequencies (n,) Hz above zero, and amplitudes (n,) in the unit of y; both empty if too few values are known.
    """
    known = np.isfinite(y)
    if known.sum() < FEWEST_ROWS_OF_SPECTRUM:
        return np.zeros(0), np.zeros(0)
    grid = np.linspace(time_s[0], time_s[-1], len(time_s))
    even = np.interp(grid, time_s[known], y[known])
    amplitude = 2.0 / len(grid) * np.abs(np.fft.rfft(even - even.mean()))
    return np.fft.rfftfreq(len(grid), grid[1] - grid[0])[1:], amplitude[1:]
