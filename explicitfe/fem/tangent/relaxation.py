"""How the relaxed isochoric stress of effects/material/viscoelastic.py changes: it is linear in the elastic one."""

from __future__ import annotations

from explicitfe.fem.effects.effect import number, remembered_tensor
from explicitfe.fem.materials.kinematics import minus, plus, times
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, load_many, splat, store

AT = MEMORY = 0
TERMS = 1
TENSOR = 6


@leaf
def elastic_stress(S, blocks, block):
    """The stress of a material without memory, and the share of it that hourglass control keeps."""
    return S, splat(1.0)


@leaf
def elastic_change(dS, blocks, block, lane, memory, at):
    """The change of the stress of a material without memory."""
    return dS


def stress_of_terms(S, blocks, block):
    """Relaxed part of the isochoric stress S (6) [Pa] in the accepted state, and its long-term fraction for hourglass control."""
    left = number(blocks, block, AT)
    T = times(left, S)
    for term in range(TERMS):
        T = plus(T, remembered_tensor(blocks, block, MEMORY + 6 + 6 * term))
    return T, left


def change_of_terms(dS, blocks, block, lane, memory, at):
    """The change of it in one element for a change dS of the elastic stress, which is remembered from ``at`` on."""
    T = times(blocks.effects[block, AT, lane], dS)
    change = minus(dS, load_many(memory, at, TENSOR))
    _keep(memory, at, dS)
    for term in range(TERMS):
        gain, decay = blocks.effects[block, AT + 1 + 3 * term, lane], blocks.effects[block, AT + 2 + 3 * term, lane]
        here = at + 6 * (1 + term) * WIDTH
        Q = plus(times(decay, load_many(memory, here, TENSOR)), times(gain, change))
        _keep(memory, here, Q)
        T = plus(T, Q)
    return T


@leaf
def _keep(memory, at, S):
    for k in range(6):
        store(memory, at + k * WIDTH, S[k])
