"""Equilibrium of hyperelastic bodies in contact, by a route that shares no code with the mechanics of explicitfe.

Hexahedra with eight nodes, 2 x 2 x 2 integration points and the mean change of volume of the element, or elements with 27 nodes
and a linear change of volume. Yeoh's law,

    W = C10 (I1 J^(-2/3) - 3) + C20 (I1 J^(-2/3) - 3)^2 + K/4 (J^2 - 1 - 2 ln J),

and muscles as stress along fibres, W += sigma |F a0|. Contact is a penalty: a point that lies at a depth p in a closed surface of
triangles has the energy k A p^2 / 2. Distances are exact, and a point is inside where the surface winds around it. All forces
derive from one energy, whose minimum is found by Newton's iteration with a regularisation (Levenberg, Marquardt).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

CORNERS = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], dtype=float
)
# Corners of the sides of a hexahedron, counter-clockwise seen from outside.
SIDES = np.array([(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])
POINTS = CORNERS / np.sqrt(3.0)  # of integration
HALVES = 2.0 * np.stack(np.unravel_index(np.arange(8), (2, 2, 2)), axis=1) - 1.0  # middles of the parts of a quadratic element
DEEPEST_M = 4e-3  # points that are deeper in a surface count as outside
STIFFENING_M = 1e-4  # depth in a bone at which its springs push twice as hard as at first
LONGEST_EDGE_M = 4e-3  # of triangles of bones; larger ones are halved
LONGEST_CHANGE_M = 1e-3  # of a node in one iteration
SYMMETRIC = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}  # of SuperLU
DIFFERENCE_M = 1e-9  # over which contact forces are differenced


@dataclass(frozen=True)
class Part:
    """An energy [J] and, for groups (k, a) of nodes, its derivatives (k, a, 3) N and (k, 3 a, 3 a) N/m."""

    energy: float
    nodes: np.ndarray
    slope: np.ndarray
    stiffness: np.ndarray


Term = Callable[[np.ndarray], Part]  # of displacements (n, 3) m


def shape_values(natural: np.ndarray) -> np.ndarray:
    """Shape functions (k, 8) at natural coordinates (k, 3)."""
    return np.prod(1.0 + natural[:, None] * CORNERS, axis=2) / 8.0


def shape_slopes(natural: np.ndarray) -> np.ndarray:
    """Their derivatives (k, 8, 3)."""
    factors = 1.0 + natural[:, None] * CORNERS
    return np.stack([CORNERS[:, i] * factors[..., i - 1] * factors[..., i - 2] / 8.0 for i in range(3)], axis=2)


def _along(x: np.ndarray) -> np.ndarray:
    """Quadratic functions of one coordinate (k,) with the nodes -1, 0 and 1, and their derivatives, (2, k, 3)."""
    values = x * (x - 1.0) / 2.0, 1.0 - x * x, x * (x + 1.0) / 2.0
    return np.array([np.stack(values, axis=1), np.stack([x - 0.5, -2.0 * x, x + 0.5], axis=1)])


def quadratic_values(natural: np.ndarray) -> np.ndarray:
    """Shape functions (k, 27) with nodes on a grid, the last coordinate fastest."""
    return np.einsum("ka,kb,kc->kabc", *(_along(x)[0] for x in natural.T)).reshape(-1, 27)


def quadratic_slopes(natural: np.ndarray) -> np.ndarray:
    """Their derivatives (k, 27, 3)."""
    each = [np.einsum("ka,kb,kc->kabc", *(_along(x)[int(i == k)] for k, x in enumerate(natural.T))) for i in range(3)]
    return np.stack(each, axis=-1).reshape(-1, 27, 3)


def outer_faces(hexes: np.ndarray) -> np.ndarray:
    """The faces (k, 4) that belong to one element only."""
    every = hexes[:, SIDES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
    return every[np.sort(first[count == 1])]


def face_points(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shares (4, 4) of the corners of a face at 2 x 2 points, and their areas (f, 4) m^2."""
    at = np.column_stack([CORNERS[:4, :2] / np.sqrt(3.0), -np.ones(4)])
    shares, slopes = shape_values(at)[:, :4], shape_slopes(at)[:, :4, :2]
    along = np.einsum("qai,fak->ifqk", slopes, points[faces])
    return shares, np.linalg.norm(np.cross(along[0], along[1]), axis=2)


def node_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The area (n,) m^2 of faces that belongs to each node, the integral of its shape function."""
    shares, areas = face_points(points, faces)
    return np.bincount(faces.ravel(), (areas @ shares).ravel(), len(points))


# ---- tissue ----


@dataclass(frozen=True)
class Elements:
    """Elements of one kind.

    Attributes
    ----------
    nodes : (m, a).
    slopes, volumes : (m, g, a, 3) 1/m, (m, g) m^3. Derivatives of the shape functions at integration points, and their volumes.
    hexes : (m, p) hexahedra of the mesh in each element, with eight points each.
    spans : (m, g, r) functions that span the change of volume of an element.
    sides : (3, 8) on which side of an element of 2 x 2 x 2 hexahedra, along each axis, each corner of these is.
    """

    nodes: np.ndarray
    slopes: np.ndarray
    volumes: np.ndarray
    hexes: np.ndarray
    spans: np.ndarray
    sides: np.ndarray

    def at(self, hexes: np.ndarray, natural: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (k, a) and their shares (k, a) of points at natural coordinates (k, 3) of hexahedra (k,)."""
        element, part = np.array([np.argwhere(self.hexes == number)[0] for number in hexes]).T
        shares = shape_values(natural)
        if self.nodes.shape[1] == 27:
            shares = quadratic_values((HALVES[part] + shares @ self.sides.T) / 2.0)
        return self.nodes[element], shares


def linear(points: np.ndarray, hexes: np.ndarray) -> Elements:
    """Hexahedra with eight nodes and one change of volume each."""
    slopes, volumes = _mapped(points[hexes], shape_slopes(POINTS))
    return Elements(hexes, slopes, volumes, np.arange(len(hexes))[:, None], np.ones((len(hexes), 8, 1)), CORNERS.T)


def quadratic(points: np.ndarray, hexes: np.ndarray, cells: Sequence[int], first: int = 0) -> Elements:
    """Elements with 27 nodes and a linear change of volume, each of 2 x 2 x 2 hexahedra of a grid, which begin at ``first``."""
    number = first + np.arange(np.prod(cells)).reshape([n for count in cells for n in (count // 2, 2)])
    number = number.transpose(0, 2, 4, 1, 3, 5).reshape(-1, 8)
    sides = np.zeros((3, 8))
    for axis in range(3):  # the corners on the far side are also nodes of the neighbour there
        one, neighbour = hexes[number[:, 0]], hexes[number[:, 2 ** (2 - axis)]]
        sides[axis] = [1.0 if (one[:, [corner]] == neighbour).any(axis=1).all() else -1.0 for corner in range(8)]
    nodes = np.empty((len(number), 27), dtype=int)
    for part in range(8):
        place = np.rint((HALVES[part] + sides.T) / 2.0).astype(int) + 1
        nodes[:, place @ [9, 3, 1]] = hexes[number[:, part]]
    at = ((POINTS + HALVES[:, None]) / 2.0).reshape(-1, 3)
    spans = np.tile(np.column_stack([np.ones(len(at)), at]), (len(nodes), 1, 1))
    slopes, volumes = _mapped(points[nodes], quadratic_slopes(at))
    return Elements(nodes, slopes, volumes / 8.0, number, spans, sides)


def _mapped(corners: np.ndarray, natural: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (m, g, a, 3) by place from those by natural coordinates (g, a, 3), and the Jacobian determinants (m, g)."""
    jacobian = np.einsum("gai,mak->mgki", natural, corners)
    return np.einsum("gai,mgik->mgak", natural, np.linalg.inv(jacobian)), np.linalg.det(jacobian)


@dataclass(frozen=True)
class Tissue:
    """The energy of elements.

    Attributes
    ----------
    elements : all of one kind.
    C10, C20, bulk : Pa, of each hexahedron of the mesh.
    muscles : of each the stress Pa and the direction in the hexahedra.
    """

    elements: Elements
    C10: np.ndarray
    C20: np.ndarray
    bulk: np.ndarray
    muscles: Sequence[tuple[np.ndarray, np.ndarray]] = ()

    def __post_init__(self) -> None:
        of = np.repeat(self.elements.hexes, 8, axis=1)
        for name in ("C10", "C20", "bulk"):
            object.__setattr__(self, name, getattr(self, name)[of])
        object.__setattr__(self, "muscles", [(sigma[of], direction[of]) for sigma, direction in self.muscles])

    def stress(self, F: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """First Piola-Kirchhoff stress (m, g, 3, 3) at a pressure (m, g)."""
        J = np.linalg.det(F)
        inverse_T = np.swapaxes(np.linalg.inv(F), -1, -2)
        I1, isochoric = np.einsum("...ij,...ij->...", F, F), J ** (-2.0 / 3.0)
        shear = 2.0 * (self.C10 + 2.0 * self.C20 * (I1 * isochoric - 3.0)) * isochoric
        total = shear[..., None, None] * F + (pressure * J - shear * I1 / 3.0)[..., None, None] * inverse_T
        for sigma, direction in self.muscles:
            fibre = np.einsum("mgij,mgj->mgi", F, direction)
            pull = sigma / np.linalg.norm(fibre, axis=2)
            total += pull[..., None, None] * fibre[..., :, None] * direction[..., None, :]
        return total

    def __call__(self, u: np.ndarray) -> Part:
        """Infinite where an element is inverted."""
        nodes, slopes, volumes, spans = self.elements.nodes, self.elements.slopes, self.elements.volumes, self.elements.spans
        F = np.eye(3) + np.einsum("mai,mgak->mgik", u[nodes], slopes, optimize=True)
        J = np.linalg.det(F)
        count, size = len(F), 3 * nodes.shape[1]
        # the projection of a field on the functions that span the change of volume, as their factors
        weighted = np.linalg.solve(np.einsum("mgr,mgs,mg->mrs", spans, spans, volumes), np.einsum("mgr,mg->mrg", spans, volumes))
        mean = np.einsum("mgr,mrh,mh->mg", spans, weighted, J, optimize=True)
        if min(J.min(), mean.min()) <= 0.0:
            return Part(np.inf, nodes, np.zeros((*nodes.shape, 3)), np.zeros((count, size, size)))
        x = np.einsum("mgij,mgij->mg", F, F) * J ** (-2.0 / 3.0) - 3.0
        density = self.C10 * x + self.C20 * x * x + self.bulk / 4.0 * (mean * mean - 1.0 - 2.0 * np.log(mean))
        for sigma, direction in self.muscles:
            density += sigma * np.linalg.norm(np.einsum("mgij,mgj->mgi", F, direction), axis=2)
        pressure = np.einsum("mgr,mrh,mh->mg", spans, weighted, self.bulk / 2.0 * (mean - 1.0 / mean), optimize=True)
        slope = np.einsum("mgik,mgak,mg->mai", self.stress(F, pressure), slopes, volumes, optimize=True)
        tangent = np.empty((*F.shape, 3, 3))
        for i in range(3):
            for k in range(3):
                step = np.zeros((3, 3))
                step[i, k] = 1e-6
                tangent[..., i, k] = (self.stress(F + step, pressure) - self.stress(F - step, pressure)) / 2e-6
        tangent = tangent.reshape(count, -1, 9, 9) * volumes[..., None, None]
        each = np.zeros((count, size, size))
        for g in range(volumes.shape[1]):
            B = np.einsum("mak,ij->mikaj", slopes[:, g], np.eye(3)).reshape(count, 9, size)  # F = 1 + B u
            each += np.swapaxes(B, 1, 2) @ (tangent[:, g] @ B)
        cofactor = J[..., None, None] * np.swapaxes(np.linalg.inv(F), -1, -2)
        of_volume = np.einsum("mgik,mgak->mgai", cofactor, slopes, optimize=True).reshape(count, -1, size)
        of_mean = spans @ (weighted @ of_volume)
        curvature = self.bulk / 2.0 * (1.0 + 1.0 / mean**2) * volumes
        each += np.swapaxes(of_mean, 1, 2) @ (curvature[..., None] * of_mean)
        return Part(float(np.sum(density * volumes)), nodes, slope, each)


# ---- contact ----


def closest(p: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ways (k, 3) from points (k, 3) to the closest points of triangles (k, 3, 3), and the shares (k, 3) of the corners there."""
    e, f, r = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], p - corners[:, 0]
    ee, ef, ff, re, rf = (np.einsum("ki,ki->k", *pair) for pair in ((e, e), (e, f), (f, f), (r, e), (r, f)))
    whole = ee * ff - ef * ef
    s, t = (ff * re - ef * rf) / whole, (ee * rf - ef * re) / whole
    trials = [np.stack([1.0 - s - t, s, t], axis=1)]
    for a in range(3):
        b = (a + 1) % 3
        along = corners[:, b] - corners[:, a]
        edge = np.zeros((len(p), 3))
        edge[:, b] = np.clip(np.einsum("ki,ki->k", p - corners[:, a], along) / np.einsum("ki,ki->k", along, along), 0.0, 1.0)
        edge[:, a] = 1.0 - edge[:, b]
        trials.append(edge)
    shares = np.stack(trials)  # of the plane, and of the three edges
    ways = np.einsum("ekc,kci->eki", shares, corners) - p
    squared = np.einsum("eki,eki->ek", ways, ways)
    squared[0, (trials[0] <= 0.0).any(axis=1)] = np.inf
    best, k = squared.argmin(axis=0), np.arange(len(p))
    return ways[best, k], shares[best, k]


def winds(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """How often triangles (t, 3, 3) wind around points (k, 3): their solid angles over 4 pi (van Oosterom & Strackee 1983)."""
    number = np.zeros(len(p))
    for k, place in enumerate(p):
        a, b, c = np.moveaxis(corners - place, 1, 0)
        la, lb, lc = (np.sqrt(np.einsum("ti,ti->t", side, side)) for side in (a, b, c))
        ab, bc, ca = (np.einsum("ti,ti->t", *pair) for pair in ((a, b), (b, c), (c, a)))
        top = np.einsum("ti,ti->t", a, np.cross(b, c))
        number[k] = np.arctan2(top, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2.0 * np.pi)
    return number


def halved(corners: np.ndarray) -> np.ndarray:
    """Triangles (t, 3, 3) halved across their longest edge until that is no longer than ``LONGEST_EDGE_M``."""
    while True:
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        long = edges.max(axis=1) > LONGEST_EDGE_M
        if not long.any():
            return corners
        order = (edges[long].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[long], order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2.0
        corners = np.concatenate([corners[~long], np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


class Surface:
    """A closed surface of triangles (t, 3, 3) m, whose normals point outwards."""

    def __init__(self, corners: np.ndarray) -> None:
        self.corners = corners
        middle = corners.mean(axis=1)
        self.widest = np.linalg.norm(corners - middle[:, None], axis=2).max()
        self.tree = cKDTree(middle)
        self.seen, self.clear = np.zeros((0, 3)), np.zeros(0)  # where points were, and how far they may go until they could touch

    def inside(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which (k,) of the points lie in it, and the triangle (k,) that is closest to each; the points are always the same."""
        if not len(self.seen):
            self.seen, self.clear = p.copy(), np.zeros(len(p))
        due = np.flatnonzero(np.linalg.norm(p - self.seen, axis=1) >= self.clear)
        to_middle, _ = self.tree.query(p[due], distance_upper_bound=self.widest + DEEPEST_M)
        self.seen[due], self.clear[due] = p[due], DEEPEST_M
        near, to_middle = due[np.isfinite(to_middle)], to_middle[np.isfinite(to_middle)]
        tried = self.tree.query_ball_point(p[near], to_middle + self.widest)
        point = np.repeat(near, [len(one) for one in tried])
        triangle = np.concatenate([*map(np.asarray, tried), np.zeros(0)]).astype(int)
        away = np.linalg.norm(closest(p[point], self.corners[triangle])[0], axis=1)
        order = np.lexsort((away, point))
        first = order[np.unique(point[order], return_index=True)[1]]
        first = first[away[first] < DEEPEST_M]
        within = winds(p[point[first]], self.corners) > 0.5
        self.clear[point[first]] = np.where(within, 0.0, away[first])
        return point[first[within]], triangle[first[within]]


def differenced(slope: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """The derivative (k, 3 a, 3 a) of slopes (k, a, 3) by places (k, a, 3)."""
    count, nodes, _ = x.shape
    each = np.empty((count, 3 * nodes, 3 * nodes))
    for column in range(3 * nodes):
        step = np.zeros((nodes, 3))
        step.flat[column] = DIFFERENCE_M
        each[:, :, column] = ((slope(x + step) - slope(x - step)) / (2.0 * DIFFERENCE_M)).reshape(count, 3 * nodes)
    return (each + np.swapaxes(each, 1, 2)) / 2.0


@dataclass(frozen=True)
class Bone:
    """Contact of points of faces with a rigid surface, beyond their depth p at rest: k A p (1 + p / p0); the bone is at R X + s.

    Attributes
    ----------
    points : (n, 3) m at rest.
    nodes, shares : (k, a), (k, a) of the points that touch.
    springs : (k,) N/m. k A of each.
    surface : at rest.
    rotation, shift : R (3, 3), s (3,) m.
    """

    points: np.ndarray
    nodes: np.ndarray
    shares: np.ndarray
    springs: np.ndarray
    surface: Surface
    rotation: np.ndarray
    shift: np.ndarray
    start: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        start, x = np.zeros(len(self.nodes)), self._at(self.points)
        which, triangle = self.surface.inside(x)
        start[which] = np.linalg.norm(closest(x[which], self.surface.corners[triangle])[0], axis=1)
        object.__setattr__(self, "start", start)

    def _at(self, values: np.ndarray) -> np.ndarray:
        """Vectors at the points (k, 3) from those of nodes (n, 3)."""
        return np.einsum("ka,kai->ki", self.shares, values[self.nodes])

    def __call__(self, u: np.ndarray) -> Part:
        x = (self._at(self.points + u) - self.shift) @ self.rotation
        which, triangle = self.surface.inside(x)

        def depth(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            way, _ = closest(x[:, 0], self.surface.corners[triangle])
            whole = np.linalg.norm(way, axis=1)
            return np.maximum(whole - self.start[which], 0.0), way / np.maximum(whole, 1e-300)[:, None]

        def slope(x: np.ndarray) -> np.ndarray:
            beyond, out = depth(x)
            return -(self.springs[which] * beyond * (1.0 + beyond / STIFFENING_M))[:, None, None] * out[:, None]

        x = x[which][:, None]
        shares, each = self.shares[which], self.rotation @ differenced(slope, x) @ self.rotation.T
        beyond, _ = depth(x)
        energy = self.springs[which] @ (beyond**2 / 2.0 + beyond**3 / (3.0 * STIFFENING_M))
        every = np.einsum("ka,kij,kb->kaibj", shares, each, shares).reshape(len(which), 3 * shares.shape[1], 3 * shares.shape[1])
        return Part(energy, self.nodes[which], shares[:, :, None] * (slope(x) @ self.rotation.T), every)


@dataclass(frozen=True)
class Touch:
    """Contact of points of a body with the faces of another, each of which is four triangles around its middle.

    Attributes
    ----------
    points : (n, 3) m at rest.
    nodes, shares : (k, a), (k, a) of the points that touch: a node, or a point of a face.
    springs : (k,) N/m. k A of each.
    faces : (f, 4) of the closed surface of the other body.
    free : (f,) which of these can be touched.
    """

    points: np.ndarray
    nodes: np.ndarray
    shares: np.ndarray
    springs: np.ndarray
    faces: np.ndarray
    free: np.ndarray

    def __call__(self, u: np.ndarray) -> Part:
        x = self.points + u
        own = self.nodes.shape[1]
        which, triangle = Surface(triangles_of(x[self.faces])).inside(np.einsum("ka,kai->ki", self.shares, x[self.nodes]))
        which, triangle = which[self.free[triangle // 4]], triangle[self.free[triangle // 4]]
        shares, springs, k, corner = self.shares[which], self.springs[which], np.arange(len(which)), triangle % 4

        def ways(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """To the surface (k, 3), and how it changes with each node (k, a + 4)."""
            corners = triangles_of(x[:, own:]).reshape(len(k), 4, 3, 3)[k, corner]
            way, of = closest(np.einsum("ka,kai->ki", shares, x[:, :own]), corners)
            arm = np.concatenate([-shares, np.repeat(of[:, 2:] / 4.0, 4, axis=1)], axis=1)
            arm[k, own + corner] += of[:, 0]
            arm[k, own + (corner + 1) % 4] += of[:, 1]
            return way, arm

        def slope(x: np.ndarray) -> np.ndarray:
            way, arm = ways(x)
            return springs[:, None, None] * arm[:, :, None] * way[:, None]

        nodes = np.column_stack([self.nodes[which], self.faces[triangle // 4]])
        energy = 0.5 * springs @ np.sum(ways(x[nodes])[0] ** 2, axis=1)
        return Part(energy, nodes, slope(x[nodes]), differenced(slope, x[nodes]))


def triangles_of(x: np.ndarray) -> np.ndarray:
    """Faces (f, 4, 3) as triangles (4 f, 3, 3) from each corner to the next and to the middle."""
    middle = np.broadcast_to(x.mean(axis=1, keepdims=True), x.shape)
    return np.stack([x, np.roll(x, -1, axis=1), middle], axis=2).reshape(-1, 3, 3)


# ---- equilibrium ----


def assembled(parts: Sequence[Part], count: int) -> tuple[np.ndarray, coo_array]:
    """The derivative (3 n,) of the energy of parts, and the second one."""
    slope, data, ends = np.zeros(3 * count), [], ([], [])
    for part in parts:
        rows = (3 * part.nodes[:, :, None] + np.arange(3)).reshape(len(part.nodes), 3 * part.nodes.shape[1])
        np.add.at(slope, rows, part.slope.reshape(rows.shape))
        data.append(part.stiffness.ravel())
        ends[0].append(np.repeat(rows, rows.shape[1], axis=1).ravel())
        ends[1].append(np.tile(rows, (1, rows.shape[1])).ravel())
    return slope, coo_array((np.concatenate(data), tuple(map(np.concatenate, ends))), shape=2 * (3 * count,))


def settle(terms: Sequence[Term], u: np.ndarray, free: np.ndarray, tolerance_N: float = 1e-7, most: int = 200) -> np.ndarray:
    """Displacement (n, 3) m at which the energy of all terms has a minimum, from u on.

    ``free`` : numbers of the components that may change, of 3 n. The iteration ends when no force is above the tolerance.
    """
    u, viscous = u.copy(), 0.0
    parts = [term(u) for term in terms]
    for _ in range(most):
        energy = sum(part.energy for part in parts)
        slope, stiffness = assembled(parts, len(u))
        slope = slope[free]
        largest = np.abs(slope).max()
        if largest < tolerance_N:
            return u
        matrix = stiffness.tocsc()[free][:, free]
        unit = 1e-4 * abs(matrix.diagonal()).mean()
        while True:
            change = splu(matrix + viscous * eye_array(len(free), format="csc"), **SYMMETRIC).solve(-slope)
            change *= min(1.0, LONGEST_CHANGE_M / np.abs(change).max())
            trial = u.copy()
            trial.ravel()[free] += change
            parts = [term(trial) for term in terms]
            after = sum(part.energy for part in parts)
            if slope @ change < 0.0 and after <= energy + 1e-4 * slope @ change + 1e-13 * abs(energy):
                u, viscous = trial, viscous / 4.0 if viscous > unit / 100.0 else 0.0
                break
            viscous = max(4.0 * viscous, unit)
            if viscous > 1e12 * unit:
                raise RuntimeError(f"no equilibrium: {largest:g} N")
    raise RuntimeError(f"no equilibrium within {most} iterations: {largest:g} N")
