"""A rigid tool of revolution on the surface of a section, and the assembly of a banded system of equations."""

from __future__ import annotations

import numpy as np

from explicitfe.platform.compiled.jit import kernel


@kernel
def touch(u, depth, tool, surface, anchors, forces, stiffness, tractions):
    """Nodal forces (k, 7) of the surface on r, z of three nodes and on the depth, and their derivatives (k, 7, 7).

    Parameters
    ----------
    tool : height of the surface, radius of the flat face, rounding of its edge [m], 1 for a plane, normal and tangential
        stiffness [Pa/m], coefficient of friction, distance in which the onset of contact is rounded [m].
    anchors : (k, 4) place r, z and tool depth [m] of the last equilibrium, and the tangential traction [Pa] there.
    tractions : (k, 2) receives the tangential traction and the pressure [Pa].
    """
    for p in range(len(surface.areas)):
        r, z = surface.places[p, 0], surface.places[p, 1]
        for a in range(3):
            node = surface.nodes[p, a]
            r += surface.shape[p, a] * u[2 * node]
            z += surface.shape[p, a] * u[2 * node + 1]
        above = tool[0] - depth - z  # height of the lowest point of the tool above the point
        nr, nz, curvature = 0.0, -1.0, 0.0
        gap = above
        out = r - tool[1]
        if tool[3] == 0.0 and out > 0.0:
            down = above + tool[2]
            if down > 0.0:
                distance = np.sqrt(out * out + down * down)
                gap, nr, nz, curvature = distance - tool[2], out / distance, -down / distance, 1.0 / distance
            else:
                gap, nr, nz = out - tool[2], 1.0, 0.0
        pressure, normal, pull, along, across = 0.0, 0.0, 0.0, 0.0, 0.0
        if gap < tool[7]:
            # The onset of contact is rounded, so that Newton's method meets no kink.
            inside = gap <= -tool[7]
            pressure = tool[4] * (-gap if inside else (tool[7] - gap) ** 2 / (4.0 * tool[7]))
            normal = tool[4] * (1.0 if inside else (tool[7] - gap) / (2.0 * tool[7]))
            slip = -nz * (r - anchors[p, 0]) + nr * (z - anchors[p, 1] + depth - anchors[p, 2])
            pull, along = anchors[p, 3] + tool[5] * slip, tool[5]
            limit = tool[6] * pressure
            if abs(pull) > limit:
                sign = 1.0 if pull > 0.0 else -1.0
                pull, along, across = sign * limit, 0.0, -sign * tool[6] * normal
        tractions[p, 0], tractions[p, 1] = pull, pressure
        fr, fz = -pressure * nr - nz * pull, -pressure * nz + nr * pull
        tr, tz = -nz, nr
        by_slip, by_gap = along - pressure * curvature, across
        rr = normal * nr * nr + by_slip * tr * tr + by_gap * tr * nr - pull * curvature * nr * tr
        rz = normal * nr * nz + by_slip * tr * tz + by_gap * tr * nz - pull * curvature * nr * tz
        zr = normal * nz * nr + by_slip * tz * tr + by_gap * tz * nr - pull * curvature * nz * tr
        zz = normal * nz * nz + by_slip * tz * tz + by_gap * tz * nz - pull * curvature * nz * tz
        area = surface.areas[p]
        for a in range(7):
            N, i = (surface.shape[p, a // 2], a % 2) if a < 6 else (1.0, 1)
            forces[p, a] = area * N * (fr if i == 0 else fz)
            for b in range(7):
                M, j = (surface.shape[p, b // 2], b % 2) if b < 6 else (1.0, 1)
                slope = (rr if j == 0 else rz) if i == 0 else (zr if j == 0 else zz)
                stiffness[p, a, b] = area * N * M * slope


@kernel
def assemble(numbers, forces, stiffness, diagonal, rows, matrix, column, row):
    """Add forces (m, k) and stiffness (m, k, k) of parts with unknowns ``numbers`` (m, k) to the system.

    Parameters
    ----------
    numbers : -1 is held, and the number of unknowns stands for the tool.
    matrix : in band storage of LAPACK, with its diagonal in row ``diagonal``; entries above its first row are left out.
    rows : (n + 1,) receives the forces, the last one on the tool.
    column, row : (n + 1,) derivatives by the tool's depth, and of the force on the tool.
    """
    last = len(rows) - 1
    for m in range(len(numbers)):
        for a in range(numbers.shape[1]):
            i = numbers[m, a]
            if i < 0:
                continue
            rows[i] += forces[m, a]
            for b in range(numbers.shape[1]):
                j = numbers[m, b]
                if j < 0:
                    continue
                if i == last and j == last:
                    column[last] += stiffness[m, a, b]
                elif j == last:
                    column[i] += stiffness[m, a, b]
                elif i == last:
                    row[j] += stiffness[m, a, b]
                elif diagonal + i >= j:
                    matrix[diagonal + i - j, j] += stiffness[m, a, b]


@kernel
def add_forces(numbers, forces, rows):
    """Add forces (m, k) to the unknowns."""
    for m in range(len(numbers)):
        for a in range(numbers.shape[1]):
            if numbers[m, a] >= 0:
                rows[numbers[m, a]] += forces[m, a]
