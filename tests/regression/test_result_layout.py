"""The result file: its layout, its readers, what the writer refuses."""

from __future__ import annotations

import json
from dataclasses import fields
from zlib import crc32

import h5py
import numpy as np
import pytest
from support import ROOT
from tiny_result import HISTORY, MESH, SCENARIO, E, N, add, check_steps, displacement, jacobian, python, start, write

from explicitfe.fem.mesh.hexmesh import MaterialPoints
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.platform.errors import InputError
from explicitfe.results.documents import run_summary
from explicitfe.results.files import FAILED, FINISHED, Quantity, layout, open_result, provenance

M3 = Quantity("m", 3)


# Layout and readers


def test_bones_are_stored_at_rest_and_placed_by_the_history(tmp_path):
    tetrahedron = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    bones = {"palate": (tetrahedron + 0.1, triangles), "jaw": (tetrahedron, triangles)}
    placement = {"bone_jaw_placement": Quantity("1", 12, "rotation, row by row, and shift in m")}
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # by 90 degrees about y
    with start(tmp_path / "a.vtkhdf", bones=bones, history=placement, restart=None) as result:
        for step, rotation in enumerate((np.eye(3), turned)):
            shift = 0.001 * step * np.array([1.0, 2.0, 3.0])
            row = {"bone_jaw_placement": np.concatenate([rotation.ravel(), shift])}
            fields = {"displacement": displacement(step), "velocity": displacement(step)}
            result.sample(1e-3 * step, row, fields, {"J": jacobian(step), "hourglass_energy": jacobian(step)})
        path = result.finish(FINISHED, "", {})
    with open_result(path) as opened:
        assert set(opened.bones) == {"palate", "jaw"}
        for name, (points, corners) in bones.items():
            np.testing.assert_array_equal(opened.bones[name].points, points)
            np.testing.assert_array_equal(opened.bones[name].triangles, corners)
            np.testing.assert_array_equal(opened.placed_bones(0)[name].points, points)
        rotation, shift = opened.placement("jaw")
        np.testing.assert_array_equal(rotation, turned)
        np.testing.assert_array_equal(shift, [0.001, 0.002, 0.003])
        now = opened.placed_bones(time_s=0.0009)
        np.testing.assert_array_equal(now["palate"].points, bones["palate"][0])
        # A quarter turn about y takes x to -z and z to x.
        np.testing.assert_allclose(now["jaw"].points, tetrahedron[:, [2, 1, 0]] * [1, 1, -1] + [0.001, 0.002, 0.003], atol=1e-17)
    with open_result(write(tmp_path / "none.vtkhdf", 1)) as opened:
        assert opened.bones == opened.placed_bones() == {}


def test_fibres_are_stored_muscle_by_muscle(tmp_path):
    anchored = MaterialPoints(
        np.array([-1, 0]), np.array([[0.0] * 3, [0.5, 0.0, -0.5]]), np.array([[0.1] * 3, [0.0075, 0.005, 0.0025]])
    )
    across = MESH.points_in(np.array([0, 1, 1]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    muscles = {"muscles": [{"name": "A"}, {"name": "B"}, {"name": "C"}]}
    path = write(tmp_path / "a.vtkhdf", 2, model=muscles, fibres=[[anchored, across], [], [across]])
    with open_result(path) as opened:
        assert [len(lines) for lines in opened.fibres] == [2, 0, 1]
        for stored, given in zip([*opened.fibres[0], *opened.fibres[2]], [anchored, across, across], strict=True):
            for name in ("element", "natural", "position"):
                np.testing.assert_array_equal(getattr(stored, name), getattr(given, name))
    with open_result(write(tmp_path / "none.vtkhdf", 1, model=muscles)) as opened:
        assert opened.fibres == [[], [], []]
    with h5py.File(path, "r+") as file:
        element = file["explicitfe/fibres/0/element"]
        element[0] = 2  # of the elements 0 and 1
        element.attrs["crc32"] = np.uint32(crc32(element[()].tobytes()))
    with open_result(path) as opened, pytest.raises(InputError, match=r"fibres/0 are no fibres"):
        _ = opened.fibres


def test_layout_is_the_vtkhdf_that_all_versions_read(tmp_path):
    with h5py.File(write(tmp_path / "a.vtkhdf", 7)) as file:
        vtk = file["VTKHDF"]
        kind = h5py.h5a.open(vtk.id, b"Type").get_type()
        assert not kind.is_variable_str()
        assert kind.get_cset() == h5py.h5t.CSET_ASCII
        assert vtk.attrs["Type"] == b"UnstructuredGrid"
        assert list(vtk.attrs["Version"]) == [2, 0]
        for name, value in (("NumberOfPoints", N), ("NumberOfCells", E), ("NumberOfConnectivityIds", 8 * E)):
            assert vtk[name].dtype.kind == "i"
            assert list(vtk[name]) == [value]
        assert vtk["Types"].dtype == np.uint8
        assert list(vtk["Types"]) == [12] * E
        assert vtk["Connectivity"].dtype == vtk["Offsets"].dtype == np.int64
        np.testing.assert_array_equal(vtk["Connectivity"], MESH.hexes.ravel())
        np.testing.assert_array_equal(vtk["Offsets"], [0, 8, 16])
        np.testing.assert_array_equal(vtk["Points"], MESH.points)

        steps = vtk["Steps"]
        assert steps.attrs["NSteps"] == 7
        np.testing.assert_array_equal(steps["Values"], 1e-3 * np.arange(7))
        np.testing.assert_array_equal(steps["NumberOfParts"], np.ones(7))
        for name in ("PartOffsets", "PointOffsets"):
            np.testing.assert_array_equal(steps[name], np.zeros(7))
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            np.testing.assert_array_equal(steps[name], np.zeros((7, 1)))
        for data, names, count in (
            ("PointData", {"displacement", "velocity"}, N),
            ("CellData", {"J", "hourglass_energy"}, E),
        ):
            assert set(vtk[data]) == set(steps[f"{data}Offsets"]) == names
            for name in names:
                np.testing.assert_array_equal(steps[f"{data}Offsets"][name], count * np.arange(7))
                assert vtk[data][name].dtype == np.float64
                assert len(vtk[data][name]) == 7 * count
        assert vtk["PointData/displacement"].shape == (7 * N, 3)
        assert vtk["CellData/J"].shape == (7 * E,)
        assert vtk["PointData/displacement"].attrs["unit"] == b"m"

        own = file["explicitfe"]
        assert own["scenario"].asstr()[()] == SCENARIO
        assert json.loads(own["model"][()]) == {"density": 1040.0}
        assert own["history/kinetic_energy"].attrs["unit"] == b"J"
        assert own["history/kinetic_energy"].attrs["description"] == b"of all nodes"
        assert own["history/probe_tip_displacement"].shape == (7, 3)


def test_h5py_pyvista_and_the_reader_agree_bitwise(tmp_path):
    # 40 steps: three chunks and several lengthenings.
    path = write(tmp_path / "a.vtkhdf", 40)
    with open_result(path) as result, h5py.File(path) as file:
        for step in (0, 17, 39):
            grid = result.mesh_at(time_s=1e-3 * step)
            assert grid.n_points == N
            assert grid.n_cells == E
            np.testing.assert_array_equal(grid.points, MESH.points)
            np.testing.assert_array_equal(grid.cells_dict[12], MESH.hexes)
            for name, count in (("displacement", N), ("velocity", N)):
                stored = file["VTKHDF/PointData"][name][step * count : (step + 1) * count]
                np.testing.assert_array_equal(grid.point_data[name], stored)
                np.testing.assert_array_equal(result.field(name, step), stored)
            for name in ("J", "hourglass_energy"):
                stored = file["VTKHDF/CellData"][name][step * E : (step + 1) * E]
                np.testing.assert_array_equal(grid.cell_data[name], stored)
                np.testing.assert_array_equal(result.field(name, step), stored)
            warped = result.mesh_at(step, warped=True)
            np.testing.assert_array_equal(warped.points, MESH.points + displacement(step))
        check_steps(result, 40)


def test_the_reader_gives_back_what_was_written(tmp_path):
    with start(tmp_path / "a.vtkhdf") as run:
        for step in (0, 1000, 2000):
            run.sample(
                step,
                {"kinetic_energy": -step, "probe_tip_displacement": [step, 0, 1]},
                {"displacement": displacement(step), "velocity": displacement(step)},
                {"J": jacobian(step), "hourglass_energy": jacobian(step)},
            )
        run.finish(FAILED, "element 3 turned inside out: größer machen", {"steps": np.int64(3), "peak": np.array([1.5])})
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert (result.status, result.message) == ("failed", "element 3 turned inside out: größer machen")
        assert result.summary == {"steps": 3, "peak": [1.5]}
        assert result.scenario_text == SCENARIO
        assert result.model == {"density": 1040.0}
        assert result.provenance == {"explicitfe": "test"}
        assert not result.live
        np.testing.assert_array_equal(result.mesh.points, MESH.points)
        np.testing.assert_array_equal(result.mesh.hexes, MESH.hexes)
        np.testing.assert_array_equal(result.mesh.node_sets["jaw"], MESH.node_sets["jaw"])
        named = result.mesh.named_points
        assert set(named) == {"tip", "inside"}
        for name, point in MESH.named_points.items():
            for part in ("element", "natural", "position"):
                np.testing.assert_array_equal(getattr(named[name], part), getattr(point, part))
            assert named[name].element.dtype == np.int64
        inside = [MESH.at(MESH.named_points["inside"], displacement(row))[0] for row in (0, 1000, 2000)]
        np.testing.assert_allclose(result.probe("inside"), inside, rtol=0.0, atol=1e-15)
        np.testing.assert_array_equal(result.probe("tip"), [displacement(row)[11] for row in (0, 1000, 2000)])
        np.testing.assert_array_equal(result.history("time"), [0.0, 1000.0, 2000.0])
        np.testing.assert_array_equal(result.history("kinetic_energy"), [0.0, -1000.0, -2000.0])
        np.testing.assert_array_equal(result.history("probe_tip_displacement")[:, 0], [0.0, 1000.0, 2000.0])
        assert result.history_names["kinetic_energy"] == HISTORY["kinetic_energy"]
        assert result.fields["displacement"].kind == "point"
        assert result.fields["J"] == ("cell", Quantity("1"))
        # 1400 s lies nearest to the sample at 1000 s.
        np.testing.assert_array_equal(result.displacement(time_s=1400.0), displacement(1000))
        np.testing.assert_array_equal(result.displacement(-2), displacement(1000))
        progress = json.loads(json.dumps(result.contents()))
        assert (progress["status"], progress["steps"], progress["history_rows"]) == ("failed", 3, 3)
        assert progress["time_s"] == [0.0, 2000.0]
        assert progress["named_points"]["tip"] == {"position_mm": [10.0, 10.0, 20.0]}
        assert {"name": "J", "kind": "cell", "unit": "1", "components": 1, "description": ""} in progress["fields"]


def test_a_file_of_format_1_names_nodes(tmp_path):
    path = write(tmp_path / "old.vtkhdf", 3)
    with h5py.File(path, "r+") as file:
        assert file["explicitfe"].attrs["format"] == 3
        np.testing.assert_array_equal(file["explicitfe/named_points/inside"], [1.0, 0.5, -0.25, 0.125])
        file["explicitfe"].attrs["format"] = 1
        del file["explicitfe/named_points/tip"], file["explicitfe/named_points/inside"]
        file["explicitfe/named_points/tip"] = np.int64(11)
    with open_result(path) as result:
        np.testing.assert_array_equal(result.mesh.named_points["tip"].position, MESH.points[[11]])
        np.testing.assert_array_equal(result.probe("tip"), [displacement(row)[11] for row in range(3)])


def test_an_ending_has_the_length_it_needs(tmp_path):
    """What is known only at the end never throws a finished run away, whatever its length."""
    names = {f"point-{number}": 11 for number in range(2000)}
    message, warnings = 5000 * "ö", ["x" * 1000] * 500
    with start(tmp_path / "a.vtkhdf", mesh=MESH.with_named_nodes(names)) as run:
        add(run, 0)
        run.finish(FAILED, message, {"warnings": warnings})
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert (result.message, result.summary) == (message, {"warnings": warnings})
        assert len(result.mesh.named_points) == 2000


def test_a_summary_says_of_the_history_what_it_said_at_first(tmp_path):
    """``curve``, ``loads`` and ``probes`` are in the history already: no number of them makes a summary too long."""
    loads, count = {}, 900
    columns = list(run_summary.CURVE_COLUMNS | run_summary.LOAD_COLUMNS)
    with start(tmp_path / "a.vtkhdf", history={name: Quantity("1") for name in columns}, restart=None) as run:
        for step in range(count):
            row = {name: np.float64(np.sin(step + k)) for k, name in enumerate(columns)} | {
                "iterations": step,
                "folded_elements": 0,
            }
            fields = {"displacement": displacement(0), "velocity": displacement(0)}
            run.sample(step, row, fields, {"J": jacobian(0), "hourglass_energy": jacobian(0)})
            loads[step] = {key: float(row[column]) for column, key in run_summary.LOAD_COLUMNS.items()} | {
                "iterations": step,
                "folded": 0,
            }
            loads[step]["curve"] = {"force_N": float(row["force"]), "displacement_mm": 1e3 * float(row["indentation"])}
        curve = [loads[step].pop("curve") for step in range(count)][1:]
        summary = {"status": "finished", "curve": curve, "loads": [*loads.values()][1:], "touch_mm": 0.1}
        run.finish(FINISHED, "", summary)
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert result.summary == summary
        assert [*result.summary] == [*summary]
    with start(tmp_path / "b.vtkhdf", history={"probe_tip_displacement": M3, "probe_tip_velocity": M3}, restart=None) as run:
        fields = {"displacement": displacement(0), "velocity": displacement(0)}
        row = {"probe_tip_displacement": [1e-3, 2e-3, 3e-3], "probe_tip_velocity": [0.0, 3.0, 4.0]}
        run.sample(0.0, row, fields, {"J": jacobian(0), "hourglass_energy": jacobian(0)})
        words = {"forward_mm": -1.0, "right_mm": 2.0, "up_mm": 3.0}
        probes = {"tip": {"displacement_mm": [1.0, 2.0, 3.0], **words, "speed_mm_s": 5000.0}}
        run.finish(FINISHED, "", {"probes": probes})
    with open_result(tmp_path / "b.vtkhdf") as result:
        assert result.summary == {"probes": probes}


def test_the_columns_of_the_history_are_all_of_an_equilibrium():
    assert {*run_summary.CURVE_COLUMNS.values(), *run_summary.LOAD_COLUMNS.values()} == {f.name for f in fields(Equilibrium)}


def test_what_is_not_there_is_answered_with_what_is(tmp_path):
    with open_result(write(tmp_path / "a.vtkhdf", 3)) as result:
        with pytest.raises(InputError, match='no field "displacment"; did you mean "displacement"'):
            result.field("displacment")
        with pytest.raises(InputError, match='did you mean "kinetic_energy"'):
            result.history("kinetic")
        with pytest.raises(InputError, match="tip"):
            result.probe("tipp")
        with pytest.raises(InputError, match="no step 3; its steps are 0 to 2"):
            result.displacement(3)
        with pytest.raises(InputError, match=r"no time 0\.1 s; its times are 0 s to 0\.002 s"):
            result.mesh_at(time_s=0.1)


def test_a_run_that_fails_before_its_first_sample_can_be_read(tmp_path):
    with open_result(write(tmp_path / "a.vtkhdf", 0)) as result:
        assert result.times.shape == (0,)
        assert result.probe("tip").shape == (0, 3)
        assert result.restart_state() is None
        assert result.contents()["steps"] == 0
        with pytest.raises(InputError, match="no stored step"):
            result.displacement()


def test_reading_numbers_does_not_load_vtk(tmp_path):
    path = write(tmp_path / "a.vtkhdf", 1)
    code = f"""
import sys
from explicitfe.results.files import open_result
open_result({str(path)!r}).displacement()
print("pyvista" in sys.modules)
"""
    assert python(code).stdout == "False\n"


# What is refused


def test_samples_that_are_not_as_declared_are_refused(tmp_path):
    u, J = displacement(0), jacobian(0)
    row = {"kinetic_energy": 0.0, "probe_tip_displacement": u[11]}
    with start(tmp_path / "a.vtkhdf", point_fields={}, cell_fields={"J": Quantity("1")}) as run:
        for point_data, cell_data in (
            ({}, {"J": J}),
            ({"displacement": u}, {}),
            ({"displacement": u[:-1]}, {"J": J}),
            ({"displacement": u[:, :2]}, {"J": J}),
            ({"displacement": u}, {"J": J[:, None]}),
        ):
            with pytest.raises(ValueError, match="declared"):
                run.sample(0.0, row, point_data, cell_data)
        run.sample(0.0, row, {"displacement": u}, {"J": J})
        for again in (0.0, -1.0, np.nan):
            with pytest.raises(ValueError, match="does not come after"):
                run.sample(again, row, {"displacement": u}, {"J": J})
        with pytest.raises(ValueError, match="declared"):
            run.sample(1.0, {"kinetic_energy": 1.0}, {"displacement": u}, {"J": J})
        for arrays in ({"step": 1}, {"half_step_velocity": u[1:], "step": 1}, {"half_step_velocity": u, "step": 1.0}):
            with pytest.raises(ValueError, match="declared"):
                run.restart(arrays)
        with pytest.raises(ValueError, match="running"):
            run.finish("running", "", {})
        with pytest.raises(ValueError, match="bytes"):
            run.finish("x" * 33, "", {})
        run.finish(FINISHED, "", {})
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert len(result.times) == 1


def test_what_is_no_result_is_told_so(tmp_path):
    whole = write(tmp_path / "whole.vtkhdf", 3)
    text = tmp_path / "text.vtkhdf"
    text.write_text("not HDF5")
    other = tmp_path / "other.vtkhdf"
    with h5py.File(other, "w") as file:
        file["x"] = 1
    cut = tmp_path / "cut.vtkhdf"
    cut.write_bytes(whole.read_bytes()[:-5000])
    for name, part in (("part", "explicitfe/history"), ("steps", "VTKHDF/Steps/Values")):
        (tmp_path / f"{name}.vtkhdf").write_bytes(whole.read_bytes())
        with h5py.File(tmp_path / f"{name}.vtkhdf", "r+") as file:
            del file[part]
    short = tmp_path / "short.vtkhdf"
    short.write_bytes(whole.read_bytes())
    with h5py.File(short, "r+") as file:
        file["VTKHDF/PointData/velocity"].resize(2 * N, axis=0)
    newer = tmp_path / "newer.vtkhdf"
    newer.write_bytes(whole.read_bytes())
    with h5py.File(newer, "r+") as file:
        file["explicitfe"].attrs["format"] = layout.FORMAT_VERSION + 1
    with start(tmp_path / "going.vtkhdf") as run:
        add(run, 0)
    for name, words in (
        ("missing.vtkhdf", "does not exist$"),
        (300 * "x", r"cannot be read \(File name too long\)"),
        ("x\0", r"cannot be read"),
        ("going.vtkhdf", r"does not exist; an unfinished run has .*going\.running\.vtkhdf"),
        ("", "is a folder"),
        ("text.vtkhdf", "is not an HDF5 file"),
        ("text.vtkhdf/below", "cannot be read"),
        ("other.vtkhdf", "is an HDF5 file but not a result of explicitfe"),
        ("cut.vtkhdf", "is damaged"),
        ("part.vtkhdf", "is damaged .*history is missing"),
        ("steps.vtkhdf", "is damaged"),
        ("short.vtkhdf", "is damaged .*velocity is shorter than 3 steps"),
        ("newer.vtkhdf", "needs a newer version of explicitfe"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            open_result(tmp_path / name)
        assert repr(str(tmp_path / name))[1:-1] in str(caught.value)


# Provenance


def test_provenance_needs_no_git(monkeypatch, tmp_path):
    here = provenance()
    assert json.loads(json.dumps(here)) == here
    assert here["numpy"] == np.__version__
    assert here["h5py"] == h5py.__version__
    assert here["started_utc"].endswith("+00:00")
    assert here["processor"]
    assert here["cores"] >= 1
    if (ROOT / ".git").exists() and here["commit"] is not None:
        assert len(here["commit"].removesuffix("-dirty")) == 40
    monkeypatch.setenv("PATH", str(tmp_path))
    assert provenance()["commit"] is None
