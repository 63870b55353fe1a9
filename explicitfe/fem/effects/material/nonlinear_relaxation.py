"""Relaxation that is not linear: what relaxes stiffens in another way with strain than what stays.

The branches of ``viscoelastic`` follow f S_el instead of S_el, with f = (I1_bar / 3)^k: each is hyperelastic, with slope f dW/dI1
(a Prony series on a strain-dependent modulus; Simo 1987, eq. 2.7, with an energy of its own for the branches). C10 and C20 are
those of the law at k = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from explicitfe.fem.effects.affected import ModelT
from explicitfe.fem.effects.effect import Description, Effect, MaterialEffect, Sought, in_materials
from explicitfe.fem.effects.material.viscoelastic import PronySeries, Viscoelastic, note_invariant
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.errors import InputError


class NonlinearRelaxation(Effect):
    """How the branches of ``viscoelastic`` stiffen with strain, beyond the law."""

    about: ClassVar[Description] = Description(
        title="nonlinear relaxation",
        equation="dQ_i/dt + Q_i / tau_i = g_i d(f S_el)/dt, f = (I1_bar / 3)^k",
        source="Simo (1987) Comput. Meth. Appl. Mech. Engng 60:153-173, with an energy of its own for the branches",
        where="material",
        strength="k",
        plausible=10.0,
        needs="holds, or several rates, at different strains",
        neighbours="viscoelastic with a further term (the same at all strains), third-yeoh (does not relax)",
    )
    sought: ClassVar[Mapping[str, Sought]] = {"exponent": Sought((-0.3, -1.0, 0.3, 1.0), -2.5, 2.5, scale="stiffening")}
    requires: ClassVar[tuple[str, ...]] = ("time",)
    extends: ClassVar[str] = "viscoelastic"
    acts_on = "material"
    pointwise = True
    without_tool = True
    remembers = True
    depends_on_path = True
    exponent: float = Field(description="k: above 0 what relaxes stiffens more than what stays")

    @property
    def strength(self) -> float:
        return self.exponent

    def in_materials(self, effects: Sequence[MaterialEffect]) -> tuple[MaterialEffect, ...]:
        """The effects with a series whose branches stiffen.

        Raises
        ------
        InputError : there is no series.
        """
        if not any(type(effect) is Viscoelastic for effect in effects):
            raise InputError("effects: nonlinear relaxation says how viscoelastic relaxes; add viscoelastic.")
        return tuple(_with_exponent(effect, self.exponent) for effect in effects)

    def apply(self, model: ModelT) -> ModelT:
        return in_materials(self, model)


class NonlinearSeries(PronySeries):
    """Any Prony series, whose branches may stiffen with strain; its kernel reads the number of terms."""

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
        return np.array(self.g), np.array(self.tau_s)

    @property
    def head(self) -> tuple[float, ...]:
        return self.exponent, float(len(self.g))

    @property
    def shape(self) -> Mapping[str, int]:
        return {"NONLINEAR": 1}

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {**super().leaves(), "stiffen": note_invariant}


def _with_exponent(effect: MaterialEffect, exponent: float) -> MaterialEffect:
    return NonlinearSeries(g=effect.g, tau_s=effect.tau_s, exponent=exponent) if type(effect) is Viscoelastic else effect
