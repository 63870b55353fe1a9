"""A sector of a body of revolution: the far side moves like the near side, rotated about the axis."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.model.model import RotationalSymmetry
from explicitfe.platform.compiled.arrays import Turned


class SectorTie:
    """Which nodes move with which; none where the body is whole.

    Parameters
    ----------
    symmetry : of the model, None where it is no sector.
    place : (n,) row of each node in computing order.

    Attributes
    ----------
    turned : what the kernels read of it.
    rotation : (3, 3) that leads from the near side to the far one.
    partner : (n,) row of the node that each moves with: its own, or that of its partner on the near side.
    on_far_side : (n,) whether a node moves as a partner does.
    """

    def __init__(self, symmetry: RotationalSymmetry | None, place: np.ndarray) -> None:
        nodes = partners = np.zeros(0, dtype=np.int64)
        angle = 0.0
        if symmetry is not None:
            nodes, partners, angle = place[symmetry.nodes], place[symmetry.partners], symmetry.angle_rad
        c, s = np.cos(angle), np.sin(angle)
        self.turned = Turned(nodes, partners, np.array([c, s]))
        self.rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self.partner = np.arange(len(place))
        self.partner[nodes] = partners
        self.on_far_side = np.zeros(len(place), dtype=bool)
        self.on_far_side[nodes] = True

    def spread_to_far_side(self, rows: np.ndarray) -> None:
        """Move the far side of displacement rows (N, 4) m as the near one, turned."""
        turned = self.turned
        rows[turned.node, :3] = rows[turned.partner, :3] @ self.rotation.T

    def gather_on_near_side(self, rows: np.ndarray) -> None:
        """Let forces (N, 4) N on the far side act on the near one, turned back."""
        turned = self.turned
        rows[turned.partner, :3] += rows[turned.node, :3] @ self.rotation  # no node has two partners
        rows[turned.node] = 0.0
