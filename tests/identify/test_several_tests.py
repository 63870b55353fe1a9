"""Closed forms of homogeneous tests, alone and together: Treloar's rubber, and data with known constants and noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from identify_cases import write_homogeneous

from explicitfe.app.api.inverse import identify

# Stretch and nominal stress [MPa] of 8 % sulphur rubber at 20 °C in simple elongation: Treloar (1944), Trans. Faraday Soc. 40,
# 59-70, as tabulated by Steinmann, Hossain and Possart (2012), Arch. Appl. Mech. 82, 1183-1217.
UNIAXIAL = """1 0, 1.01 .03, 1.12 .14, 1.24 .23, 1.39 .32, 1.61 .41, 1.89 .5, 2.17 .58, 2.42 .67, 3.01 .85, 3.58 1.04, 4.03 1.21,
4.76 1.58, 5.36 1.94, 5.76 2.29, 6.16 2.67, 6.4 3.02, 6.62 3.39, 6.87 3.75, 7.05 4.12, 7.16 4.47, 7.27 4.85, 7.43 5.21, 7.5 5.57,
7.61 6.3"""


def treloar() -> tuple[np.ndarray, np.ndarray]:
    """Stretch, and nominal stress [Pa]."""
    stretch, stress = np.array([row.split() for row in UNIAXIAL.split(",")], dtype=float).T
    return stretch, 1e6 * stress


@pytest.fixture
def rubber(tmp_path) -> Path:
    return write_homogeneous(tmp_path / "rubber", "tension", "stretch,nominal_stress_Pa", *treloar())


def test_a_fit_of_rubber_is_that_of_the_incompressible_closed_form(rubber):
    """The three Yeoh constants follow by linear least squares from P = 2 (l - l^-2) sum i C_i0 (I1 - 3)^(i - 1)."""
    stretch, stress = treloar()
    I1 = stretch**2 + 2.0 / stretch
    basis = np.stack([2.0 * (stretch - stretch**-2) * i * (I1 - 3.0) ** (i - 1) for i in (1, 2, 3)], axis=1)
    exact = np.linalg.lstsq(basis, stress, rcond=None)[0]
    assert exact == pytest.approx([175.5e3, -1879.0, 46.3], rel=1e-3)
    answer = identify(rubber, law="yeoh-3")
    group = answer["groups"]["all"]
    assert [row["value"] for row in group["constants"].values()] == pytest.approx(exact, rel=1e-6)
    assert answer["poisson"] == 0.5 and "Poisson's ratio 0.5 (incompressible closed form)" in group["assumed"]
    assert group["youngs_modulus"]["value"] == pytest.approx(3.0 * group["shear_modulus"]["value"])


def test_a_stated_ratio_is_used_by_the_closed_form(rubber):
    answer = identify(rubber, law="yeoh-3", poisson=0.499)
    assert answer["groups"]["all"]["constants"]["C10_Pa"]["value"] == pytest.approx(186.5e3, rel=1e-3)
    assert answer["poisson"] == 0.499 and answer["groups"]["all"]["assumed"] == ["Poisson's ratio 0.499"]
