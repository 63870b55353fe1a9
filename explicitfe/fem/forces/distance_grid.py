"""Signed distance to bones, interpolated between the nodes of their grids, for vectors of places."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd_lookup import absolute, entries, entry, floor, within

SHORTER = 3**-0.5  # the length of a vector over the sum of its components, at least


@leaf
def place_in_grid(bones, bone, x):
    """Where points of a bone's frame are in its grid, in spacings from its first node, and how far outside of it at least [m].

    Of a point outside of it, the nearest place inside.
    """
    scale = 1.0 / bones.spacing[bone]
    nx, ny, nz = bones.shape[bone, 0], bones.shape[bone, 1], bones.shape[bone, 2]
    gx = (x[0] - bones.origin[bone, 0]) * scale
    gy = (x[1] - bones.origin[bone, 1]) * scale
    gz = (x[2] - bones.origin[bone, 2]) * scale
    cx, cy, cz = within(gx, 0.0, nx - 1.0), within(gy, 0.0, ny - 1.0), within(gz, 0.0, nz - 1.0)
    outside = absolute(gx - cx) + absolute(gy - cy) + absolute(gz - cz)
    return (cx, cy, cz), (SHORTER * bones.spacing[bone]) * outside


@leaf
def trilinear(bones, bone, gx, gy, gz):
    """Distance and gradient at places in a grid, in spacings from its first node, trilinear between its nodes."""
    nx, ny, nz = bones.shape[bone, 0], bones.shape[bone, 1], bones.shape[bone, 2]
    i, j, k = within(floor(gx), 0.0, nx - 2.0), within(floor(gy), 0.0, ny - 2.0), within(floor(gz), 0.0, nz - 2.0)
    a, b, c = gx - i, gy - j, gz - k
    at = (i * float(ny) + j) * float(nz) + k
    d, first = bones.distance, bones.start[bone]
    (e000, e001), (e010, e011) = entries(d, at, first), entries(d, at, first + nz)
    first += ny * nz
    (e100, e101), (e110, e111) = entries(d, at, first), entries(d, at, first + nz)
    z00, z01, z10, z11 = e001 - e000, e011 - e010, e101 - e100, e111 - e110
    d00, d01, d10, d11 = e000 + c * z00, e010 + c * z01, e100 + c * z10, e110 + c * z11
    y0, y1 = d01 - d00, d11 - d10
    d0, d1 = d00 + b * y0, d10 + b * y1
    z0, z1 = z00 + b * (z01 - z00), z10 + b * (z11 - z10)
    scale = 1.0 / bones.spacing[bone]
    return d0 + a * (d1 - d0), (scale * (d1 - d0), scale * (y0 + a * (y1 - y0)), scale * (z0 + a * (z1 - z0)))


@leaf
def _share(t, k):
    """Weight of neighbour k = -1, 0, 1 in a quadratic B-spline at t, from -1/2 to 1/2, and its first two derivatives."""
    if k == 0:
        return 0.75 - t * t, -2.0 * t, -2.0
    near = 0.5 + k * t
    return 0.5 * near * near, k * near, 1.0


@leaf
def smooth_distance(bones, bone, gx, gy, gz):
    """Signed distance [m], its gradient, and its second derivatives xx, yy, zz, xy, xz, yz [1/m]: a quadratic B-spline.

    Its coefficients are the distances at the nodes of the grid: exact for a plane, while a surface of curvature C is rounded off
    by C h^2 / 8 for a spacing h. Value and gradient are continuous from cell to cell.
    """
    nx, ny, nz = bones.shape[bone, 0], bones.shape[bone, 1], bones.shape[bone, 2]
    # the nearest node, none of the outermost
    i, j, k = (
        within(floor(gx + 0.5), 1.0, nx - 2.0),
        within(floor(gy + 0.5), 1.0, ny - 2.0),
        within(floor(gz + 0.5), 1.0, nz - 2.0),
    )
    x, y, z = gx - i, gy - j, gz - k
    at, first = (i * float(ny) + j) * float(nz) + k, bones.start[bone]
    d = hx = hy = hz = xx = yy = zz = xy = xz = yz = 0.0 * x
    for p in range(-1, 2):
        x0, x1, x2 = _share(x, p)
        s00 = s01 = s02 = s10 = s11 = s20 = 0.0 * x  # sums in a plane: derivatives along y and z
        for q in range(-1, 2):
            y0, y1, y2 = _share(y, q)
            t0 = t1 = t2 = 0.0 * x  # along a line
            for r in range(-1, 2):
                z0, z1, z2 = _share(z, r)
                value = entry(bones.distance, at, first + (p * ny + q) * nz + r)
                t0, t1, t2 = t0 + z0 * value, t1 + z1 * value, t2 + z2 * value
            s00, s01, s02 = s00 + y0 * t0, s01 + y0 * t1, s02 + y0 * t2
            s10, s11, s20 = s10 + y1 * t0, s11 + y1 * t1, s20 + y2 * t0
        d, hx, hy, hz = d + x0 * s00, hx + x1 * s00, hy + x0 * s10, hz + x0 * s01
        xx, yy, zz = xx + x2 * s00, yy + x0 * s20, zz + x0 * s02
        xy, xz, yz = xy + x1 * s10, xz + x1 * s01, yz + x0 * s11
    w = 1.0 / bones.spacing[bone]
    return d, (w * hx, w * hy, w * hz), (w * w * xx, w * w * yy, w * w * zz, w * w * xy, w * w * xz, w * w * yz)
