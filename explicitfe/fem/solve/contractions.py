"""The active stresses of a model as the arrays that kernels read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.model.model import FibreStress
from explicitfe.platform.compiled.arrays import no_muscles, zeros
from explicitfe.platform.compiled.simd import WIDTH


def contractions(stresses: Sequence[FibreStress], element_order: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays of ``Blocks`` for the muscles that pull in each block of elements, at activation 0.

    Parameters
    ----------
    stresses : with elements in the user's numbering.
    element_order : (m,) the user's number of each element in computing order.
    """
    blocks = -(-len(element_order) // WIDTH)
    if not stresses:
        return no_muscles(blocks)
    place = np.empty(len(element_order), dtype=np.int64)
    place[element_order] = np.arange(len(element_order))
    muscle = np.concatenate([np.full(len(stress.elements), k) for k, stress in enumerate(stresses)])
    element = place[np.concatenate([stress.elements for stress in stresses])]
    pairs, entry = np.unique(np.stack([element // WIDTH, muscle], axis=1), axis=0, return_inverse=True)
    block = pairs[:, 0]
    rank = np.arange(len(pairs)) - np.searchsorted(block, block)  # of each muscle among those of its block
    most = int(rank.max()) + 1

    rows = zeros((blocks, most, WIDTH), np.int64)
    rows[:] = -1
    rows[block, rank] = pairs[:, 1, None]
    numbers = zeros((blocks, most, 4, WIDTH))
    numbers[:, :, 1] = 1.0  # a fibre without stress has some direction
    values = np.column_stack([
        np.concatenate([stress.stress_Pa for stress in stresses]),
        np.concatenate([stress.direction for stress in stresses]),
    ])  # fmt: skip
    entry = entry.ravel()
    numbers[block[entry], rank[entry], :, element % WIDTH] = values
    activation = zeros((len(stresses), 2))
    activation[:, 1] = [stress.force_length for stress in stresses]
    return {
        "muscle": rows,
        "contraction": numbers.reshape(blocks, 4 * most, WIDTH),
        "activation": activation,
        "length": zeros((len(stresses), WIDTH)),
        "last_length": zeros((len(stresses),)),
    }
