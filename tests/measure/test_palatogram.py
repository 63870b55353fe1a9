"""Palatograms of plates and bumps of known shape under a flat palate: exact cells, on any mesh, wherever the palate is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from command import command
from support import ROOT, result_writer

from explicitfe.app.view.palatogram import TOUCHED, palatogram_figure
from explicitfe.fem.bones.tables import read_bones
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.results.files import FINISHED, Quantity, open_result
from explicitfe.results.measure.measure import measure
from explicitfe.results.measure.palatogram import anteriority, centrality, centre_of_gravity, electrodes_of, palatogram
from explicitfe.results.measure.tract import TOUCHING_GAP_M
from explicitfe.simulate.anatomy import catalogue

# A "tongue": a block of 60 x 40 x 20 mm, front at x = 0, symmetric in y, its top at z = 0, under a flat palate at z = 0 from
# x = -5 to 65 mm and |y| = 15 mm. The last row lies 2.5 mm before its end, the first 8 mm behind its front, so that rows lie
# 8 + 59.5 n / 11 mm behind its front, n = 0, 1, 2, 3, 5 ... 11, and columns at |y| = 15 / 7, 45 / 7, 75 / 7 and 15 mm.
SIZE_M = np.array([0.06, 0.04, 0.02])
ROW_X_M = -0.005 + 0.008 + 0.0595 / 11 * np.array([0, 1, 2, 3, 5, 7, 9, 11])
COLUMN_Y_M = 0.015 / 7 * np.array([-7, -5, -3, -1, 1, 3, 5, 7])
PRESSURE_PA = 500.0
WHOLE = {"hard_palate_mm": 70.0}  # all of the flat palate is hard
Clearance = Callable[[np.ndarray, np.ndarray], np.ndarray]
NO_TURN = np.eye(3)


def block(cells: tuple[int, int, int] = (12, 8, 2)) -> HexMesh:
    mesh = box(cells, SIZE_M)
    return HexMesh(mesh.points - SIZE_M * [0.0, 0.5, 1.0], mesh.hexes)


def flat_palate(length_m: float = 0.07) -> tuple[np.ndarray, np.ndarray]:
    mesh = box((7, 3, 1), (length_m, 0.03, 0.01))
    points = mesh.points + [-0.005, -0.015, 0.0]
    corners, _ = surface_triangles(HexMesh(points, mesh.hexes), points)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def write(
    path: Path,
    mesh: HexMesh,
    clearances: Sequence[np.ndarray],
    bone: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    turn: np.ndarray = NO_TURN,
    shift: np.ndarray | None = None,
    bone_table: dict[str, object] | None = None,
) -> Path:
    """A result whose top has given clearances (n,) m from a palate at z = 0, one sample every 10 ms; nodes inside it are pressed.

    From the second sample on palate and tongue are turned and shifted together.
    """
    top = mesh.points[:, 2] > -1e-9
    shift = np.zeros(3) if shift is None else shift
    with result_writer(
        path,
        mesh=mesh,
        bones={"palate": bone or flat_palate()},
        point_fields={"contact_pressure_palate": Quantity("Pa")},
        history={"bone_palate_placement": Quantity("1", 12)},
        scenario_text="",
        model={"scenario": {"analysis": {"type": "transient"}, "bone": [{"name": "palate", **WHOLE, **(bone_table or {})}]}},
        provenance={},
        overwrite=True,
    ) as result:
        for number, clearance in enumerate([np.full(mesh.node_count, 0.001), *clearances]):
            turned, shifted = (turn, shift) if number else (np.eye(3), np.zeros(3))
            place = mesh.points - np.where(top, clearance, 0.0)[:, None] * [0.0, 0.0, 1.0]
            pressure = np.where(top & (clearance < 0.0), PRESSURE_PA, 0.0)
            moved = place @ turned.T + shifted - mesh.points
            result.sample(
                0.01 * number,
                {"bone_palate_placement": np.concatenate([turned.ravel(), shifted])},
                {"displacement": moved, "contact_pressure_palate": pressure},
            )
        return result.finish(FINISHED, "", {})


def plate(x_m: tuple[float, float], y_m: tuple[float, float], depth_m: float = 0.1e-3) -> Clearance:
    """A plate that has gone so deep into the palate, with flanks of 45 degrees around it."""

    def clearance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        beside = np.maximum.reduce([np.zeros_like(x), x_m[0] - x, x - x_m[1], y_m[0] - y, y - y_m[1]])
        return beside - depth_m

    return clearance


def pattern_of(path: Path) -> np.ndarray:
    """The last pattern of a result, (8, 8) bool."""
    with open_result(path) as result:
        answer = palatogram(result, len(result.times) - 1)
    assert answer is not None
    return np.array([[bool(on) for on in row] for row in answer.now.electrodes])


def cells(rows: Sequence[int], columns: Sequence[int]) -> np.ndarray:
    """A pattern of rows and columns, from 1."""
    touched = np.zeros((8, 8), dtype=bool)
    touched[np.ix_(np.array(rows) - 1, np.array(columns) - 1)] = True
    touched[0, [0, 7]] = False
    return touched


def test_electrodes_lie_where_they_should(tmp_path):
    mesh = block()
    with open_result(write(tmp_path / "a.vtkhdf", mesh, [])) as result:
        at = electrodes_of(result)
    assert at is not None
    assert len(at.position) == 62
    np.testing.assert_allclose(at.position[:, 0], ROW_X_M[at.row], atol=1e-9)
    np.testing.assert_allclose(at.position[:, 1], COLUMN_Y_M[at.column], atol=1e-9)
    np.testing.assert_allclose(at.position[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(at.normal, np.tile([0.0, 0.0, -1.0], (62, 1)), atol=1e-12)
    np.testing.assert_allclose(1e3 * at.row_places, 5.0 + 1e3 * ROW_X_M, atol=1e-9)


def test_a_plate_lights_the_electrodes_over_it(tmp_path):
    mesh = block()
    # Rows at x = 13.8, 19.2 and 30.0 mm and columns at |y| = 2.1 and 6.4 mm lie over the plate. The next are at 8.4 and 40.9 mm
    # and at 10.7 mm, where 1.5, 0.8 and 0.6 mm are free.
    path = write(tmp_path / "a.vtkhdf", mesh, [plate((0.01, 0.04), (-0.01, 0.01))(*mesh.points[:, :2].T)])
    np.testing.assert_array_equal(pattern_of(path), cells([3, 4, 5], [3, 4, 5, 6]))
    with open_result(path) as result:
        answer = palatogram(result, 1)
        pressure = np.array([[value or 0.0 for value in row] for row in answer.pressure_kPa])
        np.testing.assert_allclose(pressure, 1e-3 * PRESSURE_PA * cells([3, 4, 5], [3, 4, 5, 6]))
        # 7 x 5 nodes of 25 mm2 are pressed.
        assert answer.course.area_mm2 == pytest.approx([0.0, 35 * 25.0])
        assert answer.course.force_N == pytest.approx([0.0, 35 * 25.0e-6 * PRESSURE_PA])
        assert answer.course.contacts == [0, 12]


def test_closure_and_one_side(tmp_path):
    mesh = block()
    x, y = mesh.points[:, :2].T
    # From side to side, under rows 2 to 4, at x = 8.4, 13.8 and 19.2 mm.
    path = write(tmp_path / "a.vtkhdf", mesh, [plate((0.005, 0.025), (-0.02, 0.02))(x, y)])
    np.testing.assert_array_equal(pattern_of(path), cells([2, 3, 4], range(1, 9)))
    with open_result(path) as result:
        assert palatogram(result, 1).now.closed_rows == [2, 3, 4]
    # y is to the speaker's right, which is at the right of the pattern; row 1 has no electrode at the end.
    path = write(tmp_path / "b.vtkhdf", mesh, [plate((0.0, 0.025), (0.01, 0.02))(x, y)])
    np.testing.assert_array_equal(pattern_of(path), cells([1, 2, 3, 4], [7, 8]))
    with open_result(path) as result:
        assert palatogram(result, 1).now.closed_rows == []


@pytest.mark.parametrize("cells_of_mesh", [(12, 8, 2), (17, 11, 2), (30, 20, 2)])
def test_a_bump_lights_the_same_electrodes_on_every_mesh(tmp_path, cells_of_mesh):
    radius, depth = 0.050, 1.8e-3

    def bump(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return ((x - 0.035) ** 2 + y**2) / (2.0 * radius) - depth

    mesh = block(cells_of_mesh)
    x, y = np.meshgrid(ROW_X_M, COLUMN_Y_M, indexing="ij")
    expected = bump(x, y) < 0.0
    expected[0, [0, 7]] = False
    # Between nodes 5 mm apart or less the height of the bump is off by up to (5^2 + 5^2) / 8 R. What is free by less than
    # TOUCHING_GAP_M beside it may be on, depending on the mesh: no electrode is as near as that to its edge.
    off = 50e-6 / (8.0 * radius)
    assert not np.any((bump(x, y) > -off) & (bump(x, y) < TOUCHING_GAP_M + off))
    assert expected.sum() == 12
    path = write(tmp_path / "a.vtkhdf", mesh, [bump(*mesh.points[:, :2].T)])
    np.testing.assert_array_equal(pattern_of(path), expected)


def test_a_palate_that_moves_takes_its_electrodes_along(tmp_path):
    mesh = block()
    x, y = mesh.points[:, :2].T
    angle = np.radians(20.0)
    turn = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    here = plate((0.01, 0.04), (-0.01, 0.01))(x, y)
    together = write(tmp_path / "a.vtkhdf", mesh, [here], turn=turn, shift=np.array([-0.012, 0.003, 0.02]))
    np.testing.assert_array_equal(pattern_of(together), cells([3, 4, 5], [3, 4, 5, 6]))
    # A palate 8 mm further forward at rest has its electrodes there: rows at x = 11.2, 22.0 and 32.9 mm lie over the plate.
    points, triangles = flat_palate()
    forward = write(tmp_path / "b.vtkhdf", mesh, [here], (points - [0.008, 0.0, 0.0], triangles))
    np.testing.assert_array_equal(pattern_of(forward), cells([4, 5, 6], [3, 4, 5, 6]))


def test_what_is_near_but_not_pressed_is_off(tmp_path):
    mesh = block()
    for clearance in (0.0, 0.5 * TOUCHING_GAP_M):
        path = write(tmp_path / "a.vtkhdf", mesh, [np.full(mesh.node_count, clearance)])
        assert not pattern_of(path).any()


def test_a_symmetric_tongue_has_a_symmetric_pattern(tmp_path):
    mesh = catalogue.built_in("tongue", cells=(10, 6, 8)).mesh
    surface = read_bones(ROOT / "models" / "tongue" / "bones.toml")["palate"].surface
    pressed = np.where((surface_areas(mesh) > 0.0) & (np.abs(mesh.points[:, 1]) > 0.008), PRESSURE_PA, 0.0)
    lifted = np.tile([0.0, 0.0, 0.0025], (mesh.node_count, 1))
    with result_writer(
        tmp_path / "a.vtkhdf",
        mesh=mesh,
        bones={"palate": (surface.points, surface.triangles)},
        point_fields={"contact_pressure_palate": Quantity("Pa")},
        scenario_text="",
        model={"scenario": {"analysis": {"type": "transient"}}},
        provenance={},
    ) as result:
        result.sample(0.0, {}, {"displacement": lifted, "contact_pressure_palate": pressed})
        path = result.finish(FINISHED, "", {})
    touched = pattern_of(path)
    np.testing.assert_array_equal(touched, touched[:, ::-1])
    assert 2 <= touched.sum() < 62
    with open_result(path) as opened:
        at = electrodes_of(opened)
    # The last row lies where the velum begins, at x = 103 mm, the first on the gum behind the incisors, whose edge is at 50 mm.
    assert at.position[at.row == 7, 0].max() == pytest.approx(0.103, abs=1e-3)
    assert at.position[at.row == 0, 0].min() == pytest.approx(0.055, abs=1e-3)


def test_first_contact_and_duration(tmp_path):
    mesh = block()
    x, y = mesh.points[:, :2].T
    small, large = plate((0.01, 0.025), (-0.01, 0.01)), plate((0.01, 0.04), (-0.01, 0.01))
    none = plate((0.01, 0.04), (-0.01, 0.01), -1e-3)
    path = write(tmp_path / "a.vtkhdf", mesh, [course(x, y) for course in (none, small, large, large, none)])
    with open_result(path) as result:
        answer = palatogram(result, 5)
        before = palatogram(result, 2)
    assert answer.now.contacts == 0
    assert answer.now.centre_of_gravity is None
    assert (answer.most.time_ms, answer.most.contacts) == (pytest.approx(30.0), 12)
    # Samples every 10 ms: rows 3 and 4 are on at 20, 30 and 40 ms, row 5 at 30 and 40.
    assert answer.first_contact_ms[1][3] is None
    assert [answer.first_contact_ms[row][3] for row in (2, 3, 4)] == pytest.approx([20.0, 20.0, 30.0])
    assert [answer.duration_ms[row][3] for row in (1, 2, 3, 4)] == pytest.approx([0.0, 30.0, 30.0, 20.0])
    assert answer.duration_ms[0][0] is None
    assert (before.now.contacts, before.duration_ms[2][3]) == (8, pytest.approx(5.0))


def test_how_long_the_hard_palate_is(tmp_path):
    mesh = block()
    with open_result(write(tmp_path / "a.vtkhdf", mesh, [], bone_table={"hard_palate_mm": 41.0})) as result:
        np.testing.assert_allclose(1e3 * electrodes_of(result).row_places, [8, 11, 14, 17, 23, 29, 35, 41], atol=1e-9)
    with open_result(write(tmp_path / "b.vtkhdf", mesh, [], bone_table={"hard_palate_mm": 500.0})) as result:
        assert 1e3 * electrodes_of(result).row_places[-1] == pytest.approx(67.5)
    with open_result(write(tmp_path / "c.vtkhdf", mesh, [], flat_palate(0.007))) as result:
        assert electrodes_of(result) is None
    with open_result(write(tmp_path / "d.vtkhdf", mesh, [], bone_table={"hard_palate_mm": None})) as result:
        np.testing.assert_allclose(1e3 * electrodes_of(result).row_places[[0, -1]], [8, 60], atol=1e-9)


def test_a_thick_plate_is_touched_from_further_away(tmp_path):
    mesh = block()
    # Without contact: 1 mm is free over a plate, and beside it 1 mm more at each mm of distance.
    near = plate((0.01, 0.04), (-0.01, 0.01), -1e-3)(*mesh.points[:, :2].T)
    for plate_mm, pattern in ((0.0, cells([], [])), (0.9, cells([], [])), (1.1, cells([3, 4, 5], [3, 4, 5, 6]))):
        path = write(tmp_path / f"{plate_mm}.vtkhdf", mesh, [near], bone_table={"plate_mm": plate_mm})
        np.testing.assert_array_equal(pattern_of(path), pattern)


def test_centre_of_gravity_as_emur_computes_it():
    # The two patterns of emuR's help of `epgcog`, after Gibbon and Nicolaidis (1999), Fig. 10.5: 0.5 and 1.17.
    first, second = np.zeros((8, 8), dtype=bool), np.zeros((8, 8), dtype=bool)
    first[7, 2:6] = True
    second[5, 2] = True
    second[6:, 2:6] = True
    assert centre_of_gravity(first) == pytest.approx(0.5)
    assert centre_of_gravity(second) == pytest.approx(1.17, abs=0.005)


def test_indices_weigh_one_electrode_more_than_all_that_count_less():
    whole = cells(range(1, 9), range(1, 9))
    assert anteriority(whole) == pytest.approx(1.0)
    assert centrality(whole) == pytest.approx(1.0)
    assert anteriority(np.zeros((8, 8), dtype=bool)) == centrality(np.zeros((8, 8), dtype=bool)) == 0.0
    for row in range(1, 5):
        behind = cells(range(row + 1, 9), range(1, 9))
        assert anteriority(cells([row], [4])) > anteriority(behind)
    for column in range(2, 5):
        beside = cells(range(1, 9), [*range(1, column), *range(10 - column, 9)])
        assert centrality(cells([5], [column])) > centrality(beside)
    # ln(1 + 729 x 8 / 8) / ln(1 + 4921 + 729 + 81 + 9 + 1)
    assert anteriority(cells([2], range(1, 9))) == pytest.approx(np.log(730.0) / np.log(5742.0))


def test_the_table_and_the_picture(tmp_path, capsys):
    mesh = block()
    path = write(tmp_path / "a.vtkhdf", mesh, [plate((0.005, 0.025), (-0.02, 0.02))(*mesh.points[:, :2].T)])
    assert measure(path).palatogram.now.contacts == 24
    assert command(["measure", str(path)]) == 0
    lines = [line.strip("│ \n") for line in capsys.readouterr().out.splitlines()]
    first = next(k for k, line in enumerate(lines) if line == "○○○○○○")
    assert lines[first + 1 : first + 8] == ["●●●●●●●●"] * 3 + ["○○○○○○○○"] * 4
    assert "closed rows: 2, 3, 4" in " ".join(" ".join(lines).replace("│", " ").split())
    with open_result(path) as result:
        figure = palatogram_figure(result, 1)
        squares = figure.axes[0].patches
        assert len(squares) == 62
        assert sum(square.get_facecolor()[:3] == (0.0, 0.0, 0.0) for square in squares) == 24
        assert TOUCHED == "black"


def test_the_picture_follows_contact_and_release(tmp_path):
    mesh = block()
    x, y = mesh.points[:, :2].T
    pressed, free = plate((0.01, 0.04), (-0.01, 0.01))(x, y), np.full(mesh.node_count, 1e-3)
    path = write(tmp_path / "a.vtkhdf", mesh, [free] * 5 + [pressed] * 4 + [free] * 10)
    with open_result(path) as result:
        patterns = palatogram_figure(result, 19).axes[1:7]
    # Samples every 10 ms: contact from 60 to 90 ms.
    assert [axes.get_title() for axes in patterns] == ["50 ms", "60 ms", "70 ms", "80 ms", "90 ms", "100 ms"]
    black = [sum(square.get_facecolor()[:3] == (0.0, 0.0, 0.0) for square in axes.patches) for axes in patterns]
    assert black == [0, 12, 12, 12, 12, 0]


def test_without_a_palate_or_its_pressure_there_is_none(tmp_path):
    mesh = block()
    for name, fields in (("jaw", {"contact_pressure_jaw": Quantity("Pa")}), ("palate", {})):
        with result_writer(
            tmp_path / f"{name}.vtkhdf",
            mesh=mesh,
            bones={name: flat_palate()},
            point_fields=fields,
            scenario_text="",
            model={"scenario": {"analysis": {"type": "transient"}}},
            provenance={},
        ) as result:
            zero = {key: np.zeros(mesh.node_count) for key in fields}
            result.sample(0.0, {}, {"displacement": np.zeros_like(mesh.points), **zero})
            path = result.finish(FINISHED, "", {})
        assert measure(path).palatogram is None
        with open_result(path) as opened:
            assert palatogram_figure(opened, 0) is None
