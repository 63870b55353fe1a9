"""In large meshes the geometry of elements is derived from the positions of their nodes at each step: the same as if read."""

from __future__ import annotations

import numpy as np
import pytest
from support import block_mesh, deformed, elastic_energies, force_scale, model_of

from explicitfe.fem.elements import hex8, hourglass_stiffness, hourglass_strain
from explicitfe.fem.solve import body as bodies
from explicitfe.fem.solve.simulation import Simulation

pytestmark = pytest.mark.slow

TREATMENTS = {"hex8": hourglass_strain, "hex8-stiffness": hourglass_stiffness}


def test_derived_geometry_is_the_stored_one():
    """Products of three edges, and sums of eight of them: 1e-14 of the largest number of a kind on distorted hexes of size 1."""
    mesh = block_mesh((3, 3, 2), seed=4)
    for corners in mesh.points[mesh.hexes] / np.ptp(mesh.points) * 3.0:
        modes = tuple(hex8.to_modes(tuple(corners[:, j])) for j in range(3))
        derived = hex8.derived_geometry(modes)
        stored = hex8.geometry(corners[None])
        for kind in (slice(0, 18), slice(18, hex8.VOLUME), slice(hex8.VOLUME, None)):
            assert np.abs(np.array(derived[kind]) - stored[0, kind]).max() < 1e-14 * np.abs(stored[0, kind]).max()
        for treatment in TREATMENTS.values():
            assert treatment.of_shape(modes, derived) == pytest.approx(treatment.constants(corners[None], stored)[0], rel=1e-14)


@pytest.mark.parametrize("element", TREATMENTS)
def test_both_kinds_of_kernels_compute_the_same(element, monkeypatch):
    """Forces, energies, the element bound and the strain rate of nine elements, so that some lanes are empty.

    Geometry differs by 1e-14, and so do forces relative to their scale; the bound differences them over a millionth of an edge.
    """
    mesh = block_mesh((3, 3, 1), seed=9)
    u = deformed(mesh, np.random.default_rng(9), 0.3, 0.1)
    velocity = np.random.default_rng(1).standard_normal(u.shape)
    answers = []
    for limit in (len(mesh.hexes), 0):
        monkeypatch.setattr(bodies, "DERIVED_ABOVE_ELEMENTS", limit)
        body = Simulation(model_of(mesh, element=element), displacement=u, velocity=velocity)
        assert body.blocks.geometry.shape[1] == (hex8.GEOMETRY if limit else 0)
        forces = body.internal_force(u) / force_scale(body)
        answers.append((forces, elastic_energies(body, u), body.stable_bound()))
    (read_force, read_energies, read_bound), (force, energies, bound) = answers
    assert np.abs(force).max() > 1e-2
    assert np.abs(force - read_force).max() < 1e-13
    assert energies == pytest.approx(read_energies, rel=1e-12)
    assert bound[1] == read_bound[1] and bound[0] == pytest.approx(read_bound[0], rel=1e-6)


def test_parts_have_the_positions_of_their_nodes(monkeypatch):
    """Two threads compute with derived geometry what one computes, up to the order of sums."""
    monkeypatch.setattr(bodies, "DERIVED_ABOVE_ELEMENTS", 0)
    mesh = block_mesh((4, 4, 4), seed=2)
    velocity = 0.1 * np.random.default_rng(3).standard_normal((mesh.node_count, 3))
    moved = []
    for threads in (1, 2):
        body = Simulation(model_of(mesh), velocity=velocity, threads=threads)
        assert len(body.parts) == threads
        dt_s = 0.5 * body.stable_limit(20)
        body.start(dt_s)
        assert body.advance(10, dt_s)
        moved.append(body.displacement)
    assert np.abs(moved[1] - moved[0]).max() < 1e-10 * np.abs(moved[0]).max()
