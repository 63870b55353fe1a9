"""Relaxation of the isochoric stress by a Prony series (Simo 1987).

S(t) = S_el - sum_i g_i integral (1 - e^(-(t - s) / tau_i)) dS_el(s).

C10 and C20 are those of a sudden load; after a long time the isochoric stress is 1 - sum g of it. Each term remembers a stress
Q, with dQ/dt + Q / tau = g dS_el/dt; for an S_el that changes linearly over an increment its update is exact.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from explicitfe.fem.effects.effect import (
    Description,
    MaterialEffect,
    Sought,
    number,
    remember,
    remember_tensor,
    remembered_tensor,
    renew,
)
from explicitfe.fem.materials.kinematics import minus, plus, squared_size, times
from explicitfe.fem.materials.law import Law
from explicitfe.fem.materials.volumetric import bulk_modulus
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.compiled.simd import WIDTH, exp, load, log

AT = MEMORY = 0
TERMS = 1
# An increment that is no longer than this share of a relaxation time relaxes nothing: (1 - e^-x) / x is 1 to the last digit.
SMALLEST_INCREMENT_TAU = 1e-300
# 1 where the branches stiffen with strain in their own way, and one kernel serves any number of terms: nonlinear_relaxation.py
NONLINEAR = 0


class PronySeries(MaterialEffect):
    """Relaxation whose relaxation function of a sudden strain is a Prony series."""

    remembers = True
    depends_on_path = True

    @property
    @abstractmethod
    def series(self) -> tuple[np.ndarray, np.ndarray]:
        """Share (m,) of the sudden stress that each term loses, and relaxation times (m,) [s]."""

    @property
    def long_term_share(self) -> float:
        return 1.0 - float(np.sum(self.series[0]))

    @property
    def transient(self) -> bool:
        return len(self.series[0]) > 0

    @property
    def numbers(self) -> int:
        return 1 + len(self.head) + 3 * len(self.series[0])

    @property
    def memory(self) -> int:
        return 6 + self.shape.get("NONLINEAR", 0) + 6 * len(self.series[0])

    @property
    def shape(self) -> Mapping[str, int]:
        return {"TERMS": len(self.series[0])}

    @property
    def head(self) -> tuple[float, ...]:
        """Numbers of its leaves between 1 - sum g and those of the terms."""
        return ()

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"relax": relax, "branch_energy": branch_energy}

    def values(self, increment_s: float) -> tuple[float, ...]:
        return tuple(self.values_along(np.array([increment_s]))[0].tolist())

    def values_along(self, increments_s: np.ndarray) -> np.ndarray:
        """1 - sum g, ``head``, and of each term g (1 - e^-x) / x, e^-x and g, with x = increment / tau."""
        g, tau_s = self.series
        x = np.maximum(increments_s[:, None] / tau_s, SMALLEST_INCREMENT_TAU)
        values, first = np.empty((len(x), self.numbers)), self.numbers - 3 * len(g)
        values[:, :first] = 1.0 - np.sum(g), *self.head
        values[:, first::3], values[:, first + 1 :: 3], values[:, first + 2 :: 3] = g * (-np.expm1(-x) / x), np.exp(-x), g
        return values


class Viscoelastic(PronySeries):
    """Prony series of the isochoric stress, one to four terms."""

    about: ClassVar[Description] = Description(
        title="viscoelastic relaxation",
        equation="S = (1 - sum g) S_el + sum Q_i, dQ_i/dt + Q_i / tau_i = g_i dS_el/dt",
        source="Simo (1987) Comput. Meth. Appl. Mech. Engng 60:153-173; Holzapfel (2000) section 6.10",
        where="material",
        strength="sum of g",
        plausible=0.9,
        needs="a hold, or two rates",
        neighbours="softening (no relaxation in a hold), drainage (needs a change of volume: two radii), friction",
    )
    sought: ClassVar[Mapping[str, Sought]] = {
        "g": Sought((0.1, 0.3, 0.6), 0.0, 0.98, kind="rest"),
        "tau_s": Sought((0.0005, 0.002, 0.008, 0.03, 0.12, 0.5), 1e-5, 5.0, scale="duration_s", kind="log"),
    }
    requires: ClassVar[tuple[str, ...]] = ("time",)
    terms: ClassVar[int] = 3
    shares_of_remainder = ("g",)
    g: tuple[float, ...] = Field(description="share of the sudden stress that each term loses")
    tau_s: tuple[float, ...] = Field(description="relaxation time of each term [s]")

    @model_validator(mode="after")
    def _series(self) -> Viscoelastic:
        if len(self.g) != len(self.tau_s) or not 1 <= len(self.g) <= 4:
            raise ValueError("g and tau_s must have as many entries, one to four")
        if min(self.g) < 0.0 or sum(self.g) >= 1.0:
            raise ValueError("g must not be negative, and must add up to less than 1: else nothing would hold in the long run")
        if min(self.tau_s) <= 0.0:
            raise ValueError("tau_s must be above 0")
        return self

    @classmethod
    def from_terms(cls, terms: Sequence[Mapping[str, float]]) -> Self:
        """Of the stress that the terms before it leave, each term loses its share ``g``: together never all of it."""
        left, g = 1.0, []
        for term in terms:
            g.append(left * term["g"])
            left -= g[-1]
        return cls(g=tuple(g), tau_s=tuple(term["tau_s"] for term in terms))

    @property
    def strength(self) -> float:
        return sum(self.g)

    @property
    def series(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.g), np.array(self.tau_s)


def from_damping(law: Law, beta_s: float, tau_s: float) -> tuple[Law, Viscoelastic]:
    """A material that is damped as by stiffness-proportional damping ``beta_s``, by one Maxwell branch: at rest it is ``law``.

    The branch has the viscosity eta = beta G and the modulus eta / tau. A Kelvin-Voigt element of the same eta would cut the
    explicit step; the branch acts like it below 1 / (2 pi tau), above it stiffens by beta / tau. The bulk modulus stays.
    """
    times = 1.0 + beta_s / tau_s
    G, K = times * law.shear_modulus_Pa, bulk_modulus(law.shear_modulus_Pa, law.poisson)
    moduli = {name: times * value for name, value in law.model_dump().items() if name.endswith("_Pa")}
    poisson = (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))
    return law.model_copy(update=moduli | {"poisson": poisson}), Viscoelastic(g=(1.0 - 1.0 / times,), tau_s=(tau_s,))


def note_invariant(I1_bar, blocks, block):
    """Nothing is added to the slope or the energy; the leaf that relaxes reads I1_bar."""
    remember(blocks, block, MEMORY + 6, I1_bar)
    return 0.0 * I1_bar, 0.0 * I1_bar


def relax(S, blocks, block):
    """The isochoric stress (6 components) [Pa] that is left of the elastic one S, and the share that hourglass control keeps.

    That is the long-term share. A share that followed the stress, S.T / S.S, would change in time without a force that does the
    work of the change: an element that vibrates would then be pumped.
    """
    left = number(blocks, block, AT)
    T = times(left, S)
    if NONLINEAR and blocks.effects[block, AT + 1, 0] != 0.0:
        I1_bar = load(blocks.new, (block * blocks.new.shape[1] + MEMORY + 6) * WIDTH)
        S = times(exp(number(blocks, block, AT + 1) * log(I1_bar * (1.0 / 3.0))), S)
    change = minus(S, remembered_tensor(blocks, block, MEMORY))
    remember_tensor(blocks, block, MEMORY, S)
    terms = int(blocks.effects[block, AT + 2, 0]) if NONLINEAR else TERMS
    head, held = AT + 1 + 2 * NONLINEAR, MEMORY + 6 + NONLINEAR
    for term in range(terms):
        gain, decay = number(blocks, block, head + 3 * term), number(blocks, block, head + 1 + 3 * term)
        T = plus(T, renew(blocks, block, held + 6 * term, decay, gain, change))
    return T, left


def branch_energy(C, modulus, blocks, block):
    """Share of the sudden energy that is kept in the long run, and the energy of the terms [Pa]: sum of tr(Q C Q C) / (4 g G).

    G is the ``modulus`` [Pa] of a sudden small shear from here.
    """
    energy = 0.0 * modulus
    terms = int(blocks.effects[block, AT + 2, 0]) if NONLINEAR else TERMS
    head, held = AT + 1 + 2 * NONLINEAR, MEMORY + 6 + NONLINEAR
    for term in range(terms):
        square = squared_size(remembered_tensor(blocks, block, held + 6 * term), C)
        energy = energy + square / (4.0 * modulus * number(blocks, block, head + 2 + 3 * term) + 1e-200)
    return number(blocks, block, AT), energy
