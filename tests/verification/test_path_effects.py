"""Effects of the material that look at the past: power-law and nonlinear relaxation, permanent set, friction inside the tissue.

Each against a closed form or an equation that is integrated here anew, at a point. In simple shear of amount m, with one
invariant, P_xz = 2 w m and the isochoric stress is all of it.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support import YEOH

from explicitfe.effects import EFFECTS, with_leaves
from explicitfe.effects.effect import Effect, MaterialEffect
from explicitfe.effects.material.fibres import Fibres
from explicitfe.effects.material.nonlinear_relaxation import NonlinearRelaxation
from explicitfe.effects.material.payne import Payne
from explicitfe.effects.material.permanent_set import PermanentSet
from explicitfe.effects.material.power_law import PowerLaw
from explicitfe.effects.material.softening import Softening
from explicitfe.effects.material.viscoelastic import Viscoelastic
from explicitfe.errors import InputError
from explicitfe.forces.response import layout_of
from explicitfe.solve import point

C10, C20, *_ = YEOH.constants()


def sheared(effects: tuple[Effect, ...], time_s: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """Shear stress [Pa] from rest on."""
    return point.shear(YEOH, with_leaves(effects), time_s, amount)


def elastic(amount: np.ndarray) -> np.ndarray:
    return 2.0 * (C10 + 2.0 * C20 * amount**2) * amount


def step_and_hold(until_s: float, amount: float) -> tuple[np.ndarray, np.ndarray]:
    """A shear that comes at once, and is held: instants dense on a logarithmic axis."""
    time_s = np.concatenate([[0.0, 0.0], np.geomspace(1e-3, until_s, 60)])
    return time_s, np.where(np.arange(len(time_s)) > 0, amount, 0.0)


@pytest.mark.parametrize("exponent", [0.03, 0.2, 0.5])
def test_power_law_of_a_step(exponent, record_property):
    """(1 + t / tau)^-n until 10 000 tau, to 1.2 %: the error of eight terms."""
    time_s, amount = step_and_hold(1e3, 0.3)
    wanted = (1.0 + time_s / 0.1) ** -exponent * elastic(amount)
    stress = sheared((PowerLaw(exponent=exponent, tau_s=0.1),), time_s, amount)
    error = np.abs(stress[1:] / wanted[1:] - 1.0).max()
    record_property("error", error)
    assert stress[1] == pytest.approx(elastic(amount)[1], rel=1e-12)  # at once all of it
    assert error < 0.012


def test_no_exponent_is_no_relaxation():
    time_s, amount = step_and_hold(1e3, 0.3)
    assert sheared((PowerLaw(exponent=0.0, tau_s=0.1),), time_s, amount) == pytest.approx(elastic(amount), rel=1e-12)


@pytest.mark.parametrize("exponent", [-4.0, 0.0, 4.0])
def test_branches_that_stiffen_in_their_own_way(exponent):
    """A step of shear m: (1 - g) + g (1 + m^2 / 3)^k of the elastic stress at once, of which the branch fades with tau."""
    g, tau = 0.4, 2.0
    time_s, amount = step_and_hold(10.0, 0.8)
    effects = (Viscoelastic(g=(g,), tau_s=(tau,)), NonlinearRelaxation(exponent=exponent))
    branch = g * (1.0 + 0.8**2 / 3.0) ** exponent * np.exp(-time_s / tau)
    assert sheared(effects, time_s, amount)[1:] == pytest.approx(((1.0 - g + branch) * elastic(amount))[1:], rel=1e-9)


def network(path: np.ndarray) -> np.ndarray:
    """Stress over G2 of the network that forms anew, in incompressible uniaxial stretches that change from one entry to the next.

    A is diagonal, (a, b, b). While x = stretch^2 + 2 / stretch - 3 is larger than ever, dA = 4 (C^-1 - A) dx / x.
    """
    A, largest, stresses = np.ones(2), 0.0, [0.0]
    for before, stretch in itertools.pairwise(path):

        def x(s: float) -> float:
            return s**2 + 2.0 / s - 3.0

        def slope(s: float, A: np.ndarray) -> np.ndarray:
            return 4.0 * (np.array([s**-2.0, s]) - A) * (2.0 * s - 2.0 / s**2) / x(s)

        if x(stretch) > largest:
            if largest == 0.0:  # near rest A follows the strain e: 1 - A = 8/9 of (2 e, -e)
                before = 1.0 + 1e-4 * np.sign(stretch - 1.0)
                A = 1.0 + 8.0 / 9.0 * (np.array([before**-2.0, before]) - 1.0)
            A = solve_ivp(slope, (before, stretch), A, rtol=1e-9, atol=1e-12).y[:, -1]
            largest = x(stretch)
        stresses.append(A[0] * stretch - A[1] / stretch**2)  # W2 = G2 / 2 (a stretch^2 + 2 b / stretch - 3)
    return np.array(stresses)


@pytest.mark.parametrize("top", [1.4, 0.7])
def test_permanent_set_follows_its_equation(top, record_property):
    """Up, back, and up beyond, against the equation integrated by Runge and Kutta; then what stays at no load."""
    corners = np.array([1.0, 1.0 + 0.6 * (top - 1.0), 1.0, top, 1.0])
    G2 = 200.0
    path = np.concatenate([[1.0], *(np.linspace(a, b, 401)[1:] for a, b in itertools.pairwise(corners))])
    stress = point.uniaxial(YEOH, (PermanentSet(modulus_Pa=G2),), np.arange(len(path), dtype=float), path)
    own = stress - point.uniaxial(YEOH, (), np.arange(len(path), dtype=float), path)
    wanted = G2 * network(path)
    error = np.abs(own - wanted).max() / np.abs(wanted).max()
    record_property("error", error)
    assert error < 0.02  # steps of 1/400, and a bulk modulus of 500 times the shear modulus
    # At the end of the way back, without strain, the specimen pushes towards the shape in which the network formed.
    assert np.sign(stress[-1]) == -np.sign(top - 1.0)


def test_permanent_set_grows_with_the_largest_strain_and_not_with_time():
    def residue(top: float, seconds: float) -> float:
        path = np.concatenate([np.linspace(1.0, top, 101), np.linspace(top, 1.0, 101)[1:]])
        stress = point.uniaxial(YEOH, (PermanentSet(modulus_Pa=200.0),), np.linspace(0.0, seconds, len(path)), path)[101:]
        return float(np.interp(0.0, stress[::-1], path[101:][::-1])) - 1.0

    small, large = residue(1.2, 1.0), residue(1.4, 1.0)
    assert 0.01 < small < 0.6 * large
    assert residue(1.4, 1000.0) == pytest.approx(large, rel=1e-12)


def test_payne_is_a_spring_that_slides(record_property):
    """Prandtl's element at small shear: G + 2 C10 up to the yield, then 2 C10; a cycle of amplitude a loses 4 G y (a - y)."""
    G, y, a = 300.0, 0.004, 0.02
    time_s = np.linspace(0.0, 5.0, 2001)
    amount = np.interp(time_s, [0.0, 1.0, 3.0, 5.0], [0.0, a, -a, a])
    own = sheared((Payne(modulus_Pa=G, yield_shear=y),), time_s, amount) - elastic(amount)
    assert own[:401] == pytest.approx(G * np.minimum(amount, y)[:401], rel=2e-3, abs=1e-3)
    cycle = slice(400, None)
    lost = float(np.sum(0.5 * (own[cycle][1:] + own[cycle][:-1]) * np.diff(amount[cycle])))
    record_property("lost", lost / (4.0 * G * y * (a - y)))
    assert lost == pytest.approx(4.0 * G * y * (a - y), rel=5e-3)


@pytest.mark.parametrize(
    "effects",
    [(PermanentSet(modulus_Pa=0.0),), (Payne(modulus_Pa=0.0, yield_shear=0.05),)],
    ids=["permanent-set", "payne"],
)
def test_no_modulus_is_no_effect(effects):
    time_s = np.linspace(0.0, 2.0, 41)
    amount = np.interp(time_s, [0.0, 1.0, 2.0], [0.0, 0.5, -0.2])
    assert sheared(effects, time_s, amount) == pytest.approx(elastic(amount), rel=1e-12, abs=1e-12)


def test_set_friction_and_fibres_share_a_body():
    """They stand beside each other in one slot, and their stresses add up."""
    time_s = np.linspace(0.0, 2.0, 41)
    amount = np.interp(time_s, [0.0, 1.0, 2.0], [0.0, 0.5, 0.1])
    parts: list[MaterialEffect] = [
        PermanentSet(modulus_Pa=100.0),
        Payne(modulus_Pa=80.0, yield_shear=0.1),
        Fibres(k1_Pa=50.0, k2=0.5, direction=(0.0, 0.0, 1.0)),
    ]
    own = [sheared((part,), time_s, amount) - elastic(amount) for part in parts]
    assert sheared(tuple(parts), time_s, amount) - elastic(amount) == pytest.approx(sum(own), abs=1e-9)


def test_what_cannot_be_combined_is_refused():
    series, power = Viscoelastic(g=(0.2,), tau_s=(1.0,)), PowerLaw(exponent=0.1, tau_s=1.0)
    with pytest.raises(InputError, match="viscoelastic relaxation and power-law relaxation cannot be combined"):
        layout_of((series, power))
    with pytest.raises(InputError, match="add viscoelastic"):
        with_leaves((Softening(inverse_r=0.2, m_Pa=5.0), NonlinearRelaxation(exponent=1.0)))


def test_an_extension_comes_after_what_it_extends():
    """In the table of all effects, which is the order in which a body gets them."""
    names = list(EFFECTS)
    extensions = {name: kind.extends for name, kind in EFFECTS.items() if kind.extends}
    assert extensions
    assert all(names.index(base) < names.index(name) for name, base in extensions.items())
