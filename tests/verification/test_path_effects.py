"""Effects of the material that depend on the past: power-law, fractional and nonlinear relaxation, permanent set, Payne friction.

Each against a closed form or an equation that is integrated here anew, at a point. In simple shear of amount m, with one
invariant, P_xz = 2 w m and the isochoric stress is all of it.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import erfcx
from support import YEOH

from explicitfe.fem.effects import EFFECTS, with_leaves
from explicitfe.fem.effects.effect import Effect, MaterialEffect
from explicitfe.fem.effects.material.drainage import Drainage
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.fractional import Fractional
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearRelaxation
from explicitfe.fem.effects.material.payne import Payne
from explicitfe.fem.effects.material.permanent_set import PermanentSet
from explicitfe.fem.effects.material.power_law import PowerLaw
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.viscoelastic import PronySeries, Viscoelastic
from explicitfe.fem.forces.response import layout_of
from explicitfe.fem.solve import point
from explicitfe.platform.errors import InputError

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
    """(1 + t / tau)^-n until 10 000 tau, to 4e-4 of the sudden stress: the stated error of the series."""
    time_s, amount = step_and_hold(1e3, 0.3)
    wanted = (1.0 + time_s / 0.1) ** -exponent
    stress = sheared((PowerLaw(exponent=exponent, tau_s=0.1),), time_s, amount)
    error = np.abs(stress[1:] / elastic(amount)[1:] - wanted[1:]).max()
    record_property("error", error)
    assert stress[1] == pytest.approx(elastic(amount)[1], rel=1e-12)  # at once all of it
    assert error < 4e-4


def mittag_leffler(time: np.ndarray, alpha: float) -> np.ndarray:
    """E_alpha(-t^alpha) at times (n,), from its Laplace transform s^(alpha - 1) / (s^alpha + 1).

    The inverse is the midpoint rule on Talbot's contour with the numbers of Trefethen, Weideman & Schmelzer (2006), which
    converges as 3.89^-points. It uses no spectrum of relaxation times.
    """
    points = 24
    theta = np.pi * (2.0 * np.arange(points) + 1.0 - points) / points
    z = points * (0.5017 * theta / np.tan(0.6407 * theta) - 0.6122 + 0.2645j * theta)
    slope = points * (0.5017 / np.tan(0.6407 * theta) - 0.5017 * 0.6407 * theta / np.sin(0.6407 * theta) ** 2 + 0.2645j)
    s = z / time[:, None]
    return ((np.exp(z) * slope * s ** (alpha - 1.0) / (s**alpha + 1.0)).sum(axis=1) / (1j * points * time)).real


def test_the_mittag_leffler_function_of_order_one_half():
    """E_1/2(-x) = exp(x^2) erfc(x)."""
    time = np.geomspace(1e-6, 1e6, 50)
    assert mittag_leffler(time, 0.5) == pytest.approx(erfcx(np.sqrt(time)), abs=1e-11)


@pytest.mark.parametrize("alpha", [0.1, 0.15, 0.25, 0.4, 0.6, 0.8, 0.95])
def test_fractional_relaxation_of_a_step(alpha, record_property):
    """1 - g + g E_alpha(-(t / tau)^alpha) from 1e-6 to 1e4 tau, to 5e-4 of the sudden stress: the stated error of the series."""
    tau, g = 2.5, 0.92
    time_s = np.concatenate([[0.0, 0.0], tau * np.geomspace(1e-6, 1e4, 120)])
    amount = np.where(np.arange(len(time_s)) > 0, 0.3, 0.0)
    stress = sheared((Fractional(g=g, alpha=alpha, tau_s=tau),), time_s, amount)
    wanted = 1.0 - g + g * mittag_leffler(time_s[2:] / tau, alpha)
    error = np.abs(stress[2:] / elastic(amount)[2:] - wanted).max()
    record_property("error", error)
    assert stress[1] == pytest.approx(elastic(amount)[1], rel=1e-12)
    assert error < 5e-4


def test_fractional_relaxation_of_a_ramp(record_property):
    """Ramp and hold of a linear solid: the stress is the integral of the relaxation function over the time since each strain."""
    tau, g, alpha, rate = 2.5, 0.92, 0.25, 1e-3
    time_s = np.linspace(0.0, 60.0, 601)
    amount = rate * np.minimum(time_s, 20.0)
    stress = sheared((Fractional(g=g, alpha=alpha, tau_s=tau),), time_s, amount)
    age = np.concatenate([[0.0], np.geomspace(1e-8, 60.0, 20001)])
    function = np.concatenate([[1.0], 1.0 - g + g * mittag_leffler(age[1:] / tau, alpha)])
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (function[1:] + function[:-1]) * np.diff(age))])
    wanted = 2.0 * C10 * rate * (np.interp(time_s, age, integral) - np.interp(np.maximum(time_s - 20.0, 0.0), age, integral))
    error = np.abs(stress - wanted).max() / (2.0 * C10 * amount.max())
    record_property("error", error)
    assert error < 5e-4 + 2.0 * C20 * amount.max() ** 2 / C10  # the series, and the share of the sudden stress that C20 adds


@pytest.mark.parametrize(
    "effect",
    [
        Viscoelastic(g=(0.2, 0.3), tau_s=(0.1, 5.0)),
        PowerLaw(exponent=0.2, tau_s=0.1),
        Fractional(g=0.9, alpha=0.3, tau_s=1.0),
        *with_leaves((Viscoelastic(g=(0.2,), tau_s=(0.1,)), NonlinearRelaxation(exponent=2.0))),
        Softening(inverse_r=0.3, m_Pa=5.0),
        Drainage(share=0.5, tau_s=2.0),
    ],
    ids=["viscoelastic", "power-law", "fractional", "nonlinear-relaxation", "softening", "drainage"],
)
def test_numbers_of_several_increments(effect):
    increments = np.array([0.0, 1e-320, 1e-9, 0.3, 1e6])
    several = effect.values_along(increments)
    assert several.shape == (len(increments), effect.numbers)
    assert several == pytest.approx(np.array([effect.values(float(increment)) for increment in increments]), rel=1e-15)
    assert np.isfinite(several).all()
    if isinstance(effect, PronySeries):  # stress is there at once, and what a very long increment adds is left
        assert several[0, 0] + several[0, 1 + len(effect.head) :: 3].sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("effect", [PowerLaw(exponent=0.0, tau_s=0.1), Fractional(g=0.0, alpha=0.3, tau_s=0.1)])
def test_no_strength_is_no_relaxation(effect):
    time_s, amount = step_and_hold(1e3, 0.3)
    assert sheared((effect,), time_s, amount) == pytest.approx(elastic(amount), rel=1e-12)


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
