"""A nine-node quadrilateral of a body of revolution: biquadratic displacements, linear pressure and volume ratio in each element.

The volume ratio J of each Gauss point is replaced by the L2 projection theta of J on linear functions of the element, so that the
deformation gradient of the material is F (theta / J)^(1/3) (Simo, Taylor & Pister 1985). The pressure is linear in each element
and discontinuous (Sussman & Bathe 1987), which does not lock, and an unknown of its own: the projection of the pressure that the
material answers. Any response of a material can be used, since derivatives at a Gauss point are taken by differences.

Entries of a tensor in the order rr, rz, zr, zz, and around the axis.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from explicitfe.fem.forces import response
from explicitfe.fem.materials import law_of
from explicitfe.fem.materials.kinematics import cofactor, determinant
from explicitfe.platform.compiled.jit import Dispatcher, bind, leaf
from explicitfe.platform.compiled.simd import WIDTH, load_many, splat, store

# Placeholders, bound below.
respond: Any = None
answers_at: Any = None
LAW_CONSTANTS = 1
NODES, QUAD_POINTS, DOFS, LINEAR = 9, 9, 18, 3
# What a Gauss point answers: five stresses and a pressure. It depends on the five entries of F, and on the factor of F.
OWN_PRESSURE, QUAD_ANSWERS = 5, 6
SCALE, UNSHIFTED = 5, 6
# Where the entries stand in a tensor of three dimensions, row by row: r, around the axis, z.
RR, RZ, ZR, ZZ, AROUND = 0, 2, 6, 8, 4


class Quads(NamedTuple):
    """Elements of a body of revolution; m elements, p = 9 m Gauss points, n nodes.

    Attributes
    ----------
    nodes : (m, 9) numbers of the nodes.
    slopes : (m, 9, 9, 3) at each Gauss point of each shape function N: dN/dr, dN/dz and N/r.
    weights : (m, 9) volume that a Gauss point stands for [m^3].
    project : (m, 9, 9) the projection on linear functions: theta = project @ J.
    linear : (9, 3) linear functions at the Gauss points.
    mass, inverse : (m, 3, 3) moments of linear functions [m^3], and their inverse.
    """

    nodes: np.ndarray
    slopes: np.ndarray
    weights: np.ndarray
    project: np.ndarray
    linear: np.ndarray
    mass: np.ndarray
    inverse: np.ndarray


class QuadWork(NamedTuple):
    """Work arrays.

    Attributes
    ----------
    gradients, volumes : (p, 5) of F, and (p, 2) of J and (theta / J)^(1/3).
    states : (blocks, 9, W) deformation gradients of the material, then its stresses.
    answers : (7, p, 6) what Gauss points answer with each of the six arguments shifted, and without a shift.
    rows : (6, 18) derivatives of the answers of a Gauss point by the displacements of its element.
    thetas : (3, 18) derivatives of the coefficients of theta by the displacements.
    """

    gradients: np.ndarray
    volumes: np.ndarray
    states: np.ndarray
    answers: np.ndarray
    rows: np.ndarray
    thetas: np.ndarray


def work_for(points: int, blocks: int) -> QuadWork:
    """Work arrays for so many Gauss points in so many blocks of lanes."""
    shapes = ((points, 5), (points, 2), (blocks, 9, WIDTH), (UNSHIFTED + 1, points, QUAD_ANSWERS))
    return QuadWork(*map(np.zeros, (*shapes, (QUAD_ANSWERS, DOFS), (LINEAR, DOFS))))


@leaf
def deform(u, quads, work):
    """Deformation gradients of all points, J and (theta / J)^(1/3); False where J is not positive."""
    for e in range(len(quads.nodes)):
        for q in range(QUAD_POINTS):
            rr, rz, zr, zz, around = 1.0, 0.0, 0.0, 1.0, 1.0
            for a in range(NODES):
                node = quads.nodes[e, a]
                ur, uz = u[2 * node], u[2 * node + 1]
                dr, dz, over_r = quads.slopes[e, q, a, 0], quads.slopes[e, q, a, 1], quads.slopes[e, q, a, 2]
                rr += dr * ur
                rz += dz * ur
                zr += dr * uz
                zz += dz * uz
                around += over_r * ur
            p = QUAD_POINTS * e + q
            J = around * (rr * zz - rz * zr)
            if not (J > 0.0 and around > 0.0):
                return False
            work.gradients[p, 0], work.gradients[p, 1], work.gradients[p, 2] = rr, rz, zr
            work.gradients[p, 3], work.gradients[p, 4] = zz, around
            work.volumes[p, 0] = J
        for q in range(QUAD_POINTS):
            theta = 0.0
            for other in range(QUAD_POINTS):
                theta += quads.project[e, q, other] * work.volumes[QUAD_POINTS * e + other, 0]
            if not theta > 0.0:
                return False
            p = QUAD_POINTS * e + q
            work.volumes[p, 1] = (theta / work.volumes[p, 0]) ** (1.0 / 3.0)
    return True


def answers_of(pressures, column, step, quads, blocks, work):
    """What the Gauss points answer into ``work.answers[column]``: five stresses that work on F [Pa], and the material's pressure.

    Parameters
    ----------
    pressures : (m, 3) coefficients of the pressure on linear functions [Pa].
    column, step : which argument is shifted, and by what: an entry of F, ``SCALE``, or none (``UNSHIFTED``).
    """
    points = len(work.gradients)
    for block in range(len(work.states)):
        for lane in range(WIDTH):
            p = min(block * WIDTH + lane, points - 1)
            s = work.volumes[p, 1] + (step if column == SCALE else 0.0)
            for k in range(9):
                work.states[block, k, lane] = 0.0
            work.states[block, RR, lane] = s * (work.gradients[p, 0] + (step if column == 0 else 0.0))
            work.states[block, RZ, lane] = s * (work.gradients[p, 1] + (step if column == 1 else 0.0))
            work.states[block, ZR, lane] = s * (work.gradients[p, 2] + (step if column == 2 else 0.0))
            work.states[block, ZZ, lane] = s * (work.gradients[p, 3] + (step if column == 3 else 0.0))
            work.states[block, AROUND, lane] = s * (work.gradients[p, 4] + (step if column == 4 else 0.0))
    for block in range(len(work.states)):
        F = load_many(work.states, block * 9 * WIDTH, 9)
        cof = cofactor(F)
        c = load_many(blocks.constants, block * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)
        P, _ = respond(F, cof, determinant(F, cof), splat(0.0), c, blocks, block)
        for k in range(9):
            store(work.states, (block * 9 + k) * WIDTH, P[k])
    for p in range(points):
        block, lane, q = p // WIDTH, p % WIDTH, p % QUAD_POINTS
        rr = work.gradients[p, 0] + (step if column == 0 else 0.0)
        rz = work.gradients[p, 1] + (step if column == 1 else 0.0)
        zr = work.gradients[p, 2] + (step if column == 2 else 0.0)
        zz = work.gradients[p, 3] + (step if column == 3 else 0.0)
        around = work.gradients[p, 4] + (step if column == 4 else 0.0)
        s = work.volumes[p, 1] + (step if column == SCALE else 0.0)
        Prr, Prz = s * work.states[block, RR, lane], s * work.states[block, RZ, lane]
        Pzr, Pzz = s * work.states[block, ZR, lane], s * work.states[block, ZZ, lane]
        Pt = s * work.states[block, AROUND, lane]
        plane, cube = rr * zz - rz * zr, s * s * s
        # A third of the trace of the Kirchhoff stress is theta times the pressure, as the rest is isochoric.
        own = (Prr * rr + Prz * rz + Pzr * zr + Pzz * zz + Pt * around) / (3.0 * around * plane * cube)
        pressure = -own * cube
        for k in range(LINEAR):
            pressure += quads.linear[q, k] * pressures[p // QUAD_POINTS, k]
        work.answers[column, p, 0] = Prr + pressure * around * zz
        work.answers[column, p, 1] = Prz - pressure * around * zr
        work.answers[column, p, 2] = Pzr - pressure * around * rz
        work.answers[column, p, 3] = Pzz + pressure * around * rr
        work.answers[column, p, 4] = Pt + pressure * plane
        work.answers[column, p, OWN_PRESSURE] = own


@leaf
def gather(bulk, quads, work, forces, growth):
    """Nodal forces and growth of the elements from the answers without a shift, see :func:`forces_of`."""
    for e in range(len(quads.nodes)):
        for k in range(DOFS):
            forces[e, k] = 0.0
        for k in range(LINEAR):
            growth[e, k] = 0.0
        for q in range(QUAD_POINTS):
            w, answer = quads.weights[e, q], work.answers[UNSHIFTED, QUAD_POINTS * e + q]
            for k in range(LINEAR):
                growth[e, k] += w * quads.linear[q, k] * answer[OWN_PRESSURE] / bulk
            for a in range(NODES):
                dr, dz, over_r = quads.slopes[e, q, a, 0], quads.slopes[e, q, a, 1], quads.slopes[e, q, a, 2]
                forces[e, 2 * a] += w * (answer[0] * dr + answer[1] * dz + answer[4] * over_r)
                forces[e, 2 * a + 1] += w * (answer[2] * dr + answer[3] * dz)


def forces_of(u, pressures, bulk, quads, blocks, work, forces, growth):
    """Nodal forces (m, 18) of the elements [N]; False where J is not positive.

    Parameters
    ----------
    u : (2 n,) displacements r, z of the nodes [m].
    pressures : (m, 3) coefficients of the pressure on linear functions [Pa].
    bulk : a modulus [Pa], by which pressures are counted in changes of volume.
    forces : receives the virtual work of stress and pressure by the displacements.
    growth : (m, 3) receives the moments of the pressure that the material answers, over ``bulk`` [m^3].
    """
    if not deform(u, quads, work):
        return False
    answers_at(pressures, UNSHIFTED, 0.0, quads, blocks, work)
    gather(bulk, quads, work, forces, growth)
    return True


def stiffness_of(u, pressures, step, bulk, quads, blocks, work, forces, growth, stiffness, coupling, spread):
    """As :func:`forces_of`, with derivatives: at Gauss points by differences, and by the chain rule from there.

    Parameters
    ----------
    step : by which the arguments of Gauss points are shifted.
    stiffness : (m, 18, 18) receives those of the forces by the displacements.
    coupling, spread : (m, 18, 3) receive those of the growth by the displacements, and of the forces by the pressures.

    The memory of the material ends at the state without a shift.
    """
    if not deform(u, quads, work):
        return False
    for column in range(UNSHIFTED + 1):
        answers_at(pressures, column, step, quads, blocks, work)
    gather(bulk, quads, work, forces, growth)
    rows, thetas = work.rows, work.thetas
    for e in range(len(quads.nodes)):
        for m in range(DOFS):
            for n in range(DOFS):
                stiffness[e, m, n] = 0.0
            for k in range(LINEAR):
                spread[e, m, k] = coupling[e, m, k] = 0.0
        # The coefficients of theta change by the pressures' work on the displacements.
        for q in range(QUAD_POINTS):
            F = work.gradients[QUAD_POINTS * e + q]
            plane = F[0] * F[3] - F[1] * F[2]
            for a in range(NODES):
                dr, dz, over_r = quads.slopes[e, q, a, 0], quads.slopes[e, q, a, 1], quads.slopes[e, q, a, 2]
                r = F[4] * (F[3] * dr - F[2] * dz) + plane * over_r
                z = F[4] * (F[0] * dz - F[1] * dr)
                for k in range(LINEAR):
                    w = quads.weights[e, q] * quads.linear[q, k]
                    spread[e, 2 * a, k] += w * r
                    spread[e, 2 * a + 1, k] += w * z
        for k in range(LINEAR):
            for m in range(DOFS):
                thetas[k, m] = 0.0
                for other in range(LINEAR):
                    thetas[k, m] += quads.inverse[e, k, other] * spread[e, m, other]
        for q in range(QUAD_POINTS):
            p = QUAD_POINTS * e + q
            F, w, J, s = work.gradients[p], quads.weights[e, q] / step, work.volumes[p, 0], work.volumes[p, 1]
            plane = F[0] * F[3] - F[1] * F[2]
            of_J, of_theta = -s / (3.0 * J), 1.0 / (3.0 * J * s * s)  # derivatives of the factor s
            slopes = quads.slopes[e, q]
            for i in range(QUAD_ANSWERS):
                now = work.answers[UNSHIFTED, p, i]
                of_s = w * (work.answers[SCALE, p, i] - now)
                rr = w * (work.answers[0, p, i] - now) + of_s * of_J * F[4] * F[3]
                rz = w * (work.answers[1, p, i] - now) - of_s * of_J * F[4] * F[2]
                zr = w * (work.answers[2, p, i] - now) - of_s * of_J * F[4] * F[1]
                zz = w * (work.answers[3, p, i] - now) + of_s * of_J * F[4] * F[0]
                around = w * (work.answers[4, p, i] - now) + of_s * of_J * plane
                for b in range(NODES):
                    rows[i, 2 * b] = rr * slopes[b, 0] + rz * slopes[b, 1] + around * slopes[b, 2]
                    rows[i, 2 * b + 1] = zr * slopes[b, 0] + zz * slopes[b, 1]
                for k in range(LINEAR):
                    along = of_s * of_theta * quads.linear[q, k]
                    for n in range(DOFS):
                        rows[i, n] += along * thetas[k, n]
            for k in range(LINEAR):
                factor = quads.linear[q, k] / bulk
                for n in range(DOFS):
                    coupling[e, n, k] += factor * rows[OWN_PRESSURE, n]
            for a in range(NODES):
                dr, dz, over_r = slopes[a, 0], slopes[a, 1], slopes[a, 2]
                for n in range(DOFS):
                    stiffness[e, 2 * a, n] += dr * rows[0, n] + dz * rows[1, n] + over_r * rows[4, n]
                    stiffness[e, 2 * a + 1, n] += dr * rows[2, n] + dz * rows[3, n]
    return True


@cache
def kernels(law: str, layout: response.Layout) -> tuple[Dispatcher, Dispatcher]:
    """``forces_of`` and ``stiffness_of`` for a law with effects."""
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout)
    inner = bind(answers_of, stored=False, respond=answer, LAW_CONSTANTS=leaves.count)
    return bind(forces_of, answers_at=inner), bind(stiffness_of, answers_at=inner)


def along_a_line(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes (points, 3) of the quadratic shape functions of a line from -1 to 1."""
    value = np.array([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)]).T
    return value, np.array([x - 0.5, -2.0 * x, x + 0.5]).T


GAUSS, GAUSS_WEIGHT = np.polynomial.legendre.leggauss(3)
# Shape functions (point, node) at the Gauss points.
SHAPE = np.einsum("qi,sj->qsij", along_a_line(GAUSS)[0], along_a_line(GAUSS)[0]).reshape(QUAD_POINTS, NODES)


def quads_of(nodes: np.ndarray, corners: np.ndarray) -> Quads:
    """Rectangles with nodes (m, 9), and corners (m, 2, 2): lowest r, z and largest r, z [m]."""
    value, slope = along_a_line(GAUSS)
    along_r = np.einsum("qi,sj->qsij", slope, value).reshape(QUAD_POINTS, NODES)
    along_z = np.einsum("qi,sj->qsij", value, slope).reshape(QUAD_POINTS, NODES)
    half = 0.5 * (corners[:, 1] - corners[:, 0])
    at_r, at_z = np.repeat(GAUSS, 3), np.tile(GAUSS, 3)
    r = corners[:, :, 0].mean(axis=1)[:, None] + half[:, :1] * at_r
    slopes = np.stack([along_r / half[:, 0, None, None], along_z / half[:, 1, None, None], SHAPE / r[:, :, None]], axis=3)
    weights = 2.0 * np.pi * r * np.outer(GAUSS_WEIGHT, GAUSS_WEIGHT).ravel() * np.prod(half, axis=1)[:, None]
    linear = np.stack([np.ones(QUAD_POINTS), at_r, at_z], axis=1)
    mass = np.einsum("qk,mq,ql->mkl", linear, weights, linear)
    inverse = np.linalg.inv(mass)
    project = np.einsum("qk,mkl,ol,mo->mqo", linear, inverse, linear, weights)
    return Quads(np.ascontiguousarray(nodes), np.ascontiguousarray(slopes), weights, project, linear, mass, inverse)
