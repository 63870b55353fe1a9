"""Active stress of muscles along their fibres, P += a sigma phi(lambda) / lambda (F a0) x a0 with lambda = |F a0|.

With a constant activation a it derives from the energy a sigma Phi(lambda), Phi the integral of phi: a closed loop of states does
no work (Holzapfel 2000, section 6.7, for the derivative of a stretch). In a fibre that shortens, phi = 1 - ((lambda - 1) / 0.5)^2
down to half its length, and 0 below; or 1 throughout. ``blocks.length`` receives the volume integral of sigma Phi of each muscle:
when it falls from one instant to the next by dS while the activation is a, the muscle has done the work a dS.
"""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, load, load_many, maximum, minimum, splat, square_root, store, sum_lanes

SHORTEST_STRETCH_LESS_ONE = -0.5  # a fibre of half its length pulls no more


@leaf
def no_contraction(P, F, volume, blocks, block):
    """The stress of a body in which no muscle pulls."""
    return P


@leaf
def no_start(blocks):
    """Nothing to begin."""


@leaf
def start_contraction(blocks):
    """Sums over the muscles begin anew."""
    for muscle in range(len(blocks.activation)):
        store(blocks.length, muscle * WIDTH, splat(0.0))


@leaf
def contract(P, F, volume, blocks, block):
    """First Piola-Kirchhoff stress (9) [Pa] with that of the muscles in a block added."""
    most = blocks.muscle.shape[1]
    for k in range(most):
        muscle = blocks.muscle[block, k, 0]
        if muscle < 0:
            break
        activation, falls_off = blocks.activation[muscle, 0], blocks.activation[muscle, 1]
        sigma, x, y, z = load_many(blocks.contraction, (block * most + k) * (4 * WIDTH), 4)
        fx = F[0] * x + F[1] * y + F[2] * z
        fy = F[3] * x + F[4] * y + F[5] * z
        fz = F[6] * x + F[7] * y + F[8] * z
        stretch = square_root(fx * fx + fy * fy + fz * fz)
        short = minimum(stretch - 1.0, splat(0.0))
        within = maximum(short, splat(SHORTEST_STRETCH_LESS_ONE))
        phi = 1.0 - falls_off * (4.0 * within * within)
        area = stretch - falls_off * (short - within + (4.0 / 3.0) * within * within * within)
        pull = activation * sigma * phi / stretch
        x, y, z = pull * x, pull * y, pull * z
        P = (
            P[0] + fx * x,
            P[1] + fx * y,
            P[2] + fx * z,
            P[3] + fy * x,
            P[4] + fy * y,
            P[5] + fy * z,
            P[6] + fz * x,
            P[7] + fz * y,
            P[8] + fz * z,
        )
        at = muscle * WIDTH
        store(blocks.length, at, load(blocks.length, at) + volume * sigma * area)
    return P


@leaf
def contraction_work(blocks, before, after):
    """Work of the muscles [J] since the last accepted instant, and accept this one; activations (muscles,) then and now."""
    work = 0.0
    for muscle in range(len(blocks.activation)):
        now = sum_lanes(load(blocks.length, muscle * WIDTH))
        work += 0.5 * (before[muscle] + after[muscle]) * (blocks.last_length[muscle] - now)
        blocks.last_length[muscle] = now
    return work
