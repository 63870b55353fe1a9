"""How the internal forces of one-point hexes change along directions: the derivative of forces/internal.py, element by element.

Values are computed once for W elements at a time, in lanes of elements, and kept in a work array. Then each element in turn takes
its numbers from there and multiplies them by changes in lanes of directions: corners are rows of vectors, so that nothing has to
be shuffled. With S the second Piola-Kirchhoff stress, P = F S, and C = F^T F,

    dP = dF S + F dS,   dC^-1 = -C^-1 dC C^-1,   d log J = C^-1 : dC / 2,

and S = a 1 + b C^-1 + p J C^-1 + what muscles pull, a = 2 W' J^(-2/3), b = -a tr C / 3 (Holzapfel 2000, sections 6.4 and 6.6).
The slope W' of the law is differenced with step 1e-3 to fourth order: of a polynomial of degree four that is exact.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

from explicitfe.fem.elements import barrier as shape_barrier
from explicitfe.fem.elements import hourglass_stiffness, hourglass_strain
from explicitfe.fem.elements.hex8 import GEOMETRY, gradient, minus_corner_forces, to_modes
from explicitfe.fem.elements.hex8 import VOLUME as VOLUME_OF_GEOMETRY
from explicitfe.fem.elements.hex8 import hourglass_modes as modes_of
from explicitfe.fem.forces import response
from explicitfe.fem.forces.corners import element_modes
from explicitfe.fem.forces.internal import bound_shape, kinematics
from explicitfe.fem.forces.response import Layout
from explicitfe.fem.materials import Leaves
from explicitfe.fem.materials.kinematics import cofactor, determinant, inverse_C, plus, right_cauchy_green, times
from explicitfe.fem.materials.volumetric import pressure, pressure_slope
from explicitfe.fem.tangent import barrier, relaxation
from explicitfe.fem.tangent import hourglass_stiffness as stiffness_change
from explicitfe.fem.tangent import hourglass_strain as strain_change
from explicitfe.fem.tangent.arrays import (
    BY_BULK,
    BY_CONSTANTS_AT,
    BY_DELTA,
    BY_F_AT,
    BY_MODES_AT,
    BY_TRACE,
    BY_VOLUME,
    COMPONENTS,
    CONSTANTS_AT,
    F_AT,
    FRAME_AT,
    GEOMETRY_AT,
    INVERSE_AT,
    MODES_AT,
    MUSCLES_AT,
    NUMBER_COUNT,
    NUMBERS_AT,
    OF_MUSCLE,
    PJ,
    PJ_SLOPE,
    SHARE,
    SLOPED,
    SQUARE,
    STRESS_AT,
    TRACE,
    A,
    B,
    put,
)  # fmt: skip
from explicitfe.platform.compiled.choose import any_below_zero, choose, load_lane
from explicitfe.platform.compiled.jit import PLACEHOLDER, Dispatcher, bind, leaf
from explicitfe.platform.compiled.simd import (
    WIDTH,
    inverse_cube_root,
    load,
    load_many,
    maximum,
    minimum,
    splat,
    square_root,
    store,
)

CHANGES: dict[ModuleType, ModuleType] = {hourglass_strain: strain_change, hourglass_stiffness: stiffness_change}
INVARIANT_STEP = 1e-3
CONSTANT_STEP_SHARE = 1e-3
SHORTEST_STRETCH_LESS_ONE = -0.5

# Placeholders, bound below.
law_constants = law_slopes = shape = hourglass_invariant = hourglass_force = prepare_hourglass = hourglass_change = PLACEHOLDER
stress_left = stress_change = add_barrier_change = is_suspect = prepare = add_element_change = PLACEHOLDER
LAW_CONSTANTS = 1


def kernel_of(law: Leaves, treatment: ModuleType, layout: Layout, derived: bool) -> Dispatcher:
    """The kernel of the changes of the internal forces, for a law of the first invariant, with one relaxation or without."""
    change = CHANGES[treatment]
    left, changed = relaxation.elastic_stress, relaxation.elastic_change
    for place in layout:
        here: dict[str, Any] = {"AT": place.at, "MEMORY": place.memory, "TERMS": dict(place.shape)["TERMS"]}
        left = bind(relaxation.stress_of_terms, inline=True, **here)
        changed = bind(relaxation.change_of_terms, inline=True, **{name: here[name] for name in ("AT", "TERMS")})
    guarded = treatment.HAS_BARRIER
    return bind(
        internal_change,
        stored=False,
        prepare=bind(
            prepare_block,
            inline=True,
            law_constants=response.bound_constants(law),
            law_slopes=law.slopes_at,
            LAW_CONSTANTS=law.count,
            shape=bound_shape(treatment, derived),
            hourglass_invariant=treatment.invariant,
            hourglass_force=treatment.force,
            prepare_hourglass=change.prepare,
            stress_left=left,
            is_suspect=is_near_barrier if guarded else is_never_near,
        ),
        add_element_change=bind(
            add_change_of_element,
            inline=True,
            LAW_CONSTANTS=law.count,
            hourglass_change=change.force_change,
            stress_change=changed,
        ),
        add_barrier_change=barrier.add_barrier_change if guarded else barrier.no_barrier_change,
    )


def internal_change(u, blocks, tangents):
    """Put the changes of minus the internal forces at the displacement u into ``tangents.force``.

    Of a material that remembers, the state is the accepted one, and its changes are remembered here: once an instant.
    """
    tangents.force[:] = 0.0
    for block in range(len(blocks.nodes)):
        suspect = prepare(u, blocks, block, tangents)
        for lane in range(min(WIDTH, tangents.elements - block * WIDTH)):
            for group in range(len(tangents.u)):
                add_element_change(blocks, block, lane, group, tangents)
            if suspect:
                add_barrier_change(u, blocks, block, lane, tangents)


@leaf
def is_near_barrier(cof, J, qx, qy, qz, blocks, block):
    """Whether a corner of one of the elements may be about to fold."""
    reach = load(blocks.barrier, (block * shape_barrier.NUMBERS + shape_barrier.REACH) * WIDTH)
    return any_below_zero(shape_barrier.slack(cof, J, qx, qy, qz, reach))


@leaf
def is_never_near(cof, J, qx, qy, qz, blocks, block):
    """The same of elements without a barrier."""
    return False


def prepare_block(u, blocks, block, tangents):
    """Put what the changes of W elements are made of into the work array; give whether a corner may be about to fold."""
    work = tangents.work
    g, h = shape(blocks, block)
    F, qx, qy, qz = kinematics(element_modes(u, blocks.nodes, block * (8 * WIDTH)), g)
    cof = cofactor(F)
    J = determinant(F, cof)
    c = law_constants(blocks, block)
    put(work, GEOMETRY_AT, g)
    put(work, FRAME_AT, h)
    put(work, F_AT, F)
    put(work, MODES_AT, qx)
    put(work, MODES_AT + 4, qy)
    put(work, MODES_AT + 8, qz)
    inverse = inverse_C(cof, J)
    put(work, INVERSE_AT, inverse)
    rx, ry, rz, by_F = hourglass_force(F, qx, qy, qz, h, splat(1.0))
    put(work, BY_MODES_AT, rx)
    put(work, BY_MODES_AT + 4, ry)
    put(work, BY_MODES_AT + 8, rz)
    put(work, BY_F_AT, by_F)

    root = inverse_cube_root(J)
    square = root * root
    C = right_cauchy_green(F)
    trace = C[0] + C[1] + C[2]
    x = square * trace + hourglass_invariant(F, qx, qy, qz, h)
    e = INVARIANT_STEP
    near = law_slopes((x + e,), c)[0] - law_slopes((x - e,), c)[0]
    far = law_slopes((x + 2.0 * e,), c)[0] - law_slopes((x - 2.0 * e,), c)[0]
    slope = law_slopes((x,), c)[0]
    a = 2.0 * slope * square
    b = (-1.0 / 3.0) * a * trace
    S = (a + b * inverse[0], a + b * inverse[1], a + b * inverse[2], b * inverse[3], b * inverse[4], b * inverse[5])
    T, share = stress_left(S, blocks, block)
    K = c[LAW_CONSTANTS - 1]
    p = pressure(J, K)
    pj = p * J
    S = plus(T, times(pj, inverse))
    v = g[VOLUME_OF_GEOMETRY]
    prepare_hourglass(F, qx, qy, qz, h, v * share * slope, work)
    bent = (8.0 * near - far) * (1.0 / (12.0 * e))
    put(work, NUMBERS_AT, (
        bent * square, (2.0 / 3.0) * bent * square * trace, bent,
        2.0 * v * square, (2.0 / 3.0) * v * a, v * a, v * b, trace,
        v * share, v * pj, v * (p + J * pressure_slope(J, K)) * J, v * pressure(J, splat(1.0)) * J,
    ))  # fmt: skip
    if len(tangents.constants) > 0:
        for k in range(LAW_CONSTANTS - 1):
            put(work, CONSTANTS_AT, c)
            here = load(work, (CONSTANTS_AT + k) * WIDTH)
            size = maximum(here, -here)
            step = choose(size, CONSTANT_STEP_SHARE * size, splat(1.0))
            total = splat(0.0)
            for share_of_step, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                store(work, (CONSTANTS_AT + k) * WIDTH, here + share_of_step * step)
                total = total + weight * law_slopes((x,), load_many(work, CONSTANTS_AT * WIDTH, LAW_CONSTANTS))[0]
            store(work, (BY_CONSTANTS_AT + k) * WIDTH, total / (12.0 * step))
    put(work, STRESS_AT, times(v, plus(S, muscle_stress(F, v, blocks, block, work))))
    return is_suspect(cof, J, qx, qy, qz, blocks, block)


@leaf
def muscle_stress(F, v, blocks, block, work):
    """Second Piola-Kirchhoff stress (6) [Pa] of the muscles in a block; what its changes are made of goes into the work array."""
    most = blocks.muscle.shape[1]
    zero = splat(0.0)
    S = (zero, zero, zero, zero, zero, zero)
    for k in range(most):
        muscle = blocks.muscle[block, k, 0]
        if muscle < 0:
            break
        activation, falls_off = blocks.activation[muscle, 0], blocks.activation[muscle, 1]
        sigma, x, y, z = load_many(blocks.contraction, (block * most + k) * (4 * WIDTH), 4)
        fx = F[0] * x + F[1] * y + F[2] * z
        fy = F[3] * x + F[4] * y + F[5] * z
        fz = F[6] * x + F[7] * y + F[8] * z
        stretch = square_root(fx * fx + fy * fy + fz * fz)
        short = minimum(stretch - 1.0, splat(0.0))
        within = maximum(short, splat(SHORTEST_STRETCH_LESS_ONE))
        phi = 1.0 - falls_off * (4.0 * within * within)
        fall = choose(short - SHORTEST_STRETCH_LESS_ONE, falls_off * (-8.0 * within), splat(0.0))
        one = activation * phi / stretch
        # d (phi / lambda) / d (lambda^2)
        stiffness = activation * sigma * (fall - phi / stretch) / (2.0 * stretch * stretch)
        dyad = (x * x, y * y, z * z, x * y, x * z, y * z)
        at = MUSCLES_AT + OF_MUSCLE * k
        put(work, at, dyad)
        store(work, (at + 6) * WIDTH, v * stiffness)
        store(work, (at + 7) * WIDTH, v * one)
        pull = one * sigma
        S = plus(S, times(pull, dyad))
    return S


@leaf
def rows_of(rows, block, lane):
    """Where the vectors of the eight corners of an element begin in a group of tangents."""
    return (
        rows[block, 0, lane],
        rows[block, 1, lane],
        rows[block, 2, lane],
        rows[block, 3, lane],
        rows[block, 4, lane],
        rows[block, 5, lane],
        rows[block, 6, lane],
        rows[block, 7, lane],
    )


@leaf
def corner_changes(u, rows, shift):
    """Changes of one component at the eight corners."""
    return (
        load(u, rows[0] + shift),
        load(u, rows[1] + shift),
        load(u, rows[2] + shift),
        load(u, rows[3] + shift),
        load(u, rows[4] + shift),
        load(u, rows[5] + shift),
        load(u, rows[6] + shift),
        load(u, rows[7] + shift),
    )


@leaf
def add_corner_changes(force, rows, shift, f):
    """Add one component of the changes of the corner forces."""
    for k in range(8):
        at = rows[k] + shift
        store(force, at, load(force, at) + f[k])


@leaf
def gradient_of(modes, g):
    """The three derivatives of one component, and its four hourglass modes."""
    x, y, z = gradient(modes, g, 0), gradient(modes, g, 1), gradient(modes, g, 2)
    return x, y, z, modes_of(modes, g, x, y, z)


@leaf
def change_of_C(F, dF):
    """dC = dF^T F + F^T dF: 11, 22, 33, 12, 13, 23."""
    return (
        2.0 * (F[0] * dF[0] + F[3] * dF[3] + F[6] * dF[6]),
        2.0 * (F[1] * dF[1] + F[4] * dF[4] + F[7] * dF[7]),
        2.0 * (F[2] * dF[2] + F[5] * dF[5] + F[8] * dF[8]),
        F[0] * dF[1] + F[1] * dF[0] + F[3] * dF[4] + F[4] * dF[3] + F[6] * dF[7] + F[7] * dF[6],
        F[0] * dF[2] + F[2] * dF[0] + F[3] * dF[5] + F[5] * dF[3] + F[6] * dF[8] + F[8] * dF[6],
        F[1] * dF[2] + F[2] * dF[1] + F[4] * dF[5] + F[5] * dF[4] + F[7] * dF[8] + F[8] * dF[7],
    )


@leaf
def _row(x, y, z, D):
    """A row of numbers times a symmetric tensor."""
    return x * D[0] + y * D[3] + z * D[4], x * D[3] + y * D[1] + z * D[5], x * D[4] + y * D[5] + z * D[2]


@leaf
def between(K, D):
    """K D K of symmetric tensors."""
    a0, a1, a2 = _row(K[0], K[3], K[4], D)
    b0, b1, b2 = _row(K[3], K[1], K[5], D)
    c0, c1, c2 = _row(K[4], K[5], K[2], D)
    return (
        a0 * K[0] + a1 * K[3] + a2 * K[4],
        b0 * K[3] + b1 * K[1] + b2 * K[5],
        c0 * K[4] + c1 * K[5] + c2 * K[2],
        a0 * K[3] + a1 * K[1] + a2 * K[5],
        a0 * K[4] + a1 * K[5] + a2 * K[2],
        b0 * K[4] + b1 * K[5] + b2 * K[2],
    )


def add_change_of_element(blocks, block, lane, group, tangents):
    """Add the changes of minus the internal forces of one element along a group of directions."""
    work = tangents.work
    element = block * WIDTH + lane
    rows = rows_of(tangents.rows, block, lane)
    shift = group * (tangents.u.shape[1] * COMPONENTS * WIDTH)
    g = load_lane(work, GEOMETRY_AT * WIDTH + lane, GEOMETRY)
    F = load_lane(work, F_AT * WIDTH + lane, 9)
    q = load_lane(work, MODES_AT * WIDTH + lane, 12)
    K = load_lane(work, INVERSE_AT * WIDTH + lane, 6)
    S = load_lane(work, STRESS_AT * WIDTH + lane, 6)
    r = load_lane(work, BY_MODES_AT * WIDTH + lane, 12)
    R = load_lane(work, BY_F_AT * WIDTH + lane, 9)
    numbers = load_lane(work, NUMBERS_AT * WIDTH + lane, NUMBER_COUNT)
    a, b = numbers[A], numbers[B]

    xx, xy, xz, dqx = gradient_of(to_modes(corner_changes(tangents.u, rows, shift)), g)
    yx, yy, yz, dqy = gradient_of(to_modes(corner_changes(tangents.u, rows, shift + WIDTH)), g)
    zx, zy, zz, dqz = gradient_of(to_modes(corner_changes(tangents.u, rows, shift + 2 * WIDTH)), g)
    dF = (xx, xy, xz, yx, yy, yz, zx, zy, zz)
    dC = change_of_C(F, dF)
    trace = dC[0] + dC[1] + dC[2]
    e = 0.5 * (K[0] * dC[0] + K[1] * dC[1] + K[2] * dC[2]) + K[3] * dC[3] + K[4] * dC[4] + K[5] * dC[5]
    delta = r[0] * dqx[0] + r[1] * dqx[1] + r[2] * dqx[2] + r[3] * dqx[3]
    delta = delta + r[4] * dqy[0] + r[5] * dqy[1] + r[6] * dqy[2] + r[7] * dqy[3]
    delta = delta + r[8] * dqz[0] + r[9] * dqz[1] + r[10] * dqz[2] + r[11] * dqz[3]
    delta = delta + R[0] * xx + R[1] * xy + R[2] * xz + R[3] * yx + R[4] * yy + R[5] * yz + R[6] * zx + R[7] * zy + R[8] * zz
    slope = numbers[BY_TRACE] * trace - numbers[BY_VOLUME] * e + numbers[BY_DELTA] * delta
    dpj = numbers[PJ_SLOPE] * e
    if len(tangents.constants) > 0:
        one = min(element, len(tangents.constants) - 1)
        groups = len(tangents.u)
        for k in range(LAW_CONSTANTS - 1):
            at = ((one * LAW_CONSTANTS + k) * groups + group) * WIDTH
            slope = slope + work[BY_CONSTANTS_AT + k, lane] * load(tangents.constants, at)
        at = ((one * LAW_CONSTANTS + LAW_CONSTANTS - 1) * groups + group) * WIDTH
        dpj = dpj + numbers[BY_BULK] * load(tangents.constants, at)
    da = numbers[SQUARE] * slope - numbers[SLOPED] * e
    db = (-1.0 / 3.0) * (numbers[TRACE] * da + a * trace)
    Y = between(K, dC)
    dS = (
        da + K[0] * db - b * Y[0],
        da + K[1] * db - b * Y[1],
        da + K[2] * db - b * Y[2],
        K[3] * db - b * Y[3],
        K[4] * db - b * Y[4],
        K[5] * db - b * Y[5],
    )
    memory = tangents.memory
    dT = stress_change(dS, blocks, block, lane, memory, (element * len(tangents.u) + group) * (memory.shape[2] * WIDTH))
    pj = numbers[PJ]
    dS = (
        dT[0] + K[0] * dpj - pj * Y[0],
        dT[1] + K[1] * dpj - pj * Y[1],
        dT[2] + K[2] * dpj - pj * Y[2],
        dT[3] + K[3] * dpj - pj * Y[3],
        dT[4] + K[4] * dpj - pj * Y[4],
        dT[5] + K[5] * dpj - pj * Y[5],
    )
    most = blocks.muscle.shape[1]
    for k in range(most):
        if blocks.muscle[block, k, 0] < 0:
            break
        m = load_lane(work, (MUSCLES_AT + OF_MUSCLE * k) * WIDTH + lane, OF_MUSCLE)
        pull = m[6] * (m[0] * dC[0] + m[1] * dC[1] + m[2] * dC[2] + 2.0 * (m[3] * dC[3] + m[4] * dC[4] + m[5] * dC[5]))
        if len(tangents.sigma) > 0:
            pull = pull + m[7] * load(tangents.sigma, ((element * most + k) * len(tangents.u) + group) * WIDTH)
        dS = plus(dS, (m[0] * pull, m[1] * pull, m[2] * pull, m[3] * pull, m[4] * pull, m[5] * pull))

    gain = numbers[SHARE] * slope
    sx, sy, sz, dR = hourglass_change(work, lane, q, dF, dqx, dqy, dqz)
    rx = (sx[0] + r[0] * gain, sx[1] + r[1] * gain, sx[2] + r[2] * gain, sx[3] + r[3] * gain)
    ry = (sy[0] + r[4] * gain, sy[1] + r[5] * gain, sy[2] + r[6] * gain, sy[3] + r[7] * gain)
    rz = (sz[0] + r[8] * gain, sz[1] + r[9] * gain, sz[2] + r[10] * gain, sz[3] + r[11] * gain)
    px = stress_row(S, dS, (F[0], F[1], F[2]), (xx, xy, xz), gain, (dR[0], dR[1], dR[2]), (R[0], R[1], R[2]))
    py = stress_row(S, dS, (F[3], F[4], F[5]), (yx, yy, yz), gain, (dR[3], dR[4], dR[5]), (R[3], R[4], R[5]))
    pz = stress_row(S, dS, (F[6], F[7], F[8]), (zx, zy, zz), gain, (dR[6], dR[7], dR[8]), (R[6], R[7], R[8]))
    add_corner_changes(tangents.force, rows, shift, minus_corner_forces(px[0], px[1], px[2], rx, g))
    add_corner_changes(tangents.force, rows, shift + WIDTH, minus_corner_forces(py[0], py[1], py[2], ry, g))
    add_corner_changes(tangents.force, rows, shift + 2 * WIDTH, minus_corner_forces(pz[0], pz[1], pz[2], rz, g))


@leaf
def stress_row(S, dS, f, df, gain, dR, R):
    """A row of V dP + dQ: P = F S, S with V in it, and Q, the derivative of the hourglass energy by F."""
    return (
        df[0] * S[0] + df[1] * S[3] + df[2] * S[4] + f[0] * dS[0] + f[1] * dS[3] + f[2] * dS[4] + dR[0] + R[0] * gain,
        df[0] * S[3] + df[1] * S[1] + df[2] * S[5] + f[0] * dS[3] + f[1] * dS[1] + f[2] * dS[5] + dR[1] + R[1] * gain,
        df[0] * S[4] + df[1] * S[5] + df[2] * S[2] + f[0] * dS[4] + f[1] * dS[5] + f[2] * dS[2] + dR[2] + R[2] * gain,
    )
