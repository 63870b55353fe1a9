"""Few Gauss points with weights that give the internal forces of the modes as all points do.

Energy-conserving sampling and weighting (Farhat, Chapman & Avery 2015): weights that are not negative keep the stiffness of the
reduced body definite. Points instead of elements are the empirical cubature of Hernandez, Caicedo & Ferrer (2017).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from explicitfe.fem.reduced.modes import Modes
from explicitfe.fem.reduced.snapshots import Snapshots

# States that the weights are fitted to; rows of the fit below this share of the largest singular value are left out.
FITTED_STATES, SMALLEST_SHARE = 40, 1e-7
# A change of volume counts as the force of a pressure, over the metric's stiffness against it.
VOLUME_WEIGHT = 10.0
DUAL_WEIGHT = 100.0
CANDIDATES_AT_ONCE = 4


class Cubature(NamedTuple):
    """Gauss points (k,) of a section and the volumes [m^3] that they stand for; the error that is left, relative to all."""

    points: np.ndarray
    weights: np.ndarray
    error: float


def cubature_of(snapshots: Snapshots, modes: Modes, most: int, tolerance: float) -> Cubature:
    """Find points and weights.

    Parameters
    ----------
    most : number of points at most.
    tolerance : of the forces on the modes and of the volumes, relative to their norm.
    """
    weights = snapshots.section.quads.weights.ravel()
    states = snapshots.displacements
    amounts = np.linalg.lstsq(modes.displacements, states.T, rcond=None)[0].T
    shape = modes.pressures.reshape(-1, modes.pressures.shape[2])
    heads = np.linalg.lstsq(shape, snapshots.pressures.reshape(len(states), -1).T, rcond=None)[0].T
    rows = []
    for state in np.unique(np.linspace(1, len(states) - 2, FITTED_STATES).astype(int)):
        pressure = modes.at_points @ heads[state]
        gradient = modes.gradients @ amounts[state] + np.array([1.0, 0.0, 0.0, 1.0, 1.0])
        cofactor, volume = cofactors(gradient)
        of_pressure = pressure[:, None] * cofactor
        of_shape = snapshots.stresses[state] - of_pressure
        forces = [np.einsum("q,qi,qin->nq", weights, stress, modes.gradients) for stress in (of_shape, of_pressure)]
        growth = weights * (volume - 1.0) * modes.at_points.T
        rows += [*forces, VOLUME_WEIGHT * growth]
        # What an error does to the force on the tool: its work on the change of the state with the depth.
        for other in (state - 1, state + 1):
            along, rise = amounts[other] - amounts[state], heads[other] - heads[state]
            size = np.linalg.norm(along) / DUAL_WEIGHT
            rows.append(((along @ (forces[0] + forces[1]) + rise @ growth) / size)[None, :])
    rows.append(weights[None, :] / np.sqrt(weights.sum()) * 1e-2)
    matrix = np.concatenate(rows)
    gram = matrix @ matrix.T
    values, vectors = np.linalg.eigh(gram)
    kept = values > SMALLEST_SHARE**2 * values[-1]
    matrix = vectors[:, kept].T @ matrix
    shares, error = sparse_shares(matrix, matrix.sum(axis=1), most, tolerance)
    points = np.flatnonzero(shares)
    return Cubature(points, shares[points] * weights[points], error)


def cofactors(gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (p, 5) of the determinant of deformation gradients (p, 5), and the determinant (p,)."""
    rr, rz, zr, zz, around = gradient.T
    plane = rr * zz - rz * zr
    return np.stack([around * zz, -around * zr, -around * rz, around * rr, plane], axis=1), around * plane


def sparse_shares(matrix: np.ndarray, goal: np.ndarray, most: int, tolerance: float) -> tuple[np.ndarray, float]:
    """Few shares (p,), none negative, with matrix @ shares near a goal (Lawson & Hanson 1974, ended early), and the error."""
    shares = np.zeros(matrix.shape[1])
    active = np.zeros(len(shares), dtype=bool)
    scale = np.linalg.norm(goal)
    norms = np.linalg.norm(matrix, axis=0)
    left = goal.copy()
    while np.linalg.norm(left) > tolerance * scale and active.sum() < most:
        gain = np.where(active, -np.inf, (left @ matrix) / norms)
        best = np.argsort(-gain)[:CANDIDATES_AT_ONCE]
        active[best[gain[best] > 0.0]] = True
        if gain[best[0]] <= 0.0:
            break
        while True:
            at = np.flatnonzero(active)
            found = np.linalg.lstsq(matrix[:, at], goal, rcond=None)[0]
            if (found > 0.0).all():
                break
            before = shares[at]
            wrong = found <= 0.0
            step = np.min(before[wrong] / np.maximum(before[wrong] - found[wrong], 1e-300))
            shares[at] = before + step * (found - before)
            dropped = at[wrong & (shares[at] <= 1e-14)]
            shares[dropped], active[dropped] = 0.0, False
        shares[at] = found
        left = goal - matrix[:, at] @ found
    return shares, float(np.linalg.norm(left) / scale)
