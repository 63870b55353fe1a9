"""Scenarios with several bodies: names, materials, supports, contact, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import explicitfe
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.bones import BoneTable
from explicitfe.simulate.scenario.read import read_transient

SCENARIO = """title = "A plate above a block"
[model]
box_mm = [20.0, 20.0, 20.0]
cells = [4, 4, 4]
fixed = ["z0"]
material = {{ law = "neo-hooke", C10_Pa = 2000.0, poisson = 0.45 }}
damping = {{ alpha_per_s = 100.0 }}
{more}
[[body]]
name = "plate"
box_mm = [30.0, 10.0, 5.0]
cells = [9, 3, 2]
fixed = {fixed}
shift_mm = [-2.0, 5.0, {height}]
material = {{ law = "{law}", C10_Pa = 6000.0{C20}, poisson = 0.45 }}
[[load]]
nodes = ["plate.x1", "plate.z1"]
force_N = [0.0, 0.0, -0.01]
[analysis]
duration_ms = 150.0
[record]
every_ms = 10.0
"""
USUAL = {"more": "", "fixed": '["x0"]', "height": 20.2, "law": "neo-hooke", "C20": ""}


def write(folder: Path, **changed: object) -> Path:
    path = folder / "two.toml"
    path.write_text(SCENARIO.format(**(USUAL | changed)), encoding="utf-8")
    return path


def test_bodies_have_their_own_names_materials_and_supports(tmp_path: Path) -> None:
    model = assemble(read_transient(write(tmp_path)), tmp_path).model
    mesh = model.mesh
    plate = mesh.node_sets["plate"]
    assert len(plate) == 10 * 4 * 3 and {"x0", "plate.x0"} <= mesh.node_sets.keys()
    assert np.isclose(mesh.points[plate, 2].min(), 0.0202) and np.isclose(mesh.points[plate, 0].min(), -0.002)
    assert model.held[mesh.node_sets["plate.x0"]].all() and not model.held[mesh.node_sets["x1"]].all()
    (part,) = model.inclusions
    assert len(part.elements) == 54 and part.elements.min() == 64 and part.material.C10_Pa == 6000.0
    assert model.surfaces is not None and np.allclose(model.probes["plate.z1"].position, [[0.013, 0.010, 0.0252]])


def test_a_plate_rests_on_a_block(tmp_path: Path) -> None:
    """The plate bends down until it rests on the block, which carries part of its load; without the block it hangs lower."""
    summary = explicitfe.run(write(tmp_path), tmp_path / "out")
    assert summary["status"] == "finished" and summary["energy_balance_error"] < 1e-3
    with explicitfe.open_result(summary["result"]) as result:
        last = len(result.times) - 1
        pressure, u = result.field("surface_pressure", last), result.field("displacement", last)
        mesh = result.mesh
    sides = np.isin(np.arange(mesh.node_count), mesh.node_sets["plate"])
    assert pressure[sides].max() > 0.0 and pressure[~sides].max() > 0.0
    far = explicitfe.run(write(tmp_path, height=60.0), tmp_path / "far")
    with explicitfe.open_result(far["result"]) as result:
        free = result.field("displacement", last)
    end = mesh.node_sets["plate.x1"]
    assert u[end, 2].mean() > free[end, 2].mean() + 1e-4


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"height": 19.0}, "two bodies overlap at rest: .* 1 mm deep .*; move them apart"),
        ({"fixed": "[]"}, 'body "plate" is held by nothing; name node sets of it in fixed'),
        ({"fixed": '["x9"]'}, 'body "plate": fixed: unknown node set "x9"; did you mean'),
        ({"law": "yeoh", "C20": ", C20_Pa = 100.0"}, 'body "plate": its material is of another law than that of .model.'),
        ({"more": '[[body]]\nname = "plate"\nbox_mm = [1.0, 1.0, 1.0]\ncells = [4, 3, 4]'}, "two ..body.. tables have one name"),
        ({"more": '[[body]]\nname = "a.b"\nbox_mm = [1.0, 1.0, 1.0]\ncells = [4, 3, 4]'}, '"a.b" cannot be the name of a body'),
        ({"more": '[[body]]\nname = "c"'}, "give either model .a built-in model., file"),
        ({"more": "[[resection]]\nbox_mm = [[0.0, 0.0, 0.0], [5.0, 5.0, 5.0]]"}, "surgery of several bodies is not supported"),
        ({"more": "[contact]\nfriction = -1.0"}, "friction"),
    ],
)
def test_what_is_refused(tmp_path: Path, changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        explicitfe.run(write(tmp_path, **changed), tmp_path / "out")


def test_only_the_built_in_palate_has_a_velum() -> None:
    """It ends where the body of that name begins; no other bone can be cut so."""
    shape = catalogue.bones("tongue")["palate"]
    assert shape.without_velum is not None
    assert shape.without_velum.points[:, 0].max() == pytest.approx(0.103)
    assert shape.surface.points[:, 0].max() == pytest.approx(0.134)
    velum = catalogue.built_in("velum").mesh
    assert velum.points[velum.node_sets["hard-palate"], 0] == pytest.approx(0.103)
    for table in ({"name": "jaw"}, {"name": "palate", "file": "palate.stl", "length_unit": "mm"}):
        with pytest.raises(ValidationError, match="has no velum: velum = false belongs to the built-in bone"):
            BoneTable.model_validate({**table, "velum": False})
