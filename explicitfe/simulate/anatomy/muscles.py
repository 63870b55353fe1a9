"""Loads on the mesh from a muscle and its force.

The force is shared equally over the fibres of the sides named. Along a fibre the tension T of its segments is

``ends``    one segment, the chord: equal and opposite forces on the two ends (Gérard et al. 2005);
``along``   the same in every segment: the ends are pulled and the bends in between pushed inwards;
``volume``  that of a uniform active stress in the muscle's elements: in proportion to the volume that a unit of fibre
            length stands for, scaled so that the sum of T x length, which is the work of a uniform contraction, is that of
            ``along``. Segments in thin parts, such as the tip, pull less, as in ArtiSynth (Stavness et al. 2011).

The resultant of every fibre is zero in each of them, and so is its moment, with the reaction of the bone where an end is
fixed in space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints, shape_functions
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.model.model import FibrePull, NodalLoad
from explicitfe.platform.errors import InputError
from explicitfe.simulate.scenario.profile import profile_of
from explicitfe.simulate.scenario.transient import MuscleTable


def line_pull(mesh: HexMesh, muscle: Muscle, table: MuscleTable) -> FibrePull:
    """The lines of one ``[[muscle]]`` table, one for each fibre that pulls, in the order of ``muscle.chosen``.

    Raises
    ------
    InputError : the muscle has no fibre on the side or of the number asked for, or a closed one that is to pull at its ends.
    """
    fibres = muscle.chosen(table.side, table.fibres)
    points = tuple(_ends(fibre.points) if table.distribution == "ends" else fibre.points for fibre in fibres)
    for number, fibre in enumerate(muscle.fibres, start=1):
        first, last = fibre.points.position[[0, -1]]
        if table.distribution == "ends" and any(fibre is pulling for pulling in fibres) and np.array_equal(first, last):
            raise InputError(
                f'fibre {number} of muscle {muscle.name} ends at its first point; use distribution = "along" or "volume".'
            )
    share = table.force_N / len(fibres)
    if table.distribution == "volume":
        tension = _volume_tensions(mesh, fibres, share)
    else:
        tension = tuple(np.full(len(chain) - 1, share) for chain in points)
    return FibrePull(muscle.name, points, tension, profile_of(table))


STIFFEST_FACTOR = 10.0  # of the moduli of a muscle that pulls as hard as it can


def activation_stiffness(mesh: HexMesh, muscles: Mapping[str, Muscle], tables: Sequence[MuscleTable]) -> np.ndarray:
    """Factor of the moduli in each element, (m,): 1 + 9 min(1, sum of F / F_max) over the muscles that run through it.

    After Buchaillard, Perrier & Payan (2009), who let the tissue of active muscles stiffen. Here the factor is that of the full
    force and stays for the whole run: a movement begins in tissue as stiff as at its end.

    Raises
    ------
    InputError : a muscle whose largest force is not known.
    """
    share = np.zeros(mesh.element_count)
    for table in tables:
        muscle = muscles[table.name]
        if not muscle.max_force_N > 0.0:
            raise InputError(
                f"model.activation_stiffening: the largest force of muscle {muscle.name} is unknown; add its max_force_N in "
                "the model file."
            )
        share[muscle.elements] += table.force_N / muscle.max_force_N
    return 1.0 + (STIFFEST_FACTOR - 1.0) * np.minimum(1.0, share)


def _ends(points: MaterialPoints) -> MaterialPoints:
    at = [0, -1]
    return MaterialPoints(points.element[at], points.natural[at], points.position[at])


def _volume_tensions(mesh: HexMesh, fibres: list[Fibre], share: float) -> tuple[np.ndarray, ...]:
    lengths = [np.linalg.norm(np.diff(fibre.points.position, axis=0), axis=1) for fibre in fibres]
    element = np.concatenate([fibre.segment_element for fibre in fibres])
    length = np.concatenate(lengths)
    inside = element >= 0
    in_element = np.bincount(element[inside], weights=length[inside], minlength=mesh.element_count)
    volume = volumes(mesh.points, mesh.hexes)
    # A segment in space, between bone and tissue, carries the fibre's share.
    tension = np.full(len(element), share)
    tension[inside] = volume[element[inside]] / in_element[element[inside]]
    tension[inside] *= share * length[inside].sum() / (tension[inside] @ length[inside])
    return tuple(np.split(tension, np.cumsum([len(part) for part in lengths])[:-1]))


def directed(mesh: HexMesh, pull: FibrePull, direction: Literal["reference", "following"]) -> NodalLoad | FibrePull:
    """Lines as what acts on a body: "following" the deformation, or with the directions that they have in the undeformed body."""
    if direction == "following":
        return pull
    total = np.zeros((mesh.node_count, 3))
    for chain, t in zip(pull.points, pull.tension_N, strict=True):
        along = np.diff(chain.position, axis=0)
        along *= (t / np.linalg.norm(along, axis=1))[:, None]
        force = np.zeros_like(chain.position)
        force[:-1] += along
        force[1:] -= along
        inside = chain.element >= 0
        weights = shape_functions(chain.natural[inside])
        nodes = mesh.hexes[chain.element[inside]]
        np.add.at(total, nodes, weights[:, :, None] * force[inside][:, None, :])
    nodes = np.flatnonzero(np.any(total != 0.0, axis=1))
    return NodalLoad(pull.name, nodes, total[nodes], pull.profile, of_muscle=True)
