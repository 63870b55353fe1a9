"""Pressure that follows faces, body forces, prescribed motion of nodes and bones, and initial velocities of a scenario."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from support import block_mesh, model_of

import explicitfe
from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.model.attached import FacePressure
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import EXTERNAL
from explicitfe.platform.errors import InputError

BOX = """
title = "Box"
[model]
box_mm = [20.0, 10.0, 10.0]
cells = [4, 2, 2]
fixed = {fixed}
material = {{ law = "neo-hooke", C10_Pa = 5000.0, poisson = 0.45, density_kg_m3 = 1000.0 }}
damping = {{ alpha_per_s = {alpha} }}
{more}
[analysis]
duration_ms = {ms}
[record]
every_ms = 5.0
"""


def run(folder: Path, more: str, *, fixed: str = '["x0"]', alpha: float = 100.0, ms: float = 20.0):
    """The opened result of a box with further tables; keys of [model] come first."""
    (folder / "box.toml").write_text(BOX.format(fixed=fixed, more=more, alpha=alpha, ms=ms))
    return explicitfe.open_result(explicitfe.run(folder / "box.toml", out=folder, overwrite=True)["result"])


def test_pressure_on_a_closed_surface_has_no_resultant_and_works_by_the_volume() -> None:
    """Forces and moments vanish on any closed shape; the external work of a run is the integral of -p dV, by the trapezoid."""
    mesh = block_mesh((3, 2, 2), seed=4)
    u = 1e-3 * np.random.default_rng(1).standard_normal((mesh.node_count, 3))
    every = FacePressure.on(mesh, np.arange(mesh.node_count), 3000.0)
    force = Simulation(model_of(mesh, pressures=(every,)), displacement=u).external_force()
    scale = np.abs(force).sum()
    assert scale > 0.1
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(np.cross(mesh.points + u, force).sum(axis=0), 0.0, atol=1e-14 * scale)
    soft = NeoHooke(law="neo-hooke", C10_Pa=5000.0, poisson=0.3)
    simulation = Simulation(model_of(mesh, soft, pressures=(every,), alpha_per_s=100.0))
    (*_, last) = Transient(simulation, 0.02).samples(0.001)
    change = (volumes(mesh.points + last.displacement, mesh.hexes) - volumes(mesh.points, mesh.hexes)).sum()
    assert change < -0.1 * 12e-6
    assert last.energies[EXTERNAL] == pytest.approx(-3000.0 * change, rel=5e-3)


def shell(around: int, across: int, inner_m: float, outer_m: float) -> HexMesh:
    """An eighth of a spherical shell, of three patches; node sets "inner" and the planes "x", "y", "z"."""
    angle = np.tan(np.linspace(0.0, 0.25 * np.pi, around + 1))
    r, a, b = np.meshgrid(np.linspace(inner_m, outer_m, across + 1), angle, angle, indexing="ij")
    way = np.stack([np.ones_like(a), a, b], axis=-1)
    patch = (r[..., None] * way / np.linalg.norm(way, axis=-1, keepdims=True)).reshape(-1, 3)
    number = np.arange(len(patch)).reshape(r.shape)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    sizes = across, around, around
    hexes = np.stack([number[i : i + sizes[0], j : j + sizes[1], k : k + sizes[2]].ravel() for i, j, k in corners], axis=1)
    points = np.concatenate([np.roll(patch, turn, axis=1) for turn in range(3)])
    _, first, inverse = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    hexes = inverse.ravel()[np.concatenate([hexes + turn * len(patch) for turn in range(3)])]
    points = points[first]
    sets = {name: np.flatnonzero(np.abs(points[:, k]) < 1e-9) for k, name in enumerate("xyz")}
    sets["inner"] = np.flatnonzero(np.linalg.norm(points, axis=1) < inner_m * (1.0 + 1e-9))
    return HexMesh(points, hexes, sets)


def test_a_sphere_under_pressure() -> None:
    """Lame's thick sphere, at a strain of 1e-3: displacement within 1 %, radial and hoop stress within 2 % of the pressure."""
    a, b, p, E, nu = 0.02, 0.04, 60.0, 30e3, 0.3
    mesh = shell(10, 10, a, b)
    law = NeoHooke(law="neo-hooke", C10_Pa=E / (4.0 * (1.0 + nu)), poisson=nu)
    held = mesh.held("x", along="x") | mesh.held("y", along="y") | mesh.held("z", along="z")
    inside = FacePressure.on(mesh, mesh.nodes_of("inner"), p)
    simulation = Simulation(Model(mesh, law, held, pressures=(inside,), alpha_per_s=300.0), stress=True)
    (*_, last) = Transient(simulation, 0.15).samples(0.05)
    centre = mesh.points[mesh.hexes].mean(axis=1)
    radius = np.linalg.norm(centre, axis=1)
    way = centre / radius[:, None]
    tensor = last.stress[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    radial = np.einsum("mi,mij,mj->m", way, tensor, way)
    hoop = 0.5 * (np.trace(tensor, axis1=1, axis2=2) - radial)
    share = p * a**3 / (b**3 - a**3)
    moved = np.einsum("ni,ni->n", last.displacement, mesh.points) / np.linalg.norm(mesh.points, axis=1)
    exact = share / E * ((1.0 - 2.0 * nu) + (1.0 + nu) * b**3 / (2.0 * a**3)) * a
    np.testing.assert_allclose(moved[mesh.nodes_of("inner")], exact, rtol=1e-2)
    np.testing.assert_allclose(radial, share * (1.0 - (b / radius) ** 3), atol=0.02 * p)
    np.testing.assert_allclose(hoop, share * (1.0 + 0.5 * (b / radius) ** 3), atol=0.02 * p)


def test_a_body_force_is_a_weight(tmp_path: Path) -> None:
    """Of density times gravity: the run under gravity, to rounding; a set without elements is refused."""
    with run(tmp_path, "gravity_m_s2 = [0.0, 0.0, -9.81]") as result:
        wanted = result.displacement(-1)
    with run(tmp_path, "[[load]]\nbody_force_N_m3 = [0.0, 0.0, -9810.0]") as result:
        np.testing.assert_allclose(result.displacement(-1), wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())
    assert np.abs(wanted).max() > 1e-4
    with pytest.raises(explicitfe.InputError, match="no element has all its nodes in x0"):
        run(tmp_path, '[[load]]\nnodes = ["x0"]\nbody_force_N_m3 = [0.0, 0.0, -9810.0]')


def test_nodes_move_along_a_path(tmp_path: Path) -> None:
    """A pulled and returned end: at each sample where the path says, with a reaction force of its own name."""
    with run(tmp_path, '[[motion]]\nnodes = ["x1"]\npath = [[0, 0, 0, 0], [100, 4, 0, 0], [300, 4, 0, 1]]', ms=300.0) as result:
        assert result.reaction_names == ["x0", "x1"]
        moved = result.displacement(-1)[result.mesh.node_sets["x1"]]
        np.testing.assert_allclose(moved, np.broadcast_to([4e-3, 0.0, 1e-3], moved.shape), rtol=1e-9)
        halfway = result.displacement(time_s=0.05)[result.mesh.node_sets["x1"]]
        np.testing.assert_allclose(halfway, np.broadcast_to([2e-3, 0.0, 0.0], halfway.shape), rtol=1e-2, atol=1e-12)
        force = result.reaction("x1")[-1]
        assert force[0] > 0.2 and np.abs(force + result.reaction("x0")[-1]).max() < 0.02 * force[0]
    with pytest.raises(explicitfe.InputError, match="take it out of fixed"):
        run(tmp_path, '[[motion]]\nnodes = ["x0"]\npath = [[0, 0, 0, 0], [100, 4, 0, 0]]')
    with pytest.raises(explicitfe.InputError, match="path must begin with"):
        run(tmp_path, '[[motion]]\nnodes = ["x1"]\npath = [[0, 1, 0, 0], [100, 4, 0, 0]]')


def test_a_path_in_a_file_is_the_path_in_the_scenario(tmp_path: Path) -> None:
    """The same displacements to the bit, a column that is left out is zero, and each wrong file has a sentence with its line."""
    file, moved = tmp_path / "motion.csv", '[[motion]]\nnodes = ["x1"]\n'
    file.write_text("time_ms, z_mm, x_mm\n0, 0, 0\n100, 0, 4\n\n300, 1, 4.0\n")
    with run(tmp_path, moved + "path = [[0, 0, 0, 0], [100, 4, 0, 0], [300, 4, 0, 1]]") as inline:
        wanted = inline.displacement(-1)
    with run(tmp_path, moved + 'path_file = "motion.csv"') as result:
        np.testing.assert_array_equal(result.displacement(-1), wanted)
    wrong = {
        "time_s,x_mm\n0,0\n1,1\n": "the first line must name columns",
        "": "the first line must name columns",
        "time_ms,x_mm\n0,0\n1,one\n": "line 3: give a number",
        "time_ms,x_mm\n0,0\n1\n": "line 3: give a number",
        "time_ms,x_mm\n0,0\n": "two rows",
        "time_ms,x_mm\n0,0\n5,1\n4,1\n": "times of path must increase",
        "time_ms,x_mm\n0,1\n5,1\n": "must begin with",
    }
    for text, sentence in wrong.items():
        file.write_text(text)
        with pytest.raises(InputError, match=sentence):
            run(tmp_path, moved + 'path_file = "motion.csv"')
    with pytest.raises(InputError, match="not both"):
        run(tmp_path, moved + 'path_file = "motion.csv"\npath = [[0, 0, 0, 0], [1, 1, 0, 0]]')
    with pytest.raises(InputError, match=r"motion\.csv"):
        file.unlink()
        run(tmp_path, moved + 'path_file = "motion.csv"')


def test_a_body_flies_with_its_initial_velocity(tmp_path: Path) -> None:
    """A free body goes v t; a velocity of one end only sets it in motion there."""
    with run(tmp_path, "[[initial]]\nvelocity_m_s = [0.1, 0.0, -0.2]", fixed="[]", alpha=0.0) as result:
        np.testing.assert_allclose(result.displacement(-1), np.broadcast_to([2e-3, 0.0, -4e-3], (45, 3)), rtol=1e-9)
    with run(tmp_path, '[[initial]]\nnodes = ["x1"]\nvelocity_m_s = [0.0, 0.1, 0.0]') as result:
        velocity = result.field("velocity", 0)
        x1 = result.mesh.node_sets["x1"]
        np.testing.assert_allclose(velocity[x1], np.broadcast_to([0.0, 0.1, 0.0], (9, 3)), atol=1e-3)
        assert np.abs(np.delete(velocity, x1, axis=0)).max() < 1e-3


def test_a_rigid_tool_moves_along_a_path(tmp_path: Path) -> None:
    """A plate touches the box at 25 mm/s and presses it by 1 mm: its place in the file, and the clamp carries its force."""
    low, high = np.array([-5e-3, -5e-3, 10.5e-3]), np.array([25e-3, 15e-3, 14e-3])
    corners = low + (high - low) * np.array([[k, j, i] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    triangles = [[f[0], f[i], f[i + 1]] for f in faces for i in (1, 2)]
    meshio.Mesh(corners, [("triangle", np.array(triangles))]).write(tmp_path / "plate.stl")
    plate = '[[bone]]\nname = "plate"\nfile = "plate.stl"\nlength_unit = "m"\npath = [[0, 0, 0, 0], [60, 0, 0, -1.5]]'
    with run(tmp_path, plate, fixed='["z0"]', ms=200.0) as result:
        np.testing.assert_allclose(result.placement("plate")[1], [0.0, 0.0, -1.5e-3], rtol=1e-12)
        top = result.displacement(-1)[result.mesh.node_sets["z1"], 2]
        np.testing.assert_allclose(top, -1e-3, atol=2e-4)  # the contact gives way by some 0.1 mm
        force = result.reaction("plate")[-1]
        assert force[2] < -0.1
        np.testing.assert_allclose(result.reaction("z0")[-1], -force, atol=1e-3 * abs(force[2]))
