"""Patches of the surface that springs tie to bones, in proportion to their area.

The energy of a patch is the integral of k |u - u_bone|^2 / 2 over it. With the shape functions of the faces that is a matrix
between their nodes, K_ab = integral of k N_a N_b; and since these functions give back every field that is linear in place, a bone
that moves rigidly is met at the nodes. A bone that itself hangs on a spring of stiffness K_bone gives way without turning, to
where its own spring and all ties are in balance: h = sum K u / (K_bone + sum K).
"""

from __future__ import annotations

from explicitfe.compiled.arrays import ROTATION, SHIFT
from explicitfe.compiled.jit import leaf


@leaf
def _moved(ties, entry, u, placement, instant, k):
    """Displacement of a tied node relative to where its bone's course puts it."""
    if not ties.moves[ties.bone[entry]]:
        return u[ties.node[entry], k]
    R, X = placement[instant, ties.bone[entry]], ties.position[entry]
    at = ROTATION + 3 * k
    return u[ties.node[entry], k] + X[k] - R[at] * X[0] - R[at + 1] * X[1] - R[at + 2] * X[2] - R[SHIFT + k]


@leaf
def add_ties(force, u, ties, placement, instant):
    """Add the pull of the bones at displacement u to the node rows; give the energy [J] of ties and bones' springs."""
    ties.shift[:] = 0.0
    energy = 0.0
    for row in range(len(ties.node)):
        bone = ties.bone[row]
        for k in range(3):
            pull = 0.0
            for entry in range(ties.start[row], ties.start[row + 1]):
                pull += ties.stiffness[entry] * _moved(ties, ties.column[entry], u, placement, instant, k)
            force[ties.node[row], k] -= pull
            ties.shift[bone, k] += pull
            energy += 0.5 * pull * _moved(ties, row, u, placement, instant, k)
    for bone in range(len(ties.total)):
        for k in range(3):
            pull = ties.shift[bone, k]
            ties.shift[bone, k] = pull / (ties.bone_stiffness[bone] + ties.total[bone])
            energy -= 0.5 * pull * ties.shift[bone, k]
    for row in range(len(ties.node)):
        bone = ties.bone[row]
        if ties.shift[bone, 0] != 0.0 or ties.shift[bone, 1] != 0.0 or ties.shift[bone, 2] != 0.0:
            whole = 0.0
            for entry in range(ties.start[row], ties.start[row + 1]):
                whole += ties.stiffness[entry]
            for k in range(3):
                force[ties.node[row], k] += whole * ties.shift[bone, k]
    return energy
