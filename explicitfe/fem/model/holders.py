"""What holds a body, by name: sets of held or prescribed nodes, and patches that springs tie."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.model.model import Model


class Holder(NamedTuple):
    """A part that holds the body or moves it, and exerts a reaction force.

    Attributes
    ----------
    name : of the node set or of the tie; "held" or "prescribed" for nodes of no named set.
    nodes : (k,) the nodes whose reaction forces add up, each in one holder only; none for a tie.
    place_m : (3,) mean reference position, m.
    motion : of the bone or foundation of a tie; None where it is fixed, and for nodes.
    """

    name: str
    nodes: np.ndarray
    place_m: np.ndarray
    motion: RigidMotion | None = None

    def displacement(self, times_s: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """How far the holder has moved at times (t,) s, (t, 3) m; ``displacement`` (t, n, 3) m is that of the body."""
        if len(self.nodes):
            return np.asarray(displacement[:, self.nodes].mean(axis=1))
        if self.motion is None:
            return np.zeros((len(times_s), 3))
        rotation, shift = self.motion.placement(times_s)
        return np.asarray(rotation @ self.place_m + shift - self.place_m)


def holders_of(model: Model) -> tuple[Holder, ...]:
    """The holders of a model, sets of nodes first, then its attachments; their names differ.

    A node in several sets of ``model.fixed`` belongs to the first of them, so that the forces of all holders add up to the total.
    """
    mesh = model.mesh
    held, prescribed = model.held.any(axis=1), np.zeros(mesh.node_count, dtype=bool)
    if model.motion is not None:
        prescribed[model.motion.nodes] = True
    free = held | prescribed
    holders: list[Holder] = []
    names: set[str] = set()

    def add(name: str, nodes: np.ndarray, place_m: np.ndarray, motion: RigidMotion | None = None) -> None:
        number, unique = 2, name
        while unique in names:
            unique, number = f"{name}.{number}", number + 1
        names.add(unique)
        holders.append(Holder(unique, nodes, place_m, motion))

    def add_nodes(name: str, members: np.ndarray) -> None:
        nodes = np.flatnonzero(members & free)
        if len(nodes):
            add(name, nodes, mesh.points[nodes].mean(axis=0))
            free[nodes] = False

    for name in model.fixed:
        add_nodes(name, np.isin(np.arange(mesh.node_count), mesh.nodes_of(name)))
    add_nodes("held", ~prescribed)
    add_nodes("prescribed", prescribed)
    for tie in model.attachments:
        add(tie.name, np.zeros(0, dtype=np.int64), np.average(tie.points.position, axis=0, weights=tie.areas_m2), tie.motion)
    return tuple(holders)
