"""Laws of I1_bar and I2_bar: Mooney-Rivlin in every element, at a point and with every effect, against its energy.

The reference is the energy alone, in numpy, differentiated by a complex step (tests/energies.py); C10 = 121.5 Pa, C01 = 70 Pa,
nu = 0.499.

Tolerance: K |J - 1| = 1e4 to 1e5 Pa is rounded by some 100 eps in F and J, 2e-14 of it; 1e-9 of the largest stress is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
import pytest
from energies import derivative, series_energy, volume_energy
from scipy.special import erf
from support import (
    ELEMENTS,
    MOONEY_RIVLIN,
    NEO_HOOKE,
    ROOT,
    YEOH,
    block_mesh,
    model_of,
    random_gradient,
    random_rotation,
    stiffness_matrix,
)

from explicitfe.fem.effects.effect import MaterialEffect
from explicitfe.fem.effects.material.drainage import Drainage
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.materials import mooney_rivlin
from explicitfe.fem.materials.law import Law, leaves_of
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.errors import InputError
from explicitfe.simulate.scenario.read import read_scenario

C10, C01, K = MOONEY_RIVLIN.constants()
# One order and one number of terms, as in test_effects.py.
NONE: tuple[MaterialEffect, ...] = (
    ThirdYeoh(C30_Pa=0.0),
    Viscoelastic(g=(0.0, 0.0, 0.0), tau_s=(0.05, 0.3, 2.0)),
    Softening(inverse_r=0.0, m_Pa=20.0),
    Drainage(share=0.0, tau_s=0.5),
    Fibres(k1_Pa=0.0, direction=(1.0, 2.0, 2.0)),
)
SOME: tuple[MaterialEffect, ...] = (
    ThirdYeoh(C30_Pa=50.0),
    Viscoelastic(g=(0.3, 0.1, 0.2), tau_s=(0.05, 0.3, 2.0)),
    Softening(inverse_r=0.5, m_Pa=20.0, beta=0.1),
    Drainage(share=0.4, tau_s=0.5),
    Fibres(k1_Pa=200.0, k2=0.5, direction=(1.0, 2.0, 2.0)),
)
FIBRE = np.array([1.0, 2.0, 2.0]) / 3.0


law_energy = series_energy(C10, C01=C01)


def fibre_energy(F: np.ndarray) -> complex:
    """Of the fibres [Pa]."""
    a = F @ FIBRE
    beyond = (a @ a) * np.linalg.det(F) ** (-2.0 / 3.0) - 1.0
    return 200.0 / (2.0 * 0.5) * (np.exp(0.5 * beyond**2) - 1.0) if beyond.real > 0.0 else 0.0j


def elastic(F: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress (3, 3) Pa of the law."""
    return derivative(F, law_energy, volume_energy(K))


def states(seed: int, count: int = 12, size: float = 0.35) -> np.ndarray:
    """Deformation gradients (count, 3, 3), turned at random."""
    rng = np.random.default_rng(seed)
    return np.array([random_rotation(rng) @ random_gradient(rng, size) for _ in range(count)])


def relative(values: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(values - wanted).max() / np.abs(wanted).max())


def element_stress(element: str, effects: Sequence[MaterialEffect], F: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress (n, 3, 3) Pa of one cubic element, from the forces on its faces; each state is sudden."""
    edge = 0.01
    mesh = block_mesh((1, 1, 1), edge, distort=0.0)
    stress = []
    for gradient in F:
        body = Simulation(model_of(mesh, MOONEY_RIVLIN, element=element, effects=tuple(effects)))
        force = body.internal_force(mesh.points @ (gradient - np.eye(3)).T)
        stress.append(np.column_stack([force[mesh.node_sets[f"{axis}1"]].sum(axis=0) for axis in "xyz"]) / edge**2)
    return np.array(stress)


# ---- the law alone ----


@pytest.mark.parametrize("effects", [(), NONE], ids=["elastic", "effects-of-no-strength"])
def test_a_point_has_the_stress_of_the_energy(effects, record_property):
    F = states(1)
    P, _ = point.path(MOONEY_RIVLIN, effects, np.zeros(len(F)), F, [])
    off = relative(P, np.array([elastic(A) for A in F]))
    record_property("off by", off)
    assert off < 1e-9


@pytest.mark.parametrize(
    ("element", "effects"),
    [*((element, ()) for element in ELEMENTS), ("hex8", NONE), ("hex8-stiffness", NONE)],
    ids=[*ELEMENTS, "hex8-effects-of-no-strength", "hex8-stiffness-effects-of-no-strength"],
)
def test_every_element_has_the_stress_of_the_energy(element, effects, record_property):
    """One cube under an affine deformation: what its faces bear, over their area."""
    F = states(2)
    off = relative(element_stress(element, effects, F), np.array([elastic(A) for A in F]))
    record_property("off by", off)
    assert off < 1e-9


def test_closed_forms_without_a_change_of_volume(record_property):
    """sigma_zz - sigma_xx = 2 (C10 + C01 / l) (l^2 - 1 / l) uniaxially, 2 (C10 + C01 l^2) (l^2 - l^-4) biaxially, and
    sigma_xz = 2 (C10 + C01) gamma in shear (Holzapfel 2000, section 6.5): F is given and J = 1, so K has no part in it.
    """
    worst = 0.0
    for l in (0.5, 0.8, 1.2, 2.0, 3.0):  # noqa: E741
        for F, wanted in (
            (np.diag([l**-0.5, l**-0.5, l]), 2.0 * (C10 + C01 / l) * (l**2 - 1.0 / l)),
            (np.diag([l**-2, l, l]), 2.0 * (C10 + C01 * l**2) * (l**2 - l**-4)),
        ):
            P, _ = point.path(MOONEY_RIVLIN, (), np.zeros(1), F[None], [])
            sigma = P[0] @ F.T
            worst = max(worst, abs((sigma[2, 2] - sigma[0, 0]) / wanted - 1.0))
        sheared = point.shear(MOONEY_RIVLIN, (), np.zeros(1), np.array([l]))[0]
        worst = max(worst, abs(sheared / (2.0 * (C10 + C01) * l) - 1.0))
    record_property("off by", worst)
    assert worst < 1e-9


@pytest.mark.parametrize("element", ELEMENTS)
def test_bends_as_the_equal_neo_hooke_does(element, record_property):
    """At small strain both invariants are 3 + 2 e:e: every stiffness of a distorted body, that of hourglass modes too, is that
    of the neo-Hooke law with C10 + C01, the same shear and bulk modulus.

    Central differences over 1e-6 h: third derivatives differ, 1e-12 relative, and rounding is eps / 1e-6 = 2e-10 of the
    largest entry, K h; hourglass stiffness is G h, K / 500. 1e-8 of the largest entry, 2e-6 of the hourglass energy.
    """
    mesh = block_mesh((2, 1, 1), seed=3)
    assert MOONEY_RIVLIN.shear_modulus_Pa == NEO_HOOKE.shear_modulus_Pa
    undeformed = np.zeros_like(mesh.points)
    ours, wanted = (
        stiffness_matrix(Simulation(model_of(mesh, law, element=element)), undeformed) for law in (MOONEY_RIVLIN, NEO_HOOKE)
    )
    off = relative(ours, wanted)
    record_property("off by", off)
    assert off < 1e-8
    soft = np.linalg.eigvalsh(0.5 * (wanted + wanted.T))[6:]  # the lowest ones after rigid motion bend and twist
    also = np.linalg.eigvalsh(0.5 * (ours + ours.T))[6:]
    assert np.abs(also / soft - 1.0).max() < 2e-6


def test_pressure_is_higher_the_more_the_second_invariant_counts():
    """The two laws are not the same: stretched to 1.5 sideways, the second invariant bears 1.5^2 times as much (biaxial form)."""
    stretch, at = np.array([1.5]), np.zeros(1)
    ratio = point.biaxial(MOONEY_RIVLIN, (), at, stretch)[0] / point.biaxial(NEO_HOOKE, (), at, stretch)[0]
    assert ratio == pytest.approx((C10 + C01 * 1.5**2) / (C10 + C01), rel=0.01)  # what J - 1 of nu = 0.499 leaves


# ---- with effects ----


def test_all_effects_at_once_and_after_long(record_property):
    """A sudden load is elastic: law, third Yeoh term and fibres. Long after, of the isochoric stress 1 - sum g is left, of the
    pressure 1 - d. Tolerance as above; after 1e4 times the longest relaxation time.
    """
    series, drainage = SOME[1], SOME[3]
    assert isinstance(series, Viscoelastic)
    assert isinstance(drainage, Drainage)
    long = 1e4 * max(series.tau_s)
    worst = 0.0
    for F in states(5, size=0.25):
        path = np.array([np.eye(3), F, F])
        P, _ = point.path(MOONEY_RIVLIN, SOME, np.array([0.0, 0.0, long]), path, [])
        isochoric = derivative(F, series_energy(C10, C01=C01, C30=50.0), fibre_energy)
        pressure = derivative(F, volume_energy(K))
        worst = max(worst, relative(P[1], isochoric + pressure))
        wanted = (1.0 - sum(series.g)) * isochoric + (1.0 - drainage.share) * pressure
        worst = max(worst, relative(P[2], wanted))
    record_property("off by", worst)
    assert worst < 1e-9


def test_softening_sees_the_whole_energy(record_property):
    """Back from l = 1.8: eta = 1 - erf((Wm - W) / (m + beta Wm)) / r with W of both invariants (Ogden & Roxburgh 1999)."""
    softening = SOME[2]
    assert isinstance(softening, Softening)
    stretch = np.concatenate([np.linspace(1.0, 1.8, 9), np.linspace(1.7, 1.1, 7)])
    F = np.array([np.diag([l**-0.5, l**-0.5, l]) for l in stretch])  # noqa: E741
    P, _ = point.path(MOONEY_RIVLIN, (softening,), np.zeros(len(F)), F, [])
    W = np.array([law_energy(A).real for A in F])
    largest = np.maximum.accumulate(W)
    eta = 1.0 - softening.inverse_r * erf((largest - W) / (softening.m_Pa + softening.beta * largest))
    assert eta.min() < 0.7
    wanted = np.array([e * derivative(A, law_energy) for e, A in zip(eta, F, strict=True)])
    off = relative(P, wanted)
    record_property("off by", off)
    assert off < 1e-9


# ---- what is refused ----


def test_a_law_of_other_invariants_is_refused():
    class OfFibres(Law):
        invariants: ClassVar[tuple[str, ...]] = ("I1", "I4")
        reads: ClassVar[tuple[str, ...]] = ()

        law: Literal["of-fibres"] = "of-fibres"

        @property
        def shear_modulus_Pa(self) -> float:
            return 1.0

    with pytest.raises(InputError, match=r"OfFibres: no element knows a law of I1 and I4; .*I1 and I2"):
        leaves_of(OfFibres, mooney_rivlin)


def test_scenarios_take_the_law():
    """By its name; a misspelt constant is refused with the keys of this law and of no other."""
    path = ROOT / "scenarios" / "vowel-i.toml"
    law = '{law="mooney-rivlin", C10_Pa=121.5, %s=70.0}'
    scenario, _ = read_scenario(path, ["model.material=" + law % "C01_Pa"])
    assert scenario.model.material == MOONEY_RIVLIN
    with pytest.raises(InputError, match=r'"stiffness".*valid are: C01_Pa, C10_Pa, density_kg_m3, law, poisson, source'):
        read_scenario(path, ["model.material=" + law % "stiffness"])


def test_a_layer_scales_stresses_only():
    """Constants that are no stress, such as an exponent, stay as they are in stiffer elements."""

    class Stiffening(type(YEOH)):  # type: ignore[misc]
        reads: ClassVar[tuple[str, ...]] = ("C10_Pa", "poisson")

    law = Stiffening(C10_Pa=10.0, C20_Pa=0.0)
    own = np.array([law.constants(), law.constants()])
    scaled = law.scaled(own, np.array([1.0, 3.0]))
    assert np.array_equal(scaled[0], own[0])
    assert np.array_equal(scaled[1], own[1] * [3.0, 1.0, 3.0])
