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
    stiffness_Pa_m : pressure over depth [Pa/m]; the same as of contact with bones if left out.
    friction : coefficient of Coulomb friction.

    Raises
    ------
    InputError : a number out of range.
    """

    stiffness_Pa_m: float = 2e7
    friction: float = 0.0

    def __post_init__(self) -> None:
        number_like("SurfaceContact: stiffness_Pa_m", self.stiffness_Pa_m, Positive, "stiffness_Pa_m")
        number_like("SurfaceContact: friction", self.friction, NotNegative, "friction")
