"""Solutions of the full section from which a reduced one is made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve.quad9 import UNSHIFTED
from explicitfe.fem.solve.revolution import Revolution, ToolState
from explicitfe.fem.solve.section import RevolvedSection
from explicitfe.platform.errors import RunError


class Programme(NamedTuple):
    """A run of the full section.

    Attributes
    ----------
    law, effects : the tissue.
    time_s, displacement_m : (n,) instants, and displacements of the machine since first touch there.
    """

    law: Yeoh
    effects: Sequence[Effect]
    time_s: np.ndarray
    displacement_m: np.ndarray


class Snapshots(NamedTuple):
    """Equilibria of the full section; s states, p Gauss points, k points of the surface.

    Attributes
    ----------
    section : the mesh.
    displacements : (s, 2 n) of the nodes, r, z in turn [m].
    pressures : (s, m, 3) over the shear modulus of the law: coefficients on the linear functions of the elements.
    stresses : (s, p, 5) first Piola-Kirchhoff stress with the pressure, over the shear modulus; entries as in solve/quad9.py.
    contact : (k, 2, 2) mean stiffness of the contact by r, z over the shear modulus [m].
    """

    section: RevolvedSection
    displacements: np.ndarray
    pressures: np.ndarray
    stresses: np.ndarray
    contact: np.ndarray


def snapshots_of(specimen: SpecimenTable, tool: ToolTable, programmes: Sequence[Programme], fineness: float = 1.0) -> Snapshots:
    """Follow programmes with the full section and keep its equilibria, up to the last one that it reaches.

    Parameters
    ----------
    fineness : divides the element sizes.

    Raises
    ------
    RunError : no state is reached.
    """
    states, pressures, stresses, contacts = [], [], [], []
    for programme in programmes:
        body = Revolution(specimen, tool, programme.law, programme.effects, fineness)
        body.compile()
        body.settle()
        unit = programme.law.shear_modulus_Pa
        shape = body.section.surface.shape
        for at_s, depth in zip(programme.time_s, programme.displacement_m, strict=True):
            if not isinstance(body.move(float(depth), at_s=float(at_s)), ToolState):
                break
            states.append(body.main.u.copy())
            pressures.append(body.main.pressures / unit)
            stresses.append(body.newton.work.answers[UNSHIFTED, :, :5] / unit)
            of_nodes = body.newton.contact_stiffness[:, :6, :6].reshape(-1, 3, 2, 3, 2)
            contacts.append(np.einsum("kaibj->kij", of_nodes) / (unit * shape.sum(axis=1) ** 2)[:, None, None])
    if not states:
        raise RunError("the full section reaches no state of the runs that a reduced section is made from.")
    return Snapshots(body.section, np.array(states), np.array(pressures), np.array(stresses), np.mean(contacts, axis=0))
