"""Pictures in three dimensions, drawn in a process of their own: the deformed tongue, and the map of its hourglass energy.

Without OpenGL, or with a broken display, VTK does not raise an error: it crashes. The process is this module, started as
``python -m explicitfe.view.render RESULT VIEW [MAP]``.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.measure.sections import Y, middle
from explicitfe.measure.steps import last_step
from explicitfe.results import StoredBone, open_result
from explicitfe.view.heading import result_figure, rounded
from explicitfe.view.hourglass import OUTSIDE_VIEWS, HourglassMap, hourglass_map, outside_view
from explicitfe.view.palette import BONE, BONE_EDGE, ENERGY_MAP, WIDTH_IN, save
from explicitfe.view.times import milliseconds

if TYPE_CHECKING:
    import pyvista

# Without a graphics card a view takes a few seconds: a process that takes longer than this hangs.
RENDER_LIMIT_S = 120.0
# The colour scale of the hourglass map ends here at most, and spans so many powers of ten: more would show no difference.
MAP_TOP_PERCENT = 1000.0
MAP_DECADES = 3
# An element is found in the picture where it covers more dots than this; fewer cannot be pointed at.
SEEN_DOTS = 20
# A view is drawn a little larger than it stands in the picture, and cut to what it shows with a margin around it.
VIEW_DOTS = 1100
MARGIN_DOTS = 20
# Bones are drawn as far as this around the tongue, and let it be seen through them.
BONES_AROUND_MM = 12.0
BONE_OPACITY = 0.5
FOLDED_COLOUR = "#E00000"


def start_rendering(result_path: Path, targets: Sequence[Path]) -> subprocess.Popen[str]:
    """Start to draw the 3D view and, if there is a second target, the hourglass map; give the process."""
    for target in targets:
        target.unlink(missing_ok=True)
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "explicitfe.view.render", str(result_path), *map(str, targets)],
        env=os.environ | {"PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def end_rendering(rendering: subprocess.Popen[str], targets: Sequence[Path]) -> str:
    """Wait for the rendered pictures; give a sentence if one is missing, else an empty text."""
    try:
        _, errors = rendering.communicate(timeout=RENDER_LIMIT_S)
        drawn = rendering.returncode == 0 and all(target.exists() for target in targets)
        why = "" if drawn else f"exit code {rendering.returncode}"
    except subprocess.TimeoutExpired:
        errors, why = "", f"it took longer than {RENDER_LIMIT_S:g} s"
    if not why:
        return ""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if lines and "Error" in lines[-1]:
        why = lines[-1].rstrip(".")
    return (
        f"The 3D view {'and the hourglass map were' if len(targets) > 1 else 'was'} left out because this machine could not "
        f"render {'them' if len(targets) > 1 else 'it'} ({why}); the other pictures are complete. "
        "On a computer without a screen VTK needs EGL or OSMesa (Debian, Ubuntu: install libegl1 or libosmesa6)."
    )


def _render(result_path: Path, target: Path) -> None:
    """The deformed tongue from the front and, cut in the middle, from the side, coloured by displacement."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    with open_result(result_path) as result:
        step = last_step(result)
        mesh, u = result.mesh, result.displacement(step)
        grid = _grid(1e3 * mesh.points, mesh.hexes)
        grid.point_data["u"] = 1e3 * u
        grid.point_data["displacement"] = 1e3 * np.linalg.norm(u, axis=1)
        limit = float(grid.point_data["displacement"].max()) or 1.0
        # The cut is made in the reference shape: the cut face is the midsagittal tissue, wherever it went.
        origin = (0.0, 1e3 * middle(mesh), 0.0)
        half, face = grid.clip(normal="y", origin=origin, invert=False), grid.slice(normal="y", origin=origin)
        # Of the bones the far half is shown: the near one would hide the tongue.
        bones = _bones_around(grid, result.placed_bones(step).values())
        halves = [bone.clip(normal="y", origin=origin, invert=False) for bone in bones]
        lines = [bone.slice(normal="y", origin=origin) for bone in bones]
        views = [
            _view(grid, grid, grid, (-1.0, -0.75, 0.45), limit, halves, lines),
            _view(half, face, grid, (0.0, -1.0, 0.0), limit, halves, lines),
        ]
        left, right, bottom, top = _window([np.any(image < 255, axis=2) | mask for image, mask in views])
        height, width = bottom - top, right - left
        time = milliseconds(result.times[[step]], result.times[step])[0]
        around = ", with the right half of the bones around it" if bones else ""
        figure = result_figure(result, 1.75 + 0.47 * WIDTH_IN * height / width, f"Tongue at {time}{around}, dashed: at rest")
        titles = ("from the front and the left", "cut at the midsagittal plane, front at the left")
        for axes, (image, mask), title in zip(figure.subplots(1, 2), views, titles, strict=True):
            axes.imshow(image)
            axes.contour(mask, [0.5], colors="0.35", linewidths=1.2, linestyles="--")
            axes.set_xlim(left, right)
            axes.set_ylim(bottom, top)
            axes.set_title(title, fontsize=10)
            axes.set_axis_off()
        scale = ScalarMappable(Normalize(0.0, limit), "viridis")
        bar = figure.colorbar(scale, ax=figure.axes, location="bottom", shrink=0.5, aspect=40, pad=0.02)
        bar.set_label("displacement (mm)")
        save(figure, target)


def _view(
    part: pyvista.DataSet,
    reference: pyvista.DataSet,
    whole: pyvista.DataSet,
    direction: tuple[float, float, float],
    limit: float,
    bones: Sequence[pyvista.DataSet] = (),
    bone_lines: Sequence[pyvista.DataSet] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """The deformed ``part`` from ``direction`` as pixels, (h, w, 3), and where ``reference`` would be, (h, w) bool.

    The camera is placed by ``whole``, at rest and deformed, and by the bones, in the same way for all parts. Bones can be looked
    through.
    """
    shown = [whole.points, whole.points + whole.point_data["u"], *(bone.points for bone in bones)]
    plotter = _plotter(np.concatenate(shown), direction)
    actor = plotter.add_mesh(reference, color="black", lighting=False, reset_camera=False, render=False)
    mask = _pixels(plotter)[:, :, 0] < 128
    plotter.remove_actor(actor, reset_camera=False, render=False)
    plotter.add_mesh(
        part.warp_by_vector("u").extract_surface(algorithm="dataset_surface"),
        scalars="displacement",
        clim=(0.0, limit),
        cmap="viridis",
        show_edges=True,
        edge_color="#202020",
        edge_opacity=0.3,
        show_scalar_bar=False,
        ambient=0.4,
        diffuse=0.7,
        reset_camera=False,
        render=False,
    )
    for bone in bones:
        plotter.add_mesh(bone, color=BONE, opacity=BONE_OPACITY, reset_camera=False, render=False)
    for line in bone_lines:
        plotter.add_mesh(line, color=BONE_EDGE, line_width=2, lighting=False, reset_camera=False, render=False)
    plotter.render()  # without it a second screenshot would be the first one again
    image = _pixels(plotter)
    plotter.close()
    return image, mask


def _bones_around(grid: pyvista.DataSet, bones: Iterable[StoredBone]) -> list[pyvista.PolyData]:
    """The bones, in mm, as far as they are near the tongue at rest: of a whole skull the tongue would be a dot."""
    import pyvista

    low, high = grid.points.min(axis=0) - BONES_AROUND_MM, grid.points.max(axis=0) + BONES_AROUND_MM
    box = np.column_stack([low, high]).ravel()
    near = []
    for bone in bones:
        surface = pyvista.PolyData.from_regular_faces(1e3 * bone.points, bone.triangles)
        if np.any((surface.points < low) | (surface.points > high)):
            surface = surface.clip_box(box, invert=False).extract_surface(algorithm="dataset_surface")
        if surface.n_points:
            near.append(surface)
    return near


def _render_hourglass(result_path: Path, target: Path) -> None:
    """The deformed elements, cut in the middle and from outside, coloured by their hourglass energy."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    with open_result(result_path) as result:
        step = last_step(result)
        energy = hourglass_map(result, step)
        assert energy is not None
        mesh = result.mesh
        points = 1e3 * (mesh.points + result.displacement(step))
        top = min(MAP_TOP_PERCENT, 10.0 ** math.ceil(math.log10(energy.percent.max())))
        limits = (top / 10.0**MAP_DECADES, top)
        # Elements stay whole, as each has one value: shown are those whose middle is right of the plane or in it.
        y = mesh.points[mesh.hexes, Y].mean(axis=1)
        half = y > middle(mesh) - 1e-9 * np.ptp(mesh.points[:, Y])
        name = outside_view(points, mesh.hexes, energy.percent)
        views = {
            "cut at the midsagittal plane, front at the left": _map_view(
                points, mesh.hexes, half, energy, (0.0, -1.0, 0.0), limits
            ),
            name: _map_view(points, mesh.hexes, np.ones_like(half), energy, OUTSIDE_VIEWS[name], limits),
        }
        left, right, bottom, above = _window([np.any(image < 255, axis=2) for image, _ in views.values()])
        time = milliseconds(result.times[[step]], result.times[step])[0]
        what = f"Hourglass energy at {time}, {rounded(energy.share, 2)} % of the elastic energy"
        folded = int(energy.folded.sum())
        if folded:
            what += f"; {folded} of {mesh.element_count} elements folded (red edges)"
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
        lines = [f"The {len(energy.worst)} largest, where they are at rest:"]
        for number, element in enumerate(energy.worst, start=1):
            place = ", ".join(f"{1e3 * value:.0f}" for value in mesh.points[mesh.hexes[element]].mean(axis=0))
            note = ", folded" if energy.folded[element] else ""
            note += "" if any(number in places for _, places in views.values()) else ", hidden"
            lines.append(f"{number}  element {element}: {rounded(energy.percent[element])} % at ({place}) mm{note}")
        listing = panels["list"].text(0.12, 0.98, "\n".join(lines), va="top", fontsize=9.5, linespacing=1.4)
        listing.set_in_layout(False)
        save(figure, target)


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
    surface = _grid(points, hexes[elements]).extract_surface(algorithm="dataset_surface", pass_pointid=False)
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


def _grid(points: np.ndarray, hexes: np.ndarray) -> pyvista.UnstructuredGrid:
    """The elements as pyvista takes them."""
    import pyvista

    types = np.full(len(hexes), pyvista.CellType.HEXAHEDRON, dtype=np.uint8)
    return pyvista.UnstructuredGrid(np.insert(hexes, 0, 8, axis=1).ravel(), types, points)


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


if __name__ == "__main__":
    _render(Path(sys.argv[1]), Path(sys.argv[2]))
    for path in sys.argv[3:]:
        _render_hourglass(Path(sys.argv[1]), Path(path))
