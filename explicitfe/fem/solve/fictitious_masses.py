"""Masses that let a relaxation take steps of 1, near the stable limit everywhere (Underwood 1983; Joldes et al. 2011)."""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.fem.solve.body import Body
from explicitfe.fem.solve.contact_points import ToolContact
from explicitfe.fem.solve.sector import SectorTie
from explicitfe.fem.solve.stable_step import stiffness_rows
from explicitfe.platform.compiled.arrays import FRICTION, Nodes, Springs, nodes_of, zeros

STIFFENING_RESERVE = 1.2  # factor of the masses: the tissue may stiffen by so much on the way to the next load
# Turns of the iteration that finds the highest frequency. On the specimens of the tests its square is then 2 % low at most.
LANCZOS_TURNS = 20
LANCZOS_DIFFERENCE_SHARE = 1e-7  # of the mean size of the elements, over which forces are differenced there


def fictitious_masses(body: Body, tie: SectorTie, free: np.ndarray, contact: ToolContact, springs: Springs) -> Nodes | None:
    """Masses for the present state of a body; None where an element is inside out.

    A quarter of the sums of the stiffness rows bounds the highest frequency by 2 (Gershgorin 1931). Neighbours do not all push
    at once, so the true one is lower; it is found, and the masses of the elements are as light as it allows. The bound stays for
    the springs: with K = K_e + K_s, K_e <= 4 M_e and K_s <= 4 M_s, no frequency is above 2.

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
        mass[:count, k] = 0.25 * np.bincount(own.ravel(), rows[..., k].ravel(), count)
    mass[:count, :3] *= free
    mass *= 0.25 * _highest_square(body, tie, mass) * STIFFENING_RESERVE
    points = contact.points
    # a point that slides is pushed along the surface by its friction times what pushes it across
    across = points.spring * (1.0 + points.shape[FRICTION])
    stiffness = 0.25 * STIFFENING_RESERVE * (across + points.grip)[:, None] * points.weight
    mass[:count, :3] += np.bincount(points.node.ravel(), stiffness.ravel(), count)[:, None]
    np.add.at(mass[:, :3], springs.node, 0.25 * STIFFENING_RESERVE * springs.stiffness)
    mass[:count, :3] *= free
    return nodes_of(mass, np.divide(1.0, mass, out=zeros(mass.shape), where=mass > 0.0))


def _highest_square(body: Body, tie: SectorTie, mass: np.ndarray) -> float:
    """Largest eigenvalue of M^-1 K of the elements alone, by Lanczos' iteration (Parlett 1998, chapter 13), from below."""
    root = np.sqrt(np.divide(1.0, mass, out=zeros(mass.shape), where=mass > 0.0))
    length_m = LANCZOS_DIFFERENCE_SHARE * np.cbrt(body.volumes.mean())

    rows = zeros(mass.shape)

    def force(u: np.ndarray) -> np.ndarray:
        tie.spread_to_far_side(u)
        body.kernels.forces(u, rows, body.blocks)
        tie.gather_on_near_side(rows)
        return rows

    at_rest = force(body.state.u.copy()).copy()
    vector = root * np.random.default_rng(0).standard_normal(mass.shape)
    vector /= np.linalg.norm(vector)
    last, diagonal, beside = np.zeros_like(vector), [], [0.0]
    for _ in range(LANCZOS_TURNS):
        moved = root * vector
        step = length_m / np.abs(moved).max()
        product = root * (at_rest - force(body.state.u + step * moved)) / step - beside[-1] * last
        diagonal.append(float(np.vdot(vector, product)))
        product -= diagonal[-1] * vector
        beside.append(float(np.linalg.norm(product)))
        if beside[-1] == 0.0:
            break
        last, vector = vector, product / beside[-1]
    return float(scipy.linalg.eigvalsh_tridiagonal(diagonal, beside[1 : len(diagonal)])[-1])
