"""Material effects together with those that are absent, so that one compiled kernel serves every combination of them.

A kernel is compiled for the effects that it computes, which takes seconds. A search over sets of effects would spend most of its
time on that. At one point of material the absent effects cost little, so they are computed too, without strength.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from explicitfe.fem.effects.effect import Description, Effect, MaterialEffect, Sought
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearSeries, note_invariant
from explicitfe.fem.effects.material.payne import Payne
from explicitfe.fem.effects.material.permanent_set import PermanentSet
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.effects.material.viscoelastic import PronySeries, Viscoelastic
from explicitfe.platform.compiled.jit import Template

# Terms of the longest series among the effects.
MOST_TERMS = 20
ABSENT: tuple[MaterialEffect, ...] = (
    ThirdYeoh(C30_Pa=0.0),
    Softening(inverse_r=0.0, m_Pa=1.0),
    Fibres(k1_Pa=0.0),
    Payne(modulus_Pa=0.0, yield_shear=1.0),
    PermanentSet(modulus_Pa=0.0),
)


class AnySeries(PronySeries):
    """Any series of relaxation, with terms without strength up to the largest number."""

    about: ClassVar[Description] = Viscoelastic.about
    sought: ClassVar[Mapping[str, Sought]] = {}
    g: tuple[float, ...] = ()
    tau_s: tuple[float, ...] = ()
    exponent: float = 0.0

    @property
    def strength(self) -> float:
        return sum(self.g)

    @property
    def series(self) -> tuple[np.ndarray, np.ndarray]:
        more = MOST_TERMS - len(self.g)
        return np.array([*self.g, *[0.0] * more]), np.array([*self.tau_s, *[1.0] * more])

    @property
    def memory(self) -> int:
        return super().memory + 1

    @property
    def shape(self) -> Mapping[str, int]:
        return {"TERMS": MOST_TERMS, "NONLINEAR": 1}

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {**super().leaves(), "stiffen": note_invariant}

    def values_along(self, increments_s: np.ndarray) -> np.ndarray:
        return np.column_stack([super().values_along(increments_s), np.full(len(increments_s), self.exponent)])


def complete(effects: Sequence[MaterialEffect]) -> Sequence[MaterialEffect]:
    """The effects with the absent ones; as they are where one of them has no place there, or where there is none."""
    own = {type(effect): effect for effect in effects if not isinstance(effect, PronySeries)}
    series = [effect for effect in effects if isinstance(effect, PronySeries)]
    known = {type(effect) for effect in ABSENT}
    if not effects or not set(own) <= known or len(series) > 1 or len(own) + len(series) < len(effects):
        return effects
    g, tau_s = series[0].series if series else (np.zeros(0), np.zeros(0))
    exponent = series[0].exponent if series and isinstance(series[0], NonlinearSeries) else 0.0
    whole = AnySeries(g=tuple(map(float, g)), tau_s=tuple(map(float, tau_s)), exponent=exponent)
    return [whole, *(own.get(type(effect), effect) for effect in ABSENT)]


def is_isochoric(effect: type[Effect]) -> bool:
    """Whether an effect changes the stress of an element alone and leaves its volume as it is."""
    return effect in {type(one) for one in ABSENT} or issubclass(effect, PronySeries)
