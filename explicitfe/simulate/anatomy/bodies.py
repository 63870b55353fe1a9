"""Several bodies of a scenario as one anatomy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.joined import join
from explicitfe.fem.mesh.muscle_lines import Fibre, Muscle, points_of_mesh
from explicitfe.fem.model.model import FibrePull, Inclusion
from explicitfe.platform.errors import InputError, nearest
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.scenario.bodies import BodyTable, MeshTable
from explicitfe.simulate.scenario.transient import ModelTable


@dataclass(frozen=True)
class Bodies:
    """The bodies of a scenario.

    Attributes
    ----------
    anatomy : of all of them; that of ``[model]`` has its own names, the others have theirs in front.
    inclusions : the elements of bodies and element sets with another material than that of ``[model]``.
    held : (k,) nodes of further bodies that are held.
    fixed : the node sets that these are in.
    parts : name of a body, "" of that of ``[model]`` -> its mesh in its place, and the number of its first element.
    """

    anatomy: Anatomy
    inclusions: tuple[Inclusion, ...] = ()
    held: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    fixed: tuple[str, ...] = ()
    parts: Mapping[str, tuple[HexMesh, int]] = field(default_factory=dict)

    def part_of(self, muscle: str) -> tuple[HexMesh, int]:
        """The mesh of the body that a muscle belongs to, and the number of its first element: it acts nowhere else."""
        return next((part for name, part in self.parts.items() if name and muscle.startswith(f"{name}.")), self.parts[""])

    def tie(self, pull: FibrePull, first: int = 0) -> FibrePull:
        """The lines of a muscle, with their ends in space that lie in a further body tied to it.

        So a palatoglossus pulls at a velum that is a body as at one of bone. Lines from one end to points around a fibre's entry
        lie as far apart in that body as there: a force at a point has no limit under refinement. Elements of the muscle's body
        count from ``first`` on.
        """
        ends = np.array([line.position[0] for line in pull.points])
        entries = np.array([line.position[1] for line in pull.points])
        lines = [replace(line, element=np.where(line.element < 0, -1, line.element + first)) for line in pull.points]
        for mesh, first in (part for name, part in self.parts.items() if name):
            in_space = np.array([line.element[0] < 0 for line in lines])
            if not in_space.any():
                break
            _, within = points_of_mesh(mesh, ends)
            for end in np.unique(ends[within & in_space], axis=0):
                of_end = np.flatnonzero((ends == end).all(axis=1) & in_space)
                spread, _ = points_of_mesh(mesh, end + entries[of_end] - entries[of_end].mean(axis=0), np.inf, thorough=True)
                for row, number in enumerate(of_end):
                    line = lines[number]
                    lines[number] = MaterialPoints(
                        np.append(first + spread.element[row], line.element[1:]),
                        np.vstack([spread.natural[row], line.natural[1:]]),
                        np.vstack([spread.position[row], line.position[1:]]),
                    )
        return replace(pull, points=tuple(lines))


def with_bodies(
    model: ModelTable,
    material: Law,
    tables: Sequence[BodyTable],
    supported: Set[str],
    folder: Path,
    anatomy_of: Callable[[MeshTable, Path], Anatomy],
) -> Bodies:
    """The anatomy of ``[model]`` with further bodies; node sets that are ``supported`` by springs are not held.

    Raises
    ------
    InputError : a mesh that cannot be read, an unknown node set, a body that nothing holds, or a material of another law.
    """
    main = anatomy_of(model, folder)
    laws = [(0, main.mesh.element_count, material)]
    if not tables:
        return Bodies(main, _inclusions(main, laws, model, material), parts={"": (main.mesh, 0)})
    parts, muscles = {"": (main.mesh, 0)}, dict(main.muscles)
    element_sets, notes = dict(main.element_sets), [*main.notes]
    held: list[np.ndarray] = []
    names: list[str] = []
    nodes, elements = main.mesh.node_count, main.mesh.element_count
    for table in tables:
        where = f'body "{table.name}"'
        if table.built_in is not None and table.resolution is None and table.cells is None:
            table = table.model_copy(update={"resolution": model.resolution})
        one = anatomy_of(table, folder)
        fixed = one.fixed if table.fixed is None else table.fixed
        for name in fixed:
            if name not in one.mesh.node_sets:
                raise InputError(f'{where}: fixed: unknown node set "{name}"; {nearest(name, one.mesh.node_sets)}')
            if f"{table.name}.{name}" not in supported:
                held.append(nodes + one.mesh.node_sets[name])
                names.append(f"{table.name}.{name}")
        if not fixed and not any(name.startswith(f"{table.name}.") for name in supported):
            raise InputError(f"{where} is held by nothing; name node sets of it in fixed.")
        shift = 1e-3 * np.array(table.shift_mm)
        parts[table.name] = _shift_mesh(one.mesh, shift), elements
        for name, muscle in one.muscles.items():
            muscles[f"{table.name}.{name}"] = _shift_muscle(muscle, f"{table.name}.{name}", elements, shift)
        element_sets |= {f"{table.name}.{name}": elements + of for name, of in one.element_sets.items()}
        notes += one.notes
        law = material if table.material is None else catalogue.material(table.material)
        if type(law) is not type(material):
            raise InputError(f"{where}: its material is of another law than that of [model]; use one law for all bodies.")
        laws.append((elements, elements + one.mesh.element_count, law))
        nodes, elements = nodes + one.mesh.node_count, elements + one.mesh.element_count
    mesh = join({name: mesh for name, (mesh, _) in parts.items()})
    anatomy = Anatomy(main.name, mesh, muscles, main.fixed, element_sets, tuple(notes))
    inclusions = _inclusions(anatomy, laws, model, material)
    return Bodies(anatomy, inclusions, np.unique(np.concatenate([*held, np.zeros(0, dtype=np.int64)])), tuple(names), parts)


def _inclusions(
    anatomy: Anatomy, laws: Sequence[tuple[int, int, Law]], model: ModelTable, material: Law
) -> tuple[Inclusion, ...]:
    """The elements with another material: those of bodies, (first, end, law), and those of ``model.materials``."""
    chosen = np.zeros(anatomy.mesh.element_count, dtype=np.int64)
    every = [law for *_, law in laws]
    for number, (first, end, _) in enumerate(laws):
        chosen[first:end] = number
    for name, choice in model.materials.items():
        if name not in anatomy.element_sets:
            raise InputError(f'model.materials: unknown element set "{name}"; {nearest(name, anatomy.element_sets)}')
        every.append(catalogue.material(choice))
        if type(every[-1]) is not type(material):
            raise InputError(f'model.materials: that of "{name}" is of another law than model.material; use one law for all.')
        chosen[anatomy.element_sets[name]] = len(every) - 1
    parts = ((np.flatnonzero(chosen == number), law) for number, law in enumerate(every) if law is not material)
    return tuple(Inclusion(elements, law) for elements, law in parts if len(elements))


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
