"""Laws that ``identify`` fits: their constants, the bounds of these, and where a fit starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from explicitfe.fem.materials import LAWS, Law
from explicitfe.fem.materials.mooney_rivlin import MooneyRivlin
from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.materials.ogden import Ogden
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.platform.errors import InputError, shortened

ConstantsLike = Sequence[float] | np.ndarray

SMALLEST_MODULUS_PA = 1e-3  # The first constant must be above 0.
LARGEST_FITTED_ALPHA = 25.0  # Ogden exponents stay within this magnitude.
NO_ALPHA = 1e-7  # takes the place of an exponent of 0, whose energy is only a limit
# Shares of the second modulus with which the start of a fit is sought.
FIRST_RATIOS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
TRIED_ALPHAS = (-6.0, -2.0, 1.0, 2.0, 4.0, 8.0, 14.0)
ALL = "all"


@dataclass(frozen=True)
class FitLaw:
    """A material law as it is fitted.

    Attributes
    ----------
    name : as in ``--law``.
    law : class of the constants.
    constants : keys of the fitted constants; the others keep their defaults.
    lower, upper : bounds of the constants; the first one is a modulus.
    shapes : constants of different shape, of which the best one times a factor is the start of the fit.
    """

    name: str
    law: type[Law]
    constants: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    shapes: tuple[tuple[float, ...], ...]

    @cached_property
    def moduli(self) -> np.ndarray:
        """Which constants (k,) are moduli: stresses are proportional to all of them together."""
        return np.array([name.endswith("_Pa") for name in self.constants])

    @property
    def symbols(self) -> tuple[str, ...]:
        """The constants without their units, as they are printed."""
        return tuple(name.removesuffix("_Pa") for name in self.constants)

    @property
    def in_elements(self) -> bool:
        """Whether the simulator supports the law."""
        return self.key in LAWS

    @cached_property
    def key(self) -> str:
        """The name of the law in a scenario."""
        return str(self.law.model_fields["law"].default)

    def table(self, constants: ConstantsLike) -> dict[str, Any]:
        """The law and its constants with their keys."""
        triples = zip(self.constants, constants, self.moduli, strict=True)
        return {"law": self.key, **{name: float(c) if c or modulus else NO_ALPHA for name, c, modulus in triples}}

    def at(self, constants: ConstantsLike, poisson: float) -> Law:
        """The law with these constants, which are not checked: the optimiser also tries unstable ones."""
        return self._unit.model_copy(update=self.table(constants) | {"poisson": poisson})

    @cached_property
    def _unit(self) -> Law:
        """The law with some constants, which are not checked."""
        return self.law.model_construct(**self.table(np.ones(len(self.constants))))

    def shear_modulus_Pa(self, constants: ConstantsLike) -> float:
        """Initial shear modulus [Pa]; it is linear in the moduli."""
        return self.at(constants, 0.499).shear_modulus_Pa

    def shear_modulus_gradient(self) -> np.ndarray:
        """Derivative (k,) of the initial shear modulus with respect to the constants."""
        unit = np.eye(len(self.constants))
        return np.array([self.shear_modulus_Pa(row) if own else 0.0 for row, own in zip(unit, self.moduli, strict=True)])

    def ordered(self, constants: np.ndarray) -> np.ndarray:
        """The same constants with the terms of an Ogden law in the order of their moduli, the largest first."""
        if self.law is not Ogden:
            return constants
        terms = constants.reshape(-1, 2)
        return terms[np.argsort(-terms[:, 0], kind="stable")].ravel()

    def of_any_sign(self) -> FitLaw:
        """The same with Yeoh constants after the first one of either sign; only stable results may be used."""
        if self.law is not Yeoh:
            return self
        return replace(self, lower=(SMALLEST_MODULUS_PA, *(-np.inf for _ in self.lower[1:])))


def _moduli(name: str, law: type[Law], constants: tuple[str, ...], shapes: Sequence[tuple[float, ...]]) -> FitLaw:
    others = len(constants) - 1
    return FitLaw(name, law, constants, (SMALLEST_MODULUS_PA, *others * (0.0,)), (others + 1) * (np.inf,), tuple(shapes))


def _ogden(terms: int) -> FitLaw:
    """With ``terms`` terms; the starts are all increasing sets of exponents, with several shares of the moduli."""
    names = tuple(name for number in range(1, terms + 1) for name in (f"mu{number}_Pa", f"alpha{number}"))
    exponents = [tried for tried in product(TRIED_ALPHAS, repeat=terms) if list(tried) == sorted(set(tried))]
    shares = (1.0,) if terms == 1 else (0.1, 0.45, 0.8)
    splits = [split for split in product(shares, repeat=terms) if abs(sum(split) - 1.0) < 0.15]
    shapes = [tuple(x for pair in zip(split, tried, strict=True) for x in pair) for tried in exponents for split in splits]
    lower = (SMALLEST_MODULUS_PA, -LARGEST_FITTED_ALPHA, *(terms - 1) * (0.0, -LARGEST_FITTED_ALPHA))
    return FitLaw(f"ogden-{terms}", Ogden, names, lower, terms * (np.inf, LARGEST_FITTED_ALPHA), tuple(shapes))


_RATIOS = [(1.0 - q, q) for q in FIRST_RATIOS]
_THREE_TERMS = [(1.0 - q, q * s, q - q * s) for q, s in product(FIRST_RATIOS, (1.0, 0.9))]
YEOH = _moduli("yeoh", Yeoh, ("C10_Pa", "C20_Pa"), _RATIOS)
FIT_LAWS: dict[str, FitLaw] = {
    law.name: law
    for law in (
        YEOH,
        _moduli("neo-hooke", NeoHooke, ("C10_Pa",), [(1.0,)]),
        _moduli("mooney-rivlin", MooneyRivlin, ("C10_Pa", "C01_Pa"), [*_RATIOS, (0.2, 0.8), (0.05, 0.95)]),
        _moduli("yeoh-3", Yeoh, ("C10_Pa", "C20_Pa", "C30_Pa"), _THREE_TERMS),
        _ogden(1),
        _ogden(2),
        _ogden(3),
    )
}
# Laws of two constants at most, which tests under a tool can be fitted with: one ratio has to be interpolated.
TOOL_LAWS = ("yeoh", "neo-hooke", "mooney-rivlin")


def requested_laws(name: str | None, *, homogeneous: bool) -> list[FitLaw]:
    """The laws to fit, the reported one first; ``--law all`` reports the preferred one.

    Parameters
    ----------
    name : of ``--law``, which fits this law alone; None: Yeoh, compared with all others where that takes no simulations.
    homogeneous : no test needs the simulator.

    Raises
    ------
    InputError : there is no such law, or the tests need the simulator and the law is for homogeneous tests only.
    """
    if name not in (None, ALL, *FIT_LAWS):
        raise InputError(f"`law` {shortened(str(name))}: there is no such law; valid are {', '.join([*FIT_LAWS, ALL])}.")
    if not homogeneous and name not in (None, ALL, *TOOL_LAWS):
        raise InputError(
            f"`law` {name}: this law is fitted to homogeneous tests only (tension, shear, compression between frictionless "
            f"platens); take {', '.join(TOOL_LAWS[:-1])} or {TOOL_LAWS[-1]} for tests under a tool."
        )
    if name == ALL or (name is None and homogeneous):
        return [FIT_LAWS[other] for other in (FIT_LAWS if homogeneous else TOOL_LAWS)]  # Yeoh is the first one.
    return [FIT_LAWS[name or YEOH.name]]
