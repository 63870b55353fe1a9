"""Distribution of the blocks of elements over threads."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from explicitfe.platform.compiled.arrays import SMALLEST_J, SWEEP_ROWS, Blocks, Part, State, zeros
from explicitfe.platform.compiled.simd import ROW
from explicitfe.platform.compiled.threads import cores, gate

# Measured: waking a thread costs some steps of a small mesh, and every sample and every look at the stable step does that.
ELEMENTS_PER_THREAD = 2000


def usual_threads(elements: int, each: int = ELEMENTS_PER_THREAD) -> int:
    """How many threads pay for so many elements, if it takes ``each`` of them to keep one busy."""
    return max(1, min(cores(), elements // each))


def parts_of(state: State, blocks: Blocks, count: int, loaded_rows: np.ndarray | None = None) -> list[Part]:
    """The blocks in ``count`` runs of equal length, or in fewer where a run would share nodes with more than the next one.

    ``loaded_rows`` are those on which external forces may act.
    """
    loaded = np.zeros(len(state.u), dtype=np.uint8)
    loaded[[] if loaded_rows is None else loaded_rows] = 1
    total = len(blocks.nodes)
    meeting = gate()
    if count < 2:
        whole = (state.u, state.force, state.force[:0], blocks, _runs(loaded))
        return [Part(0, 1, meeting, 0, len(state.u), *whole)]
    bounds = np.linspace(0, total, min(count, total) + 1).astype(int)
    runs = [blocks.nodes[a:b] // np.uint32(ROW) for a, b in pairwise(bounds)]
    first = [0, *(int(run.min()) // 2 * 2 for run in runs[1:])]
    begins = [*first, len(state.u)]
    # idle lanes are in the last run; a row that no element touches is of the part before it
    after = [max(int(run.max()) // 2 * 2 + 2, begin) for run, begin in zip(runs[:-1], first[1:], strict=True)] + [len(state.u)]
    owned = np.diff(begins)
    if any(owned <= 0) or any(end > begin for end, begin in zip(after, begins[2:], strict=False)):
        return parts_of(state, blocks, count - 1, loaded_rows)
    forces = [zeros((b - a, ROW)) for a, b in zip(first, after, strict=True)]
    parts = []
    for k, (a, b) in enumerate(pairwise(bounds)):
        lower = forces[k - 1][first[k] - first[k - 1] :] if k else state.force[:0]
        touched = slice(first[k], after[k])
        places = np.uint32(ROW) * (runs[k] - np.uint32(first[k]))
        own_blocks = blocks.between(a, b)._replace(nodes=places, position=blocks.position[touched])
        runs_loaded = _runs(loaded[begins[k] : begins[k + 1]])
        parts.append(
            Part(k, len(runs), meeting, first[k], int(owned[k]), state.u[touched], forces[k], lower, own_blocks, runs_loaded)
        )
    return parts


def _runs(rows: np.ndarray) -> np.ndarray:
    """Of a flag a row, whether one is set in each run of SWEEP_ROWS."""
    return np.maximum.reduceat(rows, np.arange(0, len(rows), SWEEP_ROWS))


def for_threads(state: dict[str, np.ndarray], threads: int) -> dict[str, np.ndarray]:
    """Convert the sums of a restart state, stored per thread, to another number of threads: the first thread gets them all."""
    if len(state["ledgers"]) == threads:
        return state
    sums = {name: np.zeros((threads, *state[name].shape[1:])) for name in ("ledgers", "lengths")}
    for name, values in sums.items():
        values[0] = state[name].sum(axis=0)
    sums["ledgers"][:, SMALLEST_J:] = state["ledgers"][:, SMALLEST_J:].min(axis=0)
    return state | sums
