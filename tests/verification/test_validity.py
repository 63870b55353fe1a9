"""Hexes that are folded between sound corners: against closed forms, exact arithmetic and dense sampling."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from outside_data import SHARED_DATA, needs

from explicitfe.fem.mesh.cylinder import sector_mesh
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, shape_gradients
from explicitfe.fem.mesh.quality import check, corner_jacobians
from explicitfe.fem.mesh.validity import certify, smallest_jacobian_bounds
from explicitfe.platform.errors import InputError

CUBE = 0.5 * (CORNERS + 1.0)
ONE = np.arange(8)[None]
MEASURED_TONGUE = SHARED_DATA / "tongue" / "artisynth-hextongue" / "hextongue.npz"


def prism(a: float, b: float) -> np.ndarray:
    """Corners of a prism of unit length along x whose unit square y, z becomes diag(a, b) of it on the way.

    At x = t its section is diag(1 - t + a t, 1 - t + b t) of the square: that is its Jacobian.
    """
    x, y, z = CUBE.T
    return np.stack([x, y * np.where(x > 0.0, a, 1.0), z * np.where(x > 0.0, b, 1.0)], axis=1)


def jacobian(corners: np.ndarray, natural: np.ndarray) -> Fraction:
    """Jacobian over the unit cube at natural coordinates, in exact arithmetic."""
    xi = [Fraction(float(value)) for value in natural]
    tangents = [[Fraction(0)] * 3 for _ in range(3)]
    for corner, place in zip(CORNERS.astype(int).tolist(), corners, strict=True):
        for axis in range(3):
            slope = Fraction(corner[axis], 4)
            for other in {0, 1, 2} - {axis}:
                slope *= 1 + corner[other] * xi[other]
            for k in range(3):
                tangents[axis][k] += slope * Fraction(float(place[k]))
    (a, b, c), (d, e, f), (g, h, i) = tangents
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)


def sampled(corners: np.ndarray, count: int) -> np.ndarray:
    """Jacobian of hexes (m, 8, 3) over the unit cube at ``count`` places along each axis, (m, count, count, count)."""
    at = np.linspace(-1.0, 1.0, count)
    gradients = shape_gradients(np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1))
    return 8.0 * np.linalg.det(np.einsum("xyzaj,mai->mxyzij", gradients, corners))


def apart(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and elements of hexes (m, 8, 3) that share no nodes."""
    return corners.reshape(-1, 3), np.arange(8 * len(corners)).reshape(-1, 8)


def crumpled(count: int, by: float) -> np.ndarray:
    """Unit cubes (m, 8, 3) with corners moved by up to ``by`` along each axis."""
    return CUBE + by * np.random.default_rng(3).uniform(-1.0, 1.0, (count, 8, 3))


@pytest.mark.parametrize(("a", "b"), [(-0.5, -3.0), (-0.2, -5.0), (-0.9, -1.3)])
def test_a_prism_that_turns_over_on_the_way_is_folded(a, b):
    """Both sides change sign, one after the other: negative in between, at 1 / (1 - b) < t < 1 / (1 - a), as sections tell."""
    corners = prism(a, b)
    assert (corner_jacobians(corners, ONE) > 0.0).all()
    certificate = certify(corners, ONE)
    assert certificate.folded.all() and not certificate.undecided.any() and not certificate.valid
    t = 0.5 * (certificate.natural[0, 0] + 1.0)
    assert 1.0 / (1.0 - b) <= t <= 1.0 / (1.0 - a)
    # The smallest is halfway between the roots; the mean size of the coefficients 1, (a + b) / 2, a b is taken out.
    t = 0.5 * (1.0 / (1.0 - a) + 1.0 / (1.0 - b))
    smallest = (1.0 - t + a * t) * (1.0 - t + b * t) / ((1.0 + abs(a + b) / 2.0 + a * b) / 3.0)
    lower, upper = smallest_jacobian_bounds(corners, ONE, gap=0.01)
    assert lower[0] <= smallest <= upper[0] <= lower[0] + 0.01001


def test_a_prism_that_only_narrows_is_valid_though_a_coefficient_is_negative():
    """A section that turns on the way: by 127 degrees, it narrows to a fifth of its area and no further."""
    x, y, z = CUBE.T
    turn = np.array([[-0.6, -0.8], [0.8, -0.6]])  # det(1 - t + t R) = 1 - 3.2 t (1 - t): coefficients 1, -0.6, 1
    section = np.where(x[:, None] > 0.0, np.stack([y, z], axis=1) @ turn.T, np.stack([y, z], axis=1))
    corners = np.column_stack([x, section])
    assert certify(corners, ONE).valid
    lower, upper = smallest_jacobian_bounds(corners, ONE, gap=1e-6)
    smallest = 0.2 / ((1.0 + 0.6 + 1.0) / 3.0)
    assert lower[0] <= smallest <= upper[0] + 1e-12 and upper[0] - lower[0] < 1.001e-6


# Found by search: where the Jacobian is not positive.
FOLDED = {
    "at an edge only": [[-1, 0, -1], [2, -1, -1], [5, 6, 2], [-2, 2, -2], [-3, 0, 4], [4, -2, 6], [6, 4, 2], [2, 7, 7]],
    "in a face only": [[3, -1, 2], [7, 3, -2], [7, 4, -1], [-1, 1, -3], [-1, 2, 5], [2, -3, 4], [2, 3, 3], [3, 7, 1]],
    "in a face and inside": [[0, 3, 0], [7, -1, -1], [7, 2, 3], [3, 5, 3], [-3, -3, 3], [6, 2, 3], [1, 7, 5], [-2, 6, 2]],
}


@pytest.mark.parametrize("where", FOLDED)
def test_a_fold_between_sound_corners_is_seen(where):
    """Dense sampling says where it is; exact arithmetic confirms the place that the certificate names."""
    corners = np.array(FOLDED[where], dtype=float)
    J = sampled(corners[None], 41)[0]
    at_end = np.zeros(41, dtype=int)
    at_end[[0, -1]] = 1
    ends = at_end[:, None, None] + at_end[:, None] + at_end  # 0: inside, 1: in a face, 2: at an edge, 3: at a corner
    folded = {name for count, name in enumerate(("inside", "face", "edge", "corner")) if (J[ends == count] <= 0.0).any()}
    assert folded == {name for name in ("inside", "face", "edge") if name in where}
    certificate = certify(corners, ONE)
    assert certificate.folded.all()
    assert jacobian(corners, certificate.natural[0]) <= 0


def test_folded_is_what_exact_arithmetic_confirms_and_dense_sampling_finds():
    corners = crumpled(600, 0.6)
    certificate = certify(*apart(corners))
    assert 100 < certificate.folded_count < 500 and certificate.undecided_count == 0
    least = sampled(corners, 9).reshape(len(corners), -1).min(axis=1)
    assert (least[~certificate.folded] > 0.0).all()
    for element in np.flatnonzero(certificate.folded):
        assert jacobian(corners[element], certificate.natural[element]) <= 0
    # Each by itself is judged as all of them together.
    alone = [bool(certify(corner, ONE).folded[0]) for corner in corners[:50]]
    assert alone == certificate.folded[:50].tolist()


def test_bounds_enclose_the_smallest_jacobian():
    """Of 2 000 hexes: no sample lies below the lower bound, the upper bound is reached, and both are as near as asked."""
    corners = crumpled(2000, 0.45)
    points, hexes = apart(corners)
    scale = mean_size(corners)
    least = np.concatenate([sampled(part, 11).reshape(len(part), -1).min(axis=1) for part in np.split(corners, 20)]) / scale
    seen = certify(points, hexes).natural
    for gap in (1e-1, 1e-2, 1e-4):
        lower, upper = smallest_jacobian_bounds(points, hexes, gap)
        assert (lower <= upper).all() and (upper - lower <= gap + 1e-12).all()
        assert (lower <= least).all()
        # Nowhere is it smaller than at the corners and the places that are seen, but by the gap.
        corner = corner_jacobians(points, hexes).min(axis=1) / scale
        assert (upper <= corner + 1e-12).all()
    # Between samples a tenth of an edge apart it is smaller by an eighth of the second differences at most, along each axis.
    assert (least - upper < 3.0 / 8.0 * 0.01 * 8.0).all() and (least - upper).max() > 0.0
    assert seen.shape == (len(hexes), 3) and (np.abs(seen) <= 1.0).all()


def mean_size(corners: np.ndarray) -> np.ndarray:
    """Mean size (m,) of Bernstein's coefficients, which the values at 0, 1/2 and 1 along each axis decide."""
    coefficients = sampled(corners, 3)
    for axis in (1, 2, 3):
        first, middle, last = np.moveaxis(coefficients, axis, 0)
        coefficients = np.stack([first, 2.0 * middle - 0.5 * (first + last), last], axis=axis)
    return np.abs(coefficients).mean(axis=(1, 2, 3))


def test_bounds_and_folds_stay_under_an_affine_map():
    corners = crumpled(300, 0.5)
    first, certificate = smallest_jacobian_bounds(*apart(corners)), certify(*apart(corners))
    stretch = np.array([[0.1, 0.0, 0.0], [0.3, 20.0, 0.1], [0.0, 0.5, 7.0]])
    moved = corners @ stretch.T + np.array([1.0, 0.0, -4.0])
    for a, b in zip(first, smallest_jacobian_bounds(*apart(moved)), strict=True):
        # The bounds include a rounding of 64 eps of the longest edges, 40^3, by the volume, 14.
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-10)
    np.testing.assert_array_equal(certify(*apart(moved)).folded, certificate.folded)
    mirrored = certify(*apart(corners * [-1.0, 1.0, 1.0]))
    assert mirrored.folded[~certificate.folded].all()


def test_parallelepipeds_are_one_and_flat_ones_are_folded():
    lower, upper = smallest_jacobian_bounds(CUBE @ np.array([[2.0, 0.3, 0.0], [0.1, 1.0, 0.2], [0.0, 0.5, 0.7]]), ONE)
    assert lower[0] == pytest.approx(1.0, abs=1e-12) and upper[0] == pytest.approx(1.0, abs=1e-12)
    for flat in (CUBE * [1.0, 1.0, 0.0], CUBE @ np.array([[1.0, 2.0, 3.0], [0.1, 0.2, 0.4], [1.1, 2.2, 3.4]]), 0.0 * CUBE):
        assert certify(flat, ONE).folded.all()


def test_what_touches_zero_between_the_halvings_is_undecided():
    """(1 - 3 t)^2 is zero at t = 1/3, which no halving meets: neither a fold nor its absence can be shown."""
    certificate = certify(prism(-2.0, -2.0), ONE)
    assert certificate.undecided.all() and not certificate.folded.any() and not certificate.valid


def test_a_position_that_is_not_finite_is_no_certificate():
    points, hexes = apart(crumpled(3, 0.1))
    for bad in (np.nan, np.inf):
        points[9] = bad
        certificate = certify(points, hexes)
        assert certificate.undecided.tolist() == [False, True, False] and not certificate.folded.any()


# ---- elements with shared corners ----


def sector() -> HexMesh:
    return sector_mesh(np.linspace(0.0, 0.02, 5), np.linspace(0.0, 0.01, 4), np.radians(1.0))


def test_the_axis_of_a_sector_is_left_out():
    """Where the axis has no volume anyway, the elements on it are certain; moved at random in the plane too."""
    mesh = sector()
    assert (corner_jacobians(mesh.points, mesh.hexes) == 0.0).any(axis=1).sum() == 3
    assert certify(mesh.points, mesh.hexes).valid
    moved = mesh.points + 5e-4 * np.random.default_rng(0).uniform(-1.0, 1.0, mesh.points.shape) * [1.0, 0.0, 1.0]
    turned, origin = mesh.node_sets["turned"], mesh.node_sets["turned_from"]
    away, cos, sin = moved[origin, 0], np.cos(np.radians(1.0)), np.sin(np.radians(1.0))
    moved[turned] = np.column_stack([away * cos, away * sin, moved[origin, 2]])
    moved[mesh.node_sets["axis"], :2] = 0.0
    assert certify(moved, mesh.hexes).valid


def test_a_fold_beside_the_axis_of_a_sector_is_seen():
    """A node of the axis passes the next one: the element between them turns over there, and no other."""
    mesh = sector()
    points = mesh.points.copy()
    low, high = mesh.node_sets["axis"][:2]
    points[low, 2] = points[high, 2] + 1e-5
    certificate = certify(points, mesh.hexes)
    assert certificate.folded.tolist() == [low in hexes and high in hexes for hexes in mesh.hexes]
    assert certificate.undecided_count == 0


@pytest.mark.parametrize(("same", "kind"), [([(3, 0), (7, 4)], "wedge"), ([(5, 4), (6, 4), (7, 4)], "pyramid")])
def test_collapsed_elements_are_judged_beside_their_edge(same, kind):
    """A wedge and a pyramid are certain; seen from inside, and flat, they are folded."""
    hexes = np.arange(8)
    for corner, other in same:
        hexes[corner] = hexes[other]
    assert certify(CUBE, hexes[None]).valid
    for spoilt in (CUBE * [1.0, 1.0, -1.0], CUBE * [1.0, 0.0, 1.0]):
        assert certify(spoilt, hexes[None]).folded.all()


# ---- what a mesh is told ----


def test_a_mesh_with_a_fold_between_sound_corners_is_refused():
    corners = np.concatenate([CUBE + 10.0, prism(-0.5, -3.0)])
    with pytest.raises(InputError) as caught:
        check(HexMesh(corners, np.arange(16).reshape(2, 8)), "mesh.vtu")
    message = str(caught.value)
    assert message.startswith("mesh.vtu: element 1 is inverted between its corners") and message.endswith("move its nodes.")
    check(HexMesh(corners[:8], ONE), "mesh.vtu")


@needs(MEASURED_TONGUE)
def test_the_measured_tongue_is_folded_nowhere():
    """Its worst corner has a scaled Jacobian of 0.007; no Jacobian is below a hundredth of its mean size in the element."""
    with np.load(MEASURED_TONGUE) as data:
        points, hexes = data["nodes_m"], data["hexes_vtk"]
    assert certify(points, hexes).valid
    lower, upper = smallest_jacobian_bounds(points, hexes, gap=1e-3)
    assert 0.014 < lower.min() <= upper.min() < 0.015
