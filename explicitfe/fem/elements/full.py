"""The fully integrated hex: eight Gauss points and the element's mean volume change, slow and simple.

E = sum_g w_g W(F_g) + V U(J_mean), J_mean = v / V: the volume change is taken once for the element (mean dilatation; Nagtegaal,
Parks & Rice 1974; Simo, Taylor & Pister 1985), so it does not lock at Poisson's ratio 1/2. It needs no hourglass control and
is here to answer whether that decided a result. Its shear locks in bending with few elements: compare on fine meshes.
"""

from __future__ import annotations

import numpy as np

from explicitfe.fem.mesh.hexmesh import CORNERS
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, load

HAS_BARRIER = False
GAUSS_POINTS = 8
NUMBERS_PER_POINT = 25  # its volume w_g, and dN_a/dX_j


def constants(corners: np.ndarray, geometry: np.ndarray) -> np.ndarray:
    """What the kernels read of each element, (m, 200): at each Gauss point w_g [m^3] and dN_a/dX_j [1/m]."""
    numbers = []
    for natural in CORNERS / np.sqrt(3.0):
        factors = 1.0 + natural * CORNERS
        dn = np.stack([CORNERS[:, k] * factors[:, (k + 1) % 3] * factors[:, (k + 2) % 3] / 8.0 for k in range(3)], axis=1)
        jacobian = corners.transpose(0, 2, 1) @ dn
        at_point = dn @ np.linalg.inv(jacobian)
        numbers += [np.linalg.det(jacobian)[:, None], at_point.reshape(len(corners), 24)]
    return np.concatenate(numbers, axis=1)


@leaf
def point_gradient(values, numbers, at, j):
    """d u / d X_j of one component's 8 corner values, at the Gauss point whose numbers start at ``at``."""
    first = at + (1 + j) * WIDTH
    return (
        values[0] * load(numbers, first)
        + values[1] * load(numbers, first + 3 * WIDTH)
        + values[2] * load(numbers, first + 6 * WIDTH)
        + values[3] * load(numbers, first + 9 * WIDTH)
        + values[4] * load(numbers, first + 12 * WIDTH)
        + values[5] * load(numbers, first + 15 * WIDTH)
        + values[6] * load(numbers, first + 18 * WIDTH)
        + values[7] * load(numbers, first + 21 * WIDTH)
    )


@leaf
def minus_point_forces(f, px, py, pz, numbers, at):
    """Minus the corner forces of one component, with those of a Gauss point: w_g P B_ga of that row."""
    w = load(numbers, at)
    sx, sy, sz = w * px, w * py, w * pz
    return (
        f[0] - _pull(sx, sy, sz, numbers, at + WIDTH),
        f[1] - _pull(sx, sy, sz, numbers, at + 4 * WIDTH),
        f[2] - _pull(sx, sy, sz, numbers, at + 7 * WIDTH),
        f[3] - _pull(sx, sy, sz, numbers, at + 10 * WIDTH),
        f[4] - _pull(sx, sy, sz, numbers, at + 13 * WIDTH),
        f[5] - _pull(sx, sy, sz, numbers, at + 16 * WIDTH),
        f[6] - _pull(sx, sy, sz, numbers, at + 19 * WIDTH),
        f[7] - _pull(sx, sy, sz, numbers, at + 22 * WIDTH),
    )


@leaf
def _pull(sx, sy, sz, numbers, at):
    return sx * load(numbers, at) + sy * load(numbers, at + WIDTH) + sz * load(numbers, at + 2 * WIDTH)
