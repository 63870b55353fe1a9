"""A nine-node quadrilateral of a body of revolution: biquadratic displacements, linear pressure and volume ratio in each element.

The volume ratio J of each Gauss point is replaced by the L2 projection theta of J on linear functions of the element, so that the
deformation gradient of the material is F (theta / J)^(1/3) (Simo, Taylor & Pister 1985). The pressure is linear in each element
and discontinuous (Sussman & Bathe 1987), which does not lock, and an unknown of its own: the projection of the pressure that the
material answers. Any response of a material can be used, since derivatives are taken by differences.

Entries of a tensor in the order rr, rz, zr, zz, and around the axis.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from explicitfe.compiled.jit import Dispatcher, bind, leaf
from explicitfe.compiled.simd import WIDTH, load_many, splat, store
from explicitfe.forces import response
from explicitfe.materials import law_of
from explicitfe.materials.kinematics import cofactor, determinant

# Placeholders, bound below.
respond: Any = None
LAW_CONSTANTS = 1
NODES, POINTS, DOFS, LINEAR = 9, 9, 18, 3
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
    mass : (m, 3, 3) moments of linear functions [m^3].
    """

    nodes: np.ndarray
    slopes: np.ndarray
    weights: np.ndarray
    project: np.ndarray
    linear: np.ndarray
    mass: np.ndarray


class QuadWork(NamedTuple):
    """QuadWork arrays: ``gradients`` (p, 5), ``volumes`` (p, 2) of J and (theta / J)^(1/3), ``states`` (blocks, 9, W)."""

    gradients: np.ndarray
    volumes: np.ndarray
    states: np.ndarray


@leaf
def deform(u, column, step, quads, work):
    """Deformation gradients of all points, with one displacement of each element shifted; False where J is not positive."""
    for e in range(len(quads.nodes)):
        for q in range(POINTS):
            rr, rz, zr, zz, around = 1.0, 0.0, 0.0, 1.0, 1.0
            for a in range(NODES):
                node = quads.nodes[e, a]
                ur, uz = u[2 * node], u[2 * node + 1]
                if column == 2 * a:
                    ur += step
                elif column == 2 * a + 1:
                    uz += step
                dr, dz, over_r = quads.slopes[e, q, a, 0], quads.slopes[e, q, a, 1], quads.slopes[e, q, a, 2]
                rr += dr * ur
                rz += dz * ur
                zr += dr * uz
                zz += dz * uz
                around += over_r * ur
            p = POINTS * e + q
            J = around * (rr * zz - rz * zr)
            if not (J > 0.0 and around > 0.0):
                return False
            work.gradients[p, 0], work.gradients[p, 1], work.gradients[p, 2] = rr, rz, zr
            work.gradients[p, 3], work.gradients[p, 4] = zz, around
            work.volumes[p, 0] = J
        for q in range(POINTS):
            theta = 0.0
            for other in range(POINTS):
                theta += quads.project[e, q, other] * work.volumes[POINTS * e + other, 0]
            if not theta > 0.0:
                return False
            p = POINTS * e + q
            s = (theta / work.volumes[p, 0]) ** (1.0 / 3.0)
            work.volumes[p, 1] = s
            block, lane = p // WIDTH, p % WIDTH
            work.states[block, RR, lane] = s * work.gradients[p, 0]
            work.states[block, RZ, lane] = s * work.gradients[p, 1]
            work.states[block, ZR, lane] = s * work.gradients[p, 2]
            work.states[block, ZZ, lane] = s * work.gradients[p, 3]
            work.states[block, AROUND, lane] = s * work.gradients[p, 4]
    return True


def forces_of(u, pressures, column, step, bulk, quads, blocks, work, forces, growth):
    """Nodal forces (m, 18) of the elements [N], with one displacement of each element shifted; False where J is not positive.

    Parameters
    ----------
    u : (2 n,) displacements r, z of the nodes [m].
    pressures : (m, 3) coefficients of the pressure on linear functions [Pa].
    column, step : which of the 18 displacements of each element is shifted, and by what [m]; -1 is none.
    bulk : a modulus [Pa], by which pressures are counted in changes of volume.
    forces : receives the virtual work of stress and pressure by the displacements.
    growth : (m, 3) receives the moments of the pressure that the material answers, over ``bulk`` [m^3].
    """
    for block in range(len(work.states)):
        for k in range(9):
            for lane in range(WIDTH):
                work.states[block, k, lane] = 1.0 if k % 4 == 0 else 0.0
    if not deform(u, column, step, quads, work):
        return False
    for block in range(len(work.states)):
        F = load_many(work.states, block * 9 * WIDTH, 9)
        cof = cofactor(F)
        c = load_many(blocks.constants, block * (LAW_CONSTANTS * WIDTH), LAW_CONSTANTS)
        P, _ = respond(F, cof, determinant(F, cof), splat(0.0), c, blocks, block)
        for k in range(9):
            store(work.states, (block * 9 + k) * WIDTH, P[k])
    for e in range(len(quads.nodes)):
        for k in range(DOFS):
            forces[e, k] = 0.0
        for k in range(LINEAR):
            growth[e, k] = 0.0
        for q in range(POINTS):
            p = POINTS * e + q
            block, lane, F = p // WIDTH, p % WIDTH, work.gradients[p]
            w, J, s = quads.weights[e, q], work.volumes[p, 0], work.volumes[p, 1]
            Prr, Prz = work.states[block, RR, lane], work.states[block, RZ, lane]
            Pzr, Pzz = work.states[block, ZR, lane], work.states[block, ZZ, lane]
            Pt = work.states[block, AROUND, lane]
            # A third of the trace of the Kirchhoff stress is theta times the pressure, as the rest is isochoric.
            own = s * (Prr * F[0] + Prz * F[1] + Pzr * F[2] + Pzz * F[3] + Pt * F[4]) / (3.0 * J * s * s * s)
            pressure = -own * s * s * s
            for k in range(LINEAR):
                pressure += quads.linear[q, k] * pressures[e, k]
                growth[e, k] += w * quads.linear[q, k] * own / bulk
            plane = F[0] * F[3] - F[1] * F[2]
            Arr, Arz = w * (s * Prr + pressure * F[4] * F[3]), w * (s * Prz - pressure * F[4] * F[2])
            Azr, Azz = w * (s * Pzr - pressure * F[4] * F[1]), w * (s * Pzz + pressure * F[4] * F[0])
            At = w * (s * Pt + pressure * plane)
            for a in range(NODES):
                dr, dz, over_r = quads.slopes[e, q, a, 0], quads.slopes[e, q, a, 1], quads.slopes[e, q, a, 2]
                forces[e, 2 * a] += Arr * dr + Arz * dz + At * over_r
                forces[e, 2 * a + 1] += Azr * dr + Azz * dz
    return True


def stiffness_of(u, pressures, step, bulk, quads, blocks, work, forces, growth, shifted, grown, stiffness, coupling, spread):
    """As :func:`forces_of`, with derivatives by differences.

    Parameters
    ----------
    stiffness : (m, 18, 18) receives those of the forces by the displacements.
    coupling, spread : (m, 18, 3) receive those of the growth by the displacements, and of the forces by the pressures.

    The memory of the material ends at the state without a shift.
    """
    for column in range(DOFS):
        if not forces_at(u, pressures, column, step, bulk, quads, blocks, work, shifted, grown):
            return False
        for e in range(len(quads.nodes)):
            for k in range(DOFS):
                stiffness[e, k, column] = shifted[e, k]
            for k in range(LINEAR):
                coupling[e, column, k] = grown[e, k]
    if not forces_at(u, pressures, -1, 0.0, bulk, quads, blocks, work, forces, growth):
        return False
    for e in range(len(quads.nodes)):
        for column in range(DOFS):
            for k in range(DOFS):
                stiffness[e, k, column] = (stiffness[e, k, column] - forces[e, k]) / step
            for k in range(LINEAR):
                coupling[e, column, k] = (coupling[e, column, k] - growth[e, k]) / step
                spread[e, column, k] = 0.0
        for q in range(POINTS):
            F = work.gradients[POINTS * e + q]
            plane = F[0] * F[3] - F[1] * F[2]
            for a in range(NODES):
                dr, dz, over_r = quads.slopes[e, q, a, 0], quads.slopes[e, q, a, 1], quads.slopes[e, q, a, 2]
                r = F[4] * (F[3] * dr - F[2] * dz) + plane * over_r
                z = F[4] * (F[0] * dz - F[1] * dr)
                for k in range(LINEAR):
                    w = quads.weights[e, q] * quads.linear[q, k]
                    spread[e, 2 * a, k] += w * r
                    spread[e, 2 * a + 1, k] += w * z
    return True


forces_at: Any = None


@cache
def kernels(law: str, layout: response.Layout) -> tuple[Dispatcher, Dispatcher]:
    """``forces_of`` and ``stiffness_of`` for a law with effects."""
    leaves = law_of(law)
    answer, _ = response.bound(leaves, layout)
    inner = bind(forces_of, stored=False, respond=answer, LAW_CONSTANTS=leaves.count)
    return bind(forces_of, respond=answer, LAW_CONSTANTS=leaves.count), bind(stiffness_of, forces_at=inner)


def along_a_line(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes (points, 3) of the quadratic shape functions of a line from -1 to 1."""
    value = np.array([0.5 * x * (x - 1.0), 1.0 - x**2, 0.5 * x * (x + 1.0)]).T
    return value, np.array([x - 0.5, -2.0 * x, x + 0.5]).T


GAUSS, GAUSS_WEIGHT = np.polynomial.legendre.leggauss(3)
# Shape functions (point, node) at the Gauss points.
SHAPE = np.einsum("qi,sj->qsij", along_a_line(GAUSS)[0], along_a_line(GAUSS)[0]).reshape(POINTS, NODES)


def quads_of(nodes: np.ndarray, corners: np.ndarray) -> Quads:
    """Rectangles with nodes (m, 9), and corners (m, 2, 2): lowest r, z and largest r, z [m]."""
    value, slope = along_a_line(GAUSS)
    along_r = np.einsum("qi,sj->qsij", slope, value).reshape(POINTS, NODES)
    along_z = np.einsum("qi,sj->qsij", value, slope).reshape(POINTS, NODES)
    half = 0.5 * (corners[:, 1] - corners[:, 0])
    at_r, at_z = np.repeat(GAUSS, 3), np.tile(GAUSS, 3)
    r = corners[:, :, 0].mean(axis=1)[:, None] + half[:, :1] * at_r
    slopes = np.stack([along_r / half[:, 0, None, None], along_z / half[:, 1, None, None], SHAPE / r[:, :, None]], axis=3)
    weights = 2.0 * np.pi * r * np.outer(GAUSS_WEIGHT, GAUSS_WEIGHT).ravel() * np.prod(half, axis=1)[:, None]
    linear = np.stack([np.ones(POINTS), at_r, at_z], axis=1)
    mass = np.einsum("qk,mq,ql->mkl", linear, weights, linear)
    project = np.einsum("qk,mkl,ol,mo->mqo", linear, np.linalg.inv(mass), linear, weights)
    return Quads(np.ascontiguousarray(nodes), np.ascontiguousarray(slopes), weights, project, linear, mass)
