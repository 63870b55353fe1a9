"""Picture of a result and recorded sensors: paths in the midsagittal plane, and displacements over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.bones import fill_bones
from explicitfe.app.view.files import new_files
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.palette import COLOURS, FORMATS, GREY, plain, save
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.extras import require
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.sections import X, Y, Z, middle, midsagittal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM_PER_M, MS_PER_S = 1e3, 1e3
MARGIN_MM = 6.0  # around the paths
LEAST_HEIGHT_MM = 24.0  # of the panel of the paths
# Line and marker of the model and of the recording.
MODEL_STYLE, RECORDED_STYLE = ("-", "o"), ("--", "s")


@dataclass(frozen=True, eq=False)
class RecordingPicture:
    """Paths of points of a result and of the sensors mapped to them.

    Attributes
    ----------
    time_s : (k,) times in the simulation.
    model, recorded : point -> (k, 3) m, in the frame of the model.
    labels : names of the points in the legend.
    what : the recording and its distance from the model, in words.
    palate : (p, 3) m, a trace of the speaker's palate in the frame of the model; None if there is none.
    """

    time_s: np.ndarray
    model: Mapping[str, np.ndarray]
    recorded: Mapping[str, np.ndarray]
    labels: Sequence[str]
    what: str
    palate: np.ndarray | None = None


def draw_recording(result_path: Path, file: Path, shown: RecordingPicture, overwrite: bool = False) -> None:
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
        save(recording_figure(result, shown), file)


def recording_figure(result: Result, shown: RecordingPicture) -> Figure:
    """Draw points of a result (solid) and the sensors mapped to them (dashed)."""
    figure = result_figure(result, 8.6, shown.what)
    panels: dict[str, Axes] = figure.subplot_mosaic([["plane", "plane"], ["forward", "up"]], height_ratios=[1.2, 1.0])
    plane = panels["plane"]
    _draw_surroundings(plane, result, shown.palate)
    for k, (name, label) in enumerate(zip(shown.model, shown.labels, strict=True)):
        colour = COLOURS[k % len(COLOURS)]
        for paths, (line, marker), text in ((shown.model, MODEL_STYLE, label), (shown.recorded, RECORDED_STYLE, None)):
            path = MM_PER_M * paths[name]
            plane.plot(path[:, X], path[:, Z], line, color=colour, lw=1.6, label=text)
            for row, fill in ((0, "white"), (-1, colour)):
                plane.plot(*path[row, [X, Z]], marker, mfc=fill, mec=colour, ms=5)
            moved = path - path[0]
            panels["forward"].plot(MS_PER_S * shown.time_s, -moved[:, X], line, color=colour, lw=1.5)
            panels["up"].plot(MS_PER_S * shown.time_s, moved[:, Z], line, color=colour, lw=1.5)
    for (line, marker), text in ((MODEL_STYLE, "model"), (RECORDED_STYLE, "recording")):
        plane.plot([], [], line, marker=marker, color="black", lw=1.6, ms=5, label=text)
    _limit(plane, np.concatenate([*shown.model.values(), *shown.recorded.values()]))
    plane.set_aspect("equal", adjustable="box")
    plane.set_title("paths in the midsagittal plane, from open to filled markers", fontsize=10)
    plane.set_xlabel("front  ←   x (mm)   →  back")
    plane.set_ylabel("z, up (mm)")
    plane.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=9, handlelength=3.2)
    for name in ("forward", "up"):
        panels[name].set_title("displacement of each path from its first position", fontsize=10)
        panels[name].set_ylabel(f"{name} (mm)")
        panels[name].set_xlabel("time in the simulation (ms)")
    for axes in panels.values():
        plain(axes)
    return figure


def _draw_surroundings(plane: Axes, result: Result, palate: np.ndarray | None) -> None:
    """Draw the tongue at rest, the bones of the model, and the trace of the speaker's palate."""
    normal = np.eye(3)[Y]
    fill_bones(plane, result, 0, middle(result.mesh) * normal, normal, X, "bone of the model")
    cut = midsagittal(result.mesh)
    if cut.loops:
        outline = outline_mm(result, cut, result.mesh.points)
        plane.plot(outline[:, X], outline[:, Z], color=GREY, lw=1.2, label="tongue at rest")
    if palate is not None:
        plane.plot(*(MM_PER_M * palate[:, [X, Z]].T), ".", color="black", ms=2, label="recorded palate")


def _limit(plane: Axes, everywhere_m: np.ndarray) -> None:
    """Limit the panel to the paths (k, 3) m, with a margin and a least height."""
    (x_low, z_low), (x_high, z_high) = (MM_PER_M * end(everywhere_m[:, [X, Z]], axis=0) for end in (np.min, np.max))
    lower = max(0.0, LEAST_HEIGHT_MM - (z_high - z_low)) / 2.0
    plane.set_xlim(x_low - MARGIN_MM, x_high + MARGIN_MM)
    plane.set_ylim(z_low - MARGIN_MM - lower, z_high + MARGIN_MM + lower)
