"""Charts of the residuals of markers: over time, and their spectrum next to that of the data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from explicitfe.app.view.page.chart import Chart, Line, chart
from explicitfe.app.view.page.close_loop.motion_film import AXES_OF_MODEL, largest_coordinate, largest_motion
from explicitfe.app.view.page.close_loop.pictures import AFTER_COLOUR, BEFORE_COLOUR, BEFORE_DASH, DATA_COLOUR
from explicitfe.app.view.page.close_loop.reading import has_changed
from explicitfe.app.view.page.words import finite, model_names, shortened
from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.motion_report import MovingMarkers

# A row of charts for each curve and a column for each marker, those that move most; the tables have all of them.
MOST_CURVES_WITH_MARKERS, MOST_MARKERS_OF_A_CURVE = 6, 4
# The spectrum is drawn up to the highest frequency with this share of the largest amplitude, times a factor.
HIGH_AMPLITUDE_SHARE, FREQUENCY_MARGIN_FACTOR = 0.1, 2.5
# Amplitudes below this share of the largest one are not drawn.
SMALLEST_AMPLITUDE_SHARE = 1e-4
FEWEST_ROWS_OF_SPECTRUM = 8


def marker_charts(report: LoopReport, markers: Sequence[MovingMarkers]) -> list[list[Chart | None]]:
    """Of each curve the distance of model and data of each marker over time, and spectra; all rows are equally long."""
    drawn = [one for one in markers if len(one.time_s) > 1 and np.isfinite(one.measured).any()]
    drawn = sorted(drawn, key=lambda one: (one.split != "holdout", -largest_motion(one)))[:MOST_CURVES_WITH_MARKERS]
    columns = min(max((len(one.names) for one in drawn), default=0), MOST_MARKERS_OF_A_CURVE)
    rows = []
    for one in drawn:
        distances = list(_distances(report, one))
        rows.append([*distances, *[None] * (columns - len(distances)), _spectrum(report, one)])
    return rows


def _models(report: LoopReport, one: MovingMarkers) -> list[tuple[str, np.ndarray, int, int]]:
    """Legend, displacements (k, s, 3), colour and kind of line of each model."""
    names = model_names(report)
    if not has_changed(report):
        return [(names[0], one.before, BEFORE_COLOUR, BEFORE_DASH)]
    before = (f"before: {shortened(names[0], 52)}", one.before, BEFORE_COLOUR, BEFORE_DASH)
    return [before, (f"after: {shortened(names[1], 52)}", one.after, AFTER_COLOUR, 0)]


def _distances(report: LoopReport, one: MovingMarkers) -> Iterator[Chart | None]:
    """The distance of model and data over time, a chart for each marker with one range for all."""
    motion = np.nan_to_num(np.linalg.norm(one.measured, axis=2)).max(axis=0)
    repeats = report.repeats.rms.get(one.curve) if report.repeats else None
    panels, ends = [], one.time_s[[0, -1]]
    for number in sorted(np.argsort(-motion)[:MOST_MARKERS_OF_A_CURVE]):
        lines = [
            Line(name, one.time_s, np.linalg.norm(path[:, number] - one.measured[:, number], axis=1), colour=colour, dash=dash)
            for name, path, colour, dash in _models(report, one)
        ]
        if finite(repeats):
            lines.append(Line("rms distance of two repeats", ends, np.full(2, repeats), colour=DATA_COLOUR, dash=2))
        panels.append((one.names[number], lines))
    highest = max(float(np.nanmax(line.y, initial=0.0)) for _, lines in panels for line in lines)
    for position, (name, lines) in enumerate(panels):
        lines = [replace(line, name="") for line in lines] if position else lines
        title = f"{'held out: ' if one.split == 'holdout' else ''}{shortened(one.curve, 30)}, {shortened(name, 24)}"
        y_range = (0.0, highest or 1.0)
        yield chart(title, lines, x_label="time (s)", y_label="distance of model and data (mm)", y_range=y_range)


def _spectrum(report: LoopReport, one: MovingMarkers) -> Chart | None:
    """Amplitude spectra of the data and of the residuals of the coordinate with the largest motion."""
    marker, axis = largest_coordinate(one)
    measured = one.measured[:, marker, axis]
    frequency, amplitude = amplitude_spectrum(one.time_s, measured)
    if not len(frequency):
        return None
    last = frequency[np.flatnonzero(amplitude >= HIGH_AMPLITUDE_SHARE * amplitude.max())[-1]]
    shown, least = frequency <= FREQUENCY_MARGIN_FACTOR * last, SMALLEST_AMPLITUDE_SHARE * amplitude.max()
    spectra = [("measured", amplitude, DATA_COLOUR, 0)]
    for name, path, colour, dash in _models(report, one):
        residual = amplitude_spectrum(one.time_s, path[:, marker, axis] - measured)[1]
        spectra.append((name, residual, colour, dash))
    lines = [
        Line(name, frequency[shown], np.where(y >= least, y, np.nan)[shown], colour=colour, dash=dash)
        for name, y, colour, dash in spectra
        if len(y)
    ]
    title = f"spectra of {shortened(one.names[marker], 24)} along {AXES_OF_MODEL[axis]}"
    return chart(title, lines, x_label="frequency (Hz)", y_label="amplitude (mm)", logarithmic=bool(amplitude.max() > 0.0))


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
