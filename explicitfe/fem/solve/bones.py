"""The bones of a model as arrays for the kernels: positions, contact nodes and attachments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.forces.bone import CONTACT_STIFFNESS_PA_M
from explicitfe.fem.mesh.hexmesh import HexMesh, shape_functions
from explicitfe.fem.mesh.surface_points import surface_areas, surface_normals
from explicitfe.fem.model.model import Attachment, Bone
from explicitfe.platform.compiled.arrays import PLACEMENT, ROTATION, SHIFT, SPEED, SPIN, Bones, Ties
from explicitfe.platform.host.kept import kept
from explicitfe.platform.host.stored import store_answers

# Where a bone begins beyond the depth at rest: were it there, rounding would tell which points touch before anything moves.
REST_GAP_M = 1e-12
SPEED_INTERVAL_S = 1e-6  # over which the speed of a moving bone is differenced


def bones_of(bones: Sequence[Bone], mesh: HexMesh, place: np.ndarray, mass: np.ndarray, held: np.ndarray) -> Bones:
    """Bones, and the nodes of the body's surface that may touch them.

    Parameters
    ----------
    mesh : the body.
    place : (n,) row of each node in computing order.
    mass : (n,) kg.
    held : (n,) nodes that do not move or follow a course: they are no contact points.
    """
    areas = surface_areas(mesh) if bones else np.zeros(mesh.node_count)
    nodes = np.flatnonzero((areas > 0.0) & ~held)
    nodes = nodes[np.argsort(place[nodes])]
    spring = CONTACT_STIFFNESS_PA_M * areas[nodes]
    depth = [REST_GAP_M + np.maximum(0.0, -_distance(bone, _at_rest(bone, mesh.points[nodes]))) for bone in bones]
    grids = [np.ascontiguousarray(bone.field.values, dtype=float) for bone in bones]
    sizes = [grid.size for grid in grids]
    return Bones(
        node=place[nodes].astype(np.int64),
        position=np.ascontiguousarray(mesh.points[nodes]),
        spring=spring,
        damper=np.array([2.0 * bone.damping * np.sqrt(spring * mass[nodes]) for bone in bones]).reshape(len(bones), len(nodes)),
        rest_depth=np.array(depth).reshape(len(bones), len(nodes)),
        start=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)[: len(bones)],
        shape=np.array([grid.shape for grid in grids], dtype=np.int64).reshape(-1, 3),
        origin=np.array([bone.field.origin_m for bone in bones], dtype=float).reshape(-1, 3),
        spacing=np.array([bone.field.spacing_m for bone in bones], dtype=float),
        distance=np.concatenate([grid.ravel() for grid in grids] or [np.zeros(0)]),
        friction=np.array([bone.friction for bone in bones], dtype=float),
        moves=np.array([bone.motion is not None for bone in bones], dtype=np.int64),
        smooth=np.array([bone.smooth for bone in bones], dtype=np.int64),
        free=np.zeros((1 + len(bones), len(nodes), 4)),
    )


def _distance(bone: Bone, points: np.ndarray) -> np.ndarray:
    """Signed distance of points (k, 3) of the bone's own frame, (k,) m, as the kernels see it."""
    field = bone.field
    if not bone.smooth:
        return field.at(points)[0]
    at = (points - field.origin_m) / field.spacing_m
    inside = np.all((at >= 0.0) & (at <= np.array(field.values.shape) - 1.0), axis=1)
    smooth = scipy.ndimage.map_coordinates(field.values, at.T, order=2, prefilter=False, mode="nearest")
    return np.where(inside, smooth, np.inf)


def _at_rest(bone: Bone, points: np.ndarray) -> np.ndarray:
    """Points (k, 3) in the frame of a bone as it is placed at time 0."""
    if bone.motion is None:
        return points
    rotation, shift = bone.motion.placement(np.zeros(1))
    return (points - shift[0]) @ rotation[0]


def ties_of(attachments: Sequence[Attachment], mesh: HexMesh, place: np.ndarray) -> Ties:
    """Springs between patches of the surface and bones, as a matrix between the nodes of each patch."""
    node, column, stiffness, bone, length, row_sum = [], [], [], [], [], []
    first = 0
    for number, attachment in enumerate(attachments):
        used, counts, columns, values, sums = _tied(
            mesh.hexes, attachment.points.element, attachment.points.natural, attachment.areas_m2, attachment.stiffness_Pa_m
        )
        node.append(used)
        bone.append(np.full(len(used), number))
        column.append(columns + first)
        stiffness.append(values)
        row_sum.append(sums)
        length.append(counts)
        first += len(used)
    nodes = np.concatenate([*node, np.zeros(0, dtype=np.int64)]).astype(np.int64)
    return Ties(
        node=place[nodes],
        bone=np.concatenate([*bone, np.zeros(0)]).astype(np.int64),
        position=np.ascontiguousarray(mesh.points[nodes]),
        start=np.concatenate([[0], np.cumsum(np.concatenate([*length, np.zeros(0)]))]).astype(np.int64),
        column=np.concatenate([*column, np.zeros(0)]).astype(np.int64),
        stiffness=np.concatenate([*stiffness, np.zeros(0)]).astype(float),
        row_sum=np.concatenate([*row_sum, np.zeros(0)]),
        total=np.array([values.sum() for values in stiffness], dtype=float),
        normal=np.array([_normal_of(mesh, attachment) for attachment in attachments]).reshape(-1, 3),
        excess=np.array([_excess_of(attachment) for attachment in attachments], dtype=float),
        bone_stiffness=np.array([attachment.bone_stiffness_N_m for attachment in attachments], dtype=float),
        shift=np.zeros((len(attachments), 3)),
        moved=np.zeros((len(nodes), 3)),
        moves=np.array([attachment.motion is not None for attachment in attachments], dtype=np.int64),
    )


def _excess_of(attachment: Attachment) -> float:
    """Stiffness along the normal of a patch over that along the patch, less 1."""
    normal = attachment.normal_stiffness_Pa_m
    return 0.0 if normal is None else normal / attachment.stiffness_Pa_m - 1.0


def _normal_of(mesh: HexMesh, attachment: Attachment) -> np.ndarray:
    """Mean unit normal (3,) of a patch; zero where its springs are the same in all directions."""
    if attachment.normal_stiffness_Pa_m is None:
        return np.zeros(3)
    normal = attachment.areas_m2 @ surface_normals(mesh, attachment.points)
    return np.asarray(normal / np.linalg.norm(normal))


@kept(16)
@store_answers(sources=("fem/solve/bones.py", "fem/mesh/hexmesh.py"))
def _tied(
    hexes: np.ndarray, element: np.ndarray, natural: np.ndarray, areas_m2: np.ndarray, stiffness_Pa_m: float
) -> tuple[np.ndarray, ...]:
    """The nodes (k,) that springs at points of elements hold; and, of the stiffness between them, how many entries each row has,
    their columns and values, and the sums of the rows.
    """
    weights, nodes = shape_functions(natural), hexes[element]
    share = stiffness_Pa_m * areas_m2[:, None, None] * weights[:, :, None] * weights[:, None, :]
    used, index = np.unique(nodes, return_inverse=True)
    index = index.reshape(nodes.shape)
    rows = np.broadcast_to(index[:, :, None], share.shape).ravel()
    columns = np.broadcast_to(index[:, None, :], share.shape).ravel()
    matrix = scipy.sparse.coo_matrix((share.ravel(), (rows, columns)), shape=(len(used), len(used))).tocsr()
    # of a face's element four corners have no weight but rounding
    matrix.data[np.abs(matrix.data) < 1e-12 * matrix.data.max(initial=0.0)] = 0.0
    matrix.eliminate_zeros()
    some = np.flatnonzero(np.diff(matrix.indptr))
    matrix = matrix[some][:, some]
    return used[some], np.diff(matrix.indptr), matrix.indices, matrix.data, np.asarray(matrix.sum(axis=1)).ravel()


def placements(motions: Sequence[RigidMotion | None], instants: np.ndarray) -> np.ndarray:
    """Where bones are and how they move at instants (k,) s: (k, bones, PLACEMENT)."""
    placed = np.zeros((len(instants), len(motions), PLACEMENT))
    placed[:, :, [ROTATION, ROTATION + 4, ROTATION + 8]] = 1.0
    for number, motion in enumerate(motions):
        if motion is None:
            continue
        rotation, shift = motion.placement(instants)
        before = motion.placement(instants - 0.5 * SPEED_INTERVAL_S)
        after = motion.placement(instants + 0.5 * SPEED_INTERVAL_S)
        turning = np.einsum("tij,tkj->tik", (after[0] - before[0]) / SPEED_INTERVAL_S, rotation)  # R' R^T, skew
        spin = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
        placed[:, number, ROTATION:SHIFT] = rotation.reshape(-1, 9)
        placed[:, number, SHIFT:SPIN] = shift
        placed[:, number, SPIN:SPEED] = spin
        # x' = s' + R' X = (s' - spin x s) + spin x x
        placed[:, number, SPEED:] = (after[1] - before[1]) / SPEED_INTERVAL_S - np.cross(spin, shift)
    return placed
