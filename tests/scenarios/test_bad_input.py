"""Bad input of every kind gives one clear sentence on stderr and exit code 2, and leaves nothing behind."""

from __future__ import annotations

import json
from pathlib import Path

import meshio
import numpy as np
import pytest
from command import command
from support import block_mesh

from explicitfe.platform.errors import InputError, nearest
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.read import read_scenario

ROOT = Path(__file__).parents[2]
VOWEL = ROOT / "scenarios" / "vowel-i.toml"
SMALL = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=2"]

SETTINGS = [
    ("muscle.GGp.forc_N=1", ["forc_N", "muscle.GGp", 'did you mean "force_N"?']),
    ("model.materiel=soft", ["materiel", "[model]", 'did you mean "material"?']),
    ("muscle.GGp.name=GGq", ["GGq", 'did you mean "GGp"?']),
    ("muscle.GGp.force_N=-1", ["muscle.GGp.force_N", "-1", "greater than or equal to 0"]),
    ("muscle.GGp.force_N=nan", ["muscle.GGp.force_N", "finite"]),
    ("muscle.GGp.side=centre", ["muscle.GGp.side", "'both', 'left' or 'right'"]),
    ("muscle.GGp.fibres=[1, 9]", ["muscle GGp has no fibre 9", "from 1 to 4 on a side"]),
    ("muscle.GGp.fibres=[]", ["muscle.GGp.fibres", "at least 1"]),
    ("muscle.GGp.end_ms=0", ["muscle.GGp", "end_ms must come after"]),
    ("muscle.GGx.force_N=1", ["GGx", 'did you mean "GGp"?']),
    ("analysis.duration_ms=0", ["analysis.duration_ms", "greater than 0"]),
    ("analysis.duration_ms=long", ["analysis.duration_ms", "number"]),
    ("analysis.step_us=100000", ["vowel-i.toml", "analysis.step_us", "unstable", "largest stable step", "element"]),
    ('muscle.GGp.force_N="2"', ["muscle.GGp.force_N", "'2'", "valid number"]),
    ('model.material={C10_Pa="191.5", C20_Pa=90.6}', ["model.material.C10_Pa", "valid number"]),
    ("model.damping.alpha_per_s=true", ["model.damping.alpha_per_s", "valid number"]),
    ("model.gravity_m_s2=[0, 0]", ["model.gravity_m_s2: must be three numbers [x, y, z]"]),
    ("model.cells=[8, 4]", ["model.cells: must be three whole numbers"]),
    (
        'muscle=[{name="GGp", force_N=1, profile="table", table=[[0, 1, 2]]}]',
        ["muscle.GGp.table 1: must be a pair [time_ms, scale]"],
    ),
    (
        'muscle=[{name="GGp", force_N=1, profile="table", table=[[0, 1]], end_ms=5}]',
        ["muscle.GGp", "end_ms", 'profile = "table"'],
    ),
    (
        'muscle=[{name="GGp", force_N=1, profile="table", table=[[0, 1]], start_ms=5}]',
        ["muscle.GGp", "start_ms", 'profile = "table"'],
    ),
    ("muscle=[{force_N=1}]", ['the key "name" is missing in [muscle 1]']),
    ("model.material=gerard-2006", ["gerard-2006", 'did you mean "gerard-2005"?']),
    ("model.material={C10_Pa=191.5}", ["C20_Pa", "missing"]),
    ("model.material={C10_Pa=191.5, C20_Pa=90.6, poisson=0.5}", ["poisson", "0.5", "less than 0.5"]),
    ('model.material={law="ogden", C10_Pa=1.0}', ["law ogden", "yeoh"]),
    ("model.name=tounge", ["tounge", 'did you mean "tongue"?']),
    ("model.resolution=corse", ["corse", 'did you mean "coarse"?']),
    ("model.cells=[8, 4, 5]", ["cells", "even"]),
    ('model.fixed=["jaws"]', ["jaws", 'did you mean "jaw"?']),
    ('record.probes=["tipp"]', ["tipp", 'did you mean "tip"?']),
    ('record.fields=["stresses"]', ["record.fields", "displacement"]),
    ("muscle", ["key=value"]),
]


@pytest.mark.parametrize(("setting", "words"), SETTINGS, ids=[setting for setting, _ in SETTINGS])
def test_bad_settings(setting: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _refused(["run", str(VOWEL), "--out", str(tmp_path / "out"), *SMALL, "--set", setting], words, capsys)
    assert not list(tmp_path.rglob("*.vtkhdf")), "a refused run must leave no file"


def test_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "mine.toml"
    scenario.write_text(VOWEL.read_text().replace("force_N = 1.33", "force_n = 1.33"))
    _refused(["run", str(scenario)], ["mine.toml", "force_n", 'did you mean "force_N"?'], capsys)
    scenario.write_text("title = ")
    _refused(["check", str(scenario)], ["mine.toml", "not valid TOML"], capsys)
    _refused(["check", str(tmp_path / "none.toml")], ["none.toml", "cannot be read"], capsys)
    stored = tmp_path / "stored.json"
    stored.write_text("{")
    _refused(["check", str(stored)], ["stored.json", "not valid JSON"], capsys)
    stored.write_text("[1]")
    _refused(["check", str(stored)], ["stored.json: the scenario = [1] is not possible"], capsys)


def test_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("not a folder")
    _refused(["run", str(VOWEL), "--out", str(tmp_path / "file" / "out"), *SMALL], ["cannot write", "--out"], capsys)


def test_existing_result_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", str(VOWEL), "--out", str(tmp_path), *SMALL]
    assert command(arguments) == 0
    result = tmp_path / "vowel-i.vtkhdf"
    before = result.read_bytes()
    _refused(arguments, ["vowel-i.vtkhdf", "exists", "--overwrite"], capsys)
    assert result.read_bytes() == before
    assert command([*arguments, "--overwrite", "--set", "muscle.GGp.force_N=1"]) == 0
    assert result.read_bytes() != before


def test_refused_run_keeps_the_old_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", str(VOWEL), "--out", str(tmp_path), *SMALL]
    assert command(arguments) == 0
    before = (tmp_path / "vowel-i.vtkhdf").read_bytes()
    _refused([*arguments, "--overwrite", "--set", "analysis.step_us=100000"], ["unstable"], capsys)
    assert (tmp_path / "vowel-i.vtkhdf").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["vowel-i.vtkhdf"]


# ---- meshes of one's own ----


def _own_mesh(folder: Path, points: np.ndarray, cells: list, **tables: object) -> Path:
    """A scenario on a mesh file with its model file; ``tables`` are appended to the model file."""
    meshio.write(folder / "block.vtu", meshio.Mesh(points, cells))
    lines = ['mesh = "block.vtu"', 'length_unit = "m"']
    for key, value in tables.items():
        inline = "{ " + ", ".join(f"{k} = {v}" for k, v in value.items()) + " }" if isinstance(value, dict) else json.dumps(value)
        lines.append(f"{key} = {inline}")
    (folder / "block.toml").write_text("\n".join(lines) + "\n")
    scenario = folder / "own.toml"
    scenario.write_text('title = "own"\n[model]\nfile = "block.toml"\n[analysis]\nduration_ms = 1.0\n')
    return scenario


def _add_muscles(folder: Path, *muscles: dict) -> None:
    """Append [[muscle]] tables to the model file in a folder."""
    with (folder / "block.toml").open("a") as file:
        for muscle in muscles:
            file.write(f"[[muscle]]\nname = {json.dumps(muscle['name'])}\n")
            for fibre in muscle["fibre"]:
                file.write("[[muscle.fibre]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in fibre.items()))


def test_own_mesh_runs(tmp_path: Path) -> None:
    mesh = block_mesh((3, 2, 2), 0.01)
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)], named_points={"corner": 0})
    assert command(["run", str(scenario), "--out", str(tmp_path)]) == 0


def test_inverted_element(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((3, 2, 2), 0.01, distort=0.0)
    points = mesh.points.copy()
    node = int(mesh.hexes[4, 6])
    points[node] -= 1.5 * (points[node] - points[mesh.hexes[4, 0]])
    scenario = _own_mesh(tmp_path, points, [("hexahedron", mesh.hexes)])
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["element", "corner", "node", "inverted"], capsys)


def test_zero_volume_element(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((3, 2, 2), 0.01, distort=0.0)
    hexes = mesh.hexes.copy()
    hexes[7, 4:] = hexes[7, :4]
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", hexes)])
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["element 7", "corner"], capsys)


def test_mesh_with_tets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((3, 2, 2), 0.01)
    cells = [("hexahedron", mesh.hexes), ("tetra", mesh.hexes[:2, [0, 1, 3, 4]])]
    scenario = _own_mesh(tmp_path, mesh.points, cells)
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["block.vtu", "2 tetra", "hex"], capsys)


def test_node_that_is_not_finite(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((3, 2, 2), 0.01)
    points = mesh.points.copy()
    points[5, 1] = np.nan
    scenario = _own_mesh(tmp_path, points, [("hexahedron", mesh.hexes)])
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["node 5", "finite"], capsys)


def test_everything_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((2, 1, 1), 0.01)
    everything = list(range(mesh.node_count))
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)], fixed=["all"], node_sets={"all": everything})
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["own.toml", "model.fixed", "every node"], capsys)


def test_model_file_with_mistakes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((3, 2, 2), 0.01)
    cells = [("hexahedron", mesh.hexes)]
    run = ["run", str(tmp_path / "own.toml"), "--out", str(tmp_path)]
    _own_mesh(tmp_path, mesh.points, cells, named_points={"far": 9999})
    _refused(run, ["block.toml", "9999", "named_points.far"], capsys)
    _own_mesh(tmp_path, mesh.points, cells, fixed=["base"], node_sets={"bases": [0, 1]})
    _refused(run, ["block.toml", "base", 'did you mean "bases"?'], capsys)
    _own_mesh(tmp_path, mesh.points, cells, lenght_unit="mm")
    _refused(run, ["block.toml", "lenght_unit", 'did you mean "length_unit"?'], capsys)


_TOP = {"name": "TOP"}
_LEFT = {"side": "left", "nodes": [0, 9, 18]}
# The mesh has the nodes 0, 1, 2 at x = y = 0, and lengths in m.
FILES = [
    ("the same node twice", {"fibre": [_LEFT, {"side": "right", "nodes": [0, 9, 9]}]}, ["fibre 2 of muscle TOP", "position"]),
    ("the same point twice", {"fibre": [{"side": "left", "points": [[0, 0, 0], [0, 0, 0], [0, 0, 0.02]]}]},
     ["fibre 1 of muscle TOP", "same position"]),
    ("anchor at the first point", {"fibre": [{"side": "left", "anchor": [0, 0, 0], "points": [[0, 0, 0]]}]},
     ["fibre 1 of muscle TOP", "same position"]),
    ("a fibre that leaves the mesh", {"fibre": [_LEFT, {"side": "right", "points": [[0, 0, 0], [0, 0, 0.2]]}]},
     ["fibre 2 of muscle TOP", "outside the mesh"]),
    ("a node that no element has", {"fibre": [{"side": "left", "nodes": [0, 999]}]}, ["fibre 1 of muscle TOP", "999"]),
    ("a fibre of one node", {"fibre": [_LEFT, {"side": "left", "nodes": [3]}]}, ["muscle.TOP.fibre 2", "two points"]),
    ("a tension at two of three nodes", {"fibre": [{**_LEFT, "tension": [1.0, 2.0]}]},
     ["muscle.TOP.fibre 1", "tension needs a value for each of the 3 points, not 2"]),
    ("a tension of nothing", {"fibre": [{**_LEFT, "tension": [0.0, 0.0, 0.0]}]}, ["muscle.TOP.fibre 1", "tension is 0 at every"]),
    ("an anchor of two numbers", {"fibre": [{**_LEFT, "anchor": [0, 0]}]}, ["anchor: must be three numbers [x, y, z]"]),
]  # fmt: skip


@pytest.mark.parametrize(("muscle", "words"), [case[1:] for case in FILES], ids=[case[0] for case in FILES])
def test_fibres_that_cannot_be(muscle: dict, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((2, 2, 2), 0.01, distort=0.0)
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)])
    _add_muscles(tmp_path, _TOP | muscle)
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["block.toml", *words], capsys)


def test_fibre_whose_middle_lies_outside_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its nodes lie in two cubes, and the piece between them in neither."""
    mesh = block_mesh((1, 1, 1), 0.01, distort=0.0)
    points = np.concatenate([mesh.points, mesh.points + [0.1, 0.0, 0.0]])
    scenario = _own_mesh(tmp_path, points, [("hexahedron", np.concatenate([mesh.hexes, mesh.hexes + 8]))])
    _add_muscles(tmp_path, _TOP | {"fibre": [{"side": "left", "nodes": [0, 8]}]})
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["block.toml", "fibre 1 of muscle TOP", "outside"], capsys)


def test_muscles_of_a_model_file_have_names_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((2, 2, 2), 0.01)
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)])
    _add_muscles(tmp_path, _TOP | {"fibre": [_LEFT]}, _TOP | {"fibre": [_LEFT]})
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["block.toml", "2 muscles have the name TOP"], capsys)


def test_fibre_that_ends_where_it_begins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A ring has no chord to pull along; with another distribution it runs."""
    mesh = block_mesh((2, 2, 2), 0.01, distort=0.0)
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)])
    _add_muscles(tmp_path, _TOP | {"fibre": [{"side": "left", "nodes": [0, 9, 12, 3, 0]}]})
    pulling = ["run", str(scenario), "--out", str(tmp_path), "--set"]
    _refused([*pulling, 'muscle=[{name="TOP", force_N=1e-4}]'], ["fibre 1 of muscle TOP", 'distribution = "along"'], capsys)
    assert command([*pulling, 'muscle=[{name="TOP", force_N=1e-4, distribution="along"}]']) == 0


@pytest.mark.parametrize("name", ["left/right", "", " ", "."])
@pytest.mark.parametrize("key", ["node_sets", "named_points"])
def test_names_that_a_result_cannot_hold(key: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((2, 2, 2), 0.01)
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)])
    with (tmp_path / "block.toml").open("a") as file:
        file.write(f'[{key}]\n"{name}" = {[0, 1] if key == "node_sets" else 0}\n')
    _refused(["run", str(scenario), "--out", str(tmp_path)], ["block.toml", key, f'"{name}" cannot be a name'], capsys)


@pytest.mark.parametrize("entry", ["abc", {"point_data": '"wall"'}, [0, "1"], 3])
def test_node_sets_that_are_none(entry: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((2, 2, 2), 0.01)
    _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)])
    value = "{ point_data = 'wall' }" if isinstance(entry, dict) else json.dumps(entry)
    with (tmp_path / "block.toml").open("a") as file:
        file.write(f"[node_sets]\nx = {value}\n")
    words = ["block.toml", 'node_sets.x: must be a list of node numbers, { point_data = "...", value = ... } or { cell_data']
    _refused(["check", str(tmp_path / "own.toml")], words, capsys)


def test_model_file_is_strict_about_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = block_mesh((2, 2, 2), 0.01)
    scenario = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)], named_points={"a": '"1"'})
    _refused(["check", str(scenario)], ["block.toml", "named_points.a", "integer"], capsys)


def test_setting_the_source_of_a_model_replaces_the_other(tmp_path: Path) -> None:
    """model.file takes the place of name, resolution and cells, and model.name that of file."""
    mesh = block_mesh((2, 2, 2), 0.01)
    own = _own_mesh(tmp_path, mesh.points, [("hexahedron", mesh.hexes)])
    settings = [f"model.file={tmp_path / 'block.toml'}", "muscle=[]", "analysis.duration_ms=1"]
    for name in ("resolution", "cells"):
        built_in = tmp_path / f"{name}.toml"
        value = '"coarse"' if name == "resolution" else "[8, 4, 4]"
        built_in.write_text(VOWEL.read_text().replace('resolution = "medium"', f"{name} = {value}"))
        scenario, _ = read_scenario(built_in, settings)
        assert scenario.model.file and (scenario.model.name, scenario.model.resolution, scenario.model.cells) == (None,) * 3
    scenario, _ = read_scenario(own, ["model.name=tongue", "model.resolution=coarse"])
    assert (scenario.model.name, scenario.model.file) == ("tongue", None)


def test_whole_numbers_and_arrays_are_numbers_and_tuples() -> None:
    """Strictness is for text: 2 is a number of newtons, an array a vector."""
    scenario, _ = read_scenario(
        VOWEL, ["muscle.GGp.force_N=2", "model.gravity_m_s2=[0, 0, -9.81]", "model.material={C10_Pa=1, C20_Pa=0}"]
    )
    assert scenario.muscle[0].force_N == 2.0 and scenario.model.gravity_m_s2 == (0.0, 0.0, -9.81)
    assert scenario.model.material.C10_Pa == 1.0


def test_material_names_of_two_models_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for model in ("one", "two"):
        (tmp_path / model).mkdir()
        (tmp_path / model / "materials.toml").write_text('[soft]\nlaw = "neo-hooke"\nC10_Pa = 100.0\n')
    monkeypatch.setattr(catalogue, "folder_of", lambda kind: tmp_path)
    with pytest.raises(InputError, match=r'two.*one.*also has a material "soft"'):
        catalogue.materials.__wrapped__()


def test_nearest_lists_what_is_valid_when_nothing_is_near() -> None:
    assert nearest("xyz", ["GGa", "SL"]) == "valid are: GGa, SL."
    assert nearest("gga", ["GGa", "SL"]) == 'did you mean "GGa"?'
    assert nearest("gga", []) == "there is none."
    assert nearest("x", [f"point {k}" for k in range(30)]).endswith("and 10 more.")


def _refused(arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """The command ends with 2 and one sentence that holds the words; nothing is printed on stdout."""
    capsys.readouterr()
    code = command(arguments)
    captured = capsys.readouterr()
    # Progress lines may stand before it; the sentence is the last line.
    lines = [line for line in captured.err.splitlines() if line.strip()]
    assert code == 2, captured.err
    assert captured.out == ""
    assert lines[-1].startswith("error: ")
    for word in words:
        assert word in lines[-1], f"{word!r} not in: {lines[-1]}"
    assert "Traceback" not in captured.err
