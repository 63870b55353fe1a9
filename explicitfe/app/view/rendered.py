"""Figures with views in three dimensions, drawn in a separate process, see ``rendering.py``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.app.view.files import writing
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.hourglass_figure import hourglass_figure
from explicitfe.app.view.palette import FIBRE_AT_REST, FIBRE_PULLING, WIDTH_IN, save
from explicitfe.app.view.scene.scene import Look, Scene, mixed
from explicitfe.app.view.scene.viewpoint import VIEWPOINTS
from explicitfe.app.view.times import milliseconds
from explicitfe.results.files import Result, open_result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_VIEWS = ("oblique", "midsagittal")
VIEW_SIZE_PX = (800, 680)
FREE_SHARE = 0.02  # of a view on every side
COLOUR_STEPS = 64


def draw_figures(result: str, step: int, files: Mapping[str, str], progress: Callable[[float], None]) -> None:
    """Draw figures of a result at a step; ``files`` is name of a figure, "3d" or "hourglass" -> where it goes."""
    with open_result(result) as opened:
        for number, (name, path) in enumerate(files.items()):
            figure = shape_figure(opened, step) if name == "3d" else hourglass_figure(opened, step)
            assert figure is not None
            with writing(Path(path)):
                save(figure, Path(path))
            progress((number + 1) / len(files))


def shape_figure(result: Result, step: int) -> Figure:
    """The deformed body from the front and, cut in the middle, from the side, coloured by displacement; with bones and fibres."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    scenes = [_scene(result, step, view) for view in SHOWN_VIEWS]
    scale = max(scene.plotter.camera.parallel_scale for scene in scenes)
    images = []
    for scene in scenes:
        scene.plotter.camera.parallel_scale = scale  # the same for both
        scene.show(step)
        images.append(scene.plotter.screenshot(return_img=True))
        scene.plotter.close()
    drawn = np.any([np.any(image < 255, axis=2) for image in images], axis=0)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    height, width = (part.stop - part.start for part in window)
    time = milliseconds(result.times[[step]], result.times[step])[0]
    figure = result_figure(result, 1.9 + 0.47 * WIDTH_IN * height / width, f"Shape at {time}; thin line, dashes: at rest")
    for axes, image, view in zip(figure.subplots(1, 2), images, SHOWN_VIEWS, strict=True):
        axes.imshow(image[window])
        axes.set_title(VIEWPOINTS[view].words, fontsize=10)
        axes.set_axis_off()
    field = scenes[0].field
    assert field is not None
    _add_scale(figure, ScalarMappable(Normalize(*field.limits), field.colours), field.label)
    if any(scene.has_fibres for scene in scenes):
        colours = [mixed(FIBRE_AT_REST, FIBRE_PULLING, share) for share in np.linspace(0.0, 1.0, COLOUR_STEPS)]
        pull = ScalarMappable(Normalize(0.0, 100.0), LinearSegmentedColormap.from_list("pull", colours))
        _add_scale(figure, pull, "fibres: pull of their muscle (% of its force)")
    return figure


def _scene(result: Result, step: int, view: str) -> Scene:
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(VIEW_SIZE_PX), lighting="light kit")
    plotter.background_color = "white"
    scene = Scene(result, [step], Look(view), plotter)
    scene.aim((FREE_SHARE, FREE_SHARE, FREE_SHARE))
    return scene


def _add_scale(figure: Figure, scale: Any, label: str) -> None:
    bar = figure.colorbar(scale, ax=figure.axes[:2], location="bottom", shrink=0.5, aspect=40, pad=0.02)
    bar.set_label(label)
