"""Certificate that a trilinear hexahedron is nowhere inverted, instead of a check at sample points.

The Jacobian determinant of a hex over its unit cube is a polynomial of degree two in each natural coordinate. In Bernstein's
basis it has 27 coefficients and lies between the smallest and the largest of them; the eight at the corners are its values there.
So a hex whose coefficients are all positive is folded nowhere, one with a corner that is not positive is folded. Any other is
halved along all axes, the coefficients of the parts come from those of the whole by de Casteljau's means, and each part is judged
in the same way (Johnen, Remacle & Geuzaine 2013, J. Comput. Phys. 233:359-372; Johnen, Weill & Remacle 2017, Procedia Eng.
203:271-283).

Folded is what has a Jacobian that is not positive beyond rounding: flat or inverted. Where two corners of an element are one
node, as on the axis of a sector, the Jacobian is zero on the edge between them however the nodes move. Coefficients that vanish
for that reason are left out, and the next one along an edge tells the sign beside it: the element is judged everywhere else.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.mesh.hexmesh import CORNERS

# So many elements are looked at together: what is computed of them fits into the processor's cache.
_PART_ELEMENTS = 1024
# An element is undecided where parts of 2^-10 of its edges do not decide it, or where so many of its parts are in doubt.
_MOST_HALVINGS = 10
_MOST_PARTS_IN_DOUBT = 256
_HALVED_TOGETHER = 64
# Rounding of a coefficient, relative to the product of the longest edges along the three axes (sums of components): some thirty
# roundings in each, and six more at each halving.
_ROUNDING_SHARE = 64.0 * np.finfo(float).eps
# Arithmetic with positions that are not finite, as those of a run that diverged, is no error.
_NOT_FINITE = np.errstate(invalid="ignore", over="ignore")
# Places of the corners in VTK order, so that the corner at (i, j, k) of the unit cube is number 4 i + 2 j + k.
_BY_AXES = np.lexsort((CORNERS[:, 2], CORNERS[:, 1], CORNERS[:, 0]))
# The 12 edges as pairs of corners.
_ENDS_OF_EDGES = [(a, b) for a in range(8) for b in range(a) if np.sum(CORNERS[a] != CORNERS[b]) == 1]
# The coefficients at corners, in the middle of edges and at both ends of these, and where the first two lie in the unit cube.
_IN_THE_CUBE = 0.5 * (CORNERS + 1.0)
_MIDDLES = np.array([0.5 * (_IN_THE_CUBE[a] + _IN_THE_CUBE[b]) for a, b in _ENDS_OF_EDGES])
_AT_CORNERS, _AT_MIDDLES = (tuple((2.0 * places).astype(int).T) for places in (_IN_THE_CUBE, _MIDDLES))
_AT_ENDS = tuple((2.0 * _IN_THE_CUBE[np.array(_ENDS_OF_EDGES).T]).astype(int).transpose(2, 0, 1))
_OFFSETS = np.concatenate([_IN_THE_CUBE, _MIDDLES]).T


@dataclass(frozen=True)
class Certificate:
    """What is known of the elements of a mesh, in one of its shapes.

    Attributes
    ----------
    folded : (m,) bool. There is a place in the element where the Jacobian is not positive: it is flat or inverted there.
    undecided : (m,) bool. Neither that is known, nor that there is no such place.
    natural : (m, 3). Natural coordinates, each in [-1, 1], of the smallest Jacobian that was seen; beside an edge without volume
        the middle of another edge, on which it changes sign.
    """

    folded: np.ndarray
    undecided: np.ndarray
    natural: np.ndarray

    @property
    def folded_count(self) -> int:
        return int(self.folded.sum())

    @property
    def undecided_count(self) -> int:
        return int(self.undecided.sum())

    @property
    def valid(self) -> bool:
        """Whether all elements are certain to be folded nowhere."""
        return not (self.folded.any() or self.undecided.any())


@_NOT_FINITE
def certify(points: np.ndarray, hexes: np.ndarray) -> Certificate:
    """Which elements are folded anywhere, and which are certain not to be.

    Parameters
    ----------
    points : (n, 3) node positions, m.
    hexes : (m, 8) node numbers, VTK order; two corners may be one node (see the module).
    """
    folded, undecided = np.zeros(len(hexes), dtype=bool), np.zeros(len(hexes), dtype=bool)
    natural = np.empty((len(hexes), 3))
    for part, coefficients, rounding in _parts(points, hexes):
        lower, upper, place = _narrowed(coefficients, _vanishing(hexes[part]), rounding, np.full_like(rounding, np.inf))
        folded[part] = upper <= rounding
        undecided[part] = ~(folded[part] | (lower > rounding))  # so it is where a position is not finite
        natural[part] = 2.0 * place.T - 1.0
    return Certificate(folded, undecided, natural)


@_NOT_FINITE
def smallest_jacobian_bounds(points: np.ndarray, hexes: np.ndarray, gap: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bound, (m,) and (m,), of the smallest Jacobian over each hex.

    Relative to the mean size of the element's 27 coefficients: its volume, where all of them are positive. So the smallest is 1
    for every parallelepiped, and the same for any affine image of an element. The bounds include rounding.

    Parameters
    ----------
    points : (n, 3) node positions, m.
    hexes : (m, 8) node numbers, VTK order.
    gap : the bounds are brought as near to each other; less near where the Jacobian is smallest all along a surface.
    """
    lower, upper = np.empty(len(hexes)), np.empty(len(hexes))
    for part, coefficients, rounding in _parts(points, hexes):
        size = np.abs(coefficients).mean(axis=(0, 1, 2))
        low, high, _ = _narrowed(coefficients, None, np.full_like(size, -np.inf), gap * size)
        scale = np.where(size > 0.0, size, 1.0)
        lower[part], upper[part] = (low - rounding) / scale, (high + rounding) / scale
    return lower, upper


def _parts(points: np.ndarray, hexes: np.ndarray) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Part of the elements, coefficients (3, 3, 3, k) and their rounding (k,) m^3."""
    for first in range(0, len(hexes), _PART_ELEMENTS):
        part = slice(first, first + _PART_ELEMENTS)
        yield part, *_coefficients(points[hexes[part][:, _BY_AXES]].transpose(1, 2, 0))


def _coefficients(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bernstein's coefficients (3, 3, 3, k) m^3 of the Jacobian over the unit cube, and their rounding (k,).

    ``corners`` (8, 3, k) lie in the order of ``_BY_AXES``. The tangent along an axis is bilinear in the other two coordinates;
    its coefficients are the four edges. A product of two linear functions has the coefficients a0 b0, (a0 b1 + a1 b0) / 2, a1 b1.
    """
    place = np.ascontiguousarray(corners).reshape(2, 2, 2, 3, -1)
    x = place[1] - place[0]  # [j, k]
    y = place[:, 1] - place[:, 0]  # [i, k]
    z = place[:, :, 1] - place[:, :, 0]  # [i, j]
    # y cross z: a quadratic function of i, linear in k (from y) and in j (from z)
    left, right = y[:, :, None, None], z[None, None]
    pairs = np.empty((2, 2, 2, 2, *x.shape[2:]))
    for m in range(3):
        p, q = (m + 1) % 3, (m + 2) % 3
        np.subtract(left[..., p, :] * right[..., q, :], left[..., q, :] * right[..., p, :], out=pairs[..., m, :])
    normal = np.empty((3, *x.shape))  # [i, k, j]
    normal[0], normal[2] = pairs[0, :, 0], pairs[1, :, 1]
    np.multiply(0.5, pairs[0, :, 1] + pairs[1, :, 0], out=normal[1])
    # (y cross z) . x: quadratic in j and k as well
    normal = normal[:, :, :, None, None]
    products = normal[..., 0, :] * x[..., 0, :]  # [i, k, j, j', k']
    products += normal[..., 1, :] * x[..., 1, :]
    products += normal[..., 2, :] * x[..., 2, :]
    half = np.empty((3, 2, 3, 2, x.shape[-1]))  # [i, k, j, k']
    half[:, :, 0], half[:, :, 2] = products[:, :, 0, 0], products[:, :, 1, 1]
    half[:, :, 1] = 0.5 * (products[:, :, 0, 1] + products[:, :, 1, 0])
    coefficients = np.empty((3, 3, 3, x.shape[-1]))
    coefficients[:, :, 0], coefficients[:, :, 2] = half[:, 0, :, 0], half[:, 1, :, 1]
    coefficients[:, :, 1] = 0.5 * (half[:, 0, :, 1] + half[:, 1, :, 0])
    longest = [np.abs(edges).sum(axis=2).max(axis=(0, 1)) for edges in (x, y, z)]
    return coefficients, _ROUNDING_SHARE * longest[0] * longest[1] * longest[2]


def _vanishing(hexes: np.ndarray) -> np.ndarray | None:
    """Coefficients (3, 3, 3, k) that vanish as corners are one node; None where no element has such corners."""
    shared = np.zeros(len(hexes), dtype=bool)
    for a, b in _ENDS_OF_EDGES:
        shared |= hexes[:, a] == hexes[:, b]
    if not shared.any():
        return None
    vanishing = np.zeros((3, 3, 3, len(hexes)), dtype=bool)
    # Nodes in general position tell: what is zero with these is always zero.
    nodes, first = np.unique(hexes[shared], return_inverse=True)
    anywhere = np.random.default_rng(0).standard_normal((len(nodes), 3))
    coefficients, rounding = _coefficients(anywhere[first.reshape(-1, 8)[:, _BY_AXES]].transpose(1, 2, 0))
    vanishing[..., shared] = np.abs(coefficients) <= rounding
    return vanishing


def _narrowed(
    coefficients: np.ndarray, vanishing: np.ndarray | None, floor: np.ndarray, gap: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper bounds (k,), (k,) of the smallest value of each polynomial, and where in the unit cube it was seen (3, k).

    They are brought as near to each other as ``gap`` (k,), or to the same side of ``floor`` (k,). ``vanishing`` coefficients are
    left out.
    """
    lower, upper, place = _halved(coefficients, vanishing, floor, gap, 0)
    doubtful = np.flatnonzero(lower < _needed(upper, floor, gap))
    for first in range(0, len(doubtful), _HALVED_TOGETHER):
        some = doubtful[first : first + _HALVED_TOGETHER]
        left_out = None if vanishing is None else vanishing[..., some]
        lower[some], upper[some], place[:, some] = _halved(
            coefficients[..., some], left_out, floor[some], gap[some], _MOST_HALVINGS
        )
    return lower, upper, place


def _needed(upper: np.ndarray, floor: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """The lower bound that is wanted at an upper bound; see ``_narrowed``."""
    return np.where(upper > floor, np.maximum(upper - gap, floor), -np.inf)


def _halved(
    coefficients: np.ndarray, vanishing: np.ndarray | None, floor: np.ndarray, gap: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What ``_narrowed`` gives, after ``most`` halvings at most."""
    count = coefficients.shape[-1]
    lower, upper, place = np.full(count, np.inf), np.full(count, np.inf), np.zeros((3, count))
    element, origin = np.arange(count), np.zeros((3, count), dtype=int)  # of each part; in parts
    for halvings in range(most + 1):
        counted = coefficients if vanishing is None else np.where(vanishing, np.inf, coefficients)
        least = counted.reshape(27, -1).min(axis=0)
        values = counted[_AT_CORNERS]
        if vanishing is not None:
            values = np.concatenate([values, np.where(vanishing[_AT_ENDS].any(axis=0), counted[_AT_MIDDLES], np.inf)])
        smallest = values.argmin(axis=0)
        value = values[smallest, np.arange(len(smallest))]
        before = upper.copy()
        np.minimum.at(upper, element, value)
        new = (value == upper[element]) & (value < before[element])
        place[:, element[new]] = (origin + _OFFSETS[:, smallest])[:, new] / 2.0**halvings

        doubtful = least < _needed(upper, floor, gap)[element]
        doubtful &= np.bincount(element[doubtful], minlength=count)[element] <= _MOST_PARTS_IN_DOUBT
        doubtful &= halvings < most
        np.minimum.at(lower, element[~doubtful], least[~doubtful])
        if not doubtful.any():
            break
        element = np.repeat(element[doubtful], 8)
        origin = (2 * origin[:, doubtful, None] + np.indices((2, 2, 2)).reshape(3, 1, 8)).reshape(3, -1)
        coefficients = _eighths(coefficients[..., doubtful])
        if vanishing is not None:
            # means with positive weights: zero where all that they are means of vanishes
            vanishing = _eighths(1.0 - vanishing[..., doubtful]) == 0.0
    return lower, upper, place


def _eighths(coefficients: np.ndarray) -> np.ndarray:
    """Coefficients (3, 3, 3, 8 k) on the eight parts of cubes halved along all axes (de Casteljau); one cube after the other."""
    for axis in range(3):
        a, b, c = np.moveaxis(coefficients, axis, 0)
        ab, bc = 0.5 * (a + b), 0.5 * (b + c)
        middle = 0.5 * (ab + bc)
        halves = np.array([[a, ab, middle], [middle, bc, c]])  # [half, coefficient, ...]
        coefficients = np.moveaxis(np.moveaxis(halves, 0, -1), 0, axis)
    return coefficients.reshape(3, 3, 3, -1)
