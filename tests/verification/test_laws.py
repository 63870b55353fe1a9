"""Laws in homogeneous tests: closed forms, derivatives by a complex step, agreement with the compiled point, stability, messages.

The energies of reference are written here in principal stretches; W(F + i h E) needs no difference, so it is exact to rounding.
"""

from __future__ import annotations

import numpy as np
import pytest
from energies import series_energy, volume_energy
from support import MOONEY_RIVLIN, YEOH

import explicitfe as fe
from explicitfe.fem.inputs.specimen import SpecimenTable
from explicitfe.fem.materials import law_of
from explicitfe.fem.materials.homogeneous import nominal_slope, nominal_stress
from explicitfe.fem.materials.law import Law
from explicitfe.fem.materials.mooney_rivlin import MooneyRivlin
from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.materials.ogden import Ogden
from explicitfe.fem.materials.stability import loss_of_stability
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.platform.errors import InputError

STEP = 1e-30
STRETCH = np.array([0.4, 0.7, 0.95, 1.0, 1.02, 1.3, 1.8, 2.5])
# Equibiaxial compression to 0.4 stretches the free side 6 times; there a power of 7.5 compresses the volume.
BIAXIAL = STRETCH[1:]
OGDENS = [
    Ogden(mu1_Pa=25e3, alpha1=4.0),
    Ogden(mu1_Pa=800.0, alpha1=1.3, mu2_Pa=200.0, alpha2=-2.0),
    Ogden(mu1_Pa=600.0, alpha1=1.7, mu2_Pa=30.0, alpha2=7.5, mu3_Pa=90.0, alpha3=-3.2),
]
# FEBio's test ma61 has these constants, in its unit of stress.
MA61 = {"C10_Pa": 574.0, "C20_Pa": -74.7, "C30_Pa": 11.3}


def energy(law: Law, stretch: np.ndarray) -> complex:
    """W of three principal stretches [Pa], with the energy of the volume."""
    J = stretch[0] * stretch[1] * stretch[2]
    K = law.constants()[-1]
    if isinstance(law, Ogden):
        isochoric = sum(2.0 * mu / a**2 * ((stretch * J ** (-1.0 / 3.0)) ** a).sum() - 6.0 * mu / a**2 for mu, a in law.terms)
    else:
        series = {name.removesuffix("_Pa"): getattr(law, name) for name in law.reads}
        isochoric = series_energy(**series)(np.diag(stretch))
    return isochoric + volume_energy(K)(np.diag(stretch))


def principal_stress(law: Law, stretch: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress dW/dstretch (3,) Pa, by a complex step."""
    return np.array([energy(law, stretch + 1j * STEP * np.eye(3)[k]).imag / STEP for k in range(3)])


@pytest.mark.parametrize("law", [YEOH, Yeoh(**MA61), MOONEY_RIVLIN, *OGDENS], ids=lambda law: f"{law.law}-{len(law.constants())}")
@pytest.mark.parametrize("mode", ["uniaxial", "biaxial", "planar"])
@pytest.mark.parametrize("poisson", [0.3, 0.499])
def test_stress_is_the_derivative_of_the_energy_and_the_sides_are_free(law, mode, poisson):
    """The free stretch is found here by Newton's method from the energy alone; K (J - 1) is rounded to 1e-9 of the stress."""
    law = law.model_copy(update={"poisson": poisson})
    loaded = [0, 1] if mode == "biaxial" else [0]
    free = {"uniaxial": [1, 2], "biaxial": [2], "planar": [1]}[mode]
    stretches = BIAXIAL if mode == "biaxial" else STRETCH
    stress = nominal_stress(law, mode, stretches)
    for stretch, value in zip(stretches, stress, strict=True):
        state = np.ones(3)
        state[free] = stretch ** {"uniaxial": -0.5, "biaxial": -2.0, "planar": -0.6}[mode]
        state[loaded] = stretch
        for _ in range(60):
            P, h = principal_stress(law, state), 1e-7
            shifted = state.copy()
            shifted[free] *= 1.0 + h
            slope = (principal_stress(law, shifted)[free[0]] - P[free[0]]) / (h * state[free[0]])
            state[free] -= P[free[0]] / slope
        P = principal_stress(law, state)
        assert abs(P[loaded[0]] - value) < 1e-9 * np.abs(stress).max()


@pytest.mark.parametrize("law", OGDENS, ids=["one-term", "two-terms", "three-terms"])
def test_closed_forms_of_an_incompressible_ogden_law(law):
    """P = sum 2 mu / a (l^(a - 1) - l^(-a/2 - 1)) uniaxially, (l^(a - 1) - l^(-2 a - 1)) biaxially (Ogden 1972); shear is exact.

    Poisson's ratio 0.5 is exact. A bar that can change its volume differs by about its J - 1, up to (1 - 2 nu) times strain and
    stiffening, here 1e-4 of the largest stress at a ratio of 0.4999999.
    """
    pairs = law.terms
    uniaxial = sum(2.0 * mu / a * (STRETCH ** (a - 1.0) - STRETCH ** (-a / 2.0 - 1.0)) for mu, a in pairs)
    biaxial = sum(2.0 * mu / a * (BIAXIAL ** (a - 1.0) - BIAXIAL ** (-2.0 * a - 1.0)) for mu, a in pairs)
    planar = sum(2.0 * mu / a * (STRETCH ** (a - 1.0) - STRETCH ** (-a - 1.0)) for mu, a in pairs)
    for poisson, share in ((0.4999999, 1e-4), (0.5, 1e-12)):
        law = law.model_copy(update={"poisson": poisson})
        assert np.abs(nominal_stress(law, "uniaxial", STRETCH) - uniaxial).max() < share * np.abs(uniaxial).max()
        assert np.abs(nominal_stress(law, "biaxial", BIAXIAL) - biaxial).max() < share * np.abs(biaxial).max()
        assert np.abs(nominal_stress(law, "planar", STRETCH) - planar).max() < share * np.abs(planar).max()
    gamma = STRETCH - 1.0 / STRETCH
    shear = sum(2.0 * mu / a * (STRETCH**a - STRETCH**-a) for mu, a in pairs) / (STRETCH + 1.0 / STRETCH)
    assert nominal_stress(law, "shear", gamma) == pytest.approx(shear, rel=1e-12, abs=1e-12)


def test_small_strain_modulus_of_every_law():
    """dP/dstretch = E = 2 G (1 + nu) at rest, and dtau/dgamma = G, with G as the law states it; exact to rounding."""
    for law in [YEOH, Yeoh(**MA61), MOONEY_RIVLIN, *OGDENS]:
        for poisson in (0.2, 0.499):
            law = law.model_copy(update={"poisson": poisson})
            G = law.shear_modulus_Pa
            assert nominal_slope(law, "uniaxial", np.array([1.0]))[1][0] == pytest.approx(2.0 * G * (1.0 + poisson), rel=1e-9)
            assert nominal_slope(law, "shear", np.array([0.0]))[1][0] == pytest.approx(G, rel=1e-12)
    assert OGDENS[2].shear_modulus_Pa == 720.0


def test_special_cases_of_the_ogden_law():
    """alpha = 2 is the neo-Hooke law with C10 = mu / 2; alpha = 2 and -2 is the Mooney-Rivlin law."""
    for mode in ("uniaxial", "biaxial", "shear"):
        neo = nominal_stress(NeoHooke(C10_Pa=500.0), mode, STRETCH)
        assert nominal_stress(Ogden(mu1_Pa=1000.0, alpha1=2.0), mode, STRETCH) == pytest.approx(neo, rel=1e-10, abs=1e-9)
        both = nominal_stress(MooneyRivlin(C10_Pa=500.0, C01_Pa=150.0), mode, STRETCH)
        ogden = Ogden(mu1_Pa=1000.0, alpha1=2.0, mu2_Pa=300.0, alpha2=-2.0)
        assert nominal_stress(ogden, mode, STRETCH) == pytest.approx(both, rel=1e-10, abs=1e-9)


@pytest.mark.parametrize("law", [Yeoh(**MA61), MOONEY_RIVLIN], ids=["yeoh-three-terms", "mooney-rivlin"])
def test_agrees_with_the_compiled_point(law):
    """The kernel finds stress-free sides within 1e-9 of the stiffness of the state."""
    times = np.zeros(len(STRETCH))
    for mode, compiled in (("uniaxial", point.uniaxial), ("biaxial", point.biaxial), ("shear", point.shear)):
        imposed = STRETCH - 1.0 if mode == "shear" else STRETCH
        stress = nominal_stress(law, mode, imposed)
        assert np.abs(compiled(law, (), times, imposed) - stress).max() < 1e-8 * np.abs(stress).max()


def test_slope_is_the_derivative():
    """Against central differences over 1e-5, whose error is some 1e-8 of the slope."""
    for law in OGDENS:
        for mode in ("uniaxial", "biaxial", "planar", "shear"):
            stress, slope = nominal_slope(law, mode, STRETCH)
            low, high = (nominal_stress(law, mode, STRETCH + h) for h in (-1e-5, 1e-5))
            assert stress == pytest.approx(nominal_stress(law, mode, STRETCH), rel=1e-12, abs=1e-9)
            assert slope == pytest.approx((high - low) / 2e-5, rel=1e-6)


# ---- stability ----


def test_febios_three_term_constants_are_accepted_and_stable():
    law = Yeoh(**MA61)
    assert loss_of_stability(law, (0.1, 10.0)) is None
    SpecimenTable(radius_mm=10.0, height_mm=5.0, material=law)


def test_loss_of_stability_has_its_closed_form():
    """Shear stress 2 (C10 + 2 C20 gamma^2) gamma stops increasing at gamma^2 = -C10 / (6 C20), stretch - 1 / stretch = gamma."""
    law = Yeoh.model_construct(law="yeoh", C10_Pa=100.0, C20_Pa=-30.0, C30_Pa=0.0, poisson=0.499)
    gamma = np.sqrt(100.0 / 180.0)
    stretch = 0.5 * (gamma + np.sqrt(gamma**2 + 4.0))
    losses = [loss_of_stability(law, (1.0 / high, high)) for high in (stretch * 0.9, stretch * 1.1, 2.0)]
    found = loss_of_stability(law, (1.0 / (1.001 * stretch), 1.001 * stretch))
    assert losses[2] is not None and found is not None
    # Another load may lose stability before shear does, but none later.
    assert losses[2].stretch <= 1.01 * stretch and 1.0 / found.stretch <= 1.01 * stretch


def test_unstable_constants_are_refused_with_the_stretch():
    with pytest.raises(
        InputError, match=r"Yeoh: with C20_Pa = -60 the law loses stability at a stretch of 1\.\d+ in .*; increase"
    ):
        Yeoh(C10_Pa=100.0, C20_Pa=-60.0)
    assert Yeoh(C10_Pa=100.0, C20_Pa=-2.0).C20_Pa == -2.0
    assert Yeoh(C10_Pa=100.0, C20_Pa=-60.0, C30_Pa=60.0).C30_Pa == 60.0


# ---- constants in Python ----


def test_no_law_has_to_be_named():
    assert fe.NeoHooke(C10_Pa=1.0).law == "neo-hooke"
    assert fe.MooneyRivlin(C10_Pa=1.0, C01_Pa=0.5).law == "mooney-rivlin"
    assert fe.Yeoh(C10_Pa=1.0, C20_Pa=0.5).law == "yeoh"
    assert fe.Ogden(mu1_Pa=1.0, alpha1=3.0).law == "ogden"


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: NeoHooke(C10_Pa=-1.0), r"^NeoHooke: C10_Pa = -1\.0: it must be greater than 0\.$"),
        (lambda: NeoHooke(), r"^NeoHooke: C10_Pa is missing"),
        (lambda: NeoHooke(C20_Pa=3.0, C10_Pa=1.0), r'^NeoHooke: there is no constant "C20_Pa"; did you mean "C10_Pa"\?$'),
        (lambda: NeoHooke(3.0), r"write the constants with their names, such as NeoHooke\(C10_Pa=\.\.\.\)"),
        (lambda: Ogden(mu1_Pa=1.0, alpha1=0.0), r"^Ogden: alpha1 = 0: its magnitude must lie between 0\.01 and 100\.$"),
        (lambda: Yeoh(C10_Pa=float("nan"), C20_Pa=1.0), r"^Yeoh: C10_Pa = nan: it must be a finite number\.$"),
        (lambda: Yeoh(C10_Pa="soft", C20_Pa=1.0), r"^Yeoh: C10_Pa = 'soft': it must be a valid number"),
        (lambda: MooneyRivlin(law="yeoh", C10_Pa=1.0, C01_Pa=1.0), r"^MooneyRivlin: law = 'yeoh': it must be 'mooney-rivlin'\.$"),
    ],
)
def test_wrong_constants_end_in_a_sentence(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_elements_refuse_the_ogden_law_in_a_sentence():
    with pytest.raises(InputError, match="law ogden is available for homogeneous tests only"):
        law_of("ogden")
