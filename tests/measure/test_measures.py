"""Measures of motions and shapes with known figures: rigid displacements, a bump, a dome over a flat tongue, even pressure."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from support import result_writer

from explicitfe.app.view.terminal.measures import measure_rows
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.triangles import plane_segments, surface_triangles
from explicitfe.platform.errors import InputError
from explicitfe.results.files import FINISHED, Quantity
from explicitfe.results.measure import motion, shape, tract
from explicitfe.results.measure.measure import measure

# A "tongue": a block of 60 x 40 x 20 mm, front at x = 0, symmetric in y, its top at z = 0.
SIZE_M = np.array([0.06, 0.04, 0.02])
DURATION_S, SAMPLES = 0.1, 20
Field = np.ndarray | Callable[[float], np.ndarray]
Bone = tuple[np.ndarray, np.ndarray]


def block(cells: tuple[int, int, int] = (12, 8, 4)) -> HexMesh:
    mesh = box(cells, SIZE_M)
    mesh = HexMesh(mesh.points - SIZE_M * [0.0, 0.5, 1.0], mesh.hexes)
    named = {"tip": (0.0, 0.0, 0.0), "front": (0.015, 0.0, 0.0), "dorsum": (0.03, 0.0, 0.0), "back": (0.045, 0.0, 0.0)}
    nodes = {name: int(np.argmin(np.linalg.norm(mesh.points - place, axis=1))) for name, place in named.items()}
    return mesh.with_named_nodes(nodes)


def write(
    path: Path,
    mesh: HexMesh,
    displacement: np.ndarray,
    *,
    course: Callable[[float], float] = lambda share: share,
    bones: Mapping[str, Bone] | None = None,
    pressure: Mapping[str, np.ndarray] | None = None,
    placement: Mapping[str, np.ndarray] | None = None,
    force: Mapping[str, np.ndarray] | None = None,
) -> Path:
    """A result whose displacement follows ``course`` over shares 0 to 1 of the duration; all else stays as it is given."""
    history = {f"bone_{name}_placement": Quantity("1", 12) for name in placement or {}}
    history |= {f"contact_{name}_force": Quantity("N", 3) for name in force or {}}
    row = {f"bone_{name}_placement": value for name, value in (placement or {}).items()}
    row |= {f"contact_{name}_force": value for name, value in (force or {}).items()}
    with result_writer(
        path,
        mesh=mesh,
        bones=bones,
        point_fields={f"contact_pressure_{name}": Quantity("Pa") for name in pressure or {}},
        history=history,
        scenario_text="",
        model={"scenario": {"title": "Known", "analysis": {"type": "transient"}}},
        provenance={},
        overwrite=True,
    ) as result:
        for number in range(SAMPLES + 1):
            share = number / SAMPLES
            fields = {f"contact_pressure_{name}": value for name, value in (pressure or {}).items()}
            result.sample(share * DURATION_S, row, {"displacement": course(share) * displacement, **fields})
        return result.finish(FINISHED, "", {})


def flat_palate(z_m: float, thickness_m: float = 0.01, half_width_m: float = 0.015) -> Bone:
    """A plate over the block, wider than long, from x = -5 mm to 65 mm."""
    mesh = box((7, 3, 1), (0.07, 2.0 * half_width_m, thickness_m))
    points = mesh.points + [-0.005, -half_width_m, z_m]
    corners, _ = surface_triangles(HexMesh(points, mesh.hexes), points)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def dome(radius_m: float, rim_m: float, centre: np.ndarray, rings: int = 60, spokes: int = 120) -> np.ndarray:
    """The underside of a palate, (m, 3, 3) m: half a sphere, hollow from below, in a flat rim at the height of its centre."""
    turn = np.linspace(0.0, 2.0 * np.pi, spokes + 1)
    polar = np.linspace(0.0, 0.5 * np.pi, rings + 1)
    r, h = radius_m * np.sin(polar), radius_m * np.cos(polar)
    r, h = np.append(r, radius_m + rim_m), np.append(h, 0.0)
    grid = np.stack([r[:, None] * np.cos(turn), r[:, None] * np.sin(turn), np.broadcast_to(h[:, None], (len(r), len(turn)))], -1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    # The innermost ring is a fan: its triangles with two corners at the apex have no area.
    halves = np.stack([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)], axis=2)
    return centre + halves.reshape(-1, 3, 3)


# Points and the whole body


def test_a_rigid_displacement_is_forward_and_up(tmp_path):
    mesh = block()
    shift = np.array([-0.004, 0.001, 0.0025])
    answer = measure(write(tmp_path / "a.vtkhdf", mesh, np.tile(shift, (mesh.node_count, 1))))
    assert list(answer.points) == ["back", "dorsum", "front", "tip"]
    speed = 1e3 * np.linalg.norm(shift) / DURATION_S
    for point in answer.points.values():
        assert (point.forward_mm, point.right_mm, point.up_mm) == pytest.approx((4.0, 1.0, 2.5), rel=1e-12)
        assert point.time_to_90_ms == pytest.approx(0.9 * 1e3 * DURATION_S, rel=1e-12)
        assert point.peak_speed_mm_s == pytest.approx(speed, rel=1e-9)
        assert point.speed_mm_s == pytest.approx(speed, rel=1e-9)
    body = answer.body
    assert body.time_to_90_ms == pytest.approx(0.9 * 1e3 * DURATION_S, rel=1e-9)
    assert body.largest_displacement_mm == pytest.approx(1e3 * np.linalg.norm(shift))
    assert body.fastest_mm_s == pytest.approx(speed, rel=1e-9)
    assert not body.settled
    assert body.volume_change_percent == pytest.approx(0.0, abs=1e-9)
    assert body.left_right_mm == pytest.approx(2.0, rel=1e-9)  # the mirror image of 1 mm to the right is 1 mm to the left
    assert body.self_penetration.nodes == 0
    assert answer.highest is not None
    assert (answer.highest.forward_mm, answer.highest.up_mm) == pytest.approx((4.0, 2.5), abs=1e-9)
    assert [groove.depth_mm for groove in answer.grooves.values()] == pytest.approx([0.0] * 3, abs=1e-12)
    assert answer.constriction is None
    assert answer.contact == {}


def test_earlier_times_are_measured_as_if_the_run_ended_there(tmp_path):
    mesh = block()
    path = write(tmp_path / "a.vtkhdf", mesh, np.tile([-0.004, 0.0, 0.0], (mesh.node_count, 1)))
    answer = measure(path, 0.0501)
    assert answer.time_ms == pytest.approx(50.0)
    assert answer.points["tip"].forward_mm == pytest.approx(2.0)
    assert answer.points["tip"].time_to_90_ms == pytest.approx(45.0)
    at_rest = measure(path, 0.0)
    assert at_rest.points["tip"].time_to_90_ms is None
    assert at_rest.body.time_to_90_ms is None
    assert at_rest.body.settled
    with pytest.raises(InputError, match=r"time 101 ms is outside the stored samples; give a time from 0 to 100 ms"):
        measure(path, 0.101)


def test_volume_and_symmetry_of_a_stretch(tmp_path):
    mesh = block()
    stretch = mesh.points * [0.1, -0.05, 0.02]
    body = measure(write(tmp_path / "a.vtkhdf", mesh, stretch)).body
    assert body.volume_change_percent == pytest.approx(100.0 * (1.1 * 0.95 * 1.02 - 1.0), rel=1e-9)
    assert body.left_right_mm == pytest.approx(0.0, abs=1e-12)
    random = np.random.default_rng(0).uniform(-1e-4, 1e-4, mesh.points.shape)
    odd = HexMesh(mesh.points + random, mesh.hexes, named_points=mesh.named_points)
    assert measure(write(tmp_path / "b.vtkhdf", odd, stretch)).body.left_right_mm is None


def test_rise_time_of_an_exponential_and_of_an_overshoot():
    times = np.linspace(0.0, 0.5, 2001)
    end = np.array([-3e-3, 0.0, 4e-3])
    course = (1.0 - np.exp(-times / 0.04)) / (1.0 - np.exp(-0.5 / 0.04))
    # 1 - exp(-t / tau) = 0.9 at tau ln 10; between samples it is linear, off by less than dt^2 / (8 tau) = 2e-7 s.
    assert motion.rise_time(times, course[:, None] * end) == pytest.approx(0.04 * np.log(10.0), abs=2e-6)
    # The first time counts: a course that shoots over comes back to its end later.
    swing = 1.0 - np.exp(-times / 0.1) * np.cos(40.0 * times)
    first = times[np.argmax(swing >= 0.9 * swing[-1])]
    assert motion.rise_time(times, swing[:, None] * end) == pytest.approx(first, abs=times[1])
    assert motion.rise_time(times, np.zeros((2001, 3))) is None
    # A movement that returns to near its place at rest has no rise time; even an undamped step response has one.
    returning = np.sin(2.0 * np.pi * times) + 1e-3 * times
    assert motion.rise_time(times, returning[:, None] * end) is None
    undamped = 1.0 - np.cos(2.0 * np.pi * times / 0.1)
    undamped[-1] = 1.0
    assert motion.rise_time(times, undamped[:, None] * end) == pytest.approx(0.1 * np.arccos(0.1) / (2.0 * np.pi), abs=1e-5)


def test_a_movement_that_has_returned_is_settled_and_has_its_largest_displacement(tmp_path):
    """The criterion compares the speed with the whole movement, and not with the remainder of a displacement at the end."""
    mesh = block()
    # Up to 1 and back: 10 um remain, and the last two samples are 2 um apart, 0.4 mm/s.
    course = np.concatenate([np.linspace(0.0, 1.0, 11), np.linspace(0.9, 0.003, 9), [0.0025]])
    path = write(
        tmp_path / "a.vtkhdf",
        mesh,
        np.tile([-0.004, 0.0, 0.0], (mesh.node_count, 1)),
        course=lambda share: course[round(share * SAMPLES)],
    )
    answer = measure(path)
    tip, body = answer.points["tip"], answer.body
    assert tip.forward_mm == pytest.approx(0.01) and tip.time_to_90_ms is None
    assert (tip.largest_mm, tip.largest_at_ms) == (pytest.approx(4.0), pytest.approx(50.0))
    assert body.settled and body.time_to_90_ms is None
    assert body.fastest_mm_s == pytest.approx(0.4, rel=1e-6)
    assert (body.largest_displacement_mm, body.largest_so_far_mm) == (pytest.approx(0.01), pytest.approx(4.0))
    # The terminal shows so many digits that a speed above 0 is not 0.
    assert dict(measure_rows(answer))["whole body"].endswith("settled, fastest node 0.40 mm/s")
    assert "largest 4.00 mm at 50 ms" in dict(measure_rows(answer))["tip"]
    at_the_top = measure(path, 0.05)
    assert at_the_top.points["tip"].time_to_90_ms == pytest.approx(45.0)


def test_settled_without_any_motion_and_while_moving():
    assert motion.has_settled(0.0, 0.0)
    assert not motion.has_settled(1e-6, 0.0)
    assert motion.has_settled(4e-3, 8e-3) and not motion.has_settled(4.1e-3, 8e-3)
    assert motion.largest_displacement(np.array([[3.0, 4.0, 0.0], [np.nan, 9.0, 9.0]])) == 5.0
    assert motion.largest_displacement(np.zeros((0, 3))) == 0.0


# Shape


def test_grooves_are_as_deep_as_their_midline_was_lowered_against_the_sides(tmp_path):
    mesh = block()
    top, y = 1.0 + mesh.points[:, 2] / SIZE_M[2], mesh.points[:, 1] / (0.5 * SIZE_M[1])
    depth = 0.001 + 0.1 * mesh.points[:, 0]  # 1 mm in front, 7 mm at the back
    sunk = np.zeros_like(mesh.points)
    sunk[:, 2] = -depth * top * (1.0 - y**2) + 0.002
    answer = measure(write(tmp_path / "a.vtkhdf", mesh, sunk))
    # At the sides (y = 1) nothing has sunk; at x = 15, 30, 45 mm the midline has by 2.5, 4 and 5.5 mm.
    assert {name: groove.depth_mm for name, groove in answer.grooves.items()} == pytest.approx(
        {"front": 2.5, "dorsum": 4.0, "back": 5.5}
    )
    assert [groove.behind_tip_mm for groove in answer.grooves.values()] == pytest.approx([15.0, 30.0, 45.0])
    arched = measure(write(tmp_path / "b.vtkhdf", mesh, -sunk))
    assert [groove.depth_mm for groove in arched.grooves.values()] == [0.0, 0.0, 0.0]


def test_a_groove_at_rest_does_not_count(tmp_path):
    flat = block()
    top, y = 1.0 + flat.points[:, 2] / SIZE_M[2], flat.points[:, 1] / (0.5 * SIZE_M[1])
    hollow = flat.points.copy()
    hollow[:, 2] -= 0.0015 * top * (1.0 - y**2)
    mesh = HexMesh(hollow, flat.hexes)  # without named points: sections at 40, 55 and 70 % of the length
    deeper = np.zeros_like(hollow)
    deeper[:, 2] = -0.0005 * top * (1.0 - y**2)
    grooves = shape.grooves(mesh, deeper)
    assert [groove.at_rest_mm for groove in grooves.values()] == pytest.approx([1.5] * 3)
    assert [groove.depth_mm for groove in grooves.values()] == pytest.approx([0.5] * 3)
    assert [groove.behind_tip_mm for groove in grooves.values()] == pytest.approx([24.0, 33.0, 42.0])


def test_the_highest_point_of_a_parabola_lies_between_corners():
    x = np.array([0.0, 1.0, 2.1, 2.9, 4.0])
    outline = np.column_stack([np.append(x, 2.0), np.append(3.0 - (x - 2.3) ** 2, -9.0)])
    np.testing.assert_allclose(shape.summit(outline), [2.3, 3.0], rtol=1e-12)
    np.testing.assert_allclose(shape.summit(outline[::-1]), [2.3, 3.0], rtol=1e-12)
    corner = np.array([[0.0, 0.0], [0.0, 2.0], [1.0, 0.0]])  # upright on one side
    np.testing.assert_array_equal(shape.summit(corner), [0.0, 2.0])
    # The upper edge of a block whose side leans by rounding: the parabola through it would end kilometres above.
    edge = np.array([[0.0, 0.0], [1e-18, 1.0], [0.5, 1.0 - 1e-12], [1.0, 0.9]])
    np.testing.assert_array_equal(shape.summit(edge), [1e-18, 1.0])


# Constriction


def bump(mesh: HexMesh, x_m: float, height_m: float) -> np.ndarray:
    """The row of nodes across the top at ``x_m`` comes up."""
    u = np.zeros_like(mesh.points)
    u[(np.abs(mesh.points[:, 0] - x_m) < 1e-9) & (np.abs(mesh.points[:, 2]) < 1e-9), 2] = height_m
    return u


def test_the_constriction_is_where_the_tongue_comes_nearest(tmp_path):
    mesh, palate = block(), flat_palate(0.008)
    path = write(tmp_path / "a.vtkhdf", mesh, bump(mesh, 0.02, 0.005), bones={"palate": palate})
    answer = measure(path).constriction
    assert answer is not None
    # 8 mm less 5 mm, 20 + 5 mm behind the front end of the plate.
    assert (answer.width_mm, answer.place_mm) == pytest.approx((3.0, 25.0), abs=1e-9)
    assert answer.width_at_rest_mm == pytest.approx(8.0)
    # From the midline to the edges of the plate at |y| = 15 mm: 30 mm times the height, which falls off over 5 mm.
    areas = {section.place_mm: section.area_mm2 for section in answer.sections}
    assert areas[10.0] == pytest.approx(30.0 * 8.0, rel=1e-3)
    assert areas[25.0] == pytest.approx(30.0 * 3.0, rel=1e-3)
    assert areas[20.0] == pytest.approx(30.0 * 8.0, rel=1e-3)
    assert areas[5.0] == pytest.approx(30.0 * 8.0, rel=1e-3)
    assert {section.channel_mm2 for section in answer.sections} == {section.area_mm2 for section in answer.sections}
    assert (answer.smallest_channel_mm2, answer.smallest_channel_place_mm) == (areas[25.0], 25.0)


def test_a_tongue_that_reaches_into_the_palate_closes_it(tmp_path):
    mesh, palate = block(), flat_palate(0.008)
    answer = measure(write(tmp_path / "a.vtkhdf", mesh, bump(mesh, 0.02, 0.0085), bones={"palate": palate})).constriction
    assert answer is not None
    assert (answer.width_mm, answer.place_mm) == pytest.approx((0.0, 25.0), abs=1e-9)
    closed = next(section for section in answer.sections if section.place_mm == 25.0)
    assert (closed.height_mm, closed.area_mm2, closed.channel_mm2) == (0.0, 0.0, 0.0)


def test_a_palate_that_moves_is_measured_where_it_is(tmp_path):
    mesh, palate = block(), flat_palate(0.008)
    placed = np.concatenate([np.eye(3).ravel(), [0.002, 0.0, 0.004]])
    path = write(tmp_path / "a.vtkhdf", mesh, bump(mesh, 0.02, 0.005), bones={"palate": palate}, placement={"palate": placed})
    answer = measure(path).constriction
    assert answer is not None
    assert (answer.width_mm, answer.place_mm) == pytest.approx((7.0, 23.0), abs=1e-9)
    assert answer.width_at_rest_mm == pytest.approx(8.0)


def test_sides_that_touch_leave_a_channel_in_the_middle(tmp_path):
    mesh, palate = block(), flat_palate(0.008)
    u = np.zeros_like(mesh.points)
    # Nodes lie every 5 mm across: those at |y| = 10 mm touch, those at 0, 5, 15 and 20 mm do not.
    raised = {0.0: 0.004, 0.005: 0.004, 0.010: 0.009, 0.015: 0.004, 0.020: 0.004}
    for y, height in raised.items():
        u[(np.abs(np.abs(mesh.points[:, 1]) - y) < 1e-9) & (np.abs(mesh.points[:, 2]) < 1e-9), 2] = height
    answer = measure(write(tmp_path / "a.vtkhdf", mesh, u, bones={"palate": palate})).constriction
    assert answer is not None
    section = next(each for each in answer.sections if each.place_mm == 30.0)
    # The gap is 4 mm up to 5 mm from the midline and falls by 1 mm a mm: it is 0.3 mm, which counts as closed, after another
    # 3.7 mm. Outside of the ridge the same comes again from 15 mm on inwards, with what is left below 0.3 mm on both flanks.
    side = 4.0 * 5.0 + 0.5 * (4.0 + 0.3) * 3.7
    assert section.height_mm == pytest.approx(4.0, rel=1e-6)
    assert section.channel_mm2 == pytest.approx(2.0 * side, rel=0.02)
    assert section.area_mm2 == pytest.approx(2.0 * (4.0 * 5.0 + 0.5 * 4.0 * 4.0) + 2.0 * (0.5 * 4.0 * 4.0), rel=0.02)


def test_sections_under_a_dome_over_a_flat_tongue():
    radius, rim, below = 0.012, 0.003, 0.002
    centre = np.array([0.03, 0.0, below])  # 2 mm above the tongue
    palate, mesh = dome(radius, rim, centre), block()
    tongue, _ = surface_triangles(mesh, mesh.points)
    line = tract.palate_midline(palate, 0.0)
    assert line is not None
    # The rim, half a circle, the rim. Sampled every 0.5 mm along x, the steep ends of the circle are cut short by chords.
    assert line.length[-1] == pytest.approx(2.0 * rim + np.pi * radius, rel=0.01)
    for degrees in (-40.0, -20.0, 0.0, 10.0, 35.0):
        lean = np.radians(degrees)
        place = float(np.interp(centre[0] + radius * np.sin(lean), line.points[:, 0], line.length))
        answer = tract.section_between(tract.columns(tract.section_plane(line, place), palate, tongue, 0.0), place)
        # The plane across the midline contains the centre: the section is half a disc, and down to the tongue a strip between
        # the crests at |y| = R.
        strip = below / np.cos(lean)
        assert answer.height_mm == pytest.approx(1e3 * (radius + strip), rel=2e-3)
        assert answer.area_mm2 == pytest.approx(1e6 * (0.5 * np.pi * radius**2 + 2.0 * radius * strip), rel=5e-3)
        assert answer.channel_mm2 == pytest.approx(answer.area_mm2)


def test_plane_segments_of_a_sphere_make_a_circle():
    palate = dome(0.01, 0.0, np.zeros(3))
    normal = np.array([0.6, 0.0, 0.8])
    lines = plane_segments(palate, np.array([0.0, 0.0, 0.001]), normal)
    np.testing.assert_allclose((lines - [0.0, 0.0, 0.001]) @ normal, 0.0, atol=1e-15)
    # The plane passes 0.8 mm from the centre. The triangles lie inside of the sphere by up to R (1 - cos(pi / 120)) = 3.4e-4 R.
    distance = np.linalg.norm(lines - 0.0008 * normal, axis=2)
    np.testing.assert_allclose(distance, np.sqrt(0.01**2 - 0.0008**2), rtol=1e-3)


def test_without_a_plane_in_common_there_is_no_constriction(tmp_path):
    mesh = block()
    points, triangles = flat_palate(0.008, half_width_m=0.001)
    aside = {"palate": (points + [0.0, 0.01, 0.0], triangles)}
    assert measure(write(tmp_path / "a.vtkhdf", mesh, np.zeros_like(mesh.points), bones=aside)).constriction is None


# Contact


def test_even_pressure_on_a_third_of_the_bone(tmp_path):
    mesh, palate = block((12, 12, 2)), flat_palate(0.0, half_width_m=0.02)
    x, y, z = mesh.points.T
    touched = (z > -1e-9) & (x < 0.0125) & (y > 0.0075)
    pressure = np.where(touched, 500.0, 0.0)
    force = np.array([0.01, -0.02, -0.03])
    path = write(
        tmp_path / "a.vtkhdf",
        mesh,
        np.zeros_like(mesh.points),
        bones={"palate": palate},
        pressure={"palate": pressure},
        force={"palate": force},
    )
    contact = measure(path).contact["palate"]
    # 3 x 4 nodes 5 and 3.33 mm apart. On the upper face each stands for 16.67 mm2, half of it at the edges of the face, of which
    # there are two here, the front and the right one; there it has half a face of the block's front or side, too, of the height
    # 10 mm: 3.33 x 5 and 5 x 5 mm2.
    upper = 16.667 * (3 - 0.5) * (4 - 0.5)
    sides = 3.333 * 5.0 * (4 - 0.5) + 5.0 * 5.0 * (3 - 0.5)
    assert contact.area_mm2 == pytest.approx(upper + sides, rel=1e-3)
    assert contact.force_N == pytest.approx(500.0 * 1e-6 * (upper + sides), rel=1e-3)
    assert contact.mean_kPa == contact.peak_kPa == pytest.approx(0.5)
    assert contact.midline_free
    assert (contact.forward_N, contact.right_N, contact.up_N) == (-0.01, -0.02, -0.03)
    assert contact.resultant_N == pytest.approx(np.linalg.norm(force))  # stored, and another quantity than the sum of pressures
    # The bone reaches from x = -5 to 65 mm and to |y| = 20 mm: all of that is in its right front cell.
    assert contact.cells["right"]["front"].area_mm2 == pytest.approx(contact.area_mm2)
    assert sum(cell.area_mm2 for row in contact.cells.values() for cell in row.values()) == pytest.approx(contact.area_mm2)
    # Where the bone has moved forward by 30 mm, the same nodes touch its middle third.
    moved = np.concatenate([np.eye(3).ravel(), [-0.03, 0.0, 0.0]])
    path = write(
        tmp_path / "b.vtkhdf",
        mesh,
        np.zeros_like(mesh.points),
        bones={"palate": palate},
        pressure={"palate": pressure},
        placement={"palate": moved},
    )
    contact = measure(path).contact["palate"]
    assert contact.cells["right"]["middle"].area_mm2 == pytest.approx(contact.area_mm2)
    assert contact.forward_N is None and contact.resultant_N is None


def test_a_touched_midline_is_not_free(tmp_path):
    mesh = block()
    pressure = np.where((mesh.points[:, 2] > -1e-9) & (np.abs(mesh.points[:, 1]) < 1e-9), 100.0, 0.0)
    bones = {"palate": flat_palate(0.0)}
    path = write(tmp_path / "a.vtkhdf", mesh, np.zeros_like(mesh.points), bones=bones, pressure={"palate": pressure})
    assert not measure(path).contact["palate"].midline_free


# The command


def keys(value: object) -> object:
    """The structure of a document: the keys of its tables, and of the first item of its lists."""
    if isinstance(value, dict):
        return {key: keys(inner) for key, inner in value.items()}
    return [keys(value[0])] if isinstance(value, list) and value else None


def test_the_document_has_all_keys(tmp_path, capsys):
    mesh, palate = block(), flat_palate(0.008)
    path = write(
        tmp_path / "a.vtkhdf",
        mesh,
        bump(mesh, 0.02, 0.005),
        bones={"palate": palate},
        pressure={"palate": np.zeros(mesh.node_count)},
    )
    assert command(["measure", str(path), str(path), "--at-ms", "50", "--json"]) == 0
    answer = check_answer("measure", capsys.readouterr().out)
    assert len(answer["results"]) == 2
    point = dict.fromkeys(
        ("forward_mm", "up_mm", "right_mm", "largest_mm", "largest_at_ms", "time_to_90_ms", "peak_speed_mm_s", "speed_mm_s")
    )
    part = dict.fromkeys(("area_mm2", "force_N", "mean_kPa"))
    groove = dict.fromkeys(("depth_mm", "at_rest_mm", "behind_tip_mm"))
    section = dict.fromkeys(("place_mm", "height_mm", "area_mm2", "channel_mm2"))
    pattern = {
        **dict.fromkeys(("time_ms", "contacts", "anteriority", "centrality", "dorsopalatal", "centre_of_gravity", "closed_rows")),
        "electrodes": [[None]],
    }
    assert keys(answer["results"][0]) == {
        "result": None,
        "title": None,
        "status": None,
        "time_ms": None,
        "points": dict.fromkeys(("back", "dorsum", "front", "tip"), point),
        "highest": dict.fromkeys(("forward_mm", "up_mm", "behind_tip_mm", "above_tip_mm")),
        "grooves": dict.fromkeys(("front", "dorsum", "back"), groove),
        "constriction": {
            **dict.fromkeys(("width_mm", "place_mm", "width_at_rest_mm", "place_at_rest_mm")),
            **dict.fromkeys(("smallest_channel_mm2", "smallest_channel_place_mm")),
            "sections": [section],
        },
        "reactions": {},
        "contact": {
            "palate": {
                **part,
                **dict.fromkeys(("resultant_N", "peak_kPa", "midline_free", "forward_N", "up_N", "right_N")),
                "cells": dict.fromkeys(("left", "centre", "right"), dict.fromkeys(("front", "middle", "back"), part)),
            }
        },
        "palatogram": {
            "now": pattern,
            "most": pattern,
            **{name: [[None]] for name in ("pressure_kPa", "first_contact_ms", "duration_ms")},
            "row_places_mm": [None],
            "course": {name: [None] for name in ("time_ms", "contacts", "area_mm2", "force_N")},
        },
        "leak": {
            **dict.fromkeys(("width_mm", "area_mm2", "closed", "place_mm", "side_mm", "over_plate_mm", "beside_molars_mm")),
            "course": {name: [None] for name in ("time_ms", "width_mm", "area_mm2")},
            "closures": None,
        },
        "body": {
            **dict.fromkeys(("largest_displacement_mm", "largest_so_far_mm", "fastest_mm_s", "settled", "time_to_90_ms")),
            **dict.fromkeys(("volume_change_percent", "left_right_mm")),
            "self_penetration": dict.fromkeys(("nodes", "deepest_mm", "deepest_at_rest")),
        },
        "airway": None,
    }


def test_tables_and_inspect(tmp_path, capsys):
    mesh, palate = block(), flat_palate(0.008)
    path = write(tmp_path / "a.vtkhdf", mesh, bump(mesh, 0.02, 0.005), bones={"palate": palate})
    other = write(tmp_path / "b.vtkhdf", mesh, np.tile([-0.004, 0.0, -0.001], (mesh.node_count, 1)))
    assert command(["measure", str(path)]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "constriction 3.0 mm wide, 25 mm behind the incisors" in text
    assert command(["measure", str(path), str(other)]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "forward 4.00, down 1.00 mm" in text
    assert command(["inspect", str(other)]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "tip forward 4.00, down 1.00 mm; 90 % after 90 ms; peak speed 41 mm/s" in text
    assert command(["inspect", str(other), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["measures"]["points"]["tip"]["forward_mm"] == pytest.approx(4.0)
    assert command(["measure", str(tmp_path / "none.vtkhdf")]) == 2
    assert "does not exist" in capsys.readouterr().err


@pytest.mark.parametrize(("extreme", "reduce"), [(np.maximum, np.fmax), (np.minimum, np.fmin)])
def test_the_outermost_crossing_is_the_extreme_of_all(extreme, reduce):
    """Against all crossings of all lines, steep and level ones, and lines that end where others begin."""
    rng = np.random.default_rng(5)
    ends = np.round(rng.uniform(-1.0, 1.0, (60, 2, 2)), 1)
    lines = ends[ends[:, 0, 0] != ends[:, 1, 0]]
    at = np.linspace(-1.2, 1.2, 97)
    every = tract.crossings(lines, at)
    assert np.array_equal(tract.outermost(lines, at, extreme), reduce.reduce(every, axis=1), equal_nan=True)
    low = np.where(np.abs(every) < 0.5, every, np.nan)
    assert np.array_equal(tract.outermost(lines, at, extreme, 0.5), reduce.reduce(low, axis=1), equal_nan=True)
    assert np.isnan(tract.outermost(lines[:0], at, extreme)).all()
