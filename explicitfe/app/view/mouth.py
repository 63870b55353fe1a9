"""What surrounds a tongue of a built-in model, for display: crowns of teeth, and a palate as thin as a palate is.

Nothing touches what is only drawn. The crowns are data of the model, ``models/tongue/teeth.npz``, computed from its bones by
``studies/benchmarks/teeth.py``; the palate in contact is a thick plate, of which the underside is seen. See
``models/tongue/SOURCES.md``.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy

from explicitfe.platform.host.shipped import folder_of
from explicitfe.results.files import Result, StoredBone
from explicitfe.results.measure.sections import Y, Z

TEETH_FILE = "teeth.npz"
ARCHES = ("palate", "jaw")
# Thickness of the drawn palate. Above the teeth it reaches so far above their edge in front, up to where the velum begins.
PALATE_MM, ALVEOLAR_MM = 7.0, 17.0
VELUM_BEHIND_FRONT_MM, VELUM_BEGINS_OVER_MM = 46.0, 14.0


class Teeth(NamedTuple):
    """The crowns of an arch as a surface: ``points`` (k, 3) m, at rest, ``triangles`` (m, 3)."""

    points: np.ndarray
    triangles: np.ndarray


def is_mouth(result: Result) -> bool:
    """Whether a result is one of a built-in tongue, whose surroundings are known."""
    return result.model.get("airway") is not None


def teeth_of(result: Result) -> dict[str, Teeth]:
    """Crowns by the name of the bone that they move with; none on bones of one's own, whose teeth are part of them."""
    return {name: _arch(bone, name) for name, bone in result.bones.items() if name in ARCHES and _is_built_in(result, name)}


def drawn_bones(result: Result) -> dict[str, StoredBone]:
    """The bones at rest as they are drawn: a built-in palate is thinner than the stored one."""
    thin = {name: thin_palate(result.bones[name]) for name in ("palate",) if name in result.bones and _is_built_in(result, name)}
    return {**result.bones, **thin}


def thin_palate(bone: StoredBone) -> StoredBone:
    """A palate with the same underside as a plate, and an upper side that follows it, see ``PALATE_MM``."""
    x, y, z = 1e3 * bone.points.T
    # The points of the upper side stand vertically above those of the underside.
    place, number = np.unique(np.round(np.column_stack([x, y]), 6), axis=0, return_inverse=True)
    number = number.ravel()
    low = np.full(len(place), np.inf)
    np.minimum.at(low, number, z)
    paired = np.bincount(number) > 1
    underside = low[paired][scipy.spatial.cKDTree(place[paired]).query(np.column_stack([x, y]))[1]]
    front = x.min()
    before_velum = np.clip((front + VELUM_BEHIND_FRONT_MM + VELUM_BEGINS_OVER_MM - x) / VELUM_BEGINS_OVER_MM, 0.0, 1.0)
    alveolar = z[x < front + 1.0].min() + ALVEOLAR_MM
    thickness = np.maximum(PALATE_MM, before_velum * (alveolar - underside))
    return bone._replace(points=1e-3 * np.column_stack([x, y, np.minimum(z, underside + thickness)]))


def _is_built_in(result: Result, name: str) -> bool:
    tables = result.model.get("scenario", {}).get("bone", ())
    return is_mouth(result) and not any(table.get("file") for table in tables if table.get("name") == name)


@cache
def teeth_data() -> dict[str, np.ndarray]:
    """Of each bone the rings (t, r, p, 3) mm of the crowns of its right half, as ``<bone>_mm``, their sizes and its anchor."""
    with np.load(folder_of("models") / "tongue" / TEETH_FILE, allow_pickle=False) as stored:
        return dict(stored)


def anchor_of(points: np.ndarray) -> np.ndarray:
    """The foremost x, the middle y and the highest z, (3,) m, of a bone: a scenario may have shifted it."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([low[0], 0.5 * (low[Y] + high[Y]), high[Z]])


def _arch(bone: StoredBone, name: str) -> Teeth:
    """The crowns of one arch: those of the right half, and their mirror images."""
    stored = teeth_data()
    rings = stored[f"{name}_mm"]
    number = np.arange(rings[..., 0].size).reshape(rings.shape[:-1])
    a, b = number[:, :-1], number[:, 1:]
    # The ends of a crown are too small to be seen open, or inside the bone.
    quads = np.stack([a, b, np.roll(b, -1, axis=-1), np.roll(a, -1, axis=-1)], axis=-1).reshape(-1, 4)
    faces = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    # The rings of an upper crown run the other way round than those of a lower one; a mirror image turns faces inside out.
    faces = faces if name == "jaw" else faces[:, ::-1]
    right = rings.reshape(-1, 3)
    points = 1e-3 * np.concatenate([right, right * [1.0, -1.0, 1.0]]) + (anchor_of(bone.points) - stored[f"{name}_anchor"])
    return Teeth(points, np.concatenate([faces, faces[:, ::-1] + len(right)]))
