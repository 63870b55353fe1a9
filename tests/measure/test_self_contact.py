"""A body that passes through itself is found, and how deep is known where the shape is."""

from __future__ import annotations

import numpy as np
import pytest
from support import block_mesh, deformed, mesh_of

from explicitfe.fem.mesh import self_contact
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.self_contact import self_penetration

# A plate of 40 x 10 x 2 mm in elements of 1 x 1 x 0.5 mm.
LENGTH_M, THICKNESS_M = 0.04, 0.002


def plate() -> HexMesh:
    return box((40, 10, 4), (LENGTH_M, 0.01, THICKNESS_M))


def folded(gap_m: float, mesh: HexMesh) -> np.ndarray:
    """The displacement that folds the plate over: 15 mm stay flat, 10 mm turn by half a circle, 15 mm come back above them.

    Its middle surface turns with the radius 10 mm / pi = 3.18 mm, so the halves would be 2 x 3.18 - 2 = 4.37 mm apart; the upper
    one then comes down evenly, over the turn and beyond, until the gap is ``gap_m``; below 0 they pass into each other.
    """
    flat, turn = 0.015, 0.010
    radius = turn / np.pi
    s, y, h = mesh.points.T
    angle = np.clip((s - flat) / radius, 0.0, np.pi)
    back = np.maximum(s - flat - turn, 0.0)
    away = radius + 0.5 * THICKNESS_M - h  # from the axis of the turn
    x = np.minimum(s, flat) + away * np.sin(angle) - back
    z = radius + 0.5 * THICKNESS_M - away * np.cos(angle)
    lowered = 2.0 * radius - THICKNESS_M - gap_m
    z = z - lowered * angle / np.pi
    return np.column_stack([x, y, z]) - mesh.points


@pytest.mark.parametrize("gap_mm", [2.0, 0.5, 0.1])
def test_a_fold_that_does_not_touch_is_none(gap_mm):
    mesh = plate()
    answer = self_penetration(mesh, folded(1e-3 * gap_mm, mesh))
    assert (answer.count, answer.deepest_m, answer.where_m) == (0, 0.0, None)


@pytest.mark.parametrize("depth_mm", [0.1, 0.4, 0.7])
def test_a_folded_plate_passes_into_itself_as_deep_as_it_was_pushed(depth_mm):
    mesh = plate()
    answer = self_penetration(mesh, folded(-1e-3 * depth_mm, mesh))
    # Where the halves are flat the depth is known: the plate was lowered that far, and its surfaces there are planes.
    assert answer.deepest_m == pytest.approx(1e-3 * depth_mm, rel=0.02)
    # One of the two upper faces (h = 2 mm) that came to lie on each other, on the parts that stayed flat.
    assert answer.where_m[2] == pytest.approx(THICKNESS_M)
    # Each flat part has 16 x 11 nodes there; of the lower one all below the upper one are inside it.
    assert 16 * 9 < answer.count < 2 * 18 * 11


def test_rigid_motion_and_strain_are_no_penetration():
    random = np.random.default_rng(7)
    for shape in ("block", "tongue"):
        mesh = mesh_of(shape)
        for _ in range(5):
            assert self_penetration(mesh, deformed(mesh, random, gradient=0.3)).count == 0


def test_two_bodies_in_one_mesh():
    one = box((3, 3, 3), (0.003, 0.003, 0.003))
    # The second cube is moved along the diagonal: its corner node lies (0.3, 0.4, 0.5) mm below three faces of the first.
    shift = 0.003 - np.array([0.0003, 0.0004, 0.0005])
    points = np.concatenate([one.points, one.points + shift])
    both = HexMesh(points, np.concatenate([one.hexes, one.hexes + one.node_count]))
    answer = self_penetration(both, np.zeros_like(points))
    assert answer.count == 2  # and the corner of the first lies in the second
    assert answer.deepest_m == pytest.approx(0.0003, rel=1e-9)
    apart = np.zeros_like(points)
    apart[one.node_count :, 0] = 0.0003  # now the faces touch
    assert self_penetration(both, apart).count == 0


def test_it_is_found_in_any_direction():
    mesh = block_mesh((3, 3, 3), distort=0.2, seed=3)
    copy = np.concatenate([mesh.points, mesh.points])
    both = HexMesh(copy, np.concatenate([mesh.hexes, mesh.hexes + mesh.node_count]))
    random = np.random.default_rng(1)
    for _ in range(10):
        direction = random.normal(size=3)
        u = np.zeros_like(copy)
        u[mesh.node_count :] = 0.004 * direction / np.linalg.norm(direction)
        assert self_penetration(both, u).count > 0
        u[mesh.node_count :] *= 20.0  # further than the diagonal of the block: apart
        assert self_penetration(both, u).count == 0


def test_pairs_of_boxes_and_points_are_complete():
    """Boxes of many sizes: the cells give the pairs that trying each box with each point gives."""
    random = np.random.default_rng(3)
    mesh = box((4, 5, 6), (0.04, 0.05, 0.06))
    x = mesh.points + random.normal(scale=5e-3, size=mesh.points.shape)
    x[mesh.hexes[0]] *= 20.0  # a large element among small ones
    points = np.concatenate([x, 0.1 * random.normal(size=(200, 3))])
    low, high = x[mesh.hexes].min(axis=1)[:, None], x[mesh.hexes].max(axis=1)[:, None]
    element, point = self_contact._in_boxes(x, mesh.hexes, points)
    order = np.lexsort([point, element])
    pairs = np.argwhere(((points >= low) & (points <= high)).all(axis=2))
    np.testing.assert_array_equal(np.column_stack([element, point])[order], pairs)
