"""Pictures of the shape of a tongue: the midsagittal contour and a coronal section, at rest and at several times.

The speaker looks to the left in side views: x points backwards, z up, y to the speaker's right. Lengths are in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from explicitfe.app.view.bones import fill_bones, keep_to_tongue, mark_constriction
from explicitfe.app.view.heading import result_figure
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.palette import GREY, HELD, plain, sequence
from explicitfe.app.view.times import drawn_steps, milliseconds
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.results.files import Result
from explicitfe.results.measure.sections import PlaneCut, X, Y, Z, groove_depth, middle, midline, midsagittal, section, station

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def attachments(result: Result, step: int) -> dict[str, np.ndarray]:
    """The node sets that are fixed: those whose displacement is exactly 0, while other nodes have moved."""
    still = np.all(result.displacement(step) == 0.0, axis=1)
    if still.all():
        return {}
    return {name: nodes for name, nodes in result.mesh.node_sets.items() if len(nodes) and still[nodes].all()}


def contour_figure(result: Result, step: int, steps: Sequence[int] | None = None) -> Figure | None:
    """The midsagittal outline at several times, with the paths of the named points; None where the plane does not cut the body.

    ``steps`` are drawn in addition to the shape at rest; by default some up to ``step``.
    """
    from matplotlib.patheffects import withStroke

    mesh = result.mesh
    cut = midsagittal(mesh)
    if not cut.loops:
        return None
    steps = _drawn(result, step, steps)
    figure = result_figure(result, 7.0, "Midsagittal contour")
    axes = figure.subplots()
    _side_view(axes)
    _outlines(axes, result, steps, cut, X)

    held = np.zeros(mesh.node_count)
    for marker, (name, nodes) in zip("s^DvP*" * 9, attachments(result, step).items(), strict=False):
        held[:] = 0.0
        held[nodes] = 1.0
        at = 1e3 * cut.at(mesh.points)[cut.at(held) == 1.0]
        if len(at):
            axes.plot(at[:, X], at[:, Z], marker, color=HELD, ms=5.5, label=f"fixed: {name}", zorder=4)

    in_plane = _points_in_plane(mesh)
    centre = np.nanmean(1e3 * cut.outline(mesh.points), axis=0)
    for name, point in in_plane.items():
        path = 1e3 * (point.position + result.probe(name)[: step + 1])
        label = "named point\nat rest ○, at end ●" if name == next(iter(in_plane)) else None
        axes.plot(path[:, X], path[:, Z], color="black", lw=1.0, zorder=5, label=label)
        axes.plot(*path[0, [X, Z]], "o", mfc="white", mec="black", ms=5.5, zorder=6)
        axes.plot(*path[-1, [X, Z]], "o", mfc="black", mec="black", ms=5.5, zorder=6)
        outwards = (path[0] - centre)[[X, Z]]
        # The name stands on the side that the point does not move to.
        side = -9.0 if (path[-1] - path[0])[[X, Z]] @ outwards > 0.0 else 9.0
        dx, dz = side * outwards / max(np.hypot(*outwards), 1e-9)
        axes.annotate(
            name,
            path[0, [X, Z]],
            (dx, dz),
            textcoords="offset points",
            ha="left" if dx > 4.0 else "right" if dx < -4.0 else "center",
            va="bottom" if dz > 4.0 else "top" if dz < -4.0 else "center",
            zorder=7,
            path_effects=[withStroke(linewidth=3, foreground="white")],
        )
    axes.margins(0.09)
    if result.bones:
        fill_bones(axes, result, step, *_midsagittal_plane(mesh), X)
        mark_constriction(axes, result, step)
        keep_to_tongue(axes, _span(result, steps, cut, X))
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False)
    return figure


def coronal_figure(result: Result, step: int, steps: Sequence[int] | None = None) -> Figure | None:
    """A coronal section of the front, at rest and later, and where it is; None where the plane does not cut the body.

    ``steps`` as in :func:`contour_figure`.
    """
    mesh = result.mesh
    cut, side = section(mesh, X, station(mesh, "front")), midsagittal(mesh)
    if not cut.loops:
        return None
    steps = _drawn(result, step, steps)
    figure = result_figure(result, 6.0, "Coronal section of the front, moving with the tissue")
    where, axes = figure.subplots(1, 2, width_ratios=[1.0, 1.6])
    now = mesh.points + result.displacement(step)
    loop = max(cut.loops, key=len)
    at_rest, at_end = cut.at(mesh.points)[loop], cut.at(now)[loop]
    middle_points = midline(at_rest)

    _side_view(where, "box")
    for points, outline, colour in ((mesh.points, at_rest, GREY), (now, at_end, sequence(1)[0])):
        line, inside = outline_mm(result, side, points), 1e3 * outline[middle_points]
        where.plot(line[:, X], line[:, Z], color=colour, lw=0.8)
        where.plot(inside[:, X], inside[:, Z], color=colour, lw=2.5, solid_capstyle="round")
    where.set_title("place of the section (thick)", fontsize=10)
    if result.bones:
        fill_bones(where, result, step, *_midsagittal_plane(mesh), X, label=None)
        keep_to_tongue(where, _span(result, steps, side, X))

    plain(axes)
    axes.set_aspect("equal", adjustable="datalim")
    _outlines(axes, result, steps, cut, Y)
    depths = [_depth(1e3 * groove_depth(at_rest, outline)) for outline in (at_rest, at_end)]
    back, _, up = 1e3 * (at_end - at_rest)[middle_points[-1]]
    time = milliseconds(result.times[[step]], result.times[step])[0]
    axes.set_title(
        f"groove in the midline: {depths[0]} at rest, {depths[1]} at {time}\n"
        f"the top moved {abs(back):.1f} mm {'back' if back > 0.0 else 'forward'} "
        f"and {abs(up):.1f} mm {'up' if up > 0.0 else 'down'}",
        fontsize=10,
    )
    axes.set_xlabel("left  ←   y (mm)   →  right")
    axes.set_ylabel("z, up (mm)")
    for each in (where, axes):
        each.margins(0.08)
    if result.bones:
        # The tissue of the section has moved on from where it was cut: bones are cut by the plane through its midline now.
        top, bottom = at_end[middle_points[[-1, 0]]]
        across_it = np.array([top[Z] - bottom[Z], 0.0, bottom[X] - top[X]])
        fill_bones(
            axes, result, step, top, across_it / np.linalg.norm(across_it), Y, label="bone at the current\nplace of the section"
        )
        keep_to_tongue(axes, _span(result, steps, cut, Y))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def _drawn(result: Result, step: int, steps: Sequence[int] | None) -> list[int]:
    """The samples that are drawn in addition to the shape at rest: the chosen ones, or some up to ``step``."""
    return drawn_steps(result.times, step) if steps is None else list(steps)


def _outlines(axes: Axes, result: Result, steps: Sequence[int], cut: PlaneCut, across: int) -> None:
    """Draw a section at rest and at several steps, the last of them thick; ``across`` is the axis drawn to the right."""
    reference = outline_mm(result, cut, result.mesh.points)
    axes.fill(*_polygon(reference, across, Z), color="0.94", zorder=0)
    axes.plot(reference[:, across], reference[:, Z], color=GREY, lw=2.0, label="at rest")
    labels = milliseconds(result.times[list(steps)], result.times[steps[-1]]) if steps else []
    for number, colour, label in zip(steps, sequence(len(steps)), labels, strict=True):
        line = outline_mm(result, cut, result.mesh.points + result.displacement(number))
        width = 2.6 if number == steps[-1] else 1.3
        axes.plot(line[:, across], line[:, Z], color=colour, lw=width, label=label)


def _midsagittal_plane(mesh: HexMesh) -> tuple[np.ndarray, np.ndarray]:
    """A point (3,) m of the midsagittal plane, and its normal."""
    return np.array([0.0, middle(mesh), 0.0]), np.array([0.0, 1.0, 0.0])


def _span(result: Result, steps: Sequence[int], cut: PlaneCut, across: int) -> np.ndarray:
    """All points, (k, 2) mm, of the outlines that are drawn of a section."""
    outlines = [outline_mm(result, cut, result.mesh.points + result.displacement(number)) for number in (0, *steps)]
    return np.concatenate(outlines)[:, [across, Z]]


def _side_view(axes: Axes, adjustable: Literal["box", "datalim"] = "datalim") -> None:
    """Give a panel the axes of a view from the speaker's left."""
    plain(axes)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set_xlabel("front  ←   x (mm)   →  back")
    axes.set_ylabel("z, up (mm)")


def _points_in_plane(mesh: HexMesh) -> dict[str, MaterialPoints]:
    """The named points of the midsagittal plane; all of them if none lies there."""
    tolerance = 1e-3 * float(np.ptp(mesh.points[:, Y]))
    points = mesh.named_points
    return {name: at for name, at in points.items() if abs(at.position[0, Y] - middle(mesh)) < tolerance} or points


def _polygon(outline: np.ndarray, across: int, up: int) -> list[np.ndarray]:
    """Arguments of ``fill`` for the loops of an outline."""
    breaks = np.flatnonzero(np.isnan(outline[:, 0]))
    loops = [part for part in np.split(outline, breaks) if len(part) > 1]
    return [loop[1:, axis] if np.isnan(loop[0, 0]) else loop[:, axis] for loop in loops for axis in (across, up)]


def _depth(mm: float) -> str:
    """The depth of a groove in words."""
    return "none" if mm < 0.05 else f"{mm:.1f} mm"
