"""Bones of a model from the tables of a scenario: contact surfaces and attachments."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from explicitfe.fem.bones.distance import DistanceField, bone_field
from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.bones.read import read_surface
from explicitfe.fem.bones.surface import TriangleSurface, in_mm, shifted
from explicitfe.fem.bones.tables import BoneShape
from explicitfe.fem.inputs.table import Vector
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.surface_points import points_on_set, surface_areas
from explicitfe.fem.mesh.triangles import triangle_distance
from explicitfe.fem.model.model import Attachment, Bone, FibrePull
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import InputError, nearest
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.bones import GLIDE_MM_PER_DEG, SOFT_PARTS, BoneTable, HyoidTable, JawTable
from explicitfe.simulate.scenario.transient import ModelTable, TransientScenario

# Of the ties between tissue and bone [Pa/m], as stiff as contact: under the 10 kPa of a strong muscle's origin they give way by
# half a millimetre. Five times as stiff, points of the tongue move by 0.1 mm less of 4, and its meshes agree less well.
TIE_STIFFNESS_PA_M = 2e7

# A muscle that begins as near to a bone as this begins on it.
_ANCHORED_WITHIN_M = 5e-3


def bones_of(scenario: TransientScenario, mesh: HexMesh, folder: Path) -> tuple[Bone, ...]:
    """The bones of the ``[[bone]]`` tables; paths are relative to ``folder``.

    Raises
    ------
    InputError : no such bone, two of one name, or a surface that cannot be used.
    """
    built_in = {} if scenario.model.name is None else catalogue.bones(scenario.model.name)
    names = [table.name for table in scenario.bone]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f'{names.count(name)} bones have the name "{name}"; give each its own name.')
    motion = jaw_motion(scenario)
    surface_points = mesh.points[surface_areas(mesh) > 0.0] if scenario.bone else mesh.points
    with ThreadPoolExecutor(cores()) as pool:
        surfaces = pool.map(lambda table: _surface(table, built_in, folder, surface_points, bool(scenario.body)), scenario.bone)
        return tuple(
            Bone(
                table.name,
                *surface,
                motion=motion if table.moves_with_jaw else _motion_along(table, folder),
                friction=table.friction,
                damping=table.damping,
                smooth=table.smooth,
            )
            for table, surface in zip(scenario.bone, surfaces, strict=True)
        )


def _motion_along(table: BoneTable, folder: Path) -> RigidMotion | None:
    course = table.course(folder)
    if course is None:
        return None
    time_s, shift_m = course
    return RigidMotion(np.zeros(3), np.zeros(3), shift_m, time_s, np.zeros(len(time_s)))


def _surface(
    table: BoneTable, built_in: dict[str, BoneShape], folder: Path, body_points: np.ndarray, has_bodies: bool
) -> tuple[DistanceField, TriangleSurface]:
    if table.file is None:
        if table.name not in built_in:
            hint = nearest(table.name, built_in) if built_in else "this model has no bones; give the surface with the key file."
            raise InputError(f'unknown bone "{table.name}"; {hint}')
        shape, what = built_in[table.name], f'bone "{table.name}"'
        surface = shape.surface if table.is_whole or shape.hard is None else shape.hard
        if surface is not shape.hard and shape.hard is not None and has_bodies:
            what += f" ({SOFT_PARTS[table.name]} = false makes room for a [[body]])"
    else:
        assert table.length_unit is not None  # the schema has checked that it is given
        path = folder / table.file
        surface, what = read_surface(path, table.length_unit), f'bone "{table.name}" ({path})'
    shift = 1e-3 * np.array(table.shift_mm)
    return bone_field(surface, what, body_points, shift), shifted(surface, shift) if any(table.shift_mm) else surface


def jaw_motion(scenario: TransientScenario) -> RigidMotion | None:
    """How the jaw moves, None where it does not.

    Raises
    ------
    InputError : the axis or the incisors are not known, or no turn lowers these so far.
    """
    table: JawTable | None = scenario.jaw
    if table is None:
        return None
    shape = None if scenario.model.name is None else catalogue.bones(scenario.model.name).get("jaw")
    centre = _jaw_point("axis_mm", table.axis_mm, None if shape is None else shape.hinge_m, "the axis through the condyles")
    if table.opening_mm is None:
        turn_deg = table.opening_deg or 0.0
    else:
        incisor = _jaw_point(
            "incisor_mm", table.incisor_mm, None if shape is None else shape.incisor_m, "the edge of the incisors"
        )
        turn_deg = _turn_deg(centre - incisor, 1e-3 * table.opening_mm)
    forward_mm = GLIDE_MM_PER_DEG * turn_deg if table.forward_mm is None else table.forward_mm
    time_s, course = table.course
    return RigidMotion(
        centre_m=centre,
        # x points backwards and z up: about +y a chin in front of the axis would rise
        turn_rad=np.radians([0.0, -turn_deg, 0.0]),
        shift_m=1e-3 * np.array([-forward_mm, 0.0, -table.down_mm]),
        time_s=time_s,
        course=course,
    )


def _jaw_point(key: str, stated_mm: Vector | None, built_in_m: np.ndarray | None, what: str) -> np.ndarray:
    """A point of the jaw, (3,) m: as the scenario states it, or that of the built-in model."""
    if stated_mm is not None:
        return 1e-3 * np.array(stated_mm)
    if built_in_m is None:
        raise InputError(f"jaw.{key} is missing: a model from a file does not define {what}; add the key.")
    return built_in_m


def _turn_deg(from_incisor_m: np.ndarray, opening_m: float) -> float:
    """The turn that lowers the incisors by ``opening_m``; ``from_incisor_m`` (3,) leads from their edge to the axis.

    At an angle t the edge is r sin(t0 + t) below the axis, with r its distance from there and r sin(t0) its depth at rest.
    """
    before, below = from_incisor_m[0], from_incisor_m[2]
    radius = float(np.hypot(before, below))
    if not abs(below + opening_m) < radius:
        raise InputError(f"jaw.opening_mm: no rotation opens incisors {1e3 * radius:.0f} mm from the axis so far; reduce it.")
    return float(np.degrees(np.arcsin((below + opening_m) / radius) - np.arctan2(below, before)))


def check_anchors(pulls: Sequence[FibrePull], bones: Sequence[Bone]) -> None:
    """Refuse a muscle that begins in space where a bone moves away: such a point stays where it is.

    Raises
    ------
    InputError : it lies within 5 mm of the surface of a bone that moves.
    """
    for bone in bones:
        if bone.motion is None:
            continue
        corners = bone.surface.corners
        for pull in pulls:
            in_space = [points.position[points.element < 0] for points in pull.points]
            for anchor in np.unique(np.concatenate(in_space), axis=0):
                if triangle_distance(np.broadcast_to(anchor, (len(corners), 3)), corners).min() < _ANCHORED_WITHIN_M:
                    raise InputError(
                        f"muscle {pull.name} is anchored at {in_mm(anchor)} on the bone {bone.name}, which moves, but "
                        "an anchor is fixed in space; start its fibres in the mesh, at the patch attached to this bone."
                    )


def attachments(scenario: TransientScenario, mesh: HexMesh, names: tuple[str, ...]) -> tuple[Attachment, ...]:
    """The ties of the patches called ``names`` to their bones, by area; the one called "jaw" moves with it."""
    motion = jaw_motion(scenario)
    hyoid: HyoidTable | None = scenario.hyoid
    ties = []
    for name in names:
        points, areas = _patch(scenario.model, mesh, name)
        given_way = hyoid is not None and name == "hyoid"
        stiffness = 1e3 * hyoid.stiffness_N_per_mm if hyoid is not None and given_way else np.inf
        ties.append(Attachment(name, points, areas, TIE_STIFFNESS_PA_M, stiffness, motion if name == "jaw" else None))
    return tuple(ties)


def _patch(table: ModelTable, mesh: HexMesh, name: str) -> tuple[MaterialPoints, np.ndarray]:
    if table.name is None:
        return points_on_set(mesh, name)
    cells = catalogue.cells_of(table.name, table.resolution, table.cells)
    return catalogue.attachment_points(table.name, tuple(cells), name)
