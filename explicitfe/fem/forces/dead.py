"""Nodal forces of fixed direction, in groups that share a time profile."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


@leaf
def add_dead_loads(force, loads, activation, instant):
    """Add the loads at an instant to the node rows; activation[profile, instant] scales each group."""
    for group in range(len(loads.profile)):
        scale = activation[loads.profile[group], instant]
        if scale != 0.0:
            for entry in range(loads.start[group], loads.start[group + 1]):
                node = loads.node[entry]
                for k in range(3):
                    force[node, k] += scale * loads.force[entry, k]
