"""The moving picture of a report: measured and simulated markers over each other, before and after."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.gif import gif_bytes
from explicitfe.app.view.page.close_loop.motion_tables import motion_errors
from explicitfe.app.view.page.close_loop.reading import has_changed
from explicitfe.app.view.page.words import bare, finite, model_names, number, shortened
from explicitfe.app.view.palette import AFTER, BEFORE, new_figure, plain, use_plain_text
from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.motion_report import MovingMarkers

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

AXES_OF_MODEL = "xyz"
FILM_DOTS_PER_INCH, FILM_WIDTH_IN, FILM_COLOURS = 96, 11.0, 48
# The first frame is a summary for paper; it stands for some time, and then the markers move.
SUMMARY_FRAME_S, MOVING_S, MOST_MOVING_FRAMES = 2.0, 6.5, 93
# The film ends where no marker is farther from its place at the end than this share of the largest such distance ...
SETTLED_SHARE = 0.05
# ... where the last share of the recording tells this place; and after so many periods of the vibration.
PLACE_AT_END_SHARE, PERIODS_SHOWN = 0.15, 10.0
# A trail is as long as this share of the film.
TRAIL_SHARE = 0.08
# Smaller displacements, as a share of the size of the body, are drawn larger by the largest of these factors that fits.
VISIBLE_SHARE, ENLARGEMENT_FACTORS = 0.12, (1000, 500, 200, 100, 50, 20, 10, 5, 2)
# Names stand at the markers if there are not more.
MOST_NAMED_MARKERS = 8
MARGIN_OF_VIEW_SHARE = 0.06
SHORTEST_PANEL_IN, TALLEST_PANEL_IN, TITLES_IN, HISTORY_IN = 1.6, 4.6, 1.5, 1.7


@dataclass(frozen=True, eq=False)
class FilmedCurve:
    """A curve as the film shows it: positions in the plane of the largest motion, mm.

    Attributes
    ----------
    plane : numbers of the horizontal and the vertical axis.
    enlarged : factor by which displacements are drawn larger.
    time_s : (k,) since the start of the motion.
    at_rest : (s, 2) of the markers; ``outline`` (e, 2, 2) of the body.
    measured, models : (k, s, 2) as measured, and by each model.
    histories : (k,) measured, and by each model, of the coordinate with the largest motion; ``history_label`` says which.
    rows : of the k samples, those of the moving frames.
    worst : the row in which measured and first model are farthest from each other.
    """

    plane: tuple[int, int]
    enlarged: int
    time_s: np.ndarray
    at_rest: np.ndarray
    outline: np.ndarray
    measured: np.ndarray
    models: list[np.ndarray]
    histories: list[np.ndarray]
    history_label: str
    rows: np.ndarray
    worst: int


def choose_curve(markers: Sequence[MovingMarkers]) -> MovingMarkers | None:
    """The curve with the largest motion among the held-out ones, or among the fitted ones if none is held out."""
    drawable = [one for one in markers if len(one.time_s) > 1 and np.isfinite(one.measured).any()]
    return max(drawable, key=lambda one: (one.split == "holdout", largest_motion(one)), default=None)


def largest_motion(one: MovingMarkers) -> float:
    """The largest measured distance of a marker from its position at rest, mm."""
    return float(np.nanmax(np.linalg.norm(one.measured, axis=2), initial=0.0))


def largest_coordinate(one: MovingMarkers) -> tuple[int, int]:
    """Numbers of the marker and of the axis with the largest measured motion."""
    span = np.nanmax(one.measured, axis=0, initial=-np.inf) - np.nanmin(one.measured, axis=0, initial=np.inf)
    marker, axis = np.unravel_index(int(np.argmax(span)), span.shape)
    return int(marker), int(axis)


def motion_film(report: LoopReport, markers: Sequence[MovingMarkers]) -> bytes | None:
    """The moving picture as a GIF; None if no marker was measured."""
    one = choose_curve(markers)
    if one is None:
        return None
    filmed = _project(report, one)
    stage = _Stage(report, one, filmed)
    frames = [stage.summary(), *(stage.frame(row) for row in filmed.rows)]
    moving_s = MOVING_S / max(len(filmed.rows), 1)
    return gif_bytes(frames, [SUMMARY_FRAME_S, *[moving_s] * len(filmed.rows)], FILM_COLOURS)


def _project(report: LoopReport, one: MovingMarkers) -> FilmedCurve:
    """Project a curve onto the plane of its motion, and choose the samples that are shown."""
    measured = np.where(np.isfinite(one.measured), one.measured, np.nan)
    span = np.nanmax(measured, axis=(0, 1), initial=0.0) - np.nanmin(measured, axis=(0, 1), initial=0.0)
    plane = [axis for axis in range(3) if axis != int(np.argmin(span))]
    at_rest, outline = one.at_rest[:, plane], one.outline[..., plane].reshape(-1, 2, 2)
    size = float(np.ptp(np.concatenate([at_rest, outline.reshape(-1, 2)]), axis=0).max())
    largest = largest_motion(one)
    fitting = [factor for factor in ENLARGEMENT_FACTORS if factor * largest <= VISIBLE_SHARE * size]
    enlarged = fitting[0] if fitting and largest > 0.0 else 1
    models = [one.before, one.after] if has_changed(report) else [one.before]
    rows = _frame_rows(report, one)
    distance = np.nansum(np.linalg.norm(one.before - measured, axis=2), axis=1)
    paths = [at_rest + enlarged * path[..., plane] for path in (measured, *models)]
    worst = int(rows[np.argmax(distance[rows])])
    marker, axis = largest_coordinate(one)
    return FilmedCurve(
        (plane[0], plane[1]),
        enlarged,
        one.time_s,
        at_rest,
        outline,
        paths[0],
        paths[1:],
        [path[:, marker, axis] for path in (measured, *models)],
        f"{shortened(one.names[marker], 20)}: {AXES_OF_MODEL[axis]} displacement (mm)",
        rows,
        worst,
    )


def _frame_rows(report: LoopReport, one: MovingMarkers) -> np.ndarray:
    """Samples at even times from the start until the motion has settled or many periods are over."""
    time, duration = one.time_s, float(np.ptp(one.time_s))
    last = time >= time[-1] - PLACE_AT_END_SHARE * duration
    counted = np.maximum(np.isfinite(one.measured[last]).sum(axis=0), 1)
    distance = np.linalg.norm(one.measured - np.nansum(one.measured[last], axis=0) / counted, axis=2)
    distance = np.nanmax(distance, axis=1, initial=0.0)
    end = float(time[np.flatnonzero(distance >= SETTLED_SHARE * distance.max())[-1]])
    frequencies = [row.measured.frequency_Hz for row in report.motion if row.curve == one.curve]
    known = [f for f in frequencies if finite(f) and f > 0.0]
    if known:
        end = min(end, float(time[0]) + PERIODS_SHOWN / float(np.median(known)))
    wanted = np.linspace(time[0], max(end, time[1]), MOST_MOVING_FRAMES)
    return np.unique(np.abs(time[:, None] - wanted).argmin(axis=0))


class _Stage:
    """The figure of the film: what stands still is drawn once, and what moves is drawn upon it in each frame."""

    def __init__(self, report: LoopReport, one: MovingMarkers, filmed: FilmedCurve) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self.filmed = filmed
        self.figure = _figure(filmed)
        heights = [self.figure.get_figheight() - HISTORY_IN, HISTORY_IN]
        upper, lower = self.figure.subfigures(2, 1, squeeze=False, height_ratios=heights).ravel()
        panels = upper.subplots(1, len(filmed.models), squeeze=False, sharey=True)[0]
        self.panels = [
            _Panel(axes, filmed, model, colour)
            for axes, model, colour in zip(panels, filmed.models, (BEFORE, AFTER), strict=False)
        ]
        _title_panels(panels, report, one.curve)
        _scale_panels(panels, filmed)
        for axes in panels:
            _name_markers(axes, filmed, one.names)
        self.cursor, self.clock = _draw_histories(lower.subplots(), filmed)
        handles = [self.panels[0].body, self.panels[0].circles, *(panel.dots for panel in self.panels)]
        labels = ["body at rest", "measured", *(["before", "after"] if len(panels) > 1 else ["model"])]
        title = _heading(one, filmed)
        upper.legend(
            handles, labels, title=title, loc="outside upper left", ncols=4, frameon=False, fontsize=10, alignment="left"
        )
        use_plain_text(self.figure)
        self.canvas = FigureCanvasAgg(self.figure)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # drawn as a box, which is seen
            self.canvas.draw()
        self.figure.set_layout_engine("none")
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)

    def summary(self) -> np.ndarray:
        """The first frame: whole paths, and the markers when measured and model are farthest from each other."""
        row = self.filmed.worst
        for panel in self.panels:
            panel.show_paths(row)
        which = "the model before" if len(self.panels) > 1 else "the model"
        return self._draw_frame(row, f"summary: whole paths, and the markers when {which} and the data differ most")

    def frame(self, row: int) -> np.ndarray:
        """A frame of the motion."""
        time, rows = self.filmed.time_s, self.filmed.rows
        shown_s = float(time[rows[-1]] - time[rows[0]])
        speed = f"{bare(shown_s)} s of the recording take {bare(MOVING_S)} s here"
        since = time[row] - TRAIL_SHARE * shown_s
        trail = np.flatnonzero((time >= since) & (np.arange(len(time)) <= row))
        for panel in self.panels:
            panel.show_trail(row, trail)
        return self._draw_frame(row, speed)

    def _draw_frame(self, row: int, note: str) -> np.ndarray:
        """Draw what moves upon what stands still; (height, width, 3) bytes."""
        self.canvas.restore_region(self.still)
        for panel in self.panels:
            for artist in panel.moving:
                panel.axes.draw_artist(artist)
        time_s = self.filmed.time_s[row]
        self.cursor.set_xdata([time_s, time_s])
        self.clock.set_text(f"time {time_s:.3f} s   ({note})")
        for artist in (self.cursor, self.clock):
            self.figure.draw_artist(artist)
        return np.array(self.canvas.buffer_rgba())[..., :3]


class _Panel:
    """Measured markers and those of one model."""

    def __init__(self, axes: Axes, filmed: FilmedCurve, model: np.ndarray, colour: str) -> None:
        from matplotlib.collections import LineCollection

        self.axes, self.measured, self.model = axes, filmed.measured, model
        self.body = LineCollection(list(filmed.outline), colors="0.6", linewidths=1.0, zorder=0)
        axes.add_collection(self.body)
        self.measured_path = LineCollection([], colors="0.75", linewidths=5.0)
        self.model_path = LineCollection([], colors=colour, linewidths=1.0)
        self.trail = LineCollection([], linewidths=3.0)
        self.gaps = LineCollection([], colors=colour, linewidths=1.4)
        for lines in (self.measured_path, self.model_path, self.trail, self.gaps):
            axes.add_collection(lines)
        (self.dots,) = axes.plot([], [], "o", color=colour, ms=6.5, mew=0)
        (self.circles,) = axes.plot([], [], "o", color="black", mfc="none", ms=10, mew=1.3)
        self.moving: list[Artist] = [self.measured_path, self.model_path, self.trail, self.gaps, self.dots, self.circles]
        for artist in self.moving:
            artist.set_animated(True)

    def show_paths(self, row: int) -> None:
        """Whole paths, and the markers in a row."""
        self.measured_path.set_segments(list(self.measured.transpose(1, 0, 2)))
        self.model_path.set_segments(list(self.model.transpose(1, 0, 2)))
        self.trail.set_segments([])
        self._place(row)

    def show_trail(self, row: int, trail: np.ndarray) -> None:
        """The markers in a row, with the last part of the measured paths, which fades with its age."""
        self.measured_path.set_segments([])
        self.model_path.set_segments([])
        pieces = np.stack([self.measured[trail[:-1]], self.measured[trail[1:]]], axis=2).reshape(-1, 2, 2)
        shades = np.repeat(np.linspace(0.9, 0.4, max(len(trail) - 1, 0)), self.measured.shape[1])
        self.trail.set_segments(list(pieces))
        self.trail.set_color([f"{shade:.3f}" for shade in shades])
        self._place(row)

    def _place(self, row: int) -> None:
        """Put circles and dots, and a line between those of a marker."""
        self.circles.set_data(*self.measured[row].T)
        self.dots.set_data(*self.model[row].T)
        self.gaps.set_segments(list(np.stack([self.measured[row], self.model[row]], axis=1)))


def _figure(filmed: FilmedCurve) -> Figure:
    """An empty figure that is as high as its panels need."""
    low, high = _view(filmed)
    panel_in = (FILM_WIDTH_IN - 1.0) / len(filmed.models)
    height_in = float(np.clip(panel_in * (high[1] - low[1]) / (high[0] - low[0]), SHORTEST_PANEL_IN, TALLEST_PANEL_IN))
    return new_figure(FILM_WIDTH_IN, height_in + TITLES_IN + HISTORY_IN, FILM_DOTS_PER_INCH)


def _view(filmed: FilmedCurve) -> tuple[np.ndarray, np.ndarray]:
    """The lower left and the upper right corner of what is drawn, mm."""
    every = [filmed.outline, filmed.at_rest, filmed.measured, *filmed.models]
    points = np.concatenate([part.reshape(-1, 2) for part in every])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = MARGIN_OF_VIEW_SHARE * float((high - low).max()) or 1.0
    return low - margin, high + margin


def _heading(one: MovingMarkers, filmed: FilmedCurve) -> str:
    """The curve, and how it is seen."""
    view = AXES_OF_MODEL[3 - sum(filmed.plane)]
    larger = f", displacements enlarged {filmed.enlarged} times" if filmed.enlarged > 1 else ""
    return f"{shortened(one.curve, 60)} ({'held out' if one.split == 'holdout' else 'fitted'}), view along {view}{larger}"


def _draw_histories(axes: Axes, filmed: FilmedCurve) -> tuple[Line2D, Text]:
    """The coordinate with the largest motion over time; returns the line of the present time and the text above, which move."""
    shown = slice(0, int(filmed.rows[-1]) + 1)
    styles = (("0.0", "-", 2.2), (BEFORE, "--", 1.4), (AFTER, "-", 1.4))
    for history, (colour, line, width) in zip(filmed.histories, styles, strict=False):
        axes.plot(filmed.time_s[shown], history[shown], line, color=colour, lw=width)
    axes.set_xlabel("time (s)", fontsize=9)
    axes.set_ylabel(filmed.history_label.replace(": ", ":\n").replace(" (", "\n("), fontsize=9)
    axes.tick_params(labelsize=9)
    axes.margins(x=0.01)
    plain(axes)
    cursor = axes.axvline(0.0, color="0.3", lw=1.5, animated=True)
    clock = axes.set_title(" ", loc="left", fontsize=11)
    clock.set_animated(True)
    return cursor, clock


def _title_panels(panels: Sequence[Axes], report: LoopReport, curve: str) -> None:
    """Titles with the names of the models and their errors."""
    errors = [(row.before, row.after) for row in motion_errors(report) if row.curve == curve] or [(None, None)]
    rows = zip(panels, ("before", "after"), model_names(report), errors[0], (BEFORE, AFTER), strict=False)
    for axes, stage, name, rms, colour in rows:
        title = shortened(f"{stage}: {name}" if len(panels) > 1 else name, 62)
        title += f"\nrms distance {number(rms)} mm" if finite(rms) else ""
        axes.set_title(title, loc="left", fontsize=11, color=colour)


def _scale_panels(panels: Sequence[Axes], filmed: FilmedCurve) -> None:
    """Equal scales and the names of the axes."""
    low, high = _view(filmed)
    for axes in panels:
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal")
        axes.set_xlabel(f"{AXES_OF_MODEL[filmed.plane[0]]} (mm)", fontsize=9)
        axes.tick_params(labelsize=9)
        plain(axes)
        axes.grid(visible=False)  # the body has straight edges, too
    panels[0].set_ylabel(f"{AXES_OF_MODEL[filmed.plane[1]]} (mm)", fontsize=9)


def _name_markers(axes: Axes, filmed: FilmedCurve, names: Sequence[str]) -> None:
    """Crosses at the positions of the markers at rest, with their names."""
    axes.plot(*filmed.at_rest.T, "+", color="0.6", ms=6, mew=1.0)
    for name, place in zip(names, filmed.at_rest, strict=True):
        if len(names) <= MOST_NAMED_MARKERS:
            axes.annotate(shortened(name, 14), place, (7, 7), textcoords="offset points", fontsize=8.5, color="0.35")
