"""The leak of shapes whose widest way and smallest cross-section are known: plates, slits and cylinders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support import result_writer

from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.triangles import surface_triangles, triangle_distance
from explicitfe.results.files import FINISHED, Quantity, open_result
from explicitfe.results.measure.leak import SAMPLES_TRIED, Leak, gaps_below, leak_history, leak_in, times_below
from explicitfe.results.measure.measure import measure
from explicitfe.results.measure.numbers import numbers_at
from explicitfe.results.measure.roof_grid import GRID_SPACING_M, clearance, roof_grid, surface_samples
from explicitfe.simulate.anatomy import catalogue

MM = 1e-3
LENGTH_M, HALF_WIDTH_M = 0.07, 0.015  # of the flat roof at z = 0
DEEP_M, AWAY_M = 0.1e-3, 5e-3  # how far a bar overlaps the roof, and how far the tongue lies below it elsewhere
WALL_M = 1e-6  # over which a wall rises
Height = Callable[[np.ndarray, np.ndarray], np.ndarray]
Span = tuple[float, float]


def sheet(first: np.ndarray, second: np.ndarray, place: Height) -> np.ndarray:
    """Triangles (m, 3, 3) of the points ``place`` gives for all pairs of two parameters; normals upwards."""
    points = place(*np.meshgrid(first, second, indexing="ij"))
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack(corners, axis=-2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])


def over_xy(height: Height) -> Height:
    return lambda x, y: np.stack([x, y, height(x, y)], axis=-1)


def flat_roof() -> np.ndarray:
    ends = np.linspace(0.0, LENGTH_M, 8), np.linspace(-HALF_WIDTH_M, HALF_WIDTH_M, 4)
    return sheet(*ends, over_xy(lambda x, y: np.zeros_like(x)))


def bar(x: Span, slits: list[tuple[Span, Span, float]]) -> np.ndarray:
    """A tongue that touches the flat roof in a bar over x mm, but for slits: their spans in x and y mm, and their depth mm."""
    walls = [np.array([each[k] for each in slits]).ravel() for k in (0, 1)]
    lines = [
        np.unique(np.concatenate([MM * edges, MM * edges + WALL_M, MM * np.arange(low, high, 2.0)]))
        for edges, low, high in ((np.append(walls[0], x), -5.0, 76.0), (walls[1], -20.0, 21.0))
    ]

    def height(along: np.ndarray, across: np.ndarray) -> np.ndarray:
        def within(at: np.ndarray, span: Span) -> np.ndarray:
            return (at > MM * span[0] + 0.5 * WALL_M) & (at < MM * span[1] + 0.5 * WALL_M)

        z = np.where(within(along, x), DEEP_M, -AWAY_M)
        for span_x, span_y, depth in slits:
            z = np.where(within(along, span_x) & within(across, span_y), -MM * depth, z)
        return z

    return sheet(*lines, over_xy(height))


def leak_between(roof: np.ndarray, tongue: np.ndarray) -> Leak:
    grid = roof_grid(roof, 0.0)
    assert grid is not None
    points = grid.points.at(roof)
    return leak_in(grid, points, gaps_below(points, tongue, surface_samples(tongue), grid.to_border))


def flat_tongue(gap_mm: float) -> np.ndarray:
    lines = MM * np.arange(-5.0, 76.0, 3.0), MM * np.arange(-20.0, 21.0, 4.0)
    return sheet(*lines, over_xy(lambda x, y: np.full_like(x, -MM * gap_mm)))


@pytest.mark.parametrize("gap_mm", [0.31, 0.5, 1.0, 2.7])
def test_between_two_plates_the_leak_is_their_distance(gap_mm):
    found = leak_between(flat_roof(), flat_tongue(gap_mm))
    assert 1e3 * found.width_m == pytest.approx(gap_mm, abs=1e-6)
    # The borders are walls: on each side half of gap^2 is lost. Integrals over the grid err by a cell at each border.
    assert 1e6 * found.area_m2 == pytest.approx(30.0 * gap_mm - gap_mm**2, abs=1e3 * GRID_SPACING_M * gap_mm)
    assert not found.closed


@pytest.mark.parametrize("gap_mm", [0.29, 0.0, -0.5])
def test_what_is_narrower_than_the_limit_is_closed(gap_mm):
    found = leak_between(flat_roof(), flat_tongue(gap_mm))
    assert found.closed and found.area_m2 == 0.0
    assert 1e3 * found.width_m == pytest.approx(max(0.0, gap_mm), abs=1e-6)


@pytest.mark.parametrize(("y", "depth_mm"), [((-6.0, 6.0), 1.0), ((-5.5, 6.5), 1.0), ((2.0, 10.0), 1.5), ((-3.0, -1.0), 3.0)])
def test_a_straight_slit_in_a_bar(y, depth_mm):
    found = leak_between(flat_roof(), bar((30.0, 40.0), [((30.0, 40.0), y, depth_mm)]))
    wide = y[1] - y[0]
    reach = min(depth_mm, 0.5 * wide)  # the gap grows from each wall as the distance from it does
    assert 1e3 * found.width_m == pytest.approx(reach, abs=2e-3)
    assert 1e6 * found.area_m2 == pytest.approx(wide * reach - reach**2, abs=0.5e3 * GRID_SPACING_M * reach)
    assert 29.0 < 1e3 * found.place_m < 41.0 and y[0] < 1e3 * found.side_m < y[1]
    np.testing.assert_allclose(found.path[found.narrowest, 1], found.side_m, atol=1e-9)


def test_a_slit_that_bends():
    pieces = [((25.0, 33.0), (-8.0, -4.0), 0.8), ((33.0, 37.0), (-8.0, 8.0), 0.8), ((37.0, 45.0), (4.0, 8.0), 0.8)]
    found = leak_between(flat_roof(), bar((25.0, 45.0), pieces))
    assert 1e3 * found.width_m == pytest.approx(0.8, abs=1e-6)
    assert 1e6 * found.area_m2 == pytest.approx(4.0 * 0.8 - 0.8**2, abs=0.5e3 * GRID_SPACING_M * 0.8)
    x, y, _ = 1e3 * found.path.T
    assert np.all(np.hypot(*np.diff(found.path[:, :2], axis=0).T) < 1.5 * GRID_SPACING_M)
    assert np.all(np.abs(y[(x > 26.0) & (x < 33.0)] + 6.0) < 2.0) and np.all(np.abs(y[(x > 37.0) & (x < 44.0)] - 6.0) < 2.0)
    assert x[0] < 1.0 and x[-1] > 69.0


def test_a_closed_bar_and_one_that_ends_before_the_border():
    closed = leak_between(flat_roof(), bar((30.0, 40.0), []))
    assert closed.closed and (closed.width_m, closed.area_m2) == (0.0, 0.0)
    assert 29.0 < 1e3 * closed.place_m < 41.0
    # 6 mm are free to the border, which is a wall too.
    beside = leak_between(flat_roof(), bar((30.0, 40.0), [((30.0, 40.0), (9.0, 20.0), 2.0)]))
    assert 1e3 * beside.width_m == pytest.approx(2.0, abs=1e-6)
    assert 1e6 * beside.area_m2 == pytest.approx(6.0 * 2.0 - 2.0**2, abs=0.5e3 * GRID_SPACING_M * 2.0)
    assert beside.side_m > 9e-3


def test_a_horseshoe_that_no_plane_section_shows():
    """Two bars at the sides and one across in front: each section is open on one side of it, and nothing gets through."""
    lines = MM * np.arange(-5.0, 75.5, 0.5), MM * np.arange(-20.0, 20.5, 0.5)

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        from_line = np.abs(x - 20e-3 - 2.0 * np.abs(y))
        return np.where(from_line < 3e-3, DEEP_M, -AWAY_M)

    roof, tongue = flat_roof(), sheet(*lines, over_xy(height))
    assert leak_between(roof, tongue).closed
    open_at_side = leak_between(roof, sheet(*lines, over_xy(lambda x, y: np.where(y > 10e-3, -AWAY_M, height(x, y)))))
    assert not open_at_side.closed and open_at_side.side_m > 10e-3


RADIUS_M = 0.02


def vault(radius: Height) -> np.ndarray:
    """A half pipe along x, of a radius m over x m and the angle from the top."""

    def place(x: np.ndarray, angle: np.ndarray) -> np.ndarray:
        r = radius(x, angle)
        return np.stack([x, r * np.sin(angle), r * np.cos(angle)], axis=-1)

    return sheet(MM * np.arange(0.0, 61.0, 2.0), np.linspace(-0.5 * np.pi, 0.5 * np.pi, 361), place)


@pytest.mark.parametrize(("radius_mm", "lower_mm"), [(19.0, 0.0), (18.0, 1.0), (18.5, 3.0)])
def test_a_cylinder_under_a_half_pipe(radius_mm, lower_mm):
    tongue = vault(lambda x, angle: np.full_like(x, MM * radius_mm)) - [0.0, 0.0, MM * lower_mm]
    found = leak_between(vault(lambda x, angle: np.full_like(x, RADIUS_M)), tongue)
    arc = np.linspace(0.0, 0.5 * np.pi * 20.0, 4001)
    gap = np.sqrt(20.0**2 + lower_mm**2 + 40.0 * lower_mm * np.cos(arc / 20.0)) - radius_mm
    area = 2.0 * np.trapezoid(np.minimum(gap, arc[-1] - arc), arc)
    flat = 20.0 * (1.0 - np.cos(np.pi / 720.0))  # of the facets
    assert 1e3 * found.width_m == pytest.approx(20.0 + lower_mm - radius_mm, abs=2.0 * flat + 1e-4)
    assert 1e6 * found.area_m2 == pytest.approx(area, abs=0.5e3 * GRID_SPACING_M * gap[-1] + 62.8 * flat)


@pytest.mark.parametrize(("open_deg", "over_mm", "beside_mm"), [((75.0, 91.0), 0.0, 1.0), ((0.0, 40.0), 1.0, 0.0)])
def test_over_the_plate_and_beside_the_molars(open_deg, over_mm, beside_mm):
    """The edge of the gum is at a third of the height, at acos(1/3) = 70.5 degrees from the top."""

    def radius(x: np.ndarray, angle: np.ndarray) -> np.ndarray:
        free = (np.abs(np.degrees(angle)) > open_deg[0]) & (np.abs(np.degrees(angle)) < open_deg[1])
        return np.where((x > 20e-3) & (x < 40e-3) & ~free, RADIUS_M + DEEP_M, RADIUS_M - 1e-3)

    found = leak_between(vault(lambda x, angle: np.full_like(x, RADIUS_M)), vault(radius))
    assert 1e3 * np.array([found.over_plate_m, found.beside_molars_m]) == pytest.approx([over_mm, beside_mm], abs=5e-3)
    assert found.width_m == max(found.over_plate_m, found.beside_molars_m)


def test_a_mirrored_tongue_has_the_mirrored_leak():
    lines = MM * np.arange(-5.0, 76.0, 1.5), MM * np.arange(-20.0, 20.5, 1.5)
    waves = np.random.default_rng(9).uniform(100.0, 700.0, (6, 2))
    shifts = np.random.default_rng(4).uniform(0.0, 6.0, 6)

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        rough = sum(np.sin(p * x + q * y + shift) for (p, q), shift in zip(waves, shifts, strict=True))
        return -MM * (0.55 + 0.05 * rough)  # except near the border everywhere less than the distance from that

    roof, tongue = flat_roof(), sheet(*lines, over_xy(height))
    found = leak_between(roof, tongue)
    mirrored = leak_between(roof, (tongue * [1.0, -1.0, 1.0])[:, ::-1])
    assert np.abs(found.side_m) > 1e-3
    np.testing.assert_allclose(mirrored.path, found.path * [1.0, -1.0, 1.0], atol=1e-9)
    figures = np.array([found.width_m, 1e3 * found.area_m2, found.place_m, -found.side_m])
    np.testing.assert_allclose([mirrored.width_m, 1e3 * mirrored.area_m2, mirrored.place_m, mirrored.side_m], figures, atol=1e-9)


def test_the_grid_goes_with_a_roof_that_is_bent():
    roof = catalogue.bones("tongue")["palate"].surface.corners
    grid = roof_grid(roof, 0.0)
    assert grid is not None
    at_rest = grid.points.at(roof)
    assert np.abs(at_rest[:, 1].reshape(grid.side.shape) - grid.side).max() < 1e-5
    change = np.array([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.3], [0.0, 0.1, 1.2]])
    np.testing.assert_allclose(grid.points.at(roof @ change + 0.01), at_rest @ change + 0.01, atol=1e-9)


def test_air_passes_around_a_uvula():
    """A roof 30 mm wide that comes to a point over its last 21 mm: it ends where a third of the width is left."""

    def place(x: np.ndarray, share: np.ndarray) -> np.ndarray:
        return np.stack([x, share * np.interp(x, [49e-3, LENGTH_M], [HALF_WIDTH_M, 0.0]), np.zeros_like(x)], axis=-1)

    roof = sheet(MM * np.arange(0.0, 71.0, 3.5), np.linspace(-1.0, 1.0, 7), place)
    grid = roof_grid(roof, 0.0)
    assert grid is not None
    assert 1e3 * grid.place[-1] == pytest.approx(49.0 + 21.0 * 2.0 / 3.0, abs=1e3 * GRID_SPACING_M)
    assert 1e3 * leak_between(roof, flat_tongue(2.0)).width_m == pytest.approx(2.0, abs=1e-6)


def test_the_distance_is_that_from_the_nearest_triangle():
    mesh = catalogue.built_in("tongue", "medium").mesh
    triangles, _ = surface_triangles(mesh, mesh.points)
    roof = catalogue.bones("tongue")["palate"].surface.corners
    grid = roof_grid(roof, 0.0)
    assert grid is not None
    points = grid.points.at(roof)[::31]
    found, _ = clearance(points, triangles, surface_samples(triangles), SAMPLES_TRIED)
    for point, distance in zip(points, found, strict=True):
        every = triangle_distance(np.broadcast_to(point, (len(triangles), 3)), triangles)
        assert abs(distance) == pytest.approx(every.min(), abs=2e-6)


def test_times_below_a_limit():
    times = np.arange(6.0)
    twice = times_below(times, np.array([2.0, 0.0, 0.5, 2.0, 3.0, 1.0]), 1.0)
    np.testing.assert_allclose(twice, [(0.5, 2.0 + 1.0 / 3.0), (5.0, 5.0)])
    assert times_below(times, np.full(6, 0.1), 1.0) == [(0.0, 5.0)]
    assert times_below(times, np.full(6, 2.0), 1.0) == []


def write(path: Path, gaps_mm: list[float], bones: list[str]) -> Path:
    """A block under the flat roof, with a gap at each sample, 10 ms apart; both are turned and shifted together."""
    mesh = box((12, 8, 2), (0.08, 0.04, 0.02))
    mesh = HexMesh(mesh.points - [0.005, 0.02, 0.02], mesh.hexes)
    corners = flat_roof()
    surface = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
    turn, _ = np.linalg.qr(np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 3.0]]))
    turn = turn * np.sign(np.linalg.det(turn))
    with result_writer(
        path,
        mesh=mesh,
        bones={name: surface for name in bones},
        point_fields={},
        history={f"bone_{name}_placement": Quantity("1", 12) for name in bones},
        scenario_text="",
        model={"scenario": {"analysis": {"type": "transient"}, "bone": [{"name": name} for name in bones]}},
        provenance={},
        overwrite=True,
    ) as result:
        for number, gap_mm in enumerate(gaps_mm):
            turned, shifted = (turn, np.array([0.01, 0.0, -0.02])) if number else (np.eye(3), np.zeros(3))
            placement = np.concatenate([turned.ravel(), shifted])
            moved = (mesh.points - [0.0, 0.0, MM * gap_mm]) @ turned.T + shifted - mesh.points
            result.sample(0.01 * number, {f"bone_{name}_placement": placement for name in bones}, {"displacement": moved})
        return result.finish(FINISHED, "", {})


def test_the_leak_of_a_result_over_time(tmp_path):
    path = write(tmp_path / "a.vtkhdf", [1.3, 0.8, 0.2, 0.2, 0.4], ["palate"])
    answer = measure(path).leak
    assert answer is not None and not answer.closed
    np.testing.assert_allclose(answer.course.width_mm, [1.3, 0.8, 0.2, 0.2, 0.4], atol=1e-6)
    np.testing.assert_allclose(answer.course.time_ms, [0.0, 10.0, 20.0, 30.0, 40.0])
    assert [area > 0.0 for area in answer.course.area_mm2] == [True, True, False, False, True]
    assert [(each.from_ms, each.to_ms, each.duration_ms) for each in answer.closures] == [
        pytest.approx((10.0 + 50.0 / 6.0, 35.0, 25.0 - 50.0 / 6.0))
    ]
    with open_result(path) as result:
        history = leak_history(result, 4)
        assert history is not None
        assert history.at(2).closed and history.widest(3)[:2] == (history.width_m[3], 0.0)
        assert numbers_at(result, 0.0)["leak.width_mm"] == pytest.approx(1.3)
        assert numbers_at(result, 0.02)["leak.closed"] is True
        # The path lies on the roof where that is now.
        rotation, shift = result.placement("palate", 4)
        np.testing.assert_allclose(((history.at(4).path - shift) @ rotation)[:, 2], 0.0, atol=1e-9)


def test_without_a_palate_there_is_no_leak(tmp_path):
    assert measure(write(tmp_path / "a.vtkhdf", [1.0], ["jaw"])).leak is None
