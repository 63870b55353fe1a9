"""Outlines of several results in one picture: midsagittal contours at the same times, or force curves of indentations."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.bones import SMALLEST_BONE_MOTION_M, bone_loops, fill_bones, keep_to_tongue
from explicitfe.app.view.chart_figure import draw_charts
from explicitfe.app.view.files import new_files, writing
from explicitfe.app.view.heading import common_stem, heading_of_several, labels_of
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.page.chart import chart
from explicitfe.app.view.page.run.charts import TOOL_LABEL, tool_lines
from explicitfe.app.view.palette import COLOURS, FORMATS, GREY, LINE_STYLES, plain, save
from explicitfe.app.view.several import check_count, same_kind
from explicitfe.app.view.times import milliseconds
from explicitfe.platform.errors import InputError, Progress, nearest, silent
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.drawn import DrawnPictures
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.sections import X, Z, middle, midsagittal
from explicitfe.results.measure.steps import common_steps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Kind of analysis -> name of the picture that is overlaid.
OVERLAYS = {"transient": "contour", "relaxation": "curve"}
OVERLAYS_IN_A_ROW = 2
ROW_HEIGHT_IN = 4.6


def draw_overlay(
    paths: Sequence[Path],
    folder: Path | None = None,
    *,
    only: Sequence[str] | None = None,
    file_format: str = "png",
    times_s: Sequence[float] | None = None,
    overwrite: bool = True,
    progress: Progress = silent,
) -> DrawnPictures:
    """Draw the outlines of several results into one picture, ``<stem>-<stem>-<picture>.<format>``.

    Parameters
    ----------
    paths : the results, all of runs in time or all of indentations.
    folder : output folder; that of the first result by default.
    only : the only valid name is "contour" for runs in time, "curve" for indentations.
    file_format : "png", "pdf" or "svg".
    times_s : times of the contours, one panel each; by default the last time that all results have.
    overwrite : replace an existing file.

    Raises
    ------
    InputError : a result, a name or a time cannot be used, the results are of different kinds, or the file exists.
    MachineError : the disk is full.
    """
    require("plots", "drawing pictures")
    paths = [Path(path) for path in paths]
    if file_format not in FORMATS:
        raise InputError(f'--format "{file_format}" is not a file format of pictures; {nearest(file_format, FORMATS)}')
    check_count(paths)
    with ExitStack() as opened:
        results = [opened.enter_context(open_result(path)) for path in paths]
        kind = same_kind(results)
        for name in only or ():
            if name != OVERLAYS[kind]:
                raise InputError(f'the picture "{name}" shows one result; of several results only "{OVERLAYS[kind]}" is drawn.')
        target = (folder or paths[0].parent) / f"{common_stem(paths)}-{OVERLAYS[kind]}.{file_format}"
        progress("draw", 0.0)
        if kind == "transient":
            figure = contours_figure(results, times_s)
        elif times_s:
            raise InputError("indentations have load steps and no times; leave out --times.")
        else:
            figure = curves_figure(results)
        new_files([target], overwrite)
        with writing(target):
            save(figure, target)
    progress("draw", 1.0)
    return {"result": str(paths[0]), "results": [str(path) for path in paths], "files": [str(target)], "warnings": []}


def contours_figure(results: Sequence[Result], times_s: Sequence[float] | None = None) -> Figure:
    """The midsagittal contours of results of runs in time; one panel per time, see :func:`draw_overlay`."""
    moments = [common_steps(results, time_s) for time_s in (sorted(set(times_s)) if times_s else [None])]
    columns = min(OVERLAYS_IN_A_ROW, len(moments))
    rows = -(-len(moments) // columns)
    # A single panel is as high as that of one result.
    height_in = (7.0 if len(moments) == 1 else ROW_HEIGHT_IN * rows) + 0.6
    figure = heading_of_several(results, height_in, "Midsagittal contours at the same time")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (time_s, steps) in zip(panels, moments, strict=False):
        _draw_contours(axes, results, time_s, steps)
    for axes in panels[len(moments) :]:
        axes.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False)
    return figure


def curves_figure(results: Sequence[Result]) -> Figure:
    """Force against displacement of results of indentations."""
    figure = heading_of_several(results, 5.4, "Force of the whole tool")
    labels = labels_of([result.path for result in results])
    lines = [
        replace(line, name="" if part else label, colour=number)
        for number, (result, label) in enumerate(zip(results, labels, strict=True))
        for part, line in enumerate(tool_lines(result))
    ]
    draw_charts(figure, [chart("", lines, x_label=TOOL_LABEL, y_label="force of the whole tool (N)")])
    return figure


def _draw_contours(axes: Axes, results: Sequence[Result], time_s: float, steps: Sequence[int]) -> None:
    """Draw the contours of all results in one panel, over the bones of the first result."""
    first, labels = results[0], labels_of([result.path for result in results])
    plane = np.array([0.0, middle(first.mesh), 0.0]), np.array([0.0, 1.0, 0.0])
    plain(axes)
    axes.set_aspect("equal")
    fill_bones(axes, first, steps[0], *plane, X, label="bone" if len(results) == 1 else f"bone ({labels[0]})")
    drawn_at_rest: list[np.ndarray] = []
    shown = []
    for number, (result, step, label) in enumerate(zip(results, steps, labels, strict=True)):
        colour, style = _line(number)
        cut = midsagittal(result.mesh)
        at_rest = outline_mm(result, cut, result.mesh.points)
        if not any(np.array_equal(at_rest, other, equal_nan=True) for other in drawn_at_rest):
            axes.plot(at_rest[:, X], at_rest[:, Z], color=GREY, lw=1.2, label=None if drawn_at_rest else "at rest", zorder=1.5)
            drawn_at_rest.append(at_rest)
        line = outline_mm(result, cut, result.mesh.points + result.displacement(step))
        axes.plot(line[:, X], line[:, Z], style, color=colour, lw=2.2, label=label, zorder=3 + number)
        shown += [at_rest[:, [X, Z]], line[:, [X, Z]]]
        if number:
            _draw_other_bones(axes, first, steps[0], result, step, colour)
    keep_to_tongue(axes, np.concatenate(shown))
    # The samples of a result may be so far apart that the nearest one is at another time.
    time, *sampled = milliseconds(
        np.array([time_s, *(result.times[step] for result, step in zip(results, steps, strict=True))]), time_s
    )
    others = [f"{label} at {words}" for label, words in zip(labels, sampled, strict=True) if words != time]
    axes.set_title(f"{time} ({', '.join(others)})" if others else time, fontsize=11)
    axes.set_xlabel("front  ←   x (mm)   →  back")
    axes.set_ylabel("z, up (mm)")


def _draw_other_bones(axes: Axes, first: Result, first_step: int, result: Result, step: int, colour: str) -> None:
    """Draw the outlines of bones of a result that are elsewhere than those of the first result, in the colour of the result."""
    before = first.placed_bones(first_step)
    plane = np.array([0.0, middle(result.mesh), 0.0]), np.array([0.0, 1.0, 0.0])
    for name, bone in result.placed_bones(step).items():
        other = before.get(name)
        same = other is not None and other.points.shape == bone.points.shape
        if other is not None and same and np.abs(other.points - bone.points).max(initial=0.0) <= SMALLEST_BONE_MOTION_M:
            continue
        for loop in bone_loops(bone, *plane):
            closed = np.concatenate([loop, loop[:1]])
            axes.plot(closed[:, X], closed[:, Z], ":", color=colour, lw=1.2, zorder=2)


def _line(number: int) -> tuple[str, str]:
    """Colour and style of the line of a result."""
    return COLOURS[number % len(COLOURS)], LINE_STYLES[number // len(COLOURS) % len(LINE_STYLES)]
