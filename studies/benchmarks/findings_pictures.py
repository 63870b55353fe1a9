"""The pictures of docs/studies/findings.md, from runs that studies/benchmarks/findings.py has kept."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from tongue_cases import Answer, Case, Laboratory

from explicitfe.app.view.palette import AFTER, BEFORE, BONE, BONE_EDGE, GREY, GRID, new_figure, plain, save
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.results.measure.sections import X, Y, Z, cut_surface, midsagittal
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.bones import jaw_motion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# What of the head a midsagittal panel shows, mm: x, z.
SHOWN_MM = ((44.0, 137.0), (28.0, 133.0))
# The area of a dot that stands for 1 kPa on a node, square points.
DOT_PER_KPA = 60.0
# What of the palate a map shows, mm: x, y.
MAP_MM = ((48.0, 118.0), (-27.0, 27.0))
MAP_WIDTH_IN, SIDE_VIEW_IN, BARS_IN = 10.0, (10.0, 7.6), (10.0, 4.2)


class Panel(NamedTuple):
    """A panel with its title and what it shows."""

    title: str
    case: Case


def draw_shapes(laboratory: Laboratory, rows: list[list[Panel]], path: Path) -> None:
    """Midsagittal outlines at rest and at the end, with the bones that there are: a row a tissue."""
    figure = new_figure(*SIDE_VIEW_IN)
    panels = figure.subplots(len(rows), len(rows[0]), sharex=True, sharey=True)
    for axes_of_row, row in zip(panels, rows, strict=True):
        for axes, panel in zip(axes_of_row, row, strict=True):
            _side_view(axes, laboratory.answer(panel.case))
            axes.set_title(panel.title, fontsize=10)
    for axes in panels[-1]:
        axes.set_xlabel("front  ←   x (mm)   →  back")
    for axes in panels[:, 0]:
        axes.set_ylabel("z, up (mm)")
    save(figure, path)


def draw_palate(laboratory: Laboratory, panels: list[Panel], path: Path) -> None:
    """Where the tongue touches the palate, from below: a dot for each node, as large as its pressure."""
    figure = new_figure(MAP_WIDTH_IN, 0.95 * MAP_WIDTH_IN / len(panels))
    for axes, panel in zip(figure.subplots(1, len(panels), sharey=True), panels, strict=True):
        answer = laboratory.answer(panel.case)
        arrays, mesh = answer.arrays, mesh_of(answer.case)
        now = 1e3 * (mesh.points + arrays["displacement"])
        kPa = 1e-3 * np.maximum(arrays["pressure_palate"], 0.0)
        touched = kPa > 0.0
        plain(axes)
        axes.set_aspect("equal")
        axes.axhline(0.0, color=GREY, lw=1.0, ls="--")
        surface = catalogue.bones("tongue")["palate"].surface
        axes.plot(*_sheet_edge(1e3 * surface.points), color=BONE_EDGE, lw=1.2)
        axes.scatter(now[touched, X], now[touched, Y], s=DOT_PER_KPA * kPa[touched], color=BEFORE, alpha=0.7, lw=0.0)
        axes.set_xlim(*MAP_MM[0])
        axes.set_ylim(*MAP_MM[1])
        contact = answer.measures.contact["palate"]
        free = "free" if contact.midline_free else "closed"
        axes.set_title(f"{panel.title}\nmidline {free}; {contact.mean_kPa:.1f} kPa on {contact.area_mm2:.0f} mm²", fontsize=10)
        axes.set_xlabel("front  ←   x (mm)   →  back")
    figure.axes[0].set_ylabel("left  ←   y (mm)   →  right")
    save(figure, path)


def draw_steps(labels: list[str], residuals: dict[str, list[float]], path: Path) -> None:
    """How far [i] is from what is asked of it, after each step."""
    figure = new_figure(*BARS_IN)
    axes = figure.subplots()
    plain(axes)
    at = np.arange(len(labels), dtype=float)
    height = 0.8 / len(residuals)
    for number, (name, colour) in enumerate(zip(residuals, (BEFORE, AFTER), strict=True)):
        places = at + (number - 0.5) * height
        bars = axes.barh(places, residuals[name], height=height, color=colour, label=name)
        axes.bar_label(bars, fmt=lambda mm: "met" if mm < 0.05 else f"{mm:.1f}", padding=3, fontsize=9)
    axes.set_yticks(at, labels)
    axes.invert_yaxis()
    axes.grid(axis="y", lw=0.0)
    axes.grid(axis="x", color=GRID)
    axes.set_xlabel("[i]: distance of its worst figure from what is asked (mm)")
    axes.legend(frameon=False)
    save(figure, path)


def mesh_of(case: Case) -> HexMesh:
    """The built-in mesh of a case."""
    cells = case.mesh if isinstance(case.mesh, tuple) else None
    return catalogue.built_in("tongue", None if cells else str(case.mesh), cells).mesh


def _side_view(axes: Axes, answer: Answer) -> None:
    plain(axes)
    axes.set_aspect("equal")
    mesh, u = mesh_of(answer.case), answer.arrays["displacement"]
    for name, shape in catalogue.bones("tongue").items():
        points = shape.surface.points
        moves = jaw_motion(answer.case.scenario(Path())) if name == "jaw" else None
        if moves is not None:
            rotation, shift = moves.placement(np.array([1e-3 * answer.case.duration_ms]))
            points = points @ rotation[0].T + shift[0]
        outline = 1e3 * cut_surface(shape.surface.triangles, points[:, Y]).outline(points)
        there = name in answer.case.bones
        loops = np.split(outline, np.flatnonzero(np.isnan(outline[:, X])))
        for loop in (part[~np.isnan(part[:, X])] for part in loops):
            if there:
                axes.fill(loop[:, X], loop[:, Z], fc=BONE, ec=BONE_EDGE, lw=1.0, zorder=0.5)
            else:
                axes.plot(loop[:, X], loop[:, Z], ":", color=BONE_EDGE, lw=1.0, zorder=0.5)
    cut = midsagittal(mesh)
    for moved, colour, width in ((0.0, GREY, 1.2), (1.0, BEFORE, 2.0)):
        line = 1e3 * cut.outline(mesh.points + moved * u)
        axes.plot(line[:, X], line[:, Z], color=colour, lw=width)
    axes.set_xlim(*SHOWN_MM[0])
    axes.set_ylim(*SHOWN_MM[1])


def _sheet_edge(points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The outline of the palate seen from below: how far it reaches to both sides at each x."""
    x = np.unique(np.round(points_mm[:, X], 1))
    half = np.array([np.abs(points_mm[np.abs(points_mm[:, X] - at) < 0.06, Y]).max() for at in x])
    return np.concatenate([x, x[::-1], x[:1]]), np.concatenate([half, -half[::-1], half[:1]])
