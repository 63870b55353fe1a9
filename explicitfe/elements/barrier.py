"""What keeps a hex from folding at a corner: an energy that grows without bound as a corner becomes flat.

The one point of an element sees its mean deformation, which can be sound while a corner folds. At corner a the edges along
xi, eta, zeta span the volume D_a, and D_a / D_a(rest) = det F_a is the volume ratio there. Relative to that of the mean, J,

    r_a = D_a / (D_a(rest) J),    energy = sum_a v_a B G phi(r_a / t),    phi(s) = (1 - s)^3 / s below s = 1, else 0,

where v_a = D_a(rest) / 512 is the corner's share of the element's volume, and G the long-term shear modulus of its law. In any
homogeneous deformation r_a = 1, however large that is. The energy begins with zero force and stiffness at r_a = t and is infinite
at 0. So it takes no part in an element that is not about to fold, and vanishes as a mesh is refined: r_a then goes to 1.
Barriers of this kind are known from mesh untangling and from contact (Li et al. 2020, ACM Trans. Graph. 39:49).

Few elements need it. With E_a = F_a - F = sum_k q_k x m_ka, linear in the hourglass modes, and M = F^-1 E_a, of the norm m,

    r_a = det(1 + M) = 1 + tr M + tr cof M + det M >= 1 - sqrt(3) m - m^2 - m^3 / (3 sqrt(3)),

as the singular values s_i of M have sum s_i <= sqrt(3) m, sum s_i s_j <= m^2 and s_1 s_2 s_3 <= (m / sqrt(3))^3. Where m is so
small that this is above t, no corner is looked at. With ``reach``, the largest norm of any (m_1a, ..., m_4a), it is at most
reach (sum_k |F^-1 q_k|^2)^(1/2).

An iterate of a relaxation may overshoot: below ``LAST_RATIO`` the energy goes on as a straight line, which leads back. A run in
time ends where a corner is flat.
"""

from __future__ import annotations

import numpy as np

from explicitfe.compiled.choose import choose
from explicitfe.compiled.jit import leaf
from explicitfe.compiled.simd import maximum
from explicitfe.elements.hex8 import MODES, geometry
from explicitfe.mesh.hexmesh import CORNERS

THRESHOLD = 0.4  # t
STRENGTH = 3.0  # B
LAST_RATIO = 1e-3  # of r_a to t
# Numbers of an element: reach^2 [1/m^2], B G [Pa], B G / (8 m) [1/(m s^2)] with the mass m of its lightest node, and
# 1 / D_a(rest) in units of 512 / m^3, 0 at a corner that is not guarded.
REACH, MODULUS, PER_MASS, REST, NUMBERS = 0, 1, 2, 3, 11
# A corner whose edges span less than this share of the element's volume at rest is not guarded: it has collapsed into an edge or
# a face, or is so flat that it moves by more than its own height in a step.
GUARDED_SHARE = 0.1


_BITS = np.array([1, 2, 4])  # of (xi, eta, zeta) in the order of the corners


def _largest_safe_norm(ratio: float) -> float:
    """m at which 1 - sqrt(3) m - m^2 - m^3 / (3 sqrt(3)) is ``ratio``."""
    roots = np.roots([-1.0 / np.sqrt(27.0), -1.0, -np.sqrt(3.0), 1.0 - ratio])
    return float(roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 0.0)].real.min())


SAFE_SQUARE = _largest_safe_norm(THRESHOLD) ** 2


def constants(corners: np.ndarray, modulus_Pa: np.ndarray, mass_kg: np.ndarray) -> np.ndarray:
    """What the kernels read of each element, (m, NUMBERS).

    Parameters
    ----------
    corners : (m, 8, 3) m. Reference positions of the corners in VTK order.
    modulus_Pa : (m,) Pa. Shear modulus in the long run.
    mass_kg : (m,) kg. Mass of the lightest node of each.
    """
    modes = MODES @ corners
    numbers = geometry(corners)
    b = numbers[:, :18].reshape(-1, 6, 3)
    # the residual field has no mean gradient: what that says of its linear modes
    linear = -b[:, 3:] @ np.linalg.inv(b[:, :3])
    reach = np.zeros(len(corners))
    inverse = np.zeros((len(corners), 8))
    for corner in CORNERS:
        edges = np.stack([_edge(modes, corner, along) for along in range(3)], axis=1)
        span = np.linalg.det(edges)
        sound = span > GUARDED_SHARE * 64.0 * numbers[:, 30]
        M = np.zeros((len(corners), 4, 3))
        M[:, :3] = linear
        for along in range(3):
            one, other = (along + 1) % 3, (along + 2) % 3
            M[:, other, along] += corner[one]
            M[:, one, along] += corner[other]
            M[:, 3, along] += corner[one] * corner[other]
        edges[~sound] = np.eye(3)
        norm = np.linalg.norm(M @ np.linalg.inv(edges.transpose(0, 2, 1)), ord=2, axis=(1, 2))
        reach = np.maximum(reach, np.where(sound, norm, 0.0))
        inverse[sound, _BITS @ (corner > 0.0)] = 1.0 / span[sound]
    strength_Pa = STRENGTH * modulus_Pa
    return np.column_stack([reach**2, strength_Pa, strength_Pa / (8.0 * mass_kg), inverse])


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
    """Negative where a corner may have r_a < t: what m^2 leaves of the square that is safe, times J^2."""
    square = 0.0 * J
    for k in range(4):
        x = cof[0] * qx[k] + cof[3] * qy[k] + cof[6] * qz[k]
        y = cof[1] * qx[k] + cof[4] * qy[k] + cof[7] * qz[k]
        z = cof[2] * qx[k] + cof[5] * qy[k] + cof[8] * qz[k]
        square = square + x * x + y * y + z * z
    return SAFE_SQUARE * (J * J) - reach * square


@leaf
def edges_of_modes(m):
    """The 12 edges, eight times dx/dxi_i of one component, from its seven modes: four along each natural axis.

    Those along xi lie at (eta, zeta) = (-, -), (+, -), (-, +), (+, +), those along eta likewise at (zeta, xi), and so on around.
    """
    xi, eta, zeta, ez, zx, xe, xez = m
    return (*_four(xi, xez, xe, zx), *_four(eta, xez, ez, xe), *_four(zeta, xez, zx, ez))


@leaf
def _four(linear, last, one, other):
    """linear + s1 one + s2 other + s1 s2 last, for the signs (s1, s2) of ``edges_of_modes``."""
    p, n = linear + last, linear - last
    both, between = one + other, one - other
    return p - both, n + between, n - between, p + both


@leaf
def modes_of_edges(h):
    """The transpose of ``edges_of_modes``: forces on the seven modes from those on the 12 edges."""
    xi, last_1, xe_1, zx_1 = _together(h[0], h[1], h[2], h[3])
    eta, last_2, ez_1, xe_2 = _together(h[4], h[5], h[6], h[7])
    zeta, last_3, zx_2, ez_2 = _together(h[8], h[9], h[10], h[11])
    return xi, eta, zeta, ez_1 + ez_2, zx_1 + zx_2, xe_1 + xe_2, last_1 + last_2 + last_3


@leaf
def _together(a, b, c, d):
    """Transpose of ``_four``: linear, last, one, other."""
    outer, inner, rise, lean = a + d, b + c, d - a, b - c
    return outer + inner, outer - inner, rise + lean, rise - lean


@leaf
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@leaf
def _at_corner(x, y, z, i, j, k):
    """The three edges that meet at the corner with bits (i, j, k) of (xi, eta, zeta)."""
    a, b, c = j + 2 * k, 4 + k + 2 * i, 8 + i + 2 * j
    return (x[a], y[a], z[a]), (x[b], y[b], z[b]), (x[c], y[c], z[c])


@leaf
def _span(x, y, z, i, j, k):
    """D_a of the corner with bits (i, j, k), in units of 1/512."""
    a, b, c = _at_corner(x, y, z, i, j, k)
    n = _cross(b, c)
    return a[0] * n[0] + a[1] * n[1] + a[2] * n[2]


@leaf
def spans(x, y, z):
    """D_a of the eight corners, in units of 1/512 and in the order of their bits, from the 12 edges of each component."""
    return (
        _span(x, y, z, 0, 0, 0),
        _span(x, y, z, 1, 0, 0),
        _span(x, y, z, 0, 1, 0),
        _span(x, y, z, 1, 1, 0),
        _span(x, y, z, 0, 0, 1),
        _span(x, y, z, 1, 0, 1),
        _span(x, y, z, 0, 1, 1),
        _span(x, y, z, 1, 1, 1),
    )


@leaf
def ratio(now, inverse, J):
    """D_a / D_a(rest) of a corner; J where it is not guarded."""
    return choose(inverse, now * inverse, J)


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


@leaf
def edge_forces(x, y, z, pulls):
    """Derivative of sum_a pulls_a D_a by the 12 edges of each component; the corners in the order of ``spans``."""
    zero = 0.0 * pulls[0]
    h = (zero, zero, zero)
    A00, A10, A01, A11, B00, B10, B01, B11, C00, C10, C01, C11 = h, h, h, h, h, h, h, h, h, h, h, h
    A00, B00, C00 = _pulled(x, y, z, 0, 0, 0, pulls[0], A00, B00, C00)
    A00, B01, C10 = _pulled(x, y, z, 1, 0, 0, pulls[1], A00, B01, C10)
    A10, B00, C01 = _pulled(x, y, z, 0, 1, 0, pulls[2], A10, B00, C01)
    A10, B01, C11 = _pulled(x, y, z, 1, 1, 0, pulls[3], A10, B01, C11)
    A01, B10, C00 = _pulled(x, y, z, 0, 0, 1, pulls[4], A01, B10, C00)
    A01, B11, C10 = _pulled(x, y, z, 1, 0, 1, pulls[5], A01, B11, C10)
    A11, B10, C01 = _pulled(x, y, z, 0, 1, 1, pulls[6], A11, B10, C01)
    A11, B11, C11 = _pulled(x, y, z, 1, 1, 1, pulls[7], A11, B11, C11)
    every = (A00, A10, A01, A11, B00, B10, B01, B11, C00, C10, C01, C11)
    return _components(every, 0), _components(every, 1), _components(every, 2)


@leaf
def _components(h, k):
    return (
        h[0][k], h[1][k], h[2][k], h[3][k], h[4][k], h[5][k], h[6][k], h[7][k], h[8][k], h[9][k], h[10][k], h[11][k]
    )  # fmt: skip


@leaf
def _pulled(x, y, z, i, j, k, pull, ha, hb, hc):
    """Forces on three edges with those of a corner added: pull times the derivative of D_a."""
    a, b, c = _at_corner(x, y, z, i, j, k)
    na, nb, nc = _cross(b, c), _cross(c, a), _cross(a, b)
    return (
        (ha[0] + pull * na[0], ha[1] + pull * na[1], ha[2] + pull * na[2]),
        (hb[0] + pull * nb[0], hb[1] + pull * nb[1], hb[2] + pull * nb[2]),
        (hc[0] + pull * nc[0], hc[1] + pull * nc[1], hc[2] + pull * nc[2]),
    )


@leaf
def stiffness(x, y, z, curvatures):
    """sum_a curvatures_a |dD_a / d edges|^2: how stiff the barrier is, up to a factor.

    The four nodes of a corner move its edges by 4 in the units of D_a, so that |dD_a / d nodes|^2 <= 64 |dD_a / d edges|^2.
    """
    low = _stiff(x, y, z, 0, 0, 0, curvatures[0]) + _stiff(x, y, z, 1, 0, 0, curvatures[1])
    low = low + _stiff(x, y, z, 0, 1, 0, curvatures[2]) + _stiff(x, y, z, 1, 1, 0, curvatures[3])
    top = _stiff(x, y, z, 0, 0, 1, curvatures[4]) + _stiff(x, y, z, 1, 0, 1, curvatures[5])
    return low + top + _stiff(x, y, z, 0, 1, 1, curvatures[6]) + _stiff(x, y, z, 1, 1, 1, curvatures[7])


@leaf
def _stiff(x, y, z, i, j, k, curvature):
    a, b, c = _at_corner(x, y, z, i, j, k)
    return curvature * (_square(_cross(b, c)) + _square(_cross(c, a)) + _square(_cross(a, b)))


@leaf
def _square(n):
    return n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
