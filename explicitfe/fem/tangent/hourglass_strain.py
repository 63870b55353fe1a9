"""How the forces of elements/hourglass_strain.py change: second derivatives of delta by F and the modes, along a direction.

The energy is weight x delta, with the names of ``hourglass_strain.force``. ``o_i`` is the change of log(1 / |a_i|^2).
"""

from __future__ import annotations

from explicitfe.fem.elements.hourglass_strain import _strains
from explicitfe.fem.tangent.arrays import FRAME_AT, TREATMENT_AT, put
from explicitfe.platform.compiled.choose import load_lane
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH

# Places after ``TREATMENT_AT``, with the names of ``hourglass_strain.force``: frame a_i and 1 / |a_i|^2; strains; derivatives by
# the products q_k . a_i, by |a_i|^2 (twice), by bending and twist, and factors.
CARRIED, INVERSE_SQUARES, BENDING, TWIST, THIRD, BY_PRODUCTS, BY_LENGTHS, BY_BENDING, BY_TWIST, FACTORS = (
    0, 9, 12, 18, 21, 24, 36, 39, 45, 48,
)  # fmt: skip


@leaf
def prepare(F, qx, qy, qz, h, weight, work):
    """Put the frame, its strains and the derivatives of weight x delta by them into the work array of a block."""
    (a1, a2, a3), w, bending, twist, third = _strains(F, qx, qy, qz, h)
    A1, B1, A2, B2, A3, B3 = bending
    w1, w2, w3 = w
    f1, f2, f3 = third
    m = (1.0 / 96.0) * weight
    x3, y3 = m * (4.0 * A3 + 2.0 * B3), m * (4.0 * B3 + 2.0 * A3)
    x2, y2 = m * (4.0 * A2 + 2.0 * B2), m * (4.0 * B2 + 2.0 * A2)
    x1, y1 = m * (4.0 * A1 + 2.0 * B1), m * (4.0 * B1 + 2.0 * A1)
    w12, w13, w23 = m * w1 * w2, m * w1 * w3, m * w2 * w3
    u12, u13, u23 = w12 * twist[0], w13 * twist[1], w23 * twist[2]
    third_1, third_2, third_3 = m * w1 * f1, m * w2 * f2, m * w3 * f3
    l1 = -w1 * (2.0 * (x3 * A3 + x2 * A2 + m * f1 * f1) + u12 * twist[0] + u13 * twist[1])
    l2 = -w2 * (2.0 * (y3 * B3 + x1 * A1 + m * f2 * f2) + u12 * twist[0] + u23 * twist[2])
    l3 = -w3 * (2.0 * (y2 * B2 + y1 * B1 + m * f3 * f3) + u13 * twist[1] + u23 * twist[2])
    d = (
        u12 + u13, y3 * w2, y2 * w3, x3 * w1, u12 + u23, y1 * w3, x2 * w1, x1 * w2, u13 + u23,
        third_1, third_2, third_3,
    )  # fmt: skip
    at = TREATMENT_AT
    put(work, at + CARRIED, a1)
    put(work, at + CARRIED + 3, a2)
    put(work, at + CARRIED + 6, a3)
    put(work, at + INVERSE_SQUARES, w)
    put(work, at + BENDING, bending)
    put(work, at + TWIST, twist)
    put(work, at + THIRD, third)
    put(work, at + BY_PRODUCTS, d)
    put(work, at + BY_LENGTHS, (l1, l2, l3))
    put(work, at + BY_BENDING, (x1, y1, x2, y2, x3, y3))
    put(work, at + BY_TWIST, (u12, u13, u23))
    put(work, at + FACTORS, (w12, w13, w23, m * w1, m * w2, m * w3, m))


@leaf
def _product(dF, c):
    """dF c."""
    return (
        dF[0] * c[0] + dF[1] * c[1] + dF[2] * c[2],
        dF[3] * c[0] + dF[4] * c[1] + dF[5] * c[2],
        dF[6] * c[0] + dF[7] * c[1] + dF[8] * c[2],
    )


@leaf
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@leaf
def _along(q, dqx, dqy, dqz, k, a, da):
    """Change of q_k . a_i."""
    new = dqx[k] * a[0] + dqy[k] * a[1] + dqz[k] * a[2]
    return new + q[k] * da[0] + q[4 + k] * da[1] + q[8 + k] * da[2]


@leaf
def force_change(work, lane, q, dF, dqx, dqy, dqz):
    """Changes of the derivatives of weight x delta by the modes, 3 x 4, and by F, for changes dF and dq at a constant weight."""
    at = TREATMENT_AT * WIDTH + lane
    c = load_lane(work, FRAME_AT * WIDTH + lane, 9)
    a1, a2, a3 = load_lane(work, at, 3), load_lane(work, at + 3 * WIDTH, 3), load_lane(work, at + 6 * WIDTH, 3)
    w1, w2, w3 = load_lane(work, at + INVERSE_SQUARES * WIDTH, 3)
    A1, B1, A2, B2, A3, B3 = load_lane(work, at + BENDING * WIDTH, 6)
    s12, s13, s23 = load_lane(work, at + TWIST * WIDTH, 3)
    f1, f2, f3 = load_lane(work, at + THIRD * WIDTH, 3)
    da1, da2, da3 = _product(dF, (c[0], c[1], c[2])), _product(dF, (c[3], c[4], c[5])), _product(dF, (c[6], c[7], c[8]))
    o1, o2, o3 = (-2.0 * w1) * _dot(a1, da1), (-2.0 * w2) * _dot(a2, da2), (-2.0 * w3) * _dot(a3, da3)

    # strains
    dA1 = w2 * _along(q, dqx, dqy, dqz, 2, a2, da2) + A1 * o2
    dB1 = w3 * _along(q, dqx, dqy, dqz, 1, a3, da3) + B1 * o3
    dA2 = w1 * _along(q, dqx, dqy, dqz, 2, a1, da1) + A2 * o1
    dB2 = w3 * _along(q, dqx, dqy, dqz, 0, a3, da3) + B2 * o3
    dA3 = w1 * _along(q, dqx, dqy, dqz, 1, a1, da1) + A3 * o1
    dB3 = w2 * _along(q, dqx, dqy, dqz, 0, a2, da2) + B3 * o2
    t1 = _along(q, dqx, dqy, dqz, 0, a1, da1)
    t2 = _along(q, dqx, dqy, dqz, 1, a2, da2)
    t3 = _along(q, dqx, dqy, dqz, 2, a3, da3)
    ds12, ds13, ds23 = t1 + t2, t1 + t3, t2 + t3
    df1 = w1 * _along(q, dqx, dqy, dqz, 3, a1, da1) + f1 * o1
    df2 = w2 * _along(q, dqx, dqy, dqz, 3, a2, da2) + f2 * o2
    df3 = w3 * _along(q, dqx, dqy, dqz, 3, a3, da3) + f3 * o3

    # derivatives by the products q_k . a_i
    x1, y1, x2, y2, x3, y3 = load_lane(work, at + BY_BENDING * WIDTH, 6)
    u12, u13, u23 = load_lane(work, at + BY_TWIST * WIDTH, 3)
    w12, w13, w23, m1, m2, m3, m = load_lane(work, at + FACTORS * WIDTH, 7)
    d = load_lane(work, at + BY_PRODUCTS * WIDTH, 12)
    dx3, dy3 = (4.0 * m) * dA3 + (2.0 * m) * dB3, (4.0 * m) * dB3 + (2.0 * m) * dA3
    dx2, dy2 = (4.0 * m) * dA2 + (2.0 * m) * dB2, (4.0 * m) * dB2 + (2.0 * m) * dA2
    dx1, dy1 = (4.0 * m) * dA1 + (2.0 * m) * dB1, (4.0 * m) * dB1 + (2.0 * m) * dA1
    du12 = w12 * ds12 + u12 * (o1 + o2)
    du13 = w13 * ds13 + u13 * (o1 + o3)
    du23 = w23 * ds23 + u23 * (o2 + o3)
    dd = (
        du12 + du13, w2 * dy3 + d[1] * o2, w3 * dy2 + d[2] * o3,
        w1 * dx3 + d[3] * o1, du12 + du23, w3 * dy1 + d[5] * o3,
        w1 * dx2 + d[6] * o1, w2 * dx1 + d[7] * o2, du13 + du23,
        m1 * df1 + d[9] * o1, m2 * df2 + d[10] * o2, m3 * df3 + d[11] * o3,
    )  # fmt: skip

    # derivatives by |a_i|^2, twice
    l1, l2, l3 = load_lane(work, at + BY_LENGTHS * WIDTH, 3)
    v12, v13, v23 = u12 * ds12 + s12 * du12, u13 * ds13 + s13 * du13, u23 * ds23 + s23 * du23
    dl1 = l1 * o1 - w1 * (2.0 * (x3 * dA3 + A3 * dx3 + x2 * dA2 + A2 * dx2 + (2.0 * m * f1) * df1) + v12 + v13)
    dl2 = l2 * o2 - w2 * (2.0 * (y3 * dB3 + B3 * dy3 + x1 * dA1 + A1 * dx1 + (2.0 * m * f2) * df2) + v12 + v23)
    dl3 = l3 * o3 - w3 * (2.0 * (y2 * dB2 + B2 * dy2 + y1 * dB1 + B1 * dy1 + (2.0 * m * f3) * df3) + v13 + v23)

    along, change = (l1, l2, l3), (dl1, dl2, dl3)
    rx, b1x, b2x, b3x = _component(
        (q[0], q[1], q[2], q[3]), dqx, (a1[0], a2[0], a3[0]), (da1[0], da2[0], da3[0]), d, dd, along, change
    )
    ry, b1y, b2y, b3y = _component(
        (q[4], q[5], q[6], q[7]), dqy, (a1[1], a2[1], a3[1]), (da1[1], da2[1], da3[1]), d, dd, along, change
    )
    rz, b1z, b2z, b3z = _component(
        (q[8], q[9], q[10], q[11]), dqz, (a1[2], a2[2], a3[2]), (da1[2], da2[2], da3[2]), d, dd, along, change
    )
    by_F = (
        b1x * c[0] + b2x * c[3] + b3x * c[6], b1x * c[1] + b2x * c[4] + b3x * c[7], b1x * c[2] + b2x * c[5] + b3x * c[8],
        b1y * c[0] + b2y * c[3] + b3y * c[6], b1y * c[1] + b2y * c[4] + b3y * c[7], b1y * c[2] + b2y * c[5] + b3y * c[8],
        b1z * c[0] + b2z * c[3] + b3z * c[6], b1z * c[1] + b2z * c[4] + b3z * c[7], b1z * c[2] + b2z * c[5] + b3z * c[8],
    )  # fmt: skip
    return rx, ry, rz, by_F


@leaf
def _component(q, dq, a, da, d, dd, along, change):
    """Changes of one component of r_k = sum_i d_ki a_i and of b_i = sum_k d_ki q_k + l_i a_i."""
    r = (
        _three(d[0], d[1], d[2], dd[0], dd[1], dd[2], a, da),
        _three(d[3], d[4], d[5], dd[3], dd[4], dd[5], a, da),
        _three(d[6], d[7], d[8], dd[6], dd[7], dd[8], a, da),
        _three(d[9], d[10], d[11], dd[9], dd[10], dd[11], a, da),
    )
    return (
        r,
        _four(d[0], d[3], d[6], d[9], dd[0], dd[3], dd[6], dd[9], q, dq) + change[0] * a[0] + along[0] * da[0],
        _four(d[1], d[4], d[7], d[10], dd[1], dd[4], dd[7], dd[10], q, dq) + change[1] * a[1] + along[1] * da[1],
        _four(d[2], d[5], d[8], d[11], dd[2], dd[5], dd[8], dd[11], q, dq) + change[2] * a[2] + along[2] * da[2],
    )


@leaf
def _three(d1, d2, d3, e1, e2, e3, a, da):
    return e1 * a[0] + e2 * a[1] + e3 * a[2] + d1 * da[0] + d2 * da[1] + d3 * da[2]


@leaf
def _four(d1, d2, d3, d4, e1, e2, e3, e4, q, dq):
    return e1 * q[0] + e2 * q[1] + e3 * q[2] + e4 * q[3] + d1 * dq[0] + d2 * dq[1] + d3 * dq[2] + d4 * dq[3]
