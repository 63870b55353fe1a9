"""Meshes of specimens: stations that hit their marks, sectors, butterfly grids and blocks with the right volume and sets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from explicitfe.fem.mesh.box import gridded_block, ringed_block
from explicitfe.fem.mesh.cylinder import cylinder_mesh, sector_mesh
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh
from explicitfe.fem.mesh.quality import assess, check, corner_jacobians, edge_lengths, scaled_jacobians, volumes
from explicitfe.fem.mesh.stations import stations

MM = 1e-3


@dataclass(frozen=True)
class Case:
    """A specimen as an experiment has it; lengths in mm, zones as (start, stop, size)."""

    radius: float
    height: float
    zones: list[tuple[float, float, float]]
    largest: float
    height_zones: list[tuple[float, float, float]]
    largest_height: float
    layer: list[float]

    @property
    def radii(self) -> np.ndarray:
        return stations(self.radius * MM, np.array(self.zones) * MM, largest_m=self.largest * MM)

    @property
    def heights(self) -> np.ndarray:
        breaks = [(self.height - depth) * MM for depth in self.layer]
        zones = np.array(self.height_zones) * MM
        return stations(self.height * MM, zones, largest_m=self.largest_height * MM, breaks_m=breaks)


CASES = {
    "flat punch on a layer": Case(35.0, 20.0, [(12.9, 14.4, 0.4)], 2.5, [(18.0, 20.0, 0.4)], 2.0, [1.0]),
    "narrow punch": Case(20.0, 10.0, [(1.5, 2.5, 0.2)], 1.5, [(9.0, 10.0, 0.2)], 1.0, []),
    "ball": Case(25.0, 15.0, [(0.0, 4.0, 0.4)], 2.0, [(13.0, 15.0, 0.4), (0.0, 0.5, 0.5)], 1.5, [0.3, 1.2]),
    "plate": Case(10.0, 12.0, [], 1.0, [], 1.0, []),
}
SYMMETRIES = {"quarter": 1, "half": 2, "whole": 4}
AROUND = [4, 6, 8, 12, 20]

every_case = pytest.mark.parametrize("name", CASES)
every_symmetry = pytest.mark.parametrize("symmetry", SYMMETRIES)


def ring_factor(around: int) -> float:
    phi = np.pi / 2.0 / around
    return np.sqrt(phi / np.sin(phi))


@cache
def body(shape: str, name: str, symmetry: str = "quarter", around: int = 8) -> HexMesh:
    """The specimen of a case as a cylinder, as a block with rings or as a block in a grid."""
    case = CASES[name]
    if shape == "round":
        return cylinder_mesh(case.radii, case.heights, around, symmetry)
    a, b = half_sizes(name)
    if shape == "block":
        largest = case.largest * MM
        return ringed_block((a, b), case.radii, case.heights, around, symmetry, largest_m=largest)
    x, y = (stations(half, np.array(case.zones) * MM, largest_m=case.largest * MM) for half in (a, b))
    return gridded_block(x, y, case.heights, symmetry)


def half_sizes(name: str) -> tuple[float, float]:
    radius = CASES[name].radius * MM
    return 1.6 * radius, 1.2 * radius


SHAPES = ["round", "block", "grid"]
every_shape = pytest.mark.parametrize("shape", SHAPES)


def faces_of(mesh: HexMesh) -> tuple[np.ndarray, np.ndarray]:
    """All faces of all elements as sorted rows without repetition, and how many elements have each."""
    corners = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return np.unique(np.sort(mesh.hexes[:, corners].reshape(-1, 4), axis=1), axis=0, return_counts=True)


# --- stations --------------------------------------------------------------------------------------------------------


def marks_of(length: float, zones, breaks) -> list[float]:
    return [mark for mark in [*np.ravel(zones), *breaks] if 0.0 < mark < length]


@pytest.mark.parametrize("growth", [1.1, 1.25, 1.6])
@pytest.mark.parametrize(
    ("length", "zones", "largest", "breaks"),
    [
        (35e-3, [(12.9e-3, 14.4e-3, 0.4e-3)], 2.5e-3, []),
        (20e-3, [(18e-3, 20e-3, 0.4e-3)], 2e-3, [19e-3]),
        (20e-3, [(19.5e-3, 25e-3, 0.4e-3)], 2e-3, [19.9e-3, 3e-3]),
        (20e-3, [(4e-3, 9e-3, 1e-3), (7e-3, 8e-3, 0.1e-3), (16e-3, 16e-3, 0.5e-3)], 3e-3, [0.05e-3, 12e-3]),
        (20e-3, [(-5e-3, -1e-3, 0.1e-3), (21e-3, 22e-3, 0.2e-3)], 3e-3, [-1e-3, 30e-3, 10e-3]),
        (20e-3, [], 1.7e-3, [1e-3, 1.1e-3, 7.77e-3]),
        (1.0, [(0.0, 1.0, 0.013)], 0.5, [1.0 / 3.0]),
    ],
)
def test_stations_hit_their_marks_and_keep_to_their_sizes(length, zones, largest, breaks, growth):
    positions = stations(length, zones, largest_m=largest, growth=growth, breaks_m=breaks)
    cells = np.diff(positions)
    assert positions[0] == 0.0 and positions[-1] == length and (cells > 0.0).all()
    for mark in marks_of(length, np.array(zones).reshape(-1, 3)[:, :2], breaks):
        assert mark in positions
    # A number of cells is not rounded up for an excess of 1e-9: so much may a cell be too large.
    assert cells.max() <= largest * (1.0 + 1e-8)
    for start, stop, size in zones:
        inside = (positions[:-1] >= start) & (positions[1:] <= stop)
        assert (cells[inside] <= size * (1.0 + 1e-8)).all()
    ratio = cells[1:] / cells[:-1]
    # The promise is 5 % above growth where a mark forces it; 1e-12 for the rounding of the differences.
    assert np.maximum(ratio, 1.0 / ratio).max() <= 1.05 * growth * (1.0 + 1e-12)


@pytest.mark.parametrize("growth", [1.1, 1.25, 2.0])
def test_stations_grow_geometrically_from_a_point(growth):
    """h = size + ln(g) x: the integral of 1 / h over L is I = ln(1 + ln(g) L / size) / ln(g), and N cells grow by g^(I / N)."""
    length, size = 0.05, 0.3e-3
    slope = np.log(growth)
    integral = np.log1p(slope * length / size) / slope
    count = int(np.ceil(integral))
    cells = np.diff(stations(length, [(0.0, 0.0, size)], largest_m=1.0, growth=growth))
    assert len(cells) == count
    # Rounding of a difference of positions: eps * length / size = 4e-14.
    np.testing.assert_allclose(cells[1:] / cells[:-1], growth ** (integral / count), rtol=1e-12)


def test_stations_without_zones_are_even():
    np.testing.assert_allclose(stations(1.0, [], largest_m=0.3), [0.0, 0.25, 0.5, 0.75, 1.0], rtol=1e-15)
    # 6 mm / 0.3 mm is above 20 by rounding, which does not make a 21st cell.
    assert 6e-3 / 3e-4 > 20.0
    assert len(stations(6e-3, [], largest_m=3e-4)) == 21


def test_stations_take_marks_that_differ_by_rounding_as_one():
    height = 0.02
    other = 0.019000000000000003
    assert other != height - 0.001
    positions = stations(height, [(other, height, 0.4e-3)], largest_m=2e-3, breaks_m=[height - 0.001])
    assert height - 0.001 in positions and other not in positions
    assert np.diff(positions).min() > 0.2e-3


def test_stations_end_on_any_marks():
    """Marks at random, some close together: the search for sizes that fit ends, within its bounds."""
    rng = np.random.default_rng(11)
    for growth in [1.05, 1.25, 2.0] * 30:
        bounds = np.sort(rng.uniform(-0.2, 1.2, (rng.integers(0, 4), 2)), axis=1)
        zones = np.column_stack([bounds, 10.0 ** rng.uniform(-2.5, 0.0, len(bounds))])
        breaks = rng.uniform(0.0, 1.0, rng.integers(0, 4))
        breaks = np.concatenate([breaks, breaks[:1] + 1e-3])
        positions = stations(1.0, zones, largest_m=0.3, growth=growth, breaks_m=breaks)
        cells = np.diff(positions)
        ratio = cells[1:] / cells[:-1]
        assert np.maximum(ratio, 1.0 / ratio).max(initial=1.0) <= 1.05 * growth * (1.0 + 1e-12)
        assert np.isin(marks_of(1.0, bounds, breaks), positions).all()


@pytest.mark.parametrize(
    ("length", "zones", "more"),
    [
        (0.0, [], {}),
        (np.nan, [], {}),
        (1.0, [], {"largest_m": 0.0}),
        (1.0, [], {"growth": 1.0}),
        (1.0, [], {"breaks_m": [np.nan]}),
        (1.0, [(0.1, 0.2, 0.0)], {}),
        (1.0, [(0.2, 0.1, 0.1)], {}),
        (1.0, [(np.nan, 0.1, 0.1)], {}),
    ],
)
def test_stations_that_cannot_be(length, zones, more):
    with pytest.raises(ValueError):
        stations(length, zones, **({"largest_m": 0.1} | more))


# --- sector ----------------------------------------------------------------------------------------------------------


@every_case
@pytest.mark.parametrize("angle", [0.02, 0.1, 0.7])
def test_sector_volume_and_jacobians(name, angle):
    case = CASES[name]
    radii, heights = case.radii, case.heights
    mesh = sector_mesh(radii, heights, angle)
    assert mesh.element_count == (len(radii) - 1) * (len(heights) - 1)
    # Each term of the sum is right to some eps; 1e-12 is 5000 eps.
    volume = volumes(mesh.points, mesh.hexes)
    assert (volume > 0.0).all()
    assert volume.sum() == pytest.approx(0.5 * np.sin(angle) * radii[-1] ** 2 * heights[-1], rel=1e-12)

    for gauss in CORNERS / np.sqrt(3.0):
        factors = 1.0 + gauss * CORNERS
        gradient = np.stack([CORNERS[:, i] * factors[:, i - 1] * factors[:, i - 2] / 8.0 for i in range(3)])
        assert (np.linalg.det(np.einsum("ja,mai->mji", gradient, mesh.points[mesh.hexes])) > 0.0).all()
    collapsed = (mesh.hexes[:, 0] == mesh.hexes[:, 3]) & (mesh.hexes[:, 4] == mesh.hexes[:, 7])
    assert collapsed.sum() == len(heights) - 1
    assert np.isin(mesh.hexes[collapsed][:, [0, 4]], mesh.node_sets["axis"]).all()
    assert (corner_jacobians(mesh.points, mesh.hexes[~collapsed]) > 0.0).all()


@every_case
def test_sector_nodes(name):
    case, angle = CASES[name], 0.05
    radii, heights = case.radii, case.heights
    mesh = sector_mesh(radii, heights, angle)
    sets, points = mesh.node_sets, mesh.points
    planar = len(radii) * len(heights)
    assert mesh.node_count == planar + (len(radii) - 1) * len(heights)
    assert (np.unique(mesh.hexes) == np.arange(mesh.node_count)).all()
    assert (sets["plane"] == np.arange(planar)).all() and (sets["turned"] == np.arange(planar, mesh.node_count)).all()
    assert (points[:planar, 1] == 0.0).all() and (points[planar:, 1] > 0.0).all()
    assert (np.unique(points[:planar, 0]) == radii).all() and (np.unique(points[:, 2]) == heights).all()

    from_plane, turned = points[sets["turned_from"]], points[sets["turned"]]
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(from_plane @ rotation.T, turned, rtol=1e-15, atol=1e-18)

    radius = np.hypot(points[:, 0], points[:, 1])
    expected = {
        "base": points[:, 2] == 0.0,
        "top": points[:, 2] == heights[-1],
        "side": np.isclose(radius, radii[-1], rtol=1e-14, atol=0.0),
        "axis": radius == 0.0,
    }
    for key, mask in expected.items():
        assert (sets[key] == np.flatnonzero(mask)).all()
    assert (mesh.named_points["top-centre"].position == [0.0, 0.0, heights[-1]]).all()


# --- cylinders and blocks: shape of elements -------------------------------------------------------------------------


@every_case
@pytest.mark.parametrize("around", AROUND)
def test_round_mesh_has_the_volume_of_the_cylinder_and_good_elements(name, around):
    case = CASES[name]
    mesh = body("round", name, around=around)
    check(mesh, name)
    assert (corner_jacobians(mesh.points, mesh.hexes) > 0.0).all()
    quality = assess(mesh)
    assert quality.volume_m3 == pytest.approx(np.pi / 4.0 * (case.radius * MM) ** 2 * case.height * MM, rel=1e-12)
    assert quality.smallest_scaled_jacobian > 0.75


@every_case
@pytest.mark.parametrize("around", AROUND)
def test_rings_carry_the_area_of_their_circle(name, around):
    """Every ring outside the core is a station times the ring factor, and the top within it has the area of that circle."""
    radii = CASES[name].radii
    mesh = body("round", name, around=around)
    top = mesh.hexes[np.isin(mesh.hexes[:, 4:], mesh.node_sets["top"]).all(axis=1)][:, 4:]
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    distance = np.hypot(x, y)
    along = np.sort(x[np.intersect1d(mesh.node_sets["top"], mesh.node_sets["y0"])])
    rings = [r for r in radii[1:] if np.isclose(along, r * ring_factor(around), rtol=1e-14, atol=0.0).any()]
    # The core and the layers around it take around / 2 + around / 8 cells, no ring is missing further out.
    assert rings == list(radii[-len(rings) :])
    assert len(along) - len(rings) == 1 + around // 2 + -(-around // 8) - 1
    d1, d2 = top[:, [0, 2]], top[:, [1, 3]]
    area = 0.5 * (
        (x[d1[:, 1]] - x[d1[:, 0]]) * (y[d2[:, 1]] - y[d2[:, 0]]) - (y[d1[:, 1]] - y[d1[:, 0]]) * (x[d2[:, 1]] - x[d2[:, 0]])
    )
    for r in rings:
        on_ring = np.isclose(distance, r * ring_factor(around), rtol=1e-14, atol=0.0)
        assert on_ring[mesh.node_sets["top"]].sum() == around + 1
        within = (distance[top] <= r * ring_factor(around) * (1.0 + 1e-14)).all(axis=1)
        assert area[within].sum() == pytest.approx(np.pi / 4.0 * r**2, rel=1e-12)


def test_core_cells_match_the_rings():
    """Along an axis, the cells of the core, of the layers around it and of the next rings are alike."""
    for name in CASES:
        mesh = body("round", name, around=8)
        along = np.sort(mesh.points[np.intersect1d(mesh.node_sets["top"], mesh.node_sets["y0"]), 0])
        cells = np.diff(along)[:8]
        assert cells.max() < 2.0 * cells.min()


def test_core_stays_within_its_bound():
    radii = stations(30e-3, [], largest_m=2e-3, breaks_m=[5e-3])
    free, bound = (cylinder_mesh(radii, [0.0, 1e-3], 24, core_m=core) for core in (np.inf, 5e-3))
    wanted = radii[radii >= 5e-3] * ring_factor(24)
    stations_m = bound.points[bound.node_sets["y0"], 0]
    assert np.isclose(stations_m[:, None], wanted, rtol=1e-14, atol=0.0).any(axis=0).all()
    assert not np.isclose(free.points[free.node_sets["y0"], 0], wanted[0], rtol=1e-14, atol=0.0).any()
    # No station within the bound: the first ends the core.
    least = cylinder_mesh(radii, [0.0, 1e-3], 24, core_m=0.0)
    assert np.isclose(least.points[:, 0], radii[1] * ring_factor(24), rtol=1e-14, atol=0.0).any()
    for mesh in (free, bound, least):
        assert assess(mesh).smallest_scaled_jacobian > 0.75


@pytest.mark.parametrize("around", AROUND)
@pytest.mark.parametrize("aspect", [1.0, 1.3, 1.7, 2.0, 0.5])
@pytest.mark.parametrize("share", [0.15, 0.5, 0.9])
def test_block_mesh_has_the_volume_of_the_block_and_good_elements(around, aspect, share):
    b = 20e-3
    a = aspect * b
    radii = stations(share * min(a, b), [(0.6 * share * min(a, b), 0.8 * share * min(a, b), 0.4e-3)], largest_m=2.5e-3)
    heights = CASES["flat punch on a layer"].heights
    mesh = ringed_block((a, b), radii, heights, around, largest_m=3e-3)
    check(mesh, "block")
    assert (corner_jacobians(mesh.points, mesh.hexes) > 0.0).all()
    quality = assess(mesh)
    assert quality.volume_m3 == pytest.approx(a * b * heights[-1], rel=1e-12)
    assert quality.smallest_scaled_jacobian > 0.35
    # The circle is one of the rings, the corner a node.
    distance = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    circle = np.isclose(distance, radii[-1] * ring_factor(around), rtol=1e-14, atol=0.0)
    assert circle.sum() == (around + 1) * len(heights)
    assert (mesh.points[:, :2] == [a, b]).all(axis=1).sum() == len(heights)


@every_case
def test_grid_is_made_of_bricks(name):
    mesh = body("grid", name)
    check(mesh, name)
    a, b = half_sizes(name)
    np.testing.assert_allclose(scaled_jacobians(mesh.points, mesh.hexes), 1.0, rtol=1e-12)
    assert assess(mesh).volume_m3 == pytest.approx(a * b * CASES[name].height * MM, rel=1e-12)


# --- cylinders and blocks: nodes, faces, sets ------------------------------------------------------------------------


@every_case
@every_shape
@every_symmetry
def test_symmetries_are_exact_copies_of_the_quarter(shape, name, symmetry):
    quarter, mesh = body(shape, name), body(shape, name, symmetry)
    copies = SYMMETRIES[symmetry]
    check(mesh, name)
    assert mesh.element_count == copies * quarter.element_count
    volume = assess(quarter).volume_m3
    assert assess(mesh).volume_m3 == pytest.approx(copies * volume, rel=1e-12)
    # To the last bit; adding 0.0 turns -0.0 into 0.0, which are not the same row otherwise.
    rows = np.unique(mesh.points, axis=0)
    assert len(rows) == mesh.node_count
    for signs in [[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0]][: {1: 0, 2: 1, 4: 2}[copies]]:
        assert (np.unique(mesh.points * signs + 0.0, axis=0) == rows).all()
    assert not np.signbit(mesh.points[mesh.points == 0.0]).any()


@every_case
@pytest.mark.parametrize("around", [4, 8, 20])
def test_round_mesh_is_symmetric_about_the_diagonal(name, around):
    mesh = body("round", name, around=around)
    distance, _ = cKDTree(mesh.points).query(mesh.points[:, [1, 0, 2]])
    # Some operations on numbers up to the radius: a few eps of it.
    assert distance.max() <= 8.0 * np.finfo(float).eps * mesh.points[:, 0].max()


@every_case
@every_shape
@every_symmetry
def test_nodes_are_distinct_and_faces_shared(shape, name, symmetry):
    """Each face belongs to two elements, or lies in the boundary, and then in exactly one of the sets of the boundary."""
    mesh = body(shape, name, symmetry)
    assert (np.unique(mesh.hexes) == np.arange(mesh.node_count)).all()
    nearest, _ = cKDTree(mesh.points).query(mesh.points, k=2)
    assert nearest[:, 1].min() > 0.5 * edge_lengths(mesh.points, mesh.hexes).min()

    faces, count = faces_of(mesh)
    assert set(count) == {1, 2}
    boundary = faces[count == 1]
    names = [key for key in mesh.node_sets if key != "axis"]
    of_set = {key: np.isin(boundary, mesh.node_sets[key]).all(axis=1) for key in names}
    assert (np.sum(list(of_set.values()), axis=0) == 1).all()
    for key, mask in of_set.items():
        assert (np.unique(boundary[mask]) == mesh.node_sets[key]).all()
    assert of_set["base"].sum() == of_set["top"].sum() == mesh.element_count // (len(CASES[name].heights) - 1)
    assert sum(mask.sum() for mask in of_set.values()) == len(boundary)


@every_case
@every_shape
@every_symmetry
def test_sets_lie_where_they_should(shape, name, symmetry):
    mesh = body(shape, name, symmetry)
    case = CASES[name]
    x, y, z = mesh.points.T
    a, b = half_sizes(name)
    if shape == "round":
        side = np.isclose(np.hypot(x, y), case.radii[-1] * ring_factor(8), rtol=1e-14, atol=0.0)
    else:
        side = (np.abs(x) == a) | (np.abs(y) == b)
    expected = {"base": z == 0.0, "top": z == case.heights[-1], "side": side, "axis": (x == 0.0) & (y == 0.0)}
    if symmetry == "quarter":
        expected["x0"] = x == 0.0
    if symmetry != "whole":
        expected["y0"] = y == 0.0
    assert set(mesh.node_sets) == set(expected)
    for key, mask in expected.items():
        assert (mesh.node_sets[key] == np.flatnonzero(mask)).all()
    assert (np.unique(z) == case.heights).all()
    assert len(mesh.node_sets["axis"]) == len(case.heights)
    assert (mesh.named_points["top-centre"].position == [0.0, 0.0, case.heights[-1]]).all()
    assert (x.min() >= 0.0) == (symmetry == "quarter") and (y.min() >= 0.0) == (symmetry != "whole")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda r, h: cylinder_mesh(r, h, 7), "even number"),
        (lambda r, h: cylinder_mesh(r, h, 2), "even number"),
        (lambda r, h: cylinder_mesh(r, h, 8, "third"), "symmetry must be one of"),
        (lambda r, h: cylinder_mesh(r[1:], h, 8), "radii must rise"),
        (lambda r, h: cylinder_mesh(r, h[::-1], 8), "heights must rise"),
        (lambda r, h: cylinder_mesh(r, [0.0, np.inf], 8), "heights must rise"),
        (lambda r, h: sector_mesh(r, h, 0.0), "angle"),
        (lambda r, h: sector_mesh(r, h, np.nan), "angle"),
        (lambda r, h: sector_mesh([0.0], h, 0.1), "radii must rise"),
        (lambda r, h: ringed_block((0.03, 0.02), r, h, 8, largest_m=0.01), "does not fit"),
        (lambda r, h: gridded_block(r, [0.0, 1.0, 1.0], h), "y must rise"),
    ],
)
def test_meshes_that_cannot_be(make, words):
    with pytest.raises(ValueError, match=words):
        make(np.linspace(0.0, 0.02, 9), np.linspace(0.0, 0.01, 4))
