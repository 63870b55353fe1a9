"""The side walls of the pharynx: a body of two halves that are mirror images, and the bone that is left without them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from explicitfe.fem.bones.distance import distance_field
from explicitfe.fem.bones.surface import TriangleSurface, check_surface, depth_inside
from explicitfe.fem.bones.tables import channel
from explicitfe.fem.mesh.bent_block import ContourMap, mirror
from explicitfe.fem.mesh.hexmesh import shape_functions
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.soundness import soundness
from explicitfe.simulate.anatomy import catalogue

MM = 1e-3
MIRROR = np.array([1.0, -1.0, 1.0])
RESOLUTIONS = ("coarse", "medium", "fine")
# Two straight plates of 100 x 20 x 12 mm, 18 mm to each side of the midline.
PLATES = {
    "fixed": ["outer"],
    "axes": {name: [0.0, 0.3, 0.7, 1.0] for name in "stw"},
    "contour": {
        "lower_mm": [[0.0, 0.0], [30.0, 0.0], [70.0, 0.0], [100.0, 0.0]],
        "upper_mm": [[0.0, 20.0], [30.0, 20.0], [70.0, 20.0], [100.0, 20.0]],
    },
    "half_width": {"mm": [[30.0] * 4] * 4},
    "inner_half_width": {"mm": [[18.0] * 4] * 4},
    "resolutions": {},
    "named_points": {},
    "attachments": {"outer": [{"s": [0.0, 1.0], "t": [0.0, 1.0], "w": 1.0}], "inner": [{"s": 0.0, "t": [0, 1], "w": [0, 0.5]}]},
}


def test_two_plates_are_where_they_should_be() -> None:
    """Volume, places of points and held area in closed form; each half has its own middle nodes."""
    plates = ContourMap.from_tables(PLATES, "plates")
    cells = (5, 4, 6)
    mesh = plates.mesh(cells)
    assert mesh.node_count == 6 * 5 * 8 and mesh.element_count == 5 * 4 * 6
    assert soundness(mesh).part_count == 2
    assert volumes(mesh.points, mesh.hexes).sum() == pytest.approx(2.0 * 0.1 * 0.02 * 0.012, rel=1e-13)
    y = np.unique(np.abs(mesh.points[:, 1]).round(12))
    np.testing.assert_allclose(y, [0.018, 0.022, 0.026, 0.030], rtol=1e-12)
    places = np.array([[0.41, 0.3, 0.0], [0.41, 0.3, -0.0], [0.99, 0.0, 0.37], [0.99, 0.0, -0.37], [1.0, 1.0, -1.0]])
    points = plates.locate(places, cells)
    across = np.where(np.signbit(places[:, 2]), -1.0, 1.0) * (0.018 + 0.012 * np.abs(places[:, 2]))
    expected = np.column_stack([0.1 * places[:, 0], across, 0.02 * places[:, 1]])
    np.testing.assert_allclose(points.position, expected, atol=1e-15)
    np.testing.assert_allclose(plates.position(places), expected, atol=1e-15)
    in_mesh = np.einsum("ka,kai->ki", shape_functions(points.natural), mesh.points[mesh.hexes[points.element]])
    np.testing.assert_allclose(in_mesh, expected, atol=1e-15)
    image = mirror(points, cells)
    assert np.array_equal(image.element[:2], points.element[1::-1]) and np.array_equal(image.natural[0], points.natural[1])
    held, areas_m2 = plates.attachment_points(cells, "outer")
    assert areas_m2.sum() == pytest.approx(2.0 * 0.1 * 0.02, rel=1e-13) and np.allclose(np.abs(held.position[:, 1]), 0.03)
    assert np.allclose(np.abs(mesh.points[mesh.node_sets["outer"], 1]), 0.03) and len(mesh.node_sets["outer"]) == 2 * 6 * 5
    of_end = mesh.points[mesh.node_sets["inner"]]
    assert np.allclose(of_end[:, 0], 0.0) and set(np.abs(of_end[:, 1]).round(9)) == {0.018, 0.022, 0.026}


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_the_walls_are_mirror_images(resolution: str) -> None:
    """Every node and node set to the last bit, and named points, which are sums over the corners of an element, to rounding."""
    mesh = catalogue.built_in("pharynx-walls", resolution).mesh
    assert np.array_equal(np.unique(mesh.points, axis=0), np.unique(mesh.points * MIRROR, axis=0))
    right, left = (mesh.named_points[side].position for side in ("right", "left"))
    assert right[0, 1] > 0.02
    np.testing.assert_allclose(left * MIRROR, right, rtol=0.0, atol=1e-16)
    for members in mesh.node_sets.values():
        held = mesh.points[members]
        assert np.array_equal(np.unique(held, axis=0), np.unique(held * MIRROR, axis=0))


def test_their_inner_surface_is_that_of_the_airway() -> None:
    """Within 0.2 mm of the side walls of the table of the airway behind the rounded front edge, and at the rear of their back."""
    table, shape = catalogue.airway("tongue").wall, catalogue.contour("pharynx-walls")
    s, t = np.meshgrid(np.linspace(0.0, 1.0, 36), np.linspace(0.2, 1.0, 9), indexing="ij")
    x, y, z = np.moveaxis(shape.position(np.stack([s, t, np.zeros_like(s)], axis=-1)) / MM, -1, 0)
    half_width = scipy.interpolate.PchipInterpolator(table.height_mm, table.half_width_mm)
    assert np.abs(y - half_width(z)).max() < 0.2 + 1e-9
    for height, wide, row in zip(table.height_mm[:8], table.half_width_mm, table.back_mm, strict=False):
        assert abs(np.interp(-height, -z[:, -1], x[:, -1]) - np.interp(wide, table.y_mm, row)) < 0.5
    assert z.min() == pytest.approx(60.0) and z.max() == pytest.approx(95.0) and x.min() > 114.0


def test_the_walls_are_clear_of_all_that_is_rigid() -> None:
    """Neither the jaw nor the posterior wall lies where they are; with its side walls the bone does."""
    points = catalogue.built_in("pharynx-walls", "coarse").mesh.points
    bones = catalogue.bones("tongue")
    pharynx = bones["pharynx"]
    assert pharynx.hard is not None
    assert depth_inside(bones["jaw"].surface, points).max() == 0.0
    assert depth_inside(pharynx.hard, points).max() < 0.5 * MM  # the rear edge lies in it, by what the two splines differ
    assert depth_inside(pharynx.surface, points).max() > 5.0 * MM


@pytest.mark.parametrize("part", ["surface", "hard"])
def test_the_ends_of_the_bone_leave_the_channel_open(part: str) -> None:
    """A point of the channel in the plane of an end is as far from the bone as from its walls, not from a face across."""
    surface = getattr(catalogue.bones("tongue")["pharynx"], part)
    check_surface(surface, "pharynx")
    heights = MM * np.array([60.0, 104.0])
    places = np.array([[0.122, 0.0, z] for z in heights])
    field = distance_field(surface, smoothing_m=0.0, region=np.array([[0.11, -0.01, 0.055], [0.13, 0.01, 0.11]]))
    assert field.at(places)[0].min() > 7.0 * MM
    assert surface.points[:, 0].min() > (0.1139 if part == "surface" else 0.12)


def straight_channel(radius_mm: float) -> TriangleSurface:
    """20 mm wide and 20 mm high between walls of 4 mm, open for 20 mm in front of x = 50 mm."""
    table = {"height_mm": [0, 20], "half_width_mm": [10, 10], "y_mm": [0, 5, 10], "back_mm": [[50, 50, 50]] * 2}
    surface = channel(table | {"side_front_mm": 30, "thickness_mm": 4, "front_radius_mm": radius_mm})
    check_surface(surface, "channel")
    return surface


@pytest.mark.parametrize("radius_mm", [1.5, 3.0])
def test_the_front_edges_have_their_radius(radius_mm: float) -> None:
    """A quarter of a circle joins inner sides and front: corners lie on it, middles of its quads on chords of 22.5 degrees."""
    x, y, _ = np.abs(straight_channel(radius_mm).points.T) / MM
    assert x.min() == pytest.approx(30.0) and y[x < 50.0].min() == pytest.approx(10.0)
    edge = (x < 30.0 + radius_mm - 1e-9) & (y < 10.0 + radius_mm + 1e-9)
    distance = np.hypot(x - 30.0 - radius_mm, y - 10.0 - radius_mm)[edge]
    assert np.unique(x[edge].round(6)).size == 8  # four corners and four middles
    assert distance.max() == pytest.approx(radius_mm, rel=1e-9)
    assert distance.min() == pytest.approx(radius_mm * np.cos(np.radians(11.25)), rel=1e-9)


def test_edges_without_a_radius_are_sharp() -> None:
    """The volume is that of a plate of 28 x 4 mm and two sides of 20 x 4 mm."""
    surface = straight_channel(0.0)
    assert surface.volume_m3 == pytest.approx(20.0 * (28.0 * 4.0 + 2 * 20.0 * 4.0) * MM**3, rel=1e-9)
    x, y, _ = np.abs(surface.points.T) / MM
    assert y[x < 30.1].min() == pytest.approx(10.0)
