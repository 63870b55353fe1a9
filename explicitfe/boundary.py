"""Nodes whose motion is given: held ones have no inverse mass; prescribed ones follow a course, and the work that it takes is
external work."""

from __future__ import annotations

from explicitfe.jit import leaf


@leaf
def drive(u, v, force, nodes, motion, planned, instant, h, alpha, dt_before, dt):
    """Plan the next velocities of the prescribed nodes; give the work and the damping loss [J] of one step.

    ``motion.target`` holds their displacements at the instants; ``planned`` (k, 3) receives the velocities that lead to the next
    one. Their velocity is set to zero until ``place``, so that the update of the free nodes passes them by. ``force`` is minus
    the internal force.
    """
    work = 0.0
    loss = 0.0
    for entry in range(len(motion.node)):
        node = motion.node[entry]
        for k in range(3):
            old = v[node, k]
            new = (motion.target[instant + 1, entry, k] - u[node, k]) / dt
            moved = 0.5 * (dt_before * old + dt * new)
            # what support and loads together do to the node: M dv/dt + alpha M v + f_int
            push = nodes.mass[node, k] * ((new - old) / h + 0.5 * alpha * (new + old)) - force[node, k]
            work += push * moved
            loss += nodes.mass[node, k] * (old + new) * moved
            planned[entry, k] = new
            v[node, k] = 0.0
    return work, loss


@leaf
def place(u, v, motion, planned, instant):
    """Put the prescribed nodes where they shall be at the next instant."""
    for entry in range(len(motion.node)):
        for k in range(3):
            v[motion.node[entry], k] = planned[entry, k]
            u[motion.node[entry], k] = motion.target[instant + 1, entry, k]


@leaf
def correct(u, v, force, external, velocity, nodes, motion, keep, alpha, dt):
    """What ``snapshot`` misses at prescribed nodes: kinetic energy, half a step's work and loss; their velocity is set."""
    kinetic = 0.0
    work = 0.0
    loss = 0.0
    for entry in range(len(motion.node)):
        node = motion.node[entry]
        for k in range(3):
            old = v[node, k]
            new = (motion.target[1, entry, k] - u[node, k]) / dt
            mass = nodes.mass[node, k]
            push = mass * ((new - old) / dt + 0.5 * alpha * (new + old)) - force[node, k]
            kinetic += 0.5 * mass * old * (new - keep * old)
            work += 0.5 * dt * old * (push - external[node, k])
            loss += 0.5 * dt * mass * old * (new - keep * old)
            velocity[node, k] = 0.5 * (old + new)
    return kinetic, work, loss
