"""Computing order of nodes and elements: neighbours in space become neighbours in memory."""

from __future__ import annotations

import numpy as np
import scipy

from explicitfe.platform.host.stored import store_answers


@store_answers(sources=("fem/mesh/order.py",))
def compute_order(hexes: np.ndarray, node_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Node order (n,) and element order (m,) for computing: entry k is the user's number of what stands at place k.

    Nodes follow the reverse Cuthill-McKee order of the mesh's edges, elements their smallest node. In a random order a step
    costs several times as much.
    """
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
    pairs = hexes[:, edges].reshape(-1, 2)
    graph = scipy.sparse.coo_array((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(node_count, node_count)).tocsr()
    nodes = scipy.sparse.csgraph.reverse_cuthill_mckee(graph + graph.T, symmetric_mode=True).astype(np.int64)
    place = np.empty(node_count, dtype=np.int64)
    place[nodes] = np.arange(node_count)
    elements = np.argsort(place[hexes].min(axis=1), kind="stable")
    return nodes, elements
