"""The outcome of a load: an equilibrium, or the state at which the solver stopped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium of the whole tool and body.

    Attributes
    ----------
    force_N, displacement_m : of the tool, positive into the tissue; the displacement counts from first touch.
    iterations : number of iterations.
    residual : norm of the unbalanced nodal forces, relative to those of tool and loads.
    kinetic_ratio : kinetic energy of the last iteration, relative to the work.
    reaction_N : reaction of the base along +z, without the weight that it carries.
    penetration_m : largest penetration of the surface into the tool.
    contact_radius_m : largest distance from the axis at which the tool presses.
    internal_J, hourglass_J : strain energy of the law, and energy of hourglass control.
    contact_J : energy of the contact springs.
    dead_work_J : work of the dead loads so far.
    friction_loss_J : energy lost to friction so far.
    material_loss_J : energy lost in the material so far: work of the stress minus the stored energy.
    smallest_J : smallest volume ratio of any element.
    folded : number of elements that are certainly inverted somewhere.
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
    """A load at which the solver did not converge.

    Attributes
    ----------
    reason : "inverted" or "not-converged".
    goal : the last force [N] or displacement [m] that was attempted.
    reached : the last one that converged.
    residual : relative force residual when the attempt was stopped.
    force_N : force of the tool at that state.
    place_m : (3,) reference position of the largest unbalanced force, or of the inverted element.
    """

    reason: str
    goal: float
    reached: float
    residual: float
    force_N: float
    place_m: np.ndarray
