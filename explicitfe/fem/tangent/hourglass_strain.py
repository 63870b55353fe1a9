"""How the forces of elements/hourglass_strain.py change: second derivatives of delta by F and the modes, along a direction.

Written for delta itself, with the names of ``hourglass_strain.force`` at the weight 1. ``o_i`` is the change of log(1 / |a_i|^2).
"""

from __future__ import annotations

from explicitfe.fem.elements.hourglass_strain import _strains
from explicitfe.fem.tangent.arrays import FRAME_AT, TREATMENT_AT
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, load_lane, store

M = 1.0 / 96.0


@leaf
def prepare(F, qx, qy, qz, h, work):
    """Put the frame and its strains into the work array of a block."""
    (a1, a2, a3), w, bending, twist, third = _strains(F, qx, qy, qz, h)
    at = TREATMENT_AT
    for k in range(3):
        store(work, (at + k) * WIDTH, a1[k])
        store(work, (at + 3 + k) * WIDTH, a2[k])
        store(work, (at + 6 + k) * WIDTH, a3[k])
        store(work, (at + 9 + k) * WIDTH, w[k])
        store(work, (at + 18 + k) * WIDTH, twist[k])
        store(work, (at + 21 + k) * WIDTH, third[k])
    for k in range(6):
        store(work, (at + 12 + k) * WIDTH, bending[k])


@leaf
def _turned(dF, c):
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
    """Changes of the derivatives of delta by the modes, 3 x 4, and by F, for changes dF and dq."""
    at = TREATMENT_AT * WIDTH + lane
    c = load_lane(work, FRAME_AT * WIDTH + lane, 9)
    a1, a2, a3 = load_lane(work, at, 3), load_lane(work, at + 3 * WIDTH, 3), load_lane(work, at + 6 * WIDTH, 3)
    w1, w2, w3 = load_lane(work, at + 9 * WIDTH, 3)
    A1, B1, A2, B2, A3, B3 = load_lane(work, at + 12 * WIDTH, 6)
    s12, s13, s23 = load_lane(work, at + 18 * WIDTH, 3)
    f1, f2, f3 = load_lane(work, at + 21 * WIDTH, 3)
    da1, da2, da3 = _turned(dF, (c[0], c[1], c[2])), _turned(dF, (c[3], c[4], c[5])), _turned(dF, (c[6], c[7], c[8]))
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
    x3, y3 = M * (4.0 * A3 + 2.0 * B3), M * (4.0 * B3 + 2.0 * A3)
    x2, y2 = M * (4.0 * A2 + 2.0 * B2), M * (4.0 * B2 + 2.0 * A2)
    x1, y1 = M * (4.0 * A1 + 2.0 * B1), M * (4.0 * B1 + 2.0 * A1)
    dx3, dy3 = (4.0 * M) * dA3 + (2.0 * M) * dB3, (4.0 * M) * dB3 + (2.0 * M) * dA3
    dx2, dy2 = (4.0 * M) * dA2 + (2.0 * M) * dB2, (4.0 * M) * dB2 + (2.0 * M) * dA2
    dx1, dy1 = (4.0 * M) * dA1 + (2.0 * M) * dB1, (4.0 * M) * dB1 + (2.0 * M) * dA1
    w12, w13, w23 = M * w1 * w2, M * w1 * w3, M * w2 * w3
    u12, u13, u23 = w12 * s12, w13 * s13, w23 * s23
    du12 = w12 * ds12 + u12 * (o1 + o2)
    du13 = w13 * ds13 + u13 * (o1 + o3)
    du23 = w23 * ds23 + u23 * (o2 + o3)
    d = (
        u12 + u13, y3 * w2, y2 * w3, x3 * w1, u12 + u23, y1 * w3, x2 * w1, x1 * w2, u13 + u23,
        M * w1 * f1, M * w2 * f2, M * w3 * f3,
    )  # fmt: skip
    dd = (
        du12 + du13, w2 * dy3 + d[1] * o2, w3 * dy2 + d[2] * o3,
        w1 * dx3 + d[3] * o1, du12 + du23, w3 * dy1 + d[5] * o3,
        w1 * dx2 + d[6] * o1, w2 * dx1 + d[7] * o2, du13 + du23,
        (M * w1) * df1 + d[9] * o1, (M * w2) * df2 + d[10] * o2, (M * w3) * df3 + d[11] * o3,
    )  # fmt: skip

    # derivatives by |a_i|^2, twice
    l1 = -w1 * (2.0 * (x3 * A3 + x2 * A2 + M * f1 * f1) + u12 * s12 + u13 * s13)
    l2 = -w2 * (2.0 * (y3 * B3 + x1 * A1 + M * f2 * f2) + u12 * s12 + u23 * s23)
    l3 = -w3 * (2.0 * (y2 * B2 + y1 * B1 + M * f3 * f3) + u13 * s13 + u23 * s23)
    v12, v13, v23 = u12 * ds12 + s12 * du12, u13 * ds13 + s13 * du13, u23 * ds23 + s23 * du23
    dl1 = l1 * o1 - w1 * (2.0 * (x3 * dA3 + A3 * dx3 + x2 * dA2 + A2 * dx2 + (2.0 * M * f1) * df1) + v12 + v13)
    dl2 = l2 * o2 - w2 * (2.0 * (y3 * dB3 + B3 * dy3 + x1 * dA1 + A1 * dx1 + (2.0 * M * f2) * df2) + v12 + v23)
    dl3 = l3 * o3 - w3 * (2.0 * (y2 * dB2 + B2 * dy2 + y1 * dB1 + B1 * dy1 + (2.0 * M * f3) * df3) + v13 + v23)

    along, change = (l1, l2, l3), (dl1, dl2, dl3)
    rx, b1x, b2x, b3x = _component((q[0], q[1], q[2], q[3]), dqx, (a1[0], a2[0], a3[0]), (da1[0], da2[0], da3[0]), d, dd, along, change)
    ry, b1y, b2y, b3y = _component((q[4], q[5], q[6], q[7]), dqy, (a1[1], a2[1], a3[1]), (da1[1], da2[1], da3[1]), d, dd, along, change)
    rz, b1z, b2z, b3z = _component((q[8], q[9], q[10], q[11]), dqz, (a1[2], a2[2], a3[2]), (da1[2], da2[2], da3[2]), d, dd, along, change)
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
