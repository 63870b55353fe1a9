"""Smooth surface of the body that follows the mesh, as pyvista data in mm."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy

from explicitfe.app.view.scene.carried import CarriedPoints
from explicitfe.app.view.scene.shown_field import ShownField
from explicitfe.app.view.smooth import SHARP_EDGE_DEG, SmoothSurface
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.results.files import Result
from explicitfe.results.measure.sections import Y

if TYPE_CHECKING:
    import pyvista

# A face is divided in four so often, and less where there would be more faces than this.
MOST_DIVISIONS, MOST_FACES = 2, 120_000
# A face in the plane of the cut has its corners there, but for this share of the body.
IN_CUT_SHARE = 1e-6


class BodySurface:
    """The surface of a body, or of its half behind a plane, cut where the tissue is at rest.

    Parameters
    ----------
    mesh : of the result.
    cut_y : y of the plane, m; None for the whole body.
    round_edges : as of :meth:`SmoothSurface.of`.

    Attributes
    ----------
    drawn : the surface as pyvista draws it; :meth:`move` places it.
    lines : the edges of the mesh on the surface.
    """

    def __init__(self, mesh: HexMesh, cut_y: float | None, round_edges: bool) -> None:
        import pyvista

        self.mesh = mesh
        grid = hex_grid(mesh.points, mesh.hexes) if cut_y is None else _half(mesh, cut_y)
        skin = grid.extract_surface(algorithm="dataset_surface")
        points, quads = np.array(skin.points, dtype=float), _quads(skin)
        in_cut = np.zeros(len(quads), dtype=np.int64)
        if cut_y is not None:
            in_cut[:] = (np.abs(points[quads, Y] - cut_y) < IN_CUT_SHARE * np.ptp(mesh.points)).all(axis=1)
        levels = max((level for level in range(MOST_DIVISIONS + 1) if len(quads) * 4**level <= MOST_FACES), default=0)
        smooth = SmoothSurface.of(points, quads, in_cut, levels=levels, round_edges=round_edges)
        matrix = (smooth.matrix @ CarriedPoints.at(mesh, points).matrix(mesh.node_count)).tocsr()
        surface = pyvista.PolyData.from_regular_faces(1e3 * (matrix @ mesh.points), smooth.quads)
        surface.cell_data["in_cut"] = smooth.group
        # A point of a sharp edge is there once for each side, so that neither is shaded like the other.
        self.drawn = surface.compute_normals(
            feature_angle=SHARP_EDGE_DEG,
            split_vertices=True,
            consistent_normals=False,
        )
        self._matrix = matrix[self.drawn.point_data["pyvistaOriginalPointIds"]]
        self.drawn.clear_point_data()
        ends = np.unique(smooth.lines)
        self.lines = pyvista.PolyData(surface.points[ends], lines=_pairs(np.searchsorted(ends, smooth.lines)))
        self._line_matrix = matrix[ends]

    def move(self, displacement: np.ndarray) -> None:
        """Place the surface for displacements (n, 3) m of the nodes."""
        places = 1e3 * (self.mesh.points + displacement)
        self.drawn.points = self._matrix @ places
        self.drawn.compute_normals(cell_normals=False, consistent_normals=False, inplace=True)
        self.lines.points = self._line_matrix @ places

    def paint(self, field: ShownField, result: Result, step: int) -> None:
        """Give the surface the values of a field at a sample; one of the elements has at a node the mean of those around it."""
        values = field.values(result, step)
        if field.kind == "cell":
            values = self._to_nodes @ values
        self.drawn.point_data["shown"] = self._matrix @ values

    @cached_property
    def _to_nodes(self) -> scipy.sparse.csr_array:
        corners, elements = self.mesh.hexes.ravel(), np.repeat(np.arange(self.mesh.element_count), 8)
        share = 1.0 / np.bincount(corners, minlength=self.mesh.node_count)[corners]
        return scipy.sparse.csr_array((share, (corners, elements)), shape=(self.mesh.node_count, self.mesh.element_count))

    def outline(self) -> np.ndarray:
        """The edge of the cut face at rest, lines (k, 3) mm after rows of NaN."""
        cut = self.drawn.extract_cells(self.drawn.cell_data["in_cut"] == 1).extract_surface(algorithm="dataset_surface")
        edge = cut.extract_feature_edges(feature_edges=False, manifold_edges=False).strip(join=True)
        places = np.array(edge.points, dtype=float)
        return np.concatenate(
            [np.vstack([np.full(3, np.nan), places[cell.point_ids]]) for cell in edge.cell] or [np.zeros((0, 3))]
        )


def hex_grid(points: np.ndarray, hexes: np.ndarray) -> pyvista.UnstructuredGrid:
    """Hexes as pyvista takes them."""
    import pyvista

    return pyvista.UnstructuredGrid({pyvista.CellType.HEXAHEDRON: hexes}, points)


def _half(mesh: HexMesh, cut_y: float) -> pyvista.UnstructuredGrid:
    """The part of a mesh behind a plane: whole elements if the plane goes between them."""
    y, thin = mesh.points[mesh.hexes, Y] - cut_y, IN_CUT_SHARE * np.ptp(mesh.points)
    if not np.any((y.min(axis=1) < -thin) & (y.max(axis=1) > thin)):
        return hex_grid(mesh.points, mesh.hexes[y.mean(axis=1) > 0.0])
    return hex_grid(mesh.points, mesh.hexes).clip(normal="y", origin=(0.0, cut_y, 0.0), invert=False)


def _quads(surface: pyvista.PolyData) -> np.ndarray:
    """The faces (f, 4) of a surface of triangles and quads; the last point of a triangle is repeated."""
    import pyvista

    cells = surface.GetPolys()
    begin, points = (np.asarray(pyvista.convert_array(part)) for part in (cells.GetOffsetsArray(), cells.GetConnectivityArray()))
    last = begin[1:] - 1
    return points[np.minimum(begin[:-1, None] + np.arange(4), last[:, None])].astype(np.int64)


def _pairs(ends: np.ndarray) -> np.ndarray:
    return np.column_stack([np.full(len(ends), 2), ends]).ravel()
