"""Bones in pictures of sections: their cut faces, now and at rest, and the constriction between tongue and palate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from explicitfe.app.view.mouth import drawn_bones
from explicitfe.app.view.palette import BONE, BONE_EDGE, CONSTRICTION
from explicitfe.results.files import Result, StoredBone
from explicitfe.results.measure.leak import leak_history
from explicitfe.results.measure.measure import nearest_of
from explicitfe.results.measure.sections import Z, cut_surface
from explicitfe.results.measure.tract import TOUCHING_GAP_M

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Margin around the tongue; bones extend beyond the picture.
AROUND_TONGUE_MM = 9.0
# A bone has moved when a point of it is further than this from where it was at rest.
SMALLEST_BONE_MOTION_M = 1e-5


def fill_bones(
    axes: Axes, result: Result, step: int, point_m: np.ndarray, normal: np.ndarray, across: int, label: str | None = "bone"
) -> None:
    """Fill the cut faces of the bones at a step; of a bone that has moved, draw the outline at rest dashed.

    Parameters
    ----------
    point_m, normal : (3,) a point of the plane, and its normal.
    across : the axis drawn to the right.
    label : in the legend; None for none.
    """
    drawn: set[str] = set()

    def once(text: str | None) -> str | None:
        new = None if text is None or text in drawn else text
        drawn.update(filter(None, [text]))
        return new

    for name, at_rest in drawn_bones(result).items():
        rotation, shift = result.placement(name, step)
        bone = at_rest._replace(points=at_rest.points @ rotation.T + shift)
        for loop in bone_loops(bone, point_m, normal):
            axes.fill(loop[:, across], loop[:, Z], fc=BONE, ec=BONE_EDGE, lw=1.0, zorder=0.5, label=once(label))
        if np.abs(bone.points - at_rest.points).max(initial=0.0) > SMALLEST_BONE_MOTION_M:
            for loop in bone_loops(at_rest, point_m, normal):
                closed, text = np.concatenate([loop, loop[:1]]), once(label and "bone at rest")
                axes.plot(closed[:, across], closed[:, Z], "--", color=BONE_EDGE, lw=0.9, zorder=0.6, label=text)


def mark_constriction(axes: Axes, result: Result, step: int) -> None:
    """Mark the smallest distance between tongue and palate in a side view; nothing without a palate.

    It is called closed only if no way around it is open either.
    """
    from matplotlib.patheffects import withStroke

    nearest = nearest_of(result, step)
    if nearest is None:
        return
    leak = leak_history(result, step)
    ends = 1e3 * np.stack([nearest.on_tongue, nearest.on_palate])
    axes.plot(*ends.T, "-o", color=CONSTRICTION, lw=2.0, ms=4.0, zorder=8, label="constriction")
    axes.annotate(
        "closed" if leak is not None and leak.widest(step).width_m <= TOUCHING_GAP_M else f"{1e3 * nearest.width:.1f} mm",
        ends[1],
        (0.0, 10.0),
        textcoords="offset points",
        ha="center",
        va="bottom",
        color=CONSTRICTION,
        zorder=9,
        path_effects=[withStroke(linewidth=3, foreground="white")],
    )


def keep_to_tongue(axes: Axes, shown_mm: np.ndarray) -> None:
    """Limit a panel to the outline of the tongue, points (k, 2) of its two axes in mm, with a margin."""
    low, high = np.nanmin(shown_mm, axis=0) - AROUND_TONGUE_MM, np.nanmax(shown_mm, axis=0) + AROUND_TONGUE_MM
    axes.set_adjustable("box")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def bone_loops(bone: StoredBone, point_m: np.ndarray, normal: np.ndarray) -> list[np.ndarray]:
    """Outlines (k, 3) mm of the cut of a bone by a plane."""
    cut = cut_surface(bone.triangles, (bone.points - point_m) @ normal)
    at = 1e3 * cut.at(bone.points)
    return [at[loop] for loop in cut.loops]
