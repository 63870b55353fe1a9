"""How far a point is from a bone: signed distances on a grid, interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DistanceField:
    """Signed distance of a rigid surface at the nodes of a grid, positive outside of the bone.

    Attributes
    ----------
    origin_m : (3,) m. The first node of the grid.
    spacing_m : m. Edge of its cells.
    values : (nx, ny, nz) m.
    """

    origin_m: np.ndarray
    spacing_m: float
    values: np.ndarray
