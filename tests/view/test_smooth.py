"""The smooth surface for display: it reproduces linear fields, stays near the mesh, and keeps the edges of a specimen."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.app.view.smooth import SmoothSurface
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.fem.mesh.triangles import triangle_distance
from explicitfe.simulate.anatomy import catalogue

# Largest distance of the drawn surface from the faces of the mesh, by the density of the mesh: it rounds the sharpest edges.
DISTANCE_MM = {"coarse": 1.2, "medium": 0.8, "fine": 0.6}


def skin_of(mesh: HexMesh) -> np.ndarray:
    element, face = free_faces(mesh.hexes)
    return mesh.hexes[element[:, None], FACES[face]]


def smooth_surface(mesh: HexMesh, levels: int = 2, round_edges: bool = True) -> SmoothSurface:
    return SmoothSurface.of(mesh.points, skin_of(mesh), levels=levels, round_edges=round_edges)


@pytest.mark.parametrize("levels", [0, 1, 2])
def test_constant_and_linear_fields_stay_as_they_are(levels):
    mesh = catalogue.built_in("tongue", cells=(8, 4, 4)).mesh
    surface = smooth_surface(mesh, levels)
    assert len(surface.quads) == 4**levels * len(skin_of(mesh))
    np.testing.assert_allclose(surface.matrix @ np.ones(mesh.node_count), 1.0, rtol=0.0, atol=1e-14)
    # A field that is linear in the place of a node is so in that of a drawn point, however the body is deformed.
    slope = np.array([3.0, -1.0, 2.0])
    places = surface.matrix @ mesh.points
    np.testing.assert_allclose(surface.matrix @ (mesh.points @ slope), places @ slope, rtol=0.0, atol=1e-13)


def test_a_flat_face_stays_flat_and_regular():
    mesh = box((4, 3, 2), (0.04, 0.03, 0.02))
    surface = smooth_surface(mesh, round_edges=False)
    places = np.unique(np.round(1e6 * (surface.matrix @ mesh.points)[np.unique(surface.quads)]), axis=0)
    finer = box((16, 12, 8), (0.04, 0.03, 0.02))
    expected = np.unique(np.round(1e6 * finer.points[np.unique(skin_of(finer))]), axis=0)
    np.testing.assert_array_equal(places, expected)  # the edges and the corners among them


def test_round_edges_are_round():
    mesh = box((4, 4, 4), (0.04, 0.04, 0.04))
    places = smooth_surface(mesh).matrix @ mesh.points
    corner = np.linalg.norm(places, axis=1).min()
    assert 1e-3 < corner < 5e-3


@pytest.mark.parametrize("resolution", DISTANCE_MM)
def test_the_smooth_tongue_is_near_the_mesh(resolution):
    mesh = catalogue.built_in("tongue", resolution=resolution).mesh
    surface = smooth_surface(mesh, levels=1)
    places = (surface.matrix @ mesh.points)[np.unique(surface.quads)]
    quads = skin_of(mesh)
    corners = mesh.points[quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)]
    distance = np.array([triangle_distance(np.broadcast_to(place, (len(corners), 3)), corners).min() for place in places])
    assert 1e3 * distance.max() < DISTANCE_MM[resolution]
    assert 1e3 * np.sqrt(np.mean(distance**2)) < 0.3 * DISTANCE_MM[resolution]


def test_a_cut_face_ends_at_the_skin():
    """The skin with a cut through it is drawn as without, and the cut face takes over its points."""
    mesh = catalogue.built_in("tongue", cells=(8, 4, 4)).mesh
    right = mesh.hexes[mesh.points[mesh.hexes, 1].mean(axis=1) > 0.0]
    element, face = free_faces(right)
    faces = right[element[:, None], FACES[face]]
    cut = faces[np.abs(mesh.points[faces, 1]).max(axis=1) < 1e-9]
    skin, whole = skin_of(mesh), smooth_surface(mesh)
    group = np.repeat([0, 1], [len(skin), len(cut)])
    both = SmoothSurface.of(mesh.points, np.concatenate([skin, cut]), group, levels=2, round_edges=True)
    places = both.matrix @ mesh.points
    np.testing.assert_allclose(places[both.quads[both.group == 0]], (whole.matrix @ mesh.points)[whole.quads], atol=1e-15)
    assert np.abs(places[both.quads[both.group == 1], 1]).max() < 1e-12


def test_a_collapsed_face_is_a_triangle():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1, 1], [0, 1, 3, 3], [1, 2, 3, 3], [0, 3, 2, 2]])
    surface = SmoothSurface.of(points, faces, levels=2, round_edges=True)
    assert len(surface.quads) == 4 * 3 * 4
    pairs = np.stack([surface.quads, np.roll(surface.quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    assert {tuple(pair) for pair in pairs.tolist()} == {tuple(pair) for pair in pairs[:, ::-1].tolist()}  # closed
    np.testing.assert_allclose(surface.matrix.sum(axis=1), 1.0, rtol=0.0, atol=1e-14)
