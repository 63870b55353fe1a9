"""Arrays for what acts on a body from outside: follower forces, hanging weights and the air; see ``arrays.py``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class TurningLoads(NamedTuple):
    """Nodal forces that turn with the element beside their node, in the order of their profiles."""

    node: np.ndarray  # int64, (k,)
    corners: np.ndarray  # nodes of the element whose axes the force follows, int64, (k, 8)
    position: np.ndarray  # reference positions of these nodes [m], (k, 8, 3)
    force: np.ndarray  # components along the axes of the element at activation 1 [N], (k, 3)
    profile: np.ndarray  # row of the activation table, int64, (k,)


class PressedFaces(NamedTuple):
    """Faces under a pressure that follows them."""

    node: np.ndarray  # corners, counter-clockwise seen from outside, int64, (k, 4)
    position: np.ndarray  # reference positions of these [m], (k, 4, 3)
    pressure: np.ndarray  # at activation 1 [Pa], (k,)
    profile: np.ndarray  # row of the activation table, int64, (k,)


class Weights(NamedTuple):
    """Weights that hang from nodes on strings along gravity; each moves along its string only."""

    start: np.ndarray  # first entry of each weight and the end, int64, (weights + 1,)
    node: np.ndarray  # node of each entry, int64, (entries,)
    share: np.ndarray  # of the string's pull that each entry gets, (entries,)
    down: np.ndarray  # unit vector along gravity, (weights, 3)
    mass: np.ndarray  # [kg], (weights,)
    weight: np.ndarray  # at activation 1 [N], (weights,)
    slack: np.ndarray  # [m], (weights,)
    profile: np.ndarray  # row of the activation table, int64, (weights,)
    state: np.ndarray  # displacement [m] and velocity [m/s] of the weight along gravity, (weights, 2)
    push: np.ndarray  # net force at the present instant, weight minus pull of the string [N], (weights,)


class Drag(NamedTuple):
    """Nodes on which forces against their velocity act."""

    node: np.ndarray  # int64, (k,)
    linear: np.ndarray  # force over velocity along x, y, z [N s/m], (k, 3)
    quadratic: np.ndarray  # force over squared velocity along x, y, z [kg/m], (k, 3)
