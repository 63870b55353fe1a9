"""Outlines of sections as they are drawn."""

from __future__ import annotations

import numpy as np

from explicitfe.app.view.mouth import is_mouth
from explicitfe.results.files import Result
from explicitfe.results.measure.sections import PlaneCut

PIECES_BETWEEN_POINTS = 8


def outline_mm(result: Result, cut: PlaneCut, places_m: np.ndarray) -> np.ndarray:
    """The outline of a section, (k, 3) mm: closed lines, with a row of NaN after each.

    That of a built-in tongue is a smooth curve through the points of the cut; of other bodies, straight lines join these.

    Parameters
    ----------
    places_m : (n, 3) of the nodes.
    """
    outline = 1e3 * cut.outline(places_m)
    if not is_mouth(result) or not cut.loops:
        return outline
    gap = np.full((1, 3), np.nan)
    ends = np.flatnonzero(np.isnan(outline[:, 0]))
    loops = np.split(outline, ends)[:-1]
    closed = [smooth_loop(loop[np.isfinite(loop[:, 0])][:-1]) for loop in loops]
    return np.concatenate([part for loop in closed for part in (loop, loop[:1], gap)])


def smooth_loop(points: np.ndarray) -> np.ndarray:
    """A closed curve through points (k, d), (8 k, d), of Bézier curves.

    At a point it is parallel to the line between its neighbours; handles have a third of the length of their piece, so that
    there are no loops where long and short pieces meet.
    """
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    along = after - before
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
    handle = np.linalg.norm(after - points, axis=1, keepdims=True) / 3.0
    corners = (points, points + handle * along, after - handle * np.roll(along, -1, axis=0), after)
    t = np.arange(PIECES_BETWEEN_POINTS) / PIECES_BETWEEN_POINTS
    weights = ((1.0 - t) ** 3, 3.0 * t * (1.0 - t) ** 2, 3.0 * t**2 * (1.0 - t), t**3)
    curve = np.sum([weight[:, None] * corner[:, None] for weight, corner in zip(weights, corners, strict=True)], axis=0)
    return curve.reshape(-1, points.shape[1])
