"""Contact of the free surfaces of a mesh with each other."""

from __future__ import annotations

from dataclasses import dataclass

from explicitfe.fem.inputs.argument import number_like
from explicitfe.fem.inputs.limits import NotNegative, Positive


@dataclass(frozen=True)
class SurfaceContact:
    """Contact between all free surfaces of a mesh: of its bodies, which have no node in common, and of each with itself.

    Parameters
    ----------
    stiffness_Pa_m : pressure over depth at first touch [Pa/m]. If left out it follows from the tissue: the smaller one of both
        sides of ``STIFFNESS_SHARE`` times Young's modulus over the edge of the element.
    friction : coefficient of Coulomb friction.
    damping : damping ratio of two equal surfaces that press on each other; 0 conserves the energy of an elastic impact.

    Raises
    ------
    InputError : a number out of range.
    """

    stiffness_Pa_m: float | None = None
    friction: float = 0.0
    damping: float = 0.2

    def __post_init__(self) -> None:
        if self.stiffness_Pa_m is not None:
            number_like("SurfaceContact: stiffness_Pa_m", self.stiffness_Pa_m, Positive, "stiffness_Pa_m")
        number_like("SurfaceContact: damping", self.damping, NotNegative, "damping")
        number_like("SurfaceContact: friction", self.friction, NotNegative, "friction")
