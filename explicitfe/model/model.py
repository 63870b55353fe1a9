"""The frozen model that a run computes: mesh, material, what is held, what pulls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from explicitfe.materials import Law
from explicitfe.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.model.profile import Profile


@dataclass(frozen=True)
class NodalLoad:
    """Forces of fixed direction on nodes.

    Attributes
    ----------
    name : what a user calls it.
    nodes : (k,) node numbers.
    force_N : (k, 3) N at profile value 1.
    profile : its course in time.
    """

    name: str
    nodes: np.ndarray
    force_N: np.ndarray
    profile: Profile


@dataclass(frozen=True)
class FibrePull:
    """Tense fibres whose direction follows the deformation.

    Attributes
    ----------
    name : the muscle.
    points : one MaterialPoints per fibre, the vertices of its polyline.
    tension_N : one (k - 1,) array per fibre, the tension of each segment at profile value 1.
    profile : its course in time.
    """

    name: str
    points: tuple[MaterialPoints, ...]
    tension_N: tuple[np.ndarray, ...]
    profile: Profile


@dataclass(frozen=True)
class PrescribedMotion:
    """Nodes that follow a given course in all three components.

    Attributes
    ----------
    nodes : (k,) node numbers.
    displacement : function of times (t,) s that gives displacements (t, k, 3) m; zero at time 0.
    """

    nodes: np.ndarray
    displacement: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Model:
    """Physics of one run.

    Attributes
    ----------
    mesh : reference mesh [m].
    material : constants of the material law.
    held : (n, 3) bool. Components of nodes that do not move.
    alpha_per_s : mass-proportional damping.
    element : "hex8", "hex8-stiffness" or "hex8-full".
    loads, pulls : what acts on it.
    motion : nodes that are moved.
    probes : name -> node number, recorded at every sample.
    """

    mesh: HexMesh
    material: Law
    held: np.ndarray
    alpha_per_s: float = 0.0
    loads: tuple[NodalLoad, ...] = ()
    pulls: tuple[FibrePull, ...] = ()
    probes: dict[str, int] = field(default_factory=dict)
    element: str = "hex8"
    motion: PrescribedMotion | None = None
