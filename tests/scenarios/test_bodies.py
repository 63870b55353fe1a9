"""Scenarios with several bodies: names, materials, supports, contact, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import explicitfe
from explicitfe.fem.mesh.hexmesh import shape_functions
from explicitfe.fem.model.model import Model
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
        ({"height": 19.0}, r'two bodies overlap \("plate"\) at rest: .* 1 mm deep .*; move them apart'),
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
    assert shape.hard is not None
    assert shape.hard.points[:, 0].max() == pytest.approx(0.103)
    assert shape.surface.points[:, 0].max() == pytest.approx(0.134)
    velum = catalogue.built_in("velum").mesh
    assert velum.points[velum.node_sets["hard-palate"], 0] == pytest.approx(0.103)
    for table in ({"name": "jaw"}, {"name": "palate", "file": "palate.stl", "length_unit": "mm"}):
        with pytest.raises(ValidationError, match="has no velum: velum = false belongs to the built-in bone"):
            BoneTable.model_validate({**table, "velum": False})
    with pytest.raises(ValidationError, match=r'"palate" has no side walls: side_walls = false belongs to .* "pharynx"'):
        BoneTable.model_validate({"name": "palate", "side_walls": False})


WITH_WALLS = """title = "A tongue between soft walls"
[model]
name = "{tongue}"
resolution = "coarse"
[[bone]]
name = "pharynx"
side_walls = {rigid}
[[body]]
name = "pharynx-walls"
model = "pharynx-walls"
[analysis]
duration_ms = 1.0
"""


def test_side_walls_take_the_place_of_those_of_the_bone(tmp_path: Path) -> None:
    """The bone is its posterior wall; where it keeps its side walls, or a tongue is as wide, a sentence says what to do."""
    model = assembled(tmp_path, WITH_WALLS.format(tongue="tongue", rigid="false"))
    walls = model.mesh.node_sets["pharynx-walls"]
    (bone,) = model.bones
    assert bone.field.at(model.mesh.points[walls])[0].min() > -5e-4
    assert model.held[model.mesh.node_sets["pharynx-walls.outer"]].all() and not model.held[walls].all()
    with pytest.raises(InputError, match=r'bone "pharynx" \(side_walls = false makes room for a \[\[body\]\]\): the body starts'):
        assembled(tmp_path, WITH_WALLS.format(tongue="tongue", rigid="true"))
    path = tmp_path / "wide.toml"
    path.write_text(WITH_WALLS.format(tongue="tongue-1", rigid="false"), encoding="utf-8")
    with pytest.raises(InputError, match=r'two bodies overlap \("pharynx-walls"\) at rest: .* move them apart'):
        explicitfe.run(path, tmp_path / "out")


WITH_VELUM = """title = "A tongue with a soft palate"
[model]
name = "tongue"
resolution = "coarse"
attachment = "area"
[[body]]
name = "velum"
model = "velum"
fixed = ["hard-palate"]
[[support]]
name = "velum.levator"
normal_kPa_per_mm = 5.0
tangential_kPa_per_mm = 4.0
shift_mm = [0.0, 0.0, -6.0]
table = [[0.0, 0.0], [10.0, 1.0]]
[[muscle]]
name = "PG"
force_N = 0.8
distribution = "stress"
[analysis]
duration_ms = 1.0
"""

TRANSVERSUS = """[[muscle]]
name = "TRANS"
force_N = 4.0
distribution = "stress"
"""


def assembled(folder: Path, text: str) -> Model:
    path = folder / "velum.toml"
    path.write_text(text, encoding="utf-8")
    return assemble(read_transient(path), folder).model


def test_a_palatoglossus_pulls_at_a_velum_that_is_a_body(tmp_path: Path) -> None:
    """Both ends of its lines lie in elements, as many on each side and as mirror images; without a velum they begin in space."""
    model = assembled(tmp_path, WITH_VELUM)
    tongue = catalogue.built_in("tongue", "coarse").mesh
    (pull,) = model.pulls
    ends = np.array([line.element for line in pull.points])
    assert (ends[:, 0] >= tongue.element_count).all() and (ends[:, 1] < tongue.element_count).all() and ends[:, 1].min() >= 0
    for line in pull.points:
        weights = shape_functions(line.natural)
        at = np.einsum("ka,kai->ki", weights, model.mesh.points[model.mesh.hexes[line.element]])
        assert np.allclose(at, line.position, atol=1e-9)
    half = len(pull.points) // 2
    right, left = (np.array([line.position for line in side]) for side in (pull.points[:half], pull.points[half:]))
    assert np.allclose(
        sorted(map(tuple, right.reshape(half, 6).round(9))), sorted(map(tuple, (left * [1, -1, 1]).reshape(half, 6).round(9)))
    )
    assert sum(tension.sum() for tension in pull.tension_N) == pytest.approx(0.8)
    alone = assembled(tmp_path, WITH_VELUM[: WITH_VELUM.index("[[body]]")] + WITH_VELUM[WITH_VELUM.index("[[muscle]]") :])
    assert all(line.element[0] < 0 for line in alone.pulls[0].points)


def test_a_muscle_acts_on_its_own_body_only(tmp_path: Path) -> None:
    """Its Gaussians reach into the velum 6 mm away, and the styloglossus passes it: neither pulls there."""
    text = WITH_VELUM.replace('name = "PG"', 'name = "STY"').replace("[analysis]", TRANSVERSUS + "[analysis]")
    model, tongue = assembled(tmp_path, text), catalogue.built_in("tongue", "coarse").mesh
    assert all(stress.elements.max() < tongue.element_count for stress in model.stresses)
    assert all(line.element.max() < tongue.element_count for pull in model.pulls for line in pull.points)
    alone = assembled(tmp_path, text[: text.index("[[body]]")] + text[text.index("[[muscle]]") :])
    for one, other in zip(model.stresses, alone.stresses, strict=True):
        assert np.array_equal(one.elements, other.elements) and np.array_equal(one.stress_Pa, other.stress_Pa)


def test_a_support_moves_a_patch_of_a_body(tmp_path: Path) -> None:
    """The patch of the levator is held by springs and not by nodes, and their foundation moves."""
    model = assembled(tmp_path, WITH_VELUM)
    levator = model.mesh.node_sets["velum.levator"]
    assert not model.held[levator].any() and model.held[model.mesh.node_sets["velum.hard-palate"]].all()
    (tie,) = [tie for tie in model.attachments if tie.name == "velum.levator"]
    assert (tie.normal_stiffness_Pa_m, tie.stiffness_Pa_m) == (5e6, 4e6)
    rotation, shift = tie.motion.placement(np.array([0.0, 0.005, 1.0]))
    assert np.allclose(rotation, np.eye(3)) and np.allclose(shift[:, 2], [0.0, -0.003, -0.006])
    held = assembled(tmp_path, WITH_VELUM.replace("shift_mm = [0.0, 0.0, -6.0]\n", ""))
    assert [tie.motion for tie in held.attachments if tie.name == "velum.levator"] == [None]


def test_a_built_in_body_is_as_fine_as_the_model(tmp_path: Path) -> None:
    """Unless it says otherwise."""
    counts = {name: catalogue.built_in("velum", name).mesh.node_count for name in ("coarse", "medium", "fine")}
    for resolution in ("coarse", "fine"):
        model = assembled(tmp_path, WITH_VELUM.replace('"coarse"', f'"{resolution}"'))
        assert len(model.mesh.node_sets["velum"]) == counts[resolution]
    own = assembled(tmp_path, WITH_VELUM.replace('model = "velum"', 'model = "velum"\nresolution = "medium"'))
    assert len(own.mesh.node_sets["velum"]) == counts["medium"]


def test_a_motion_begins_at_rest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="table must begin with a share of 0"):
        assembled(tmp_path, WITH_VELUM.replace("[[0.0, 0.0], [10.0, 1.0]]", "[[0.0, 0.5], [10.0, 1.0]]"))
