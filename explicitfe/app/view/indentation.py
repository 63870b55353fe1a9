"""Pictures of an indentation: force against displacement, and the deformed section under the tool."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.chart_figure import draw_charts
from explicitfe.app.view.page.run.charts import charts_of
from explicitfe.app.view.palette import ENERGY_MAP, new_figure
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh
from explicitfe.results.documents.fitted_curves import StatedTool
from explicitfe.results.files import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

# The colours go up to what this share of the section's area stays below: the element at a sharp edge would drown all others.
COLOURED_AREA_SHARE = 0.99
ENERGY_LABEL = f"strain energy density (Pa), up to what {100 * COLOURED_AREA_SHARE:.0f} % of the section stay below"


def step_of_largest_force(result: Result, last: int) -> int:
    """The load step up to ``last`` with the largest force."""
    return int(np.argmax(result.history("force")[: last + 1]))


def section_faces(mesh: HexMesh) -> tuple[np.ndarray, np.ndarray]:
    """Faces of elements that lie in the plane y = 0, on its side y > 0: node numbers (k, 4) and their elements (k,).

    Of an element that is collapsed on the axis, only faces with four different nodes are taken.
    """
    flat = np.abs(mesh.points[:, 1]) < 1e-12
    faces = mesh.hexes[:, FACES]
    element, side = np.nonzero(flat[faces].all(axis=2))
    across = mesh.points[mesh.hexes[element]].mean(axis=1)[:, 1] > 0.0
    corners = faces[element, side]
    whole = np.array([len(set(face)) == 4 for face in corners.tolist()], dtype=bool)
    return corners[across & whole], element[across & whole]


def tool_outline(tool: StatedTool, lowest_mm: float, up_to_mm: float, out_to_mm: float) -> np.ndarray:
    """Half of a tool's outline, from the axis outwards: (k, 2) of r and z [mm].

    Parameters
    ----------
    tool : all shapes but a platen have a radius.
    lowest_mm : z of its lowest point.
    up_to_mm, out_to_mm : where the picture ends.
    """
    if tool["shape"] == "platen":
        return np.array([[0.0, lowest_mm], [out_to_mm, lowest_mm]])
    radius = tool["radius_mm"]
    if tool["shape"] == "bonded-disc":
        return np.array([[0.0, lowest_mm], [radius, lowest_mm], [radius, up_to_mm]])
    edge = radius if tool["shape"] == "sphere" else tool.get("edge_radius_mm", 1.0)
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi if tool["shape"] == "sphere" else 0.0, 60)
    arc = np.column_stack([radius - edge + edge * np.cos(angle), lowest_mm + edge + edge * np.sin(angle)])
    ends = [[0.0, lowest_mm]], ([] if tool["shape"] == "sphere" else [[radius, max(up_to_mm, lowest_mm + edge)]])
    return np.concatenate([np.array(ends[0]), arc, np.array(ends[1]).reshape(-1, 2)])


def paint_section(
    axes: Axes, mesh: HexMesh, displacement_m: np.ndarray, values: np.ndarray, tool: StatedTool, lowest_mm: float
) -> PolyCollection:
    """Draw the deformed section y = 0, coloured by values of the elements, and the tool; give what a colour bar belongs to."""
    from matplotlib.collections import PolyCollection

    faces, element = section_faces(mesh)
    place = 1e3 * (mesh.points + displacement_m)[:, [0, 2]]
    polygons = place[faces]
    x, y = polygons[..., 0], polygons[..., 1]
    area = 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1))
    order = np.argsort(values[element])
    share = np.cumsum(area[order]) / area.sum()
    top = values[element][order][min(np.searchsorted(share, COLOURED_AREA_SHARE), len(order) - 1)]
    painted = PolyCollection(polygons, array=values[element], cmap=ENERGY_MAP, edgecolors="0.5", linewidths=0.25)
    painted.set_clim(0.0, max(float(top), 1e-300))
    axes.add_collection(painted)
    left, right = place[np.unique(faces), 0].min(), place[np.unique(faces), 0].max()
    highest = place[np.unique(faces), 1].max()
    margin = 0.04 * (right - left)
    outline = tool_outline(tool, lowest_mm, highest + 2.0 * margin, right + margin)
    whole = np.concatenate([outline[::-1] * [-1.0, 1.0], outline]) if left < -1e-9 else outline
    axes.fill(
        *np.concatenate([whole, [[whole[-1, 0], highest + 9.0 * margin], [whole[0, 0], highest + 9.0 * margin]]]).T, color="0.8"
    )
    axes.plot(*whole.T, color="black", lw=1.6)
    axes.set_xlim(left - margin, right + margin)
    axes.set_ylim(-margin, highest + 2.5 * margin)
    axes.set_aspect("equal")
    axes.set_xlabel("distance from the axis (mm)")
    axes.set_ylabel("height (mm)")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return painted


def curve_figure(result: Result, step: int) -> Figure | None:
    """Force against displacement over the whole run; None if it has a single equilibrium."""
    charts = charts_of([result])[0]
    if not charts:
        return None
    figure = new_figure(7.0, 5.0)
    draw_charts(figure, charts)
    figure.suptitle(_title(result), fontsize=11, x=0.02, ha="left")
    return figure


def section_figure(result: Result, step: int) -> Figure:
    """The deformed section under the tool at a step."""
    scenario, tool = result.model["scenario"], result.model["tool"]
    specimen = scenario["model"]
    height = specimen["size_mm"][2] if "size_mm" in specimen else specimen["height_mm"]
    displacement = 1e3 * result.history("indentation")[step]
    figure = new_figure(9.0, 6.0)
    axes = figure.add_subplot()
    name = "strain_energy_density" if "strain_energy_density" in result.fields else None
    values = result.field(name, step) if name else np.zeros(result.mesh.element_count)
    lowest = height - displacement - result.summary.get("touch_mm", 0.0)
    painted = paint_section(axes, result.mesh, result.displacement(step), values, tool, lowest)
    if name:
        bar = figure.colorbar(painted, ax=axes, orientation="horizontal", shrink=0.6, aspect=40, extend="max")
        bar.set_label(ENERGY_LABEL)
    force = result.history("force")[step]
    figure.suptitle(f"{_title(result)}\n{force:.4g} N at {displacement:.3f} mm", fontsize=11, x=0.02, ha="left")
    return figure


def _title(result: Result) -> str:
    """The title of the scenario, with the status of a run that did not finish."""
    title = result.model.get("scenario", {}).get("title", "")
    return title if result.status == "finished" else f"{title} (status: {result.status})"
