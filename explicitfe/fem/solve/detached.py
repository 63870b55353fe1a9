"""The elements of a body with nodes of their own, for the forces and the stress of each element."""

from __future__ import annotations

import numpy as np

from explicitfe.platform.compiled.arrays import NO_CORNER, Blocks, Detached, node_rows, position_rows, row_places, zeros


def detach(blocks: Blocks, effects: np.ndarray, corner: np.ndarray, points: np.ndarray, volumes: np.ndarray) -> Detached:
    """Detached elements, which have the material's memory in common with ``blocks`` and change nothing of these.

    Parameters
    ----------
    blocks : of the body.
    effects : numbers of the material's effects for a state in which no time passes.
    corner, points, volumes : of all elements in computing order, (m, 8) rows, (n, 3) m and (m,) m^3; ``corner`` may be empty.
    """
    count = len(corner)
    own = np.arange(8 * count).reshape(count, 8)
    places = points[corner]
    if not count:
        blocks = blocks.each(lambda array: array[:0])
        nodes, position, effects = blocks.nodes, blocks.position, effects[:0]
    else:
        nodes, position = row_places(own, 8 * count), position_rows(places.reshape(-1, 3), places[-1])
    return Detached(
        blocks=blocks._replace(
            nodes=nodes,
            position=position,
            effects=effects,
            new=zeros(blocks.new.shape),
            length=np.zeros_like(blocks.length),
            last_length=np.zeros_like(blocks.last_length),
            suspect=np.zeros_like(blocks.suspect),
            work=zeros(blocks.work.shape),
            corner=np.array(NO_CORNER),
        ),
        corner=corner,
        u=node_rows(np.zeros((8 * count, 3))),
        force=node_rows(np.zeros((8 * count, 3))),
        volume=volumes[:count],
    )
