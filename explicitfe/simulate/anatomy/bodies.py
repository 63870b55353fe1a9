"""Several bodies of a scenario as one anatomy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.joined import join
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle
from explicitfe.fem.model.model import Inclusion
from explicitfe.platform.errors import InputError, nearest
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.scenario.bodies import BodyTable, MeshTable


@dataclass(frozen=True)
class Bodies:
    """The bodies of a scenario.

    Attributes
    ----------
    anatomy : of all of them; that of ``[model]`` has its own names, the others have theirs in front.
    inclusions : the elements of bodies with another material than that of ``[model]``.
    held : (k,) nodes of further bodies that are held.
    """

    anatomy: Anatomy
    inclusions: tuple[Inclusion, ...]
    held: np.ndarray


def with_bodies(
    main: Anatomy, material: Law, tables: Sequence[BodyTable], folder: Path, anatomy_of: Callable[[MeshTable, Path], Anatomy]
) -> Bodies:
    """The anatomy of ``[model]`` with further bodies.

    Raises
    ------
    InputError : a mesh that cannot be read, an unknown node set, a body that nothing holds, or a material of another law.
    """
    if not tables:
        return Bodies(main, (), np.zeros(0, dtype=np.int64))
    meshes, muscles, held, inclusions = {"": main.mesh}, dict(main.muscles), [], []
    nodes, elements = main.mesh.node_count, main.mesh.element_count
    for table in tables:
        where = f'body "{table.name}"'
        one = anatomy_of(table, folder)
        fixed = one.fixed if table.fixed is None else table.fixed
        for name in fixed:
            if name not in one.mesh.node_sets:
                raise InputError(f'{where}: fixed: unknown node set "{name}"; {nearest(name, one.mesh.node_sets)}')
            held.append(nodes + one.mesh.node_sets[name])
        if not fixed:
            raise InputError(f"{where} is held by nothing; name node sets of it in fixed.")
        shift = 1e-3 * np.array(table.shift_mm)
        meshes[table.name] = _shift_mesh(one.mesh, shift)
        for name, muscle in one.muscles.items():
            muscles[f"{table.name}.{name}"] = _shift_muscle(muscle, f"{table.name}.{name}", elements, shift)
        if table.material is not None:
            law = catalogue.material(table.material)
            if type(law) is not type(material):
                raise InputError(f"{where}: its material is of another law than that of [model]; use one law for all bodies.")
            inclusions.append(Inclusion(elements + np.arange(one.mesh.element_count), law))
        nodes, elements = nodes + one.mesh.node_count, elements + one.mesh.element_count
    anatomy = Anatomy(main.name, join(meshes), muscles, main.fixed)
    return Bodies(anatomy, tuple(inclusions), np.unique(np.concatenate(held)))


def _shift_mesh(mesh: HexMesh, shift_m: np.ndarray) -> HexMesh:
    points = {name: replace(point, position=point.position + shift_m) for name, point in mesh.named_points.items()}
    return replace(mesh, points=mesh.points + shift_m, named_points=points)


def _shift_muscle(muscle: Muscle, name: str, elements: int, shift_m: np.ndarray) -> Muscle:
    """A muscle whose elements count from ``elements`` on."""

    def shift(fibre: Fibre) -> Fibre:
        points = fibre.points
        element = np.where(points.element < 0, -1, points.element + elements)
        segment = np.where(fibre.segment_element < 0, -1, fibre.segment_element + elements)
        return replace(fibre, points=MaterialPoints(element, points.natural, points.position + shift_m), segment_element=segment)

    return replace(muscle, name=name, fibres=tuple(map(shift, muscle.fibres)), elements=muscle.elements + elements)
