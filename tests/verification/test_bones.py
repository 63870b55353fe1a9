"""Bones: signed distances against closed forms and another program, the built-in palate and jaw, surfaces that are refused."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from outside_data import SHARED_DATA, needs
from scipy.spatial.transform import Rotation
from support import ROOT

from explicitfe.fem.bones.distance import DistanceField, bone_field, distance_field, reach
from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.bones.read import read_surface
from explicitfe.fem.bones.surface import TriangleSurface, check_surface, shifted
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy import catalogue

MM = 1e-3
SPACING = 1e-3
RADIUS = 0.02
GRID = np.array([0.0, 0.5, 0.0])  # where a node of the grid lies, in spacings
TABLES = tomllib.loads((ROOT / "models" / "tongue" / "bones.toml").read_text(encoding="utf-8"))
BONES = SHARED_DATA / "tongue" / "artisynth-hextongue" / "bones"


# ---- shapes ----


def ball(rows: int = 96, bump: float = 0.0) -> TriangleSurface:
    """A ball of ``RADIUS`` with rows of triangles from pole to pole, with bumps of a height ``bump``."""
    columns = 2 * rows
    polar, turn = np.meshgrid(np.pi * np.arange(1, rows) / rows, 2.0 * np.pi * np.arange(columns) / columns, indexing="ij")
    unit = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1).reshape(-1, 3)
    unit = np.concatenate([unit, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    radius = RADIUS + bump * np.sin(15.0 * unit[:, :1]) * np.cos(8.0 * unit[:, 1:2]) + 0.5 * bump * unit[:, 2:]
    number = np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    beside = np.roll(number, -1, axis=1)
    top, bottom = np.full(columns, number.size), np.full(columns, number.size + 1)
    a, b, c, d = (quad.ravel() for quad in (number[:-1], number[1:], beside[1:], beside[:-1]))
    triangles = [np.column_stack(corners) for corners in ((a, b, c), (a, c, d), (top, number[0], beside[0]))]
    triangles.append(np.column_stack((bottom, beside[-1], number[-1])))
    return TriangleSurface(radius * unit, np.concatenate(triangles).astype(np.int64))


def cube(half: float = RADIUS) -> TriangleSurface:
    """A cube around the origin."""
    points = half * np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return TriangleSurface(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64))


def around(half: float = 0.035) -> np.ndarray:
    return half * np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def in_a_shell(lowest: float, highest: float, count: int = 4000) -> np.ndarray:
    """Random points between two distances from the origin."""
    generator = np.random.default_rng(7)
    unit = generator.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return unit * generator.uniform(lowest, highest, (count, 1))


def contact_points() -> np.ndarray:
    """The nodes of the medium tongue's surface."""
    mesh = catalogue.built_in("tongue", "medium").mesh
    return mesh.points[surface_areas(mesh) > 0.0]


@pytest.fixture(scope="module")
def fields() -> dict[str, DistanceField]:
    """The distance fields of palate and jaw around the medium tongue."""
    body = contact_points()
    return {name: bone_field(bone.surface, name, body) for name, bone in catalogue.bones("tongue").items()}


# ---- distances ----


def test_a_ball_has_the_distance_of_a_ball():
    """r - R, less what its flat triangles cut off, e^2 / 8 R; trilinear between the nodes adds at most h^2 / 4 r."""
    surface = ball()
    edge = np.pi * RADIUS / 96
    field = distance_field(surface, spacing_m=SPACING, smoothing_m=0.0, region=around())
    points = in_a_shell(RADIUS - 4 * SPACING, RADIUS + 4 * SPACING)
    radius = np.linalg.norm(points, axis=1)
    error = field.at(points)[0] - (radius - RADIUS)
    bound = 2.0 * edge**2 / (8.0 * RADIUS) + SPACING**2 / (4.0 * radius)
    assert (error > -1e-9).all() and (error < bound).all()


def test_smoothing_adds_the_square_of_its_width_over_the_radius():
    """A Gaussian of sigma adds sigma^2 / 2 times the Laplacian of the distance, 2 / r: a ball shrinks by sigma^2 / R."""
    sigma = 1e-3
    surface, points = ball(), in_a_shell(RADIUS - 3 * SPACING, RADIUS + 3 * SPACING)
    rough = distance_field(surface, spacing_m=SPACING, smoothing_m=0.0, region=around()).at(points)[0]
    smooth = distance_field(surface, spacing_m=SPACING, smoothing_m=sigma, region=around()).at(points)[0]
    np.testing.assert_allclose(smooth - rough, sigma**2 / np.linalg.norm(points, axis=1), atol=0.1 * sigma**2 / RADIUS)


def test_a_flat_face_is_exact():
    """Over the middle of a cube's faces the distance is linear: neither grid nor smoothing changes it."""
    field = distance_field(cube(), spacing_m=SPACING, smoothing_m=1e-3, region=around())
    generator = np.random.default_rng(3)
    heights = generator.uniform(-4.0, 5.5, 300) * SPACING
    for axis in range(3):
        for side in (-1.0, 1.0):
            points = generator.uniform(-0.25, 0.25, (300, 3)) * RADIUS
            points[:, axis] = side * (RADIUS + heights)
            value, gradient = field.at(points)
            np.testing.assert_allclose(value, heights, atol=1e-12)
            np.testing.assert_allclose(gradient, np.tile(side * np.eye(3)[axis], (300, 1)), atol=1e-9)


def test_edges_and_corners_of_a_cube():
    """Outside the distance is that to the nearest point of the cube, for a node on the grid."""
    field = distance_field(cube(), spacing_m=SPACING, smoothing_m=0.0, region=around())
    nodes = SPACING * (np.random.default_rng(5).integers(-24, 25, (3000, 3)) + GRID)
    outside = np.linalg.norm(np.maximum(np.abs(nodes) - RADIUS, 0.0), axis=1)
    inside = np.minimum((np.abs(nodes) - RADIUS).max(axis=1), 0.0)
    true = outside + inside
    near = np.abs(true) < 4 * SPACING
    np.testing.assert_allclose(field.at(nodes[near])[0], true[near], atol=1e-12)
    assert np.abs(field.at(nodes)[0] - true).max() < SPACING


def test_the_gradient_is_that_of_the_interpolant():
    """Trilinear is linear along each axis: a difference within a cell is the derivative."""
    field = distance_field(ball(bump=0.002), spacing_m=SPACING, smoothing_m=1e-3, region=around())
    generator = np.random.default_rng(11)
    points = SPACING * (generator.integers(-30, 30, (2000, 3)) + generator.uniform(0.2, 0.8, (2000, 3)) + GRID)
    gradient = field.at(points)[1]
    step = 0.1 * SPACING
    for axis in range(3):
        ahead = step * np.eye(3)[axis]
        difference = (field.at(points + ahead)[0] - field.at(points - ahead)[0]) / (2.0 * step)
        np.testing.assert_allclose(gradient[:, axis], difference, atol=1e-9)


def test_another_program_finds_the_same_distances():
    """VTK's implicit distance (Baerentzen and Aanaes 2005) of a bumpy surface: near it the same numbers, and signs everywhere.

    Farther off, values between every second node are off by h^2 / d at most, by a spacing where two bumps are equally near.
    """
    pyvista = pytest.importorskip("pyvista")
    surface = ball(bump=0.002)
    field = distance_field(surface, spacing_m=SPACING, smoothing_m=0.0, region=around())
    index = np.random.default_rng(0).integers(0, np.array(field.values.shape), (5000, 3))
    cells = np.column_stack([np.full(len(surface.triangles), 3), surface.triangles])
    nodes = pyvista.PolyData(field.origin_m + field.spacing_m * index)
    theirs = np.asarray(nodes.compute_implicit_distance(pyvista.PolyData(surface.points, cells))["implicit_distance"])
    ours = field.values[tuple(index.T)]
    near = np.abs(theirs) < 4 * SPACING
    assert near.sum() > 500
    np.testing.assert_allclose(ours[near], theirs[near], atol=1e-7)
    assert (np.sign(ours) == np.sign(theirs))[np.abs(theirs) > 1e-7].all()
    error = np.abs(ours - theirs)
    assert error.max() < SPACING and error.mean() < 0.05 * SPACING


def test_beyond_the_grid_there_is_no_contact():
    field = distance_field(cube(), region=around(0.015))  # the whole grid lies inside the cube
    assert (field.at(np.zeros((1, 3)))[0] < 0.0).all()
    value, gradient = field.at(np.array([[0.1, 0.0, 0.0], [0.0, -0.016, 0.0]]))
    assert (value == 0.0).all() and (gradient == 0.0).all()


def test_pieces_may_overlap():
    """Two cubes that share a part: inside is where either is, and no wall stands between."""
    one, two = cube(), shifted(cube(), np.array([0.01, 0.0, 0.0]))
    both = TriangleSurface(np.concatenate([one.points, two.points]), np.concatenate([one.triangles, two.triangles + 8]))
    check_surface(both, "two cubes")
    field = distance_field(both, smoothing_m=0.0, region=around())
    along = np.column_stack([np.linspace(-0.018, 0.028, 40), np.zeros(40), np.zeros(40)])
    assert (field.at(along)[0] < 0.0).all()


def test_a_surface_far_away_or_huge_is_no_trouble():
    """A box of 4 m whose face passes by: only its pieces near the grid are looked at."""
    field = distance_field(shifted(cube(2.0), np.array([0.0, 0.0, 2.0])), smoothing_m=0.0, region=around())
    points = in_a_shell(0.0, 0.004)
    np.testing.assert_allclose(field.at(points)[0], -points[:, 2], atol=1e-12)
    away = distance_field(shifted(cube(), np.array([1.0, 0.0, 0.0])), region=around())
    assert (away.values > 0.0).all()


# ---- the built-in bones ----


@pytest.mark.parametrize("name", ["palate", "jaw"])
def test_built_in_bones_are_their_own_mirror_images(name, fields):
    surface = catalogue.bones("tongue")[name].surface
    mirrored = surface.points * [1.0, -1.0, 1.0] + 0.0
    assert np.array_equal(np.unique(surface.points + 0.0, axis=0), np.unique(mirrored, axis=0))
    field = fields[name]
    assert np.array_equal(field.values, field.values[:, ::-1])
    assert field.origin_m[1] == pytest.approx(-0.5 * field.spacing_m * (field.values.shape[1] - 1), abs=1e-15)


@pytest.mark.parametrize("name", ["palate", "jaw"])
def test_nothing_pushes_the_midline_aside(name, fields):
    """The gradient is that of one cell, and has a side where cells meet; so y = 0 lies in the middle of cells."""
    points = np.random.default_rng(2).uniform([0.05, 0.0, 0.06], [0.12, 0.0, 0.12], (500, 3))
    assert np.abs(fields[name].at(points)[1][:, 1]).max() < 1e-12


def test_the_palate_is_where_its_table_says(fields):
    """The surface passes within half the smoothing of every figure that is not at an edge, where smoothing rounds it."""
    table = TABLES["palate"]
    places = [
        (x, y, z)
        for x, width, row in zip(table["x_mm"], table["half_width_mm"], table["underside_mm"], strict=True)
        for y, z in zip(table["y_mm"], row, strict=True)
        if y < width - 2.5 and table["x_mm"][0] < x < table["x_mm"][-1]
    ]
    assert len(places) > 60
    distance, _ = fields["palate"].at(MM * np.array(places))
    assert np.abs(distance).max() < 0.5 * MM


def test_the_jaw_is_where_its_table_says():
    """Without smoothing the lingual surface passes through every figure whose level lies within its section."""
    table = TABLES["jaw"]
    surface = catalogue.bones("tongue")["jaw"].surface
    field = distance_field(surface, smoothing_m=0.0, region=reach(surface.points, 2 * MM))
    places = []
    for angle, bottom, top, row in zip(*(table[key] for key in ("angle_deg", "bottom_mm", "top_mm", "lingual_mm")), strict=True):
        turn = np.radians(angle)
        places += [
            (table["centre_mm"] - radius * np.cos(turn), radius * np.sin(turn), level)
            for level, radius in zip(table["level_mm"], row, strict=True)
            if bottom + 1 < level < top - 1
        ]
    distance, _ = field.at(MM * np.array(places))
    assert len(places) > 70 and np.abs(distance).max() < 0.3 * MM


def test_the_tongue_at_rest_lies_between_the_bones(fields):
    """Distances of named points within 0.6 mm of those of the measured tongue from its own bones; the tip is 1 mm further from
    the jaw, whose edge is rounded here.

    Nothing lies inside the palate. The jaw is entered by at most 2.2 mm where it holds the tongue, and by 1 mm next to that.
    """
    shape = catalogue.contour("tongue")
    expected = {"tip": ("jaw", 3.7), "blade": ("palate", 6.2), "front": ("palate", 9.2), "dorsum": ("palate", 8.7)}
    expected["back"] = ("palate", 7.6)
    for point, (bone, millimetres) in expected.items():
        place = shape.position(np.array(shape.named_points[point]))
        assert abs(fields[bone].at(place)[0][0] - MM * millimetres) < 0.6 * MM, point
    mesh = catalogue.built_in("tongue", "medium").mesh
    free = surface_areas(mesh) > 0.0
    assert fields["palate"].at(mesh.points[free])[0].min() > 0.0
    assert fields["jaw"].at(mesh.points[free])[0].min() > -2.2 * MM
    free[mesh.node_sets["jaw"]] = False
    assert fields["jaw"].at(mesh.points[free])[0].min() > -1.0 * MM


@needs(BONES / "ICPJaw3.obj")
@pytest.mark.parametrize(("name", "file"), [("jaw", "ICPJaw3.obj"), ("palate", "ICPPalate3.obj")])
def test_the_tables_are_the_measured_bones(name, file):
    """Corners of the side that faces the tongue: 90 % within 1 mm of the measured surface, by VTK."""
    pyvista = pytest.importorskip("pyvista")
    surface, table = catalogue.bones("tongue")[name].surface, TABLES[name]
    x, y, z = 1e3 * surface.points.T
    if name == "palate":
        # The underside in front of the velum, as far to the sides as the measured sheet goes.
        facing = (
            (x > 52.0)
            & (x < 122.0)
            & (np.abs(y) < 20.0)
            & (z < np.interp(x, table["x_mm"], [r[0] for r in table["underside_mm"]]))
        )
    else:
        angle = np.degrees(np.arctan2(np.abs(y), table["centre_mm"] - x))
        radius = np.hypot(y, table["centre_mm"] - x)
        low, high = (np.interp(angle, table["angle_deg"], table[key]) for key in ("bottom_mm", "top_mm"))
        middle = [0.5 * (a[4] + b[4]) for a, b in zip(table["lingual_mm"], table["labial_mm"], strict=True)]
        facing = (radius < np.interp(angle, table["angle_deg"], middle)) & (z > low + 3.0) & (z < high - 3.0) & (angle < 100.0)
    measured = pyvista.read(BONES / file)
    points = pyvista.PolyData(surface.points[facing])
    distance = np.abs(points.compute_implicit_distance(measured.triangulate())["implicit_distance"])
    assert facing.sum() > 500
    assert np.quantile(distance, 0.9) < 1.0 * MM


def test_the_jaw_hinge_is_that_of_bonwills_triangle():
    """Bonwill: 4 inches between condyles and to the incisors; Balkwill: inclined by 22 to 26 degrees to the row of teeth.

    The condyles of the measured jaw lie within 10 mm of that.
    """
    hinge = catalogue.bones("tongue")["jaw"].hinge_m
    assert catalogue.bones("tongue")["palate"].hinge_m is None
    incisors, molars = np.array([53.5, 95.0]), np.array([100.0, 99.5])
    teeth = np.arctan2(*(molars - incisors)[::-1])
    height = 101.6 * np.sqrt(0.75)
    for angle in np.radians([22.0, 26.0]) + teeth:
        axis = incisors + height * np.array([np.cos(angle), np.sin(angle)])
        assert np.linalg.norm(1e3 * hinge[[0, 2]] - axis) < 10.0


# ---- surfaces that are refused, and files ----


def turned(surface: TriangleSurface, which: slice) -> TriangleSurface:
    triangles = surface.triangles.copy()
    triangles[which] = triangles[which][:, ::-1]
    return TriangleSurface(surface.points, triangles)


BODY = in_a_shell(0.03, 0.04, 50)
GOOD = ball(12)
REFUSED = {
    "not closed: 3 edges": TriangleSurface(GOOD.points, GOOD.triangles[1:]),
    "inside out": turned(GOOD, slice(None)),
    "opposite normals at 3 edges": turned(GOOD, slice(0, 1)),
    "far too large, 69282 mm .*length_unit": TriangleSurface(1e3 * GOOD.points, GOOD.triangles),
    "far too small, 0.069 mm .*length_unit": TriangleSurface(1e-3 * GOOD.points, GOOD.triangles),
    "no triangles": TriangleSurface(GOOD.points, GOOD.triangles[:0]),
    "point 3 is not a finite number": TriangleSurface(
        np.where(np.arange(len(GOOD.points))[:, None] == 3, np.nan, GOOD.points), GOOD.triangles
    ),
    "triangles have no area": TriangleSurface(GOOD.points, np.concatenate([GOOD.triangles, [[0, 0, 1]]])),
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_a_bad_surface_is_refused_in_one_sentence(sentence):
    check_surface(GOOD, "ball", BODY)
    with pytest.raises(InputError, match=sentence) as raised:
        check_surface(REFUSED[sentence], 'bone "ball" (ball.stl)', BODY)
    message = str(raised.value)
    assert message.startswith('bone "ball" (ball.stl): ') and message.endswith(".") and "\n" not in message


def test_a_body_that_starts_inside_a_bone_is_refused():
    body = in_a_shell(0.0, RADIUS + 0.005)
    with pytest.raises(InputError, match=r"starts 1\d\.\d mm inside it, deepest at \(.* mm; move one of them"):
        bone_field(ball(), "ball", body)
    borne = bone_field(ball(), "ball", in_a_shell(RADIUS - 0.004, RADIUS + 0.02))
    assert borne.values.min() < -0.004


def test_the_field_moves_along_with_a_bone():
    """At 2.3 mm, no multiple of the spacing: the same distances from the bone; and a field that is kept serves no other bone."""
    body, shift = in_a_shell(RADIUS, RADIUS + 0.02), np.array([0.0, 0.0, 2.3e-3])
    field, moved = bone_field(ball(), "ball", body), bone_field(ball(), "ball", body + shift, shift)
    assert np.abs(moved.at(body + shift)[0] - field.at(body)[0]).max() < 1e-15
    other = bone_field(ball(bump=0.002), "ball", body)
    assert np.abs(other.at(body)[0] - field.at(body)[0]).max() > 1e-3
    assert np.array_equal(bone_field(ball(), "ball", body).values, field.values)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "vtp"])
def test_files_of_surfaces(kind, tmp_path):
    """Written by another program in millimetres, read back: closed, and of the same volume."""
    pyvista = pytest.importorskip("pyvista")
    surface = catalogue.bones("tongue")["jaw"].surface
    cells = np.column_stack([np.full(len(surface.triangles), 3), surface.triangles])
    mesh = pyvista.PolyData(1e3 * surface.points, cells)
    path = tmp_path / f"jaw.{kind}"
    pyvista.save_meshio(path, mesh) if kind == "obj" else mesh.save(path)
    again = read_surface(path, "mm")
    check_surface(again, "jaw", contact_points())
    assert len(again.points) == len(surface.points) and len(again.triangles) == len(surface.triangles)
    assert abs(again.volume_m3 / surface.volume_m3 - 1.0) < 1e-6  # STL and PLY hold single precision


def test_files_that_hold_no_surface(tmp_path):
    for name, text, unit, sentence in (
        ("a.stl", "hello", "mm", "contains no triangles; check that it is a surface in the format STL"),
        ("a.vtp", "hello", "mm", "contains no triangles|cannot be read as VTP"),
        ("a.txt", "hello", "mm", "use a file that ends in"),
        ("a.obj", "v 0 0 0\n", "mm", "contains no triangles"),
        ("b.stl", None, "mm", "No such file"),
        ("a.ply", "hello", "inch", 'unknown length_unit "inch"'),
    ):
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=sentence):
            read_surface(tmp_path / name, unit)


# ---- motion ----


def test_a_rigid_motion_is_a_rotation_about_its_centre():
    """Against scipy's rotations; the centre itself only shifts, and before the first and after the last time nothing moves."""
    generator = np.random.default_rng(2)
    turn, shift, centre = generator.normal(size=3), 0.01 * generator.normal(size=3), np.array([0.136, 0.0, 0.138])
    motion = RigidMotion(centre, turn, shift, np.array([0.01, 0.05, 0.2]), np.array([0.0, 1.0, 0.3]))
    times = np.array([0.0, 0.01, 0.03, 0.05, 0.1, 0.2, 1.0])
    share = np.array([0.0, 0.0, 0.5, 1.0, 1.0 - 0.7 / 3.0, 0.3, 0.3])
    rotation, offset = motion.placement(times)
    points = generator.normal(size=(20, 3))
    for k in range(len(times)):
        expected = Rotation.from_rotvec(share[k] * turn).apply(points - centre) + centre + share[k] * shift
        np.testing.assert_allclose(points @ rotation[k].T + offset[k], expected, atol=1e-14)
        np.testing.assert_allclose(rotation[k] @ centre + offset[k], centre + share[k] * shift, atol=1e-15)
    still = RigidMotion(centre, np.zeros(3), np.zeros(3), np.zeros(1), np.zeros(1)).placement(times)
    assert (still[0] == np.eye(3)).all() and (still[1] == 0.0).all()
