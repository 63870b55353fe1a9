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
FITTED_STATES, SMALLEST_SINGULAR_SHARE = 40, 1e-7
# Weights of the equations of the fit, relative to those of the modal forces: the volume constraints of the pressure modes, the
# effect on the tool force, and the total volume.
VOLUME_WEIGHT, DUAL_WEIGHT, VOLUME_SHARE = 10.0, 100.0, 1e-2
CANDIDATES_AT_ONCE, SMALLEST_WEIGHT = 4, 1e-14


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
    heads = np.linalg.lstsq(
        modes.pressures.reshape(-1, modes.pressures.shape[2]), snapshots.pressures.reshape(len(states), -1).T, rcond=None
    )[0].T
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
    rows.append(VOLUME_SHARE * weights[None, :] / np.sqrt(weights.sum()))
    matrix = np.concatenate(rows)
    values, vectors = np.linalg.eigh(matrix @ matrix.T)
    kept = values > SMALLEST_SINGULAR_SHARE**2 * values[-1]
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
    norms, scale = np.linalg.norm(matrix, axis=0), np.linalg.norm(goal)
    left, added, last = goal, CANDIDATES_AT_ONCE, np.inf
    while (error := float(np.linalg.norm(left) / scale)) > tolerance and np.count_nonzero(shares) < most:
        if error >= last:  # several columns at once may have driven each other out
            if added == 1:
                break
            added = 1
        last = error
        active = shares > 0.0
        gain = np.where(active, -np.inf, (left @ matrix) / norms)
        best = np.argsort(-gain)[:added]
        active[best[gain[best] > 0.0]] = True
        while True:
            at = np.flatnonzero(active)
            fitted = np.linalg.lstsq(matrix[:, at], goal, rcond=None)[0]
            wrong = fitted <= 0.0
            if not wrong.any():
                break
            before = shares[at]
            step = np.min(before[wrong] / np.maximum(before[wrong] - fitted[wrong], SMALLEST_WEIGHT))
            shares[at] = before + step * (fitted - before)
            out = at[wrong & (shares[at] <= SMALLEST_WEIGHT)]
            shares[out], active[out] = 0.0, False
        shares[:] = 0.0
        shares[at] = fitted
        left = goal - matrix[:, at] @ fitted
    return shares, error
