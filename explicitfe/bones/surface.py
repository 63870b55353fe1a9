"""A closed surface of triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TriangleSurface:
    """The surface of a bone.

    Attributes
    ----------
    points : (n, 3) m.
    triangles : (m, 3) int64. Corners, counter-clockwise seen from outside the bone.
    """

    points: np.ndarray
    triangles: np.ndarray
