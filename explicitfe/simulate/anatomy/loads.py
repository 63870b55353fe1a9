"""Loads, masses, supports, the air and the release of a scenario as parts of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from explicitfe.fem.bones.motion import RigidMotion, along
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, MaterialPoints, free_faces, shape_functions
from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.fem.mesh.surface_points import points_on_set, surface_within
from explicitfe.fem.model.attached import AirDrag, AttachedMass, FacePressure, FollowerLoad, HangingWeight
from explicitfe.fem.model.body_force import body_force
from explicitfe.fem.model.model import Attachment, Model, NodalLoad, PrescribedMotion
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.held import held_shape
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.scenario.loads import LoadTable, ReleaseTable, SupportTable
from explicitfe.simulate.scenario.profile import profile_of
from explicitfe.simulate.scenario.transient import TransientScenario

# Pairs of corners of a hexahedron that are ends of an edge.
CORNER_PAIRS = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
PA_M_PER_KPA_MM = 1e6
# A load may sit this far outside of the body [m]: half a millimetre is rounding of a drawing.
OUTSIDE_M = 5e-4


def with_loads(model: Model, scenario: TransientScenario, folder: Path) -> Model:
    """The model with the loads, masses, supports and the air of a scenario.

    Raises
    ------
    InputError : a node set or a point that the mesh does not have, or a load without nodes.
    """
    mesh, gravity = model.mesh, np.array(scenario.model.gravity_m_s2)
    loads, masses, followers, weights = [*model.loads], [*model.masses], [*model.followers], [*model.weights]
    pressures = [*model.pressures]
    for number, table in enumerate(scenario.load, 1):
        name = f"load.{number}"
        nodes, share = _nodes_of(table, mesh, name, np.array(scenario.model.scale))
        profile = profile_of(table)
        if table.pressure_kPa is not None:
            pressures.append(FacePressure.on(mesh, nodes, 1e3 * table.pressure_kPa, profile, f"of {name}"))
        if table.body_force_N_m3 is not None:
            elements = np.isin(mesh.hexes, nodes).all(axis=1)
            if not elements.any():
                raise InputError(
                    f"{name}.body_force_N_m3: no element has all its nodes in {', '.join(table.nodes)}; name others."
                )
            loads.append(body_force(mesh, name, np.outer(elements, table.body_force_N_m3), profile))
        if table.force_N is not None:
            force = share[:, None] * np.array(table.force_N)
            if table.follows:
                followers.append(FollowerLoad(name, nodes, force, profile))
            else:
                loads.append(NodalLoad(name, nodes, force, profile))
        if table.mass_g > 0.0 and table.string_slack_mm is None:
            masses.append(AttachedMass(name, nodes, 1e-3 * table.mass_g * share))
        elif table.mass_g > 0.0:
            if not gravity.any():
                raise InputError(f"{name}.string_slack_mm: a string needs model.gravity_m_s2; add it.")
            slack_m = 1e-3 * (table.string_slack_mm or 0.0)
            weights.append(HangingWeight(name, nodes, share, 1e-3 * table.mass_g, gravity, slack_m, profile))
    air = scenario.air
    return replace(
        _prescribe(model, scenario, folder),
        loads=tuple(loads),
        masses=tuple(masses),
        followers=tuple(followers),
        weights=tuple(weights),
        pressures=tuple(pressures),
        attachments=(*model.attachments, *(_foundation(table, mesh) for table in scenario.support)),
        air=None if air is None else AirDrag(air.linear_Pa_s_m, 0.5 * air.density_kg_m3 * air.drag_coefficient),
    )


def _prescribe(model: Model, scenario: TransientScenario, folder: Path) -> Model:
    """The model with the prescribed motion of a scenario."""
    if not scenario.motion:
        return model
    mesh = model.mesh
    sets = [np.unique(np.concatenate([mesh.nodes_of(name) for name in table.nodes])) for table in scenario.motion]
    nodes = np.concatenate(sets)
    if len(np.unique(nodes)) < len(nodes):
        raise InputError("two [[motion]] tables move the same node; name sets that do not meet.")
    if model.held[nodes].any():
        raise InputError("[[motion]] moves nodes of a set in model.fixed; take it out of fixed, or name sets that do not meet.")
    paths = [course for table in scenario.motion if (course := table.course(folder)) is not None]

    def displacement(times: np.ndarray) -> np.ndarray:
        moved = [along(*path, times)[:, None, :] for path in paths]
        return np.concatenate([np.repeat(one, len(own), axis=1) for one, own in zip(moved, sets, strict=True)], axis=1)

    names = dict.fromkeys(name for table in scenario.motion for name in table.nodes)
    edges = np.unique(np.concatenate([time_s for time_s, _ in paths]))
    return replace(model, motion=PrescribedMotion(nodes, displacement, edges), fixed=(*model.fixed, *names))


def initial_velocity(mesh: HexMesh, scenario: TransientScenario) -> np.ndarray | None:
    """Velocity (n, 3) m/s of the nodes at time 0; None at rest."""
    if not scenario.initial:
        return None
    velocity = np.zeros((mesh.node_count, 3))
    for table in scenario.initial:
        nodes = [mesh.nodes_of(name) for name in table.nodes] or [np.arange(mesh.node_count)]
        velocity[np.concatenate(nodes)] = table.velocity_m_s
    return velocity


def with_release(model: Model, table: ReleaseTable | None) -> tuple[Model, np.ndarray | None]:
    """The model with the forces that hold it until the release, and its displacement (n, 3) m at time 0; None at rest.

    A body that is held as a whole is in its reference shape, and no load acts before the release. Held node sets are displaced,
    the body is in equilibrium under its loads, and the forces that hold these nodes fall to zero.

    Raises
    ------
    InputError : a node set that the mesh does not have, a mass on a string with held node sets, or no equilibrium.
    """
    if table is None:
        return model, None
    at_s, over_s = 1e-3 * table.at_ms, 1e-3 * table.over_ms
    if not table.hold:
        if at_s == over_s == 0.0:
            return model, None
        later = {
            name: tuple(replace(load, profile=load.profile.times_ramp(at_s, over_s)) for load in getattr(model, name))
            for name in ("loads", "followers", "pressures", "weights", "pulls", "stresses")
        }
        return replace(model, **later), None  # type: ignore[arg-type]
    if model.weights:
        raise InputError("release.hold cannot be combined with a mass on a string; remove string_slack_mm.")
    nodes = np.unique(np.concatenate([model.mesh.nodes_of(name) for name in table.hold]))
    displacement, force = held_shape(model, nodes, 1e-3 * np.array(table.shift_mm))
    profile = Profile(np.array([at_s, at_s + over_s]), np.array([1.0, 0.0]))
    return replace(model, loads=(*model.loads, NodalLoad("release", nodes, force, profile))), displacement


def _nodes_of(table: LoadTable, mesh: HexMesh, name: str, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (k,) of a load, and the share (k,) of each."""
    if table.at_mm is not None:
        place = 1e-3 * np.array(table.at_mm) * scale
        points = locate_in_mesh(mesh, place, tolerance=np.inf)
        away_m = float(np.linalg.norm(points.position[0] - place))
        if away_m > OUTSIDE_M:
            raise InputError(f"{name}.at_mm lies {1e3 * away_m:.3g} mm outside of the body; move it onto the body.")
        if table.radius_mm > 0.0:
            return _spread(table, mesh, name, place)
        return mesh.hexes[points.element[0]], shape_functions(points.natural)[0]
    inside = np.ones(mesh.node_count, dtype=bool)
    for one in table.nodes:
        member = np.zeros(mesh.node_count, dtype=bool)
        member[mesh.nodes_of(one)] = True
        inside &= member
    nodes = np.flatnonzero(inside)
    if not len(nodes):
        raise InputError(f"{name}.nodes: no node is in all of {', '.join(table.nodes)}; name sets that meet.")
    return nodes, node_shares(mesh, nodes)


def _spread(table: LoadTable, mesh: HexMesh, name: str, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and shares of a load that is spread evenly over the surface around a place (3,) m."""
    radius_m = 1e-3 * table.radius_mm
    points, areas_m2 = surface_within(mesh, place, radius_m)
    if not len(areas_m2):
        raise InputError(f"{name}.radius_mm: no part of the surface lies within {table.radius_mm:g} mm of at_mm; increase it.")
    weights = areas_m2[:, None] * shape_functions(points.natural)
    total = np.bincount(mesh.hexes[points.element].ravel(), weights.ravel(), mesh.node_count)
    nodes = np.flatnonzero(total)
    return nodes, total[nodes] / total.sum()


def node_shares(mesh: HexMesh, nodes: np.ndarray) -> np.ndarray:
    """Shares (k,) of a uniform load on nodes, which add up to 1: by area if they have faces, by length if they have edges."""
    member = np.zeros(mesh.node_count, dtype=bool)
    member[nodes] = True
    element, face = free_faces(mesh.hexes)
    for pieces in (mesh.hexes[element[:, None], FACES[face]], _edges(mesh)):
        own = pieces[member[pieces].all(axis=1)]
        if len(own):
            sizes = _sizes(mesh.points[own])
            total = np.bincount(own.ravel(), np.repeat(sizes / own.shape[1], own.shape[1]), mesh.node_count)[nodes]
            if total.all():
                return np.asarray(total / total.sum())
    return np.full(len(nodes), 1.0 / len(nodes))


def _edges(mesh: HexMesh) -> np.ndarray:
    return np.unique(np.sort(mesh.hexes[:, CORNER_PAIRS].reshape(-1, 2), axis=1), axis=0)


def _sizes(corners: np.ndarray) -> np.ndarray:
    """Lengths (k,) of edges (k, 2, 3), or areas of faces (k, 4, 3)."""
    if corners.shape[1] == 2:
        return np.asarray(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1))
    return np.asarray(0.5 * np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1))


def _foundation(table: SupportTable, mesh: HexMesh) -> Attachment:
    """The springs of an elastic support."""
    points, areas = points_on_set(mesh, table.name)
    normal, along = PA_M_PER_KPA_MM * table.normal_kPa_per_mm, PA_M_PER_KPA_MM * table.tangential_kPa_per_mm
    motion = (
        RigidMotion(np.zeros(3), np.zeros(3), 1e-3 * np.array(table.shift_mm), *table.course) if any(table.shift_mm) else None
    )
    return Attachment(table.name, points, areas, along, motion=motion, normal_stiffness_Pa_m=normal)


def scale_anatomy(anatomy: Anatomy, factors: Sequence[float]) -> Anatomy:
    """An anatomy without muscles with its lengths multiplied along x, y and z.

    Raises
    ------
    InputError : it has muscles, whose fibres would have to be scaled too.
    """
    if anatomy.muscles:
        raise InputError("model.scale is for bodies without muscles; scale the mesh file and its fibres instead.")
    by = np.array(factors)
    mesh = anatomy.mesh
    named = {name: MaterialPoints(one.element, one.natural, one.position * by) for name, one in mesh.named_points.items()}
    return replace(anatomy, mesh=replace(mesh, points=mesh.points * by, named_points=named))
