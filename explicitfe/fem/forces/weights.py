"""Weights that hang from a body on strings: inertia along gravity only, and no pull while a string is slack.

A weight of mass m has one coordinate s along gravity, m s'' = w - T. Its string pulls by T = k (s - d - slack) + c (s' - d')
where that is positive, with d the displacement of the body along gravity where the string is fixed. Otherwise the weight falls
freely. The weights are advanced by the same central differences as the body. The work of the strings is external work.
"""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


@leaf
def pull_of(u, v, weights, number):
    """Pull [N] of the string of a weight."""
    x, y, z = weights.down[number, 0], weights.down[number, 1], weights.down[number, 2]
    moved = speed = 0.0
    for entry in range(weights.start[number], weights.start[number + 1]):
        node, share = weights.node[entry], weights.share[entry]
        moved += share * (u[node, 0] * x + u[node, 1] * y + u[node, 2] * z)
        speed += share * (v[node, 0] * x + v[node, 1] * y + v[node, 2] * z)
    stretch = weights.state[number, 0] - moved - weights.slack[number]
    if stretch <= 0.0:
        return 0.0
    return max(0.0, weights.stiffness[number] * stretch + weights.damping[number] * (weights.state[number, 1] - speed))


@leaf
def add_weights(force, u, v, weights, activation, instant):
    """Add the pull of the strings at displacement u and velocity v to the node rows, and store the net force on each weight."""
    for number in range(len(weights.mass)):
        pull = pull_of(u, v, weights, number)
        weights.push[number] = weights.weight[number] * activation[weights.profile[number], instant] - pull
        for entry in range(weights.start[number], weights.start[number + 1]):
            node, share = weights.node[entry], weights.share[entry] * pull
            for k in range(3):
                force[node, k] += share * weights.down[number, k]


@leaf
def move_weights(weights, h, dt):
    """Advance the weights to the next instant under the stored forces; h is the mean of the steps before and after it [s]."""
    for number in range(len(weights.mass)):
        weights.state[number, 1] += h * weights.push[number] / weights.mass[number]
        weights.state[number, 0] += dt * weights.state[number, 1]
