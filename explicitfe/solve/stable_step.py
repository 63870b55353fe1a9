"""The stable step of central differences: dt < 2 / omega_max, with omega_max of the current state.

Two answers. ``fastest_element`` gives a bound: no mesh vibrates faster than its fastest element by itself (Irons &
Treharne 1971). ``HighestFrequency`` finds the true one of the whole mesh, from below, so the step that is
used stays a stated fraction under it (``STEP_SHARE_OF_LIMIT``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from explicitfe.compiled.arrays import Blocks, node_rows, position_rows, row_places, zeros
from explicitfe.compiled.jit import kernel
from explicitfe.compiled.simd import ROW, WIDTH, load, min_lanes, minimum, splat, store, sum_lanes

STEP_SHARE_OF_LIMIT = 0.9  # of the limit that the iteration gives
BLOCKS_TAKEN_APART = 512  # blocks of elements that are taken apart at once, in the cache: 24 x 24 numbers an element
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
    for part, some, u in _taken_apart(blocks, displacement):
        count = part.stop - part.start
        moved, here = np.empty_like(u), np.empty_like(u)
        minus_force(u, here, some)
        collect = (own[part][:, :, None] == np.arange(8)).astype(float)  # (count, corner, corner that it counts for)
        step = 1e-6 * length_m[part]
        for corner in range(8):
            moves = collect[:, :, corner] * step[:, None]
            if not moves.any():
                continue
            for k in range(3):
                shifted = displacement[part] + moves[..., None] * rotation[part][..., k]
                u[: 8 * count, :3] = shifted.reshape(-1, 3)
                minus_force(u, moved, some)
                change = (here - moved)[: 8 * count, :3].reshape(count, 8, 1, 3)
                back = (change @ rotation[part])[:, :, 0]  # turned back: R^T f
                rows[part] += np.abs(collect.transpose(0, 2, 1) @ back) * (free[part, corner, k] / step)[:, None, None]
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


class HighestFrequency:
    """Estimates the highest angular frequency of the whole mesh, keeping its vector from call to call.

    Lanczos iteration on A = M^-1/2 K M^-1/2 (Parlett 1998, chapter 13), a power iteration that uses all its vectors: the
    tangent K is applied by differencing the internal force, so no matrix is ever formed. A start from the last vector alone
    would stay blind to an element that has stiffened elsewhere: noise is mixed in, and finds it.

    Parameters
    ----------
    minus_force : function that fills its second argument with minus the internal force at its first, both node rows.
    inverse_mass : (N, 4) 1/kg, 0 where held.
    length_m : typical element size; the force is differenced over a millionth of it.
    """

    NOISE_SHARE = 0.3  # of the length of the start vector

    def __init__(
        self, minus_force: Callable[[np.ndarray, np.ndarray], object], inverse_mass: np.ndarray, length_m: float
    ) -> None:
        self._minus_force = minus_force
        self._root = zeros(inverse_mass.shape)
        self._root[:] = np.sqrt(inverse_mass)
        self._step = 1e-6 * length_m
        self._shifted, self._response = zeros(inverse_mass.shape), zeros(inverse_mass.shape)
        # Fixed seeds: a run repeated is the same run.
        self._noise = self._unit(np.random.default_rng(20051).standard_normal(inverse_mass.shape))
        self.vector = self._unit(np.random.default_rng(20052).standard_normal(inverse_mass.shape))

    def __call__(self, u: np.ndarray, force: np.ndarray, turns: int) -> float:
        """Highest angular frequency [1/s] at displacement u, whose minus internal force is ``force`` (both node rows).

        The estimate comes from below and grows with the number of turns, one force evaluation each. NaN where the force is
        not finite.
        """
        basis = zeros((turns + 1, *u.shape))
        basis[0] = self._unit(self.vector + self.NOISE_SHARE * self._noise)
        diagonal, beside = np.zeros(turns), np.zeros(turns)
        done = 0
        for turn in range(turns):
            step = _shift(u, self._root, basis, turn, self._step, self._shifted)
            self._minus_force(self._shifted, self._response)
            _orthogonalise(self._root, force, self._response, 1.0 / step, basis, turn, diagonal, beside)
            if not np.isfinite(beside[turn]):
                return float("nan")
            done += 1
            if beside[turn] <= 1e-12 * abs(diagonal[0]):  # the basis spans an invariant space
                break
        couplings = beside[: done - 1]
        values, vectors = np.linalg.eigh(np.diag(diagonal[:done]) + np.diag(couplings, 1) + np.diag(couplings, -1))
        weights = vectors[:, -1] * (1.0 if vectors[0, -1] > 0.0 else -1.0)  # either sign is as good; the noise tells them apart
        self.vector = self._unit(np.einsum("k,kij->ij", weights, basis[:done]))
        return float(np.sqrt(values[-1]))

    def _unit(self, vector: np.ndarray) -> np.ndarray:
        free = vector * (self._root > 0.0)
        # einsum, not BLAS, which would wake all cores for it, and wait for those that are busy
        return free / max(np.sqrt(np.einsum("ij,ij->", free, free)), 1e-300)


def shift(u, root, basis, turn, length, shifted):
    """u moved along M^-1/2 times a vector of the basis, by ``length`` at most, into ``shifted``; give the factor."""
    first = turn * u.size
    largest = splat(0.0)
    for at in range(0, u.size, WIDTH):
        along = load(root, at) * load(basis, first + at)
        store(shifted, at, along)
        largest = minimum(largest, minimum(along, -along))
    step = length / -min_lanes(largest)
    for at in range(0, u.size, WIDTH):
        store(shifted, at, load(u, at) + step * load(shifted, at))
    return step


def orthogonalise(root, force, response, scale, basis, turn, diagonal, beside):
    """One turn of Lanczos: A times the last vector, from the change of the force, less the last two is the next vector."""
    here = turn * force.size
    last, coupling = (here - force.size, beside[turn - 1]) if turn > 0 else (here, 0.0)
    along = splat(0.0)
    for at in range(0, force.size, WIDTH):
        change = scale * (load(root, at) * (load(force, at) - load(response, at)))
        store(response, at, change)
        along = along + change * load(basis, here + at)
    diagonal[turn] = sum_lanes(along)
    square = splat(0.0)
    for at in range(0, force.size, WIDTH):
        remainder = load(response, at) - diagonal[turn] * load(basis, here + at) - coupling * load(basis, last + at)
        store(response, at, remainder)
        square = square + remainder * remainder
    beside[turn] = math.sqrt(sum_lanes(square))
    if beside[turn] > 0.0:
        for at in range(0, force.size, WIDTH):
            store(basis, here + force.size + at, (1.0 / beside[turn]) * load(response, at))


_shift, _orthogonalise = kernel(shift), kernel(orthogonalise)
