"""From a scenario's tables to the bones of a model: what the body may rest on, and what holds it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from explicitfe.bones.distance import DistanceField, bone_field
from explicitfe.bones.motion import RigidMotion
from explicitfe.bones.read import read_surface
from explicitfe.bones.surface import TriangleSurface, shifted
from explicitfe.bones.tables import BoneShape
from explicitfe.errors import InputError, nearest
from explicitfe.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.mesh.surface_points import points_on_set, surface_areas
from explicitfe.model import catalogue
from explicitfe.model.model import Attachment, Bone
from explicitfe.scenario.bones import BoneTable, HyoidTable, JawTable
from explicitfe.scenario.transient import ModelTable, TransientScenario

# Of the ties between tissue and bone [Pa/m], as stiff as contact: under the 10 kPa of a strong muscle's origin they give way by
# half a millimetre. Five times as stiff, points of the tongue move by 0.1 mm less of 4, and its meshes agree less well.
TIE_STIFFNESS_PA_M = 2e7


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
            raise InputError(f'{names.count(name)} bones are called "{name}"; give each another name.')
    motion = jaw_motion(scenario)
    surface_points = mesh.points[surface_areas(mesh) > 0.0] if scenario.bone else mesh.points
    return tuple(
        Bone(
            table.name,
            *_surface(table, built_in, folder, surface_points),
            motion=motion if table.moves_with_jaw else None,
            friction=table.friction,
        )
        for table in scenario.bone
    )


def _surface(
    table: BoneTable, built_in: dict[str, BoneShape], folder: Path, body_points: np.ndarray
) -> tuple[DistanceField, TriangleSurface]:
    if table.file is None:
        if table.name not in built_in:
            hint = nearest(table.name, built_in) if built_in else "this model brings none: give its surface as file."
            raise InputError(f'unknown bone "{table.name}"; {hint}')
        surface, what = built_in[table.name].surface, f'bone "{table.name}"'
    else:
        assert table.length_unit is not None  # the schema has checked that it is given
        path = folder / table.file
        surface, what = read_surface(path, table.length_unit), f'bone "{table.name}" ({path})'
    surface = shifted(surface, 1e-3 * np.array(table.shift_mm)) if any(table.shift_mm) else surface
    return bone_field(surface, what, body_points), surface


def jaw_motion(scenario: TransientScenario) -> RigidMotion | None:
    """How the jaw moves, None where it does not.

    Raises
    ------
    InputError : the axis is not known.
    """
    table: JawTable | None = scenario.jaw
    if table is None:
        return None
    if table.axis_mm is not None:
        centre = 1e-3 * np.array(table.axis_mm)
    else:
        shape = None if scenario.model.name is None else catalogue.bones(scenario.model.name).get("jaw")
        if shape is None or shape.hinge_m is None:
            raise InputError("jaw.axis_mm is missing: a model of one's own does not tell where the axis through the condyles is.")
        centre = shape.hinge_m
    if table.table:
        time_ms, course = np.array(table.table, dtype=float).T
    else:
        time_ms, course = np.array([table.start_ms, table.start_ms + table.rise_ms]), np.array([0.0, 1.0])
    return RigidMotion(
        centre_m=centre,
        # x points backwards and z up: about +y a chin in front of the axis would rise
        turn_rad=np.radians([0.0, -table.opening_deg, 0.0]),
        shift_m=1e-3 * np.array([-table.forward_mm, 0.0, -table.down_mm]),
        time_s=1e-3 * time_ms,
        course=course,
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
    return catalogue.contour(table.name).attachment_points(cells, name)
