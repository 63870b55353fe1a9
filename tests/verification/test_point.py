"""Homogeneous states of one point against closed forms, and against one element that is given the same deformation.

The closed forms are written here, not taken from the code: with b_bar = J^(-2/3) F F^T and w = dW/dI1_bar,

    J sigma = 2 w dev b_bar + J U'(J) 1,  P = J sigma F^-T,  U' = K/2 (J - 1/J)

and, where W depends on I2_bar too, v = dW/dI2_bar, 2 v dev (tr b_bar b_bar - b_bar^2) more

(Bonet & Wood 2008, section 6.5); stress-free directions give the free stretch by ``brentq``. For a volume that does not change,
b_bar = b and the pressure follows from the free face alone (Holzapfel 2000, section 6.5).
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.optimize import brentq
from support import LAWS, YEOH, block_mesh, model_of, random_gradient

from explicitfe.fem.effects.material.drainage import Drainage
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.errors import RunError

# The order and the kinds are those of test_effects.py: one compilation serves both files.
EFFECTS = (
    Viscoelastic(g=(0.3, 0.1, 0.2), tau_s=(0.05, 0.3, 2.0)),
    Softening(inverse_r=0.5, m_Pa=20.0, beta=0.1),
    ThirdYeoh(C30_Pa=50.0),
    Fibres(k1_Pa=200.0, k2=0.5, direction=(1.0, 2.0, 2.0)),
    Drainage(share=0.4, tau_s=0.5),
)
EVERY_LAW = pytest.mark.parametrize("law", list(LAWS))
C10 = 191.5
STRETCHES = np.concatenate([np.linspace(0.4, 0.98, 15), np.linspace(1.02, 3.0, 25)])


def slope(law: str, I1_bar: float) -> float:
    """dW/dI1_bar [Pa]."""
    return C10 - second_slope(law) + (2.0 * 90.6 * (I1_bar - 3.0) if law == "yeoh" else 0.0)


def second_slope(law: str) -> float:
    """dW/dI2_bar [Pa]."""
    return 70.0 if law == "mooney-rivlin" else 0.0


def deviator(A: np.ndarray) -> np.ndarray:
    return A - np.trace(A) / 3.0 * np.eye(3)


def closed_form(law: str, F: np.ndarray, K: float) -> np.ndarray:
    """First Piola-Kirchhoff stress (3, 3) Pa."""
    J = np.linalg.det(F)
    b = J ** (-2.0 / 3.0) * F @ F.T
    kirchhoff = 2.0 * slope(law, np.trace(b)) * deviator(b) + 2.0 * second_slope(law) * deviator(np.trace(b) * b - b @ b)
    kirchhoff += 0.5 * K * (J * J - 1.0) * np.eye(3)
    return kirchhoff @ np.linalg.inv(F).T


def gradient(test: str, value: float, free: float) -> np.ndarray:
    if test == "uniaxial":
        return np.diag([free, free, value])
    if test == "biaxial":
        return np.diag([value, value, free])
    return np.array([[1.0, 0.0, value], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def expected(test: str, law: str, value: float) -> float:
    """The stress that a test gives, the free stretch by bracketing: J is between 0.2 and 2 wherever these laws are used."""
    K = LAWS[law].constants()[-1]
    if test == "shear":
        return closed_form(law, gradient(test, value, 1.0), K)[0, 2]
    at, face, power = (2, 0, 0.5) if test == "uniaxial" else (0, 2, 1.0)
    held = value if test == "uniaxial" else value * value
    free = brentq(
        lambda s: closed_form(law, gradient(test, value, s), K)[face, face],
        (0.2 / held) ** power,
        (2.0 / held) ** power,
        xtol=1e-15,
        rtol=4 * np.finfo(float).eps,
    )
    return closed_form(law, gradient(test, value, free), K)[at, at]


@EVERY_LAW
@pytest.mark.parametrize("test", ["uniaxial", "biaxial", "shear"])
def test_elastic_point_equals_the_closed_form(test, law, record_property):
    """Stretches of 0.4 to 3, shears up to 3, nu = 0.499: the closed form above, free stretch solved independently.

    The free faces are left with 1e-9 G, which moves the stress by about as much: 1e-9 G / 1e-2 G at the smallest strain of
    2 %: 1e-7. 1e-6 of the stress.
    """
    values = np.linspace(0.02, 3.0, 30) if test == "shear" else STRETCHES
    stress = getattr(point, test)(LAWS[law], (), np.zeros(len(values)), values)
    wanted = np.array([expected(test, law, value) for value in values])
    worst = np.abs(stress / wanted - 1.0).max()
    record_property("off by", worst)
    assert worst < 1e-6


@EVERY_LAW
def test_elastic_point_is_near_the_incompressible_one(law):
    """Without a change of volume P = 2 (w + v / l) (l - l^-2) uniaxially, 2 (w + v l^2) (l - l^-5) biaxially, and
    2 (w + v) gamma in shear (Holzapfel 2000, section 6.5), with v = dW/dI2_bar.

    What nu = 0.4999 leaves is J - 1 = p / K, with p of the size of the stress: between 0.8 and 1.5 the Cauchy stress is below
    2 800 Pa, 1.5e-3 of K = 1.9e6 Pa, and stress changes with the free stretch a few times faster than that stretch: 1 %.
    In shear J = 1 and the forms agree to rounding.
    """
    material = LAWS[law].model_copy(update={"poisson": 0.4999})
    values = np.array([0.8, 0.9, 1.1, 1.25, 1.5])
    at = np.zeros(len(values))
    first = values**2 + 2.0 / values
    uniaxial = 2.0 * (slope(law, first) + second_slope(law) / values) * (values - values**-2)
    assert point.uniaxial(material, (), at, values) == pytest.approx(uniaxial, rel=0.01)
    first = 2.0 * values**2 + values**-4
    biaxial = 2.0 * (slope(law, first) + second_slope(law) * values**2) * (values - values**-5)
    assert point.biaxial(material, (), at, values) == pytest.approx(biaxial, rel=0.01)
    amounts = np.array([0.1, 0.5, 2.0])
    assert point.shear(material, (), np.zeros(len(amounts)), amounts) == pytest.approx(
        2.0 * (slope(law, 3.0 + amounts**2) + second_slope(law)) * amounts, rel=1e-12
    )


@pytest.mark.parametrize("effects", [(), EFFECTS], ids=["elastic", "all-effects"])
def test_free_faces_carry_no_stress(effects, record_property):
    """Along stretch paths of 0.4 to 3 the free diagonal stresses are below the stated 1e-9 of the stiffness; what is held stays.

    The stiffness is the largest stress or 2 dW/dI1_bar, of which softening and relaxation leave less than the law and C30 give.
    """
    time_s = np.linspace(0.0, 3.0, 120)
    stretch = np.interp(time_s, [0.0, 0.7, 1.0, 2.0, 3.0], [1.0, 0.4, 0.4, 3.0 if not effects else 1.8, 0.9])
    worst = 0.0
    for held, free in (([1], [0, 2]), ([0, 1], [2])):
        F = np.tile(np.eye(3), (len(stretch), 1, 1))
        F[:, held, held] = (stretch if held == [1] else np.minimum(stretch, 1.6))[:, None]
        P, gradients = point.path(YEOH, effects, time_s, F, free)
        assert np.array_equal(gradients[:, held, held], F[:, held, held])
        J = np.linalg.det(gradients)
        assert (J > 0.0).all()
        I1_bar = J ** (-2.0 / 3.0) * (gradients**2).sum(axis=(1, 2))
        modulus = 2.0 * (slope("yeoh", I1_bar) + (3.0 * 50.0 * (I1_bar - 3.0) ** 2 if effects else 0.0))
        stiffness = np.maximum(modulus, np.abs(P).max(axis=(1, 2)))
        worst = max(worst, (np.abs(P[:, free, free]).max(axis=1) / (point.STRESS_TOLERANCE * stiffness)).max())
    record_property("largest stress / allowed", worst)
    assert worst <= 1.0


@pytest.mark.parametrize("C10_Pa", [1e-4, 1e-2, 1.0])
def test_a_tissue_that_is_soft_at_rest(C10_Pa):
    """C20 alone carries the load, and K = 1e8 Pa keeps the volume: the stress is that of the incompressible law.

    J - 1 = p / K is below 1e-4, and moves the stress a few times as much. What rounding leaves of K is far more than 1e-9 of the
    modulus at rest. It counts as no stress on the lateral faces, and so may stand in that along the load.
    """
    law = Yeoh(C10_Pa=C10_Pa, C20_Pa=1000.0, poisson=0.5 * (1.0 - 2.0 * C10_Pa / 1e8))
    stretch = np.array([1.0, 0.999, 0.9, 0.6, 1.4])
    wanted = 2.0 * (C10_Pa + 2000.0 * (stretch**2 + 2.0 / stretch - 3.0)) * (stretch - stretch**-2)
    stress = point.uniaxial(law, (), np.zeros(len(stretch)), stretch)
    assert stress == pytest.approx(wanted, rel=1e-3, abs=1e8 * point.PRESSURE_ROUNDING)


def element_path(effects: tuple, time_s: np.ndarray, F: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress (n, 3, 3) Pa of one cubic element: forces on its faces at x, y, z = h, over the area."""
    edge = 0.01
    mesh = block_mesh((1, 1, 1), edge, distort=0.0)
    body = Simulation(model_of(mesh, effects=effects))
    stress = []
    for instant, gradient_now in enumerate(F):
        body.set_increment(time_s[instant] - time_s[max(instant - 1, 0)])
        force = body.internal_force(mesh.points @ (gradient_now - np.eye(3)).T)
        body.blocks.old[:] = body.blocks.new
        stress.append(np.column_stack([force[mesh.node_sets[f"{axis}1"]].sum(axis=0) for axis in "xyz"]) / edge**2)
    return np.array(stress)


@pytest.mark.parametrize("effects", [(), EFFECTS], ids=["elastic", "all-effects"])
def test_point_equals_one_element(effects, record_property):
    """The same F at the same instants, uneven in time, given to one element whose memory is advanced by hand: the same P.

    Two entries to one response. The element's F is rounded by a few eps and K loads that: 10 eps K = 4e-10 Pa, against
    stresses of K |J - 1| = 1e4 Pa: 1e-13; 1e-12 of the largest.
    """
    rng = np.random.default_rng(3)
    time_s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.001, 0.3, 30))])
    F = np.array([np.eye(3), *(random_gradient(rng, 0.25) for _ in range(30))])
    P, given = point.path(YEOH, effects, time_s, F, [])
    assert np.array_equal(given, F)
    worst = np.abs(P - element_path(effects, time_s, F)).max() / np.abs(P).max()
    record_property("off by", worst)
    assert worst < 1e-12


@pytest.mark.parametrize(
    ("test", "stretch"),
    [("uniaxial", -0.5), ("uniaxial", 0.0), ("uniaxial", np.nan), ("biaxial", -0.5), ("biaxial", np.nan), ("shear", np.nan)],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_impossible_states_are_refused(test, stretch):
    """No body has J <= 0: such an instant, at the beginning or later, is an error, never a number and never a NaN."""
    begin = 0.0 if test == "shear" else 1.0
    for path in ([stretch], [begin, stretch, begin]):
        with pytest.raises(RunError):
            getattr(point, test)(YEOH, (), np.zeros(len(path)), np.array(path))


def test_too_large_a_deformation_is_refused():
    """Fibres of k2 = 50 at 3 times their length: exp(50 x 3^2) Pa or more, which nothing balances. The error says when."""
    fibres = Fibres(k1_Pa=2e4, k2=50.0)
    with pytest.raises(RunError, match="at 2 s"):
        point.uniaxial(YEOH, (*EFFECTS[:3], fibres, EFFECTS[4]), np.array([0.0, 1.0, 2.0]), np.array([1.0, 1.01, 3.0]))


def test_a_path_takes_milliseconds(record_property):
    """400 instants with all effects and two free faces, compiled: a few milliseconds; 50 ms is the loose bound."""
    time_s = np.linspace(0.0, 10.0, 400)
    stretch = 1.0 - 0.4 * np.sin(time_s) ** 2
    point.uniaxial(YEOH, EFFECTS, time_s, stretch)
    taken = []
    for _ in range(5):
        begin = time.perf_counter()
        point.uniaxial(YEOH, EFFECTS, time_s, stretch)
        taken.append(1e3 * (time.perf_counter() - begin))
    record_property("ms", min(taken))
    assert min(taken) < 50.0
