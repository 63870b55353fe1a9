"""Two blocks pressed together: explicitfe at rest against an implicit solution that shares no code with it.

    python studies/benchmarks/two_bodies_implicit.py

A block of 12 mm stands on a block of 20 x 20 x 12 mm, 1 mm off its centre. Its top moves down and does not rotate.
The implicit route (``implicit_bodies``): other elements, solver and contact, of the nodes of the upper block's underside with the
faces of the lower block; the material, the meshes and the contact stiffness are the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from implicit_bodies import Tissue, Touch, linear, node_areas, outer_faces, settle

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
    body.surfaces.growth[:] = np.inf  # contact is linear in depth, as it is there
    ended = Transient(body, END_S).advance_to(END_S)
    assert ended is None or ended.state == "finished", ended
    return body.snapshot().displacement.copy()


def implicit(mesh: HexMesh, depth_m: float, steps: int = 4) -> np.ndarray:
    """Displacement (n, 3) m in equilibrium, by the implicit route."""
    top, upper, under = (mesh.node_sets[name] for name in ("upper.z1", "upper", "upper.z0"))
    fixed = np.zeros((mesh.node_count, 3), dtype=bool)
    fixed[mesh.node_sets["lower.z0"]] = fixed[top] = True
    free = np.flatnonzero(~fixed.ravel())
    faces = outer_faces(mesh.hexes)
    below = ~np.isin(faces, upper).any(axis=1)
    areas = node_areas(mesh.points, faces[np.isin(faces, under).all(axis=1)])[under]
    every = np.ones(mesh.hexes.shape[0])
    tissue = Tissue(linear(mesh.points, mesh.hexes), 0.5 * SHEAR_PA * every, 0.0 * every, BULK_PA * every)
    shares = np.ones((len(under), 1))
    touch = Touch(mesh.points, under[:, None], shares, STIFFNESS_PA_M * areas, faces[below], np.ones(below.sum(), dtype=bool))
    u = np.zeros((mesh.node_count, 3))
    for step in range(steps):
        u[upper if step == 0 else top, 2] -= depth_m / steps
        u = settle([tissue, touch], u, free)
    return u


def main() -> None:
    """Print the differences."""
    mesh = blocks()
    for depth_m in (1e-3, 2e-3, 3e-3):
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
