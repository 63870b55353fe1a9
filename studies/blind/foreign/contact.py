"""A rigid tool of the implicit solver as a signed distance, and the forces of a surface that it touches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

SHARP_EDGE_SHARE = 1.0 / 60.0  # of the tool's radius: an edge that is rounded by this passes for sharp
STICKING_MM = 0.005  # Surfaces that stick move against each other by no more, elastically.
SMALLEST_LENGTH_MM = 1e-12


@dataclass(frozen=True)
class RigidTool:
    """A rigid tool on the axis: a flat cylinder with a rounded edge, or a sphere.

    Attributes
    ----------
    shape : "flat-cylinder" or "sphere".
    edge_mm : radius of the rounding; 0 is sharp. A cylinder only.
    friction : Coulomb's coefficient.
    """

    shape: str
    radius_mm: float
    edge_mm: float = 0.0
    friction: float = 0.0

    @property
    def rounding_mm(self) -> float:
        """The rounding of the edge that is computed."""
        return self.edge_mm or SHARP_EDGE_SHARE * self.radius_mm

    def surface(self, x: np.ndarray, tip_mm: float) -> ToolSurface:
        """The tool with its lowest point at a height, seen from places (..., 2): radius and height [mm]."""
        if self.shape == "sphere":
            away = x - np.array([0.0, tip_mm + self.radius_mm])
            size = np.maximum(np.linalg.norm(away, axis=-1), SMALLEST_LENGTH_MM)
            return ToolSurface(size - self.radius_mm, away / size[..., None], 1.0 / size)
        rounding = self.rounding_mm
        out = np.stack([x[..., 0] - (self.radius_mm - rounding), (tip_mm + rounding) - x[..., 1]], axis=-1)
        beyond = np.maximum(out, 0.0)
        size = np.linalg.norm(beyond, axis=-1)
        outside = size > SMALLEST_LENGTH_MM
        safe = np.where(outside, size, 1.0)
        side = out[..., 0] > out[..., 1]
        normal = np.where(outside[..., None], beyond / safe[..., None], np.stack([side, ~side], axis=-1).astype(float))
        distance = np.where(outside, size, out.max(axis=-1)) - rounding
        corner = (out > 0.0).all(axis=-1)
        return ToolSurface(distance, normal * np.array([1.0, -1.0]), np.where(corner, 1.0 / safe, 0.0))


class ToolSurface(NamedTuple):
    """Signed distance of the tool from places, its gradient, and its curvature across the gradient."""

    distance: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray


class SurfaceLine(NamedTuple):
    """A line of the specimen's surface, at f edges with q points.

    Attributes
    ----------
    weight (f, q) : area at rest [mm^2].
    vector (f, q, 2, 18) : shape functions of nine nodes, r and z in turn.
    dofs (f, 18) : their places in the vector of all displacements.
    at_rest (f, q, 2) : where the points are [mm].
    """

    weight: np.ndarray
    vector: np.ndarray
    dofs: np.ndarray
    at_rest: np.ndarray

    def position(self, u: np.ndarray) -> np.ndarray:
        """Where the points are now (f, q, 2) [mm]."""
        return self.at_rest + np.einsum("fqia,fa->fqi", self.vector, u[self.dofs])

    def lump(self, values: np.ndarray, size: int) -> np.ndarray:
        """Values of the edges' displacements (f, 18) added up (size,)."""
        return np.bincount(self.dofs.ravel(), values.ravel(), size)


class Push(NamedTuple):
    """The forces of a tool.

    Attributes
    ----------
    forces (f, 18) : on the displacements of the edges [N].
    stiffness (f, 18, 18) : minus their derivative.
    by_tool (f, 18) : their derivative by the tool's way down.
    total_N : force of the tool; by_u (f, 18), total_by_tool : its derivatives.
    slip (f, q) : the elastic part of the sideways displacement [mm].
    """

    forces: np.ndarray
    stiffness: np.ndarray
    by_tool: np.ndarray
    total_N: float
    by_u: np.ndarray
    total_by_tool: float
    slip: np.ndarray


def push(
    tool: RigidTool, line: SurfaceLine, x: np.ndarray, tip_mm: float, penalty: float, moved: np.ndarray, old_slip: np.ndarray
) -> Push:
    """The forces of a tool on a line whose points are at x (f, q, 2).

    Parameters
    ----------
    penalty : pressure over depth [N/mm^3], by the area at rest.
    moved (f, q, 2) : displacement relative to the tool since the last instant, when the elastic slip was ``old_slip``.
    """
    distance, n, curvature = tool.surface(x, tip_mm)
    touches = distance < 0.0
    depth = np.where(touches, -distance, 0.0)
    t = np.stack([n[..., 1], -n[..., 0]], axis=-1)
    nn, tt = n[..., :, None] * n[..., None, :], t[..., :, None] * t[..., None, :]
    force = penalty * depth[..., None] * n
    slope = -penalty * touches[..., None, None] * (nn - (depth * curvature)[..., None, None] * tt)
    slip = np.zeros(depth.shape)
    if tool.friction > 0.0:
        trial = old_slip + np.einsum("fqi,fqi->fq", moved, t)
        sticks = touches & (np.abs(trial) <= STICKING_MM)
        slip = np.where(touches, np.clip(trial, -STICKING_MM, STICKING_MM), 0.0)
        share = tool.friction * penalty * slip / STICKING_MM
        force = force - (share * depth)[..., None] * t
        stiff = np.where(sticks, tool.friction * penalty * depth / STICKING_MM, 0.0)
        slope = slope - stiff[..., None, None] * tt + share[..., None, None] * t[..., :, None] * n[..., None, :]
    w, N = line.weight, line.vector
    return Push(
        forces=np.einsum("fq,fqi,fqia->fa", w, force, N),
        stiffness=np.einsum("fq,fqia,fqij,fqjb->fab", w, N, -slope, N, optimize=True),
        by_tool=np.einsum("fq,fqi,fqia->fa", w, slope[..., 1], N),  # A tool that goes down sees the points come up.
        total_N=-float(np.einsum("fq,fq->", w, force[..., 1])),
        by_u=-np.einsum("fq,fqj,fqja->fa", w, slope[..., 1, :], N),
        total_by_tool=-float(np.einsum("fq,fq->", w, slope[..., 1, 1])),
        slip=slip,
    )
