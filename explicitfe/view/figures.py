"""Pictures of a result as PNG files: contour, coronal section, probes, energies, 3D view, hourglass map.

The speaker looks to the left in all side views: x points backwards, z up, y to the speaker's right. Lengths are in mm,
times in ms. Sections are cut through the reference shape and move with the material, so a picture shows where the
tissue of a section went, not what else came into its plane.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import textwrap
import tomllib
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.errors import InputError
from explicitfe.mesh.hexmesh import FACES, HexMesh
from explicitfe.mesh.quality import corner_jacobians, volumes
from explicitfe.results import Result, open_result
from explicitfe.view.indentation import draw_indentation

if TYPE_CHECKING:
    import pyvista
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

X, Y, Z = 0, 1, 2
WIDTH_IN, DPI = 10.0, 160  # 1600 px
OUTLINES = 6  # times drawn besides the rest shape: more lie on each other
REST, HELD, GRID = "0.55", "black", "0.88"
# Okabe and Ito's colours, told apart with every kind of colour blindness; their yellow is too pale for a line.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "black")
LINES = ("-", "--", ":", "-.")
# Below this share of its largest, shares of the elastic energy mean nothing, as in the summary of a run.
SHARE_FLOOR = 0.01
ROUNDING = 1e-12
USUAL_SHARE = 0.1  # of hourglass energy: what users of explicit codes are advised to stay below
RENDER_LIMIT_S = 120.0
WORST = 5  # elements numbered in the hourglass map
MAP, FOLDED = "cividis_r", "#E00000"
MAP_TOP, MAP_DECADES = 1000.0, 3  # of its colour scale, %
# Where the hourglass map can be seen from, besides the cut.
OUTSIDE = {
    f"from {along}, {side} and {up}": (x, y, z)
    for side, y in (("left", -0.75), ("right", 0.75))
    for along, x in (("behind", 1.0), ("the front", -1.0))
    for up, z in (("above", 0.45), ("below", -0.45))
}


def draw(result_path: Path, folder: Path | None = None) -> list[Path]:
    """Draw a result.

    Parameters
    ----------
    result_path : the result, of a run that finished, failed or was killed.
    folder : where the pictures go; beside the result if left out.

    Returns
    -------
    The PNG files: ``<stem>-contour.png``, ``-coronal``, ``-probes``, ``-energies``, ``-3d`` and ``-hourglass``; of an
    indentation ``<stem>-curve.png`` and ``-section``. A picture
    for which the result has nothing to show is left out; so are the last two, with a warning, where the machine cannot
    render.

    Raises
    ------
    InputError : the file cannot be read or no step is stored in it.
    """
    result_path = Path(result_path)
    folder = result_path.parent if folder is None else Path(folder)
    with open_result(result_path) as result:
        step = last_step(result)
        folder.mkdir(parents=True, exist_ok=True)
        if "tool" in result.model:
            return draw_indentation(result, step, folder)

        def target(name: str) -> Path:
            return folder / f"{result_path.stem}-{name}.png"

        paths = []
        rendered = [target("3d")] + [target("hourglass")] * (hourglass_map(result, step) is not None)
        rendering = _start_rendering(result_path, rendered)
        try:
            for name, picture in (
                ("contour", _contour),
                ("coronal", _coronal),
                ("probes", _probes),
                ("energies", _energies),
            ):
                figure = picture(result, step)
                if figure is not None:
                    _save(figure, target(name))
                    paths.append(target(name))
            problem = _end_rendering(rendering, rendered)
        finally:
            rendering.kill()
    if problem:
        warnings.warn(problem, stacklevel=2)
    else:
        paths += rendered
    return paths


# ---- what is drawn: numbers from the result ----


@dataclass(frozen=True)
class Section:
    """Outline of a plane cut of the reference shape: points on edges of the surface, which move with them.

    Attributes
    ----------
    ends : (k, 2) int64. Nodes of the edge that each point lies on; twice the same where it is a node.
    share : (k,) Weight of the second node.
    loops : closed outlines as point numbers in order; the last joins the first.
    """

    ends: np.ndarray
    share: np.ndarray
    loops: tuple[np.ndarray, ...]

    def at(self, values: np.ndarray) -> np.ndarray:
        """Values of the nodes, (n, ...), interpolated at the points, (k, ...)."""
        share = self.share.reshape(-1, *[1] * (values.ndim - 1))
        return (1.0 - share) * values[self.ends[:, 0]] + share * values[self.ends[:, 1]]

    def outline(self, points: np.ndarray) -> np.ndarray:
        """All loops as one line, (j, 3): closed, with a row of NaN after each."""
        at = self.at(points)
        gap = np.full((1, points.shape[1]), np.nan)
        return np.concatenate([part for loop in self.loops for part in (at[loop], at[loop[:1]], gap)] or [gap])


def section(mesh: HexMesh, axis: int, position: float) -> Section:
    """Cut the reference shape by the plane where coordinate ``axis`` is ``position`` (m)."""
    distance = mesh.points[:, axis] - position
    distance[np.abs(distance) < 1e-9 * np.ptp(mesh.points, axis=0).max()] = 0.0
    quads = _surface(mesh.hexes)
    segments: list[tuple[tuple[int, int], tuple[int, int]]] = []
    # Nodes in the plane count as above it. A half model that ends there has nothing below: then they count as below.
    for above in (distance >= 0.0, distance > 0.0):
        changes = above[quads] != above[np.roll(quads, -1, axis=1)]
        for quad, change in zip(quads[changes.any(axis=1)], changes[changes.any(axis=1)], strict=True):
            cut = [_crossing(quad[k], quad[(k + 1) % 4], distance) for k in np.flatnonzero(change)]
            segments += [(a, b) for a, b in zip(cut[::2], cut[1::2], strict=True) if a != b]
        if segments:
            break
    edges = sorted({edge for segment in segments for edge in segment})
    number = {edge: k for k, edge in enumerate(edges)}
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2)
    low, high = distance[ends].T
    share = np.divide(low, low - high, out=np.zeros(len(ends)), where=low != high)
    return Section(ends, share, tuple(_loops([(number[a], number[b]) for a, b in segments])))


def midsagittal(mesh: HexMesh) -> Section:
    """The section y = 0 if nodes lie there, else halfway between the sides."""
    return section(mesh, Y, middle(mesh))


def middle(mesh: HexMesh) -> float:
    """The y of the midsagittal plane, m."""
    y = mesh.points[:, Y]
    return 0.0 if np.any(np.abs(y) < 1e-9 * np.ptp(y)) else 0.5 * (float(y.min()) + float(y.max()))


def front_position(mesh: HexMesh) -> float:
    """The x of a front coronal section, m: that of the point named "front", else 40 % of the length from the tip."""
    if "front" in mesh.named_points:
        return float(mesh.points[mesh.named_points["front"], X])
    x = mesh.points[:, X]
    return float(x.min() + 0.4 * np.ptp(x))


def midline(rest: np.ndarray) -> np.ndarray:
    """Numbers of the points of a coronal outline, (k, 3), nearest to its middle, from the lowest to the highest."""
    away = np.abs(rest[:, Y] - 0.5 * (rest[:, Y].min() + rest[:, Y].max()))
    nearest = np.flatnonzero(away < away.min() + 1e-6 * away.max())
    return nearest[np.argsort(rest[nearest, Z])]


def groove_depth(rest: np.ndarray, now: np.ndarray) -> float:
    """How far the midline of a coronal outline lies below the lower of the two sides' highest points, m; 0: no groove.

    Parameters
    ----------
    rest, now : (k, 3) m. Points of one outline in the reference shape, which says what is middle, left, right and
        above, and where they are now.
    """
    y = rest[:, Y] - 0.5 * (rest[:, Y].min() + rest[:, Y].max())
    top = midline(rest)[-1]
    # Only what was above stays in question: in a strong twist a lower corner could come up.
    upper = rest[:, Z] > 0.5 * (rest[:, Z].min() + rest[:, Z].max())
    sides = [now[upper & side, Z].max(initial=-np.inf) for side in (y < 0.0, y > 0.0)]
    return max(0.0, float(min(sides) - now[top, Z]))


def last_step(result: Result) -> int:
    """The last stored step whose displacements are finite.

    Raises
    ------
    InputError : there is none.
    """
    for step in reversed(range(len(result.times))):
        if np.isfinite(result.displacement(step)).all():
            return step
    raise InputError(f"{result.path} has no step that can be drawn; run the scenario again")


@dataclass(frozen=True)
class HourglassMap:
    """Where the hourglass energy of one step is.

    Attributes
    ----------
    percent : (m,) Hourglass energy per reference volume of every element, as a share of the body's mean elastic energy
        (strain + hourglass) per reference volume, %. Its mean, weighted by volume, is the body's hourglass share.
    worst : up to ``WORST`` elements with the largest ``percent``, largest first.
    folded : (m,) bool. Elements with a corner that is flat or inverted in the deformed shape.
    share : hourglass energy of the body as a share of its elastic energy, %.
    """

    percent: np.ndarray
    worst: np.ndarray
    folded: np.ndarray
    share: float


def hourglass_map(result: Result, step: int) -> HourglassMap | None:
    """The numbers of the hourglass map; None if the result has no such field, or it is zero at that step."""
    if "hourglass_energy" not in result.fields:
        return None
    energy = result.field("hourglass_energy", step)
    row = int(np.argmin(np.abs(result.history("time") - result.times[step])))
    elastic = float(result.history("internal_energy")[row] + energy.sum())
    if not energy.any() or not np.isfinite(elastic) or elastic <= 0.0:
        return None
    mesh = result.mesh
    volume = volumes(mesh.points, mesh.hexes)
    percent = 100.0 * (energy / volume) / (elastic / volume.sum())
    folded = np.any(corner_jacobians(mesh.points + result.displacement(step), mesh.hexes) <= 0.0, axis=1)
    worst = np.argsort(-percent, kind="stable")[:WORST]
    return HourglassMap(percent, worst, folded, 100.0 * float(energy.sum()) / elastic)


def outside_view(points: np.ndarray, hexes: np.ndarray, values: np.ndarray) -> str:
    """The view in ``OUTSIDE`` that shows the most: area as seen times the value of the element, summed over the surface.

    Faces that hide each other are not told apart. Of views that show about the same the first is taken.
    """
    faces = hexes[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = first[count == 1]
    a, b, c, d = points[faces[outer]].transpose(1, 0, 2)
    areas = 0.5 * np.cross(c - a, d - b)
    weights = values[outer // 6]
    seen = {name: weights @ np.maximum(0.0, areas @ direction) for name, direction in OUTSIDE.items()}
    return next(name for name, amount in seen.items() if amount >= 0.95 * max(seen.values()))


def drawn_steps(times: np.ndarray, last: int, count: int = OUTLINES) -> list[int]:
    """Up to ``count`` steps after the first, equally spaced in time, ``last`` among them."""
    wanted = times[0] + (times[last] - times[0]) * np.arange(1, count + 1) / count
    steps = {int(np.argmin(np.abs(times[: last + 1] - time))) for time in wanted}
    return sorted(steps - {0})


def attachments(result: Result, step: int) -> dict[str, np.ndarray]:
    """The node sets that are held: those whose nodes have not moved by one bit, while others have."""
    still = np.all(result.displacement(step) == 0.0, axis=1)
    if still.all():
        return {}
    return {name: nodes for name, nodes in result.mesh.node_sets.items() if len(nodes) and still[nodes].all()}


def activation(muscle: Mapping[str, Any], end_ms: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a muscle's force over time from 0 to ``end_ms``: times in ms, and shares of its ``force_N``."""
    if muscle.get("table"):
        times, scales = (list(column) for column in zip(*muscle["table"], strict=True))
    else:
        start = muscle.get("start_ms", 0.0)
        times, scales = [start, start + muscle.get("rise_ms", 0.0)], [0.0, 1.0]
        if muscle.get("end_ms") is not None:
            times, scales = times + [muscle["end_ms"]] * 2, scales + [1.0, 0.0]
    times, scales = [min(0.0, times[0]), *times, max(end_ms, times[-1])], [scales[0], *scales, scales[-1]]
    return np.array(times), np.array(scales)


def on_times(muscles: Iterable[Mapping[str, Any]], end_ms: float) -> list[tuple[float, float]]:
    """Spans of time, ms, in which at least one muscle pulls."""
    spans: list[tuple[float, float]] = []
    for muscle in muscles:
        times, scales = activation(muscle, end_ms)
        pulls = (np.maximum(scales[:-1], scales[1:]) > 0.0) & (times[1:] > times[:-1]) & (times[:-1] < end_ms)
        if muscle["force_N"] > 0.0:
            ends = np.minimum(times[1:][pulls], end_ms)
            spans += [(float(a), float(b)) for a, b in zip(times[:-1][pulls], ends, strict=True)]
    merged: list[tuple[float, float]] = []
    for start, end in sorted(spans):
        if merged and start <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        else:
            merged.append((start, end))
    return merged


def _surface(hexes: np.ndarray) -> np.ndarray:
    """The faces that belong to one element only, (f, 4) nodes in cyclic order."""
    faces = hexes[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def _crossing(a: int, b: int, distance: np.ndarray) -> tuple[int, int]:
    """Name of the point where an edge crosses the plane: the same from both faces, and one for a node in the plane."""
    if distance[a] == 0.0:
        return int(a), int(a)
    if distance[b] == 0.0:
        return int(b), int(b)
    return int(min(a, b)), int(max(a, b))


def _loops(segments: Sequence[tuple[int, int]]) -> Iterator[np.ndarray]:
    """Join segments to closed loops."""
    at = defaultdict(set)
    for k, (a, b) in enumerate(segments):
        at[a].add(k)
        at[b].add(k)
    unused = set(range(len(segments)))
    while unused:
        first = min(unused)
        start, point = segments[first]
        loop, segment = [start], first
        while True:
            unused.discard(segment)
            at[segments[segment][0]].discard(segment)
            at[segments[segment][1]].discard(segment)
            if point == start or not at[point]:
                break
            loop.append(point)
            segment = min(at[point])
            a, b = segments[segment]
            point = b if a == point else a
        if len(loop) > 2:
            yield np.array(loop)


# ---- pictures ----


def _contour(result: Result, step: int) -> Figure | None:
    """The midsagittal outline at several times, with the paths of the named points."""
    from matplotlib.patheffects import withStroke

    mesh = result.mesh
    cut = midsagittal(mesh)
    if not cut.loops:
        return None
    figure = _figure(result, 7.0, "Midsagittal contour")
    axes = figure.subplots()
    _side_view(axes)
    rest = 1e3 * cut.outline(mesh.points)
    _outlines(axes, result, step, cut, X)

    held = np.zeros(mesh.node_count)
    for marker, (name, nodes) in zip("s^DvP*" * 9, attachments(result, step).items(), strict=False):
        held[:] = 0.0
        held[nodes] = 1.0
        at = 1e3 * cut.at(mesh.points)[cut.at(held) == 1.0]
        if len(at):
            axes.plot(at[:, X], at[:, Z], marker, color=HELD, ms=5.5, label=f"held: {name}", zorder=4)

    in_plane = _points_in_plane(mesh)
    centre = np.nanmean(rest, axis=0)
    for name, node in in_plane.items():
        path = 1e3 * (mesh.points[node] + result.probe(name)[: step + 1])
        label = "named point,\nfrom rest ○ to end ●" if name == next(iter(in_plane)) else None
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
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False)
    return figure


def _coronal(result: Result, step: int) -> Figure | None:
    """A coronal section of the front at rest and after, and where it is."""
    mesh = result.mesh
    cut, side = section(mesh, X, front_position(mesh)), midsagittal(mesh)
    if not cut.loops:
        return None
    figure = _figure(result, 6.0, "Coronal section of the front, following the tissue")
    where, axes = figure.subplots(1, 2, width_ratios=[1.0, 1.6])
    now = mesh.points + result.displacement(step)
    loop = max(cut.loops, key=len)
    at_rest, at_end = cut.at(mesh.points)[loop], cut.at(now)[loop]
    middle_points = midline(at_rest)

    _side_view(where, "box")
    for points, outline, colour in ((mesh.points, at_rest, REST), (now, at_end, _sequence(1)[0])):
        line, inside = 1e3 * side.outline(points), 1e3 * outline[middle_points]
        where.plot(line[:, X], line[:, Z], color=colour, lw=0.8)
        where.plot(inside[:, X], inside[:, Z], color=colour, lw=2.5, solid_capstyle="round")
    where.set_title("where the section is (thick)", fontsize=10)

    _plain(axes)
    axes.set_aspect("equal", adjustable="datalim")
    _outlines(axes, result, step, cut, Y)
    depths = [_depth(1e3 * groove_depth(at_rest, outline)) for outline in (at_rest, at_end)]
    back, _, up = 1e3 * (at_end - at_rest)[middle_points[-1]]
    time = _ms(result.times[[step]], result.times[step])[0]
    axes.set_title(
        f"groove in the midline: {depths[0]} at rest, {depths[1]} at {time}\n"
        f"the top moved {abs(back):.1f} mm {'back' if back > 0.0 else 'forward'} "
        f"and {abs(up):.1f} mm {'up' if up > 0.0 else 'down'}",
        fontsize=10,
    )
    axes.set_xlabel("left  ←   y (mm)   →  right")
    axes.set_ylabel("z, up (mm)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    for each in (where, axes):
        each.margins(0.08)
    return figure


def _outlines(axes: Axes, result: Result, step: int, cut: Section, across: int) -> None:
    """A section at rest and at several times up to ``step``; ``across`` is the axis drawn to the right."""
    rest = 1e3 * cut.outline(result.mesh.points)
    axes.fill(*_polygon(rest, across, Z), color="0.94", zorder=0)
    axes.plot(rest[:, across], rest[:, Z], color=REST, lw=2.0, label="at rest")
    steps = drawn_steps(result.times, step)
    labels = _ms(result.times[steps], result.times[step])
    for number, colour, label in zip(steps, _sequence(len(steps)), labels, strict=True):
        line = 1e3 * cut.outline(result.mesh.points + result.displacement(number))
        width = 2.6 if number == step else 1.3
        axes.plot(line[:, across], line[:, Z], color=colour, lw=width, label=label)


def _probes(result: Result, step: int) -> Figure | None:
    """Displacement and speed of the probes over time."""
    names = [name.removesuffix("_displacement") for name in result.history_names if name.endswith("_displacement")]
    probes = [name.removeprefix("probe_") for name in names if name.startswith("probe_")]
    times = 1e3 * result.history("time")
    if not probes or len(times) < 2:
        return None
    # From front to back, as the model names its points and not as the file sorts them.
    order = list(result.model.get("probes", result.mesh.named_points))
    probes.sort(key=lambda name: order.index(name) if name in order else len(order))
    moved = {name: 1e3 * result.history(f"probe_{name}_displacement") for name in probes}
    largest = max(np.nanmax(np.abs(u), initial=0.0) for u in moved.values())
    rows = [
        ("forward (mm)", {name: -u[:, X] for name, u in moved.items()}),
        ("up (mm)", {name: u[:, Z] for name, u in moved.items()}),
    ]
    lateral = max(np.nanmax(np.abs(u[:, Y]), initial=0.0) for u in moved.values())
    if lateral > 1e-3 * largest:
        rows.append(("to the right (mm)", {name: u[:, Y] for name, u in moved.items()}))
    velocity = {name: f"probe_{name}_velocity" for name in probes if f"probe_{name}_velocity" in result.history_names}
    if velocity:
        speeds = {name: 1e3 * np.linalg.norm(result.history(key), axis=1) for name, key in velocity.items()}
        rows.append(("speed (mm/s)", speeds))

    figure = _figure(result, 1.3 + 0.22 * len(_muscles(result)) + 2.2 * len(rows), "Named points over time")
    panels = _time_panels(figure, result, [[label] for label, _ in rows], times[-1])
    for axes, (label, lines) in zip(panels, rows, strict=True):
        axes.set_ylabel(label)
        axes.axhline(0.0, color="0.6", lw=0.8)
        ends = {}
        for k, name in enumerate(lines):
            style = {"color": COLOURS[k % len(COLOURS)], "ls": LINES[k // len(COLOURS) % len(LINES)]}
            axes.plot(times, lines[name], lw=1.6, **style)
            shown = np.flatnonzero(np.isfinite(lines[name]))
            ends[name] = (float(lines[name][shown[-1]]) if len(shown) else 0.0, style["color"])
        _label_ends(axes, ends)
    if lateral <= 1e-3 * largest:
        panels[0].set_title(f"to the right: at most {max(1e-3, lateral):.2g} mm", fontsize=9, color="0.35", loc="right", pad=3)
    for axes in panels[:-1]:
        axes.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time (ms)")
    figure.align_ylabels(panels)
    return figure


def _energies(result: Result, step: int) -> Figure | None:
    """Energies over time, the error of their balance and the share of hourglass energy."""
    names = {
        "external_work": ("external work", "black", "-"),
        "internal_energy": ("elastic", COLOURS[0], "-"),
        "hourglass_energy": ("hourglass", COLOURS[1], "-"),
        "kinetic_energy": ("kinetic", COLOURS[2], "-"),
        "damping_loss": ("lost to damping", COLOURS[3], "--"),
    }
    times = 1e3 * result.history("time")
    if len(times) < 2 or not {*names, "balance_error"} <= set(result.history_names):
        return None
    energies = {name: result.history(name) for name in names}
    largest = max(float(np.nanmax(np.abs(energy), initial=0.0)) for energy in energies.values())
    factor, unit = next(((f, u) for f, u in ((1.0, "J"), (1e3, "mJ"), (1e6, "µJ")) if f * largest >= 0.1), (1e9, "nJ"))

    muscles = _muscles(result)
    figure = _figure(result, 7.2 + 0.22 * len(muscles), "Energies over time")
    panels = _time_panels(figure, result, [["energy", "energy"], ["balance", "share"]], times[-1], [1.9, 1.0])
    for name, energy in energies.items():
        label, colour, line = names[name]
        panels[0].plot(times, factor * energy, line, color=colour, lw=1.8, label=label)
    panels[0].set_ylabel(f"energy ({unit})")
    panels[0].legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), frameon=False, ncols=5, borderpad=0.2, columnspacing=1.6)

    error = 100.0 * result.history("balance_error")
    if np.any(error > 0.0):
        panels[1].plot(times, np.where(error > 0.0, error, np.nan), color="black", lw=1.6)
        panels[1].set_yscale("log")
    panels[1].set_title("error of the energy balance, largest so far", fontsize=10)
    panels[1].set_ylabel("relative error (%)")
    share = hourglass_share(result)
    panels[2].axhline(100.0 * USUAL_SHARE, color="0.4", lw=1.0, ls="--")
    panels[2].plot(times, 100.0 * share, color=COLOURS[1], lw=1.6)
    panels[2].set_title(f"hourglass share of elastic energy (dashed: {100.0 * USUAL_SHARE:g} %)", fontsize=10)
    panels[2].set_ylabel("share (%)")
    panels[2].set_ylim(0.0, max(12.5, 110.0 * np.nanmax(share, initial=0.0)))
    for axes in panels[1:]:
        axes.set_xlabel("time (ms)")
    return figure


def hourglass_share(result: Result) -> np.ndarray:
    """Share of hourglass energy in the elastic energy over the history; NaN where that is next to nothing."""
    hourglass = result.history("hourglass_energy")
    elastic = result.history("internal_energy") + hourglass
    other = np.abs([result.history("external_work"), result.history("kinetic_energy")])
    there = elastic > max(SHARE_FLOOR * np.nanmax(elastic, initial=0.0), ROUNDING * np.nanmax(other, initial=0.0))
    return np.divide(hourglass, elastic, out=np.full(len(elastic), np.nan), where=there)


# ---- 3D view, in a process of its own: without OpenGL or with a broken display VTK does not raise, it crashes ----


def _start_rendering(result_path: Path, targets: Sequence[Path]) -> subprocess.Popen:
    """Draw the 3D view and, if there is a second target, the hourglass map."""
    for target in targets:
        target.unlink(missing_ok=True)
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "explicitfe.view.figures", str(result_path), *map(str, targets)],
        env=os.environ | {"PYTHONPATH": path},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def _end_rendering(rendering: subprocess.Popen, targets: Sequence[Path]) -> str:
    """Wait for the rendered pictures; a sentence if one is missing."""
    try:
        _, said = rendering.communicate(timeout=RENDER_LIMIT_S)
        drawn = rendering.returncode == 0 and all(target.exists() for target in targets)
        why = "" if drawn else f"exit code {rendering.returncode}"
    except subprocess.TimeoutExpired:
        said, why = "", f"it took longer than {RENDER_LIMIT_S:g} s"
    if not why:
        return ""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
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
        # Cut in the reference shape: the cut face is the midsagittal tissue, wherever it went.
        plane = {"normal": "y", "origin": (0.0, 1e3 * middle(mesh), 0.0)}
        half, face = grid.clip(**plane, invert=False), grid.slice(**plane)
        views = [
            _view(grid, grid, grid, (-1.0, -0.75, 0.45), limit),
            _view(half, face, grid, (0.0, -1.0, 0.0), limit),
        ]
        left, right, bottom, top = _window([np.any(image < 255, axis=2) | mask for image, mask in views])
        height, width = bottom - top, right - left
        time = _ms(result.times[[step]], result.times[step])[0]
        figure = _figure(result, 1.75 + 0.47 * WIDTH_IN * height / width, f"Tongue at {time}, dashed: at rest")
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
        _save(figure, target)


def _view(
    part: pyvista.DataSet,
    rest: pyvista.DataSet,
    whole: pyvista.DataSet,
    direction: tuple[float, float, float],
    limit: float,
) -> tuple[np.ndarray, np.ndarray]:
    """The deformed ``part`` from ``direction`` as pixels, (h, w, 3), and where ``rest`` would be, (h, w) bool.

    The camera is placed by ``whole``, at rest and deformed, in the same way for all parts.
    """
    plotter = _plotter(np.concatenate([whole.points, whole.points + whole.point_data["u"]]), direction)
    actor = plotter.add_mesh(rest, color="black", lighting=False, reset_camera=False, render=False)
    mask = plotter.screenshot(return_img=True)[:, :, 0] < 128
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
    plotter.render()  # a second screenshot would be the first one again
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return image, mask


def _render_hourglass(result_path: Path, target: Path) -> None:
    """The deformed elements, cut in the middle and from outside, coloured by their hourglass energy."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    with open_result(result_path) as result:
        step = last_step(result)
        found = hourglass_map(result, step)
        assert found is not None
        mesh = result.mesh
        points = 1e3 * (mesh.points + result.displacement(step))
        top = min(MAP_TOP, 10.0 ** math.ceil(math.log10(found.percent.max())))
        limits = (top / 10.0**MAP_DECADES, top)
        # Whole elements, as each has one value: those whose middle is right of the plane or in it.
        y = mesh.points[mesh.hexes, Y].mean(axis=1)
        half = y > middle(mesh) - 1e-9 * np.ptp(mesh.points[:, Y])
        name = outside_view(points, mesh.hexes, found.percent)
        views = {
            "cut at the midsagittal plane, front at the left": _map_view(
                points, mesh.hexes, half, found, (0.0, -1.0, 0.0), limits
            ),
            name: _map_view(points, mesh.hexes, np.ones_like(half), found, OUTSIDE[name], limits),
        }
        left, right, bottom, above = _window([np.any(image < 255, axis=2) for image, _ in views.values()])
        time = _ms(result.times[[step]], result.times[step])[0]
        what = f"Hourglass energy at {time}, {_digits(found.share, 2)} % of the elastic energy"
        folded = int(found.folded.sum())
        if folded:
            what += f"; {folded} of {mesh.element_count} elements folded at a corner (red edges)"
        height, foot = 0.47 * WIDTH_IN * (bottom - above) / (right - left), 1.2
        figure = _figure(result, 1.15 + height + foot, what)
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
            ScalarMappable(LogNorm(*limits), MAP),
            cax=panels["scale"].inset_axes((0.1, 0.74, 0.8, 0.16)),
            orientation="horizontal",
            extend=ends[bool(found.percent.min() < limits[0]), bool(found.percent.max() > limits[1])],
        )
        bar.ax.xaxis.set_major_formatter("{x:g}")
        bar.set_label("hourglass energy per volume\n(% of the body's mean elastic energy per volume)")
        lines = [f"The {len(found.worst)} largest, where they are at rest:"]
        for number, element in enumerate(found.worst, start=1):
            place = ", ".join(f"{1e3 * value:.0f}" for value in mesh.points[mesh.hexes[element]].mean(axis=0))
            note = ", folded" if found.folded[element] else ""
            note += "" if any(number in places for _, places in views.values()) else ", hidden"
            lines.append(f"{number}  element {element}: {_digits(found.percent[element])} % at ({place}) mm{note}")
        listing = panels["list"].text(0.12, 0.98, "\n".join(lines), va="top", fontsize=9.5, linespacing=1.4)
        listing.set_in_layout(False)
        _save(figure, target)


def _map_view(
    points: np.ndarray,
    hexes: np.ndarray,
    shown: np.ndarray,
    found: HourglassMap,
    direction: tuple[float, float, float],
    limits: tuple[float, float],
) -> tuple[np.ndarray, dict[int, tuple[float, float]]]:
    """The elements ``shown`` from ``direction`` as pixels, and the places (column, row) of the worst, from 1, that are seen."""
    from matplotlib import colormaps

    elements = np.flatnonzero(shown)
    surface = _grid(points, hexes[elements]).extract_surface(algorithm="dataset_surface", pass_pointid=False)
    element = elements[surface.cell_data["vtkOriginalCellIds"]]
    plotter = _plotter(points, direction)

    # The worst are found again by grey levels that nothing else has.
    levels = np.zeros((surface.n_cells, 3), dtype=np.uint8)
    for number, worst in enumerate(found.worst, start=1):
        levels[element == worst] = 40 * number
    surface.cell_data["level"] = levels
    actor = plotter.add_mesh(surface, scalars="level", rgb=True, lighting=False, reset_camera=False, render=False)
    seen = plotter.screenshot(return_img=True)[:, :, 0]
    plotter.remove_actor(actor, reset_camera=False, render=False)
    places = {}
    for number in range(1, len(found.worst) + 1):
        rows, columns = np.nonzero(seen == 40 * number)
        if len(rows) > 20:
            nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
            places[number] = float(columns[nearest]), float(rows[nearest])

    clipped = np.log(np.clip(found.percent[element], *limits) / limits[0]) / np.log(limits[1] / limits[0])
    surface.cell_data["colour"] = (255.0 * colormaps[MAP](clipped)[:, :3]).astype(np.uint8)
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
    if found.folded[element].any():
        edges = surface.extract_cells(found.folded[element]).extract_all_edges()
        edges.points += 0.003 * np.ptp(points, axis=0).max() * np.array(direction)  # before the faces that they bound
        plotter.add_mesh(edges, color=FOLDED, line_width=3, lighting=False, reset_camera=False, render=False)
    plotter.render()  # a second screenshot would be the first one again
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return image, places


def _grid(points: np.ndarray, hexes: np.ndarray) -> pyvista.UnstructuredGrid:
    import pyvista

    types = np.full(len(hexes), pyvista.CellType.HEXAHEDRON, dtype=np.uint8)
    return pyvista.UnstructuredGrid(np.insert(hexes, 0, 8, axis=1).ravel(), types, points)


def _plotter(points: np.ndarray, direction: tuple[float, float, float]) -> pyvista.Plotter:
    """An empty view along ``direction`` in which all ``points`` have room, whichever way it looks."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(1100, 1100), lighting="light kit")
    plotter.set_background("white")
    plotter.enable_parallel_projection()
    centre = points.mean(axis=0)
    radius = np.linalg.norm(points - centre, axis=1).max()
    plotter.camera_position = [centre + 5.0 * radius * np.array(direction), centre, (0.0, 0.0, 1.0)]
    plotter.camera.parallel_scale = radius
    plotter.camera.clipping_range = (radius, 10.0 * radius)
    return plotter


def _window(drawn: Sequence[np.ndarray]) -> tuple[int, int, int, int]:
    """Left, right, bottom and top of what is drawn in any of the views: the same for all, to keep their scales equal."""
    rows, columns = (np.flatnonzero(np.any(drawn, axis=0).any(axis=axis)) for axis in (1, 0))
    return columns[0] - 20, columns[-1] + 20, rows[-1] + 20, rows[0] - 20


# ---- how it is drawn ----


def _figure(result: Result, height_in: float, what: str) -> Figure:
    """An empty figure with the titles of the run and of the picture."""
    from matplotlib.figure import Figure

    title = textwrap.wrap(_title(result), 88)
    second = ", ".join([what, *[_pull(muscle) for muscle in _muscles(result)]])
    if result.status not in ("finished", "running"):
        second += f"; the run ended early: {result.status}"
    lines = textwrap.wrap(second, 110)
    figure = Figure(figsize=(WIDTH_IN, height_in + 0.2 * (len(title) + len(lines) - 2)), dpi=DPI, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08)
    # Two sizes in one heading: the second part stands below the first, in the room that the first asks for.
    figure.suptitle("\n".join(title) + "\n" * len(lines), fontsize=13, fontweight="bold", x=0.012, ha="left")
    below = 1.0 - (0.1 + 0.225 * len(title)) / figure.get_figheight()
    figure.text(0.012, below, "\n".join(lines), fontsize=10.5, color="0.25", va="top")
    return figure


def _save(figure: Figure, path: Path) -> None:
    """Write a figure. `Figure.savefig` would draw it twice, once only for the layout."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).print_png(path)


def _title(result: Result) -> str:
    title = result.summary.get("title")
    if title:
        return str(title)
    try:
        return str(tomllib.loads(result.scenario_text).get("title", result.path.stem))
    except tomllib.TOMLDecodeError:
        return result.path.stem


def _muscles(result: Result) -> list[dict[str, Any]]:
    return result.model.get("muscles", [])


def _pull(muscle: Mapping[str, Any]) -> str:
    return f"{_name(muscle)} {muscle['force_N']:g} N ({muscle.get('distribution', 'ends')})"


def _name(muscle: Mapping[str, Any]) -> str:
    side = muscle.get("side", "both")
    return muscle["name"] if side == "both" else f"{muscle['name']} {side}"


def _side_view(axes: Axes, adjustable: str = "datalim") -> None:
    _plain(axes)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set_xlabel("front  ←   x (mm)   →  back")
    axes.set_ylabel("z, up (mm)")


def _plain(axes: Axes) -> None:
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _time_panels(
    figure: Figure, result: Result, rows: list[list[str]], end_ms: float, heights: Sequence[float] | None = None
) -> list[Axes]:
    """Panels over time, the muscles' pulls above them; returned in the order of ``rows``."""
    muscles = [muscle for muscle in _muscles(result) if muscle["force_N"] > 0.0]
    heights = list(heights or [1.0] * len(rows))
    total = figure.get_figheight()
    if muscles:
        share = 0.24 * len(muscles) / (total - 1.5 - 0.24 * len(muscles))
        rows = [["muscles"] * len(rows[0]), *rows]
        heights = [share * sum(heights), *heights]
    panels = figure.subplot_mosaic(rows, height_ratios=heights)
    if muscles:
        strip = panels.pop("muscles")
        for k, muscle in enumerate(muscles):
            times, scales = activation(muscle, end_ms)
            strip.fill_between(times, -k, -k + 0.8 * scales / max(1.0, scales.max()), color="0.45", lw=0)
        strip.set_yticks([0.4 - k for k in range(len(muscles))], [_name(muscle) for muscle in muscles])
        strip.set_ylim(0.9 - len(muscles), 1.0)
        strip.set_xlim(0.0, end_ms)
        strip.spines[["top", "right", "left"]].set_visible(False)
        strip.tick_params(labelbottom=False, left=False)
    for axes in panels.values():
        _plain(axes)
        axes.set_xlim(0.0, end_ms)
        for start, end in on_times(muscles, end_ms):
            axes.axvspan(start, end, color="0.955", lw=0, zorder=-1)
    return list(panels.values())


def _label_ends(axes: Axes, ends: Mapping[str, tuple[float, str]]) -> None:
    """Names of lines at their ends, in their colours, pushed apart where they would lie on each other."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top)
    height = axes.figure.get_figheight() / (len(axes.figure.axes) + 0.5)
    gap = min(0.19 / height, 1.0 / max(1, len(ends)))  # a line of text as a share of the panel
    names = sorted(ends, key=lambda name: ends[name][0])
    wanted = np.array([(ends[name][0] - bottom) / (top - bottom) for name in names])
    for name, place in zip(names, spread(wanted, gap), strict=True):
        axes.annotate(
            name,
            (1.0, (ends[name][0] - bottom) / (top - bottom)),
            (1.035, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=ends[name][1],
            va="center",
            arrowprops={
                "arrowstyle": "-",
                "color": ends[name][1],
                "lw": 0.8,
                "relpos": (0.0, 0.5),
                "shrinkA": 0,
                "shrinkB": 0,
            },
        )


def spread(wanted: np.ndarray, gap: float) -> np.ndarray:
    """Places in [0, 1] next to the sorted ``wanted`` ones and at least ``gap`` apart, if there is room for that."""
    # Least squares with an order: without the gaps this is isotonic regression (pool adjacent violators).
    offset = gap * np.arange(len(wanted))
    blocks: list[list[float]] = []  # [mean, size]
    for value in wanted - offset:
        blocks.append([float(value), 1])
        while len(blocks) > 1 and blocks[-2][0] >= blocks[-1][0]:
            mean, size = blocks.pop()
            blocks[-1] = [(blocks[-1][0] * blocks[-1][1] + mean * size) / (blocks[-1][1] + size), blocks[-1][1] + size]
    flat = np.repeat([mean for mean, _ in blocks], [int(size) for _, size in blocks])
    return np.clip(flat, 0.0, max(0.0, 1.0 - gap * (len(wanted) - 1))) + offset


def _points_in_plane(mesh: HexMesh) -> dict[str, int]:
    """The named points of the midsagittal plane; all of them if none lies there."""
    tolerance = 1e-3 * float(np.ptp(mesh.points[:, Y]))
    away = np.abs(mesh.points[:, Y] - middle(mesh))
    return {name: k for name, k in mesh.named_points.items() if away[k] < tolerance} or mesh.named_points


def _polygon(outline: np.ndarray, across: int, up: int) -> list[np.ndarray]:
    """Arguments of ``fill`` for the loops of an outline."""
    breaks = np.flatnonzero(np.isnan(outline[:, 0]))
    loops = [part for part in np.split(outline, breaks) if len(part) > 1]
    return [loop[1:, axis] if np.isnan(loop[0, 0]) else loop[:, axis] for loop in loops for axis in (across, up)]


def _sequence(count: int) -> list[Any]:
    """Colours of successive times, from light to dark so that the last stands out, readable with any colour vision."""
    from matplotlib import colormaps

    return [colormaps["viridis_r"](share) for share in np.linspace(0.12, 1.0, count)] if count > 1 else ["#440154"]


def _ms(times_s: np.ndarray, span_s: float) -> list[str]:
    """Times in words, as exact as telling the drawn ones apart asks for."""
    apart = 1e3 * max(span_s, 1e-9) / OUTLINES
    return [f"{1e3 * time:.{max(0, -math.floor(math.log10(apart)))}f} ms" for time in times_s]


def _digits(value: float, count: int = 3) -> str:
    """A number with some significant digits and no exponent."""
    return f"{float(f'{value:.{count}g}'):.10g}"


def _depth(mm: float) -> str:
    return "none" if mm < 0.05 else f"{mm:.1f} mm"


if __name__ == "__main__":
    _render(Path(sys.argv[1]), Path(sys.argv[2]))
    for path in sys.argv[3:]:
        _render_hourglass(Path(sys.argv[1]), Path(path))
