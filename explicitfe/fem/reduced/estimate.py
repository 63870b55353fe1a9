"""Error estimate of a reduced section: one Newton step of the full section from some of its states.

The step weighs the residual of the full section with its response to the tool (dual-weighted residual; Becker & Rannacher 2001):
it converts the residual at the reduced state into a change of the tool's depth at the same force.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.reduced.section import Followed, ReducedSection
from explicitfe.fem.solve.point import numbers_along
from explicitfe.fem.solve.revolution import Revolution
from explicitfe.fem.solve.tool_surface import add_forces

# Instants with less than this share of the largest force do not count.
LEAST_FORCE_SHARE = 0.02
# Instants at which the memory of the full section is advanced. The stated error is so many times the largest estimate, and this
# share of the height, which the full section itself errs by at a refinement of 1.
MOST_VISITS, SAFETY_FACTOR, LEAST_STATED_SHARE = 400, 1.5, 5e-5


class ErrorEstimate(NamedTuple):
    """The error of a reduced section.

    Attributes
    ----------
    instants : (k,) numbers of the instants that were looked at.
    displacement_m : (k,) what the full section would add there to the displacement at the same force.
    stated_m : the stated error of the displacement at any instant.
    """

    instants: np.ndarray
    displacement_m: np.ndarray
    stated_m: float


def estimate(
    body: ReducedSection, law: Yeoh, effects: Sequence[Effect], time_s: np.ndarray, followed: Followed, count: int = 8
) -> ErrorEstimate:
    """Estimate the error of a programme at some instants, spread evenly over those at which the tool presses."""
    full = Revolution(body.specimen, body.tool, law, effects, body.fineness)
    main, newton, surface = full.main, full.newton, full.section.surface
    n = body.modes.displacements.shape[1]
    pressing = np.flatnonzero(followed.force_N > LEAST_FORCE_SHARE * followed.force_N.max())
    instants = np.unique(pressing[np.linspace(0, len(pressing) - 1, count + 1).astype(int)[1:]])
    visits = np.linspace(0, len(time_s) - 1, MOST_VISITS).astype(int) if main.materials else instants[:0]
    visits = np.union1d(visits, instants)
    numbers = numbers_along(main.materials, np.diff(time_s[visits], prepend=time_s[visits[0]]))
    errors = []
    for row, moving in zip(visits, numbers.moving, strict=True):
        x, force = followed.unknowns[row], followed.force_N[row]
        main.u = body.modes.displacements @ x[:n]
        main.pressures = body.modes.pressures @ x[n:-1] * law.shear_modulus_Pa
        main.depth = x[-1]
        if main.materials:
            numbers.steady[numbers.places] = moving
            main.blocks.effects[:] = numbers.steady[None, :, None]
        rows = newton.evaluate(main, with_stiffness=row in instants)
        if row in instants and rows is not None and newton.factorize():
            (_, deeper, _), _ = newton.step_of(main, rows, (0.0, 1.0), force)
            pushed = np.zeros_like(rows)
            add_forces(full.section.surface_numbers, newton.contact, pushed)
            (_, yields, _), _ = newton.step_of(main, pushed, (0.0, 1.0), 0.0)
            errors.append(deeper + yields + followed.yielded_m[row])
        elif row in instants:
            errors.append(np.inf)
        main.blocks.old[:] = main.blocks.new
        moved = np.einsum("ka,kai->ki", surface.shape, main.u.reshape(-1, 2)[surface.nodes])
        main.anchors[:, :2] = surface.places + moved
        main.anchors[:, 2], main.anchors[:, 3] = main.depth, newton.tractions[:, 0]
    stated = SAFETY_FACTOR * float(np.abs(errors).max()) + LEAST_STATED_SHARE * full.section.height
    return ErrorEstimate(instants, np.array(errors), stated)
