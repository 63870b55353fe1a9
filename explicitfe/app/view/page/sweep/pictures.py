"""Pictures of a sweep: outlines, effects of factors, heat maps of two, sensitivity indices with intervals, any two columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.chart_figure import draw_charts
from explicitfe.app.view.files import new_files, writing
from explicitfe.app.view.page.sweep.effects import effects_on
from explicitfe.app.view.page.sweep.heat_map import heat_maps
from explicitfe.app.view.page.sweep.scatter import scatter_chart
from explicitfe.app.view.palette import BONE_EDGE, COLOURS, FORMATS, GREY, WIDTH_IN, new_figure, plain, save
from explicitfe.platform.errors import InputError, Progress, nearest, shortened, silent
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.drawn import DrawnPictures
from explicitfe.results.documents.sweep_to_draw import MeasureIndices, SweepToDraw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Separates the two columns of a scatter plot.
AGAINST = ":"
MOST_MULTIPLES, MULTIPLES_IN_A_ROW = 12, 4
MOST_SETTINGS_WRITTEN = 4
MOST_MEASURES_DRAWN, MOST_FACTORS_DRAWN, PANELS_IN_A_ROW = 4, 6, 3
PANEL_HEIGHT_IN = 2.2
MOST_MAPS_DRAWN, MAP_HEIGHT_IN, MOST_TICKS_OF_A_MAP = 6, 2.4, 8
CLOUD_OPACITY = 0.15
SHARES_SHOWN = (-0.1, 1.1)


def draw_sweep(
    read: Callable[[Path, Progress], SweepToDraw],
    folder: Path,
    out: Path | None = None,
    *,
    only: Sequence[str] | None = None,
    file_format: str = "png",
    overwrite: bool = False,
    progress: Progress = silent,
) -> DrawnPictures:
    """Draw a sweep, as far as it is computed, as files ``<folder>-<picture>.<format>``.

    Parameters
    ----------
    read : reads the data of a sweep from its folder.
    folder : of the sweep.
    out : where the pictures go; into the folder's ``pictures`` if left out.
    only : of "outlines", "effects", "maps" and "indices", and pairs of columns such as
        "points.tip.up_mm:constriction.width_mm"; without it the four, as far as there is something to show.
    file_format : "png", "pdf" or "svg".

    Raises
    ------
    InputError : the folder holds no sweep or no row, a name or a format is unknown, or a file exists.
    """
    require("plots", "drawing pictures")
    if file_format not in FORMATS:
        raise InputError(f'pictures cannot be drawn as "{file_format}"; {nearest(file_format, FORMATS)}')
    names = list(PICTURES) if only is None else list(only)
    for name in names:
        if name not in PICTURES and AGAINST not in name:
            raise InputError(
                f'a sweep has no picture "{shortened(name)}"; {nearest(name, PICTURES)} Or two columns: A{AGAINST}B.'
            )
    sweep = read(folder, progress)
    out = folder / "pictures" if out is None else Path(out)
    files = {name: out / f"{folder.resolve().name}-{name.replace(AGAINST, '-against-')}.{file_format}" for name in names}
    new_files(files.values(), overwrite)
    drawn, notes = [], []
    for number, name in enumerate(names):
        progress("draw", number / len(names))
        figure = PICTURES[name](sweep) if name in PICTURES else against(sweep, *name.split(AGAINST, 1))
        if figure is None:
            if only is not None:
                notes.append(f"{folder} has no data for: {name}.")
            continue
        with writing(files[name]):
            save(figure, files[name])
        drawn.append(str(files[name]))
    progress("draw", 1.0)
    return {"result": str(folder), "files": drawn, "warnings": notes}


def outlines(sweep: SweepToDraw) -> Figure | None:
    """Midsagittal outlines: an overlay of many runs, and some individual runs that differ as much as possible."""
    if not sweep.drawn:
        return None
    some = sweep.drawn[:: -(-len(sweep.drawn) // MOST_MULTIPLES)]
    rows = -(-len(some) // MULTIPLES_IN_A_ROW)
    figure = new_figure(WIDTH_IN, 4.5 + PANEL_HEIGHT_IN * rows)
    whole, multiples = figure.subfigures(2, 1, squeeze=False, height_ratios=[4.5, PANEL_HEIGHT_IN * rows]).ravel()
    axes = whole.subplots()
    for line in sweep.outlines:
        axes.plot(*_closed(line).T, color=COLOURS[0], lw=0.7, alpha=max(CLOUD_OPACITY, 1.0 / len(sweep.outlines)))
    _surroundings(axes, sweep.drawn[0].at_rest, sweep.drawn[0].palate)
    axes.set_title(f"{len(sweep.outlines)} of {sweep.outlines_of} midsagittal outlines; dashed: at rest; front is at left")
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("z (mm)")
    box = _box([line for line in sweep.outlines] + [member.outline for member in some])
    panels = multiples.subplots(rows, MULTIPLES_IN_A_ROW, squeeze=False).ravel()
    for panel, member in zip(panels, some, strict=False):
        panel.plot(*_closed(member.outline).T, color=COLOURS[0], lw=1.2)
        _surroundings(panel, member.at_rest, member.palate)
        said = [f"{name} {value}" for name, value in member.settings[:MOST_SETTINGS_WRITTEN]]
        left_out = len(member.settings) - len(said)
        panel.set_title(
            "\n".join([f"run {member.number}", *said, *([f"and {left_out} more"] if left_out else [])]), fontsize=6, loc="left"
        )
        panel.set_xticks([])
        panel.set_yticks([])
    for panel in panels[len(some) :]:
        panel.set_axis_off()
    for panel in [axes, *panels[: len(some)]]:
        panel.set_xlim(box[0], box[1])
        panel.set_ylim(box[2], box[3])
        panel.set_aspect("equal")
        panel.spines[["top", "right"]].set_visible(False)
    return figure


def effects(sweep: SweepToDraw) -> Figure | None:
    """The main measures against each factor: means and a band of one standard deviation."""
    rows = [effects_on(measure, sweep.factors, with_shares=sweep.is_balanced) for measure in sweep.shown_measures]
    charts = [row[:MOST_FACTORS_DRAWN] for row in rows if row][:MOST_MEASURES_DRAWN]
    if not charts:
        return None
    across = max(map(len, charts))
    figure = new_figure(max(WIDTH_IN, 2.4 * across), PANEL_HEIGHT_IN * len(charts) + 0.4)
    draw_charts(figure, [one for row in charts for one in (*row, *[None] * (across - len(row)))], across)
    figure.suptitle("Mean per value or bin, with one standard deviation", fontsize=9)
    return figure


def indices(sweep: SweepToDraw) -> Figure | None:
    """Bars of the indices of a sensitivity analysis, with their 95 % intervals."""
    if not sweep.indices:
        return None
    rows = -(-len(sweep.indices) // PANELS_IN_A_ROW)
    factors = max(len(of_measure.factors) for of_measure in sweep.indices)
    figure = new_figure(WIDTH_IN, rows * (0.9 + 0.28 * factors))
    panels = figure.subplots(rows, PANELS_IN_A_ROW, squeeze=False).ravel()
    for panel, of_measure in zip(panels, sweep.indices, strict=False):
        _bars(panel, of_measure)
    for panel in panels[len(sweep.indices) :]:
        panel.set_axis_off()
    return figure


def against(sweep: SweepToDraw, across: str, up: str) -> Figure | None:
    """Scatter plot of two columns, one point per run, coloured by status; None where no run has both.

    Raises
    ------
    InputError : a column does not exist.
    """
    columns = {column.name: column for column in [*sweep.factors, *sweep.measures, *sweep.checks]}
    for name in (across, up):
        if name not in columns:
            raise InputError(f'this sweep has no column "{shortened(name)}"; {nearest(name, columns)}')
    shown = scatter_chart(sweep, columns[across], columns[up])
    if shown is None:
        return None
    figure = new_figure(6.0, 4.5)
    draw_charts(figure, [shown])
    return figure


def maps(sweep: SweepToDraw) -> Figure | None:
    """Heat maps of the main measures over two factors."""
    drawn = list(heat_maps(sweep))[:MOST_MAPS_DRAWN]
    if not drawn:
        return None
    rows = -(-len(drawn) // PANELS_IN_A_ROW)
    figure = new_figure(WIDTH_IN, MAP_HEIGHT_IN * rows)
    panels = figure.subplots(rows, min(PANELS_IN_A_ROW, len(drawn)), squeeze=False).ravel()
    for panel, one in zip(panels, drawn, strict=False):
        image = panel.imshow(one.mean, origin="lower", aspect="auto", cmap="viridis")
        figure.colorbar(image, ax=panel).ax.tick_params(labelsize=6)
        for axis, factor, words in (
            (panel.xaxis, one.across, one.column_words),
            (panel.yaxis, one.up, [words for words, _ in one.table][::-1]),
        ):
            every = -(-len(words) // MOST_TICKS_OF_A_MAP)
            axis.set_ticks(range(0, len(words), every), words[::every], fontsize=6)
            axis.set_label_text(factor.title, fontsize=7)
        panel.set_title(one.measure.title, fontsize=7)
    for panel in panels[len(drawn) :]:
        panel.set_axis_off()
    return figure


PICTURES: Mapping[str, Callable[[SweepToDraw], Figure | None]] = {
    "outlines": outlines, "effects": effects, "maps": maps, "indices": indices
}  # fmt: skip


def _bars(panel: Axes, of_measure: MeasureIndices) -> None:
    plain(panel)
    kinds = list(dict.fromkeys(kind for factor in of_measure.factors for kind in factor.values))
    at = np.arange(len(of_measure.factors))
    height = 0.8 / max(len(kinds), 1)
    for number, kind in enumerate(kinds):
        values = np.array([factor.values.get(kind, (np.nan, np.nan)) for factor in of_measure.factors])
        place = at + (number - 0.5 * (len(kinds) - 1)) * height
        panel.barh(place, values[:, 0], 0.9 * height, color=COLOURS[number], label=kind)
        panel.errorbar(values[:, 0], place, xerr=values[:, 1], fmt="none", ecolor="black", lw=0.8, capsize=1.5)
    panel.set_yticks(at, [factor.factor for factor in of_measure.factors], fontsize=7)
    panel.invert_yaxis()
    panel.set_title(of_measure.measure, fontsize=8)
    panel.set_xlabel(f"elementary effect ({of_measure.unit})" if of_measure.unit else "share of the variance", fontsize=7)
    panel.tick_params(axis="x", labelsize=7)
    if not of_measure.unit:  # intervals are wide if there are few runs
        panel.set_xlim(*SHARES_SHOWN)
    if len(kinds) > 1:
        panel.legend(frameon=False, fontsize=6)


def _surroundings(panel: Axes, at_rest: np.ndarray, palate: np.ndarray) -> None:
    if len(at_rest):
        panel.plot(*_closed(at_rest).T, "--", color=GREY, lw=0.8)
    if len(palate):
        panel.plot(*palate.T, color=BONE_EDGE, lw=2.0)


def _closed(line: np.ndarray) -> np.ndarray:
    return np.concatenate([line, line[:1]])


def _box(lines: Sequence[np.ndarray]) -> tuple[float, float, float, float]:
    """Limits of x and z, mm, of all lines, with space for the palate."""
    points = np.concatenate([line for line in lines if len(line)])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.04 * (high - low)
    return float(low[0] - room[0]), float(high[0] + room[0]), float(low[1] - room[1]), float(high[1] + 8.0)
