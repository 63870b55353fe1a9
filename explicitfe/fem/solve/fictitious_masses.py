"""Masses that let a relaxation take steps of 1, near the stable limit everywhere (Underwood 1983; Joldes et al. 2011)."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.solve.body import Body
from explicitfe.fem.solve.contact_points import ToolContact
from explicitfe.fem.solve.sector import SectorTie
from explicitfe.fem.solve.stable_step import stiffness_rows
from explicitfe.platform.compiled.arrays import FRICTION, Nodes, Springs, nodes_of, zeros

STIFFENING_RESERVE = 1.1  # factor of the masses: the tissue may stiffen by so much on the way to the next load


def fictitious_masses(body: Body, tie: SectorTie, free: np.ndarray, contact: ToolContact, springs: Springs) -> Nodes | None:
    """Masses for the present state of a body, a quarter of the sums of the stiffness rows; None where an element is inside out.

    Parameters
    ----------
    body : whose elements are looked at, at their present displacement.
    tie : of the sector's far side to its near one, where the masses are put.
    free : (n, 3) components that are neither held nor on the far side.
    contact, springs : what else is stiff.
    """
    rotation = np.where(tie.on_far_side[body.hexes][..., None, None], tie.rotation, np.eye(3))
    own = tie.partner[body.hexes]
    slot = (own[:, :, None] == own[:, None, :]).argmax(axis=2)
    rows = stiffness_rows(
        body.kernels.forces,
        body.blocks,
        body.state.u[body.hexes, :3],
        np.cbrt(body.volumes),
        free[own],
        slot,
        rotation,
    )
    if not np.isfinite(rows).all():
        return None
    count = len(body.points)
    mass = zeros(body.state.u.shape)
    for k in range(3):
        mass[:count, k] = 0.25 * STIFFENING_RESERVE * np.bincount(own.ravel(), rows[..., k].ravel(), count)
    points = contact.points
    # a point that slides is pushed along the surface by its friction times what pushes it across
    across = points.spring * (1.0 + points.shape[FRICTION])
    stiffness = 0.25 * STIFFENING_RESERVE * (across + points.grip)[:, None] * points.weight
    mass[:count, :3] += np.bincount(points.node.ravel(), stiffness.ravel(), count)[:, None]
    np.add.at(mass[:, :3], springs.node, 0.25 * STIFFENING_RESERVE * springs.stiffness)
    mass[:count, :3] *= free
    return nodes_of(mass, np.divide(1.0, mass, out=zeros(mass.shape), where=mass > 0.0))
