"""Arrays for contact of deformable surfaces with each other and with bones; see ``arrays.py`` and ``fem/forces``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Entries of ``Surfaces.numbers``: twice how far a node may move before faces near each other are searched again [m]; Coulomb's
# coefficient; faces whose normals have a larger cosine are skipped, as they are on opposite sides of a wall; damping ratio;
# factor by which a damper stiffens contact for the stable step; how far a node may move in a step, so that no face is passed
# [m]; speed of the fastest node [m/s]; how deep a point that begins to touch a face may have come in the last step [m].
SKIN, RUBBING, ALIKE, ZETA, STIFFER, FARTHEST, SPEED, REACH, NUMBERS = range(9)
FACES_NEAR = 64  # faces kept for each face: in a fold of a fine mesh there are two dozen
TRIANGLES_NEAR = 24  # triangles kept for each point: around a node of a surface there are 6 to 16
CELLS = 16  # of the search along each direction


# Points of a face at which it touches bones: so many along each edge, with the corners.
POINTS_ALONG_EDGE = 4
CONTACT_POINTS = POINTS_ALONG_EDGE**2


class Surfaces(NamedTuple):
    """Free surfaces of deformable bodies: k nodes, f faces, and q points of these that may touch other faces."""

    node: np.ndarray  # row of each node, int64, (k,)
    user: np.ndarray  # its number in the user's numbering, int64, (k,)
    area: np.ndarray  # of the surface that belongs to it [m^2], (k,)
    position: np.ndarray  # its reference position [m], (k, 3)
    face: np.ndarray  # corners of each face, counter-clockwise from outside, numbers among the k nodes, int64, (f, 4)
    across: np.ndarray  # the face on the other side of each edge, -1 for none, and which of its edges that is, int64, (f, 4, 2)
    deepest: np.ndarray  # how deep a point may lie below each face when it begins to touch it [m], (f,)
    body: np.ndarray  # body of each face, int64, (f,)
    stiffness: np.ndarray  # of contact with each face at first touch [Pa/m], (f,)
    growth: np.ndarray  # depth in each face at which pressure over depth has doubled [m], (f,)
    own: np.ndarray  # faces that the points of a face never touch, rising, int64, (entries,)
    own_start: np.ndarray  # first entry of each face, and the end, int64, (f + 1,)
    point_face: np.ndarray  # face of each point, rising, int64, (q,)
    share: np.ndarray  # of the corners of its face in each point, (q, 4)
    part: np.ndarray  # half of the area of each point [m^2], (q,)
    mass: np.ndarray  # that moves with each point [kg], (q,)
    numbers: np.ndarray  # (NUMBERS,)
    held: np.ndarray  # face that each point touches until it has left it, -1 for none, int64, (q,)
    # Work arrays.
    place: np.ndarray  # positions of the nodes now [m], (k, 3)
    seen: np.ndarray  # positions at the last search [m], (k, 3); NaN before the first one
    middle: np.ndarray  # middles of the faces now [m], (f, 3)
    low: np.ndarray  # bounds of the boxes in which points may touch the faces until the next search [m], (f, 3)
    high: np.ndarray
    near: np.ndarray  # faces near each face that may touch it, int32, (f, FACES_NEAR)
    near_count: np.ndarray  # how many, int64, (f,)
    normal: np.ndarray  # outward unit normals of the faces at the last search, (f, 3)
    looked: np.ndarray  # positions of the nodes when the triangles near points were noted [m], (k, 3); NaN before the first time
    option: np.ndarray  # triangles that each point may touch, 4 times the face plus the corner, int32, (q, TRIANGLES_NEAR)
    options: np.ndarray  # how many, int64, (q,)
    waiting: np.ndarray  # points that may touch one, rising, int64, (q,)
    waiting_count: np.ndarray  # how many, int64, (1,)
    trial: np.ndarray  # triangles near one point, int64, (4 FACES_NEAR,)
    distance: np.ndarray  # its distance from them [m], (4 FACES_NEAR,)
    close: np.ndarray  # of the faces near a face those that it may touch now, int64, (FACES_NEAR,)
    active: np.ndarray  # faces that are near another one, rising, int64, (f,)
    active_count: np.ndarray  # how many, int64, (1,)
    head: np.ndarray  # first face of each cell of the search, -1 for none, int64, (CELLS ** 3,)
    chain: np.ndarray  # next face of the same cell, int64, (f,)
    touching: np.ndarray  # points that touch a face now, int64, (q,)
    touches: np.ndarray  # how many, int64, (1,)
    touched: np.ndarray  # the face that each of them touches, int64, (q,)
    weight: np.ndarray  # of the corners of that face, (q, 4)
    stiff: np.ndarray  # spring at first touch [N/m], depth at which force over depth has doubled [m], damper [N s/m], (q, 3)
    out: np.ndarray  # unit vector out of the face, and depth [m], (q, 4)
    pairs: np.ndarray  # deepest point of each pair of bodies since the last sample [m], (bodies, bodies)
    brake: np.ndarray  # damper and friction force on each of them [N], and its power at the velocity before [W], (q, 4)


class Bones(NamedTuple):
    """Rigid surfaces by their signed distance on grids, and the faces of the body's surface that may touch them, at points.

    Faces stand in B blocks of W, each block in one part of the body; a lane without a face has no springs. A face has
    P = CONTACT_POINTS points.
    """

    begin: np.ndarray  # first block of each part, and the end, int64, (parts + 1,)
    rows: np.ndarray  # where the node rows of the corners begin, uint32, (B, 4, W)
    own_rows: np.ndarray  # the same, counted from the first row of the part
    face: np.ndarray  # number of each face; -1 for none, int64, (B, W)
    node: np.ndarray  # number of each corner among the nodes of these faces, int64, (B, 4, W)
    user: np.ndarray  # these nodes in the user's numbering, int64, (k,)
    area: np.ndarray  # of the surface that belongs to each of them [m^2], (k,)
    position: np.ndarray  # node rows: reference positions [m], (N, 4)
    share: np.ndarray  # shape functions of the corners at the points, (4, P)
    spring: np.ndarray  # k A: contact stiffness of the area of each point [N/m], (B, P, W)
    damper: np.ndarray  # 2 sqrt(m / (k A)) for a damping ratio of 1 [s], with the mean of m / A of the corners, (B, W)
    mobility: np.ndarray  # k A / m, with the mean of A / m of the corners: what an even pressure does to them [1/s^2], (B, W)
    rest_depth: np.ndarray  # how deep each point lies in each bone at rest, which does not push [m], (bones, B, P, W)
    start: np.ndarray  # first entry of each bone's grid in ``distance``, int64, (bones,)
    shape: np.ndarray  # nodes of the grid along x, y, z, int64, (bones, 3)
    origin: np.ndarray  # its first node [m], (bones, 3)
    spacing: np.ndarray  # edge of its cells [m], (bones,)
    reach: np.ndarray  # largest distance of a point of the grid from the origin of the bone's frame [m], (bones,)
    distance: np.ndarray  # signed distances, positive outside [m], of all grids one after the other
    friction: np.ndarray  # Coulomb's coefficient, (bones,)
    damping: np.ndarray  # damping ratio, (bones,)
    moves: np.ndarray  # 1 where a bone moves, int64, (bones,)
    smooth: np.ndarray  # 1 where the distance has a continuous gradient, int64, (bones,)
    speeds: np.ndarray  # bound of the speed of the rows of each part [m/s], on a line of the cache of its own, (parts, 8)
    travel: np.ndarray  # how far nodes and bones may have gone since the beginning of a course [m]; the same in all, (parts, 8)
    seen: np.ndarray  # displacements that the last course has left [m], (N, 4)
    until: np.ndarray  # how far they go until a block can touch a bone [m], (bones, B)
    until_point: np.ndarray  # the same of each point of its faces, (bones B, P)
    bent: np.ndarray  # by how much the tangential spring of each point is bent, in the frame of the bone [m],
    # (bones, B, P, 3, W), or (0, ...) without friction
    checked: np.ndarray  # contact stiffness of each face at the last stability check, over that at first touch, (bones, B, W)
    drag: np.ndarray  # force of dampers and friction on the corners [N]: work array, (bones, B, 4, 3, W)
    touching: np.ndarray  # numbers of the pairs of a bone and a block that touch: work array, int64, (bones B,)
    lanes: np.ndarray  # work array, (W,)
