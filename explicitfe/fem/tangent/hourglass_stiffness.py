"""How the forces of elements/hourglass_stiffness.py change: they are linear in the hourglass modes."""

from __future__ import annotations

from explicitfe.fem.tangent.arrays import TREATMENT_AT
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, store


@leaf
def prepare(F, qx, qy, qz, h, weight, work):
    """Put the stiffness into the work array of a block."""
    store(work, TREATMENT_AT * WIDTH, 2.0 * h[0] * weight)


@leaf
def force_change(work, lane, q, dF, dqx, dqy, dqz):
    """Changes of the derivatives of weight x delta by the modes, 3 x 4, and by F, for changes dF and dq at a constant weight."""
    k = work[TREATMENT_AT, lane]
    zero = 0.0 * dqx[0]
    return (
        (k * dqx[0], k * dqx[1], k * dqx[2], k * dqx[3]),
        (k * dqy[0], k * dqy[1], k * dqy[2], k * dqy[3]),
        (k * dqz[0], k * dqz[1], k * dqz[2], k * dqz[3]),
        (zero, zero, zero, zero, zero, zero, zero, zero, zero),
    )
