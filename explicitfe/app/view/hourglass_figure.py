"""The map of the hourglass energy in three dimensions; drawn in a separate process, see ``rendering.py``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.heading import result_figure, rounded
from explicitfe.app.view.hourglass import OUTSIDE_VIEWS, HourglassMap, hourglass_map, outside_view
from explicitfe.app.view.palette import ENERGY_MAP, WIDTH_IN
from explicitfe.app.view.scene.body import hex_grid
from explicitfe.app.view.times import milliseconds
from explicitfe.results.files import Result
from explicitfe.results.measure.sections import Y, middle

if TYPE_CHECKING:
    import pyvista
    from matplotlib.figure import Figure

# The colour scale of the hourglass map ends here at most, and spans so many powers of ten: more would show no difference.
MAP_TOP_PERCENT = 1000.0
MAP_DECADES = 3
# An element is found in the picture where it covers more dots than this; fewer cannot be pointed at.
SEEN_DOTS = 20
# A view is drawn a little larger than it stands in the picture, and cut to what it shows with a margin around it.
VIEW_DOTS = 900
MARGIN_DOTS = 20
FOLDED_COLOUR = "#E00000"


def hourglass_figure(result: Result, step: int) -> Figure | None:
    """The deformed elements, cut in the middle and from outside, coloured by their hourglass energy; None where there is none."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    energy = hourglass_map(result, step)
    if energy is None:
        return None
    mesh = result.mesh
    points = 1e3 * (mesh.points + result.displacement(step))
    top = min(MAP_TOP_PERCENT, 10.0 ** math.ceil(math.log10(energy.percent.max())))
    limits = (top / 10.0**MAP_DECADES, top)
    # Elements stay whole, as each has one value: shown are those whose middle is right of the plane or in it.
    y = mesh.points[mesh.hexes, Y].mean(axis=1)
    half = y > middle(mesh) - 1e-9 * np.ptp(mesh.points[:, Y])
    name = outside_view(points, mesh.hexes, energy.percent)
    views = {
        "cut at the midsagittal plane, front at the left": _map_view(points, mesh.hexes, half, energy, (0.0, -1.0, 0.0), limits),
        name: _map_view(points, mesh.hexes, np.ones_like(half), energy, OUTSIDE_VIEWS[name], limits),
    }
    left, right, bottom, above = _window([np.any(image < 255, axis=2) for image, _ in views.values()])
    time = milliseconds(result.times[[step]], result.times[step])[0]
    what = f"Hourglass energy at {time}, {rounded(energy.share, 2)} % of the elastic energy"
    folded = int(energy.folded.sum())
    if folded:
        what += f"; {folded} of {mesh.element_count} elements inverted (red edges)"
    height, foot = 0.47 * WIDTH_IN * (bottom - above) / (right - left), 1.2
    figure = result_figure(result, 1.15 + height + foot, what)
    panels = figure.subplot_mosaic([["cut", "outside"], ["scale", "list"]], height_ratios=[height, foot])
    for axes in panels.values():
        axes.set_axis_off()
    for axes, (title, (image, places)) in zip((panels["cut"], panels["outside"]), views.items(), strict=True):
        axes.imshow(image)
        # The numbers stand above the elements like a fan, so that their arrows do not cross.
        order = sorted(places, key=lambda number: places[number])
        for number, angle in zip(order, np.radians(np.linspace(150.0, 30.0, 2 * len(order) + 1)[1::2]), strict=True):
            axes.annotate(
                str(number),
                places[number],
                (40.0 * np.cos(angle), 40.0 * np.sin(angle)),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=9,
                fontweight="bold",
                bbox={"boxstyle": "circle,pad=0.25", "fc": "white", "ec": "black", "lw": 1.0},
                arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 1.0, "shrinkA": 0, "shrinkB": 0},
            )
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, above)
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    ends = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
    bar = figure.colorbar(
        ScalarMappable(LogNorm(*limits), ENERGY_MAP),
        cax=panels["scale"].inset_axes((0.1, 0.74, 0.8, 0.16)),
        orientation="horizontal",
        extend=ends[bool(energy.percent.min() < limits[0]), bool(energy.percent.max() > limits[1])],
    )
    bar.ax.xaxis.set_major_formatter("{x:g}")
    bar.set_label("hourglass energy per volume\n(% of the body's mean elastic energy per volume)")
    lines = [f"The {len(energy.worst)} largest, with their places at rest:"]
    for number, element in enumerate(energy.worst, start=1):
        place = ", ".join(f"{1e3 * value:.0f}" for value in mesh.points[mesh.hexes[element]].mean(axis=0))
        note = ", inverted" if energy.folded[element] else ""
        note += "" if any(number in places for _, places in views.values()) else ", hidden"
        lines.append(f"{number}  element {element}: {rounded(energy.percent[element])} % at ({place}) mm{note}")
    listing = panels["list"].text(0.12, 0.98, "\n".join(lines), va="top", fontsize=9.5, linespacing=1.4)
    listing.set_in_layout(False)
    return figure


def _map_view(
    points: np.ndarray,
    hexes: np.ndarray,
    shown: np.ndarray,
    energy: HourglassMap,
    direction: tuple[float, float, float],
    limits: tuple[float, float],
) -> tuple[np.ndarray, dict[int, tuple[float, float]]]:
    """The elements ``shown`` from ``direction`` as pixels, and the places (column, row) of those of the worst that are seen.

    The worst are numbered from 1.
    """
    from matplotlib import colormaps

    elements = np.flatnonzero(shown)
    surface = hex_grid(points, hexes[elements]).extract_surface(algorithm="dataset_surface", pass_pointid=False)
    element = elements[surface.cell_data["vtkOriginalCellIds"]]
    plotter = _plotter(points, direction)

    # In a first picture the worst elements have grey levels that nothing else has, which tell where they are seen.
    levels = np.zeros((surface.n_cells, 3), dtype=np.uint8)
    for number, worst in enumerate(energy.worst, start=1):
        levels[element == worst] = 40 * number
    surface.cell_data["level"] = levels
    actor = plotter.add_mesh(surface, scalars="level", rgb=True, lighting=False, reset_camera=False, render=False)
    seen = _pixels(plotter)[:, :, 0]
    plotter.remove_actor(actor, reset_camera=False, render=False)
    places = {}
    for number in range(1, len(energy.worst) + 1):
        rows, columns = np.nonzero(seen == 40 * number)
        if len(rows) > SEEN_DOTS:
            nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
            places[number] = float(columns[nearest]), float(rows[nearest])

    clipped = np.log(np.clip(energy.percent[element], *limits) / limits[0]) / np.log(limits[1] / limits[0])
    surface.cell_data["colour"] = (255.0 * colormaps[ENERGY_MAP](clipped)[:, :3]).astype(np.uint8)
    plotter.add_mesh(
        surface,
        scalars="colour",
        rgb=True,
        show_edges=True,
        edge_color="#202020",
        edge_opacity=0.3,
        ambient=0.6,
        diffuse=0.5,
        reset_camera=False,
        render=False,
    )
    if energy.folded[element].any():
        edges = surface.extract_cells(energy.folded[element]).extract_all_edges()
        edges.points += 0.003 * np.ptp(points, axis=0).max() * np.array(direction)  # before the faces that they bound
        plotter.add_mesh(edges, color=FOLDED_COLOUR, line_width=3, lighting=False, reset_camera=False, render=False)
    plotter.render()  # without it a second screenshot would be the first one again
    image = _pixels(plotter)
    plotter.close()
    return image, places


def _plotter(points: np.ndarray, direction: tuple[float, float, float]) -> pyvista.Plotter:
    """An empty view along ``direction``; all ``points`` have room in it for any direction."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=[VIEW_DOTS, VIEW_DOTS], lighting="light kit")
    plotter.set_background("white")  # type: ignore[arg-type]  # pyvista's decorator hides that this is a method
    plotter.enable_parallel_projection()  # type: ignore[call-arg]  # here too
    centre = points.mean(axis=0)
    radius = np.linalg.norm(points - centre, axis=1).max()
    plotter.camera_position = [centre + 5.0 * radius * np.array(direction), centre, (0.0, 0.0, 1.0)]
    plotter.camera.parallel_scale = radius
    plotter.camera.clipping_range = (radius, 10.0 * radius)
    return plotter


def _pixels(plotter: pyvista.Plotter) -> np.ndarray:
    """What a plotter shows, (h, w, 3) uint8."""
    image = plotter.screenshot(return_img=True)
    assert image is not None
    return image


def _window(drawn: Sequence[np.ndarray]) -> tuple[int, int, int, int]:
    """Left, right, bottom and top of what is drawn in any of the views: the same for all, to keep their scales equal."""
    rows, columns = (np.flatnonzero(np.any(drawn, axis=0).any(axis=axis)) for axis in (1, 0))
    return columns[0] - MARGIN_DOTS, columns[-1] + MARGIN_DOTS, rows[-1] + MARGIN_DOTS, rows[0] - MARGIN_DOTS
