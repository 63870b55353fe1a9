"""Weights that hang from a body on inextensible strings: inertia along gravity only, and no pull while a string is slack.

A weight of mass m has one coordinate s along gravity, m s'' = w - T. Its string is a constraint, s <= d + slack, with d the
displacement of the body along gravity where the string is fixed. The pull T >= 0 is the Lagrange multiplier that lets the
constraint hold after the step (forward increment method, Carpenter, Taylor and Katona 1991): it follows from the displacements
that body and weight would have without it. A string that becomes taut transfers momentum in one step, as an inelastic impact. The
weights are advanced by the same central differences as the body, and the work of the strings is external work.
"""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


@leaf
def pull_weights(external, force, u, v, inverse_mass, weights, activation, instant, keep, gain, h, dt):
    """Add the pull of taut strings to the external forces, and store the net force on each weight.

    Parameters
    ----------
    external, force : (N, 4) all other forces on the node rows [N].
    inverse_mass : (N, 4) 1/kg.
    keep, gain, h, dt : share of the velocity v that remains in this step, what a force over a mass adds to it [s], mean of the
        steps before and after the instant [s], and the step [s].
    """
    for number in range(len(weights.mass)):
        moved = speed = mobility = 0.0
        for entry in range(weights.start[number], weights.start[number + 1]):
            node = weights.node[entry]
            for k in range(3):
                along, inverse = weights.share[entry] * weights.down[number, k], inverse_mass[node, k]
                moved += along * u[node, k]
                speed += along * (keep * v[node, k] + gain * inverse * (force[node, k] + external[node, k]))
                mobility += along * along * gain * inverse
        fall = h / weights.mass[number]
        weight = weights.weight[number] * activation[weights.profile[number], instant]
        below = weights.state[number, 0] + dt * (weights.state[number, 1] + fall * weight) - weights.slack[number]
        pull = max(0.0, (below - moved - dt * speed) / (dt * (fall + mobility)))
        weights.push[number] = weight - pull
        for entry in range(weights.start[number], weights.start[number + 1]):
            for k in range(3):
                external[weights.node[entry], k] += weights.share[entry] * pull * weights.down[number, k]


@leaf
def move_weights(weights, h, dt):
    """Advance the weights to the next instant under the stored forces; h is the mean of the steps before and after it [s]."""
    for number in range(len(weights.mass)):
        weights.state[number, 1] += h * weights.push[number] / weights.mass[number]
        weights.state[number, 0] += dt * weights.state[number, 1]
