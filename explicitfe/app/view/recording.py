"""Picture of a result and recorded sensors: paths in the midsagittal plane, and coordinates over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.files import new_files
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.palette import COLOURS, FORMATS, GREY, plain, save
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.extras import require
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.sections import X, Z, midsagittal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM_PER_M, MS_PER_S = 1e3, 1e3
MARGIN_MM = 6.0  # around the paths


def draw_recording(
    result_path: Path,
    file: Path,
    time_s: np.ndarray,
    model: Mapping[str, np.ndarray],
    recorded: Mapping[str, np.ndarray],
    labels: Sequence[str],
    overwrite: bool = False,
) -> None:
    """Write :func:`recording_figure` as a file.

    Raises
    ------
    InputError : the suffix is no picture format, or the file exists and must not be replaced.
    """
    require("plots", "drawing pictures")
    file_format = file.suffix.removeprefix(".").lower()
    if file_format not in FORMATS:
        raise InputError(f'--picture {file}: pictures cannot be drawn as "{file_format}"; {nearest(file_format, FORMATS)}')
    new_files([file], overwrite)
    with open_result(result_path) as result:
        save(recording_figure(result, time_s, model, recorded, labels), file)


def recording_figure(
    result: Result,
    time_s: np.ndarray,
    model: Mapping[str, np.ndarray],
    recorded: Mapping[str, np.ndarray],
    labels: Sequence[str],
) -> Figure:
    """Draw points of a result (solid) and the sensors mapped to them (dashed).

    Parameters
    ----------
    time_s : (k,) times in the simulation.
    model, recorded : point -> (k, 3) m, in the frame of the model.
    labels : names of the points in the legend.
    """
    figure = result_figure(result, 8.6, "Model (solid) and recording (dashed)")
    panels: dict[str, Axes] = figure.subplot_mosaic([["plane", "plane"], ["forward", "up"]], height_ratios=[1.2, 1.0])
    plane = panels["plane"]
    cut = midsagittal(result.mesh)
    if cut.loops:
        outline = MM_PER_M * cut.outline(result.mesh.points)
        plane.plot(outline[:, X], outline[:, Z], color=GREY, lw=1.2, label="tongue at rest")
    for k, (name, label) in enumerate(zip(model, labels, strict=True)):
        colour, start = COLOURS[k % len(COLOURS)], MM_PER_M * model[name][0]
        for paths, style, shown in ((model, "-", label), (recorded, "--", None)):
            path = MM_PER_M * paths[name]
            plane.plot(path[:, X], path[:, Z], style, color=colour, lw=1.6, label=shown)
            plane.plot(*path[0, [X, Z]], "o", mfc="white", mec=colour, ms=5)
            plane.plot(*path[-1, [X, Z]], "o", mfc=colour, mec=colour, ms=5)
            panels["forward"].plot(MS_PER_S * time_s, start[X] - path[:, X], style, color=colour, lw=1.5)
            panels["up"].plot(MS_PER_S * time_s, path[:, Z] - start[Z], style, color=colour, lw=1.5)
    everywhere = MM_PER_M * np.concatenate([*model.values(), *recorded.values()])
    (x_low, z_low), (x_high, z_high) = (end(everywhere[:, [X, Z]], axis=0) for end in (np.min, np.max))
    plane.set_xlim(x_low - MARGIN_MM, x_high + MARGIN_MM)
    plane.set_ylim(z_low - MARGIN_MM, z_high + MARGIN_MM)
    plane.set_aspect("equal", adjustable="box")
    plane.set_title("paths in the midsagittal plane, from ○ to ●", fontsize=10)
    plane.set_xlabel("front  ←   x (mm)   →  back")
    plane.set_ylabel("z, up (mm)")
    plane.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=9)
    for name in ("forward", "up"):
        panels[name].set_title("displacement from the first position of the model", fontsize=10)
    panels["forward"].set_ylabel("forward (mm)")
    panels["forward"].set_xlabel("time in the simulation (ms)")
    panels["up"].set_ylabel("up (mm)")
    panels["up"].set_xlabel("time in the simulation (ms)")
    for axes in panels.values():
        plain(axes)
    return figure
