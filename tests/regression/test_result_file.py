"""The result file: its layout, its two readers, and what is left of it when a run is killed or the disk is full.

The reference is /VTKHDF as VTK documents it. The file is read with h5py, with this package and with VTK's reader: all
three have to agree to the last bit, as float64 goes into the file and nothing is computed on the way. What the writer
is given follows from the number of the step, so right values can be told from any others.
"""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from explicitfe.errors import InputError
from explicitfe.mesh.hexmesh import HexMesh
from explicitfe.results import FAILED, FINISHED, Quantity, ResultWriter, layout, open_result, provenance, reader, writer

ROOT = Path(__file__).resolve().parents[2]
HISTORY = {"kinetic_energy": Quantity("J", 1, "of all nodes"), "probe_tip_displacement": Quantity("m", 3)}
SCENARIO = 'title = "Zunge, größer"\n'


def two_hexes() -> HexMesh:
    x, y, z = np.meshgrid([0.0, 0.01], [0.0, 0.01], [0.0, 0.01, 0.02], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    base = np.array([0, 6, 9, 3])
    hexes = np.array([[*(base + k), *(base + k + 1)] for k in range(2)])
    mesh = HexMesh(points, hexes, {"jaw": np.array([0, 3, 6, 9])}).with_named_nodes({"tip": 11})
    inside = mesh.points_in(np.array([1]), np.array([[0.5, -0.25, 0.125]]))
    return replace(mesh, named_points=mesh.named_points | {"inside": inside})


MESH = two_hexes()
N, E = MESH.node_count, MESH.element_count


def displacement(step: int) -> np.ndarray:
    return np.sin(step + 0.1 * np.arange(3 * N).reshape(N, 3))


def jacobian(step: int) -> np.ndarray:
    return np.cos(step + 0.1 * np.arange(E))


def start(path: Path, **changes) -> ResultWriter:
    options = {
        "mesh": MESH,
        "point_fields": {"velocity": Quantity("m/s", 3)},
        "cell_fields": {"J": Quantity("1"), "hourglass_energy": Quantity("J")},
        "history": HISTORY,
        "scenario_text": SCENARIO,
        "model": {"density": np.float64(1040.0)},
        "provenance": {"explicitfe": "test"},
        "restart": {"half_step_velocity": np.zeros((N, 3)), "step": 0},
        "expected_samples": 4,
    }
    return ResultWriter(path, **options | changes)


def add(result: ResultWriter, step: int) -> None:
    """One sample, one history row and one restart state, all of them telling ``step``."""
    u = displacement(step)
    result.history(1e-3 * step, {"kinetic_energy": step + 0.5, "probe_tip_displacement": u[11]})
    result.sample(1e-3 * step, {"displacement": u, "velocity": -u}, {"J": jacobian(step), "hourglass_energy": -jacobian(step)})
    result.restart({"half_step_velocity": u, "step": step})


def write(path: Path, steps: int, **changes) -> Path:
    with start(path, **changes) as result:
        for step in range(steps):
            add(result, step)
        return result.finish(FINISHED, "", {"steps": steps})


def check_steps(result, count: int) -> None:
    """The result has exactly the first ``count`` steps, history rows and the restart state that go with them."""
    np.testing.assert_array_equal(result.times, 1e-3 * np.arange(count))
    for step in range(count):
        np.testing.assert_array_equal(result.displacement(step), displacement(step))
        np.testing.assert_array_equal(result.field("velocity", step), -displacement(step))
        np.testing.assert_array_equal(result.field("J", step), jacobian(step))
        np.testing.assert_array_equal(result.field("hourglass_energy", step), -jacobian(step))
    check_history_and_restart(result, count)


def check_history_and_restart(result, count: int) -> None:
    rows = len(result.history("time"))
    # The count of steps and the count of rows are two writes: a kill may fall between them.
    assert rows in (count - 1, count)
    np.testing.assert_array_equal(result.history("time"), 1e-3 * np.arange(rows))
    np.testing.assert_array_equal(result.history("kinetic_energy"), np.arange(rows) + 0.5)
    state = result.restart_state()
    if state is None:
        assert count <= 1
    else:
        assert state.sequence in (count - 1, count)
        assert state.arrays["step"] == state.sequence - 1
        np.testing.assert_array_equal(state.arrays["half_step_velocity"], displacement(state.sequence - 1))


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
            result.history(1e-3 * step, {"bone_jaw_placement": np.concatenate([rotation.ravel(), shift])})
            fields = {"displacement": displacement(step), "velocity": displacement(step)}
            result.sample(1e-3 * step, fields, {"J": jacobian(step), "hourglass_energy": jacobian(step)})
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
        assert vtk["PointData/displacement"].attrs["unit"] == "m"

        own = file["explicitfe"]
        assert own["scenario"].asstr()[()] == SCENARIO
        assert json.loads(own["model"][()]) == {"density": 1040.0}
        assert own["history/kinetic_energy"].attrs["unit"] == "J"
        assert own["history/kinetic_energy"].attrs["description"] == "of all nodes"
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
        for row in range(2500):  # more rows than samples, and more than one chunk of them
            run.history(row, {"kinetic_energy": -row, "probe_tip_displacement": [row, 0, 1]})
            if row % 1000 == 0:
                run.sample(
                    row,
                    {"displacement": displacement(row), "velocity": displacement(row)},
                    {"J": jacobian(row), "hourglass_energy": jacobian(row)},
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
        np.testing.assert_array_equal(result.history("time"), np.arange(2500))
        np.testing.assert_array_equal(result.history("kinetic_energy"), -np.arange(2500))
        np.testing.assert_array_equal(result.history("probe_tip_displacement")[:, 0], np.arange(2500))
        assert result.history_names["kinetic_energy"] == HISTORY["kinetic_energy"]
        assert result.fields["displacement"].kind == "point"
        assert result.fields["J"] == ("cell", Quantity("1"))
        # 1400 s lies nearest to the sample at 1000 s.
        np.testing.assert_array_equal(result.displacement(time_s=1400.0), displacement(1000))
        np.testing.assert_array_equal(result.displacement(-2), displacement(1000))
        progress = json.loads(json.dumps(result.contents()))
        assert (progress["status"], progress["steps"], progress["history_rows"]) == ("failed", 3, 2500)
        assert progress["time_s"] == [0.0, 2000.0]
        assert progress["named_points"]["tip"] == {"position_mm": [10.0, 10.0, 20.0]}
        assert {"name": "J", "kind": "cell", "unit": "1", "components": 1, "description": ""} in progress["fields"]


def test_a_file_of_format_1_names_nodes(tmp_path):
    path = write(tmp_path / "old.vtkhdf", 3)
    with h5py.File(path, "r+") as file:
        assert file["explicitfe"].attrs["format"] == 2
        np.testing.assert_array_equal(file["explicitfe/named_points/inside"], [1.0, 0.5, -0.25, 0.125])
        file["explicitfe"].attrs["format"] = 1
        del file["explicitfe/named_points/tip"], file["explicitfe/named_points/inside"]
        file["explicitfe/named_points/tip"] = np.int64(11)
    with open_result(path) as result:
        np.testing.assert_array_equal(result.mesh.named_points["tip"].position, MESH.points[[11]])
        np.testing.assert_array_equal(result.probe("tip"), [displacement(row)[11] for row in range(3)])


def test_what_is_not_there_is_answered_with_what_is(tmp_path):
    with open_result(write(tmp_path / "a.vtkhdf", 3)) as result:
        with pytest.raises(InputError, match='no field "displacment"; did you mean "displacement"'):
            result.field("displacment")
        with pytest.raises(InputError, match='did you mean "kinetic_energy"'):
            result.history("kinetic")
        with pytest.raises(InputError, match="tip"):
            result.probe("tipp")
        with pytest.raises(InputError, match="no step 3; it has 0 to 2"):
            result.displacement(3)
        with pytest.raises(InputError, match=r"no time 0\.1 s; it has 0\.0 s to 0\.002 s"):
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
from explicitfe.results import open_result
open_result({str(path)!r}).displacement()
print("pyvista" in sys.modules)
"""
    assert python(code).stdout == "False\n"


# A kill at any time


CHILD = """
import os, sys
sys.path.insert(0, {here!r})
from test_result_file import add, start
side = os.open({side!r}, os.O_CREAT | os.O_WRONLY)
with start({path!r}) as result:
    for step in range(10**9):
        add(result, step)
        os.pwrite(side, b"%12d" % step, 0)
"""


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.05, 0.1, 0.2])
def test_a_killed_run_is_readable_to_its_last_sample(tmp_path, delay_s):
    side = tmp_path / "side"
    code = CHILD.format(here=str(Path(__file__).parent), side=str(side), path=str(tmp_path / "a.vtkhdf"))
    child = subprocess.Popen([sys.executable, "-c", code], env=environment())
    try:
        wait_for(lambda: side.exists() and side.stat().st_size, child)
        time.sleep(delay_s)
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    stored = int(side.read_text())
    with open_result(tmp_path / "a.running.vtkhdf") as result:
        count = len(result.times)
        assert count in (stored + 1, stored + 2)
        assert (result.status, result.live) == ("running", False)
        check_steps(result, count)
        assert result.restart_state() is not None
        for step in (0, count // 2, count - 1):
            grid = result.mesh_at(step)
            np.testing.assert_array_equal(grid.point_data["displacement"], displacement(step))
            np.testing.assert_array_equal(grid.cell_data["J"], jacobian(step))


class Recorder(io.BytesIO):
    """A file that notes every change made to it."""

    def __init__(self) -> None:
        super().__init__()
        self.changes: list[tuple[int, bytes | None]] = []

    def write(self, data) -> int:
        self.changes.append((self.tell(), bytes(data)))
        return super().write(data)

    def truncate(self, size=None) -> int:
        self.changes.append((size, None))
        missing = size - len(self.getbuffer())
        if missing > 0:
            here = self.tell()
            self.seek(0, io.SEEK_END)
            super().write(bytes(missing))
            self.seek(here)
        return super().truncate(size)


def replay(content: bytearray, change: tuple[int, bytes | None]) -> None:
    """Make one recorded change, as the operating system would."""
    place, data = change
    end = place + len(data or b"")
    content.extend(bytes(max(0, end - len(content))))
    if data is None:
        del content[place:]
    else:
        content[place:end] = data


# The last: the room for 64 steps is used up and doubled, which splits HDF5's index if its chunks are too many.
@pytest.mark.parametrize(("expected", "steps", "first"), [(30, 5, 0), (5, 5, 0), (1, 5, 0), (1, 66, 63)])
def test_the_file_is_readable_after_every_single_write(tmp_path, monkeypatch, expected, steps, first):
    """A kill falls between two writes to the file: try them all from step ``first`` on, lengthening and trimming too."""
    recorder = Recorder()
    monkeypatch.setattr(writer, "_create_file", lambda *_: h5py.File(recorder, "w", rdcc_nbytes=0))
    monkeypatch.setattr(layout, "_reserve", lambda *_: None)  # needs a file of the operating system
    run = start(tmp_path / "a.vtkhdf", expected_samples=expected)
    created = len(recorder.changes)
    done = [0] * created
    for step in range(steps):
        add(run, step)
        done += [step] * (len(recorder.changes) - len(done))
    run.running_path.touch()
    run.finish(FINISHED, "", {"steps": steps})
    done += [steps] * (len(recorder.changes) - len(done))

    u = np.concatenate([displacement(step) for step in range(steps)])
    J = np.concatenate([jacobian(step) for step in range(steps)])
    content = bytearray()
    monkeypatch.setattr(reader, "_open_file", lambda _: (h5py.File(io.BytesIO(content), "r"), False))
    seen = set()
    for number, change in enumerate(recorder.changes):
        replay(content, change)
        if number < created - 1 or done[number] < first:
            continue
        with open_result(tmp_path / "a.vtkhdf") as result:
            count = len(result.times)
            assert count in (done[number], done[number] + 1)
            # VTK copies Values into room for NSteps numbers.
            vtk = result._file["VTKHDF"]
            assert vtk["Steps"].attrs["NSteps"] >= len(vtk["Steps/Values"]) or count <= 1
            np.testing.assert_array_equal(result.times, 1e-3 * np.arange(count))
            np.testing.assert_array_equal(vtk["PointData/displacement"][: count * N], u[: count * N])
            np.testing.assert_array_equal(vtk["CellData/J"][: count * E], J[: count * E])
            check_history_and_restart(result, count)
            seen.add((result.status, bool(result.summary)))
    with open_result(tmp_path / "a.vtkhdf") as result:
        check_steps(result, steps)
    assert ("running", False) in seen
    assert ("finished", True) in seen


def test_a_torn_restart_slot_is_passed_over(tmp_path):
    path = write(tmp_path / "a.vtkhdf", 5)
    with open_result(path) as result:
        assert result.restart_state().sequence == 5
        assert result.restart_state().arrays["step"] == 4
    slots = [f"explicitfe/restart/slot{number}" for number in (0, 1)]
    with h5py.File(path, "r+") as file:
        slots.sort(key=lambda slot: file[slot]["seal"][0])
        file[slots[1]]["half_step_velocity"][3, 1] += 1e-16
    with open_result(path) as result:
        state = result.restart_state()
        assert (state.sequence, state.arrays["step"]) == (4, 3)
        np.testing.assert_array_equal(state.arrays["half_step_velocity"], displacement(3))
    with h5py.File(path, "r+") as file:
        file[slots[0]]["seal"][0] += 2  # newer than it is
    with open_result(path) as result:
        assert result.restart_state() is None


# Which file is written


def test_the_file_has_its_final_name_only_when_it_is_whole(tmp_path):
    path, running = tmp_path / "new" / "a.vtkhdf", tmp_path / "new" / "a.running.vtkhdf"
    with start(path) as run:
        add(run, 0)
        assert running.exists()
        assert not path.exists()
        assert run.finish(FINISHED, "", {}) == path
    assert [*path.parent.iterdir()] == [path]


def test_an_existing_result_stays_until_the_new_one_is_whole(tmp_path):
    path = write(tmp_path / "a.vtkhdf", 2)
    before = path.read_bytes()
    with pytest.raises(InputError, match="exists; add --overwrite to replace it or choose another --out folder"):
        start(path)
    assert [*tmp_path.iterdir()] == [path]
    with start(path, overwrite=True) as run:
        add(run, 0)
        assert path.read_bytes() == before
        run.finish(FINISHED, "", {})
    assert [*tmp_path.iterdir()] == [path]
    with open_result(path) as result:
        check_steps(result, 1)


def test_leaving_early_keeps_samples_and_no_empty_file(tmp_path):
    with pytest.raises(ZeroDivisionError), start(tmp_path / "a.vtkhdf"):
        raise ZeroDivisionError
    assert [*tmp_path.iterdir()] == []
    with pytest.raises(ZeroDivisionError), start(tmp_path / "a.vtkhdf") as run:
        add(run, 0)
        raise ZeroDivisionError
    assert [*tmp_path.iterdir()] == [tmp_path / "a.running.vtkhdf"]
    with open_result(tmp_path / "a.running.vtkhdf") as result:
        check_steps(result, 1)
        assert result.status == "running"
    with pytest.raises(AttributeError):
        start(tmp_path / "b.vtkhdf", model={"not JSON": object()})
    assert not (tmp_path / "b.running.vtkhdf").exists()


@pytest.mark.parametrize("left", ["samples", "rubbish", "nothing"])
def test_what_a_dead_run_left_is_replaced(tmp_path, left):
    running = tmp_path / "a.running.vtkhdf"
    with start(tmp_path / "a.vtkhdf") as run:
        add(run, 7)
    if left != "samples":
        running.write_bytes(b"rubbish" if left == "rubbish" else b"")
    with open_result(write(tmp_path / "a.vtkhdf", 2)) as result:
        check_steps(result, 2)
    assert not running.exists()


def test_a_file_that_a_live_run_writes_is_left_alone(tmp_path):
    with start(tmp_path / "a.vtkhdf") as run:
        add(run, 0)
        code = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_result_file import *
try:
    start(Path({str(tmp_path / "a.vtkhdf")!r}))
except InputError as error:
    print(error)
with open_result({str(run.running_path)!r}) as result:
    check_steps(result, 1)
    print(result.status, result.live)
    try:
        result.mesh_at()
    except InputError as error:
        print(error)
"""
        refusal, state, no_mesh = python(code).stdout.splitlines()
        assert refusal.startswith(f"another run is writing {run.running_path}; wait")
        assert state == "running True"
        assert "is being written" in no_mesh
        add(run, 1)
        run.finish(FINISHED, "", {})
    with open_result(tmp_path / "a.vtkhdf") as result:
        check_steps(result, 2)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot write results in .*file/sub \(Not a directory\); choose another --out"):
        start(tmp_path / "file" / "sub" / "a.vtkhdf")
    (tmp_path / "b.vtkhdf").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        start(tmp_path / "b.vtkhdf")
    with pytest.raises(InputError, match=r"must end in \.vtkhdf"):
        start(tmp_path / "b.h5")


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="this system cannot reserve room on the disk")
def test_a_full_disk_costs_no_sample(tmp_path):
    """A limit on the size of files stands for the full disk: the same calls fail at the same places."""
    code = f"""
import resource, sys
from explicitfe.errors import RunError
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_result_file import *
resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))
folder = Path({str(tmp_path)!r})
try:
    start(folder / "large.vtkhdf", expected_samples=10_000)
except InputError as error:
    print(error)
run = start(folder / "a.vtkhdf")
step = 0
try:
    while True:
        add(run, step)
        step += 1
except RunError as error:
    print(error)
run.finish(FAILED, "disk full", {{}})
print(step)
"""
    at_start, later, samples = python(code).stdout.splitlines()
    assert at_start.startswith(f"cannot write results in {tmp_path} (File too large)")
    assert f"its {samples} samples so far stay readable" in later
    assert [*tmp_path.iterdir()] == [tmp_path / "a.vtkhdf"]
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert result.status == "failed"
        np.testing.assert_array_equal(result.times, 1e-3 * np.arange(int(samples)))
        np.testing.assert_array_equal(result.displacement(), displacement(int(samples) - 1))


# What is refused


def test_samples_that_are_not_as_declared_are_refused(tmp_path):
    u, J = displacement(0), jacobian(0)
    with start(tmp_path / "a.vtkhdf", point_fields={}, cell_fields={"J": Quantity("1")}) as run:
        for point_data, cell_data in (
            ({}, {"J": J}),
            ({"displacement": u}, {}),
            ({"displacement": u[:-1]}, {"J": J}),
            ({"displacement": u[:, :2]}, {"J": J}),
            ({"displacement": u}, {"J": J[:, None]}),
        ):
            with pytest.raises(ValueError, match="declared"):
                run.sample(0.0, point_data, cell_data)
        run.sample(0.0, {"displacement": u}, {"J": J})
        for again in (0.0, -1.0, np.nan):
            with pytest.raises(ValueError, match="does not come after"):
                run.sample(again, {"displacement": u}, {"J": J})
        with pytest.raises(ValueError, match="declared"):
            run.history(0.0, {"kinetic_energy": 1.0})
        for arrays in ({"step": 1}, {"half_step_velocity": u[1:], "step": 1}, {"half_step_velocity": u, "step": 1.0}):
            with pytest.raises(ValueError, match="declared"):
                run.restart(arrays)
        with pytest.raises(ValueError, match="running"):
            run.finish("running", "", {})
        with pytest.raises(ValueError, match="bytes"):
            run.finish(FINISHED, "", {"text": "x" * 300_000})
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
        ("going.vtkhdf", r"does not exist; a run that goes on or was killed has .*going\.running\.vtkhdf"),
        ("", "is a folder"),
        ("text.vtkhdf", "is no HDF5 file"),
        ("text.vtkhdf/below", "cannot be read"),
        ("other.vtkhdf", "is an HDF5 file but no result of explicitfe"),
        ("cut.vtkhdf", "is damaged"),
        ("part.vtkhdf", "is damaged .*history is missing"),
        ("steps.vtkhdf", "is damaged"),
        ("short.vtkhdf", "is damaged .*velocity is shorter than 3 steps"),
        ("newer.vtkhdf", "newer than this explicitfe"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            open_result(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


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


# Helpers


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT)}


def python(code: str) -> subprocess.CompletedProcess:
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done


def wait_for(condition, child: subprocess.Popen) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert child.poll() is None
        assert time.monotonic() < end
        time.sleep(0.005)
