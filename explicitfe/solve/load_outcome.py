"""What a load comes to: an equilibrium, or where it got stuck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Equilibrium:
    """A converged load, for the whole tool and body.

    Attributes
    ----------
    force_N, displacement_m : of the tool, positive into the tissue; the displacement counts from first touch.
    iterations : that it took, of all its parts.
    residual : of the nodal forces, relative to those of tool and loads.
    kinetic_ratio : kinetic energy of the last iteration, relative to the work.
    reaction_N : of the base along +z, less the weight that it carries.
    penetration_m : deepest point of the surface inside the tool.
    contact_radius_m : largest distance from the axis at which the tool presses.
    internal_J, hourglass_J : strain energy of the law, and energy of hourglass control.
    contact_J : energy of the contact springs.
    dead_work_J : work of the dead loads so far.
    friction_loss_J : slip so far, times friction.
    material_loss_J : work of the stress so far, less what is stored.
    smallest_J : smallest volume ratio of any element.
    folded : elements that are folded somewhere, for certain.
    """

    force_N: float
    displacement_m: float
    iterations: int
    residual: float
    kinetic_ratio: float
    reaction_N: float
    penetration_m: float
    contact_radius_m: float
    internal_J: float
    hourglass_J: float
    contact_J: float
    dead_work_J: float
    friction_loss_J: float
    material_loss_J: float
    smallest_J: float
    folded: int


@dataclass(frozen=True)
class Stuck:
    """A load that was not reached.

    Attributes
    ----------
    reason : "inverted" or "not-converged".
    goal : the force [N] or displacement [m] aimed at last.
    reached : the last that converged.
    residual : where the attempt was given up.
    force_N : of the tool there.
    place_m : (3,) where the largest unbalanced force, or the broken element, is.
    """

    reason: str
    goal: float
    reached: float
    residual: float
    force_N: float
    place_m: np.ndarray
