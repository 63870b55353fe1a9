"""Reaction forces, and the displacement over which they are drawn."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from explicitfe.results.files import Recorded
from explicitfe.results.measure.document import Reaction
from explicitfe.results.measure.motion import unsigned_zero


class ForceCurve(NamedTuple):
    """A reaction force over the displacement of what moves.

    Attributes
    ----------
    moved : what moves: a holder of the body or a named point; None where nothing does.
    own : whether it is the one whose force is given, which then is its force on the body, and else that of the body on it.
    displacement_m, force_N : (rows,), (rows,). Along the direction of the largest displacement.
    """

    moved: str | None
    own: bool
    displacement_m: np.ndarray
    force_N: np.ndarray


def reactions(result: Recorded, step: int) -> dict[str, Reaction]:
    """The reaction forces at one stored step, by name."""
    if not result.reaction_names:
        return {}
    row = int(np.argmin(np.abs(result.history("time") - result.times[step])))
    forces = {}
    for name in result.reaction_names:
        force, column = result.reaction(name)[row], f"reaction_{name}_displacement"
        moved = 1e3 * result.history(column)[row] if column in result.history_names else None
        forces[name] = Reaction(
            force_N=list(map(unsigned_zero, force)),
            magnitude_N=float(np.linalg.norm(force)),
            displacement_mm=None if moved is None else list(map(unsigned_zero, moved)),
        )
    return forces


def force_curve(result: Recorded, name: str) -> ForceCurve:
    """The reaction force of a holder or bone over its own displacement or, where it stays, over that of what moves farthest.

    Of all holders; of the named points where no holder moves.
    """
    force = result.reaction(name)

    def paths(kind: str) -> dict[str, np.ndarray]:
        front, back = f"{kind}_", "_displacement"
        columns = [column for column in result.history_names if column.startswith(front) and column.endswith(back)]
        return {column[len(front) : -len(back)]: result.history(column) for column in columns}

    holders = paths("reaction")
    for number, candidates in enumerate(({name: holders[name]} if name in holders else {}, holders, paths("probe"))):
        farthest = max(candidates, key=lambda key: np.linalg.norm(candidates[key], axis=1).max(initial=0.0), default=None)
        if farthest is None:
            continue
        lengths = np.linalg.norm(candidates[farthest], axis=1)
        if lengths.max(initial=0.0) > 0.0:
            direction = candidates[farthest][lengths.argmax()] / lengths.max()
            own = number == 0
            along = force @ direction
            return ForceCurve(farthest, own, candidates[farthest] @ direction, along if own else -along)
    return ForceCurve(None, True, np.zeros(len(force)), np.linalg.norm(force, axis=1))
