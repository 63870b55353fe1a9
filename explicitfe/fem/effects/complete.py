"""Material effects together with those that are absent, so that one compiled kernel serves every combination of them.

A kernel is compiled for the effects that it computes, which takes seconds. A search over sets of effects would spend most of its
time on that. At one point of material the absent effects cost little, so they are computed too, without strength.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.effects.effect import Effect, MaterialEffect
from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearSeries
from explicitfe.fem.effects.material.payne import Payne
from explicitfe.fem.effects.material.permanent_set import PermanentSet
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.effects.material.viscoelastic import PronySeries

ABSENT: tuple[MaterialEffect, ...] = (
    ThirdYeoh(C30_Pa=0.0),
    Softening(inverse_r=0.0, m_Pa=1.0),
    Fibres(k1_Pa=0.0),
    Payne(modulus_Pa=0.0, yield_shear=1.0),
    PermanentSet(modulus_Pa=0.0),
)


def complete(effects: Sequence[MaterialEffect]) -> Sequence[MaterialEffect]:
    """The effects with the absent ones; as they are where one of them has no place there, or where there is none."""
    own = {type(effect): effect for effect in effects if not isinstance(effect, PronySeries)}
    series = [effect for effect in effects if isinstance(effect, PronySeries)]
    known = {type(effect) for effect in ABSENT}
    if not effects or not set(own) <= known or len(series) > 1 or len(own) + len(series) < len(effects):
        return effects
    g, tau_s = series[0].series if series else (np.zeros(0), np.zeros(0))
    exponent = series[0].exponent if series and isinstance(series[0], NonlinearSeries) else 0.0
    whole = NonlinearSeries(g=tuple(map(float, g)), tau_s=tuple(map(float, tau_s)), exponent=exponent)
    return [*(own.get(type(effect), effect) for effect in ABSENT), whole]  # the series is last, because its length differs


def is_isochoric(effect: type[Effect]) -> bool:
    """Whether an effect changes the stress of an element alone and leaves its volume as it is."""
    return effect in {type(one) for one in ABSENT} or issubclass(effect, PronySeries)
