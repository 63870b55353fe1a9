"""Base class of the material laws: constants with units, and the stress that follows from the strain energy.

A law is W = W_iso + U(J); U is in ``volumetric``. A law declares the invariants of which W_iso is a function, and defines W_iso
and its derivatives with respect to them as compiled leaves. The energy, the first Piola-Kirchhoff stress and everything that
elements and effects need follow from these leaves in this module. ``first_invariant`` and ``two_invariants`` hold the parts that
differ between laws of I1_bar and laws of I1_bar and I2_bar.

An element with one integration point does not resolve the variation of the deformation inside the element. ``delta`` is the
increase of the mean of I1_bar due to this variation. I2_bar increases by the same amount: for a deviatoric strain e both
invariants are 3 + 2 e:e to second order.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from explicitfe.fem.materials import first_invariant, two_invariants, volumetric
from explicitfe.fem.materials.kinematics import cofactor
from explicitfe.fem.materials.volumetric import bulk_modulus
from explicitfe.platform.compiled.jit import PLACEHOLDER, Dispatcher, bind
from explicitfe.platform.errors import InputError, nearest, shortened

KINDS: dict[tuple[str, ...], ModuleType] = {("I1",): first_invariant, ("I1", "I2"): two_invariants}

# Placeholders, bound below to the leaves of a law and of its kind.
invariants = raised = isochoric_at = slopes_at = total = first_stress = PLACEHOLDER
LAW_CONSTANTS = 1


class Law(BaseModel, ABC):
    """Constants of a material law, with the keys of a scenario or of a material table (units in the key names).

    Attributes
    ----------
    invariants : invariants of which the isochoric energy is a function: ("I1",) or ("I1", "I2").
    reads : constants that the leaves read as c[0], c[1], ... The bulk modulus follows them, for U(J).

    Raises
    ------
    InputError : a constant is missing, unknown or out of its limits.
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

    def __init__(self, *positional: object, **constants: Any) -> None:
        name = type(self).__name__
        if positional:
            raise InputError(f"{name}: write the constants with their names, such as {name}({next(iter(self.reads))}=...).")
        try:
            super().__init__(**constants)
        except ValidationError as error:
            raise InputError(_sentence(type(self), error)) from None

    # Marks an ``__init__`` that only replaces the error: ``model_validate`` then keeps the place of a wrong key in a scenario.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @property
    @abstractmethod
    def shear_modulus_Pa(self) -> float:
        """Initial shear modulus [Pa]."""

    def constants(self) -> tuple[float, ...]:
        """Constants in the order of the compiled law: those in ``reads``, then the bulk modulus [Pa]."""
        return (*(getattr(self, name) for name in self.reads), bulk_modulus(self.shear_modulus_Pa, self.poisson))

    def scaled(self, constants: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """Constants (m, k) of elements that are stiffer by a factor (m,): constants in Pa are multiplied by it."""
        modulus = np.array([*(name.endswith("_Pa") for name in self.reads), True])
        return constants * np.where(modulus, factor[:, None], 1.0)

    def stretch_derivative(self, stretch: np.ndarray) -> np.ndarray:
        """Derivative of W_iso with respect to the logarithms of the isochoric principal stretches.

        Parameters
        ----------
        stretch : (3, n) isochoric principal stretches, real or complex.

        Returns
        -------
        stretch_i dW_iso/dstretch_i : (3, n) Pa. Its deviator is the Kirchhoff stress without the pressure.
        """
        square = stretch * stretch
        first, second = square.sum(axis=0), (1.0 / square).sum(axis=0)
        module = sys.modules[type(self).__module__]
        if self.invariants == ("I1",):
            return 2.0 * module.slope.py_func(first, self.constants()) * square
        by_first, by_second = module.slopes.py_func(first, second, self.constants())
        return 2.0 * (by_first * square - by_second / square)


def _sentence(law: type[Law], error: ValidationError) -> str:
    """The first fault of some constants in one sentence."""
    fault = error.errors()[0]
    name, keys = law.__name__, [key for key in law.model_fields if key != "law"]
    if not fault["loc"]:
        return f"{name}: {str(fault['msg']).removeprefix('Value error, ')}"
    key = str(fault["loc"][0])
    if fault["type"] == "missing":
        return f"{name}: {key} is missing ({law.model_fields[key].description})."
    if fault["type"] == "extra_forbidden":
        return f'{name}: there is no constant "{shortened(key)}"; {nearest(key, keys)}'
    rule = str(fault["msg"]).removeprefix("Value error, ").replace("Input should be", "it must be")
    return f"{name}: {key} = {shortened(repr(fault['input']))}: {rule.rstrip('.')}."


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
