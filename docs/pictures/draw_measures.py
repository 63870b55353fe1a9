"""Draw what the measures of docs/reference/measures.md mean, from a result with a palate.

    python docs/pictures/draw_measures.py RESULT.vtkhdf [PICTURE.png]

Everything is taken from the functions that measure: the picture shows the definitions, not a sketch of them.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.app.view.bones import fill_bones, keep_to_tongue
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.palette import BONE, BONE_EDGE, COLOURS, CONSTRICTION, GREY, new_figure, plain, save
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.contact import DEPTHS, SIDES
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.measure import measures_of, nearest_of
from explicitfe.results.measure.motion import RISE_SHARE
from explicitfe.results.measure.sections import X, Y, Z, middle, midline, midsagittal, section, station
from explicitfe.results.measure.shape import summit
from explicitfe.results.measure.steps import last_step
from explicitfe.results.measure.tract import PALATE, channel, columns, palate_midline, section_places, section_plane

HERE = Path(__file__).resolve().parent
NOW, AIR, CHANNEL = "#440154", "#D6E8F5", "#8DBFE3"
SECTION_SHOWN_MM = 30.0  # the section across the palate whose area is drawn
POINT_SHOWN = "dorsum"


def main() -> None:
    source = Path(sys.argv[1])
    target = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "measures.png"
    figure = new_figure(13.0, 14.2, dots_per_inch=120)
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.12, wspace=0.03)  # type: ignore[union-attr]
    rows = [["side", "side"], ["area", "groove"], ["cells", "time"]]
    panels = figure.subplot_mosaic(rows, height_ratios=[2.1, 1.0, 1.0])
    with open_result(source) as result:
        step = last_step(result)
        measures = measures_of(result, step)
        draw_side(panels["side"], result, step, measures)
        draw_area(panels["area"], result, step)
        draw_groove(panels["groove"], result, step, measures)
        draw_cells(panels["cells"], result, step, measures)
        draw_time(panels["time"], result, measures)
    save(figure, target)
    print(f"written: {target}")


def draw_side(axes: Any, result: Result, step: int, measures: Measures) -> None:
    """Points, highest point, constriction, and where sections and grooves are cut."""
    mesh, u = result.mesh, result.displacement(step)
    plain(axes)
    axes.set_aspect("equal")
    fill_bones(axes, result, step, np.zeros(3), np.array([0.0, 1.0, 0.0]), X, label=None)
    cut = midsagittal(mesh)
    rest_line, now_line = outline_mm(result, cut, mesh.points), outline_mm(result, cut, mesh.points + u)
    axes.plot(rest_line[:, X], rest_line[:, Z], color=GREY, lw=1.5, label="tongue at rest")
    axes.plot(now_line[:, X], now_line[:, Z], color=NOW, lw=2.2, label=f"tongue at {measures.time_ms:.0f} ms")

    palate = result.placed_bones(step)[PALATE]
    line = palate_midline(palate.points[palate.triangles], middle(mesh))
    assert line is not None
    axes.plot(*(1e3 * line.points.T), color=COLOURS[0], lw=3.0, solid_capstyle="round", label="midline of the palate")
    for place in section_places(line):
        point, _, down = section_plane(line, place)
        shown = abs(1e3 * place - SECTION_SHOWN_MM) < 0.1
        ends = 1e3 * np.stack([point - 0.0025 * down, point + (0.016 if shown else 0.004) * down])
        axes.plot(ends[:, X], ends[:, Z], color=COLOURS[0], lw=2.0 if shown else 1.0)
        if round(1e3 * place) % 10 == 0:
            axes.text(*ends[0, [X, Z]], f"{1e3 * place:.0f}", color=COLOURS[0], ha="center", va="bottom", fontsize=9)
    start = 1e3 * line.points[0]
    axes.annotate(
        "0 mm: edge of the incisors", start, (-10, -4), textcoords="offset points", ha="right", color=COLOURS[0], fontsize=9
    )

    nearest = nearest_of(result, step)
    assert nearest is not None and measures.constriction is not None
    ends = 1e3 * np.stack([nearest.on_tongue, nearest.on_palate])
    axes.plot(*ends.T, "-o", color=CONSTRICTION, lw=2.5, ms=5, zorder=8)
    answer = measures.constriction
    axes.annotate(
        f"constriction: {answer.width_mm:.1f} mm wide,\n{answer.place_mm:.0f} mm behind the\nedge of the incisors",
        ends[1],
        (25.0, 118.0),
        ha="left",
        va="center",
        color=CONSTRICTION,
        fontsize=9.5,
        arrowprops={"arrowstyle": "-", "color": CONSTRICTION, "lw": 0.8},
    )

    loop = max(cut.loops, key=len)
    for points, colour in ((mesh.points, GREY), (mesh.points + u, NOW)):
        axes.plot(*(1e3 * summit(cut.at(points)[loop][:, [X, Z]])), "^", color=colour, ms=10, mec="white", zorder=9)
    top = 1e3 * summit(cut.at(mesh.points + u)[loop][:, [X, Z]])
    highest = measures.highest
    assert highest is not None
    axes.annotate(
        f"highest point: {highest.forward_mm:.1f} forward,\n{highest.up_mm:.1f} up since rest",
        top,
        (-6, -62),
        textcoords="offset points",
        ha="center",
        color=NOW,
        fontsize=9.5,
        arrowprops={"arrowstyle": "-", "color": NOW, "lw": 0.8},
    )

    at = 1e3 * mesh.named_points["blade"].position[0]
    moved = measures.points["blade"]
    corner, end = (at[X] - moved.forward_mm, at[Z]), (at[X] - moved.forward_mm, at[Z] + moved.up_mm)
    axes.annotate(
        "", corner, (at[X], at[Z]), arrowprops={"arrowstyle": "-|>", "lw": 1.6, "color": "black", "shrinkA": 0, "shrinkB": 0}
    )
    axes.annotate("", end, corner, arrowprops={"arrowstyle": "-|>", "lw": 1.6, "color": "black", "shrinkA": 0, "shrinkB": 0})
    axes.plot(at[X], at[Z], "o", mfc="white", mec="black", ms=6, zorder=9)
    axes.plot(*end, "o", color="black", ms=6, zorder=9)
    axes.annotate(
        f"blade: {moved.forward_mm:.1f} forward,\n{moved.up_mm:.1f} up",
        (at[X], at[Z] - 1.2),
        (-6, -30),
        ha="left",
        textcoords="offset points",
        fontsize=9.5,
        va="top",
    )

    for name in measures.grooves:
        x = 1e3 * station(mesh, name)
        axes.axvline(x, ymin=0.02, ymax=0.09, color=COLOURS[2], lw=2.0)
        axes.text(x + 0.8, 49.5, f"groove at\n“{name}”", color=COLOURS[2], fontsize=9, va="center")
    keep_to_tongue(axes, np.concatenate([rest_line, now_line])[:, [X, Z]])
    axes.set_xlim(24.0, 144.0)
    axes.set_ylim(46.0, 132.0)
    axes.set_xlabel("forward  ←   mm   →  back")
    axes.set_ylabel("up (mm)")
    axes.legend(loc="lower left", frameon=False, fontsize=9.5, bbox_to_anchor=(0.0, 0.3))
    axes.set_title("a  midsagittal plane: points, highest point, constriction, places along the palate", loc="left", fontsize=11)


def draw_area(axes: Any, result: Result, step: int) -> None:
    """A section across the palate: all its air, and the channel over the midline."""
    mesh = result.mesh
    palate = result.placed_bones(step)[PALATE]
    corners = palate.points[palate.triangles]
    plane = middle(mesh)
    line = palate_midline(corners, plane)
    tongue, _ = surface_triangles(mesh, mesh.points + result.displacement(step))
    assert line is not None
    cut = columns(section_plane(line, 1e-3 * SECTION_SHOWN_MM), corners, tongue, plane)
    free = channel(cut)
    y, above, below = 1e3 * cut.y, -1e3 * cut.palate, -1e3 * cut.tongue
    plain(axes)
    axes.set_aspect("equal")
    open_ = cut.inside & (cut.tongue > cut.palate)
    axes.fill_between(y, above, np.nanmax(above) + 3.0, where=np.isfinite(above), color=BONE, lw=0)
    axes.fill_between(y, above, below, where=open_, color=AIR, lw=0, label="area")
    axes.fill_between(y, above, below, where=free, color=CHANNEL, lw=0, label="of it the channel")
    axes.plot(y, above, color=BONE_EDGE, lw=1.5)
    shown = np.isfinite(below) & (below > np.nanmin(above) - 9.0)
    axes.plot(y[shown], below[shown], color=NOW, lw=2.2)
    left, right = y[cut.inside].min(), y[cut.inside].max()
    for side in (left, right):
        axes.axvline(side, color=COLOURS[0], lw=1.0, ls="--")
    axes.text(
        right + 0.5,
        np.nanmin(above) - 8.0,
        "end of the tongue’s\nside, or crest\nof the arch",
        color=COLOURS[0],
        fontsize=8.5,
        ha="left",
    )
    axes.annotate(
        "",
        (0.0, float(np.interp(0.0, y, above))),
        (0.0, float(np.interp(0.0, y, below))),
        arrowprops={"arrowstyle": "<->", "lw": 1.0, "shrinkA": 0, "shrinkB": 0},
    )
    axes.text(0.6, 0.5 * float(np.interp(0.0, y, above) + np.interp(0.0, y, below)), "height", fontsize=9, va="center")
    axes.set_xlim(-27.0, 33.0)
    axes.set_ylim(np.nanmin(above) - 10.0, np.nanmax(above) + 3.0)
    axes.set_xlabel("left  ←   mm   →  right")
    axes.set_ylabel("above the midline (mm)")
    axes.legend(loc="lower center", frameon=False, fontsize=9.5)
    axes.set_title(f"b  section across the palate, {SECTION_SHOWN_MM:.0f} mm behind the incisors", loc="left", fontsize=11)


def draw_groove(axes: Any, result: Result, step: int, measures: Measures) -> None:
    """The deepest of the grooves: its section at rest and now."""
    mesh = result.mesh
    name = max(measures.grooves, key=lambda each: measures.grooves[each].depth_mm)
    cut = section(mesh, X, station(mesh, name))
    loop = max(cut.loops, key=len)
    at_rest, now = 1e3 * cut.at(mesh.points)[loop], 1e3 * cut.at(mesh.points + result.displacement(step))[loop]
    plain(axes)
    axes.set_aspect("equal", adjustable="datalim")
    for outline, colour, label in ((at_rest, GREY, "at rest"), (now, NOW, f"at {measures.time_ms:.0f} ms")):
        closed = np.concatenate([outline, outline[:1]])
        axes.plot(closed[:, Y], closed[:, Z], color=colour, lw=2.0, label=label)
    top = now[midline(at_rest)[-1]]
    upper = at_rest[:, Z] > 0.5 * (at_rest[:, Z].min() + at_rest[:, Z].max())
    crests = [max(now[upper & side], key=lambda point: point[Z]) for side in (at_rest[:, Y] < 0.0, at_rest[:, Y] > 0.0)]
    for crest in crests:
        axes.plot(crest[Y], crest[Z], "v", color=COLOURS[2], ms=8, mec="white", zorder=5)
    level = min(crest[Z] for crest in crests)
    axes.plot([crests[0][Y], crests[1][Y]], [level, level], color=COLOURS[2], lw=1.0, ls="--")
    axes.annotate(
        "",
        (top[Y], level),
        (top[Y], top[Z]),
        arrowprops={"arrowstyle": "<->", "lw": 1.2, "color": COLOURS[2], "shrinkA": 0, "shrinkB": 0},
    )
    axes.text(
        top[Y],
        top[Z] - 0.5,
        f"groove {measures.grooves[name].depth_mm:.1f} mm",
        color=COLOURS[2],
        fontsize=9.5,
        ha="center",
        va="top",
    )
    axes.set_xlabel("left  ←   mm   →  right")
    axes.set_ylabel("up (mm)")
    axes.set_adjustable("box")
    axes.set_xlim(-34.0, 34.0)
    axes.set_ylim(at_rest[:, Z].max() - 22.0, max(at_rest[:, Z].max(), now[:, Z].max()) + 2.0)
    axes.legend(loc="lower center", frameon=False, fontsize=9.5)
    axes.set_title(f"c  coronal section at “{name}”, which follows the tissue", loc="left", fontsize=11)


def draw_cells(axes: Any, result: Result, step: int, measures: Measures) -> None:
    """Contact with the palate, seen from below: touched nodes by pressure, and the nine cells."""
    rotation, shift = result.placement(PALATE, step)
    position = 1e3 * ((result.mesh.points + result.displacement(step) - shift) @ rotation)
    corners = 1e3 * result.bones[PALATE].points
    low, high = corners.min(axis=0), corners.max(axis=0)
    pressure = 1e-3 * result.field(f"contact_pressure_{PALATE}", step)
    touched = pressure > 0.0
    plain(axes)
    axes.set_aspect("equal")
    axes.add_patch(_rectangle(low, high))
    for number in (1, 2):
        third = low + number / 3.0 * (high - low)
        axes.plot([third[X]] * 2, [low[Y], high[Y]], color=BONE_EDGE, lw=1.0)
        axes.plot([low[X], high[X]], [third[Y]] * 2, color=BONE_EDGE, lw=1.0)
    free = (surface_areas(result.mesh) > 0.0) & ~touched & (position[:, Z] > 85.0)
    axes.plot(position[free, X], position[free, Y], ".", color="0.75", ms=2)
    dots = axes.scatter(
        position[touched, X],
        position[touched, Y],
        c=pressure[touched],
        s=26,
        cmap="viridis_r",
        zorder=4,
        edgecolors="white",
        lw=0.4,
    )
    contact = measures.contact[PALATE]
    for across, side in enumerate(SIDES):
        for along, depth in enumerate(DEPTHS):
            cell = contact.cells[side][depth]
            x = low[X] + (along + 0.5) / 3.0 * (high - low)[X]
            y = low[Y] + (across + (0.13, 0.5, 0.87)[across]) / 3.0 * (high - low)[Y]
            text = f"{side}, {depth}\n{cell.area_mm2:.0f} mm², {cell.mean_kPa:.2f} kPa"
            axes.text(x, y, text, ha="center", va="center", fontsize=7.5, zorder=5)
    axes.set_xlabel("front  ←   mm   →  back")
    axes.set_ylabel("left  ←   mm   →  right")
    axes.figure.colorbar(dots, ax=axes, shrink=0.8, pad=0.02).set_label("pressure (kPa)")
    axes.set_title("d  contact with the palate: cells are thirds of the bone", loc="left", fontsize=11)


def draw_time(axes: Any, result: Result, measures: Measures) -> None:
    """The course of a point: the time to 90 %, and the peak speed."""
    times = 1e3 * result.history("time")
    path = 1e3 * result.history(f"probe_{POINT_SHOWN}_displacement")
    speed = 1e3 * np.linalg.norm(result.history(f"probe_{POINT_SHOWN}_velocity"), axis=1)
    along = path @ path[-1] / np.linalg.norm(path[-1])
    point = measures.points[POINT_SHOWN]
    assert point.time_to_90_ms is not None
    plain(axes)
    axes.plot(times, along, color=NOW, lw=2.0)
    reached = RISE_SHARE * along[-1]
    axes.plot([times[0], point.time_to_90_ms, point.time_to_90_ms], [reached, reached, 0.0], color=NOW, lw=1.0, ls="--")
    axes.text(point.time_to_90_ms + 2.0, 0.5 * reached, f"90 % at {point.time_to_90_ms:.0f} ms", color=NOW, fontsize=9.5)
    axes.set_xlabel("time (ms)")
    axes.set_ylabel("displacement (mm)", color=NOW)
    axes.set_ylim(0.0, 1.25 * along.max())
    other = axes.twinx()
    other.spines[["top"]].set_visible(False)
    other.plot(times, speed, color=COLOURS[1], lw=1.5)
    peak = int(np.argmax(speed))
    other.plot(times[peak], speed[peak], "o", color=COLOURS[1], ms=6)
    other.annotate(
        f"peak {point.peak_speed_mm_s:.0f} mm/s",
        (times[peak], speed[peak]),
        (8, 4),
        textcoords="offset points",
        color=COLOURS[1],
        fontsize=9.5,
    )
    other.set_ylabel("speed (mm/s)", color=COLOURS[1])
    other.set_ylim(0.0, 1.25 * speed.max())
    axes.set_title(f"e  course of “{POINT_SHOWN}”", loc="left", fontsize=11)


def _rectangle(low: np.ndarray, high: np.ndarray) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((low[X], low[Y]), high[X] - low[X], high[Y] - low[Y], fc=BONE, ec=BONE_EDGE, lw=1.2, zorder=0)


if __name__ == "__main__":
    main()
