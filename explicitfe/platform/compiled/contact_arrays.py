"""Arrays for contact between deformable surfaces; see ``arrays.py`` and ``fem/forces/surfaces.py``."""

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
