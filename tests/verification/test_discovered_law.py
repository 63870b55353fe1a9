"""A law of polynomials with relaxation times: against closed forms, and against a Prony series."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from explicitfe.fem.effects import EFFECTS
from explicitfe.fem.effects.material.discovered_law import DiscoveredLaw
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.forces.response import layout_of
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.platform.errors import InputError

TIME_S = np.linspace(0.0, 10.0, 101)
STRETCH = 1.0 - 0.15 * np.minimum(TIME_S, 2.0)


def test_all_polynomials_have_the_stress_of_the_closed_form():
    """Incompressible compression: P = 2 (l - l^-2) (W_1 + W_2 / l). Poisson's ratio 0.49999 leaves less than 1e-4 of it."""
    c = {"c01_Pa": 200.0, "c11_Pa": 100.0, "c02_Pa": 70.0, "c30_Pa": 10.0, "c21_Pa": 30.0, "c12_Pa": 20.0, "c03_Pa": 50.0}
    law = Yeoh(C10_Pa=300.0, C20_Pa=180.0, poisson=0.49999)
    effect = DiscoveredLaw.from_terms([c])
    x, y = STRETCH**2 + 2.0 / STRETCH - 3.0, 2.0 * STRETCH + STRETCH**-2 - 3.0
    first = 300.0 + 360.0 * x + 100.0 * y + 30.0 * x**2 + 60.0 * x * y + 20.0 * y**2
    second = 200.0 + 100.0 * x + 140.0 * y + 150.0 * y**2 + 30.0 * x**2 + 40.0 * x * y
    exact = 2.0 * (STRETCH - STRETCH**-2) * (first + second / STRETCH)
    stress = point.uniaxial(effect.in_law(law), [effect], TIME_S, STRETCH)
    assert np.abs(stress - exact).max() < 1e-4 * np.abs(exact).max()


def test_branches_alike_are_a_prony_series():
    """The law and one branch with two fifths of it are a Prony series of g = 0.4, whose update is the same: to rounding."""
    whole = Yeoh(C10_Pa=500.0, C20_Pa=300.0, poisson=0.49999)
    prony = point.uniaxial(whole, [Viscoelastic(g=(0.4,), tau_s=(3.0,))], TIME_S, STRETCH)
    remainder = Yeoh(C10_Pa=300.0, C20_Pa=180.0, poisson=0.49999)
    branch = DiscoveredLaw(tau_s=(3.0,), c10_Pa=(200.0,), c20_Pa=(120.0,))
    stress = point.uniaxial(branch.in_law(remainder), [branch], TIME_S, STRETCH)
    assert np.abs(stress - prony).max() < 1e-5 * np.abs(prony).max()


def test_names_of_coefficients_and_what_cannot_be():
    law = DiscoveredLaw.from_terms([{"c20_Pa": 3.0, "c02_300ms_Pa": 5.0, "c20_30s_Pa": 7.0}])
    assert law.tau_s == (0.0, 0.3, 30.0) and law.c20_Pa == (3.0, 0.0, 7.0) and law.c02_Pa == (0.0, 5.0, 0.0)
    assert law.strength == 15.0 and EFFECTS["discovered-law"] is DiscoveredLaw
    for wrong in ({"tau_s": ()}, {"tau_s": (1.0,), "c10_Pa": (1.0, 2.0)}, {"tau_s": (1.0,), "c10_Pa": (-1.0,)}):
        with pytest.raises(ValidationError):
            DiscoveredLaw.model_validate(wrong)
    with pytest.raises(InputError, match="cannot be combined"):
        layout_of((law, Viscoelastic(g=(0.3,), tau_s=(1.0,))))
