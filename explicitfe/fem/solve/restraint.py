"""Stiffness of ties and contact, for the highest frequency of a mesh."""

from __future__ import annotations

from explicitfe.fem.forces.apart import add_surfaces_stiffness
from explicitfe.fem.forces.bone import add_contact_stiffness
from explicitfe.fem.forces.ties import add_ties
from explicitfe.platform.compiled.threads import wait


def hold(force, u, state, part, actions, instant):
    """Add to all rows the pull of ties at displacement u, and the change of contact since the present state, linearised."""
    if len(actions.bones.rows) + len(actions.ties.node) + len(actions.surfaces.node) > 0:
        wait(part.gate, part.parts)
        if part.number == 0:
            add_contact_stiffness(force, u, state.u, actions.bones, actions.bone_placement, instant)
            add_ties(force, u, actions.ties, actions.tie_placement, instant)
            add_surfaces_stiffness(force, u, state.u, actions.surfaces)
        wait(part.gate, part.parts)
