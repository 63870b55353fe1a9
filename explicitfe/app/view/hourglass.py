"""Hourglass energy of a run: its share over time, and its distribution in the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from explicitfe.fem.mesh.hexmesh import FACES, free_faces
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.validity import certify
from explicitfe.results.files import Result

# Where the elastic energy is below this share of its largest value, a share of it means nothing; the summary of a run leaves
# the same times out.
LEAST_SHARE_OF_LARGEST_ELASTIC = 0.01
# Below this share of the work and of the kinetic energy the elastic energy is made of rounding errors.
ROUNDING_SHARE_OF_OTHER_ENERGIES = 1e-12
# As many elements have a number in the hourglass map: more numbers would lie on each other.
NUMBERED_ELEMENTS = 5
# Of views that show nearly as much as the best, the first in ``OUTSIDE_VIEWS`` is taken, so that similar runs are seen alike.
NEARLY_AS_MUCH_SHARE = 0.95
# The directions that the hourglass map can be seen from, besides the cut.
OUTSIDE_VIEWS = {
    f"from {along}, {side} and {up}": (x, y, z)
    for side, y in (("left", -0.75), ("right", 0.75))
    for along, x in (("behind", 1.0), ("the front", -1.0))
    for up, z in (("above", 0.45), ("below", -0.45))
}


@dataclass(frozen=True)
class HourglassMap:
    """Distribution of the hourglass energy at one sample.

    Attributes
    ----------
    percent : (m,) Hourglass energy per reference volume of every element, as a share of the body's mean elastic energy
        (strain + hourglass) per reference volume, %. Its mean, weighted by volume, is the body's hourglass share.
    worst : up to ``NUMBERED_ELEMENTS`` elements with the largest ``percent``, largest first.
    folded : (m,) bool. Elements that are flat or inverted anywhere in the deformed shape.
    share : hourglass energy of the body as a share of its elastic energy, %.
    """

    percent: np.ndarray
    worst: np.ndarray
    folded: np.ndarray
    share: float


def hourglass_map(result: Result, step: int) -> HourglassMap | None:
    """The numbers of the hourglass map; None if the result has no such field, or the field is zero at that sample."""
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
    folded = certify(mesh.points + result.displacement(step), mesh.hexes).folded
    worst = np.argsort(-percent, kind="stable")[:NUMBERED_ELEMENTS]
    return HourglassMap(percent, worst, folded, 100.0 * float(energy.sum()) / elastic)


def outside_view(points: np.ndarray, hexes: np.ndarray, values: np.ndarray) -> str:
    """The view in ``OUTSIDE_VIEWS`` that shows the most: area as seen times the value of the element, summed over the surface.

    A face that is hidden by another one counts as if it were seen.
    """
    element, face = free_faces(hexes)
    a, b, c, d = points[hexes[element[:, None], FACES[face]]].transpose(1, 0, 2)
    areas = 0.5 * np.cross(c - a, d - b)
    seen = {name: values[element] @ np.maximum(0.0, areas @ direction) for name, direction in OUTSIDE_VIEWS.items()}
    return next(name for name, amount in seen.items() if amount >= NEARLY_AS_MUCH_SHARE * max(seen.values()))


def hourglass_share(result: Result) -> np.ndarray:
    """Share of hourglass energy in the elastic energy over the history; NaN where the elastic energy is negligible."""
    hourglass = result.history("hourglass_energy")
    elastic = result.history("internal_energy") + hourglass
    other = np.abs([result.history("external_work"), result.history("kinetic_energy")])
    least = max(
        LEAST_SHARE_OF_LARGEST_ELASTIC * np.nanmax(elastic, initial=0.0),
        ROUNDING_SHARE_OF_OTHER_ENERGIES * np.nanmax(other, initial=0.0),
    )
    return np.divide(hourglass, elastic, out=np.full(len(elastic), np.nan), where=elastic > least)
