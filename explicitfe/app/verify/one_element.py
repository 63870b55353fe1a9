"""Claims on one element: its stress in tension, compression, equibiaxial tension and simple shear.

With b_bar = J^(-2/3) F F^T: J sigma = 2 W' dev b_bar + J U'(J) 1, P = J sigma F^-T, and the stress in a free direction
is zero. The closed form implements these equations and shares no code with the element.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from explicitfe.app.verify.claim import ClaimFigure, Workshop
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.box import box
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.simulation import Simulation

C10_PA, C20_PA, POISSON_RATIO = 191.5, 90.6, 0.4999
BULK_PA = 4.0 * C10_PA * (1.0 + POISSON_RATIO) / (3.0 * (1.0 - 2.0 * POISSON_RATIO))
EDGE_M = 0.01
CURVES = {
    "tension": np.linspace(1.05, 2.0, 5),
    "compression": np.linspace(0.97, 0.4, 5),
    "equibiaxial": np.linspace(1.03, 1.6, 5),
    "shear": np.linspace(0.05, 1.0, 5),
}
# Cauchy stress [Pa] along the load by FEBio 4.11, which uses U = K / 2 (J - 1)^2; computed for this project.
FEBIO_PA = {
    ("tension", 1.2): 255.7660579,
    ("tension", 1.5): 940.712525,
    ("tension", 2.0): 3870.586602,
    ("compression", 0.7): -477.5374802,
    ("compression", 0.4): -2728.081398,
    ("equibiaxial", 1.3): 866.8643446,
    ("equibiaxial", 1.6): 2896.686131,
    ("shear", 0.5): 236.8,
    ("shear", 1.0): 745.4,
}


def closed_form(_: Workshop) -> ClaimFigure:
    """Largest difference of any component of the first Piola-Kirchhoff stress, relative to the largest component."""
    worst = 0.0
    for test, values in CURVES.items():
        for value in values:
            F = stretched(test, float(value))
            wanted = np.linalg.det(F) * cauchy_stress(F) @ np.linalg.inv(F).T
            worst = max(worst, float(np.abs(of_the_element(F) - wanted).max() / np.abs(wanted).max()))
    return ClaimFigure(f"20 states, largest relative difference {worst:.1g}", worst)


def other_program(_: Workshop) -> ClaimFigure:
    """Largest relative difference of the Cauchy stress along the load from that of FEBio."""
    worst = 0.0
    for (test, value), wanted in FEBIO_PA.items():
        F = stretched(test, value)
        stress = of_the_element(F) @ F.T / np.linalg.det(F)
        worst = max(worst, abs(float(stress[(0, 1) if test == "shear" else (0, 0)]) / wanted - 1.0))
    return ClaimFigure(f"{len(FEBIO_PA)} states, largest relative difference {worst:.1g}", worst)


def cauchy_stress(F: np.ndarray) -> np.ndarray:
    """Cauchy stress (3, 3) Pa of the Yeoh law, with U' = K / 2 (J - 1 / J)."""
    J = np.linalg.det(F)
    b = J ** (-2.0 / 3.0) * F @ F.T
    slope = C10_PA + 2.0 * C20_PA * (np.trace(b) - 3.0)
    pressure = 0.5 * BULK_PA * (J - 1.0 / J)
    return np.asarray(2.0 * slope / J * (b - np.trace(b) / 3.0 * np.eye(3)) + pressure * np.eye(3))


def stretched(test: str, value: float) -> np.ndarray:
    """Deformation gradient of a test at a stretch or an amount of shear, with zero stress in its free directions."""

    def at(free: float) -> np.ndarray:
        return np.diag([value, value if test == "equibiaxial" else free, free])

    if test == "shear":
        F = np.eye(3)
        F[0, 1] = value
        return F
    start = value ** (-2.0 if test == "equibiaxial" else -0.5)
    free = brentq(lambda s: cauchy_stress(at(s))[2, 2], 0.9 * start, 1.1 * start, xtol=1e-16, rtol=1e-15)
    return at(free)


def of_the_element(F: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress (3, 3) Pa of one cube: the forces on its faces at x, y, z = edge, over their area."""
    mesh = box((1, 1, 1), 3 * [EDGE_M])
    material = Yeoh(C10_Pa=C10_PA, C20_Pa=C20_PA, poisson=POISSON_RATIO)
    body = Simulation(Model(mesh, material, np.zeros(mesh.points.shape, dtype=bool)))
    force = body.internal_force(mesh.points @ (F - np.eye(3)).T)
    return np.column_stack([force[mesh.node_sets[f"{axis}1"]].sum(axis=0) for axis in "xyz"]) / EDGE_M**2
