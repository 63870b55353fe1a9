"""Nodes whose motion is given: held ones have no inverse mass; prescribed ones follow a course, and the work that it takes is
external work; turned ones follow a partner by rotational symmetry, and hand their forces to it."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


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
    """Put the prescribed nodes where they shall be at the next instant; give their fastest component [m/s]."""
    fastest = 0.0
    for entry in range(len(motion.node)):
        for k in range(3):
            v[motion.node[entry], k] = planned[entry, k]
            u[motion.node[entry], k] = motion.target[instant + 1, entry, k]
            fastest = max(fastest, abs(planned[entry, k]))
    return fastest


@leaf
def correct(u, v, force, external, velocity, nodes, motion, instant, keep, alpha, dt):
    """What ``snapshot`` misses at prescribed nodes: kinetic energy, half a step's work and loss; their velocity is set."""
    kinetic = 0.0
    work = 0.0
    loss = 0.0
    for entry in range(len(motion.node)):
        node = motion.node[entry]
        for k in range(3):
            old = v[node, k]
            new = (motion.target[instant + 1, entry, k] - u[node, k]) / dt
            mass = nodes.mass[node, k]
            push = mass * ((new - old) / dt + 0.5 * alpha * (new + old)) - force[node, k]
            kinetic += 0.5 * mass * old * (new - keep * old)
            work += 0.5 * dt * old * (push - external[node, k])
            loss += 0.5 * dt * mass * old * (new - keep * old)
            velocity[node, k] = 0.5 * (old + new)
    return kinetic, work, loss


@leaf
def turn(u, turned):
    """Give the turned nodes the displacement of their partners, turned about z."""
    c, s = turned.rotation[0], turned.rotation[1]
    for entry in range(len(turned.node)):
        node, partner = turned.node[entry], turned.partner[entry]
        x, y = u[partner, 0], u[partner, 1]
        u[node, 0] = c * x - s * y
        u[node, 1] = s * x + c * y
        u[node, 2] = u[partner, 2]


@leaf
def turn_back(force, turned):
    """Add the forces on the turned nodes, turned back, to their partners."""
    c, s = turned.rotation[0], turned.rotation[1]
    for entry in range(len(turned.node)):
        node, partner = turned.node[entry], turned.partner[entry]
        x, y = force[node, 0], force[node, 1]
        force[partner, 0] += c * x + s * y
        force[partner, 1] += c * y - s * x
        force[partner, 2] += force[node, 2]
        force[node, 0] = force[node, 1] = force[node, 2] = 0.0
