"""Equilibrium under dead loads that one attempt does not reach: Cook's membrane, nearly incompressible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.box import box
from explicitfe.fem.model.face_load import face_load
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium


def tip_mm(edge: int, poisson: float = 0.4999) -> float:
    """How far the upper corner rises: 48 mm long, 44 and 16 mm high, plane strain, G = 80 kPa, 6.25 kPa of shear on the end."""
    mesh = box((edge, edge, 1), (1.0, 1.0, 1.0))
    x, y, z = mesh.points.T
    mesh = replace(mesh, points=1e-3 * np.column_stack([48.0 * x, 44.0 * x + (44.0 - 28.0 * x) * y, 48.0 / edge * z]))
    held = mesh.held("x0") | mesh.held("z0", "z1", along="z")
    law = NeoHooke(law="neo-hooke", C10_Pa=40e3, poisson=poisson)
    body = Relaxation(Model(mesh, law, held, loads=(face_load(mesh, "x1", (0.0, 4.8 / edge, 0.0)),)))
    assert isinstance(body.settle(), Equilibrium)
    return 1e3 * float(body.displacement[np.argmax(mesh.points.sum(axis=1)), 1])


@pytest.mark.parametrize(("edge", "wanted"), [(8, 6.73), (24, 6.88), pytest.param(48, 6.92, marks=pytest.mark.slow)])
def test_cooks_membrane(edge: int, wanted: float) -> None:
    """The load is halved where it is too large for one attempt; from 24 to 48 elements an edge the corner moves by 0.04 mm."""
    assert tip_mm(edge) == pytest.approx(wanted, abs=0.01)
