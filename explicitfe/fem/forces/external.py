"""The one list of forces that act on the nodes from outside, for the steps, the samples and the stability checks.

A new force is a field of ``Actions`` and a line in :func:`add_forces`; a line in :func:`add_stiffness` too if its stiffness can
limit the time step. Internal forces, bones and hanging weights are not listed: threads share the first two out among them, and
the pull of a weight depends on all other forces.
"""

from __future__ import annotations

from typing import Any

from explicitfe.fem.forces.bone import add_contact_stiffness
from explicitfe.fem.forces.dead import add_dead_loads
from explicitfe.fem.forces.drag import add_drag
from explicitfe.fem.forces.follower import add_follower_fibres
from explicitfe.fem.forces.pressure import add_pressure
from explicitfe.fem.forces.ties import add_ties
from explicitfe.fem.forces.turning import add_turning_loads

# Placeholders, bound in solve/kernels.py.
add_surfaces: Any = None
add_surfaces_stiffness: Any = None


def add_forces(external, u, v, actions, nodes, instant, gain):
    """Add all forces at an instant to the node rows; give the energies [J] stored in ties and in contact of surfaces.

    Parameters
    ----------
    external : (N, 4) N. Changed in place.
    u, v : (N, 4) m, m/s. Displacement, and velocity of the half step before.
    actions, nodes : Actions, Nodes.
    gain : s. What a force over a mass adds to the velocity in this step.
    """
    add_dead_loads(external, actions.dead, actions.activation, instant)
    add_follower_fibres(external, u, actions.fibres, actions.activation, instant)
    add_turning_loads(external, u, actions.turning, actions.activation, instant)
    add_pressure(external, u, actions.pressed, actions.activation, instant)
    add_drag(external, v, actions.drag)
    tied = add_ties(external, u, actions.ties, actions.tie_placement, instant)
    return tied, add_surfaces(external, u, v, actions.surfaces, nodes, gain)


def add_stiffness(force, u, here, actions, instant):
    """Add the pull of ties at displacement u, and the change of contact from ``here`` to u, linearised at the former."""
    add_contact_stiffness(force, u, here, actions.bones, actions.bone_placement, instant)
    add_ties(force, u, actions.ties, actions.tie_placement, instant)
    add_surfaces_stiffness(force, u, here, actions.surfaces)
