"""Pictures of a sweep: outlines, effects of factors, heat maps of two, sensitivity indices with intervals, any two columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.files import new_files, writing
from explicitfe.app.view.page.sweep.effects import MainEffect, main_effect, share_in_words
from explicitfe.app.view.page.sweep.heat_map import heat_maps
from explicitfe.app.view.palette import BONE_EDGE, COLOURS, FORMATS, GREY, WIDTH_IN, new_figure, plain, save
from explicitfe.platform.errors import InputError, Progress, nearest, shortened, silent
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.drawn import DrawnPictures
from explicitfe.results.documents.sweep_to_draw import MeasureIndices, SweepColumn, SweepToDraw

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
    by_name = {column.name: column for column in sweep.measures}
    rows: list[tuple[SweepColumn, list[MainEffect]]] = []
    for name in sweep.main_measures:
        strongest = [effect for factor in sweep.factors if (effect := main_effect(factor, by_name[name])) is not None]
        strongest = sorted(strongest, key=lambda effect: -np.nan_to_num(effect.share))[:MOST_FACTORS_DRAWN]
        if strongest and len(rows) < MOST_MEASURES_DRAWN:
            rows.append((by_name[name], strongest))
    if not rows:
        return None
    across = max(len(strongest) for _, strongest in rows)
    figure = new_figure(max(WIDTH_IN, 2.4 * across), PANEL_HEIGHT_IN * len(rows) + 0.4)
    grid = figure.subplots(len(rows), across, squeeze=False, sharey="row")
    for panels, (measure, strongest) in zip(grid, rows, strict=True):
        for panel, effect in zip(panels, strongest, strict=False):
            _effect(panel, effect, sweep.is_balanced)
        for panel in panels[len(strongest) :]:
            panel.set_axis_off()
        panels[0].set_ylabel(measure.title.replace(": ", ":\n"), fontsize=8)
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


def against(sweep: SweepToDraw, across: str, up: str) -> Figure:
    """Scatter plot of two columns, one point per run, coloured by status.

    Raises
    ------
    InputError : a column does not exist.
    """
    columns = {column.name: column for column in [*sweep.factors, *sweep.measures, *sweep.checks]}
    for name in (across, up):
        if name not in columns:
            raise InputError(f'this sweep has no column "{shortened(name)}"; {nearest(name, columns)}')
    x, y = columns[across], columns[up]
    figure = new_figure(6.0, 4.5)
    axes = figure.subplots()
    plain(axes)
    statuses = np.array(sweep.statuses)
    for number, status in enumerate(dict.fromkeys(sweep.statuses)):
        chosen = (statuses == status) & np.isfinite(x.values) & np.isfinite(y.values)
        if chosen.any():
            axes.plot(x.values[chosen], y.values[chosen], ".", ms=4, color=COLOURS[number % len(COLOURS)], label=status)
    for column, axis in ((x, axes.xaxis), (y, axes.yaxis)):
        axis.set_label_text(column.title)
        if column.levels:
            axis.set_ticks(range(len(column.levels)), column.levels)
    if len(axes.lines) > 1:
        axes.legend(frameon=False, fontsize=8)
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


def _effect(panel: Axes, effect: MainEffect, with_share: bool) -> None:
    plain(panel)
    sd = np.nan_to_num(effect.sd)
    if effect.factor.levels:
        panel.errorbar(effect.x, effect.mean, sd, fmt="o", ms=3, lw=0.8, color=COLOURS[0])
        panel.set_xticks(range(len(effect.factor.levels)), effect.factor.levels, fontsize=6)
        panel.set_xlim(-0.5, len(effect.factor.levels) - 0.5)
    else:
        panel.fill_between(effect.x, effect.mean - sd, effect.mean + sd, color=COLOURS[0], alpha=0.15, lw=0)
        panel.plot(effect.x, effect.mean, "o-", ms=3, lw=1.0, color=COLOURS[0])
    share = share_in_words(effect.share) if with_share else ""
    panel.set_title(f"{share} of the variance" if share else "", fontsize=7)
    panel.set_xlabel(effect.factor.title, fontsize=7)
    panel.tick_params(labelsize=7)


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
