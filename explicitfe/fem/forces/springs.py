"""Nodes that are held elastically where they are, such as a base that gives way sideways."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


@leaf
def add_springs(u, force, springs):
    """Add -k u of the nodes that springs hold."""
    for entry in range(len(springs.node)):
        node = springs.node[entry]
        for k in range(3):
            force[node, k] -= springs.stiffness[entry, k] * u[node, k]
