"""A mesh with its muscles and attachments, from a built-in model or a model file."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.muscle_lines import Muscle


@dataclass(frozen=True)
class Anatomy:
    """A body at rest: a scenario says what happens to it.

    Attributes
    ----------
    name : of the model.
    mesh : reference mesh with node sets and named points.
    muscles : name -> muscle.
    fixed : names of the node sets that are held unless the scenario says otherwise.
    element_sets : name -> elements, of a mesh file.
    notes : sentences on how the mesh file was read.
    """

    name: str
    mesh: HexMesh
    muscles: dict[str, Muscle]
    fixed: tuple[str, ...]
    element_sets: dict[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
