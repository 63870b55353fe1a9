"""The eight corners of W elements: their displacements into lanes, their forces back to the nodes."""

from __future__ import annotations

from explicitfe.fem.elements.hex8 import to_modes
from explicitfe.platform.compiled.jit import leaf
from explicitfe.platform.compiled.simd import WIDTH, gather_rows, scatter_rows


@leaf
def gather_corners(u, nodes, at):
    """Displacement components of the 8 corners, 3 x 8, of the W elements whose places of node rows start at ``at``."""
    x0, y0, z0 = gather_rows(u, nodes, at)
    x1, y1, z1 = gather_rows(u, nodes, at + WIDTH)
    x2, y2, z2 = gather_rows(u, nodes, at + 2 * WIDTH)
    x3, y3, z3 = gather_rows(u, nodes, at + 3 * WIDTH)
    x4, y4, z4 = gather_rows(u, nodes, at + 4 * WIDTH)
    x5, y5, z5 = gather_rows(u, nodes, at + 5 * WIDTH)
    x6, y6, z6 = gather_rows(u, nodes, at + 6 * WIDTH)
    x7, y7, z7 = gather_rows(u, nodes, at + 7 * WIDTH)
    return (x0, x1, x2, x3, x4, x5, x6, x7), (y0, y1, y2, y3, y4, y5, y6, y7), (z0, z1, z2, z3, z4, z5, z6, z7)


@leaf
def element_modes(u, nodes, at):
    """Seven modes of each component of node rows, for the W elements whose places of node rows start at ``at``."""
    x, y, z = gather_corners(u, nodes, at)
    return to_modes(x), to_modes(y), to_modes(z)


@leaf
def add_corner_forces(force, nodes, at, fx, fy, fz):
    """Add the corner forces of W elements to the node rows."""
    scatter_rows(force, nodes, at, fx[0], fy[0], fz[0])
    scatter_rows(force, nodes, at + WIDTH, fx[1], fy[1], fz[1])
    scatter_rows(force, nodes, at + 2 * WIDTH, fx[2], fy[2], fz[2])
    scatter_rows(force, nodes, at + 3 * WIDTH, fx[3], fy[3], fz[3])
    scatter_rows(force, nodes, at + 4 * WIDTH, fx[4], fy[4], fz[4])
    scatter_rows(force, nodes, at + 5 * WIDTH, fx[5], fy[5], fz[5])
    scatter_rows(force, nodes, at + 6 * WIDTH, fx[6], fy[6], fz[6])
    scatter_rows(force, nodes, at + 7 * WIDTH, fx[7], fy[7], fz[7])
