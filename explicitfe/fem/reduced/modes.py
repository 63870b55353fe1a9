"""Modes of a section: proper orthogonal decomposition of displacements and pressures, and what lets pressures act on them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from explicitfe.fem.reduced.snapshots import Snapshots
from explicitfe.fem.solve.section import RevolvedSection

# Entries of a displacement gradient by r, z of a node: the row, which slope of the shape function, and which displacement.
ENTRIES = ((0, 0, 0), (1, 1, 0), (2, 0, 1), (3, 1, 1), (4, 2, 0))


class Modes(NamedTuple):
    """Unknowns of a reduced section; n modes of displacement, k of pressure, p Gauss points.

    Attributes
    ----------
    displacements : (2 nodes, n) orthonormal in the energy of the undeformed body with the tool's springs.
    pressures : (elements, 3, k) coefficients on the linear functions of the elements.
    gradients : (p, 5, n) of the displacements at the Gauss points.
    at_points : (p, k) the pressures there.
    """

    displacements: np.ndarray
    pressures: np.ndarray
    gradients: np.ndarray
    at_points: np.ndarray


def modes_of(snapshots: Snapshots, count: int, pressure_count: int) -> Modes:
    """The first modes of displacements and of pressures.

    To each mode of pressure belongs one of displacement that answers to it (supremizer; Rozza & Veroy 2007): without them the
    displacements of bodies that keep their volume can hardly be combined without a change of volume.
    """
    section = snapshots.section
    quads, free = section.quads, section.free
    gradient = _gradient(section)
    metric = _energy(section, gradient) + _springs(section, snapshots.contact)
    displacements = _main_modes(snapshots.displacements.T, metric, count)
    mass = sparse.block_diag(list(quads.mass)).tocsr()
    pressures = _main_modes(snapshots.pressures.reshape(len(snapshots.pressures), -1).T, mass, pressure_count)
    at_points = np.einsum("qk,mkj->mqj", quads.linear, pressures.reshape(-1, 3, pressures.shape[1])).reshape(len(section.at), -1)
    divergence = gradient[0::5] + gradient[3::5] + gradient[4::5]
    loads = divergence.T @ (quads.weights.reshape(-1, 1) * at_points)
    answers = np.zeros_like(loads)
    answers[free] = splu(metric[free][:, free].tocsc()).solve(loads[free])
    both = np.hstack([displacements, answers])
    for _ in range(2):  # once more for what rounding leaves
        gram = both.T @ (metric @ both)
        both = np.linalg.solve(np.linalg.cholesky(0.5 * (gram + gram.T)), both.T).T
    own = np.ascontiguousarray((gradient @ both).reshape(-1, 5, both.shape[1]))
    return Modes(both, pressures.reshape(-1, 3, pressures.shape[1]), own, at_points)


def _main_modes(columns: np.ndarray, metric: sparse.csr_matrix, count: int) -> np.ndarray:
    """The first modes of columns (n, s), orthonormal in a metric (method of snapshots; Sirovich 1987)."""
    energy, turned = np.linalg.eigh(columns.T @ (metric @ columns))
    energy, turned = energy[::-1][:count], turned[:, ::-1][:, :count]
    return columns @ (turned / np.sqrt(energy))


def _gradient(section: RevolvedSection) -> sparse.csr_matrix:
    """Displacement gradients (5 p, 2 n) at the Gauss points by the displacements of the nodes."""
    quads = section.quads
    points = np.arange(quads.weights.size).reshape(quads.weights.shape)
    shape = (*quads.weights.shape, quads.nodes.shape[1])
    rows, columns, values = [], [], []
    for entry, slope, axis in ENTRIES:
        rows.append(np.broadcast_to(5 * points[:, :, None] + entry, shape).ravel())
        columns.append(np.broadcast_to(2 * quads.nodes[:, None, :] + axis, shape).ravel())
        values.append(quads.slopes[:, :, :, slope].ravel())
    whole = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sparse.coo_matrix(whole, shape=(5 * points.size, 2 * len(section.points))).tocsr()


def _energy(section: RevolvedSection, gradient: sparse.csr_matrix) -> sparse.csr_matrix:
    """Stiffness (2 n, 2 n) of the undeformed body against changes of shape, over the shear modulus [m]."""
    strain = np.zeros((6, 5))  # rr, zz, around, and shear; less the mean
    strain[:3, [0, 3, 4]] = np.sqrt(2.0) * (np.eye(3) - 1.0 / 3.0)
    strain[3, 1] = strain[3, 2] = 1.0
    local = strain.T @ strain
    weights = section.quads.weights.ravel()
    return gradient.T @ sparse.kron(sparse.diags(weights), local) @ gradient


def _springs(section: RevolvedSection, contact: np.ndarray) -> sparse.csr_matrix:
    """Stiffness (2 n, 2 n) of the tool's contact, over the shear modulus [m]; its symmetric and positive part."""
    surface = section.surface
    value, axes = np.linalg.eigh(0.5 * (contact + contact.transpose(0, 2, 1)))
    positive = np.einsum("kij,kj,klj->kil", axes, np.maximum(value, 0.0), axes)
    stiffness = np.einsum("ka,kij,kb->kaibj", surface.shape, positive, surface.shape).reshape(len(positive), 6, 6)
    dofs = section.surface_dofs
    whole = stiffness.ravel(), (np.repeat(dofs, 6, axis=1).ravel(), np.tile(dofs, (1, 6)).ravel())
    return sparse.coo_matrix(whole, shape=(2 * len(section.points),) * 2).tocsr()
