"""Two blocks pressed together: explicitfe at rest against an implicit solution that shares no code with it.

    python studies/benchmarks/two_bodies_implicit.py

A block of 12 mm stands on a block of 20 x 20 x 12 mm, 1 mm off its centre. Its top moves down and does not rotate.
The implicit route: hexahedra with eight nodes and 2 x 2 x 2 integration points, neo-Hooke, Newton's iteration in load steps
(scipy); contact of the nodes of the upper block's underside with the faces of the lower block by a penalty, one side only. So the
elements, the solver and the kind of contact are different; the material, the meshes and the contact stiffness are the same.
The iteration fails from 2.5 mm on, where nodes slide over the edges between faces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import spsolve

from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.joined import join
from explicitfe.fem.model.model import Model, PrescribedMotion
from explicitfe.fem.model.surface_contact import SurfaceContact
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient

SHEAR_PA, POISSON = 4000.0, 0.3
BULK_PA = 2.0 * SHEAR_PA * (1.0 + POISSON) / (3.0 * (1.0 - 2.0 * POISSON))
STIFFNESS_PA_M = 2e7
LOWER, UPPER = ((8, 8, 5), (0.02, 0.02, 0.012)), ((5, 5, 5), (0.012, 0.012, 0.012))
PLACE_M = (0.005, 0.004, 0.012 + 1e-6)
RAMP_S, END_S, ALPHA_PER_S = 0.1, 0.5, 150.0
CORNERS = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], dtype=float
)


def blocks() -> HexMesh:
    """Both blocks as one mesh."""
    upper = box(*UPPER)
    return join({"lower": box(*LOWER), "upper": replace(upper, points=upper.points + np.array(PLACE_M), named_points={})})


def explicit(mesh: HexMesh, depth_m: float, element: str) -> np.ndarray:
    """Displacement (n, 3) m with explicitfe: the top moves down smoothly within 0.1 s, and damping brings the blocks to rest."""
    top = mesh.node_sets["upper.z1"]

    def motion(times: np.ndarray) -> np.ndarray:
        s = np.clip(times / RAMP_S, 0.0, 1.0)
        u = np.zeros((len(times), len(top), 3))
        u[:, :, 2] = -depth_m * (s * s * (3.0 - 2.0 * s))[:, None]
        return u

    model = Model(
        mesh,
        NeoHooke(C10_Pa=0.5 * SHEAR_PA, poisson=POISSON),
        mesh.held("lower.z0"),
        ALPHA_PER_S,
        element=element,
        motion=PrescribedMotion(top, motion),
        surfaces=SurfaceContact(stiffness_Pa_m=STIFFNESS_PA_M),
    )
    body = Simulation(model)
    ended = Transient(body, END_S).advance_to(END_S)
    assert ended is None or ended.state == "finished", ended
    return body.snapshot().displacement.copy()


# ---- the implicit route ----


def stress(F: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress (..., 3, 3) of W = G/2 (I1 J^(-2/3) - 3) + K/4 (J^2 - 1 - 2 ln J)."""
    J = np.linalg.det(F)[..., None, None]
    inverse_T = np.swapaxes(np.linalg.inv(F), -1, -2)
    I1 = np.einsum("...ij,...ij->...", F, F)[..., None, None]
    return SHEAR_PA * J ** (-2.0 / 3.0) * (F - I1 / 3.0 * inverse_T) + 0.5 * BULK_PA * (J * J - 1.0) * inverse_T


def gradients(mesh: HexMesh) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the shape functions (m, 8, 8, 3) at the integration points, and the volumes of these (m, 8)."""
    at = CORNERS / np.sqrt(3.0)
    natural = np.empty((8, 8, 3))
    for i in range(3):
        others = [k for k in range(3) if k != i]
        natural[:, :, i] = CORNERS[:, i] / 8.0 * np.prod(1.0 + at[:, None, others] * CORNERS[None, :, others], axis=2)
    jacobian = np.einsum("gai,mak->mgki", natural, mesh.points[mesh.hexes])
    return np.einsum("gai,mgik->mgak", natural, np.linalg.inv(jacobian)), np.linalg.det(jacobian)


def internal(mesh: HexMesh, slopes: np.ndarray, volumes: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, csc_array]:
    """Internal force (3 n,) and its derivative; that of the stress is a central difference."""
    F = np.eye(3) + np.einsum("mai,mgak->mgik", u[mesh.hexes], slopes)
    tangent = np.empty((*F.shape, 3, 3))
    for i in range(3):
        for k in range(3):
            step = np.zeros((3, 3))
            step[i, k] = 1e-6
            tangent[..., i, k] = (stress(F + step) - stress(F - step)) / 2e-6
    rows = (3 * mesh.hexes[:, :, None] + np.arange(3)).reshape(len(mesh.hexes), 24)
    force = np.zeros(3 * mesh.node_count)
    np.add.at(force, rows, np.einsum("mgik,mgak,mg->mai", stress(F), slopes, volumes).reshape(-1, 24))
    each = np.einsum("mgikjl,mgak,mgbl,mg->maibj", tangent, slopes, slopes, volumes, optimize=True).reshape(-1, 24, 24)
    ends = (np.repeat(rows, 24, axis=1).ravel(), np.tile(rows, (1, 24)).ravel())
    return force, coo_array((each.ravel(), ends), shape=2 * (3 * mesh.node_count,)).tocsc()


def grid_face(mesh: HexMesh, name: str, cells: tuple[int, int]) -> np.ndarray:
    """The faces (k, 4) of a side of a box, normal to z, counter-clockwise seen from above."""
    number = mesh.node_sets[name].reshape(cells[0] + 1, cells[1] + 1)
    return np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)


def contact(mesh: HexMesh, u: np.ndarray) -> tuple[np.ndarray, csc_array]:
    """Contact force on the right of the balance (3 n,), as a part of the internal one, and its derivative without curvature."""
    x = mesh.points + u
    faces = grid_face(mesh, "lower.z1", LOWER[0][:2])
    under = grid_face(mesh, "upper.z0", UPPER[0][:2])
    area = np.bincount(under.ravel(), minlength=mesh.node_count) * UPPER[1][0] * UPPER[1][1] / under.size
    force, data, ends = np.zeros(3 * mesh.node_count), [], ([], [])
    for node in mesh.node_sets["upper.z0"]:
        for face in faces[np.argsort(np.linalg.norm(x[faces].mean(axis=1) - x[node], axis=1))[:6]]:
            s = np.zeros(2)
            for _ in range(20):  # the foot of the perpendicular on the bilinear face
                a, b = (1.0 + s[0] * CORNERS[:4, 0]) / 2.0, (1.0 + s[1] * CORNERS[:4, 1]) / 2.0
                w, wa, wb = a * b, CORNERS[:4, 0] / 2.0 * b, a * CORNERS[:4, 1] / 2.0
                ta, tb = wa @ x[face], wb @ x[face]
                off = x[node] - w @ x[face]
                step = np.linalg.solve([[ta @ ta, ta @ tb], [ta @ tb, tb @ tb]], [off @ ta, off @ tb])
                s = s + step
                if np.abs(step).max() < 1e-12:
                    break
            if np.abs(s).max() > 1.0 + 1e-9:
                continue
            normal = np.cross(ta, tb) / np.linalg.norm(np.cross(ta, tb))
            depth = -(off @ normal)
            if depth > 0.0:
                rows = (3 * np.append(node, face)[:, None] + np.arange(3)).ravel()
                arm = np.outer(np.append(1.0, -w), normal).ravel()
                stiff = STIFFNESS_PA_M * area[node]
                np.add.at(force, rows, -stiff * depth * arm)
                data.append(stiff * np.outer(arm, arm).ravel())
                ends[0].append(np.repeat(rows, len(rows)))
                ends[1].append(np.tile(rows, len(rows)))
            break
    if not data:
        return force, csc_array(2 * (len(force),))
    return force, coo_array((np.concatenate(data), tuple(map(np.concatenate, ends))), shape=2 * (len(force),)).tocsc()


def implicit(mesh: HexMesh, depth_m: float, steps: int = 8) -> np.ndarray:
    """Displacement (n, 3) m in equilibrium."""
    top = mesh.node_sets["upper.z1"]
    fixed = np.zeros((mesh.node_count, 3), dtype=bool)
    fixed[mesh.node_sets["lower.z0"]] = fixed[top] = True
    free = np.flatnonzero(~fixed.ravel())
    slopes, volumes = gradients(mesh)
    u = np.zeros((mesh.node_count, 3))
    upper = mesh.node_sets["upper"]
    for step in range(1, steps + 1):
        u[upper if step == 1 else top, 2] -= depth_m / steps
        for _ in range(60):
            force, tangent = internal(mesh, slopes, volumes, u)
            push, stiff = contact(mesh, u)
            residual = (force + push)[free]
            # a node that lies on an edge between two faces changes between them by less
            if np.abs(residual).max() < 1e-5 * np.abs(force).max():
                break
            change = spsolve((tangent + stiff)[free][:, free], -residual)
            u.ravel()[free] += change * min(1.0, 5e-4 / np.abs(change).max())
        else:
            raise RuntimeError(f"no equilibrium at {step} of {steps}: {np.abs(residual).max():g} N")
    return u


def main() -> None:
    """Print the differences."""
    mesh = blocks()
    for depth_m in (1e-3, 2e-3):
        reference = implicit(mesh, depth_m)
        for element in ("hex8-full", "hex8"):
            u = explicit(mesh, depth_m, element)
            apart = np.linalg.norm(u - reference, axis=1)
            print(
                f"{1e3 * depth_m:g} mm, {element}: rms difference {1e3 * np.sqrt(np.mean(apart**2)):.4f} mm, "
                f"largest {1e3 * apart.max():.3f} mm; rms displacement {1e3 * np.sqrt(np.sum(reference**2) / len(apart)):.3f} mm"
            )


if __name__ == "__main__":
    main()
