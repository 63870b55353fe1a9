"""The bones of a model as arrays for the kernels: positions, contact faces and attachments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.forces.bone import CONTACT_STIFFNESS_PA_M
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces, shape_functions
from explicitfe.fem.mesh.surface_points import surface_areas, surface_normals
from explicitfe.fem.model.model import Attachment, Bone
from explicitfe.platform.compiled.arrays import PLACEMENT, ROTATION, SHIFT, SPEED, SPIN, Nodes, Part, Ties, zeros
from explicitfe.platform.compiled.contact_arrays import CONTACT_POINTS, POINTS_ALONG_EDGE, Bones
from explicitfe.platform.compiled.simd import ROW, WIDTH
from explicitfe.platform.host.kept import kept
from explicitfe.platform.host.stored import store_answers

# Where a bone begins beyond the depth at rest: were it there, rounding would tell which points touch before anything moves.
REST_GAP_M = 1e-12
BANDS_M = (0.5e-3, 1.5e-3, 3e-3, 6e-3, 10e-3)  # of the distance of faces from bone at rest: see ``bones_of``
_NEVER_M = 1e3  # rest depth of a face that touches nothing
SPEED_INTERVAL_S = 1e-6  # over which the speed of a moving bone is differenced


def bones_of(
    bones: Sequence[Bone], mesh: HexMesh, place: np.ndarray, position: np.ndarray, masses: Nodes, parts: Sequence[Part]
) -> Bones:
    """Bones, and the faces of the body's surface that may touch them.

    Parameters
    ----------
    mesh : the body.
    place : (n,) row of each node in computing order.
    position : (N, 4) m. Node rows of reference positions.
    masses : of the nodes. A face of nodes alone that do not move or follow a course touches nothing.
    parts : of the body. A face belongs to the one that has its lowest row.
    """
    element, face = free_faces(mesh.hexes) if bones else (np.zeros(0, dtype=np.int64),) * 2
    quads = mesh.hexes[element[:, None], FACES[face]]
    mass, mobility = masses.mass[place, 0], masses.inverse_mass[place, :3].max(axis=1)
    quads = quads[(mobility[quads] > 0.0).any(axis=1)]
    share, areas = _points_of(mesh.points[quads])
    places = np.einsum("ap,fak->fpk", share, mesh.points[quads]).reshape(-1, 3)
    distances = np.array([_distance(bone, _at_rest(bone, places)) for bone in bones]).reshape(len(bones), *areas.shape)
    # faces of a block come to bone at one time: the same one is nearest to them, at about the same distance
    nearest = distances.min(axis=2, initial=np.inf)
    band = np.searchsorted(BANDS_M, nearest.min(axis=0, initial=np.inf))
    if bones:
        band = len(bones) * band + nearest.argmin(axis=0)
    lanes_of_parts = _in_blocks(place[quads].min(axis=1), mesh.points[quads].mean(axis=1), band, parts)
    lane = np.concatenate(lanes_of_parts)
    idle, number = lane < 0, np.maximum(lane, 0)

    def in_lanes(values: np.ndarray, without: float) -> np.ndarray:
        """Values (f, ...) of faces in lanes, (B, ..., W), with that of no face."""
        lanes = zeros((len(lane), *values.shape[1:], WIDTH), values.dtype)
        if len(lane):
            lanes[:] = np.moveaxis(values[number], 1, -1)
            np.moveaxis(lanes, -1, 1)[idle] = without
        return lanes

    nodes, corner = np.unique(quads, return_inverse=True)
    corner = corner.reshape(quads.shape)
    area = surface_areas(mesh)[nodes]
    grids = [np.ascontiguousarray(bone.field.values, dtype=float) for bone in bones]
    sizes = [grid.size for grid in grids]
    origin = np.array([bone.field.origin_m for bone in bones], dtype=float).reshape(-1, 3)
    shape = np.array([grid.shape for grid in grids], dtype=np.int64).reshape(-1, 3)
    spacing = np.array([bone.field.spacing_m for bone in bones], dtype=float)
    farthest = np.maximum(np.abs(origin), np.abs(origin + spacing[:, None] * (shape - 1)))
    # lanes without a face have the rows of another one
    rows = np.ascontiguousarray(np.moveaxis(place[quads][number] if len(lane) else np.zeros((0, WIDTH, 4)), 1, -1), np.uint32)
    blocks = [len(one) for one in lanes_of_parts]
    first_row = np.repeat([part.first for part in parts], blocks).astype(np.uint32)
    rubbing = len(bones) if any(bone.friction > 0.0 for bone in bones) else 0
    return Bones(
        begin=np.concatenate([[0], np.cumsum(blocks)]),
        rows=np.uint32(ROW) * rows,
        own_rows=np.uint32(ROW) * (rows - first_row[:, None, None]),
        face=lane,
        node=in_lanes(corner.astype(np.int64), 0),
        user=nodes.astype(np.int64),
        area=area,
        position=position,
        share=share,
        spring=in_lanes(CONTACT_STIFFNESS_PA_M * areas, 0.0),
        damper=in_lanes(2.0 * np.sqrt((mass[nodes] / area)[corner].mean(axis=1) / CONTACT_STIFFNESS_PA_M), 0.0),
        mobility=in_lanes(CONTACT_STIFFNESS_PA_M * (mobility[nodes] * area)[corner].mean(axis=1), 0.0),
        rest_depth=np.array([in_lanes(REST_GAP_M + np.maximum(0.0, -one), _NEVER_M) for one in distances]).reshape(
            len(bones), len(lane), CONTACT_POINTS, WIDTH
        ),
        start=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)[: len(bones)],
        shape=shape,
        origin=origin,
        spacing=spacing,
        reach=np.linalg.norm(farthest, axis=1),
        distance=np.concatenate([grid.ravel() for grid in grids] or [np.zeros(0)]),
        friction=np.array([bone.friction for bone in bones], dtype=float),
        damping=np.array([bone.damping for bone in bones], dtype=float),
        moves=np.array([bone.motion is not None for bone in bones], dtype=np.int64),
        smooth=np.array([bone.smooth for bone in bones], dtype=np.int64),
        speeds=zeros((len(parts), 8)),
        travel=zeros((len(parts), 8)),
        seen=np.full(position.shape, np.nan),
        until=np.full((len(bones), len(lane)), -1.0),
        until_point=np.full((len(bones) * len(lane), CONTACT_POINTS), -1.0),
        bent=zeros((rubbing, len(lane), CONTACT_POINTS, 3, WIDTH)),
        checked=zeros((len(bones), len(lane), WIDTH)),
        drag=zeros((len(bones), len(lane), 4, 3, WIDTH)),
        touching=np.zeros(len(bones) * len(lane), dtype=np.int64),
        lanes=zeros((WIDTH,)),
    )


def _in_blocks(lowest: np.ndarray, middle: np.ndarray, band: np.ndarray, parts: Sequence[Part]) -> list[np.ndarray]:
    """The faces of each part in blocks, (blocks, W) each, -1 where a lane has none.

    Parameters
    ----------
    lowest : (f,) lowest row of each face.
    middle : (f, 3) m. Where it is at rest.
    band : (f,) number; faces of a block have the same one, and are neighbours.
    """
    ends = [*(part.first for part in parts[1:]), np.inf]
    blocks = []
    for part, end in zip(parts, ends, strict=True):
        own = (lowest >= part.first) & (lowest < end)
        groups = [np.flatnonzero(own & (band == one)) for one in np.unique(band)]
        rows = [block for group in groups if len(group) for block in _halved(group, middle)]
        lanes = np.full((len(rows), WIDTH), -1)
        for lane, row in zip(lanes, rows, strict=True):
            lane[: len(row)] = row
        blocks.append(lanes)
    return blocks


def _halved(faces: np.ndarray, middle: np.ndarray) -> list[np.ndarray]:
    """Faces in blocks of W neighbours: halved across where they reach farthest, and again."""
    if len(faces) <= WIDTH:
        return [faces]
    at = middle[faces]
    order = np.argsort(at[:, np.argmax(np.ptp(at, axis=0))], kind="stable")
    half = -(-len(faces) // WIDTH) // 2 * WIDTH
    return [*_halved(np.sort(faces[order[:half]]), middle), *_halved(np.sort(faces[order[half:]]), middle)]


def state_of_bones(bones: Bones) -> dict[str, np.ndarray]:
    """What a restart needs, of each face f.

    Returns
    -------
    bent : (bones, f, P, 3) m. How far tangential springs are bent; (0, ...) without friction.
    checked : (bones, f). Contact stiffness at the last stability check.
    """
    state = {}
    for name in ("bent", "checked"):
        lanes = np.moveaxis(getattr(bones, name), -1, 2)  # (bones, B, W, ...)
        state[name] = np.zeros((len(lanes), bones.face.max(initial=-1) + 1, *lanes.shape[3:]))
        state[name][:, bones.face[bones.face >= 0]] = lanes[:, bones.face >= 0]
    return state


def restore_bones(bones: Bones, state: dict[str, np.ndarray]) -> None:
    """Take over the result of ``state_of_bones``, of a run with any number of threads; older files lack some of it."""
    bones.seen[:] = np.nan
    for name in {"bent", "checked"} & state.keys():
        for lanes, values in zip(np.moveaxis(getattr(bones, name), -1, 2), state[name], strict=False):
            lanes[bones.face >= 0] = values[bones.face[bones.face >= 0]]


def look_up_if_changed(bones: Bones, u: np.ndarray) -> None:
    """Let all faces be looked up at the next instant, unless the displacements (N, 4) m are those that the last course left."""
    if not np.array_equal(bones.seen, u):
        bones.until[:], bones.until_point[:], bones.travel[:] = -1.0, -1.0, 0.0


def _points_of(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (4, P) of the corners (f, 4, 3) m of faces at their contact points, and the areas of these (f, P), m^2.

    By the trapezoidal rule, which shares an even pressure out among the corners as their shape functions do.
    """
    places, widths = np.linspace(-1.0, 1.0, POINTS_ALONG_EDGE), np.full(POINTS_ALONG_EDGE, 2.0 / (POINTS_ALONG_EDGE - 1))
    widths[[0, -1]] *= 0.5
    r, s = (at.ravel() for at in np.meshgrid(places, places, indexing="ij"))
    sign = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    along_r, along_s = 1.0 + sign[:, :1] * r, 1.0 + sign[:, 1:] * s
    tangents = [np.einsum("ap,fak->fpk", d, corners) for d in (sign[:, :1] * along_s / 4.0, sign[:, 1:] * along_r / 4.0)]
    areas = np.linalg.norm(np.cross(*tangents), axis=2) * np.outer(widths, widths).ravel()
    return np.ascontiguousarray(along_r * along_s / 4.0), areas


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
