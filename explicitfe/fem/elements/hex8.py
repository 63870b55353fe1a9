"""The 8-node hex with one integration point, mean gradient and modal (Walsh-Hadamard) form.

The mean gradient B_aj = (1/V) integral of dN_a/dX_j over the element (Flanagan & Belytschko 1981, eq. 16) passes the
patch test on distorted hexes; the gradient at the centroid does not. The nodal values of each displacement component are
first turned into seven modes, U_m = sum_a W_ma u_a, three linear (xi, eta, zeta) and four hourglass (eta zeta, zeta xi,
xi eta, xi eta zeta): then grad u = sum_m U_m b_m with b_m = (1/8) sum_a W_ma B_a.

With the modes of the shape, c_m = (1/8) sum_a W_ma X_a, the integrals are products of two of them (and so on around):

    V b_xi = c_eta x c_zeta + (1/3) c_xieta x c_zetaxi,   V b_etazeta = (1/3) (c_zeta x c_zetaxi + c_xieta x c_eta),

and b_xietazeta is zero on every hex: the mode xi eta zeta has no mean gradient. So 31 numbers describe an element.
"""

from __future__ import annotations

import numpy as np

from explicitfe.fem.mesh.hexmesh import CORNERS
from explicitfe.platform.compiled.jit import leaf

# Mode values at the corners, (7, 8): xi, eta, zeta, then eta zeta, zeta xi, xi eta, xi eta zeta.
_XI, _ETA, _ZETA = CORNERS.T
MODES = np.stack([_XI, _ETA, _ZETA, _ETA * _ZETA, _ZETA * _XI, _XI * _ETA, _XI * _ETA * _ZETA])

# Numbers of an element: b (6 x 3), hX (4 x 3), volume.
VOLUME = 30
GEOMETRY = 31
_BATCH = 2048  # elements that are worked on at once, in the cache


def geometry(corners: np.ndarray) -> np.ndarray:
    """What the kernels read of each element, (m, GEOMETRY): b [1/m], hX [m], volume [m^3].

    Parameters
    ----------
    corners : (m, 8, 3), m. Reference positions of the corners in VTK order.
    """
    numbers = np.empty((GEOMETRY, len(corners)))
    for first in range(0, len(corners), _BATCH):
        part = slice(first, first + _BATCH)
        modes = to_modes.py_func(np.ascontiguousarray(corners[part].transpose(1, 2, 0)))
        xi, eta, zeta, ez, zx, xe, _ = c = [mode / 8.0 for mode in modes]
        b = np.stack([
            _cross(eta, zeta) + _cross(xe, zx) / 3.0,
            _cross(zeta, xi) + _cross(ez, xe) / 3.0,
            _cross(xi, eta) + _cross(zx, ez) / 3.0,
            (_cross(zeta, zx) + _cross(xe, eta)) / 3.0,
            (_cross(xi, xe) + _cross(ez, zeta)) / 3.0,
            (_cross(eta, ez) + _cross(zx, xi)) / 3.0,
        ])  # fmt: skip
        volume = (8.0 / 3.0) * sum(c[m][j] * b[m, j] for m in range(6) for j in range(3))
        numbers[:18, part] = (b / volume).reshape(18, -1)
        numbers[18:VOLUME, part] = np.stack(modes[3:]).reshape(12, -1)
        numbers[VOLUME, part] = volume
    return numbers.T


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b of (3, k) vectors."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def mean_gradients(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean gradients and volumes of hexes in their reference shape.

    Parameters
    ----------
    corners : (m, 8, 3), m. Reference positions of the corners in VTK order.

    Returns
    -------
    gradients : (m, 8, 3), 1/m. B_aj; sum_a B_aj = 0 and sum_a X_ai B_aj = 1 for i = j, else 0, on any hex.
    volumes : (m,), m^3.
    """
    numbers = geometry(corners)
    return MODES[:6].T @ numbers[:, :18].reshape(-1, 6, 3), numbers[:, VOLUME]


def lumped_mass(hexes: np.ndarray, element_mass: np.ndarray, node_count: int) -> np.ndarray:
    """Nodal masses, (n,) kg: an eighth of each element's mass at each of its nodes."""
    return np.bincount(hexes.ravel(), weights=np.repeat(element_mass / 8.0, 8), minlength=node_count)


@leaf
def to_modes(a):
    """The seven modes of one component's 8 corner values (without the mean)."""
    s01, d01 = a[1] + a[0], a[1] - a[0]
    s32, d32 = a[2] + a[3], a[2] - a[3]
    s45, d45 = a[5] + a[4], a[5] - a[4]
    s76, d76 = a[6] + a[7], a[6] - a[7]
    s_low, e_low, d_low, de_low = s32 + s01, s32 - s01, d32 + d01, d32 - d01
    s_top, e_top, d_top, de_top = s76 + s45, s76 - s45, d76 + d45, d76 - d45
    return (
        d_top + d_low,
        e_top + e_low,
        s_top - s_low,
        e_top - e_low,
        d_top - d_low,
        de_top + de_low,
        de_top - de_low,
    )


@leaf
def derived_geometry(modes):
    """What ``geometry`` gives, (GEOMETRY,), from the modes of the three components of the reference shape.

    Modes are eight times c_m, so what they give is 64 V b_m. The sum over m of the modes of x times the x of it is 64 V: the
    gradient of x along x is 1.
    """
    x, y, z = modes
    x3, x4, x5 = (1.0 / 3.0) * x[3], (1.0 / 3.0) * x[4], (1.0 / 3.0) * x[5]
    y3, y4, y5 = (1.0 / 3.0) * y[3], (1.0 / 3.0) * y[4], (1.0 / 3.0) * y[5]
    z3, z4, z5 = (1.0 / 3.0) * z[3], (1.0 / 3.0) * z[4], (1.0 / 3.0) * z[5]
    bx0, bx1, bx2, bx3, bx4, bx5 = _areas(y, z, y3, y4, y5, z3, z4, z5)
    by0, by1, by2, by3, by4, by5 = _areas(z, x, z3, z4, z5, x3, x4, x5)
    bz0, bz1, bz2, bz3, bz4, bz5 = _areas(x, y, x3, x4, x5, y3, y4, y5)
    volume = x[0] * bx0 + x[1] * bx1 + x[2] * bx2 + x[3] * bx3 + x[4] * bx4 + x[5] * bx5
    w = 1.0 / volume
    return (
        w * bx0, w * by0, w * bz0, w * bx1, w * by1, w * bz1, w * bx2, w * by2, w * bz2,
        w * bx3, w * by3, w * bz3, w * bx4, w * by4, w * bz4, w * bx5, w * by5, w * bz5,
        x[3], y[3], z[3], x[4], y[4], z[4], x[5], y[5], z[5], x[6], y[6], z[6],
        (1.0 / 64.0) * volume,
    )  # fmt: skip


@leaf
def _areas(p, q, p3, p4, p5, q3, q4, q5):
    """64 V b_mj of the six modes, from the modes p and q of the next two components, and a third of their hourglass modes."""
    return (
        p[1] * q[2] - q[1] * p[2] + p5 * q[4] - q5 * p[4],
        p[2] * q[0] - q[2] * p[0] + p3 * q[5] - q3 * p[5],
        p[0] * q[1] - q[0] * p[1] + p4 * q[3] - q4 * p[3],
        p[2] * q4 - q[2] * p4 + p5 * q[1] - q5 * p[1],
        p[0] * q5 - q[0] * p5 + p3 * q[2] - q3 * p[2],
        p[1] * q3 - q[1] * p3 + p4 * q[0] - q4 * p[0],
    )


@leaf
def minus_from_modes(m):
    """Minus the corner values sum_m W_ma m_m of seven modes: minus the transpose of ``to_modes``."""
    xi, eta, zeta, ez, zx, xe, xez = m
    xi_low, xi_top = xi - zx, xi + zx
    eta_low, eta_top = eta - ez, eta + ez
    xe_low, xe_top = xe - xez, xe + xez
    p_low, m_low = xi_low + eta_low, xi_low - eta_low
    p_top, m_top = xi_top + eta_top, xi_top - eta_top
    a_low, b_low = xe_low - zeta, xe_low + zeta
    a_top, b_top = xe_top + zeta, xe_top - zeta
    return (
        p_low - a_low,
        b_low - m_low,
        -(a_low + p_low),
        m_low + b_low,
        p_top - a_top,
        b_top - m_top,
        -(a_top + p_top),
        m_top + b_top,
    )


@leaf
def gradient(modes, g, j):
    """d u / d X_j of one component: sum_m U_m b_mj, g the element's geometry."""
    return (
        modes[0] * g[j]
        + modes[1] * g[3 + j]
        + modes[2] * g[6 + j]
        + modes[3] * g[9 + j]
        + modes[4] * g[12 + j]
        + modes[5] * g[15 + j]
    )


@leaf
def hourglass_modes(modes, g, hx, hy, hz):
    """q_k of one component, k = 0..3: what is left of the hourglass modes without the affine field; zero on any affine field."""
    return (
        modes[3] - hx * g[18] - hy * g[19] - hz * g[20],
        modes[4] - hx * g[21] - hy * g[22] - hz * g[23],
        modes[5] - hx * g[24] - hy * g[25] - hz * g[26],
        modes[6] - hx * g[27] - hy * g[28] - hz * g[29],
    )


@leaf
def minus_corner_forces(px, py, pz, r, g):
    """Minus the corner values of one component of B S + sum_k r_k g_k, S = (px, py, pz) [N m] and r_k its hourglass forces."""
    sx = px - r[0] * g[18] - r[1] * g[21] - r[2] * g[24] - r[3] * g[27]
    sy = py - r[0] * g[19] - r[1] * g[22] - r[2] * g[25] - r[3] * g[28]
    sz = pz - r[0] * g[20] - r[1] * g[23] - r[2] * g[26] - r[3] * g[29]
    return minus_from_modes(
        (
            sx * g[0] + sy * g[1] + sz * g[2],
            sx * g[3] + sy * g[4] + sz * g[5],
            sx * g[6] + sy * g[7] + sz * g[8],
            r[0] + sx * g[9] + sy * g[10] + sz * g[11],
            r[1] + sx * g[12] + sy * g[13] + sz * g[14],
            r[2] + sx * g[15] + sy * g[16] + sz * g[17],
            r[3],
        )
    )
