"""The closest point of a triangle."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


@leaf
def closest_on_triangle(px, py, pz, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Shares of the corners b and c of the point of a triangle that is closest to p (Ericson 2005, section 5.1.5)."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    wx, wy, wz = px - ax, py - ay, pz - az
    d1, d2 = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    wx, wy, wz = px - bx, py - by, pz - bz
    d3, d4 = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    c = d1 * d4 - d3 * d2
    if c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0
    wx, wy, wz = px - cx, py - cy, pz - cz
    d5, d6 = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    b = d5 * d2 - d1 * d6
    if b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6)
    a = d3 * d6 - d5 * d4
    if a <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        share = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - share, share
    whole = 1.0 / (a + b + c)
    return b * whole, c * whole
