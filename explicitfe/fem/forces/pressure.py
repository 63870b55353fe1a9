"""Pressure on faces of elements that follows them.

With corners x_c = m + r_c a + s_c b + r_c s_c d (r_c, s_c = -1 or 1) the normal over dr ds is a x b + r a x d + s d x b, so that

    f_c = -p (a x b + r_c / 3 a x d + s_c / 3 d x b)

is the exact integral of -p N_c n over the face. On a closed surface the forces and their moments add up to zero.
"""

from __future__ import annotations

from explicitfe.platform.compiled.jit import part_of_kernels


@part_of_kernels
def add_pressure(force, u, faces, activation, instant):
    """Add the pressure on faces at displacement u to the node rows."""
    for face in range(len(faces.profile)):
        p = activation[faces.profile[face], instant] * faces.pressure[face]
        if p == 0.0:
            continue
        ax = ay = az = bx = by = bz = dx = dy = dz = 0.0
        for c in range(4):
            row = faces.node[face, c]
            x = 0.25 * (faces.position[face, c, 0] + u[row, 0])
            y = 0.25 * (faces.position[face, c, 1] + u[row, 1])
            z = 0.25 * (faces.position[face, c, 2] + u[row, 2])
            r = 1.0 if c == 1 or c == 2 else -1.0
            s = 1.0 if c > 1 else -1.0
            ax, ay, az = ax + r * x, ay + r * y, az + r * z
            bx, by, bz = bx + s * x, by + s * y, bz + s * z
            dx, dy, dz = dx + r * s * x, dy + r * s * y, dz + r * s * z
        for c in range(4):
            row = faces.node[face, c]
            r = p / 3.0 if c == 1 or c == 2 else -p / 3.0
            s = p / 3.0 if c > 1 else -p / 3.0
            force[row, 0] -= p * (ay * bz - az * by) + r * (ay * dz - az * dy) + s * (dy * bz - dz * by)
            force[row, 1] -= p * (az * bx - ax * bz) + r * (az * dx - ax * dz) + s * (dz * bx - dx * bz)
            force[row, 2] -= p * (ax * by - ay * bx) + r * (ax * dy - ay * dx) + s * (dx * by - dy * bx)
