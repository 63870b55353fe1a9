"""Internal forces, reactions and stresses against felupe (PyPI), a finite element program of others: compressible Yeoh.

felupe solves for the equilibrium of a block of 8-node hexahedra with eight points and a mean volume change. At the displacement
that it finds, the element ``hex8-full`` has to be in equilibrium too: no force on free nodes, and the same reactions on the
others. The stress of ``hex8``, which has one point, is compared where it is uniform.
"""

from __future__ import annotations

import felupe
import numpy as np
import pytest
import tensortrax
from support import model_of

from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.box import box
from explicitfe.fem.model.attached import FacePressure
from explicitfe.fem.solve.simulation import Simulation

YEOH = Yeoh(C10_Pa=1037.0, C20_Pa=486.0, poisson=0.4)
MESH = box((6, 3, 3), (0.02, 0.01, 0.01))
# Newton's method of felupe ends at a relative residual of 1e-9; the forces at its displacement are as exact.
RESIDUAL = 1e-8
PRESSURE_PA = 400.0


def energy(C):
    """C10 (I1 - 3) + C20 (I1 - 3)^2 + K / 4 (J^2 - 1 - 2 ln J), with the isochoric invariant I1."""
    C10, C20, K = YEOH.constants()[0], YEOH.constants()[1], YEOH.constants()[-1]
    squared = tensortrax.math.linalg.det(C)
    stretch = squared ** (-1.0 / 3.0) * tensortrax.math.trace(C) - 3.0
    return C10 * stretch + C20 * stretch**2 + 0.25 * K * (squared - 1.0 - tensortrax.math.log(squared))


def solved(x1: tuple[float, float, float] | None):
    """Displacements (n, 3) m and internal forces (n, 3) N of a block that is held at x = 0.

    ``x1``: displacement of the opposite side [m]; None: it is free, and a pressure acts on the upper side.
    """
    mesh = felupe.Mesh(MESH.points, MESH.hexes, "hexahedron")
    field = felupe.FieldsMixed(felupe.RegionHexahedron(mesh), n=3)
    solid = felupe.SolidBody(felupe.ThreeFieldVariation(felupe.constitution.tensortrax.Hyperelastic(energy)), field)
    held = {"x0": felupe.Boundary(field[0], fx=0.0)}
    items = [solid]
    if x1 is None:
        faces = felupe.RegionHexahedronBoundary(mesh, only_surface=True, mask=MESH.points[:, 2] > 0.01 - 1e-9)
        items.append(felupe.SolidBodyPressure(felupe.FieldContainer([felupe.Field(faces, dim=3)]), pressure=0.0))
    for share in (0.25, 0.5, 0.75, 1.0):
        for k, name in enumerate("xyz"):
            if x1 is not None:
                skip = tuple(int(j != k) for j in range(3))
                held[name] = felupe.Boundary(field[0], fx=MESH.points[:, 0].max(), skip=skip, value=share * x1[k])
        dof0, dof1 = felupe.dof.partition(field, held)
        if x1 is None:
            items[1].results.pressure = share * PRESSURE_PA
            items[1].field[0].values[:] = field[0].values
        felupe.newtonrhapson(
            items=items, dof0=dof0, dof1=dof1, ext0=felupe.dof.apply(field, held, dof0), tol=1e-10, maxiter=30, verbose=0
        )
    return field[0].values, solid.assemble.vector(field).toarray()[: MESH.points.size].reshape(-1, 3)


@pytest.mark.parametrize("case", ["tension", "shear", "pressure"])
def test_a_block(case: str, record_property) -> None:
    """Stretched by a quarter, sheared by a fifth of its length, and bent by a pressure on its upper side."""
    moved = {"tension": (0.005, 0.0, 0.0), "shear": (0.0, 0.0, 0.004), "pressure": None}[case]
    u, wanted = solved(moved)
    pressures = (FacePressure.on(MESH, MESH.node_sets["z1"], PRESSURE_PA),) if moved is None else ()
    model = model_of(MESH, YEOH, held=("x0",), element="hex8-full", pressures=pressures)
    body = Simulation(model, displacement=u)
    force = body.internal_force(u)
    size = np.abs(wanted).max()
    deviation = np.abs(force - wanted).max() / size
    record_property("deviation of internal forces", deviation)
    assert deviation < RESIDUAL
    free = np.setdiff1d(np.arange(MESH.node_count), [*MESH.node_sets["x0"], *(MESH.node_sets["x1"] if moved else [])])
    unbalanced = (force - body.external_force())[free]
    record_property("force on free nodes", np.abs(unbalanced).max() / size)
    assert np.abs(unbalanced).max() < RESIDUAL * size
    assert np.abs(u[:, 2]).max() > 1e-4


def test_uniform_shear_and_stretch() -> None:
    """The Cauchy stress of each element, of ``hex8`` and ``hex8-full``, in a uniform deformation."""
    F = np.array([[1.2, 0.3, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.05]])
    u = MESH.points @ (F - np.eye(3)).T
    mesh = felupe.Mesh(MESH.points, MESH.hexes, "hexahedron")
    field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(mesh), dim=3, values=u)])
    solid = felupe.SolidBody(felupe.constitution.tensortrax.Hyperelastic(energy), field)
    wanted = solid.evaluate.cauchy_stress(field)[..., 0, 0]
    for element in ("hex8", "hex8-full"):
        stress = Simulation(model_of(MESH, YEOH, element=element), displacement=u, stress=True).snapshot().stress
        six = wanted[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
        np.testing.assert_allclose(stress, np.broadcast_to(six, stress.shape), atol=1e-10 * np.abs(six).max())
