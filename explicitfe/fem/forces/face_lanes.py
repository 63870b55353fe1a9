"""Vectors in space at the corners and points of faces, each face in a lane: a vector is three numbers, four corners a face."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, gather_rows, scatter_rows, splat, store, sum_lanes


@leaf
def corners_of(values, rows, block):
    """The vectors of node rows at the corners of a block of faces: four times three vectors of lanes."""
    at = block * (4 * WIDTH)
    return (
        gather_rows(values, rows, at),
        gather_rows(values, rows, at + WIDTH),
        gather_rows(values, rows, at + 2 * WIDTH),
        gather_rows(values, rows, at + 3 * WIDTH),
    )


@leaf
def plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@leaf
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@leaf
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@leaf
def times(a, n):
    return a * n[0], a * n[1], a * n[2]


@leaf
def at_point(bones, point, corners):
    """The vector at a point of a face from those at its corners."""
    a, b, c, d = corners
    s = bones.share
    return (
        s[0, point] * a[0] + s[1, point] * b[0] + s[2, point] * c[0] + s[3, point] * d[0],
        s[0, point] * a[1] + s[1, point] * b[1] + s[2, point] * c[1] + s[3, point] * d[1],
        s[0, point] * a[2] + s[1, point] * b[2] + s[2, point] * c[2] + s[3, point] * d[2],
    )


@leaf
def spread(bones, point, sums, f):
    """Add the force at a point of a face to the sums at its corners."""
    a, b, c, d = sums
    s = bones.share
    return (
        plus(a, times(s[0, point], f)),
        plus(b, times(s[1, point], f)),
        plus(c, times(s[2, point], f)),
        plus(d, times(s[3, point], f)),
    )


@leaf
def scatter_corners(values, rows, block, sums):
    """Add the forces at the corners of a block of faces to node rows."""
    at = block * (4 * WIDTH)
    for corner in range(4):
        f = sums[corner]
        scatter_rows(values, rows, at + corner * WIDTH, f[0], f[1], f[2])


@leaf
def no_vectors():
    """Vectors of zero at the corners of a block of faces."""
    nothing = splat(0.0), splat(0.0), splat(0.0)
    return nothing, nothing, nothing, nothing


@leaf
def each_minus(a, b):
    return minus(a[0], b[0]), minus(a[1], b[1]), minus(a[2], b[2]), minus(a[3], b[3])


@leaf
def each_plus(a, b):
    return plus(a[0], b[0]), plus(a[1], b[1]), plus(a[2], b[2]), plus(a[3], b[3])


@leaf
def dots(a, b):
    """Sum of the products of the vectors at all corners, over all lanes."""
    return sum_lanes(dot(a[0], b[0]) + dot(a[1], b[1]) + (dot(a[2], b[2]) + dot(a[3], b[3])))


@leaf
def store_many(array, at, values):
    """Write three vectors one after the other."""
    store(array, at, values[0])
    store(array, at + WIDTH, values[1])
    store(array, at + 2 * WIDTH, values[2])
