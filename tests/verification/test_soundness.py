"""A mesh that is not the body that was meant is told in a sentence, or refused; what is as usual is passed over in silence."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from command import command
from outside_data import SHARED_DATA, needs
from support import ROOT, block_mesh, mesh_of, model_of, small_indentation

from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.cylinder import sector_mesh
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import check
from explicitfe.fem.mesh.soundness import soundness
from explicitfe.fem.model.model import PrescribedMotion
from explicitfe.platform.compiled.arrays import Springs
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.specimen import specimen_model
from explicitfe.simulate.run.notes import mesh_notes
from explicitfe.simulate.run.prepare import prepare

REAL = SHARED_DATA / "tongue" / "artisynth-hextongue"
BLOCK = box((3, 2, 2), (0.03, 0.02, 0.02))


def joined(*meshes: HexMesh) -> HexMesh:
    """Several meshes as one, with no node in common; the node sets are those of the first."""
    starts = np.cumsum([0, *(mesh.node_count for mesh in meshes)])
    hexes = [mesh.hexes + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return HexMesh(np.concatenate([mesh.points for mesh in meshes]), np.concatenate(hexes), meshes[0].node_sets)


def moved(mesh: HexMesh, *shift_m: float) -> HexMesh:
    return replace(mesh, points=mesh.points + np.array(shift_m))


def notes_of(mesh: HexMesh, *held: str) -> str:
    return "\n".join(mesh_notes(model_of(mesh, held=held or ("x0",))))


# ---- what is told ----


def test_nodes_that_are_not_merged():
    """Every hex by itself, as some mesh programs write them: they would all fall by themselves."""
    alone = HexMesh(BLOCK.points[BLOCK.hexes].reshape(-1, 3), np.arange(8 * BLOCK.element_count).reshape(-1, 8))
    held = np.flatnonzero(alone.points[:, 0] == 0.0)
    notes = notes_of(replace(alone, node_sets={"x0": held}))
    # the corners of the block are the only nodes of one hex alone
    assert f"{8 * 12 - 8} nodes of the mesh lie at the place of another one" in notes and "merge these nodes" in notes
    assert "12 parts that have no node in common, the smallest of 1 element around" in notes
    assert "nothing holds 8 of the 12 parts" in notes
    assert "lie in the place of others" not in notes


def test_a_part_that_nothing_holds():
    notes = notes_of(joined(BLOCK, moved(box((1, 1, 1), (0.01, 0.01, 0.01)), 0.05, 0.0, 0.0)))
    assert "2 parts that have no node in common, the smallest of 1 element around (55.0, 5.0, 5.0) mm" in notes
    assert "nothing holds 1 of the 2 parts" in notes and "1 element around (55.0, 5.0, 5.0) mm: any force moves them" in notes
    assert "at the place of another" not in notes


def test_elements_in_the_place_of_others():
    """Whether the grids lie on each other, between each other, or only the corners of two parts are in each other."""
    for shift_mm, double in (((0.0, 0.0, 0.0), 24), ((4.0, 3.0, 3.0), 24), ((28.0, 17.0, 17.0), 2)):
        mesh = joined(BLOCK, moved(BLOCK, *(1e-3 * np.array(shift_mm))))
        assert f"{double} elements lie in the place of others at rest" in notes_of(mesh)


def test_pieces_that_an_edge_or_a_node_joins():
    for corner, count in ((0b110, 2), (0b111, 1)):  # the second cube begins at an edge of the first, at a corner
        cube = box((1, 1, 1), (0.01, 0.01, 0.01))
        shift = 0.01 * np.array([corner >> 2 & 1, corner >> 1 & 1, corner & 1])
        both = np.concatenate([cube.points, cube.points + shift])
        points, number = np.unique(both.round(9), axis=0, return_inverse=True)
        assert len(points) == 16 - count
        hexes = number.ravel()[np.concatenate([cube.hexes, cube.hexes + 8])]
        mesh = HexMesh(points, hexes, {"x0": np.flatnonzero(points[:, 0] == 0.0)})
        assert "join the mesh's 2 pieces, the smallest of 1 element around" in notes_of(mesh)
        assert soundness(mesh).part_count == 1


@pytest.mark.parametrize(("factor", "size"), [(1e3, "3e+04 mm long, very large"), (1e-3, "0.03 mm long, very small")])
def test_another_unit_of_length(factor, size):
    notes = notes_of(replace(BLOCK, points=factor * BLOCK.points))
    assert size in notes and "length_unit" in notes


def test_a_body_that_nothing_holds_gets_one_note():
    (note,) = mesh_notes(model_of(BLOCK))
    assert note.startswith("nothing holds the body") and "moves and turns freely" in note


def test_what_holds():
    """A fixed component, springs and given motion hold; so do ties (the scenarios below)."""
    free = model_of(BLOCK)
    roller = replace(free, held=BLOCK.held("z0", along="z"))
    springs = replace(free, support=Springs(np.array([0]), np.ones((1, 3))))
    led = replace(free, motion=PrescribedMotion(np.array([0]), lambda times: np.zeros((len(times), 1, 3))))
    for model in (roller, springs, led):
        assert mesh_notes(model) == ()


# ---- what is refused ----


def test_an_element_given_twice_is_refused():
    turned = BLOCK.hexes[4][[1, 2, 3, 0, 5, 6, 7, 4]]
    with pytest.raises(InputError, match="element 12 has the same 8 nodes as element 4; remove one of them"):
        check(replace(BLOCK, hexes=np.concatenate([BLOCK.hexes, [turned]])), "block")


def test_three_elements_at_a_face_are_refused():
    """A third hex on a face between two others lies where one of them is."""
    mesh = box((2, 1, 1), (0.02, 0.01, 0.01))
    far = mesh.points[mesh.node_sets["x1"]] - [0.002, 0.0, 0.0]
    third = mesh.hexes[1].copy()
    for number, node in enumerate(mesh.node_sets["x1"]):
        third[third == node] = mesh.node_count + number
    with pytest.raises(InputError, match="elements 0, 1 and 2 share a face, which can belong to two elements at most"):
        check(HexMesh(np.concatenate([mesh.points, far]), np.concatenate([mesh.hexes, [third]])), "block")


# ---- what is as usual ----


@pytest.mark.parametrize("resolution", ["coarse", "medium"])
def test_no_note_on_the_tongue(resolution):
    mesh = catalogue.built_in("tongue", resolution).mesh
    assert mesh_notes(model_of(mesh, held=("jaw", "hyoid"))) == ()


@pytest.mark.parametrize("name", ["vowel-i", "sequence-iau", "glossectomy-half", "indentation-ball"])
def test_no_note_on_a_scenario(name):
    """Held by area, after surgery, and a sector, whose elements on the axis have nodes twice."""
    assert mesh_notes(prepare(ROOT / "scenarios" / f"{name}.toml").model) == ()


@pytest.mark.parametrize("symmetry", ["quarter", "half", "whole"])
@pytest.mark.parametrize("block", [False, True])
def test_no_note_on_a_specimen(symmetry, block):
    size = {"size_mm": (16.0, 12.0, 5.0)} if block else {"radius_mm": 8.0, "height_mm": 5.0}
    table = SpecimenTable(symmetry=symmetry, edge_size_mm=1.0, base="sliding", **size)
    assert mesh_notes(specimen_model(table, ToolTable(shape="sphere", radius_mm=3.0))) == ()


def test_no_note_on_test_bodies():
    assert mesh_notes(small_indentation()) == ()
    for seed in range(5):
        assert mesh_notes(model_of(block_mesh((4, 3, 3), distort=0.2, seed=seed), held=("x0",))) == ()
    plates = box((20, 20, 4), (0.1, 0.1, 0.0004))  # 50 : 50 : 1
    assert mesh_notes(model_of(plates, held=("x0",))) == ()
    assert soundness(mesh_of("block")).piece_count == 1
    assert soundness(sector_mesh(np.linspace(0.0, 0.01, 8), np.linspace(0.0, 0.02, 5), 0.01)).piece_count == 1


@needs(REAL)
def test_no_note_on_the_measured_tongue():
    mesh = meshio.read(REAL / "hextongue.vtu")
    body = soundness(
        HexMesh(1e-3 * mesh.points * (1.0 if np.ptp(mesh.points) > 1.0 else 1e3), mesh.cells[0].data.astype(np.int64))
    )
    assert (body.part_count, body.piece_count, len(body.same_place), len(body.overlapping)) == (1, 1, 0, 0)


# ---- check and run say it ----


def test_check_and_run_tell_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """The same sentence in words and in JSON; metres that were taken for millimetres, and a block without support."""
    meshio.write(tmp_path / "block.vtu", meshio.Mesh(BLOCK.points, [("hexahedron", BLOCK.hexes)]))
    (tmp_path / "block.toml").write_text('mesh = "block.vtu"\nlength_unit = "mm"\n')
    scenario = tmp_path / "own.toml"
    scenario.write_text('title = "own"\n[model]\nfile = "block.toml"\n[analysis]\nduration_ms = 0.001\n')
    assert command(["check", str(scenario), "--json"]) == 0
    warnings = json.loads(capsys.readouterr().out)["warnings"]
    assert [note.split(",")[0] for note in warnings] == ["nothing holds the body", "the mesh is 0.03 mm long"]
    assert command(["check", str(scenario)]) == 0
    shown = " ".join(capsys.readouterr().err.split())
    assert all(note in shown for note in warnings)
    assert command(["run", str(scenario), "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"][:2] == warnings


# ---- meshes that runs share ----


def test_arrays_that_runs_share_are_read_only():
    anatomy = catalogue.built_in("tongue", "coarse")
    arrays = [anatomy.mesh.points, anatomy.mesh.hexes, anatomy.mesh.node_sets["jaw"], anatomy.mesh.named_points["tip"].natural]
    arrays += [anatomy.muscles["GGp"].elements, anatomy.muscles["GGp"].fibres[0].points.position]
    arrays += [catalogue.bones("tongue")["palate"].surface.points]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
