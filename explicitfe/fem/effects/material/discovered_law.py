"""A law that was composed from data: polynomials of both invariants, each with a relaxation time of its own.

W + sum over k of W_k, W_k = sum of c_ij (I1_bar - 3)^i (I2_bar - 3)^j with i + j <= 3 (Rivlin & Saunders 1951), where the
stress S_k of W_k fades with the time tau_k (Simo 1987, with a spring of its own in each branch):

Q_k = integral of e^(-(t - s) / tau_k) dS_k(s),  S = S_law + sum of Q_k.

A branch with the time 0 never fades. Coefficients are not negative, so that each branch is stable by itself. Where all branches
have the same polynomial this is a Prony series; else relaxation depends on strain.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from explicitfe.fem.effects.affected import LawT, ModelT
from explicitfe.fem.effects.effect import Description, MaterialEffect, Sought, number, remember_tensor, remembered_tensor, renew
from explicitfe.fem.materials.kinematics import minus, plus, right_cauchy_green
from explicitfe.fem.materials.two_invariants import second_stress
from explicitfe.fem.materials.volumetric import bulk_modulus
from explicitfe.platform.compiled.jit import Template
from explicitfe.platform.compiled.simd import maximum

AT = MEMORY = 0
BRANCHES = 1
# Powers (i, j) of the two invariants, in the order of the numbers of a branch.
MONOMIALS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
NUMBERS_OF_A_BRANCH = len(MONOMIALS) + 2
MOST_BRANCHES = 8
# Machine code is made for so many branches or twice as many: making it takes longer than to compute some that are empty.
COMPILED_BRANCHES = 4
# With a larger bulk modulus than that of this ratio, rounding of the pressure would be larger than a stress that counts as none.
LARGEST_POISSON_RATIO = 0.4999
# I1 - 3 and I2 - 3 of a compression by about 30 %, at which the stiffness of a polynomial counts.
USUAL_INVARIANT = 0.3
# How a coefficient is called where it is fitted: c20_Pa never fades, c20_30s_Pa and c20_300ms_Pa do.
COEFFICIENT = re.compile(r"c(\d)(\d)(?:_(\d+)(ms|s))?_Pa")


def coefficient_name(powers: tuple[int, int], tau_s: float) -> str:
    """What a coefficient is called; a time of 0 never fades, others are whole milliseconds."""
    head = f"c{powers[0]}{powers[1]}"
    if tau_s == 0.0:
        return f"{head}_Pa"
    return f"{head}_{round(tau_s)}s_Pa" if tau_s >= 1.0 else f"{head}_{round(1e3 * tau_s)}ms_Pa"


class DiscoveredLaw(MaterialEffect):
    """Polynomials of both invariants with their relaxation times, up to eight branches."""

    about: ClassVar[Description] = Description(
        title="discovered law",
        equation="W + sum of c_ij (I1_bar - 3)^i (I2_bar - 3)^j, each with a relaxation time of its own",
        source="Rivlin & Saunders (1951) Phil. Trans. R. Soc. A 243:251-288; Simo (1987)",
        where="material",
        strength="sum of coefficients (Pa)",
        plausible=1e6,
        needs="homogeneous tests that the named effects do not fully explain",
        neighbours="any effect of the material: it is composed where none of them is enough",
    )
    searched = False
    sought: ClassVar[Mapping[str, Sought]] = {"c20_1s_Pa": Sought((0.1, 1.0, 10.0), 0.0, 1e3, scale="modulus_Pa")}
    remembers = True
    depends_on_path = True
    tau_s: tuple[float, ...] = Field(description="relaxation time of each branch [s]; 0 never fades")
    c10_Pa: tuple[float, ...] = Field(default=(), description="of I1 - 3 in each branch [Pa]; left out is 0")
    c01_Pa: tuple[float, ...] = Field(default=(), description="of I2 - 3 in each branch [Pa]; left out is 0")
    c20_Pa: tuple[float, ...] = Field(default=(), description="of (I1 - 3)^2 in each branch [Pa]; left out is 0")
    c11_Pa: tuple[float, ...] = Field(default=(), description="of (I1 - 3) (I2 - 3) in each branch [Pa]; left out is 0")
    c02_Pa: tuple[float, ...] = Field(default=(), description="of (I2 - 3)^2 in each branch [Pa]; left out is 0")
    c30_Pa: tuple[float, ...] = Field(default=(), description="of (I1 - 3)^3 in each branch [Pa]; left out is 0")
    c21_Pa: tuple[float, ...] = Field(default=(), description="of (I1 - 3)^2 (I2 - 3) in each branch [Pa]; left out is 0")
    c12_Pa: tuple[float, ...] = Field(default=(), description="of (I1 - 3) (I2 - 3)^2 in each branch [Pa]; left out is 0")
    c03_Pa: tuple[float, ...] = Field(default=(), description="of (I2 - 3)^3 in each branch [Pa]; left out is 0")

    @model_validator(mode="after")
    def _branches(self) -> DiscoveredLaw:
        if not 1 <= len(self.tau_s) <= MOST_BRANCHES:
            raise ValueError(f"tau_s must have one to {MOST_BRANCHES} entries")
        if min(self.tau_s) < 0.0:
            raise ValueError("tau_s must not be negative; 0 never fades")
        for powers in MONOMIALS:
            coefficients = getattr(self, coefficient_name(powers, 0.0))
            if coefficients and len(coefficients) != len(self.tau_s):
                raise ValueError(f"{coefficient_name(powers, 0.0)} must have as many entries as tau_s, or none")
            if coefficients and min(coefficients) < 0.0:
                raise ValueError(f"{coefficient_name(powers, 0.0)} must not be negative: a branch must be stable by itself")
        return self

    @classmethod
    def from_terms(cls, terms: Sequence[Mapping[str, float]]) -> Self:
        """From coefficients by their names, such as ``c20_30s_Pa``."""
        branches: dict[float, dict[str, float]] = {}
        for name, value in (entry for term in terms for entry in term.items()):
            parts = COEFFICIENT.fullmatch(name)
            if parts is None:
                raise ValueError(f"{name} is no coefficient of a discovered law; write it as c20_Pa or c20_30s_Pa")
            i, j, time, unit = parts.groups()
            tau = 0.0 if time is None else float(time) * (1e-3 if unit == "ms" else 1.0)
            branches.setdefault(tau, {})[f"c{i}{j}_Pa"] = value
        times = sorted(branches)
        keys = {key for branch in branches.values() for key in branch}
        coefficients = {key: tuple(branches[tau].get(key, 0.0) for tau in times) for key in keys}
        return cls.model_validate({"tau_s": tuple(times), **coefficients})

    @property
    def coefficients(self) -> np.ndarray:
        """(branches, monomials) Pa."""
        columns = [getattr(self, coefficient_name(powers, 0.0)) or (0.0,) * len(self.tau_s) for powers in MONOMIALS]
        return np.array(columns).T

    @property
    def strength(self) -> float:
        return float(self.coefficients.sum())

    @property
    def compiled_branches(self) -> int:
        """For how many branches machine code is made."""
        return COMPILED_BRANCHES * -(-len(self.tau_s) // COMPILED_BRANCHES)

    @property
    def memory(self) -> int:
        return 12 * self.compiled_branches

    @property
    def shape(self) -> Mapping[str, int]:
        return {"BRANCHES": self.compiled_branches}

    def in_law(self, law: LawT) -> LawT:
        """With the bulk modulus that belongs to the stiffness under a sudden load, so that it stays as hard to compress."""
        slopes = [(i + j) * USUAL_INVARIANT ** (i + j - 1) for i, j in MONOMIALS]
        own = 2.0 * float((self.coefficients @ slopes).sum())
        G = law.shear_modulus_Pa
        K = max(bulk_modulus(G, law.poisson), bulk_modulus(G + own, min(law.poisson, LARGEST_POISSON_RATIO)))
        return law.model_copy(update={"poisson": (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))})

    def apply(self, model: ModelT) -> ModelT:
        return super().apply(replace(model, material=self.in_law(model.material)))

    @classmethod
    def leaves(cls) -> Mapping[str, Template]:
        return {"pull": pull, "relax": relax}

    def values(self, increment_s: float) -> tuple[float, ...]:
        """Of each branch its coefficients, (1 - e^-x) / x and e^-x, with x = increment / tau."""
        numbers: list[float] = []
        for tau, coefficients in zip(self.tau_s, self.coefficients, strict=True):
            x = increment_s / tau if tau > 0.0 else 0.0
            numbers += [*coefficients, -np.expm1(-x) / x if x > 0.0 else 1.0, float(np.exp(-x))]
        empty = NUMBERS_OF_A_BRANCH * self.compiled_branches - len(numbers)
        return (*(float(value) for value in numbers), *(0.0 for _ in range(empty)))


def pull(F, square, inverse_C, blocks, block):
    """Second Piola-Kirchhoff stress of all branches [Pa], (11, 22, 33, 12, 13, 23), and what they store [Pa].

    ``square`` is J^(-2/3), ``inverse_C`` C^-1 in the same order. A branch that never fades stores its polynomial; one that fades
    stores as much less as its stress is smaller squared, as a linear spring would. Where it pushes back after unloading it is
    said to store no more than its polynomial, and the remainder counts as lost.
    """
    C = right_cauchy_green(F)
    second = (C[0] * C[1] - C[3] * C[3]) + (C[0] * C[2] - C[4] * C[4]) + (C[1] * C[2] - C[5] * C[5])
    x = square * (C[0] + C[1] + C[2]) - 3.0
    y = square * square * second - 3.0
    zero = 0.0 * square
    T, energy = (zero, zero, zero, zero, zero, zero), zero
    for branch in range(BRANCHES):
        at, q = AT + 11 * branch, MEMORY + 12 * branch
        c10, c01 = number(blocks, block, at), number(blocks, block, at + 1)
        c20, c11, c02 = number(blocks, block, at + 2), number(blocks, block, at + 3), number(blocks, block, at + 4)
        c30, c21 = number(blocks, block, at + 5), number(blocks, block, at + 6)
        c12, c03 = number(blocks, block, at + 7), number(blocks, block, at + 8)
        gain, decay = number(blocks, block, at + 9), number(blocks, block, at + 10)
        first_slope = c10 + 2.0 * c20 * x + c11 * y + 3.0 * c30 * x * x + 2.0 * c21 * x * y + c12 * y * y
        second_slope = c01 + c11 * x + 2.0 * c02 * y + c21 * x * x + 2.0 * c12 * x * y + 3.0 * c03 * y * y
        S = second_stress((first_slope, second_slope), C, inverse_C, square)
        change = minus(S, remembered_tensor(blocks, block, q + 6))
        remember_tensor(blocks, block, q + 6, S)
        Q = renew(blocks, block, q, decay, gain, change)
        T = plus(T, Q)
        # What a branch bears now, and what it would bear at once, both squared.
        left = Q[0] * Q[0] + Q[1] * Q[1] + Q[2] * Q[2] + 2.0 * (Q[3] * Q[3] + Q[4] * Q[4] + Q[5] * Q[5])
        full = S[0] * S[0] + S[1] * S[1] + S[2] * S[2] + 2.0 * (S[3] * S[3] + S[4] * S[4] + S[5] * S[5])
        W = c10 * x + c01 * y + c20 * x * x + c11 * x * y + c02 * y * y
        W = W + c30 * x * x * x + c21 * x * x * y + c12 * x * y * y + c03 * y * y * y
        energy = energy + W * left / (maximum(left, full) + 1e-200)
    return T, energy


def relax(S, blocks, block):
    """The isochoric stress as it is, and all of hourglass control: the branches have faded already.

    A series of relaxation beside them would fade them again, so this takes the slot that only one effect can have.
    """
    return S, 0.0 * S[0] + 1.0
