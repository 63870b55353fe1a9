"""The stable step of central differences: dt < 2 / omega_max, with omega_max of the current state.

``fastest_element`` gives a bound: no mesh vibrates faster than its fastest element by itself (Irons & Treharne 1971). What finds
the true one of the whole mesh, from below, is in ``look.py``; the step that is used stays a stated fraction under it
(``STEP_SHARE_OF_LIMIT``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from explicitfe.platform.compiled.arrays import Blocks, node_rows, position_rows, row_places
from explicitfe.platform.compiled.simd import ROW, WIDTH

STEP_SHARE_OF_LIMIT = 0.9  # of the limit that the iteration gives
BLOCKS_TAKEN_APART = 128  # blocks of elements that are taken apart at once, in the cache: 24 x 24 numbers an element
TURNS_OF_AN_ELEMENT = 4  # of the iteration that finds its own frequency
ELEMENTS_PER_BATCH = 256  # elements whose eigenvalues are solved for at once


def fastest_element(
    minus_force: Callable[[np.ndarray, np.ndarray, Blocks], object],
    blocks: Blocks,
    displacement: np.ndarray,
    node_mass: np.ndarray,
    length_m: np.ndarray,
) -> tuple[float, int]:
    """Highest angular frequency [1/s] of any element by itself, free at all its nodes, at displacement u; and that element.

    The internal force is differenced on the elements taken apart, all at once, so this holds for any law, element and state.
    Where the force on an element is not finite, that element and NaN.

    Parameters
    ----------
    minus_force : fills its second argument with minus the internal force at its first, both node rows, for its third, blocks.
    blocks : all elements.
    displacement : (m, 8, 3) m, at the corners of each element.
    node_mass : (m,) kg. What each element gives to each of its nodes.
    length_m : (m,) m. Typical size; the force is differenced over a millionth of it.
    """
    largest, fastest = -np.inf, 0
    for part, some, u in _taken_apart(blocks, displacement):
        count = part.stop - part.start
        ahead, behind = np.empty_like(u), np.empty_like(u)
        step = 1e-6 * length_m[part]
        stiffness = np.empty((count, 24, 24))
        for corner in range(8):
            for k in range(3):
                own = slice(corner, 8 * count, 8)
                u[own, k] = displacement[part, corner, k] + step
                minus_force(u, ahead, some)
                u[own, k] = displacement[part, corner, k] - step
                minus_force(u, behind, some)
                u[own, k] = displacement[part, corner, k]
                change = (behind - ahead)[: 8 * count, :3].reshape(count, 24)
                stiffness[:, :, 3 * corner + k] = change / (2.0 * step)[:, None]
        symmetric = 0.5 * (stiffness + stiffness.transpose(0, 2, 1))
        # No eigenvalue is above the Frobenius norm: most elements need not be solved to know that they are not the fastest.
        size = np.linalg.norm(symmetric, axis=(1, 2)) / node_mass[part]
        if not np.isfinite(size).all():
            return float("nan"), part.start + int(np.argmin(np.isfinite(size)))
        order = np.argsort(-size)
        for batch in np.split(order, range(ELEMENTS_PER_BATCH, count, ELEMENTS_PER_BATCH)):
            if size[batch[0]] <= largest:
                break
            squares = np.linalg.eigvalsh(symmetric[batch])[:, -1] / node_mass[part][batch]
            if squares.max() > largest:
                largest, fastest = float(squares.max()), part.start + int(batch[np.argmax(squares)])
    return float(np.sqrt(largest)), fastest


def stiffness_rows(
    minus_force: Callable[[np.ndarray, np.ndarray, Blocks], object],
    blocks: Blocks,
    displacement: np.ndarray,
    length_m: np.ndarray,
    free: np.ndarray,
    own: np.ndarray,
    rotation: np.ndarray,
) -> np.ndarray:
    """Sums of the absolute entries of each row of the element stiffnesses [N/m], (m, 8, 3), over the components that are free.

    With a quarter of them as masses no element, so no mesh, vibrates faster than 2 (Gershgorin 1931; Irons & Treharne 1971).

    Parameters
    ----------
    minus_force, blocks, displacement, length_m : as in :func:`fastest_element`.
    free : (m, 8, 3) components that can move.
    own : (m, 8) for each corner the corner that it moves with: itself, or, by rotational symmetry, its partner. The forces on it
        count for that corner.
    rotation : (m, 8, 3, 3) that leads from the partner's displacement to its own.
    """
    rows = np.zeros(free.shape)
    corners = np.arange(8)
    turns = bool((own != corners).any())
    for part, some, u in _taken_apart(blocks, displacement):
        count = part.stop - part.start
        moved, here = np.empty_like(u), np.empty_like(u)
        minus_force(u, here, some)
        collect = (own[part][:, :, None] == corners).astype(float)  # (count, corner, corner that it counts for)
        step = 1e-6 * length_m[part]
        at_rest = u[: 8 * count, :3].reshape(count, 8, 3).copy()
        now = u[: 8 * count, :3].reshape(count, 8, 3)
        for corner, k in np.ndindex(8, 3):
            if not collect[:, :, corner].any():
                continue  # it moves with another one
            if turns:
                moves = collect[:, :, corner] * step[:, None]
                now[:] = at_rest + moves[..., None] * rotation[part][..., k]
            else:
                now[:, corner, k] += step
            minus_force(u, moved, some)
            now[:] = at_rest
            change = (here - moved)[: 8 * count, :3].reshape(count, 8, 3)
            if turns:  # turned back, R^T f, and added to the corner that it counts for
                back = (change[:, :, None] @ rotation[part])[:, :, 0]
                change = collect.transpose(0, 2, 1) @ back
            rows[part] += np.abs(change) * (free[part, corner, k] / step)[:, None, None]
    return rows * free


def _taken_apart(blocks: Blocks, displacement: np.ndarray) -> Iterator[tuple[slice, Blocks, np.ndarray]]:
    """Elements with 8 nodes of their own each, part after part: which they are, their blocks, and their displacement rows."""
    for first in range(0, len(blocks.nodes), BLOCKS_TAKEN_APART):
        part = slice(first * WIDTH, min((first + BLOCKS_TAKEN_APART) * WIDTH, len(displacement)))
        count = part.stop - part.start
        own = np.arange(8 * count).reshape(count, 8)
        some = blocks.between(first, first + BLOCKS_TAKEN_APART)
        corners = blocks.position[some.nodes.transpose(0, 2, 1).reshape(-1, 8)[:count] // ROW, :3]
        position = position_rows(corners.reshape(-1, 3), corners[-1])
        some = some._replace(nodes=row_places(own, 8 * count), position=position)
        yield part, some, node_rows(displacement[part].reshape(-1, 3))


def own_frequencies(
    minus_force: Callable[[np.ndarray, np.ndarray, Blocks], object],
    blocks: Blocks,
    gradients: np.ndarray,
    node_mass: np.ndarray,
    length_m: np.ndarray,
) -> np.ndarray:
    """Highest angular frequency [1/s] of each element by itself at rest, (m,), from below.

    A few turns of the power iteration, beginning with the change of volume, which is the fastest vibration of tissue that hardly
    changes its volume.

    Parameters
    ----------
    minus_force, blocks, node_mass, length_m : as for ``fastest_element``.
    gradients : (m, 8, 3) 1/m. Mean gradients of the elements.
    """
    frequencies = np.empty(len(gradients))
    for part, some, u in _taken_apart(blocks, np.zeros_like(gradients)):
        count = part.stop - part.start
        at_rest, moved = np.empty_like(u), np.empty_like(u)
        minus_force(u, at_rest, some)
        vectors = gradients[part].reshape(count, 24)
        step = 1e-6 * length_m[part, None]
        for _ in range(TURNS_OF_AN_ELEMENT):
            vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
            u[: 8 * count, :3] = (step * vectors).reshape(-1, 3)
            minus_force(u, moved, some)
            vectors = (at_rest - moved)[: 8 * count, :3].reshape(count, 24) / step
        frequencies[part] = np.sqrt(np.linalg.norm(vectors, axis=1) / node_mass[part])
    return frequencies
