"""What is exported is what the result holds: read back by the programs that it is written for, or their readers in Python."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import scipy
import tiny_result
from answers import check_answer
from command import command

from explicitfe.platform.errors import InputError
from explicitfe.results.files import FINISHED, Quantity, open_result
from explicitfe.results.files.export.export import FORMATS, export

STEPS = 4
TIP = tiny_result.MESH.named_points["tip"].position[0]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two hexes, four samples, whose tip has the velocity (1, 2, 3) m/s times the number of the sample."""
    path = tmp_path_factory.mktemp("export") / "run.vtkhdf"
    history = tiny_result.HISTORY | {"probe_tip_velocity": Quantity("m/s", 3)}
    with tiny_result.start(path, history=history, model={"probes": {"tip": {}}, "scenario": {"title": "two"}}) as writer:
        for step in range(STEPS):
            u = tiny_result.displacement(step)
            row = {
                "kinetic_energy": step + 0.5,
                "probe_tip_displacement": u[11],
                "probe_tip_velocity": step * np.array([1.0, 2.0, 3.0]),
            }
            cells = {"J": tiny_result.jacobian(step), "hourglass_energy": -tiny_result.jacobian(step)}
            writer.sample(1e-3 * step, row, {"displacement": u, "velocity": -u}, cells)
        writer.finish(FINISHED, "", {})
    return path


def exported(result: Path, folder: Path, to: str, **options) -> Path:
    (file,) = export(result, [to], folder, **options)["files"]
    assert file["bytes"] == Path(file["file"]).stat().st_size
    return Path(file["file"])


def table(path: Path) -> dict[str, np.ndarray]:
    rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_a_table_has_the_columns_of_a_sensor(result: Path, tmp_path: Path) -> None:
    """Forward is -x, up is z, right is y, in mm, mm/s and ms."""
    columns = table(exported(result, tmp_path, "csv"))
    moved = np.array([tiny_result.displacement(step)[11] for step in range(STEPS)])
    assert list(columns) == [
        "time_ms",
        *(f"tip_{direction}_mm" for direction in ("forward", "up", "right")),
        *(f"tip_velocity_{direction}_mm_s" for direction in ("forward", "up", "right")),
        "tip_speed_mm_s",
    ]
    np.testing.assert_allclose(columns["time_ms"], np.arange(STEPS))
    np.testing.assert_allclose(columns["tip_forward_mm"], -1e3 * moved[:, 0], rtol=1e-8)
    np.testing.assert_allclose(columns["tip_up_mm"], 1e3 * moved[:, 2], rtol=1e-8)
    np.testing.assert_allclose(columns["tip_right_mm"], 1e3 * moved[:, 1], rtol=1e-8)
    np.testing.assert_allclose(columns["tip_velocity_forward_mm_s"], -1e3 * np.arange(STEPS))
    np.testing.assert_allclose(columns["tip_velocity_up_mm_s"], 3e3 * np.arange(STEPS))
    np.testing.assert_allclose(columns["tip_speed_mm_s"], 1e3 * np.sqrt(14.0) * np.arange(STEPS), rtol=1e-8)


def test_positions_are_those_of_rest_and_what_was_moved(result: Path, tmp_path: Path) -> None:
    moved, placed = (table(exported(result, tmp_path / str(places), "csv", positions=places)) for places in (False, True))
    for direction, at_rest in (("forward", -TIP[0]), ("up", TIP[2]), ("right", TIP[1])):
        np.testing.assert_allclose(placed[f"tip_{direction}_mm"] - moved[f"tip_{direction}_mm"], 1e3 * at_rest, atol=1e-5)
    np.testing.assert_array_equal(placed["tip_speed_mm_s"], moved["tip_speed_mm_s"])


def test_without_stored_velocities_they_are_differences(tmp_path: Path) -> None:
    path = tiny_result.write(tmp_path / "run.vtkhdf", STEPS, model={"probes": {"tip": {}}})
    columns = table(exported(path, tmp_path, "csv"))
    np.testing.assert_allclose(columns["tip_velocity_up_mm_s"], np.gradient(columns["tip_up_mm"], 1e-3), rtol=1e-6)


def test_parquet_has_the_same_columns_and_the_history_if_asked(result: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    columns = parquet.read_table(exported(result, tmp_path, "parquet", history=True))
    assert columns["kinetic_energy_J"].to_pylist() == [0.5, 1.5, 2.5, 3.5]
    assert set(columns.column_names) - {"kinetic_energy_J"} == set(table(exported(result, tmp_path, "csv")))


def test_an_indentation_is_its_curve(tmp_path: Path) -> None:
    history = {"force": Quantity("N"), "indentation": Quantity("m"), "smallest_J": Quantity("1"), "touch": Quantity("m^2")}
    model = {"scenario": {"analysis": {"type": "relaxation"}}}
    path = tmp_path / "punch.vtkhdf"
    with tiny_result.start(path, history=history, model=model, point_fields={}, cell_fields={}) as writer:
        for step in range(2):
            row = {"force": 0.1 * step, "indentation": 2e-3 * step, "smallest_J": 1.0, "touch": 1e-6 * step}
            writer.sample(float(step), row, {"displacement": tiny_result.displacement(step)}, {})
        writer.finish(FINISHED, "", {})
    columns = table(exported(path, tmp_path, "csv"))
    assert {name: values[-1] for name, values in columns.items()} == {
        "time_ms": 1000.0,
        "force_N": 0.1,
        "indentation_mm": 2.0,
        "smallest_J": 1.0,
        "touch_mm2": 1.0,
    }


def test_arrays_are_the_stored_ones(result: Path, tmp_path: Path) -> None:
    displacement = np.array([tiny_result.displacement(step) for step in range(STEPS)])
    with np.load(exported(result, tmp_path, "npz"), allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["field_displacement"], displacement)
        np.testing.assert_array_equal(arrays["hexes"], tiny_result.MESH.hexes)
        np.testing.assert_array_equal(arrays["history_kinetic_energy"], np.arange(STEPS) + 0.5)
        assert json.loads(str(arrays["units"]))["fields"]["velocity"] == "m/s"
        assert json.loads(str(arrays["model"]))["scenario"]["title"] == "two"
    read = scipy.io.loadmat(exported(result, tmp_path, "mat"), simplify_cells=True)["result"]
    np.testing.assert_array_equal(read["fields"]["displacement"], displacement)
    np.testing.assert_array_equal(read["hexes"], tiny_result.MESH.hexes + 1)  # MATLAB counts from 1
    np.testing.assert_array_equal(read["node_sets"]["jaw"], np.array([0, 3, 6, 9]) + 1)
    assert read["units"]["history"]["kinetic_energy"] == "J"


def test_names_are_made_fit_for_matlab(tmp_path: Path) -> None:
    names = ["1st field", "a field", "a-field", "ü" * 3, "long" * 30, "long" * 31]
    fields = {name: Quantity("J") for name in names}
    path = tmp_path / "run.vtkhdf"
    with tiny_result.start(path, point_fields={}, cell_fields=fields) as writer:
        row = {"kinetic_energy": 0.0, "probe_tip_displacement": np.zeros(3)}
        cells = {name: np.full(2, float(number)) for number, name in enumerate(names)}
        writer.sample(0.0, row, {"displacement": tiny_result.displacement(0)}, cells)
        writer.finish(FINISHED, "", {})
    read = scipy.io.loadmat(exported(path, tmp_path, "mat"), simplify_cells=True)["result"]["fields"]
    assert sorted(float(np.ravel(read[name])[0]) for name in read if name != "displacement") == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert all(name.isidentifier() and name.isascii() and len(name) <= 63 for name in read)


def test_a_grid_and_a_surface_at_a_time(result: Path, tmp_path: Path) -> None:
    import meshio

    grid = meshio.read(exported(result, tmp_path, "vtu", time_s=0.0021))
    np.testing.assert_array_equal(grid.points, tiny_result.MESH.points)
    np.testing.assert_array_equal(grid.point_data["displacement"], tiny_result.displacement(2))
    np.testing.assert_array_equal(grid.cell_data["J"][0], tiny_result.jacobian(2))
    surface = meshio.read(exported(result, tmp_path, "stl", time_s=0.0))
    corners = np.asarray(surface.points, dtype=float)[surface.cells_dict["triangle"]]
    assert len(corners) == 4 * 10  # two hexes in a row have ten free faces, of four triangles each
    moved = 1e3 * (tiny_result.MESH.points + tiny_result.displacement(0))
    assert {tuple(np.round(point, 2)) for point in moved} <= {tuple(np.round(point, 2)) for point in corners.reshape(-1, 3)}


def test_an_undeformed_surface_is_closed_and_has_the_volume_of_the_body(tmp_path: Path) -> None:
    """By the divergence theorem, of triangles whose normals point outwards: 10 x 10 x 20 mm."""
    import meshio

    path = tmp_path / "run.vtkhdf"
    with tiny_result.start(path, point_fields={}, cell_fields={}) as writer:
        zero = np.zeros((tiny_result.N, 3))
        writer.sample(0.0, {"kinetic_energy": 0.0, "probe_tip_displacement": np.zeros(3)}, {"displacement": zero}, {})
        writer.finish(FINISHED, "", {})
    surface = meshio.read(exported(path, tmp_path, "stl"))
    a, b, c = np.moveaxis(np.asarray(surface.points, dtype=float)[surface.cells_dict["triangle"]], 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(2000.0, rel=1e-6)


def test_nothing_is_replaced_and_nothing_half_written(result: Path, tmp_path: Path) -> None:
    target = tmp_path / "run.csv"
    target.write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"run\.csv exists; add `overwrite`"):
        export(result, ["npz", "csv"], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"] and target.read_text(encoding="utf-8") == "mine"
    export(result, ["csv"], tmp_path, overwrite=True)
    assert target.read_text(encoding="utf-8").startswith("time_ms,tip_forward_mm")
    (tmp_path / "run.stl").symlink_to(target)
    with pytest.raises(InputError, match=r"run\.stl is a symbolic link and is not replaced"):
        export(result, ["stl"], tmp_path, overwrite=True)
    with pytest.raises(InputError, match=r'unknown format; did you mean "csv"'):
        export(result, ["cvs"], tmp_path)
    with pytest.raises(InputError, match="has no time"):
        export(result, ["vtu"], tmp_path, time_s=1.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "run.stl"]


def test_the_command_names_its_files(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / ("a-long-name-" * 12)
    words = ["export", str(result), "--to", "csv", "--to", "stl", "--at-ms", "1", "--out", str(folder)]
    assert command([*words, "--json"]) == 0
    answer = check_answer("export", capsys.readouterr().out)
    assert [file["format"] for file in answer["files"]] == ["csv", "stl"]
    assert command([*words, "--overwrite"]) == 0
    assert str(folder / "run.csv") in capsys.readouterr().out  # on one line, so that it can be copied
    assert command(["export", str(result), "--to", "docx"]) == 2
    assert ", ".join(sorted(FORMATS)) in capsys.readouterr().err


def test_every_format_is_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["export", "--help"]) == 0
    assert set(FORMATS) <= set(re.findall(r"\w+", capsys.readouterr().out))


def test_the_probe_of_a_result_agrees_with_its_table(result: Path, tmp_path: Path) -> None:
    columns = table(exported(result, tmp_path, "csv"))
    with open_result(result) as opened:
        np.testing.assert_allclose(columns["tip_up_mm"], 1e3 * opened.probe("tip")[:, 2], rtol=1e-8)


@pytest.mark.parametrize("refused", [0, 1])
def test_a_full_disk_leaves_no_exported_file(
    refused: int, result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The disk is full when the first, or only when the second file is written: exit code 3, a sentence, and no file."""
    real, opened = os.fdopen, []

    class Full(io.FileIO):
        def write(self, data: object) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def open_number(number: int, *more: object, **options: object) -> object:
        opened.append(number)
        return Full(number, "wb") if len(opened) == refused + 1 else real(number, *more, **options)

    monkeypatch.setattr("explicitfe.results.files.folder.os.fdopen", open_number)
    assert command(["export", str(result), "--to", "csv", "--to", "npz", "--out", str(tmp_path / "new")]) == 3
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert sentence.startswith("failed: cannot write ") and "(No space left on device); free disk space" in sentence
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_no_folder_for_exports(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not even with --overwrite, and the advice is not to add `overwrite`."""
    (tmp_path / "table.csv").write_text("mine", encoding="utf-8")
    words = ["export", str(result), "--to", "csv", "--out", str(tmp_path / "table.csv"), "--overwrite"]
    assert command(words) == 2
    assert "table.csv is a file; give a folder" in capsys.readouterr().err.splitlines()[-1]
    assert (tmp_path / "table.csv").read_text(encoding="utf-8") == "mine"
