"""The loads of a model as the arrays that kernels read: dead loads, follower fibres, prescribed motion, and when each acts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from explicitfe.fem.forces.turning import axes_of
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints, shape_functions
from explicitfe.fem.mesh.surface_points import projected_areas
from explicitfe.fem.model.attached import FacePressure, FollowerLoad
from explicitfe.fem.model.gravity import nodal_mass
from explicitfe.fem.model.model import FibrePull, Model, NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.bones import placements
from explicitfe.platform.compiled.arrays import Actions, Bones, DeadLoads, FollowerFibres, Motion, Ties
from explicitfe.platform.compiled.attached_arrays import Drag, PressedFaces, TurningLoads, Weights
from explicitfe.platform.compiled.contact_arrays import Surfaces


class Loads:
    """What pulls at a body and when.

    Parameters
    ----------
    model : the physics.
    place : (n,) row of each node in computing order.

    Attributes
    ----------
    dead, fibres, turning, pressed, weights : dead loads, follower fibres, follower forces, faces under pressure and hanging
        weights at activation 1, each with the row of its profile in the activation table.
    drag : of the air, and damping beside attached masses.
    """

    def __init__(self, model: Model, place: np.ndarray) -> None:
        self._place = place
        self._motion = model.motion
        self._profiles: list[Profile] = []
        self.dead = self._dead_loads(model.loads)
        self.fibres = self._follower_fibres(model.pulls, model.mesh)
        self.turning = self._turning_loads(model.followers, model.mesh)
        self.pressed = self._faces_under_pressure(model.pressures, model.mesh)
        self.weights = self._hanging_weights(model)
        self.drag = self._drag(model)
        self._muscles = [stress.profile for stress in model.stresses]
        self._bones = [bone.motion for bone in model.bones]
        self._holders = [attachment.motion for attachment in model.attachments]

    @property
    def rows(self) -> np.ndarray:
        """Node rows on which these loads may act."""
        following = [self.fibres.nodes.ravel(), self.turning.node, self.pressed.node.ravel()]
        return np.concatenate([self.dead.node, *following, self.weights.node, self.drag.node])

    @property
    def edges_s(self) -> np.ndarray:
        """Times at which some load jumps or bends: they are put on step boundaries."""
        courses = [*self._profiles, *self._muscles, *self._bones, *self._holders]
        bends = [course.edges_s for course in courses if course is not None]
        return np.unique(np.concatenate([*bends, np.zeros(0) if self._motion is None else self._motion.edges_s]))

    def start(self, dt_s: float) -> None:
        """Half-step start of the hanging weights, whose net forces a snapshot has stored; see ``Simulation.start``."""
        weights = self.weights
        weights.state[:, 1] = -0.5 * dt_s * weights.push / weights.mass

    def actions(
        self, instants: np.ndarray, tolerance_s: float, bones: Bones, ties: Ties, surfaces: Surfaces, planned: np.ndarray
    ) -> Actions:
        """What acts on the body at instants (k,) s.

        Parameters
        ----------
        tolerance_s : an instant that is within a millionth of it from an edge of a profile is taken to be on it.
        bones, ties, surfaces, planned : as for :class:`Actions`.
        """
        bone_placement, tie_placement = self.bones(instants)
        return Actions(
            dead=self.dead,
            fibres=self.fibres,
            turning=self.turning,
            pressed=self.pressed,
            weights=self.weights,
            drag=self.drag,
            activation=self.activation(instants, tolerance_s),
            muscles=self.muscles(instants, tolerance_s),
            bones=bones,
            bone_placement=bone_placement,
            ties=ties,
            tie_placement=tie_placement,
            surfaces=surfaces,
            motion=self.motion(instants),
            planned=planned,
        )

    def activation(self, instants: np.ndarray, dt_s: float) -> np.ndarray:
        """Scale of each profile at instants (k,) s, (profiles, k).

        An instant that is within a millionth of a step of an edge is taken to be on it.
        """
        return _scales(self._profiles, instants, dt_s)

    def muscles(self, instants: np.ndarray, dt_s: float) -> np.ndarray:
        """Activation of the muscles that pull by a stress at instants (k,) s, (k, muscles)."""
        return np.ascontiguousarray(_scales(self._muscles, instants, dt_s).T)

    def bones(self, instants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Placements of the bones that the body may touch, and of those that hold it, at instants (k,) s."""
        return placements(self._bones, instants), placements(self._holders, instants)

    def motion(self, instants: np.ndarray) -> Motion:
        """Displacements of the prescribed nodes at instants [s]; no node without prescribed motion."""
        if self._motion is None:
            return Motion(node=np.zeros(0, dtype=np.int64), target=np.zeros((len(instants), 0, 3)))
        # a copy: the compiler takes a read-only array for another type
        target = np.array(self._motion.displacement(instants), dtype=float, order="C")
        return Motion(node=self._place[self._motion.nodes], target=target)

    def _dead_loads(self, loads: Sequence[NodalLoad]) -> DeadLoads:
        sizes = [len(load.nodes) for load in loads]
        nodes = np.concatenate([self._place[load.nodes] for load in loads] or [np.zeros(0, dtype=np.int64)])
        forces = np.concatenate([np.asarray(load.force_N, dtype=float) for load in loads] or [np.zeros((0, 3))])
        return DeadLoads(
            start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            node=nodes.astype(np.int64),
            force=np.ascontiguousarray(forces.reshape(-1, 3)),
            profile=np.array([self._row_of(load.profile) for load in loads], dtype=np.int64),
        )

    def _follower_fibres(self, pulls: Sequence[FibrePull], mesh: HexMesh) -> FollowerFibres:
        chains = [
            (points, tension, self._row_of(pull.profile))
            for pull in pulls
            for points, tension in zip(pull.points, pull.tension_N, strict=True)
        ]
        sizes = [len(points) for points, _, _ in chains]
        nodes, weights = self._carriers([points for points, _, _ in chains], mesh)
        return FollowerFibres(
            start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            nodes=nodes,
            weights=weights,
            position=np.concatenate([points.position for points, _, _ in chains] or [np.zeros((0, 3))]),
            # one entry a vertex; the last vertex of a fibre starts no segment
            tension=np.concatenate([np.append(t, 0.0) for _, t, _ in chains] or [np.zeros(0)]),
            profile=np.array([p for _, _, p in chains], dtype=np.int64),
        )

    def _turning_loads(self, loads: Sequence[FollowerLoad], mesh: HexMesh) -> TurningLoads:
        nodes = np.concatenate([np.zeros(0, dtype=np.int64), *(load.nodes for load in loads)])
        forces = np.concatenate([np.zeros((0, 3)), *(load.force_N for load in loads)])
        element = np.zeros(mesh.node_count, dtype=np.int64)
        element[mesh.hexes] = np.arange(mesh.element_count)[:, None]
        corners = mesh.hexes[element[nodes]]
        position = np.ascontiguousarray(mesh.points[corners])
        axes = [np.reshape(axes_of(np.arange(8), one, np.zeros((8, 3))), (3, 3)) for one in position]
        local = [axis @ force for axis, force in zip(axes, forces, strict=True)]
        return TurningLoads(
            node=self._place[nodes],
            corners=np.ascontiguousarray(self._place[corners]),
            position=position,
            force=np.array(local, dtype=float).reshape(-1, 3),
            profile=np.array([self._row_of(load.profile) for load in loads for _ in load.nodes], dtype=np.int64),
        )

    def _faces_under_pressure(self, pressures: Sequence[FacePressure], mesh: HexMesh) -> PressedFaces:
        faces = np.concatenate([np.zeros((0, 4), dtype=np.int64), *(one.faces for one in pressures)])
        return PressedFaces(
            node=self._place[faces],
            position=np.ascontiguousarray(mesh.points[faces]),
            pressure=np.concatenate([np.zeros(0), *(np.full(len(one.faces), one.pressure_Pa) for one in pressures)]),
            profile=np.array([self._row_of(one.profile) for one in pressures for _ in one.faces], dtype=np.int64),
        )

    def _hanging_weights(self, model: Model) -> Weights:
        weights = model.weights
        mass = np.array([one.mass_kg for one in weights], dtype=float)
        g = np.array([one.gravity_m_s2 for one in weights], dtype=float).reshape(-1, 3)
        size = np.linalg.norm(g, axis=1)
        return Weights(
            start=np.concatenate([[0], np.cumsum([len(one.nodes) for one in weights])]).astype(np.int64),
            node=self._place[np.concatenate([np.zeros(0, dtype=np.int64), *(one.nodes for one in weights)])],
            share=np.concatenate([np.zeros(0), *(one.share for one in weights)]),
            down=g / np.maximum(size, 1e-300)[:, None],
            mass=mass,
            weight=mass * size,
            slack=np.array([one.slack_m for one in weights], dtype=float),
            profile=np.array([self._row_of(one.profile) for one in weights], dtype=np.int64),
            state=np.zeros((len(weights), 2)),
            push=np.zeros(len(weights)),
        )

    def _drag(self, model: Model) -> Drag:
        """Drag of the air, and mass-proportional damping where masses are attached: it acts on the tissue and not on them."""
        count = model.mesh.node_count
        linear, quadratic = np.zeros((count, 3)), np.zeros((count, 3))
        if model.air is not None:
            areas = projected_areas(model.mesh)
            linear += model.air.linear_Pa_s_m * areas
            quadratic += model.air.quadratic_kg_m3 * areas
        if model.masses:
            linear += model.alpha_per_s * nodal_mass(model.mesh, model.material, model.inclusions)[:, None]
        nodes = np.flatnonzero(linear.any(axis=1) | quadratic.any(axis=1))
        return Drag(self._place[nodes], np.ascontiguousarray(linear[nodes]), np.ascontiguousarray(quadratic[nodes]))

    def _row_of(self, profile: Profile) -> int:
        """Row of a profile in the activation table; equal profiles share one."""
        for row, known in enumerate(self._profiles):
            same = np.array_equal(known.time_s, profile.time_s) and np.array_equal(known.scale, profile.scale)
            if same and known.lag_s == profile.lag_s:
                return row
        self._profiles.append(profile)
        return len(self._profiles) - 1

    def _carriers(self, chains: Sequence[MaterialPoints], mesh: HexMesh) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (k, 8) in computing order and weights (k, 8) of all points; points fixed in space hang on the idle row."""
        element = np.concatenate([points.element for points in chains] or [np.zeros(0, dtype=np.int64)])
        natural = np.concatenate([points.natural for points in chains] or [np.zeros((0, 3))])
        in_space = element < 0
        nodes = self._place[mesh.hexes[np.where(in_space, 0, element)]]
        nodes[in_space] = mesh.node_count
        weights = shape_functions(natural)
        weights[in_space] = 0.0
        return np.ascontiguousarray(nodes), np.ascontiguousarray(weights)


def _scales(profiles: Sequence[Profile], instants: np.ndarray, dt_s: float) -> np.ndarray:
    scales: dict[tuple[bytes, bytes, float], np.ndarray] = {}  # equal courses of many muscles are computed once
    names = [(profile.time_s.tobytes(), profile.scale.tobytes(), profile.lag_s) for profile in profiles]
    for name, profile in zip(names, profiles, strict=True):
        if name not in scales:
            scales[name] = profile.at(instants, tolerance_s=1e-6 * dt_s)
    return np.array([scales[name] for name in names]).reshape(-1, len(instants))
