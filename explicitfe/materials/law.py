"""What every material law has in common: constants with units, and the stress that follows from its energy.

A law is W = W_iso + U(J), U in ``volumetric``. It says of which invariants W_iso is a function, and writes W_iso and its slopes
by them as compiled leaves; energy and first Piola-Kirchhoff stress of every law follow from these here, and so does what
elements and effects need of a law. What differs between a law of I1_bar and one of I1_bar and I2_bar stands in
``first_invariant`` and ``two_invariants``.

Inside an element of one integration point the deformation varies, unseen by that point. ``delta`` is what that adds to I1_bar on
the mean of the element. It adds the same to I2_bar: for a deviatoric strain e both invariants are 3 + 2 e:e to second order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from explicitfe.compiled.jit import PLACEHOLDER, Dispatcher, bind
from explicitfe.errors import InputError
from explicitfe.materials import first_invariant, two_invariants, volumetric
from explicitfe.materials.kinematics import cofactor
from explicitfe.materials.volumetric import bulk_modulus

KINDS: dict[tuple[str, ...], ModuleType] = {("I1",): first_invariant, ("I1", "I2"): two_invariants}

# Placeholders, bound below to the leaves of a law and of its kind.
invariants = raised = isochoric_at = slopes_at = total = first_stress = PLACEHOLDER
LAW_CONSTANTS = 1


class Law(BaseModel, ABC):
    """Constants of one material law, as a scenario or a material table states them (units in the key names).

    Attributes
    ----------
    invariants : those that the isochoric energy is a function of: ("I1",) or ("I1", "I2").
    reads : the constants that the leaves read as c[0], c[1], ... The bulk modulus comes after them, for U(J).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    invariants: ClassVar[tuple[str, ...]] = ("I1",)
    reads: ClassVar[tuple[str, ...]]

    law: str
    poisson: float = Field(
        default=0.499, ge=0.0, lt=0.5, description="initial Poisson's ratio; 0.5 would need an infinite bulk modulus"
    )
    density_kg_m3: float = Field(default=1040.0, gt=0.0, description="density [kg/m^3]")
    source: str = Field(default="", description="where the constants come from")

    @property
    @abstractmethod
    def shear_modulus_Pa(self) -> float:
        """Initial shear modulus [Pa]."""

    def constants(self) -> tuple[float, ...]:
        """What the compiled law reads: the constants that ``reads`` names, and the bulk modulus [Pa]."""
        return (*(getattr(self, name) for name in self.reads), bulk_modulus(self.shear_modulus_Pa, self.poisson))

    def scaled(self, constants: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """Constants (m, k) of elements that are stiffer by a factor (m,): what is a stress, ``_Pa``, is multiplied."""
        modulus = np.array([*(name.endswith("_Pa") for name in self.reads), True])
        return constants * np.where(modulus, factor[:, None], 1.0)


@dataclass(frozen=True)
class Leaves:
    """Compiled leaves of a law; F is a tuple of 9, cof its cofactor, J its determinant, c the constants.

    Attributes
    ----------
    kind : ``first_invariant`` or ``two_invariants``.
    count : how many constants it reads.
    isochoric_at : (invariants, c) -> W_iso [Pa].
    slopes_at : (invariants, c) -> its derivative by each invariant [Pa].
    energy : (F, J, delta, c) -> W [Pa].
    stress : (F, cof, J, delta, c) -> first Piola-Kirchhoff stress P = dW/dF [Pa], 9 numbers row by row.
    delta_slope : (F, cof, J, delta, c) -> dW/ddelta [Pa], which hourglass control scales with.
    """

    kind: ModuleType
    count: int
    isochoric_at: Dispatcher
    slopes_at: Dispatcher
    energy: Dispatcher
    stress: Dispatcher
    delta_slope: Dispatcher


def energy(F, J, delta, c):
    """W [Pa]."""
    return isochoric_at(raised(invariants(F, cofactor(F), J), delta), c) + volumetric.energy(J, c[LAW_CONSTANTS - 1])


def stress(F, cof, J, delta, c):
    """First Piola-Kirchhoff stress P = dW/dF [Pa], 9 numbers row by row."""
    here = invariants(F, cof, J)
    pressure = volumetric.pressure(J, c[LAW_CONSTANTS - 1])
    return first_stress(F, cof, J, here, slopes_at(raised(here, delta), c), pressure)


def delta_slope(F, cof, J, delta, c):
    """dW/ddelta [Pa]: half the shear modulus, in the reference state."""
    return total(slopes_at(raised(invariants(F, cof, J), delta), c))


@cache
def leaves_of(constants: type[Law], written: ModuleType) -> Leaves:
    """The leaves of a law: what its module has written, and what follows.

    Raises
    ------
    InputError : it is a function of other invariants than the elements know.
    """
    kind = KINDS.get(constants.invariants)
    if kind is None:
        raise InputError(
            f"{constants.__name__}: no element knows a law of {' and '.join(constants.invariants)}; write it as one of I1, "
            'or of I1 and I2: invariants = ("I1",) or ("I1", "I2").'
        )
    own: Mapping[str, Dispatcher] = {name: getattr(written, name) for name in kind.LEAVES}
    count = len(constants.reads) + 1
    here = {
        "isochoric_at": bind(kind.isochoric_at, inline=True, law_isochoric=own["isochoric"]),
        "slopes_at": bind(kind.slopes_at, inline=True, law_slopes=own[kind.LEAVES[1]]),
    }
    common = {"invariants": kind.invariants, "raised": kind.raised}
    return Leaves(
        kind=kind,
        count=count,
        **here,
        energy=bind(energy, inline=True, **common, isochoric_at=here["isochoric_at"], LAW_CONSTANTS=count),
        stress=bind(
            stress, inline=True, **common, slopes_at=here["slopes_at"], first_stress=kind.first_stress, LAW_CONSTANTS=count
        ),
        delta_slope=bind(delta_slope, inline=True, **common, slopes_at=here["slopes_at"], total=kind.total),
    )
