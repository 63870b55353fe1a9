"""What keeps a hex from folding at a corner: an energy that grows without bound as a corner becomes flat.

The one point of an element sees its mean deformation, which can be sound while a corner folds. At corner a the edges along
xi, eta, zeta span the volume D_a, and D_a / D_a(rest) = det F_a is the volume ratio there. Relative to that of all corners,

    r_a = (D_a / D_a(rest)) / j,  j = sum_a D_a / sum_a D_a(rest),
    energy = sum_a v_a B G phi(r_a / t),  phi(s) = (1 - s)^3 / s below s = 1, else 0,

where v_a = D_a(rest) / 8 is the corner's share of the element's volume, and G the long-term shear modulus of its law. In any
homogeneous deformation r_a = 1, however large that is. The energy begins with zero force and stiffness at r_a = t and is infinite
at 0. So it takes no part in an element that is not about to fold, and vanishes as a mesh is refined: r_a then goes to 1.
Barriers of this kind are known from mesh untangling and from contact (Li et al. 2020, ACM Trans. Graph. 39:49).

Few elements need it. With E_a = F_a - F = sum_k q_k x m_ka, linear in the hourglass modes, and M_a = F^-1 E_a, of the norm m,

    det F_a / J = det(1 + M_a) = 1 + tr M_a + tr cof M_a + det M_a >= 1 - sqrt(3) m - m^2 - m^3 / (3 sqrt(3)),

as the singular values s_i of M_a have sum s_i <= sqrt(3) m, sum s_i s_j <= m^2 and s_1 s_2 s_3 <= (m / sqrt(3))^3. In j / J, the
mean of these, the traces all but cancel: at most 1 + c m + m^2 + m^3 / (3 sqrt(3)), where c is zero for a parallelepiped. Where m
is so small that the quotient is above t, no corner is looked at: with ``reach``, the largest norm of any (m_1a, ..., m_4a), m is
at most reach (sum_k |F^-1 q_k|^2)^(1/2).

An iterate of a relaxation may overshoot: below ``LAST_RATIO`` the energy goes on as a straight line, which leads back. A run in
time ends where a corner is flat.
"""

from __future__ import annotations

import numpy as np

from explicitfe.fem.elements.hex8 import MODES, VOLUME, geometry
from explicitfe.fem.mesh.hexmesh import CORNERS
from explicitfe.platform.compiled.choose import choose
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import maximum
from explicitfe.platform.host.kept import kept

THRESHOLD = 0.4  # t
STRENGTH = 10.0  # B
LAST_RATIO = 1e-3  # of r_a to t
# Numbers of an element: (reach / largest safe m)^2 [1/m^2]; B G [Pa]; B G / (2 m) [1/(m s^2)] with the mass m of its lightest
# node; 1 / sum_a D_a(rest) and 1 / D_a(rest) [1/m^3] of the guarded corners, 0 at one that is not.
REACH, MODULUS, PER_MASS, WHOLE, REST, NUMBERS = 0, 1, 2, 3, 4, 12
# A corner whose edges span less than this share of the element's volume at rest is not guarded: it has collapsed into an edge or
# a face, or is so flat that it moves by more than its own height in a step.
GUARDED_SHARE = 0.2


_BITS = np.array([1, 2, 4])  # of (xi, eta, zeta) in the order of the corners
_ROOT_STEPS = 8
_ROUNDING = 1e-12  # of the closed forms, to the safe side


def _largest_safe_norm(c: np.ndarray) -> np.ndarray:
    """The m below which r_a >= t, (m,), for the c of each element: the root of a concave function that falls.

    Newton's method comes to it from above, and begins where the linear terms vanish.
    """
    slope = np.sqrt(3.0) + THRESHOLD * c
    m = (1.0 - THRESHOLD) / slope
    for _ in range(_ROOT_STEPS):
        higher, change = m**2 + m**3 / np.sqrt(27.0), 2.0 * m + m**2 / np.sqrt(3.0)
        m -= (slope * m + (1.0 + THRESHOLD) * higher - (1.0 - THRESHOLD)) / (slope + (1.0 + THRESHOLD) * change)
    return m * (1.0 - _ROUNDING)


def _spectral_norms(M: np.ndarray) -> np.ndarray:
    """Largest singular value of each matrix (m, 4, 3), by the closed form for the eigenvalues of M^T M (Smith 1961)."""
    square = M.transpose(0, 2, 1) @ M
    mean = np.trace(square, axis1=1, axis2=2) / 3.0
    apart = square - mean[:, None, None] * np.eye(3)
    size = np.sqrt(np.einsum("kij,kij->k", apart, apart) / 6.0)
    angle = np.arccos(np.clip(np.linalg.det(apart) / np.maximum(2.0 * size**3, 1e-300), -1.0, 1.0)) / 3.0
    return np.sqrt(mean + 2.0 * size * np.cos(angle)) * (1.0 + _ROUNDING)


def constants(corners: np.ndarray, modulus_Pa: np.ndarray, mass_kg: np.ndarray) -> np.ndarray:
    """What the kernels read of each element, (m, NUMBERS).

    Parameters
    ----------
    corners : (m, 8, 3) m. Reference positions of the corners in VTK order.
    modulus_Pa : (m,) Pa. Shear modulus in the long run.
    mass_kg : (m,) kg. Mass of the lightest node of each.
    """
    safe, whole, inverse = _of_shape(corners)
    strength_Pa = STRENGTH * modulus_Pa
    return np.column_stack([safe, strength_Pa, strength_Pa / (2.0 * mass_kg), 1.0 / whole, inverse])


@kept(4)
def _of_shape(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each element (reach / largest safe m)^2, the sum of D_a(rest) over guarded corners, and 1 / D_a(rest)."""
    modes = MODES @ corners
    numbers = geometry(corners)
    b = numbers[:, :18].reshape(-1, 6, 3)
    # the residual field has no mean gradient: what that says of its linear modes
    linear = -b[:, 3:] @ np.linalg.inv(b[:, :3])
    reach, whole = np.zeros(len(corners)), np.zeros(len(corners))
    mean = np.zeros((len(corners), 4, 3))  # sum_a D_a(rest) m_ka
    inverse = np.zeros((len(corners), 8))
    for corner in CORNERS:
        edges = np.stack([_edge(modes, corner, along) for along in range(3)], axis=1)
        span = np.linalg.det(0.25 * edges)
        guarded = span > GUARDED_SHARE * numbers[:, VOLUME]
        M = np.zeros((len(corners), 4, 3))
        M[:, :3] = linear
        for along in range(3):
            one, other = (along + 1) % 3, (along + 2) % 3
            M[:, other, along] += corner[one]
            M[:, one, along] += corner[other]
            M[:, 3, along] += corner[one] * corner[other]
        edges[~guarded] = np.eye(3)
        M = np.where(guarded[:, None, None], M @ np.linalg.inv(edges.transpose(0, 2, 1)), 0.0)
        reach = np.maximum(reach, _spectral_norms(M))
        mean += np.where(guarded, span, 0.0)[:, None, None] * M
        whole += np.where(guarded, span, 0.0)
        inverse[guarded, _BITS @ (corner > 0.0)] = 1.0 / span[guarded]
    reach = np.maximum(reach, 1e-300)
    c = np.linalg.norm(mean, axis=(1, 2)) / whole / reach
    return (reach / _largest_safe_norm(c)) ** 2, whole, inverse


def _edge(modes: np.ndarray, corner: np.ndarray, along: int) -> np.ndarray:
    """Eight times dx/dxi_along at a corner, from the modes (m, 7, 3)."""
    one, other = (along + 1) % 3, (along + 2) % 3
    return (
        modes[:, along]
        + corner[one] * modes[:, 3 + other]
        + corner[other] * modes[:, 3 + one]
        + corner[one] * corner[other] * modes[:, 6]
    )


@leaf
def slack(cof, J, qx, qy, qz, reach):
    """Negative where a corner may have r_a < t: what m^2 leaves of the square that is safe, times J^2 over that."""
    square = 0.0 * J
    for k in range(4):
        x = cof[0] * qx[k] + cof[3] * qy[k] + cof[6] * qz[k]
        y = cof[1] * qx[k] + cof[4] * qy[k] + cof[7] * qz[k]
        z = cof[2] * qx[k] + cof[5] * qy[k] + cof[8] * qz[k]
        square = square + x * x + y * y + z * z
    return J * J - reach * square


@leaf
def edges_of_corners(x):
    """The 12 edges of one component, from its values at the eight corners: four along each natural axis.

    Those along xi lie at (eta, zeta) = (-, -), (+, -), (-, +), (+, +), those along eta likewise at (zeta, xi), and so on around.
    """
    return (
        x[1] - x[0], x[2] - x[3], x[5] - x[4], x[6] - x[7],
        x[3] - x[0], x[7] - x[4], x[2] - x[1], x[6] - x[5],
        x[4] - x[0], x[5] - x[1], x[7] - x[3], x[6] - x[2],
    )  # fmt: skip


@leaf
def corners_of_edges(h):
    """The transpose of ``edges_of_corners``: forces on the eight corners from those on the 12 edges."""
    return (
        -(h[0] + h[4] + h[8]),
        h[0] - h[6] - h[9],
        h[1] + h[6] - h[11],
        h[4] - h[1] - h[10],
        h[8] - h[2] - h[5],
        h[2] + h[9] - h[7],
        h[3] + h[7] + h[11],
        h[5] + h[10] - h[3],
    )


@leaf
def edges_at(corner):
    """Which of the 12 edges meet at a corner, counted by its bits (xi, eta, zeta): along xi, eta and zeta."""
    i, j, k = corner & 1, (corner >> 1) & 1, corner >> 2
    return j + 2 * k, 4 + k + 2 * i, 8 + i + 2 * j


@leaf
def cross(a, b):
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@leaf
def ratio(now, inverse, j):
    """D_a / D_a(rest) of a corner; j where it is not guarded."""
    return choose(inverse, now * inverse, j)


@leaf
def density(s):
    """phi at s = r_a / t."""
    within = maximum(s, 0.0 * s + LAST_RATIO)
    left = maximum(1.0 - within, 0.0 * s)
    return left * left * left / within + density_slope(within, 1.0 / within) * (s - within)


@leaf
def density_slope(s, inverse):
    """d phi / ds at s and 1 / s, s not below the last ratio."""
    left = maximum(1.0 - s, 0.0 * s)
    return -(left * left) * (2.0 * s + 1.0) * (inverse * inverse)


@leaf
def density_curvature(s, inverse):
    """d^2 phi / ds^2 at s and 1 / s, s not below the last ratio."""
    left = maximum(1.0 - s, 0.0 * s)
    return 2.0 * left * (s * s + s + 1.0) * (inverse * inverse * inverse)
