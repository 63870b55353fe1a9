"""Two effects in one slot of the response: they add up, or they are refused when the model is built; an effect is there once.

References: stiffening effects add to the energy, W = W_Yeoh + C30 x^3 + C40 x^4 with x = I1_bar - 3, and so do families of
fibres. Their stress is written in numpy, P = F S + p cof F with S from ``support``'s constants, as in test_effects.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from pydantic import Field
from support import YEOH, block_mesh, model_of, random_gradient

from explicitfe.fem.effects import EFFECTS
from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number
from explicitfe.fem.effects.material.drainage import Drainage
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.forces.response import SLOTS, layout_of
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled.arrays import INTERNAL
from explicitfe.platform.errors import InputError

pytestmark = pytest.mark.slow

AT = MEMORY = 0
C10, C20, _, K = YEOH.constants()
TOLERANCE = 1e-12  # some 100 roundings of the largest stress, K |J - 1|


def stiffen_fourth(I1_bar, blocks, block):
    """What is added to dW/dI1_bar, and to W [Pa]."""
    x = I1_bar - 3.0
    c = number(blocks, block, AT)
    return 4.0 * c * x * x * x, c * x * x * x * x


class FourthYeoh(MaterialEffect):
    """Fourth Yeoh constant."""

    about: ClassVar[Description] = replace(ThirdYeoh.about, title="fourth Yeoh term")
    sought: ClassVar[Mapping[str, Sought]] = {"C40_Pa": Sought((1.0,), 0.0, 10.0)}
    C40_Pa: float = Field(ge=0.0)

    @property
    def strength(self) -> float:
        return self.C40_Pa

    @classmethod
    def leaves(cls) -> Mapping[str, Callable]:
        return {"stiffen": stiffen_fourth}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return (self.C40_Pa,)


class OtherFibres(Fibres):
    """A second family of fibres."""

    about: ClassVar[Description] = replace(Fibres.about, title="a second family of fibres")


class OtherSeries(Viscoelastic):
    """A second series of relaxation."""

    about: ClassVar[Description] = replace(Viscoelastic.about, title="a second series")


class OtherSoftening(Softening):
    """A second law of softening."""

    about: ClassVar[Description] = replace(Softening.about, title="a second softening")


class OtherDrainage(Drainage):
    """A second law of drainage."""

    about: ClassVar[Description] = replace(Drainage.about, title="a second drainage")


THIRD, FOURTH = ThirdYeoh(C30_Pa=50.0), FourthYeoh(C40_Pa=20.0)
FIBRES = Fibres(k1_Pa=200.0, k2=0.5, direction=(1.0, 2.0, 2.0))
ACROSS = OtherFibres(k1_Pa=300.0, k2=0.3, direction=(2.0, -2.0, 1.0))
SERIES, SOFTENING = Viscoelastic(g=(0.3,), tau_s=(0.1,)), Softening(inverse_r=0.5, m_Pa=20.0)
DRAINAGE = Drainage(share=0.4, tau_s=0.5)


def stress(F: np.ndarray, C30: float = 0.0, C40: float = 0.0, fibres: tuple[Fibres, ...] = ()) -> np.ndarray:
    """First Piola-Kirchhoff stress (3, 3) Pa."""
    J, C = np.linalg.det(F), F.T @ F
    square = J ** (-2.0 / 3.0)
    x = square * np.trace(C) - 3.0
    fictitious = 2.0 * (C10 + 2.0 * C20 * x + 3.0 * C30 * x**2 + 4.0 * C40 * x**3) * np.eye(3)
    for family in fibres:
        a = np.array(family.direction) / np.linalg.norm(family.direction)
        beyond = max(square * (a @ C @ a) - 1.0, 0.0)
        fictitious = fictitious + 2.0 * family.k1_Pa * beyond * np.exp(family.k2 * beyond**2) * np.outer(a, a)
    S = square * (fictitious - np.sum(fictitious * C) / 3.0 * np.linalg.inv(C))
    return F @ S + 0.5 * K * (J - 1.0 / J) * J * np.linalg.inv(F).T


def states() -> np.ndarray:
    rng = np.random.default_rng(12)
    return np.array([random_gradient(rng, 0.3) for _ in range(12)])


def off_by(effects: tuple[MaterialEffect, ...], wanted: np.ndarray) -> float:
    F = states()
    P, _ = point.path(YEOH, effects, np.zeros(len(F)), F, [])
    return float(np.abs(P - wanted).max() / np.abs(wanted).max())


@pytest.mark.parametrize("effects", [(THIRD, FOURTH), (FOURTH, THIRD)], ids=["third-fourth", "fourth-third"])
def test_two_stiffening_effects_add_up(effects, record_property):
    """The stress is that of both, in either order; that of one alone is far from it."""
    wanted = np.array([stress(F, 50.0, 20.0) for F in states()])
    off = off_by(effects, wanted)
    record_property("off by", off)
    assert off < TOLERANCE
    assert off_by((THIRD,), wanted) > 1e-6
    assert off_by((FOURTH,), wanted) > 1e-6


def test_two_families_of_fibres_add_up(record_property):
    wanted = np.array([stress(F, fibres=(FIBRES, ACROSS)) for F in states()])
    off = off_by((FIBRES, ACROSS), wanted)
    record_property("off by", off)
    assert off < TOLERANCE
    assert off_by((ACROSS,), wanted) > 1e-6


def test_stored_energies_add_up():
    """Strain energy of one cube in a state without a change of volume: W_Yeoh + C30 x^3 + C40 x^4 times the volume."""
    mesh = block_mesh((1, 1, 1), 0.01, distort=0.0)
    F = np.diag([1.5, 1.5**-0.5, 1.5**-0.5])
    body = Simulation(model_of(mesh, effects=(THIRD, FOURTH)))
    u = mesh.points @ (F - np.eye(3)).T
    body.internal_force(u)
    body.blocks.old[:] = body.blocks.new
    body.state.u[: len(u), :3] = u[body.node_order]
    x = np.sum(F * F) - 3.0
    wanted = 1e-6 * (C10 * x + C20 * x**2 + 50.0 * x**3 + 20.0 * x**4)
    assert body.snapshot().energies[INTERNAL] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("effects", "why"),
    [
        ((SERIES, OtherSeries(g=(0.1,), tau_s=(1.0,))), "put all terms into one effect"),
        ((SOFTENING, OtherSoftening(inverse_r=0.1, m_Pa=1.0)), "take one of them out"),
        ((DRAINAGE, OtherDrainage(share=0.1, tau_s=1.0)), "take one of them out"),
    ],
    ids=["relaxation", "softening", "drainage"],
)
def test_what_cannot_be_combined_is_refused(effects, why):
    """With a sentence that names both and says what to do, at a point and in a body, before anything is compiled."""
    names = f"{effects[0].about.title} and {effects[1].about.title} cannot be combined"
    pattern = names.replace("(", r"\(").replace(")", r"\)")
    with pytest.raises(InputError, match=f"^effects: {pattern}: .*{why}\\.$"):
        point.uniaxial(YEOH, effects, np.zeros(1), np.ones(1))
    with pytest.raises(InputError, match=pattern):
        Simulation(model_of(block_mesh((1, 1, 1)), effects=effects))


def test_an_effect_is_there_once():
    with pytest.raises(InputError, match="third Yeoh term is there twice; give it once"):
        Simulation(model_of(block_mesh((1, 1, 1)), effects=(THIRD, SERIES, ThirdYeoh(C30_Pa=1.0))))


def test_an_unknown_slot_is_refused():
    class Misspelt(FourthYeoh):
        @classmethod
        def leaves(cls) -> Mapping[str, Callable]:
            return {"stifen": stiffen_fourth}

    with pytest.raises(InputError, match=r'Misspelt\.leaves: .* no slot "stifen".*did you mean "stiffen"'):
        layout_of((Misspelt(C40_Pa=1.0),))


def test_a_memory_is_declared():
    """What remembers has to say so: else its past would not be computed where only the present counts."""
    with pytest.raises(TypeError, match=r"Forgetful: .*must set ``remembers``"):

        class Forgetful(FourthYeoh):
            @property
            def memory(self) -> int:
                return 1


@pytest.mark.parametrize("name", [name for name, kind in EFFECTS.items() if issubclass(kind, MaterialEffect)])
def test_what_an_effect_says_of_itself_is_so(name):
    """Memory and time of each effect of the material are those of its numbers; its leaves fill slots that exist."""
    kind = EFFECTS[name]
    effect = kind.from_terms([{key: entry.values[0] for key, entry in kind.sought.items()}])
    assert isinstance(effect, MaterialEffect)
    assert effect.remembers == (effect.memory > 0)
    assert effect.transient == (effect.values(1.0) != effect.values(0.0))
    assert set(effect.leaves()) <= set(SLOTS)
    assert effect.acts_on == "material"
    assert effect.pointwise
