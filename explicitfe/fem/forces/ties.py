"""Patches of the surface that springs tie to bones, in proportion to their area.

The energy of a patch is the integral of k |u - u_bone|^2 / 2 over it. With the shape functions of the faces that is a matrix
between their nodes, K_ab = integral of k N_a N_b; and since these functions give back every field that is linear in place, a bone
that moves rigidly is met at the nodes. A bone that itself hangs on a spring of stiffness K_bone gives way without turning, to
where its own spring and all ties are in balance: h = sum K u / (K_bone + sum K).
"""

from __future__ import annotations

from explicitfe.platform.compiled.arrays import ROTATION, SHIFT
from explicitfe.platform.compiled.jit import leaf


@leaf
def pulled(ties, entry, u, placement, instant):
    """Displacement of a tied node relative to where its bone's course puts it."""
    node, bone = ties.node[entry], ties.bone[entry]
    x, y, z = u[node, 0], u[node, 1], u[node, 2]
    if ties.moves[bone]:
        X, Y, Z = ties.position[entry, 0], ties.position[entry, 1], ties.position[entry, 2]
        R, s, now = ROTATION, SHIFT, placement
        x += X - now[instant, bone, R] * X - now[instant, bone, R + 1] * Y - now[instant, bone, R + 2] * Z
        y += Y - now[instant, bone, R + 3] * X - now[instant, bone, R + 4] * Y - now[instant, bone, R + 5] * Z
        z += Z - now[instant, bone, R + 6] * X - now[instant, bone, R + 7] * Y - now[instant, bone, R + 8] * Z
        x, y, z = x - now[instant, bone, s], y - now[instant, bone, s + 1], z - now[instant, bone, s + 2]
    return x, y, z


@leaf
def add_ties(force, u, ties, placement, instant):
    """Add the pull of the bones at displacement u to the node rows; give the energy [J] of ties and bones' springs."""
    shift = ties.shift
    for bone in range(len(ties.total)):
        shift[bone, 0] = shift[bone, 1] = shift[bone, 2] = 0.0
    for row in range(len(ties.node)):
        x, y, z = pulled(ties, row, u, placement, instant)
        ties.moved[row, 0], ties.moved[row, 1], ties.moved[row, 2] = x, y, z
    energy = 0.0
    for row in range(len(ties.node)):
        x = y = z = 0.0
        for entry in range(ties.start[row], ties.start[row + 1]):
            column, k = ties.column[entry], ties.stiffness[entry]
            x += k * ties.moved[column, 0]
            y += k * ties.moved[column, 1]
            z += k * ties.moved[column, 2]
        node, bone = ties.node[row], ties.bone[row]
        X, Y, Z = ties.normal[bone, 0], ties.normal[bone, 1], ties.normal[bone, 2]
        along = ties.excess[bone] * (x * X + y * Y + z * Z)
        x, y, z = x + along * X, y + along * Y, z + along * Z
        force[node, 0] -= x
        force[node, 1] -= y
        force[node, 2] -= z
        shift[bone, 0] += x
        shift[bone, 1] += y
        shift[bone, 2] += z
        energy += 0.5 * (x * ties.moved[row, 0] + y * ties.moved[row, 1] + z * ties.moved[row, 2])
    for bone in range(len(ties.total)):
        yielding = 1.0 / (ties.bone_stiffness[bone] + ties.total[bone])  # 0 for a bone that is fixed
        for k in range(3):
            pull = shift[bone, k]
            shift[bone, k] = pull * yielding
            energy -= 0.5 * pull * shift[bone, k]
    for row in range(len(ties.node)):
        node, bone = ties.node[row], ties.bone[row]
        for k in range(3):
            force[node, k] += ties.row_sum[row] * shift[bone, k]
    return energy
