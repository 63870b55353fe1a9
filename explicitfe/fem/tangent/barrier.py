"""How the forces of the barrier of forces/barrier.py change, in one element: for the few in which a corner is about to fold."""

from __future__ import annotations

from explicitfe.fem.elements.barrier import (
    LAST_RATIO,
    MODULUS,
    REST,
    THRESHOLD,
    WHOLE,
    corners_of_edges,
    edges_at,
    edges_of_corners,
)
from explicitfe.fem.tangent.arrays import (
    COMPONENTS,
    CURVATURES_NOW,
    EDGES_CHANGE,
    EDGES_NOW,
    PULLS_CHANGE,
    SLOPES_CHANGE,
    SLOPES_NOW,
    SPANS_CHANGE,
    SPANS_NOW,
)
from explicitfe.platform.compiled.jit import leaf, part_of_kernels
from explicitfe.platform.compiled.simd import WIDTH, load, load_many, splat, store


@leaf
def no_barrier_change(u, blocks, block, lane, tangents):
    """Nothing, in an element without a barrier."""


@leaf
def _put(array, at, values):
    for k in range(12):
        array[at + k] = values[k]


@leaf
def _edge(corner, which):
    """An edge (3,) of the element."""
    return corner[EDGES_NOW + which], corner[EDGES_NOW + 12 + which], corner[EDGES_NOW + 24 + which]


@leaf
def _change(work, which):
    return (
        load(work, (EDGES_CHANGE + which) * WIDTH),
        load(work, (EDGES_CHANGE + 12 + which) * WIDTH),
        load(work, (EDGES_CHANGE + 24 + which) * WIDTH),
    )


@leaf
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@leaf
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@leaf
def _slope_and_curvature(s):
    """phi' and phi'' at s = r_a / t; phi is extended linearly below ``LAST_RATIO``."""
    within = max(s, LAST_RATIO)
    left = max(1.0 - within, 0.0)
    slope = -(left * left) * (2.0 * within + 1.0) / (within * within)
    if s < LAST_RATIO:
        return slope, 0.0
    return slope, 2.0 * left * (s * s + s + 1.0) / (s * s * s)


@leaf
def _values(u, blocks, block, lane, rows, corner):
    """Put edges, spans, slopes and curvatures of an element into ``corner``; give j, sum_a D_a phi', and whether any acts."""
    for k in range(3):
        x = (
            _place(u, blocks.position, rows[block, 0, lane], k),
            _place(u, blocks.position, rows[block, 1, lane], k),
            _place(u, blocks.position, rows[block, 2, lane], k),
            _place(u, blocks.position, rows[block, 3, lane], k),
            _place(u, blocks.position, rows[block, 4, lane], k),
            _place(u, blocks.position, rows[block, 5, lane], k),
            _place(u, blocks.position, rows[block, 6, lane], k),
            _place(u, blocks.position, rows[block, 7, lane], k),
        )
        _put(corner, EDGES_NOW + 12 * k, edges_of_corners(x))
    total = 0.0
    for which in range(blocks.barrier.shape[1] - REST):
        one, two, three = edges_at(which)
        span = 0.0
        if blocks.barrier[block, REST + which, lane] > 0.0:
            span = _dot(_edge(corner, one), _cross(_edge(corner, two), _edge(corner, three)))
        corner[SPANS_NOW + which] = span
        total += span
    j = total * blocks.barrier[block, WHOLE, lane]
    moved = 0.0
    acts = False
    for which in range(blocks.barrier.shape[1] - REST):
        inverse = blocks.barrier[block, REST + which, lane]
        slope, curvature = 0.0, 0.0
        if inverse > 0.0:
            slope, curvature = _slope_and_curvature(corner[SPANS_NOW + which] * inverse / (THRESHOLD * j))
        corner[SLOPES_NOW + which], corner[CURVATURES_NOW + which] = slope, curvature
        moved += corner[SPANS_NOW + which] * slope
        acts = acts or slope < 0.0
    return j, moved, acts


@leaf
def _place(u, position, place, k):
    row = place // (COMPONENTS * WIDTH)
    return position[row, k] + u[row, k]


@leaf
def _add_group(blocks, block, lane, group, j, moved, tangents):
    """The changes along a group of directions."""
    corner, work, corners = tangents.corner, tangents.barrier, blocks.barrier.shape[1] - REST
    shift = group * (tangents.u.shape[1] * COMPONENTS * WIDTH)
    for k in range(3):
        for which in range(12):
            store(work, (PULLS_CHANGE + 12 * k + which) * WIDTH, splat(0.0))
        x = (
            _corner(tangents.u, tangents.rows[block, 0, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 1, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 2, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 3, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 4, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 5, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 6, lane], shift, k),
            _corner(tangents.u, tangents.rows[block, 7, lane], shift, k),
        )
        edges = edges_of_corners(x)
        for which in range(12):
            store(work, (EDGES_CHANGE + 12 * k + which) * WIDTH, edges[which])
    total = splat(0.0)
    for which in range(corners):
        one, two, three = edges_at(which)
        span = splat(0.0)
        if blocks.barrier[block, REST + which, lane] > 0.0:
            a, b, c = _edge(corner, one), _edge(corner, two), _edge(corner, three)
            span = (
                _dot(_change(work, one), _cross(b, c))
                + _dot(_change(work, two), _cross(c, a))
                + _dot(_change(work, three), _cross(a, b))
            )
        store(work, (SPANS_CHANGE + which) * WIDTH, span)
        total = total + span
    whole = blocks.barrier[block, WHOLE, lane]
    w = 1.0 / (THRESHOLD * j)
    j_change = (whole / j) * total  # of log j
    moved_change = splat(0.0)
    for which in range(corners):
        inverse, D, span = (
            blocks.barrier[block, REST + which, lane],
            corner[SPANS_NOW + which],
            load(work, (SPANS_CHANGE + which) * WIDTH),
        )
        slope = (corner[CURVATURES_NOW + which] * inverse * w) * (span - D * j_change)
        store(work, (SLOPES_CHANGE + which) * WIDTH, slope)
        moved_change = moved_change + corner[SLOPES_NOW + which] * span + D * slope
    factor = blocks.barrier[block, MODULUS, lane] * w * (-1.0 / 8.0)
    factor_change = -j_change
    if len(tangents.modulus) > 0:
        one = min(block * WIDTH + lane, len(tangents.modulus) - 1)
        factor_change = factor_change + load(tangents.modulus, (one * len(tangents.u) + group) * WIDTH)
    by_j = moved * whole / j
    by_j_change = (whole / j) * moved_change - by_j * j_change
    for which in range(corners):
        if blocks.barrier[block, REST + which, lane] > 0.0:
            pull = factor * (corner[SLOPES_NOW + which] - by_j)
            pull_change = pull * factor_change + factor * (load(work, (SLOPES_CHANGE + which) * WIDTH) - by_j_change)
            one, two, three = edges_at(which)
            _add_pull(corner, work, one, two, three, pull, pull_change)
            _add_pull(corner, work, two, three, one, pull, pull_change)
            _add_pull(corner, work, three, one, two, pull, pull_change)
    for k in range(3):
        f = corners_of_edges(load_many(work, (PULLS_CHANGE + 12 * k) * WIDTH, 12))
        for node in range(8):
            at = tangents.rows[block, node, lane] + k * WIDTH + shift
            store(tangents.force, at, load(tangents.force, at) + f[node])


@leaf
def _corner(changes, place, shift, k):
    return load(changes, place + k * WIDTH + shift)


@leaf
def _add_pull(corner, work, one, two, three, pull, pull_change):
    """Add the change of pull n to the force on an edge, n the cross product of the two edges after it."""
    b, c, db, dc = _edge(corner, two), _edge(corner, three), _change(work, two), _change(work, three)
    n, first, second = _cross(b, c), _cross(db, c), _cross(b, dc)
    for k in range(3):
        at = (PULLS_CHANGE + 12 * k + one) * WIDTH
        store(work, at, load(work, at) + n[k] * pull_change + pull * (first[k] + second[k]))


@part_of_kernels
def add_barrier_change(u, blocks, block, lane, tangents):
    """Add the changes of the forces of the barrier in one element."""
    corner = tangents.corner
    j, moved, acts = _values(u, blocks, block, lane, tangents.rows, corner)
    if not acts:
        return
    for group in range(len(tangents.u)):
        _add_group(blocks, block, lane, group, j, moved, tangents)
