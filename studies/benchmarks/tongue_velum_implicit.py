"""The postures of [i] and [k]: explicitfe at rest against an implicit solution that shares no code with it.

    python studies/benchmarks/tongue_velum_implicit.py

The forces, the jaw and the bodies of a scenario, held until the motion has died away. The implicit route, see
``implicit_bodies``, takes the meshes, the stress of the muscles in each hexahedron, the triangles of the bones and the attached
patches as data; its elements, contact and solver are its own. Distances from bones are exact; those of explicitfe are smoothed
over 0.5 mm. Prints a row for each pair of elements, explicitfe first, and takes twenty minutes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from implicit_bodies import (
    Bone,
    Elements,
    Part,
    Surface,
    Tissue,
    Touch,
    face_points,
    halved,
    linear,
    node_areas,
    outer_faces,
    quadratic,
    settle,
    shape_values,
)

from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.model.model import Attachment, FibrePull, Model
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.simulate.anatomy.catalogue import cells_of
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.bodies import ContactTable
from explicitfe.simulate.scenario.read import read_transient
from explicitfe.simulate.scenario.transient import Damping

SCENARIOS = Path(__file__).parents[2] / "scenarios"
RISE_MS, END_S, ALPHA_PER_S = 50.0, 1.0, 80.0
STIFFNESS_PA_M = 2e7
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True)
class Rest:
    """A posture: displacement (n, 3) m, pressure (n,) Pa between the bodies and of each bone, and the speed that is left, m/s."""

    u: np.ndarray
    pressure: np.ndarray
    bones: dict[str, np.ndarray]
    speed_m_s: float = 0.0


def model_of(element: str, posture: str, resolution: str) -> Model:
    """The bodies, forces and jaw of a scenario, which rise within 50 ms and are held."""
    scenario = read_transient(SCENARIOS / f"{posture}.toml")
    rising = {"profile": "table", "table": [(0.0, 0.0), (RISE_MS, 1.0)], "rise_ms": 0.0}
    held = {
        "model": scenario.model.model_copy(
            update={"element": element, "resolution": resolution, "damping": Damping(alpha_per_s=ALPHA_PER_S)}
        ),
        "muscle": [muscle.model_copy(update=rising) for muscle in scenario.muscle],
        "contact": ContactTable(stiffness_kPa_per_mm=1e-6 * STIFFNESS_PA_M) if scenario.body else None,
        "jaw": scenario.jaw.model_copy(update={"table": rising["table"]}),
    }
    return assemble(scenario.model_copy(update=held), SCENARIOS).model


@cache
def explicit(element: str, posture: str, resolution: str) -> Rest:
    """With explicitfe: forces and jaw rise within 50 ms, and damping brings the bodies to rest."""
    model = model_of(element, posture, resolution)
    body = Simulation(model)
    body.surfaces.growth[:] = np.inf  # contact is linear in depth, as it is there
    ended = Transient(body, END_S).advance_to(END_S)
    assert ended is None or ended.state == "finished", ended
    last = body.snapshot()
    bones = {bone.name: last.contact_pressure[number].copy() for number, bone in enumerate(model.bones)}
    speed = float(np.linalg.norm(last.velocity, axis=1).max())
    pressure = last.surface_pressure.copy() if model.surfaces else np.zeros(len(last.displacement))
    return Rest(last.displacement.copy(), pressure, bones, speed)


# ---- the implicit route ----


class Tie:
    """A patch that springs tie to a bone: K_ab = sum of k A N_a N_b; a bone on a spring of its own gives way without turning."""

    def __init__(self, patch: Attachment, hexes: np.ndarray, points: np.ndarray) -> None:
        assert patch.normal_stiffness_Pa_m in (None, patch.stiffness_Pa_m)
        weights, corners = shape_values(patch.points.natural), hexes[patch.points.element]
        self.nodes, index = np.unique(corners, return_inverse=True)
        by_node = np.zeros((len(corners), len(self.nodes)))
        np.add.at(by_node, (np.arange(len(corners))[:, None], index.reshape(corners.shape)), weights)
        self.K = by_node.T @ (patch.stiffness_Pa_m * patch.areas_m2[:, None] * by_node)
        if np.isfinite(patch.bone_stiffness_N_m):
            row = self.K.sum(axis=1)
            self.K -= np.outer(row, row) / (patch.bone_stiffness_N_m + row.sum())
        self.shift = np.zeros((len(self.nodes), 3))
        self.motion, self.at_rest = patch.motion, points[self.nodes]

    def move(self, share: float) -> None:
        """Put the bone where it is at a share of its course."""
        if self.motion is not None:
            rotation, shift = placed(self.motion, share)
            self.shift = self.at_rest @ rotation.T + shift - self.at_rest

    def __call__(self, u: np.ndarray) -> Part:
        away = u[self.nodes] - self.shift
        slope = self.K @ away
        size = 3 * len(self.nodes)
        each = np.einsum("ab,ij->aibj", self.K, np.eye(3)).reshape(1, size, size)
        return Part(0.5 * np.sum(slope * away), self.nodes[None], slope[None], each)


class Pull:
    """Lines under tension to points of the body from points in space or of the body: the energy is tension times length."""

    def __init__(self, pull: FibrePull, elements: list[Elements], points: np.ndarray) -> None:
        assert all(len(line) == 2 for line in pull.points)
        hexes, natural = (np.array([getattr(line, of) for line in pull.points]) for of in ("element", "natural"))
        self.nodes, self.weights = _in_elements(elements, hexes[:, 1], natural[:, 1])
        self.start = np.zeros((len(hexes), 3))
        if (hexes[:, 0] < 0).all():
            self.start = np.array([line.position[0] for line in pull.points])
        else:
            nodes, weights = _in_elements(elements, hexes[:, 0], natural[:, 0])
            self.nodes, self.weights = np.hstack([self.nodes, nodes]), np.hstack([self.weights, -weights])
        self.full_N = self.tension_N = np.concatenate(pull.tension_N)
        self.points = points

    def __call__(self, u: np.ndarray) -> Part:
        line = np.einsum("ka,kai->ki", self.weights, (self.points + u)[self.nodes]) - self.start
        length = np.linalg.norm(line, axis=1)
        along = line / length[:, None]
        slope = self.weights[:, :, None] * (self.tension_N[:, None] * along)[:, None]
        across = (np.eye(3) - along[:, :, None] * along[:, None, :]) * (self.tension_N / length)[:, None, None]
        each = np.einsum("ka,kb,kij->kaibj", self.weights, self.weights, across)
        each = each.reshape(len(line), 3 * self.nodes.shape[1], -1)
        return Part(float(self.tension_N @ length), self.nodes, slope, each)


def _in_elements(elements: list[Elements], hexes: np.ndarray, natural: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (k, a) and their shares (k, a) of points at natural coordinates (k, 3) of hexahedra (k,), of whichever body."""
    nodes, shares = np.empty((2, len(hexes), elements[0].nodes.shape[1]))
    for one in elements:
        own = np.isin(hexes, one.hexes)
        if own.any():
            nodes[own], shares[own] = one.at(hexes[own], natural[own])
    return nodes.astype(int), shares


def placed(motion: RigidMotion, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) about an axis along y, and shift (3,) m, of the jaw at a share of its course."""
    angle = share * motion.turn_rad[1]
    assert not motion.turn_rad[[0, 2]].any()
    rotation = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    return rotation, motion.centre_m + share * motion.shift_m - rotation @ motion.centre_m


@cache
def implicit(posture: str, resolution: str, second: bool = False, of_nodes: bool = False) -> Rest:
    """The same posture from the minimum of the energy, with elements of eight nodes or, of second order, of 27.

    ``of_nodes`` : contact between the bodies is of nodes of the velum with faces of the tongue, instead of 2 x 2 points of the
    faces of either body with those of the other, which carry half of the pressure each.
    """
    model = model_of("hex8", posture, resolution)
    points, hexes = model.mesh.points, model.mesh.hexes
    C10, C20, poisson = model.in_elements(lambda law: (law.C10_Pa, law.C20_Pa, law.poisson)).T
    bulk = 4.0 * C10 * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson))
    muscles = []
    for muscle in model.stresses:
        assert not muscle.force_length
        sigma, direction = np.zeros(len(hexes)), np.tile([1.0, 0.0, 0.0], (len(hexes), 1))
        sigma[muscle.elements], direction[muscle.elements] = muscle.stress_Pa, muscle.direction
        muscles.append((sigma, direction))
    faces = outer_faces(hexes)
    areas = node_areas(points, faces)
    u = np.zeros(points.shape)
    free = np.setdiff1d(np.arange(u.size), np.flatnonzero(model.held.ravel()))
    loose = faces[~model.held[faces].all(axis=(1, 2))]
    shares, of_points = face_points(points, loose)
    outside = np.repeat(loose, len(shares), axis=0), np.tile(shares, (len(loose), 1)), STIFFNESS_PA_M * of_points.ravel()
    ties = [Tie(patch, hexes, points) for patch in model.attachments]
    touches = touches_of(model, faces, of_nodes) if model.surfaces else []
    bones = [(bone, Surface(halved(bone.surface.corners))) for bone in model.bones]
    elements = [linear(points, hexes)]
    if second:
        elements, first = [], 0
        for name in ("tongue", "velum")[: 1 + len(model.inclusions)]:
            along, through, across = cells_of(name, resolution, None)
            elements.append(quadratic(points, hexes, (along, across, through), first))
            first += along * through * across
    pulls = [Pull(pull, elements, points) for pull in model.pulls]
    for share in SHARES:
        active = [(share * sigma, direction) for sigma, direction in muscles]
        tissues = [Tissue(one, C10, C20, bulk, active) for one in elements]
        for tie in ties:
            tie.move(share)
        for pull in pulls:
            pull.tension_N = share * pull.full_N
        contacts = {}
        for bone, surface in bones:
            place = (np.eye(3), np.zeros(3)) if bone.motion is None else placed(bone.motion, share)
            contacts[bone.name] = Bone(points, *outside, surface, *place)
        u = settle([*tissues, *ties, *pulls, *contacts.values(), *touches], u, free)
    pressed = {name: pressure_of([contact(u)], areas) for name, contact in contacts.items()}
    return Rest(u, pressure_of([touch(u) for touch in touches], areas), pressed)


def touches_of(model: Model, faces: np.ndarray, of_nodes: bool) -> list[Touch]:
    """Contact of the two bodies."""
    points = model.mesh.points
    free = ~model.held[faces].all(axis=(1, 2))  # not the end at the hard palate, which is no surface
    of_velum = np.isin(faces, model.mesh.node_sets["velum"]).all(axis=1)
    if of_nodes:
        nodes = np.unique(faces[of_velum])
        springs = STIFFNESS_PA_M * node_areas(points, faces)[nodes]
        return [Touch(points, nodes[:, None], np.ones((len(nodes), 1)), springs, faces[~of_velum], free[~of_velum])]
    touches = []
    for one in (of_velum, ~of_velum):
        shares, areas = face_points(points, faces[one])
        nodes, shares = np.repeat(faces[one], len(shares), axis=0), np.tile(shares, (one.sum(), 1))
        touches.append(Touch(points, nodes, shares, 0.5 * STIFFNESS_PA_M * areas.ravel(), faces[~one], free[~one]))
    return touches


def pressure_of(parts: list[Part], areas: np.ndarray) -> np.ndarray:
    """Pressure (n,) Pa at nodes, from the forces on them."""
    force = np.zeros(len(areas))
    for part in parts:
        np.add.at(force, part.nodes, np.linalg.norm(part.slope, axis=2))
    return force / np.where(areas > 0.0, areas, 1.0)


class Pair(NamedTuple):
    """What a row compares: the scenario, the mesh, the element of explicitfe, and the implicit route."""

    title: str
    posture: str
    resolution: str
    element: str
    second: bool = False
    of_nodes: bool = False


PAIRS = (
    *(
        Pair(title, posture, resolution, element, second)
        for posture in ("vowel-i-palatal", "velar-k")
        for title, resolution, element, second in (
            ("eight points", "coarse", "hex8-full", False),
            ("eight points", "medium", "hex8-full", False),
            ("one point against eight", "medium", "hex8", False),
            ("one point against quadratic elements", "medium", "hex8", True),
        )
    ),
    Pair("eight points; contact of nodes, one side", "velar-k", "coarse", "hex8-full", of_nodes=True),
)


def row_of(pair: Pair) -> str:
    """The differences of nodes that can move, and forces and pressures by either route."""
    model = model_of(pair.element, pair.posture, pair.resolution)
    routes = (
        explicit(pair.element, pair.posture, pair.resolution),
        implicit(pair.posture, pair.resolution, pair.second, pair.of_nodes),
    )
    velum = np.zeros(model.mesh.node_count, dtype=bool)
    velum[model.mesh.node_sets.get("velum", [])] = True
    moves = ~model.held.all(axis=1)
    apart = 1e3 * np.linalg.norm(routes[0].u - routes[1].u, axis=1)
    areas = node_areas(model.mesh.points, outer_faces(model.mesh.hexes))
    cells = [pair.posture, pair.title, pair.resolution, f"{np.sqrt(np.mean(apart[moves] ** 2)):.3f}"]
    for body in (~velum, velum & moves)[: 1 + velum.any()]:
        cells.append(f"{np.sqrt(np.mean(apart[body] ** 2)):.3f}, {apart[body].max():.2f}")
    if velum.any():
        push = [rest.pressure * areas * velum for rest in routes]
        centres = [force @ (model.mesh.points + rest.u) / force.sum() for force, rest in zip(push, routes, strict=True)]
        cells.append(", ".join(f"{force.sum():.3f}" for force in push))
        cells.append(", ".join(f"{1e-3 * rest.pressure[velum].max():.2f}" for rest in routes))
        cells.append(f"{1e3 * np.linalg.norm(centres[0] - centres[1]):.2f}")
    else:
        cells += [""] * 4
    cells += [", ".join(f"{rest.bones[name] @ areas:.3f}" for rest in routes) for name in routes[0].bones]
    return f"| {' | '.join(cells)} | {1e3 * routes[0].speed_m_s:.0e} |"


def main() -> None:
    """Print how far apart the postures are."""
    print("| scenario | elements; contact | mesh | rms mm | tongue: rms, largest mm | velum | contact N | peak kPa ", end="")
    print("| centres apart mm | palate N | jaw N | pharynx N | speed left mm/s |")
    for pair in PAIRS:
        print(row_of(pair), flush=True)


if __name__ == "__main__":
    main()
