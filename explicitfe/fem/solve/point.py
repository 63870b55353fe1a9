"""One point of material in a homogeneous state: the response of the elements, with stress-free directions, in milliseconds.

The deformation gradient is given at instants, all but those diagonal entries that are free: they are found so that the stress
there vanishes (uniaxial: two, biaxial: one, shear: none). Between two instants the material remembers as in an equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from explicitfe.fem.effects.complete import complete
from explicitfe.fem.effects.effect import MaterialEffect
from explicitfe.fem.forces import response
from explicitfe.fem.materials import Law, law_of
from explicitfe.fem.materials.kinematics import cofactor, determinant
from explicitfe.fem.solve.body import memory_of
from explicitfe.platform.compiled.arrays import Blocks, no_muscles, without_barrier
from explicitfe.platform.compiled.jit import Dispatcher, bind, leaf
from explicitfe.platform.compiled.simd import ROW, WIDTH, load_many, splat, store
from explicitfe.platform.errors import RunError

# Placeholder, bound below.
respond: Any = None
LAW_CONSTANTS = 1
NEWTON_TURNS = 30
DIFFERENCE_STEP = 1e-6  # of a free stretch, for the slope
STRESS_TOLERANCE = 1e-9  # of the stress that vanishes, relative to the stiffness of the state
# What rounding leaves of a pressure, relative to the bulk modulus: J is a sum of products of entries that are rounded.
PRESSURE_ROUNDING = 16.0 * float(np.finfo(float).eps)
ANSWERS = 10  # of a state: nine stresses, and the slope of the energy
STATES = 4  # computed at once: the state itself, and one with each of up to three free entries shifted


@leaf
def determinant_of(states):
    """det F of the first state, the first lane of the first block."""
    return (
        states[0, 0, 0] * (states[0, 4, 0] * states[0, 8, 0] - states[0, 5, 0] * states[0, 7, 0])
        - states[0, 1, 0] * (states[0, 3, 0] * states[0, 8, 0] - states[0, 5, 0] * states[0, 6, 0])
        + states[0, 2, 0] * (states[0, 3, 0] * states[0, 7, 0] - states[0, 4, 0] * states[0, 6, 0])
    )


def follow(F, free, numbers, blocks, states, answers, stress):
    """Follow a path; give the number of instants done.

    A stress counts as none where it is small beside the stiffness of the state, which is the present shear modulus 2 dW/dI1_bar
    or the largest stress: not that at rest, for a tissue may be soft there and carry its load by what stiffens it.

    Parameters
    ----------
    F : (n, 9) deformation gradients, row by row; free entries receive what is found.
    free : (3,) 1 for the diagonal entries that are free of stress.
    numbers : (n, k) numbers of the effects, for the increment that ends at each instant.
    blocks : as many as hold STATES lanes; ``old`` is advanced.
    states, answers : (blocks, 9, W) and (blocks, ANSWERS, W) work arrays; state s stands in block s // W, lane s % W.
    stress : (n, 9) receives the first Piola-Kirchhoff stress [Pa].
    """
    count = len(states)
    for instant in range(len(F)):
        for block in range(count):
            for k in range(numbers.shape[1]):
                for lane in range(WIDTH):
                    blocks.effects[block, k, lane] = numbers[instant, k]
        if instant > 0:
            # The search begins at the volume of the last state, which a nearly incompressible material keeps.
            for k in range(9):
                states[0, k, 0] = F[instant - 1, k]
            volume = determinant_of(states)
            for k in range(9):
                states[0, k, 0] = F[instant, k]
            for i in range(3):
                if free[i] > 0.0:
                    states[0, 4 * i, 0] = F[instant - 1, 4 * i]
            volume /= determinant_of(states)
            kept = volume ** (1.0 / max(np.sum(free), 1.0)) if volume > 0.0 else 1.0
            for i in range(3):
                if free[i] > 0.0:
                    F[instant, 4 * i] = kept * F[instant - 1, 4 * i]
        solved = False
        for turn in range(NEWTON_TURNS):
            for block in range(count):
                for k in range(9):
                    for lane in range(WIDTH):
                        states[block, k, lane] = F[instant, k]
            for i in range(3):
                states[(1 + i) // WIDTH, 4 * i, (1 + i) % WIDTH] += DIFFERENCE_STEP * free[i]
            for block in range(count):
                deformation = load_many(states, block * (9 * WIDTH), 9)
                cof = cofactor(deformation)
                J = determinant(deformation, cof)
                c = load_many(blocks.constants, block * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)
                P, slope = respond(deformation, cof, J, splat(0.0), c, blocks, block)
                for k in range(9):
                    store(answers, (block * ANSWERS + k) * WIDTH, P[k])
                store(answers, (block * ANSWERS + 9) * WIDTH, slope)
            total = answers[0, 0, 0] + determinant_of(states)
            stiffness = max(2.0 * answers[0, 9, 0], abs(answers[0, 0, 0]))
            for k in range(1, 9):
                total += answers[0, k, 0]
                stiffness = max(stiffness, abs(answers[0, k, 0]))
            sound = np.isfinite(total) and determinant_of(states) > 0.0
            largest = 0.0
            slopes = np.eye(3)
            wrong = np.zeros(3)
            for i in range(3):
                if free[i] > 0.0:
                    wrong[i] = answers[0, 4 * i, 0]
                    largest = max(largest, abs(wrong[i]))
                    for j in range(3):
                        if free[j] > 0.0:
                            shifted = answers[(1 + j) // WIDTH, 4 * i, (1 + j) % WIDTH]
                            slopes[i, j] = (shifted - wrong[i]) / DIFFERENCE_STEP
            small = max(STRESS_TOLERANCE * stiffness, PRESSURE_ROUNDING * blocks.constants[0, LAW_CONSTANTS - 1, 0])
            # One correction is always made: where rounding limits the stress, it brings the state below that limit.
            solved = sound and largest <= small and (turn > 0 or largest == 0.0)
            if solved or not sound:
                break
            change = np.linalg.solve(slopes, wrong)
            for i in range(3):
                F[instant, 4 * i] = max(F[instant, 4 * i] - change[i], 0.5 * F[instant, 4 * i])
        if not solved:
            return instant
        for block in range(count):
            for k in range(blocks.old.shape[1]):
                for lane in range(WIDTH):
                    blocks.old[block, k, lane] = blocks.new[0, k, 0]
        for k in range(9):
            stress[instant, k] = answers[0, k, 0]
    return len(F)


@cache
def _kernel(law: str, layout: response.Layout) -> Dispatcher:
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout)
    return bind(follow, allocates=True, respond=answer, LAW_CONSTANTS=leaves.count)


def blocks_at_rest(law: Law, effects: Sequence[MaterialEffect], count: int) -> Blocks:
    """Blocks of so many points at rest."""
    rows = -(-count // WIDTH)
    return Blocks(
        nodes=np.zeros((rows, 8, WIDTH), dtype=np.uint32),
        geometry=np.zeros((rows, 1, WIDTH)),
        constants=np.tile(np.array(law.constants(), dtype=float)[None, :, None], (rows, 1, WIDTH)),
        hourglass=np.zeros((rows, 1, WIDTH)),
        **memory_of(effects, count),
        **no_muscles(rows),
        **without_barrier(rows),
        position=np.zeros((0, ROW)),
    )


def numbers_along(effects: Sequence[MaterialEffect], time_s: np.ndarray) -> np.ndarray:
    """Numbers (n, k) of the effects for the increment that ends at each instant."""
    increments = np.diff(time_s, prepend=time_s[0])
    return np.hstack([effect.values_along(increments) for effect in effects]) if effects else np.zeros((len(time_s), 1))


def path(
    law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, F: np.ndarray, free: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """First Piola-Kirchhoff stress along a path of deformation gradients.

    Parameters
    ----------
    law, effects : the material.
    time_s : (n,) s, not decreasing; what the material remembers begins at rest at the first.
    F : (n, 3, 3). Entries of ``free`` are ignored.
    free : axes (0, 1, 2) along which the body is free of stress and stays straight.

    Returns
    -------
    stress : (n, 3, 3) Pa.
    F : (n, 3, 3) with the free entries as they were found.

    Raises
    ------
    ValueError : times_s needs one time for each deformation, at least one, and must not decrease.
    RunError : no stress-free state was found at an instant.
    """
    time_s = np.asarray(time_s, dtype=float)
    if len(time_s) != len(F) or len(F) == 0 or (np.diff(time_s) < 0.0).any():
        raise ValueError("times_s needs one time for each deformation, at least one, and must not decrease")
    gradients = np.array(F, dtype=float).reshape(-1, 9)
    freed = np.zeros(3)
    freed[list(free)] = 1.0
    if len(free):
        others = np.prod([gradients[0, 4 * i] for i in range(3) if i not in free])
        gradients[0, [4 * i for i in free]] = others ** (-1.0 / len(free)) if others > 0.0 else 1.0
    effects = complete(effects)
    blocks = blocks_at_rest(law, effects, STATES)
    count = len(blocks.old)
    stress = np.zeros_like(gradients)
    work = np.zeros((count, 9, WIDTH)), np.zeros((count, ANSWERS, WIDTH))
    done = _kernel(law.law, response.layout_of(effects))(gradients, freed, numbers_along(effects, time_s), blocks, *work, stress)
    if done < len(gradients):
        raise RunError(
            f"no state of uniaxial stress was found at {time_s[done]:g} s; the deformation is too large for this material."
        )
    return stress.reshape(-1, 3, 3), gradients.reshape(-1, 3, 3)


def uniaxial(law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, stretch: np.ndarray, axis: int = 2) -> np.ndarray:
    """Nominal stress (n,) Pa along an axis at stretches (n,), lateral faces free; see :func:`path`."""
    F = np.tile(np.eye(3), (len(stretch), 1, 1))
    F[:, axis, axis] = stretch
    stress, _ = path(law, effects, time_s, F, [k for k in range(3) if k != axis])
    return stress[:, axis, axis]


def biaxial(law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, stretch: np.ndarray) -> np.ndarray:
    """Nominal stress (n,) Pa at equal stretches (n,) along x and y, z free."""
    F = np.tile(np.eye(3), (len(stretch), 1, 1))
    F[:, 0, 0] = F[:, 1, 1] = stretch
    return path(law, effects, time_s, F, [2])[0][:, 0, 0]


def shear(law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """Shear stress (n,) Pa at amounts (n,) of simple shear, P_xz at F_xz."""
    F = np.tile(np.eye(3), (len(amount), 1, 1))
    F[:, 0, 2] = amount
    return path(law, effects, time_s, F, [])[0][:, 0, 2]
