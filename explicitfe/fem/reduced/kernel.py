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
from explicitfe.fem.solve.revolution import GIVING_TOLERANCE, LEAST_GIVING, LEAST_WEIGHED_SHARE, MOST_GIVING
from explicitfe.fem.solve.section import Edges
from explicitfe.fem.solve.section_newton import DIFFERENCE_STEP, LEAST_WAY_SHARE, MOST_CUTS
from explicitfe.fem.solve.tool_surface import touch
from explicitfe.platform.compiled.jit import Dispatcher, bind, leaf

# Placeholders, bound below.
answers_at: Any = None
touch_at: Any = None
residual_at: Any = None
derivatives_at: Any = None
step_at: Any = None
giving_at: Any = None
converge_at: Any = None
# Convergence tolerance of a step relative to the tool's way.
REDUCED_TOLERANCE_SHARE = 1e-5
# Derivatives are taken again where a step is not smaller than the last by this ratio, and after so many instants.
SLOW_RATIO, MOST_INSTANTS = 0.5, 25
MOST_REDUCED_TURNS, SMALLEST_LOAD_SHARE = 25, 1.0 / 128.0
# No step is longer than this share of the height.
LONGEST_REDUCED_STEP_SHARE = 0.2
# What the springs of the contact give way by is found again where the depth has changed by this share.
WEIGHED_SHARE = 0.05
# State beside the unknowns: that ratio, the age of the derivatives in instants (below 0: there are none), the last goal, the
# largest force, the depth at which the ratio was found, and what the springs give way by [m].
GIVING, AGE, COORDINATE, LARGEST, WEIGHED, YIELDED, STATE = range(7)


class Reduced(NamedTuple):
    """What does not change while a section is followed; p Gauss points and s displacements of the surface.

    Attributes
    ----------
    gradients, weights : (5 p, n) displacement gradients of the modes, and (p,) volumes that the points stand for [m^3].
    pressures : (p, k) of the modes, times the shear modulus [Pa].
    linear : (9, 3) zeros: no point has a pressure beside that of the modes.
    surface, lifted : the points that the tool can meet, with nodes counted within the surface, and (s, n) their modes.
    springs, dead : (n, n) of the base [N/m], and (n,) weight [N].
    tool : see solve/tool_surface.py.
    """

    gradients: np.ndarray
    weights: np.ndarray
    pressures: np.ndarray
    linear: np.ndarray
    surface: Edges
    lifted: np.ndarray
    springs: np.ndarray
    dead: np.ndarray
    tool: np.ndarray


class ReducedWork(NamedTuple):
    """Of the state evaluated last.

    Attributes
    ----------
    none, pressures : (p, 3) zeros, and (p,) pressures at the points [Pa].
    moved, pushed : (s,) displacements [m] and forces [N] of the surface.
    contact, contact_stiffness, tractions : see solve/tool_surface.py.
    rows, inverse, by_force : (N,) residual, (N, N) inverse of its derivatives, and (N,) derivatives of the tool's force.
    """

    none: np.ndarray
    pressures: np.ndarray
    moved: np.ndarray
    pushed: np.ndarray
    contact: np.ndarray
    contact_stiffness: np.ndarray
    tractions: np.ndarray
    rows: np.ndarray
    inverse: np.ndarray
    by_force: np.ndarray


def work_arrays(reduced: Reduced) -> ReducedWork:
    """Work arrays for a section."""
    (p, k), (s, n), points = reduced.pressures.shape, reduced.lifted.shape, len(reduced.surface.areas)
    N = n + k + 1
    return ReducedWork(*map(np.zeros, [(p, 3), p, s, s, (points, 7), (points, 7, 7), (points, 2), N, (N, N), N]))


@leaf
def cofactor_of(F):
    """Derivatives of the determinant of a deformation gradient (5,)."""
    return F[4] * F[3], -F[4] * F[2], -F[4] * F[1], F[4] * F[0], F[0] * F[3] - F[1] * F[2]


def residual(x, anchors, control, yielded, goal, reduced, points, blocks, work):
    """Unbalanced forces [N], changes of volume times the shear modulus, and distance to the goal into ``work.rows``.

    Parameters
    ----------
    control : (2,) weights of depth and force in what reaches the goal.
    yielded : what the springs of the contact give way by, as it was estimated before [m].
    points : work arrays of the Gauss points, see solve/quad9.py.

    Returns
    -------
    sound, force, compression : no Gauss point is inverted; on the tool [N], and what the springs give way by, at least [m].
    """
    n, rows, count = reduced.gradients.shape[1], work.rows, len(reduced.weights)
    flat = np.dot(reduced.gradients, x[:n])
    for p in range(count):
        F = points.gradients[p]
        for i in range(5):
            F[i] = flat[5 * p + i] + (0.0 if i == 1 or i == 2 else 1.0)
        J = F[4] * (F[0] * F[3] - F[1] * F[2])
        if not (J > 0.0 and F[4] > 0.0):
            return False, 0.0, 0.0
        points.volumes[p, 0], points.volumes[p, 1] = J, J ** (-1.0 / 3.0)
    answers_at(work.none, UNSHIFTED, 0.0, reduced, blocks, points)
    np.dot(reduced.pressures, x[n:-1], work.pressures)
    grown = np.empty(count)
    for p in range(count):
        w, cof = reduced.weights[p], cofactor_of(points.gradients[p])
        grown[p] = w * (points.volumes[p, 0] - 1.0)
        for i in range(5):
            flat[5 * p + i] = w * (points.answers[UNSHIFTED, p, i] + work.pressures[p] * cof[i])
    np.dot(reduced.lifted, x[:n], work.moved)
    touch_at(work.moved, x[-1], reduced.tool, reduced.surface, anchors, work.contact, work.contact_stiffness, work.tractions)
    work.pushed[:] = 0.0
    force, square = 0.0, 0.0
    for p in range(len(work.contact)):
        if work.tractions[p, 1] > 0.0:
            force += work.contact[p, 6]
            square += reduced.surface.areas[p] * work.tractions[p, 1] ** 2
            for a in range(6):
                work.pushed[2 * reduced.surface.nodes[p, a // 2] + a % 2] += work.contact[p, a]
    rows[:n] = np.dot(work.pushed, reduced.lifted) + np.dot(flat, reduced.gradients)
    rows[:n] += np.dot(reduced.springs, x[:n]) - reduced.dead
    rows[n:-1] = np.dot(grown, reduced.pressures)
    rows[-1] = control[0] * (x[-1] - yielded) + control[1] * force - goal
    return np.isfinite(np.sum(rows)), force, square / (reduced.tool[4] * force) if force > 0.0 else 0.0


def derivatives(control, reduced, points, blocks, work):
    """The inverse of the derivatives of the state evaluated last into ``work.inverse``; False where there is none."""
    n, N = reduced.gradients.shape[1], len(work.rows)
    for column in range(SCALE + 1):
        answers_at(work.none, column, DIFFERENCE_STEP, reduced, blocks, points)
    answers_at(work.none, UNSHIFTED, 0.0, reduced, blocks, points)  # the memory ends at the state without a shift
    local, volume, slopes = np.empty(reduced.gradients.shape), np.empty((len(reduced.weights), n)), np.empty((5, 5))
    for p in range(len(reduced.weights)):
        F, w, answer = points.gradients[p], reduced.weights[p], points.answers[UNSHIFTED, p]
        cof, pressure = cofactor_of(F), work.pressures[p]
        for i in range(5):
            of_s = (points.answers[SCALE, p, i] - answer[i]) * points.volumes[p, 1] / (3.0 * points.volumes[p, 0])
            for j in range(5):
                slopes[i, j] = (points.answers[j, p, i] - answer[i] - of_s * cof[j]) / DIFFERENCE_STEP
        for i, j, value in ((0, 3, F[4]), (0, 4, F[3]), (1, 2, -F[4]), (1, 4, -F[2]), (2, 4, -F[1]), (3, 4, F[0])):
            slopes[i, j] += pressure * value
            slopes[j, i] += pressure * value
        for m in range(n):
            volume[p, m] = 0.0
            for i in range(5):
                volume[p, m] += w * cof[i] * reduced.gradients[5 * p + i, m]
                total = 0.0
                for j in range(5):
                    total += slopes[i, j] * reduced.gradients[5 * p + j, m]
                local[5 * p + i, m] = w * total
    size = len(work.pushed)
    on_surface, by_depth, by_surface = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    work.by_force[:] = 0.0
    for p in range(len(work.contact)):
        if work.tractions[p, 1] > 0.0:
            work.by_force[-1] += work.contact_stiffness[p, 6, 6]
            for a in range(6):
                i = 2 * reduced.surface.nodes[p, a // 2] + a % 2
                by_depth[i] += work.contact_stiffness[p, a, 6]
                by_surface[i] += work.contact_stiffness[p, 6, a]
                for b in range(6):
                    on_surface[i, 2 * reduced.surface.nodes[p, b // 2] + b % 2] += work.contact_stiffness[p, a, b]
    work.by_force[:n] = np.dot(by_surface, reduced.lifted)
    matrix = np.zeros((N, N))
    matrix[:n, :n] = np.dot(reduced.lifted.T, np.dot(on_surface, reduced.lifted)) + reduced.springs
    matrix[:n, :n] += np.dot(reduced.gradients.T, local)
    coupling = np.dot(reduced.pressures.T, volume)
    matrix[n:-1, :n], matrix[:n, n:-1] = coupling, coupling.T
    matrix[:n, -1] = np.dot(by_depth, reduced.lifted)
    matrix[-1] = control[1] * work.by_force
    matrix[-1, -1] += control[0]
    if not np.isfinite(np.sum(matrix)):
        return False
    work.inverse[:] = np.linalg.inv(matrix)
    return True


def newton_step(reduced, work):
    """Newton's step (N,) with the present derivatives, and its size [m]: about the displacement that its energy stands for."""
    step = -np.dot(work.inverse, work.rows)
    energy = np.sqrt(np.sum(step[: reduced.gradients.shape[1]] ** 2) / reduced.tool[0])
    return step, max(energy, abs(step[-1]))


def giving(control, force, compression, reduced, work):
    """What the springs give way by over the simplest estimate; it is inverse to their stiffness (Richardson)."""
    push = np.zeros_like(work.rows)
    push[: reduced.gradients.shape[1]] = np.dot(work.pushed, reduced.lifted)
    push[-1] = control[1] * force
    answer, along = -np.dot(work.inverse, push), work.inverse[:, -1].copy()
    share = -(force + np.dot(work.by_force, answer)) / np.dot(work.by_force, along)
    return min(max(-(share * along[-1] + answer[-1]) / compression, LEAST_GIVING), MOST_GIVING)


def converge(x, state, anchors, control, goal, reduced, points, blocks, work):
    """Newton's method with derivatives that are corrected by each step (Broyden 1965); gives whether it converges, and the force.

    Parameters
    ----------
    x, state : (N,) unknowns, and (STATE,) what is known beside them; both are advanced.
    """
    height, factor, fresh, known = reduced.tool[0], 1.0, False, state[AGE] >= 0.0
    sound, force, compression = residual_at(x, anchors, control, state[YIELDED], goal, reduced, points, blocks, work)
    for _turn in range(MOST_REDUCED_TURNS):
        if not known:
            if not sound or not derivatives_at(control, reduced, points, blocks, work):
                return False, force, compression
            state[AGE], fresh, known = 0.0, True, True
        step, size = step_at(reduced, work)
        least = max(abs(x[-1]), LEAST_WAY_SHARE * height)
        if size <= REDUCED_TOLERANCE_SHARE * least:
            far = abs(x[-1] - state[WEIGHED]) >= WEIGHED_SHARE * least or state[AGE] >= MOST_INSTANTS
            if far and force > LEAST_WEIGHED_SHARE * state[LARGEST] and compression > 0.0:
                state[LARGEST], state[WEIGHED] = max(state[LARGEST], force), x[-1]
                if not derivatives_at(control, reduced, points, blocks, work):
                    return False, force, compression
                state[AGE], fresh = 0.0, True
                state[GIVING] = giving_at(control, force, compression, reduced, work)
            change = state[GIVING] * compression - state[YIELDED]
            state[YIELDED] += change
            if control[0] == 0.0 or abs(change) <= GIVING_TOLERANCE * least:
                return True, force, compression
            work.rows[-1] -= control[0] * change
            step, size = step_at(reduced, work)
        factor = min(1.0, 4.0 * factor, LONGEST_REDUCED_STEP_SHARE * height / size)
        before, accepted, following, next_size = x.copy(), False, step, size
        for _cut in range(MOST_CUTS if fresh else 1):
            x[:] = before + factor * step
            sound, force, compression = residual_at(x, anchors, control, state[YIELDED], goal, reduced, points, blocks, work)
            if sound:
                following, next_size = step_at(reduced, work)
                accepted = next_size <= (1.0 - 0.25 * factor) * size
            if accepted:
                break
            factor *= 0.5
        if accepted and factor == 1.0 and next_size <= SLOW_RATIO * size:
            # Broyden's correction: what the step has left of the residual, along the step.
            changed = step - following  # the inverse times the change of the residual
            left = np.dot(step, work.inverse) / np.dot(step, changed)
            for i in range(len(x)):
                work.inverse[i] += following[i] * left
            fresh = False
            continue
        if not accepted:
            x[:] = before
            if fresh:
                break
            sound, force, compression = residual_at(x, anchors, control, state[YIELDED], goal, reduced, points, blocks, work)
            factor = 1.0
        known = False
    return False, force, compression


def follow(imposed, numbers, ahead, control, history, state, anchors, reduced, points, blocks, work, answers):
    """Find the equilibria at all instants; give the number of instants done.

    Parameters
    ----------
    imposed : (i,) goals, see :func:`residual`.
    numbers : of the effects for the increments that end at the instants.
    ahead : (i, 3) weights of the last three states, the latest first, in what each search begins with.
    history : (3, N) the last three states, the latest first.
    answers : (i, N + 2) unknowns, then force [N] and depth without what the springs give way by [m].
    """
    x, yielded, surface = history[0].copy(), np.full(3, state[YIELDED]), reduced.surface
    for k in range(len(numbers.steady)):
        blocks.effects[:, k] = numbers.steady[k]
    for instant in range(len(imposed)):
        for k in range(len(numbers.places)):
            blocks.effects[:, numbers.places[k]] = numbers.moving[instant, k]
        goal, old, leads = imposed[instant], state[COORDINATE], ahead[instant, 1] != 0.0
        x[:], state[YIELDED] = np.dot(ahead[instant], history), np.dot(ahead[instant], yielded)
        done, share, force, compression = 0.0, 1.0, 0.0, 0.0
        while done < 1.0:
            start = history[0] if done == 0.0 else x.copy()
            now = goal if done + share >= 1.0 else old + (done + share) * (goal - old)
            fine, force, compression = converge_at(x, state, anchors, control, now, reduced, points, blocks, work)
            if fine:
                done += share
                share = min(1.5 * share, 1.0 - done)
                continue
            x[:] = start
            state[AGE], state[YIELDED] = -1.0, yielded[0]
            if leads:
                leads = False  # begin at the last equilibrium instead
            elif share <= SMALLEST_LOAD_SHARE:
                return instant
            else:
                share *= 0.5
        history[2], history[1], history[0] = history[1], history[0], x
        yielded[2], yielded[1], yielded[0] = yielded[1], yielded[0], state[YIELDED]
        state[COORDINATE] = goal
        state[AGE] += 1.0
        answers[instant, :-2], answers[instant, -2] = x, force
        answers[instant, -1] = x[-1] - state[GIVING] * compression
        for p in range(len(anchors)):
            for i in range(2):
                anchors[p, i] = surface.places[p, i]
                for a in range(3):
                    anchors[p, i] += surface.shape[p, a] * work.moved[2 * surface.nodes[p, a] + i]
            anchors[p, 2], anchors[p, 3] = x[-1], work.tractions[p, 0]
        blocks.old[:] = blocks.new
    return len(imposed)


@cache
def follower(law: str, layout: response.Layout) -> Dispatcher:
    """:func:`follow` for a law with effects."""
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout)
    points = bind(answers_of, stored=False, respond=answer, LAW_CONSTANTS=leaves.count)
    tool = bind(touch.py_func, stored=False)
    rows = bind(residual, stored=False, allocates=True, answers_at=points, touch_at=tool)
    slopes = bind(derivatives, stored=False, allocates=True, answers_at=points)
    step, ratio = (bind(one, stored=False, allocates=True) for one in (newton_step, giving))
    parts = {"residual_at": rows, "derivatives_at": slopes, "step_at": step, "giving_at": ratio}
    newton = bind(converge, stored=False, allocates=True, **parts)
    return bind(follow, allocates=True, converge_at=newton)
