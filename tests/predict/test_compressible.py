"""The volumetric energy of a compressible tissue: its pressure, and the depth of a tool that follows from it."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.fem.effects.effect import with_leaves
from explicitfe.fem.effects.material.compressible import Compressible
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point

LAW = Yeoh(C10_Pa=200.0, C20_Pa=100.0, poisson=0.45)
K = LAW.constants()[-1]
HEIGHT_RATIO = np.linspace(1.0, 0.7, 7)


def pressure(J: np.ndarray, s: float) -> np.ndarray:
    """U'(J) [Pa]."""
    return (1.0 - s) * K * (J - 1.0) + 0.5 * s * K * (J - 1.0 / J)


def confined_stress(s: float) -> np.ndarray:
    """Axial nominal stress (n,) Pa of a body that keeps its cross section: J is the ratio of heights."""
    F = np.tile(np.eye(3), (len(HEIGHT_RATIO), 1, 1))
    F[:, 2, 2] = HEIGHT_RATIO
    effects = with_leaves((Compressible(poisson=0.45, volume_stiffening=s),))
    return point.path(LAW, effects, np.zeros(len(F)), F, [])[0][:, 2, 2]


def test_the_law_has_the_energy_of_simo_and_taylor():
    """At s = 1 the effect is in the constants alone, so that its answers are those of the law to the last bit."""
    assert with_leaves((Compressible(poisson=0.45),)) == ()
    other = Compressible(poisson=0.45, volume_stiffening=0.0)
    assert with_leaves((other,)) == (other,)
    assert other.in_law(LAW.model_copy(update={"poisson": 0.499})) == LAW


@pytest.mark.slow
@pytest.mark.parametrize("s", [0.0, 0.5, 2.0])
def test_the_pressure_is_that_of_the_volumetric_energy(s):
    """Two tissues of one isochoric law differ by the difference of their pressures, as the cross section keeps its size."""
    difference = confined_stress(s) - confined_stress(1.0)
    wanted = pressure(HEIGHT_RATIO, s) - pressure(HEIGHT_RATIO, 1.0)
    assert np.abs(wanted).max() > 0.01 * K
    assert difference == pytest.approx(wanted, abs=1e-12 * K)
