"""Where the sides of a tongue touch the palate, as Liu et al. (2022), Phonetica 79:523, count it: a measure for sweeps.

    explicitfe.sweep("studies/benchmarks/postures.toml", ..., measures=["points", "contact", bracing])

Their places on the palate (ArtiSynth, artisynth_models, jawTongue/frameMarkers) are in the coordinates of the built-in tongue:
eleven on either side, beside the molars, and twenty around the midline behind the incisors ("coronal"). One is touched where the
tongue's surface is 0.5 mm away or less (DistanceMonitor.java), and a tongue is braced where one is touched on both sides
(bracing_simulations, src/analyze_simulation_results.R). Here the places are first brought to the nearest point of the palate that
the run has, so that the two surfaces, which are some 1.4 mm apart, do not decide.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from explicitfe.fem.mesh.triangles import surface_triangles, triangle_distance
from explicitfe.results.files import Recorded
from explicitfe.results.measure.electrodes import Underside

TOUCHING_MM = 0.5
AROUND_PLACES_M = 10e-3
TRIANGLES_TRIED = 24
SAME_DISTANCE_M = 1e-9
PLACES_MM = {
    "left": [
        (79.971, -19.706, 106.33), (84.914, -20.507, 106.2), (89.441, -21.197, 106.23), (93.601, -22.325, 106.0),
        (81.444, -17.706, 111.36), (85.136, -18.252, 111.38), (89.895, -18.834, 111.26), (94.784, -20.122, 111.15),
        (81.938, -14.526, 116.55), (86.147, -15.135, 116.59), (89.746, -15.678, 116.53),
    ],
    "right": [
        (81.898, 14.346, 117.0), (86.048, 15.026, 116.97), (89.871, 15.634, 116.87), (81.055, 17.912, 111.19),
        (85.558, 18.794, 110.82), (89.528, 19.13, 110.98), (94.397, 20.068, 111.26), (80.113, 19.949, 106.1),
        (84.486, 20.607, 106.1), (89.229, 21.454, 105.72), (94.18, 22.671, 105.99),
    ],
    "middle": [
        (54.764, -3.7896, 105.24), (54.619, 0.0, 105.27), (54.827, 3.6278, 105.36), (57.944, -3.7475, 109.21),
        (57.262, 0.0, 108.77), (57.962, 3.66, 109.33), (61.385, -4.0671, 112.23), (61.062, 0.0, 112.13),
        (61.944, 3.8097, 112.62), (65.863, -3.0222, 114.56), (65.138, 0.0, 114.21), (65.757, 3.0418, 114.5),
        (69.123, 0.0, 116.23), (66.9, 6.5166, 114.72), (69.974, 3.1539, 116.62), (71.81, 6.3872, 117.45),
        (72.921, 0.0, 118.12), (69.87, -3.609, 116.57), (71.733, -6.8327, 117.34), (67.552, -6.3118, 115.08),
    ],
}  # fmt: skip


def bracing(result: Recorded, step: int) -> dict[str, dict[str, float | int]]:
    """Of each group of places how many are touched at a step, and how near the tongue is to the nearest, mm."""
    bone = result.bones["palate"]
    rotation, shift = result.placement("palate", step)
    triangles, _ = surface_triangles(result.mesh, (result.mesh.points + result.displacement(step) - shift) @ rotation)
    near = scipy.spatial.cKDTree(triangles.mean(axis=1))
    groups = {}
    for name in PLACES_MM:
        places = places_on(bone.points.tobytes(), bone.triangles.tobytes(), name)
        tried = near.query(places, k=TRIANGLES_TRIED)[1]
        distance_mm = 1e3 * _distance(places, triangles[tried])
        groups[name] = {"touched": int((distance_mm <= TOUCHING_MM).sum()), "nearest_mm": float(distance_mm.min())}
    return groups


@lru_cache(maxsize=16)
def places_on(points: bytes, triangles: bytes, group: str) -> np.ndarray:
    """The places of a group (k, 3) m, on a palate that is given as the bytes of its points and triangles."""
    corners = np.frombuffer(points).reshape(-1, 3)[np.frombuffer(triangles, dtype=np.int64).reshape(-1, 3)]
    places = 1e-3 * np.array(PLACES_MM[group])
    box = np.stack([places.min(axis=0) - AROUND_PLACES_M, places.max(axis=0) + AROUND_PLACES_M])
    under = Underside(corners, box)
    return places - under.clearance(places)[:, None] * under.normals(places)


def _distance(places: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distances (k,) m of places (k, 3) from the surface, of each the nearest of triangles (k, t, 3, 3); 0 inside of it."""
    count, tried = triangles.shape[:2]
    flat = triangles.reshape(-1, 3, 3)
    repeated = np.repeat(places, tried, axis=0)
    distance = triangle_distance(repeated, flat).reshape(count, tried)
    outward = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    outside = (np.einsum("ij,ij->i", repeated - flat[:, 0], outward) > 0.0).reshape(count, tried)
    # Over an edge two triangles are as near, and one of them may face away.
    nearest = distance.min(axis=1)
    as_near = distance <= nearest[:, None] + SAME_DISTANCE_M
    return np.where((outside & as_near).any(axis=1), nearest, 0.0)
