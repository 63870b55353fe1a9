"""Several bodies as one mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh


def join(bodies: Mapping[str, HexMesh]) -> HexMesh:
    """The meshes of several bodies as one, without common nodes.

    Parameters
    ----------
    bodies : name -> mesh, each in its place.

    Returns
    -------
    Nodes and elements body after body. Node sets and named points have the name of their body in front, ``velum.x0``; the
    node set ``velum`` has all nodes of that body. Those of a body without a name, "", stay as they are.
    """
    points, hexes, node_sets, named_points = [], [], {}, {}
    nodes = elements = 0
    for name, mesh in bodies.items():
        points.append(mesh.points)
        hexes.append(mesh.hexes + nodes)
        front = f"{name}." if name else ""
        if name:
            node_sets[name] = nodes + np.arange(mesh.node_count)
        node_sets |= {front + key: nodes + members for key, members in mesh.node_sets.items()}
        for key, point in mesh.named_points.items():
            named_points[front + key] = replace(point, element=point.element + elements)
        nodes, elements = nodes + mesh.node_count, elements + mesh.element_count
    return HexMesh(np.concatenate(points), np.concatenate(hexes), node_sets, named_points)
