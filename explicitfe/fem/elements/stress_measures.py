"""Quantities of stress and strain in elements, and their means at nodes.

Symmetric tensors have the components xx, yy, zz, xy, yz, xz, the order of VTK.
"""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.fem.elements.hex8 import mean_gradients
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.platform.host.kept import kept

_ROWS, _COLUMNS = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])


def symmetric(tensors: np.ndarray) -> np.ndarray:
    """The six components (..., 6) of symmetric tensors (..., 3, 3)."""
    return np.asarray(tensors[..., _ROWS, _COLUMNS])


def von_mises(stress: np.ndarray) -> np.ndarray:
    """Von Mises stress (...) Pa of stresses (..., 6) Pa: sqrt(3/2 s : s) of the deviator s."""
    deviator = stress[..., :3] - stress[..., :3].mean(axis=-1, keepdims=True)
    return np.asarray(np.sqrt(1.5 * np.sum(deviator**2, axis=-1) + 3.0 * np.sum(stress[..., 3:] ** 2, axis=-1)))


def pressure(stress: np.ndarray) -> np.ndarray:
    """Pressure (...) Pa of stresses (..., 6) Pa: minus a third of the trace, positive in compression."""
    return np.asarray(-stress[..., :3].mean(axis=-1))


def deformation_gradients(mesh: HexMesh, displacement: np.ndarray) -> np.ndarray:
    """Mean deformation gradient of each element, (..., m, 3, 3), at displacements (..., n, 3) m."""
    gradients, _ = _shape(mesh)
    return np.eye(3) + np.einsum("...mai,maj->...mij", displacement[..., mesh.hexes, :], gradients)


def green_lagrange(F: np.ndarray) -> np.ndarray:
    """Green-Lagrange strain (..., 6), (F^T F - 1) / 2; shear components are those of the tensor."""
    return symmetric(0.5 * (np.swapaxes(F, -1, -2) @ F - np.eye(3)))


def principal_stretches(F: np.ndarray) -> np.ndarray:
    """Principal stretches (..., 3), the largest first; not a number where F is not finite."""
    sound = np.isfinite(F).all(axis=(-1, -2))
    stretches = np.linalg.svd(np.where(sound[..., None, None], F, np.eye(3)), compute_uv=False)
    return np.where(sound[..., None], stretches, np.nan)


def at_nodes(mesh: HexMesh, values: np.ndarray) -> np.ndarray:
    """Means of values of elements (..., m, k) over the elements at each node, weighted by their volumes at rest: (..., n, k)."""
    _, volumes = _shape(mesh)
    count = mesh.element_count
    share = scipy.sparse.csr_matrix(
        (np.repeat(volumes, 8), (mesh.hexes.ravel(), np.repeat(np.arange(count), 8))), shape=(mesh.node_count, count)
    )
    total = np.asarray(share.sum(axis=1))
    return np.stack([share @ one / total for one in values.reshape(-1, count, values.shape[-1])]).reshape(
        *values.shape[:-2], mesh.node_count, values.shape[-1]
    )


@kept(8)
def _shape(mesh: HexMesh) -> tuple[np.ndarray, np.ndarray]:
    return mean_gradients(mesh.points[mesh.hexes])
