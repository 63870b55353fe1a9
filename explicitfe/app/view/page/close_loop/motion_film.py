"""The moving picture of a report: measured and simulated markers over each other, before and after."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
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
    from matplotlib.axes import Axes

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
    stage = _Stage(report, one)
    frames = [stage.summary(), *(stage.frame(row) for row in stage.rows)]
    moving_s = MOVING_S / max(len(stage.rows), 1)
    return gif_bytes(frames, [SUMMARY_FRAME_S, *[moving_s] * len(stage.rows)], FILM_COLOURS)


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
    """The figure of the film: what stands still is drawn once, and what moves is drawn upon it in each frame.

    Positions are in the plane of the largest motion, mm.
    """

    def __init__(self, report: LoopReport, one: MovingMarkers) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self.time_s, self.rows = one.time_s, _frame_rows(report, one)
        measured = np.where(np.isfinite(one.measured), one.measured, np.nan)
        self.worst = int(self.rows[np.argmax(np.nansum(np.linalg.norm(one.before - measured, axis=2), axis=1)[self.rows])])
        span = np.nanmax(measured, axis=(0, 1), initial=0.0) - np.nanmin(measured, axis=(0, 1), initial=0.0)
        plane = [axis for axis in range(3) if axis != int(np.argmin(span))]
        at_rest, outline = one.at_rest[:, plane], one.outline[..., plane].reshape(-1, 2, 2)
        size = float(np.ptp(np.concatenate([at_rest, outline.reshape(-1, 2)]), axis=0).max())
        fitting = [factor for factor in ENLARGEMENT_FACTORS if factor * largest_motion(one) <= VISIBLE_SHARE * size]
        enlarged = fitting[0] if fitting and largest_motion(one) > 0.0 else 1
        answers = [one.before, one.after] if has_changed(report) else [one.before]
        paths = [at_rest + enlarged * path[..., plane] for path in (measured, *answers)]
        points = np.concatenate([part.reshape(-1, 2) for part in (outline, at_rest, *paths)])
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        margin = MARGIN_OF_VIEW_SHARE * float((high - low).max()) or 1.0
        shape = (high[1] - low[1] + 2.0 * margin) / (high[0] - low[0] + 2.0 * margin)
        height_in = float(np.clip((FILM_WIDTH_IN - 1.0) / len(answers) * shape, SHORTEST_PANEL_IN, TALLEST_PANEL_IN))
        self.figure = new_figure(FILM_WIDTH_IN, height_in + TITLES_IN + HISTORY_IN, FILM_DOTS_PER_INCH)
        upper, lower = self.figure.subfigures(2, 1, squeeze=False, height_ratios=[height_in + TITLES_IN, HISTORY_IN]).ravel()
        panels = upper.subplots(1, len(answers), squeeze=False, sharey=True)[0]
        for axes in panels:
            (body,) = axes.plot(*_one_line(outline), color="0.6", lw=1.0, zorder=0)
            axes.set_xlim(low[0] - margin, high[0] + margin)
            axes.set_ylim(low[1] - margin, high[1] + margin)
            axes.set_aspect("equal")
            axes.set_xlabel(f"{AXES_OF_MODEL[plane[0]]} (mm)", fontsize=9)
            _name_markers(axes, at_rest, one.names)
        panels[0].set_ylabel(f"{AXES_OF_MODEL[plane[1]]} (mm)", fontsize=9)
        _title_panels(panels, report, one.curve)
        colours = (BEFORE, AFTER)
        self.panels = [_Panel(*each) for each in zip(panels, [paths[0]] * 2, paths[1:], colours, strict=False)]
        handles = [body, self.panels[0].circles, *(panel.dots for panel in self.panels)]
        labels = ["body at rest", "measured", *(["before", "after"] if len(panels) > 1 else ["model"])]
        larger = f", displacements enlarged {enlarged} times" if enlarged > 1 else ""
        side = "held out" if one.split == "holdout" else "fitted"
        title = f"{shortened(one.curve, 60)} ({side}), view along {AXES_OF_MODEL[3 - sum(plane)]}{larger}"
        upper.legend(
            handles, labels, title=title, loc="outside upper left", ncols=4, frameon=False, fontsize=10, alignment="left"
        )
        history, (marker, axis), shown = lower.subplots(), largest_coordinate(one), slice(0, int(self.rows[-1]) + 1)
        styles = (("0.0", "-", 2.2), (BEFORE, "--", 1.4), (AFTER, "-", 1.4))
        for path, (colour, line, width) in zip((measured, *answers), styles, strict=False):
            history.plot(self.time_s[shown], path[shown, marker, axis], line, color=colour, lw=width)
        history.set_xlabel("time (s)", fontsize=9)
        history.set_ylabel(f"{shortened(one.names[marker], 20)}:\n{AXES_OF_MODEL[axis]} displacement\n(mm)", fontsize=9)
        history.margins(x=0.01)
        for axes in (*panels, history):
            axes.tick_params(labelsize=9)
            plain(axes)
            axes.grid(visible=axes is history)  # the body has straight edges, too
        self.cursor = history.axvline(0.0, color="0.3", lw=1.5, animated=True)
        self.clock = history.set_title(" ", loc="left", fontsize=11)
        self.clock.set_animated(True)
        use_plain_text(self.figure)
        self.canvas = FigureCanvasAgg(self.figure)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # drawn as a box, which is seen
            self.canvas.draw()
        self.figure.set_layout_engine("none")
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)

    def summary(self) -> np.ndarray:
        """The first frame: whole paths, and the markers when measured and model are farthest from each other."""
        which = "the model before" if len(self.panels) > 1 else "the model"
        note = f"summary: whole paths, and the markers when {which} and the data differ most"
        return self._draw_frame(self.worst, slice(0), slice(None), note)

    def frame(self, row: int) -> np.ndarray:
        """A frame of the motion, with the last part of the measured paths."""
        shown_s = float(self.time_s[self.rows[-1]] - self.time_s[self.rows[0]])
        first = int(np.searchsorted(self.time_s, self.time_s[row] - TRAIL_SHARE * shown_s))
        note = f"{bare(shown_s)} s of the recording take {bare(MOVING_S)} s here"
        return self._draw_frame(row, slice(first, row + 1), slice(0), note)

    def _draw_frame(self, row: int, trail: slice, whole: slice, note: str) -> np.ndarray:
        """Draw what moves upon what stands still; (height, width, 3) bytes."""
        self.canvas.restore_region(self.still)
        for panel in self.panels:
            panel.draw(row, trail, whole)
        self.cursor.set_xdata([self.time_s[row]] * 2)
        self.clock.set_text(f"time {self.time_s[row]:.3f} s   ({note})")
        for artist in (self.cursor, self.clock):
            self.figure.draw_artist(artist)
        return np.array(self.canvas.buffer_rgba())[..., :3]


class _Panel:
    """Measured markers and those of one model, positions (k, s, 2) mm."""

    def __init__(self, axes: Axes, measured: np.ndarray, model: np.ndarray, colour: str) -> None:
        self.axes, self.measured, self.model = axes, measured, model
        looks = (("0.75", 5.0), (colour, 1.0), ("0.6", 3.0), (colour, 1.4))
        self.lines = [axes.plot([], [], color=own, lw=width, animated=True)[0] for own, width in looks]
        (self.dots,) = axes.plot([], [], "o", color=colour, ms=6.5, mew=0, animated=True)
        (self.circles,) = axes.plot([], [], "o", color="black", mfc="none", ms=10, mew=1.3, animated=True)

    def draw(self, row: int, trail: slice, whole: slice) -> None:
        """Draw the markers in a row, each joined with that of the model, with parts of the paths: a trail, or whole ones."""
        gaps = np.stack([self.measured[row], self.model[row]], axis=1)
        paths = (path.swapaxes(0, 1) for path in (self.measured[whole], self.model[whole], self.measured[trail]))
        for line, pieces in zip(self.lines, (*paths, gaps), strict=True):
            line.set_data(*_one_line(pieces))
        self.dots.set_data(*self.model[row].T)
        self.circles.set_data(*self.measured[row].T)
        for artist in (*self.lines, self.dots, self.circles):
            self.axes.draw_artist(artist)


def _one_line(pieces: np.ndarray) -> np.ndarray:
    """Lines (n, k, 2) as one line (2, n (k + 1)) with gaps."""
    gaps = np.full((len(pieces), 1, 2), np.nan)
    line: np.ndarray = np.concatenate([pieces, gaps], axis=1).reshape(-1, 2).T
    return line


def _title_panels(panels: Sequence[Axes], report: LoopReport, curve: str) -> None:
    """Titles with the names of the models and their errors."""
    errors = [(row.before, row.after) for row in motion_errors(report) if row.curve == curve] or [(None, None)]
    rows = zip(panels, ("before", "after"), model_names(report), errors[0], (BEFORE, AFTER), strict=False)
    for axes, stage, name, rms, colour in rows:
        title = shortened(f"{stage}: {name}" if len(panels) > 1 else name, 62)
        title += f"\nrms distance {number(rms)} mm" if finite(rms) else ""
        axes.set_title(title, loc="left", fontsize=11, color=colour)


def _name_markers(axes: Axes, at_rest: np.ndarray, names: Sequence[str]) -> None:
    """Crosses at the positions of the markers at rest, with their names."""
    axes.plot(*at_rest.T, "+", color="0.6", ms=6, mew=1.0)
    for name, place in zip(names, at_rest, strict=True):
        if len(names) <= MOST_NAMED_MARKERS:
            axes.annotate(shortened(name, 14), place, (7, 7), textcoords="offset points", fontsize=8.5, color="0.35")
