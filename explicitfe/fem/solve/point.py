"""One point of material in a homogeneous state: the response of the elements, with stress-free directions, in milliseconds.

The deformation gradient is given at instants, all but those diagonal entries that are free: they are found so that the stress
there vanishes (uniaxial: two, biaxial: one, shear: none). Between two instants the material remembers as in an equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from explicitfe.fem.effects.complete import complete
from explicitfe.fem.effects.effect import MaterialEffect
from explicitfe.fem.forces import response
from explicitfe.fem.forces.response import WORK_MEMORY
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
STRAIN_TOLERANCE = 1e-12  # of a strain in series with a rig
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


@leaf
def wrong_of(F, answers, unknown, k, loaded, goal, compliance):
    """The stress [Pa] that should vanish at the k-th unknown entry of F (9), or the strain that is missing in a rig."""
    if k >= len(unknown):
        return 0.0
    entry = unknown[k]
    return F[entry] + compliance * answers[0, entry, 0] - goal if entry == loaded else answers[0, entry, 0]


@leaf
def slope_of(answers, unknown, i, j, loaded, compliance):
    """Change of the i-th of these by the j-th unknown entry; where there is none, the entry (i, j) of 1."""
    if max(i, j) >= len(unknown):
        return 1.0 if i == j else 0.0
    slope = (answers[(1 + j) // WIDTH, unknown[i], (1 + j) % WIDTH] - answers[0, unknown[i], 0]) / DIFFERENCE_STEP
    return compliance * slope + (1.0 if i == j else 0.0) if unknown[i] == loaded else slope


@leaf
def correct(F, answers, unknown, loaded, goal, compliance):
    """A correction of the unknown entries of F (9) by Newton's method, with slopes by differences; stretches halve at most."""
    slopes = (
        slope_of(answers, unknown, 0, 0, loaded, compliance),
        slope_of(answers, unknown, 0, 1, loaded, compliance),
        slope_of(answers, unknown, 0, 2, loaded, compliance),
        slope_of(answers, unknown, 1, 0, loaded, compliance),
        slope_of(answers, unknown, 1, 1, loaded, compliance),
        slope_of(answers, unknown, 1, 2, loaded, compliance),
        slope_of(answers, unknown, 2, 0, loaded, compliance),
        slope_of(answers, unknown, 2, 1, loaded, compliance),
        slope_of(answers, unknown, 2, 2, loaded, compliance),
    )
    cof = cofactor(slopes)
    J = determinant(slopes, cof)
    wrong = (
        wrong_of(F, answers, unknown, 0, loaded, goal, compliance),
        wrong_of(F, answers, unknown, 1, loaded, goal, compliance),
        wrong_of(F, answers, unknown, 2, loaded, goal, compliance),
    )
    for i in range(len(unknown)):
        change = (cof[i] * wrong[0] + cof[3 + i] * wrong[1] + cof[6 + i] * wrong[2]) / J
        smallest = 0.5 * F[unknown[i]] if unknown[i] % 4 == 0 else -np.inf
        F[unknown[i]] = max(F[unknown[i]] - change, smallest)


def follow(ends, F, unknown, loaded, compliance, constants, numbers, blocks, work, stress, done):
    """Follow paths, one after the other, each from rest.

    A stress counts as none where it is small beside the stiffness of the state, which is the present shear modulus 2 dW/dI1_bar
    or the largest stress: not that at rest, for a tissue may be soft there and carry its load by what stiffens it.

    Parameters
    ----------
    ends : (m + 1,) where the instants of each path begin, and the end of the last.
    F : (n, 9) deformation gradients, row by row; unknown entries receive what is found.
    unknown : entries of F, three at most: diagonal ones that are free of stress, and ``loaded`` where it is in series with a rig.
    loaded, compliance : the entry that is loaded, and (m,) the strain of the rig per nominal stress [1/Pa].
    constants : (m, j) of the law of each path.
    numbers : of the effects, with one row of ``steady`` (m, k) for each path.
    blocks : as many as hold STATES lanes.
    work : arrays for states (blocks, 9, W) and their answers (blocks, ANSWERS, W); state s stands in block s // W, lane s % W.
    stress : (n, 9) receives the first Piola-Kirchhoff stress [Pa].
    done : (m,) receives the number of instants done.
    """
    states, answers = work
    count, held = len(states), blocks.old.shape[1]
    steady, places, moving = numbers
    for path in range(len(done)):
        for block in range(count):
            for k in range(LAW_CONSTANTS):
                store(blocks.constants, (block * LAW_CONSTANTS + k) * WIDTH, splat(constants[path, k]))
            for k in range(steady.shape[1]):
                store(blocks.effects, (block * blocks.effects.shape[1] + k) * WIDTH, splat(steady[path, k]))
            for k in range(WORK_MEMORY, held):
                store(blocks.old, (block * held + k) * WIDTH, splat(0.0))
        done[path] = ends[path + 1] - ends[path]
        for instant in range(ends[path], ends[path + 1]):
            for block in range(count):
                for k in range(len(places)):
                    store(blocks.effects, (block * blocks.effects.shape[1] + places[k]) * WIDTH, splat(moving[instant, k]))
            goal = F[instant, loaded]
            if instant > ends[path]:
                # The search begins at the volume of the last state, which a nearly incompressible material keeps.
                if compliance[path] > 0.0:
                    F[instant, loaded] = goal - compliance[path] * stress[instant - 1, loaded]
                for k in range(9):
                    states[0, k, 0] = F[instant - 1, k]
                volume, free = determinant_of(states), 0
                for k in range(9):
                    states[0, k, 0] = F[instant, k]
                for entry in unknown:
                    if entry != loaded:
                        states[0, entry, 0] = F[instant - 1, entry]
                        free += 1
                volume /= determinant_of(states)
                kept = volume ** (1.0 / max(free, 1)) if volume > 0.0 else 1.0
                for entry in unknown:
                    if entry != loaded:
                        F[instant, entry] = kept * F[instant - 1, entry]
            solved = False
            for turn in range(NEWTON_TURNS):
                for block in range(count):
                    for k in range(9):
                        store(states, (block * 9 + k) * WIDTH, splat(F[instant, k]))
                for k in range(len(unknown)):
                    states[(1 + k) // WIDTH, unknown[k], (1 + k) % WIDTH] += DIFFERENCE_STEP
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
                if len(unknown) > 0:  # no stretch is negative
                    sound = sound and min(F[instant, 0], F[instant, 4], F[instant, 8]) > 0.0
                largest = 0.0
                for k in range(len(unknown)):
                    wrong = abs(wrong_of(F[instant], answers, unknown, k, loaded, goal, compliance[path]))
                    largest = max(
                        largest, wrong * (stiffness * STRESS_TOLERANCE / STRAIN_TOLERANCE if unknown[k] == loaded else 1.0)
                    )
                small = max(STRESS_TOLERANCE * stiffness, PRESSURE_ROUNDING * constants[path, LAW_CONSTANTS - 1])
                # One correction is always made: where rounding limits the stress, it brings the state below that limit.
                solved = sound and largest <= small and (turn > 0 or largest == 0.0)
                if solved or not sound:
                    break
                correct(F[instant], answers, unknown, loaded, goal, compliance[path])
            if not solved:
                done[path] = instant - ends[path]
                break
            for block in range(count):
                for k in range(WORK_MEMORY, held):
                    store(blocks.old, (block * held + k) * WIDTH, splat(blocks.new[0, k, 0]))
            for k in range(9):
                stress[instant, k] = answers[0, k, 0]


@cache
def _kernel(law: str, layout: response.Layout) -> Dispatcher:
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout, counts_work=False)
    return bind(follow, respond=answer, LAW_CONSTANTS=leaves.count)


def blocks_at_rest(law: Law, effects: Sequence[MaterialEffect], count: int) -> Blocks:
    """Blocks of so many points at rest."""
    rows = -(-count // WIDTH)
    constants = np.tile(np.array(law.constants(), dtype=float)[None, :, None], (rows, 1, WIDTH))
    return Blocks(constants=constants, **memory_of(effects, count), **_without_elements(rows))


@cache
def _without_elements(rows: int) -> dict[str, np.ndarray]:
    """The arrays of ``Blocks`` that points do not have; nothing writes in them."""
    return {
        "nodes": np.zeros((rows, 8, WIDTH), dtype=np.uint32),
        "geometry": np.zeros((rows, 1, WIDTH)),
        "hourglass": np.zeros((rows, 1, WIDTH)),
        **no_muscles(rows),
        **without_barrier(rows),
        "position": np.zeros((0, ROW)),
    }


class Numbers(NamedTuple):
    """Numbers of effects along n instants: all (k,), and places (i,) and values (n, i) of those that depend on the increment."""

    steady: np.ndarray
    places: np.ndarray
    moving: np.ndarray


def numbers_along(effects: Sequence[MaterialEffect], increments_s: np.ndarray) -> Numbers:
    """Numbers of effects for time increments (n,) that end at instants; those that depend on them are 0 in ``steady``."""
    steady: list[float] = []
    places, moving = [np.zeros(0, dtype=np.int64)], [np.zeros((len(increments_s), 0))]
    for effect in effects:
        if effect.transient:
            moving.append(effect.values_along(increments_s))
            places.append(len(steady) + np.arange(effect.numbers))
            steady += effect.numbers * [0.0]
        else:
            steady += effect.values(0.0)
    return Numbers(np.array(steady), np.concatenate(places), np.hstack(moving))


class History(NamedTuple):
    """A material, and the stretches or amounts of shear (n,) that are imposed at times (n,) s; it is at rest before the first.

    ``compliance_per_Pa`` is the strain of a rig in series with the material, per nominal stress [1/Pa].
    """

    law: Law
    effects: Sequence[MaterialEffect]
    time_s: np.ndarray
    imposed: np.ndarray
    compliance_per_Pa: float = 0.0


class Load(NamedTuple):
    """A homogeneous load.

    Attributes
    ----------
    entries : entries of F, numbered row by row, that are imposed.
    free : axes along which the body is free of stress and stays straight.
    answer : the entry of the nominal stress that answers.
    """

    entries: tuple[int, ...]
    free: tuple[int, ...]
    answer: int

    def stresses(self, histories: Sequence[History]) -> list[np.ndarray | RunError]:
        """Nominal stress (n,) Pa in each history, or why there is none; in one call of :func:`follow`.

        Parameters
        ----------
        histories : of laws of one kind, with effects of the same kinds and series of the same length.
        """
        imposed = np.concatenate([history.imposed for history in histories])
        F = np.tile(np.eye(3).ravel(), (len(imposed), 1))
        for entry in self.entries:
            F[:, entry] = imposed
        stress, errors = follow_histories(histories, F, self.free, self.answer)
        ends = np.cumsum([len(history.time_s) for history in histories])[:-1]
        return [error or part for error, part in zip(errors, np.split(stress[:, self.answer], ends), strict=True)]

    def stress(self, law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, imposed: np.ndarray) -> np.ndarray:
        """Nominal stress (n,) Pa of one material.

        Raises
        ------
        RunError : no stress-free state was found at an instant.
        """
        (answer,) = self.stresses([History(law, effects, time_s, imposed)])
        if isinstance(answer, RunError):
            raise answer
        return answer


# Along z with free lateral faces; along x and y with z free; and simple shear, P_xz at F_xz.
UNIAXIAL, BIAXIAL, SHEAR = Load((8,), (0, 1), 8), Load((0, 4), (2,), 0), Load((2,), (), 2)
uniaxial, biaxial, shear = UNIAXIAL.stress, BIAXIAL.stress, SHEAR.stress


def follow_histories(
    histories: Sequence[History], F: np.ndarray, free: Sequence[int], loaded: int = -1
) -> tuple[np.ndarray, list[RunError | None]]:
    """First Piola-Kirchhoff stress (n, 9) Pa along histories, and for each why no state was found.

    Parameters
    ----------
    F : (n, 9) deformation gradients of all histories, row by row; the diagonal entries of free axes receive what is found.
    loaded : the entry of F that is in series with a rig.

    Raises
    ------
    ValueError : a history needs one time for each deformation, at least one, and they must not decrease.
    """
    law, effects = histories[0].law, [complete(history.effects) for history in histories]
    ends = np.cumsum([0, *(len(history.time_s) for history in histories)])
    compliance = np.array([history.compliance_per_Pa for history in histories])
    unknown = np.array([*(4 * i for i in free), *([loaded] if compliance.any() else [])], dtype=np.int64)
    for start in ends[:-1] if len(free) else ():
        held = np.prod([F[start, 4 * i] for i in range(3) if i not in free])
        F[start, [4 * i for i in free]] = held ** (-1.0 / len(free)) if held > 0.0 else 1.0
    increments = [np.concatenate([[0.0], history.time_s[1:] - history.time_s[:-1]]) for history in histories]
    if len(F) != ends[-1] or any(one.min(initial=0.0) < 0.0 for one in increments):
        raise ValueError("a history needs one time for each deformation, at least one, and they must not decrease")
    steady, places, moving = zip(*map(numbers_along, effects, increments), strict=True)
    layout = response.layout_of(effects[0])
    blocks = blocks_at_rest(law, effects[0], STATES)
    count = len(blocks.old)
    constants = np.array([history.law.constants() for history in histories], dtype=float)
    work = np.zeros((count, 9, WIDTH)), np.zeros((count, ANSWERS, WIDTH))
    stress, done = np.empty_like(F), np.zeros(len(histories), dtype=np.int64)
    numbers = Numbers(np.array(steady), places[0], np.concatenate(moving))
    _kernel(law.law, layout)(ends, F, unknown, loaded, compliance, constants, numbers, blocks, work, stress, done)
    return stress, [
        RunError(
            f"no state of uniaxial stress was found at {history.time_s[instants]:g} s; "
            "the deformation is too large for this material."
        )
        if instants < len(history.time_s)
        else None
        for history, instants in zip(histories, done, strict=True)
    ]


def path(
    law: Law, effects: Sequence[MaterialEffect], time_s: np.ndarray, F: np.ndarray, free: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Stress (n, 3, 3) Pa along gradients F (n, 3, 3), and F with its free entries found; see :func:`follow_histories`.

    Raises
    ------
    RunError : no stress-free state was found at an instant.
    """
    gradients = np.array(F, dtype=float).reshape(-1, 9)
    stress, (error,) = follow_histories([History(law, effects, time_s, gradients)], gradients, free)
    if error is not None:
        raise error
    return stress.reshape(-1, 3, 3), gradients.reshape(-1, 3, 3)
