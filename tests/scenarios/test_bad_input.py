"""Bad input of every kind gives one clear sentence on stderr and exit code 2, and leaves nothing behind."""

from __future__ import annotations

import json
from pathlib import Path

import meshio
import numpy as np
import pytest
from command import command
from support import block_mesh

from explicitfe.errors import nearest

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
    ("muscle.GGp.end_ms=0", ["muscle.GGp", "end_ms must come after"]),
    ("muscle.GGx.force_N=1", ["GGx", 'did you mean "GGp"?']),
    ("analysis.duration_ms=0", ["analysis.duration_ms", "greater than 0"]),
    ("analysis.duration_ms=long", ["analysis.duration_ms", "number"]),
    ("analysis.step_us=100000", ["analysis.step_us", "unstable", "largest stable step", "element"]),
    ("model.material=gerard-2006", ["gerard-2006", 'did you mean "gerard-2005"?']),
    ("model.material={C10_Pa=191.5}", ["C20_Pa", "missing"]),
    ("model.material={C10_Pa=191.5, C20_Pa=90.6, poisson=0.5}", ["poisson", "0.5", "less than 0.5"]),
    ('model.material={law="ogden", C10_Pa=1.0}', ["unknown law", "yeoh"]),
    ("model.name=tounge", ["tounge", 'did you mean "tongue"?']),
    ("model.resolution=corse", ["corse", 'did you mean "coarse"?']),
    ("model.cells=[8, 4, 5]", ["cells", "even"]),
    ('model.fixed=["jaws"]', ["jaws", 'did you mean "jaw"?']),
    ('record.probes=["tipp"]', ["tipp", 'did you mean "tip"?']),
    ('record.fields=["stress"]', ["record.fields", "displacement"]),
    ("muscle", ["key=value"]),
]


@pytest.mark.parametrize(("setting", "words"), SETTINGS, ids=[setting for setting, _ in SETTINGS])
def test_bad_settings(setting: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _refused(["run", str(VOWEL), "--out", str(tmp_path / "out"), *SMALL, "--set", setting], words, capsys)
    assert not list(tmp_path.rglob("*.vtkhdf")), "a refused run must leave no file"


def test_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "mine.toml"
    scenario.write_text(VOWEL.read_text().replace("force_N = 2.0", "force_n = 2.0"))
    _refused(["run", str(scenario)], ["mine.toml", "force_n", 'did you mean "force_N"?'], capsys)
    scenario.write_text("title = ")
    _refused(["check", str(scenario)], ["mine.toml", "not valid TOML"], capsys)
    _refused(["check", str(tmp_path / "none.toml")], ["none.toml", "cannot be read"], capsys)


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


def test_nearest_lists_what_is_valid_when_nothing_is_near() -> None:
    assert nearest("xyz", ["GGa", "SL"]) == "valid are: GGa, SL."
    assert nearest("gga", ["GGa", "SL"]) == 'did you mean "GGa"?'


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
