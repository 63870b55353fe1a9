"""The equations of a reduced section, and how they are followed in time: compiled code.

Unknowns are the amounts of n modes of displacement and of k modes of pressure, and the depth of the tool, N = n + k + 1. The
section keeps its volume: each mode of pressure demands that the volume, weighted with it, does not change.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from explicitfe.fem.forces import response
from explicitfe.fem.materials import law_of
from explicitfe.fem.solve.quad9 import SCALE, UNSHIFTED, answers_of
from explicitfe.fem.solve.section import Edges
from explicitfe.fem.solve.tool_surface import touch
from explicitfe.platform.compiled.jit import Dispatcher, bind

# Placeholders, bound below.
answers_at: Any = None
touch_at: Any = None
contact_at: Any = None
residual_at: Any = None
derivatives_at: Any = None
converge_at: Any = None
DIFFERENCE_STEP = 1e-6
# Convergence tolerance of a step relative to the tool's way, which counts as at least this share of the height.
TOLERANCE_SHARE, LEAST_WAY_SHARE = 1e-5, 1e-2
# Derivatives are taken again where a step is not smaller than the last by this ratio, and after so many instants.
SLOW_RATIO, MOST_INSTANTS = 0.5, 25
MOST_TURNS, MOST_CUTS, SMALLEST_SHARE = 25, 5, 1.0 / 128.0
# No step is longer than this share of the height.
LONGEST_STEP_SHARE = 0.2
# What the springs give way by is not found where the force is below this share of the largest one.
WEIGHED_SHARE, LEAST_WEIGHED_SHARE, LEAST_GIVING, MOST_GIVING, GIVING_TOLERANCE = 0.05, 0.01, 0.5, 4.0, 1e-5
# Entries of the state beside the unknowns.
GIVING, AGE, COORDINATE, LARGEST, WEIGHED, YIELDED, STATE = range(7)


class Reduced(NamedTuple):
    """What does not change while a section is followed; p Gauss points and s displacements of the surface.

    Attributes
    ----------
    gradients : (5 p, n) displacement gradients of the modes.
    pressures : (p, k) of the modes, times the shear modulus [Pa].
    weights : (p,) volumes that the points stand for [m^3].
    linear : (9, 3) zeros: no point has a pressure beside that of the modes.
    surface : the points that the tool can meet, with nodes counted within the surface.
    lifted : (s, n) displacements of the surface's nodes by the modes.
    springs, dead : (n, n) of the base [N/m], and (n,) weight [N].
    tool : see solve/tool_surface.py.
    unit : the shear modulus [Pa].
    """

    gradients: np.ndarray
    pressures: np.ndarray
    weights: np.ndarray
    linear: np.ndarray
    surface: Edges
    lifted: np.ndarray
    springs: np.ndarray
    dead: np.ndarray
    tool: np.ndarray
    unit: float


class ReducedWork(NamedTuple):
    """Work arrays.

    Attributes
    ----------
    flat, stress, local, volume : (5 p,) deformation gradients, the same of weighted stresses, (5 p, n) of derivatives of the
        stresses, and (p, n) of the volumes.
    pressures, grown : (p,) pressures, and changes of the volumes of the points.
    none, slopes : (p, 3) zeros, and (5, 5).
    moved, pushed, pull, on_surface : (s,) displacements and forces of the surface, their derivatives by the depth, and (s, s)
        stiffness.
    contact, contact_stiffness, tractions : see solve/tool_surface.py.
    rows, matrix, inverse, by_force : (N,) residual, (N, N) its derivatives and their inverse, (N,) those of the tool's force.
    """

    flat: np.ndarray
    stress: np.ndarray
    local: np.ndarray
    volume: np.ndarray
    pressures: np.ndarray
    grown: np.ndarray
    none: np.ndarray
    slopes: np.ndarray
    moved: np.ndarray
    pushed: np.ndarray
    pull: np.ndarray
    on_surface: np.ndarray
    contact: np.ndarray
    contact_stiffness: np.ndarray
    tractions: np.ndarray
    rows: np.ndarray
    matrix: np.ndarray
    inverse: np.ndarray
    by_force: np.ndarray


def work_arrays(reduced: Reduced) -> ReducedWork:
    """Work arrays for a section."""
    p, k = reduced.pressures.shape
    s, n = reduced.lifted.shape
    points, unknowns = len(reduced.surface.areas), n + k + 1
    shapes: list[tuple[int, ...]] = [(5 * p,), (5 * p,), (5 * p, n), (p, n), (p,), (p,), (p, 3), (5, 5), (s,), (s,), (s,), (s, s)]
    shapes += [(points, 7), (points, 7, 7), (points, 2), (unknowns,), (unknowns, unknowns), (unknowns, unknowns), (unknowns,)]
    return ReducedWork(*map(np.zeros, shapes))


def contact(x, anchors, reduced, work):
    """Forces on the surface into ``work.pushed``; gives the force on the tool [N], and how far the contact's springs give way."""
    np.dot(reduced.lifted, x[: reduced.lifted.shape[1]], work.moved)
    touch_at(work.moved, x[-1], reduced.tool, reduced.surface, anchors, work.contact, work.contact_stiffness, work.tractions)
    work.pushed[:] = 0.0
    force, square = 0.0, 0.0
    for p in range(len(work.contact)):
        if work.tractions[p, 1] > 0.0:
            force += work.contact[p, 6]
            square += reduced.surface.areas[p] * work.tractions[p, 1] ** 2
            for a in range(3):
                node = reduced.surface.nodes[p, a]
                work.pushed[2 * node] += work.contact[p, 2 * a]
                work.pushed[2 * node + 1] += work.contact[p, 2 * a + 1]
    return force, square / (reduced.tool[4] * force) if force > 0.0 else 0.0


def residual(x, anchors, way, yielded, goal, reduced, points, blocks, work):
    """Unbalanced forces [N], changes of volume times the shear modulus, and distance to the goal into ``work.rows``.

    Parameters
    ----------
    way : (2,) weights of depth and force in what reaches the goal.
    yielded : what the springs of the contact give way by, as it was estimated before [m].
    points : work arrays of the Gauss points, see solve/quad9.py.

    Returns
    -------
    sound, force, compression : no Gauss point is inverted; on the tool [N], and of the springs of the contact [m].
    """
    n, k = reduced.gradients.shape[1], reduced.pressures.shape[1]
    rows = work.rows
    np.dot(reduced.gradients, x[:n], work.flat)
    for p in range(len(reduced.weights)):
        F = points.gradients[p]
        for i in range(5):
            F[i] = work.flat[5 * p + i] + (0.0 if i == 1 or i == 2 else 1.0)
        J = F[4] * (F[0] * F[3] - F[1] * F[2])
        if not (J > 0.0 and F[4] > 0.0):
            return False, 0.0, 0.0
        points.volumes[p, 0], points.volumes[p, 1] = J, J ** (-1.0 / 3.0)
    answers_at(work.none, UNSHIFTED, 0.0, reduced, blocks, points)
    np.dot(reduced.pressures, x[n : n + k], work.pressures)
    for p in range(len(reduced.weights)):
        F, w, pressure = points.gradients[p], reduced.weights[p], work.pressures[p]
        work.grown[p] = w * (points.volumes[p, 0] - 1.0)
        cof = (F[4] * F[3], -F[4] * F[2], -F[4] * F[1], F[4] * F[0], F[0] * F[3] - F[1] * F[2])
        for i in range(5):
            work.stress[5 * p + i] = w * (points.answers[UNSHIFTED, p, i] + pressure * cof[i])
    force, compression = contact_at(x, anchors, reduced, work)
    np.dot(work.pushed, reduced.lifted, rows[:n])
    rows[:n] += np.dot(work.stress, reduced.gradients)
    rows[:n] += np.dot(reduced.springs, x[:n])
    rows[:n] -= reduced.dead
    np.dot(work.grown, reduced.pressures, rows[n : n + k])
    rows[-1] = way[0] * (x[-1] - yielded) + way[1] * force - goal
    return np.isfinite(np.sum(rows)), force, compression


def derivatives(x, way, reduced, points, blocks, work):
    """The inverse of the derivatives of the state evaluated last into ``work.inverse``; False where there is none."""
    n, k = reduced.gradients.shape[1], reduced.pressures.shape[1]
    for column in range(SCALE + 1):
        answers_at(work.none, column, DIFFERENCE_STEP, reduced, blocks, points)
    answers_at(work.none, UNSHIFTED, 0.0, reduced, blocks, points)  # the memory ends at the state without a shift
    slopes = work.slopes
    for p in range(len(reduced.weights)):
        F, w, answer = points.gradients[p], reduced.weights[p], points.answers[UNSHIFTED, p]
        J, s = points.volumes[p, 0], points.volumes[p, 1]
        cof = (F[4] * F[3], -F[4] * F[2], -F[4] * F[1], F[4] * F[0], F[0] * F[3] - F[1] * F[2])
        pressure = work.pressures[p]
        for i in range(5):
            of_s = (points.answers[SCALE, p, i] - answer[i]) / DIFFERENCE_STEP * s / (3.0 * J)
            for j in range(5):
                slopes[i, j] = (points.answers[j, p, i] - answer[i]) / DIFFERENCE_STEP - of_s * cof[j]
        for i, j, value in ((0, 3, F[4]), (0, 4, F[3]), (1, 2, -F[4]), (1, 4, -F[2]), (2, 4, -F[1]), (3, 4, F[0])):
            slopes[i, j] += pressure * value
            slopes[j, i] += pressure * value
        for m in range(n):
            volume = 0.0
            for i in range(5):
                volume += cof[i] * reduced.gradients[5 * p + i, m]
                total = 0.0
                for j in range(5):
                    total += slopes[i, j] * reduced.gradients[5 * p + j, m]
                work.local[5 * p + i, m] = w * total
            work.volume[p, m] = w * volume
    work.on_surface[:] = 0.0
    work.by_force[:] = 0.0
    column = work.pull
    column[:] = 0.0
    for p in range(len(work.contact)):
        if work.tractions[p, 1] > 0.0:
            for a in range(6):
                i = 2 * reduced.surface.nodes[p, a // 2] + a % 2
                column[i] += work.contact_stiffness[p, a, 6]
                for b in range(6):
                    work.on_surface[i, 2 * reduced.surface.nodes[p, b // 2] + b % 2] += work.contact_stiffness[p, a, b]
                for m in range(n):
                    work.by_force[m] += work.contact_stiffness[p, 6, a] * reduced.lifted[i, m]
            work.by_force[-1] += work.contact_stiffness[p, 6, 6]
    matrix = work.matrix
    matrix[:] = 0.0
    own = np.dot(reduced.gradients.T, work.local) + np.dot(reduced.lifted.T, np.dot(work.on_surface, reduced.lifted))
    coupling = np.dot(reduced.pressures.T, work.volume)
    matrix[:n, :n] = own + reduced.springs
    matrix[n : n + k, :n] = coupling
    matrix[:n, n : n + k] = coupling.T
    matrix[:n, n + k] = np.dot(column, reduced.lifted)
    matrix[n + k] = way[1] * work.by_force
    matrix[n + k, n + k] += way[0]
    if not np.isfinite(np.sum(matrix)):
        return False
    work.inverse[:] = np.linalg.inv(matrix)
    return True


def converge(x, state, anchors, way, goal, reduced, points, blocks, work):
    """Newton's method with derivatives that are corrected by each step (Broyden 1965); gives whether it converges, and the force.

    Parameters
    ----------
    x : (N,) unknowns; they are advanced.
    state : see the entries GIVING to YIELDED; the giving of the springs and the age of the derivatives are advanced.
    """
    n, height = reduced.gradients.shape[1], reduced.tool[0]
    length = np.sqrt(height)
    fresh = False
    sound, force, compression = residual_at(x, anchors, way, state[YIELDED], goal, reduced, points, blocks, work)
    if not sound:
        return False, force, compression
    if state[AGE] < 0.0:
        if not derivatives_at(x, way, reduced, points, blocks, work):
            return False, force, compression
        state[AGE], fresh = 0.0, True
    step = -np.dot(work.inverse, work.rows)
    size = max(np.sqrt(np.sum(step[:n] ** 2)) / length, abs(step[-1]))
    factor = 1.0
    for _turn in range(MOST_TURNS):
        if size <= TOLERANCE_SHARE * max(abs(x[-1]), LEAST_WAY_SHARE * height):
            least = max(abs(x[-1]), LEAST_WAY_SHARE * height)
            moved = abs(x[-1] - state[WEIGHED]) >= WEIGHED_SHARE * least or state[AGE] >= MOST_INSTANTS
            if moved and force > LEAST_WEIGHED_SHARE * state[LARGEST] and compression > 0.0:
                # What the springs give way by is inverse to their stiffness, at the same force (Richardson).
                state[LARGEST], state[WEIGHED] = max(state[LARGEST], force), x[-1]
                if not derivatives_at(x, way, reduced, points, blocks, work):
                    return False, force, compression
                state[AGE], fresh = 0.0, True
                push = np.zeros_like(x)
                push[:n] = np.dot(work.pushed, reduced.lifted)
                push[-1] = way[1] * force
                answer = -np.dot(work.inverse, push)
                along = work.inverse[:, -1].copy()
                share = -(force + np.dot(work.by_force, answer)) / np.dot(work.by_force, along)
                ratio = -(share * along[-1] + answer[-1]) / compression
                state[GIVING] = min(max(ratio, LEAST_GIVING), MOST_GIVING)
            change = state[GIVING] * compression - state[YIELDED]
            state[YIELDED] += change
            if way[0] == 0.0 or abs(change) <= GIVING_TOLERANCE * least:
                return True, force, compression
            work.rows[-1] -= way[0] * change
            step = -np.dot(work.inverse, work.rows)
            size = max(np.sqrt(np.sum(step[:n] ** 2)) / length, abs(step[-1]))
        factor = min(1.0, 4.0 * factor, LONGEST_STEP_SHARE * height / size)
        before = x.copy()
        accepted = False
        for _cut in range(MOST_CUTS if fresh else 1):
            x[:] = before + factor * step
            sound, force, compression = residual_at(x, anchors, way, state[YIELDED], goal, reduced, points, blocks, work)
            if sound:
                following = -np.dot(work.inverse, work.rows)
                next_size = max(np.sqrt(np.sum(following[:n] ** 2)) / length, abs(following[-1]))
                if next_size <= (1.0 - 0.25 * factor) * size:
                    accepted = True
                    break
            factor *= 0.5
        if not accepted and fresh:
            x[:] = before
            return False, force, compression
        if not accepted:
            x[:] = before
            sound, force, compression = residual_at(x, anchors, way, state[YIELDED], goal, reduced, points, blocks, work)
            factor = 1.0
        elif factor == 1.0 and next_size <= SLOW_RATIO * size:
            # Broyden's correction: the last step, with what it has left of the residual.
            change = -following + step  # the inverse times the change of the residual
            dot = np.dot(step, change)
            if dot != 0.0:
                left = np.dot(step, work.inverse) / dot
                for i in range(len(x)):
                    for j in range(len(x)):
                        work.inverse[i, j] += following[i] * left[j]
            step = -np.dot(work.inverse, work.rows)
            size = max(np.sqrt(np.sum(step[:n] ** 2)) / length, abs(step[-1]))
            fresh = False
            continue
        if not derivatives_at(x, way, reduced, points, blocks, work):
            return False, force, compression
        state[AGE], fresh = 0.0, True
        step = -np.dot(work.inverse, work.rows)
        size = max(np.sqrt(np.sum(step[:n] ** 2)) / length, abs(step[-1]))
    return False, force, compression


def follow(imposed, numbers, ahead, way, history, state, anchors, reduced, points, blocks, work, answers, states):
    """Find the equilibria at all instants; give the number of instants done.

    Parameters
    ----------
    imposed : (i,) goals, see :func:`residual`.
    numbers : (i, j) numbers of the effects for the increment that ends at each instant.
    ahead : (i, 3) weights of the last three states, the latest first, in what each search begins with.
    history : (3, N) the last three states, the latest first.
    answers, states : (i, 2) force [N] and depth without what the springs give way by [m]; (i, N) unknowns.
    """
    x = history[0].copy()
    yielded = np.full(3, state[YIELDED])
    for instant in range(len(imposed)):
        for block in range(len(blocks.effects)):
            for k in range(numbers.shape[1]):
                for lane in range(blocks.effects.shape[2]):
                    blocks.effects[block, k, lane] = numbers[instant, k]
        goal, old, weights = imposed[instant], state[COORDINATE], ahead[instant]
        leads = weights[1] != 0.0
        x[:] = np.dot(weights, history)
        state[YIELDED] = np.dot(weights, yielded)
        done, share = 0.0, 1.0
        force, compression = 0.0, 0.0
        while done < 1.0:
            start = history[0] if done == 0.0 else x.copy()
            now = goal if done + share >= 1.0 else old + (done + share) * (goal - old)
            fine, force, compression = converge_at(x, state, anchors, way, now, reduced, points, blocks, work)
            if fine:
                done += share
                share = min(1.5 * share, 1.0 - done)
                continue
            x[:] = start
            state[AGE], state[YIELDED] = -1.0, yielded[0]
            if leads:
                leads = False
            elif share <= SMALLEST_SHARE:
                return instant
            else:
                share *= 0.5
        history[2], history[1], history[0] = history[1], history[0], x
        yielded[2], yielded[1], yielded[0] = yielded[1], yielded[0], state[YIELDED]
        state[COORDINATE] = goal
        state[AGE] += 1.0
        answers[instant, 0], answers[instant, 1] = force, x[-1] - state[GIVING] * compression
        states[instant] = x
        for p in range(len(anchors)):
            for i in range(2):
                anchors[p, i] = reduced.surface.places[p, i]
                for a in range(3):
                    anchors[p, i] += reduced.surface.shape[p, a] * work.moved[2 * reduced.surface.nodes[p, a] + i]
            anchors[p, 2], anchors[p, 3] = x[-1], work.tractions[p, 0]
        for block in range(len(blocks.old)):
            for k in range(blocks.old.shape[1]):
                for lane in range(blocks.old.shape[2]):
                    blocks.old[block, k, lane] = blocks.new[block, k, lane]
    return len(imposed)


@cache
def follower(law: str, layout: response.Layout) -> Dispatcher:
    """:func:`follow` for a law with effects."""
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout)
    points = bind(answers_of, stored=False, respond=answer, LAW_CONSTANTS=leaves.count)
    tool = bind(contact, stored=False, allocates=True, touch_at=bind(touch.py_func, stored=False))
    rows = bind(residual, stored=False, allocates=True, answers_at=points, contact_at=tool)
    slopes = bind(derivatives, stored=False, allocates=True, answers_at=points)
    newton = bind(converge, stored=False, allocates=True, residual_at=rows, derivatives_at=slopes)
    return bind(follow, allocates=True, converge_at=newton)
