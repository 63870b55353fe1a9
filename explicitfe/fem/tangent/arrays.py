"""Arrays of a run that is differentiated: the tangents of its state by W G directions, and how the directions change its inputs.

A vector holds W = ``simd.WIDTH`` directions of one number, and there are G groups of them. N node rows, m elements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from explicitfe.platform.compiled.arrays import Addresses, Blocks, BoneRecord, Nodes, zeros
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import ROW, WIDTH, store

# Places in the work array of a block, vectors over its elements: geometry, frame, F, hourglass modes, C^-1, total second
# Piola-Kirchhoff stress, and derivatives of the hourglass invariant by the modes and by F.
GEOMETRY_AT, FRAME_AT, F_AT, MODES_AT, INVERSE_AT, STRESS_AT, BY_MODES_AT, BY_F_AT = 0, 31, 40, 49, 61, 67, 73, 85
# Numbers, all but the first three times the volume V: derivatives of W' by tr C, log J and delta; 2 J^(-2/3), 2 a / 3, a and b of
# the isochoric stress a 1 + b C^-1, tr C; share of the stress that hourglass control keeps; p J, J d(p J)/dJ and J dp/dK. The
# stress and what the material remembers are those times V as well.
NUMBERS_AT = 94
BY_TRACE, BY_VOLUME, BY_DELTA, SQUARE, SLOPED, A, B, TRACE, SHARE, PJ, PJ_SLOPE, BY_BULK, NUMBER_COUNT = range(13)
# Derivatives of W' by the constants of the law; what the hourglass treatment prepares; and of each muscle a0 x a0 (6), its
# stiffness and its stress at a sigma of 1.
MOST_CONSTANTS = 16
BY_CONSTANTS_AT = NUMBERS_AT + NUMBER_COUNT
TREATMENT_AT = BY_CONSTANTS_AT + MOST_CONSTANTS
MOST_OF_TREATMENT = 56
CONSTANTS_AT = TREATMENT_AT + MOST_OF_TREATMENT
MUSCLES_AT = CONSTANTS_AT + MOST_CONSTANTS
OF_MUSCLE = 8
COMPONENTS = 3  # vectors of a node
# Places in the work array of the barrier: changes of the 36 components of the edges and of the forces on them, of the spans D_a
# and of the slopes phi'.
EDGES_CHANGE, PULLS_CHANGE, SPANS_CHANGE, SLOPES_CHANGE, BARRIER_CHANGES = 0, 36, 72, 80, 88
# The same for the values: edges, D_a, phi' and phi''.
EDGES_NOW, SPANS_NOW, SLOPES_NOW, CURVATURES_NOW, BARRIER_VALUES = 0, 36, 44, 52, 60


class Tangents(NamedTuple):
    """Derivatives of the state by the directions, and of the inputs; an input that no direction changes has no rows."""

    u: np.ndarray  # of displacements, (G, N, 3, W)
    v: np.ndarray  # of velocities, (G, N, 3, W)
    force: np.ndarray  # of minus the internal forces, then of all forces, (G, N, 3, W)
    rows: np.ndarray  # where the vectors of the corners of each element begin in a group, int64, (B, 8, W)
    before: np.ndarray  # velocity before the present step: work array [m/s], (N, 4)
    memory: np.ndarray  # of the isochoric stress and its relaxed parts, as the material remembers them, (m, G, numbers, W)
    work: np.ndarray  # of a block, (numbers, W)
    barrier: np.ndarray  # changes in one element: work array, (BARRIER_CHANGES, W)
    corner: np.ndarray  # values in one element: work array, (BARRIER_VALUES,)
    tied: np.ndarray  # displacements of the tied nodes: work array, (k, 3, W)
    shift: np.ndarray  # and of their bones: work array, (bones, 3, W)
    elements: int  # m
    constants: np.ndarray  # of the constants of the law, (m or 1, number, G, W); (0, ...)
    modulus: np.ndarray  # of the logarithm of the barrier's modulus, (m or 1, G, W); (0, ...)
    sigma: np.ndarray  # of the muscles' stress at activation 1 [Pa], (m, K, G, W); (0, ...)
    dead: np.ndarray  # of the dead loads, (entries, 3, G, W); (0, ...)
    tension: np.ndarray  # of the tensions of follower fibres, (vertices, G, W); (0, ...)
    log_inverse_mass: np.ndarray  # of the logarithm of the inverse masses, (N, G, W); (0, ...)
    alpha: np.ndarray  # of the mass-proportional damping, (G, W); (0, ...)


class SharedWithTangents(NamedTuple):
    """``Shared`` of a run that is differentiated."""

    blocks: Blocks
    nodes: Nodes
    external: np.ndarray
    alpha: float
    unrecorded: BoneRecord
    addresses: Addresses
    tangents: Tangents


def tangents_of(
    blocks: Blocks, rows: int, elements: int, groups: int, memory: int, ties: tuple[int, int], inputs: dict[str, np.ndarray]
) -> Tangents:
    """Tangents of a body at rest.

    Parameters
    ----------
    blocks : those of the body.
    rows, elements, groups : N, m, G.
    memory : numbers that each element remembers.
    ties : tied nodes, and bones that tie them.
    inputs : the derivatives of inputs, by the names of the fields.
    """
    state = {name: zeros((groups, rows, COMPONENTS, WIDTH)) for name in ("u", "v", "force")}
    return Tangents(
        **state,
        rows=blocks.nodes.astype(np.int64) // ROW * (COMPONENTS * WIDTH),
        before=zeros((rows, ROW)),
        memory=zeros((elements, groups, memory, WIDTH)),
        work=zeros((MUSCLES_AT + OF_MUSCLE * blocks.muscle.shape[1], WIDTH)),
        barrier=zeros((BARRIER_CHANGES, WIDTH)),
        corner=np.zeros(BARRIER_VALUES),
        tied=zeros((ties[0], COMPONENTS, WIDTH)),
        shift=zeros((ties[1], COMPONENTS, WIDTH)),
        elements=elements,
        **inputs,
    )


@leaf
def put(work, at, values):
    """Put a tuple of vectors into the work array of a block from a place on."""
    for k in range(len(values)):
        store(work, (at + k) * WIDTH, values[k])
