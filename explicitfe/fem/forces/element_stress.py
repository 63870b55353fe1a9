"""Mean Cauchy stress of each element, from the forces on its own corners.

For corner forces f_a in balance with the stress inside, the volume integral of sigma is the sum of f_a x x_a, whatever the
element, the material and its history. So the elements are evaluated once more, each with nodes of its own.
"""

from __future__ import annotations

from explicitfe.platform.compiled.jit import part_of_kernels
from explicitfe.platform.compiled.pieces import call_at


@part_of_kernels
def add_stress(stress, J, element, detached, u, internal_force):
    """Write the stress of elements at displacement rows u, (m, 6) Pa: xx, yy, zz, xy, yz, xz.

    ``J`` (m,) and ``element`` (m,), the number in computing order, are in the numbering of the user; ``detached`` is
    Detached, and ``internal_force`` the address of the kernel.
    """
    rows, forces, position = detached.u, detached.force, detached.blocks.position
    for number in range(len(detached.corner)):
        for a in range(8):
            for k in range(3):
                rows[8 * number + a, k] = u[detached.corner[number, a], k]
                forces[8 * number + a, k] = 0.0
    call_at(internal_force, (rows, forces, detached.blocks))
    for user in range(len(element)):
        first = 8 * element[user]
        xx = yy = zz = xy = yz = xz = 0.0
        for row in range(first + 1, first + 8):  # relative to the first corner, whose force balances those of the others
            x = position[row, 0] + rows[row, 0] - position[first, 0] - rows[first, 0]
            y = position[row, 1] + rows[row, 1] - position[first, 1] - rows[first, 1]
            z = position[row, 2] + rows[row, 2] - position[first, 2] - rows[first, 2]
            fx, fy, fz = -forces[row, 0], -forces[row, 1], -forces[row, 2]
            xx, yy, zz = xx + fx * x, yy + fy * y, zz + fz * z
            xy, yz, xz = xy + 0.5 * (fx * y + fy * x), yz + 0.5 * (fy * z + fz * y), xz + 0.5 * (fx * z + fz * x)
        share = 1.0 / (J[user] * detached.volume[element[user]])
        stress[user, 0], stress[user, 1], stress[user, 2] = share * xx, share * yy, share * zz
        stress[user, 3], stress[user, 4], stress[user, 5] = share * xy, share * yz, share * xz
