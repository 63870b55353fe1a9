"""Reaction forces: of fixed and prescribed nodes, and of ties.

A held or prescribed node moves as it is told, so the force that makes it do so follows from its equation of motion,
R = M a + alpha M v - f_ext + f_int, with the forces and velocities of the integrator itself.
"""

from __future__ import annotations

from explicitfe.platform.compiled.jit import part_of_kernels


@part_of_kernels
def sum_reactions(sums, holders, v, velocity, resting, external, nodes, ties, alpha, dt):
    """Write the force of each holder on the body, and the sum of all loads on the body [N], in this order.

    Parameters
    ----------
    sums : (sets + ties + 1, 3) N.
    holders : Holders. Rows of the nodes of each set.
    v, velocity : (N, 4) m/s. Of the half step before the instant, and at the instant.
    resting, external : (N, 4) N. All forces but the external ones, and these; ``add_ties`` has left its work arrays in ``ties``.
    dt : s. Step before the instant.
    """
    sets = len(holders.start) - 1
    last = len(sums) - 1
    sums[:] = 0.0
    for row in range(len(external)):
        for k in range(3):
            sums[last, k] += external[row, k]
    for number in range(sets):
        for entry in range(holders.start[number], holders.start[number + 1]):
            row = holders.node[entry]
            for k in range(3):
                if nodes.inverse_mass[row, k] == 0.0:
                    rate = 2.0 * (velocity[row, k] - v[row, k]) / dt if dt > 0.0 else 0.0
                    inertia = nodes.mass[row, k] * (rate + alpha * velocity[row, k])
                    sums[number, k] += inertia - resting[row, k] - external[row, k]
    for row in range(len(ties.node)):
        bone = ties.bone[row]
        x = y = z = 0.0
        for entry in range(ties.start[row], ties.start[row + 1]):
            column, stiffness = ties.column[entry], ties.stiffness[entry]
            x += stiffness * ties.moved[column, 0]
            y += stiffness * ties.moved[column, 1]
            z += stiffness * ties.moved[column, 2]
        X, Y, Z = ties.normal[bone, 0], ties.normal[bone, 1], ties.normal[bone, 2]
        along = ties.excess[bone] * (x * X + y * Y + z * Z)
        sums[sets + bone, 0] += ties.row_sum[row] * ties.shift[bone, 0] - x - along * X
        sums[sets + bone, 1] += ties.row_sum[row] * ties.shift[bone, 1] - y - along * Y
        sums[sets + bone, 2] += ties.row_sum[row] * ties.shift[bone, 2] - z - along * Z
    for number in range(sets, last):
        for k in range(3):
            sums[last, k] -= sums[number, k]
