"""The muscle fibres of a result: where they run through the mesh, for pictures. A file without them has none."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.results.files.layout import FIBRES
from explicitfe.results.files.stored import StoredFile

FibreLines = Sequence[MaterialPoints]
"""The lines that the fibres of one muscle run along."""


def fibre_arrays(muscles: Sequence[FibreLines]) -> dict[str, np.ndarray]:
    """What is stored of the fibres of muscles: name in the file -> array.

    Of each muscle that has fibres: the points of all its lines one after the other, and where each line begins.
    """
    arrays: dict[str, np.ndarray] = {}
    for number, lines in enumerate(muscles):
        if lines:
            arrays[f"{FIBRES}/{number}/element"] = np.concatenate([line.element for line in lines]).astype(np.int64)
            arrays[f"{FIBRES}/{number}/natural"] = np.concatenate([line.natural for line in lines]).astype("<f8")
            arrays[f"{FIBRES}/{number}/position"] = np.concatenate([line.position for line in lines]).astype("<f8")
            arrays[f"{FIBRES}/{number}/begin"] = np.cumsum([0, *(len(line) for line in lines)])[:-1].astype(np.int64)
    return arrays


def read_fibres(stored: StoredFile, mesh: HexMesh, muscles: int) -> list[list[MaterialPoints]]:
    """The lines of each of so many muscles; an empty list for one of which none are stored.

    Raises
    ------
    InputError : the file is damaged.
    """
    return [_lines(stored, f"{FIBRES}/{number}", mesh) for number in range(muscles)]


def _lines(stored: StoredFile, path: str, mesh: HexMesh) -> list[MaterialPoints]:
    if not stored.has(path):
        return []
    element, begin = (stored.numbers(f"{path}/{name}", "i", axes=(1,)) for name in ("element", "begin"))
    natural, position = (stored.numbers(f"{path}/{name}", axes=(2,)) for name in ("natural", "position"))
    count = len(element)
    bounds = [*begin.tolist(), count]
    whole = (
        natural.shape == position.shape == (count, 3)
        and bounds[0] == 0
        and all(start < stop for start, stop in pairwise(bounds))
        and bool(((element >= -1) & (element < mesh.element_count)).all())
        and bool((np.abs(natural) <= 1.0 + 1e-9).all() and np.isfinite(position).all())
    )
    if not whole:
        raise stored.damaged(f"{path} are no fibres")
    return [MaterialPoints(element[a:b], natural[a:b], position[a:b]) for a, b in pairwise(bounds)]
