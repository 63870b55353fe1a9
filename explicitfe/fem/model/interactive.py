"""A model for a quick look: tissue that changes its volume a little, and slightly heavier nodes where elements are smallest.

The stable step of nearly incompressible tissue is that of its pressure waves, 2 / omega with omega^2 ~ (K + 4 G / 3) / (rho h^2),
although a muscle moves the body a thousand times slower. Two changes make it longer, and both are small where one looks: a
Poisson's ratio of 0.49 instead of 0.499 (K / G of 50 instead of 500), and more mass at the few nodes that limit the step (mass
scaling, Belytschko et al. 2014, section 6.2.5). An equilibrium does not know of the mass.

No mesh vibrates faster than omega, omega^2 = max_n sum_e m_e omega_e^2 / m_n over the elements e at a node n of the mass m_n
(fem/solve/look.py). So a node needs the mass sum_e m_e omega_e^2 / omega^2, and the shortest period that a given share of the
mass of the body pays for follows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from explicitfe.fem.elements import hex8
from explicitfe.fem.materials import Law
from explicitfe.fem.model.attached import AttachedMass
from explicitfe.fem.model.model import Model

POISSON = 0.49
ADDED_MASS_SHARE = 0.03  # of the mass of the body
_BISECTIONS = 50


def let_volume_change(model: Model) -> Model:
    """The model with a Poisson's ratio of ``POISSON`` at most."""

    def law(material: Law) -> Law:
        return material.model_copy(update={"poisson": min(material.poisson, POISSON)})

    inclusions = tuple(replace(part, material=law(part.material)) for part in model.inclusions)
    return replace(model, material=law(model.material), inclusions=inclusions)


def scale_mass(model: Model) -> Model:
    """The model with ``ADDED_MASS_SHARE`` of its mass added at the nodes that limit the step; gravity does not act on it."""
    mass_kg, stiffness = _mass_and_stiffness(model)
    free = ~model.held.all(axis=1)

    def extra_mass(square: float) -> np.ndarray:
        return np.where(free, np.maximum(stiffness / square - mass_kg, 0.0), 0.0)

    high = float((stiffness / mass_kg).max())
    low = 1e-6 * high
    for _ in range(_BISECTIONS):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if extra_mass(middle).sum() > ADDED_MASS_SHARE * mass_kg.sum() else (low, middle)
    nodes = np.flatnonzero(extra_mass(high))
    return replace(model, masses=(*model.masses, AttachedMass("mass scaling", nodes, extra_mass(high)[nodes])))


def _mass_and_stiffness(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Of each node m_n [kg] and sum_e m_e omega_e^2 [N/m] at rest, (n,)."""
    hexes = model.mesh.hexes
    gradients, volumes = hex8.mean_gradients(model.mesh.points[hexes])
    modulus_Pa = model.in_elements(lambda law: law.constants()[-1] + 4.0 / 3.0 * law.shear_modulus_Pa)
    if model.stiffness is not None:
        modulus_Pa = modulus_Pa * model.stiffness
    share = model.in_elements(lambda law: law.density_kg_m3) * volumes / 8.0
    stiffness = modulus_Pa * volumes * np.einsum("eai,eai->e", gradients, gradients)
    count = model.mesh.node_count
    mass_kg = np.bincount(hexes.ravel(), np.repeat(share, 8), count)
    for attached in model.masses:
        mass_kg += np.bincount(attached.nodes, attached.mass_kg, count)
    return mass_kg, np.bincount(hexes.ravel(), np.repeat(stiffness, 8), count)
