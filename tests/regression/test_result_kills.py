"""What is left of a result when its run is killed."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from support import ROOT
from tiny_result import (
    E,
    N,
    add,
    check_history_and_restart,
    check_steps,
    displacement,
    environment,
    jacobian,
    start,
    wait_for,
    write,
)

from explicitfe.results.files import FINISHED, ResultWriter, open_result, stored
from explicitfe.results.files.disk import DiskFile

# A kill at any time


CHILD = """
import os, sys
sys.path.insert(0, {here!r})
from tiny_result import add, start
side = os.open({side!r}, os.O_CREAT | os.O_WRONLY)
with start({path!r}) as result:
    for step in range(10**9):
        add(result, step)
        os.pwrite(side, b"%12d" % step, 0)
"""


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.2])
def test_a_killed_run_is_readable_to_its_last_sample(tmp_path, delay_s):
    side = tmp_path / "side"
    code = CHILD.format(here=str(ROOT / "tests"), side=str(side), path=str(tmp_path / "a.vtkhdf"))
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


def replay(content: bytearray, change: tuple[int, bytes | None]) -> None:
    """Make one recorded change, as the operating system would."""
    place, data = change
    end = place + len(data or b"")
    content.extend(bytes(max(0, end - len(content))))
    if data is None:
        del content[place:]
    else:
        content[place:end] = data


# The third: the room for 64 steps is used up and doubled, which splits HDF5's index if its chunks are too many. The last: stopped
# after 3 steps, once by an ending and once without, and gone on with.
@pytest.mark.parametrize(
    ("expected", "steps", "first", "stop"),
    [(30, 4, 0, None), (1, 5, 0, None), (1, 66, 64, None), (2, 5, 3, "interrupted"), (2, 5, 3, "killed")],
)
def test_the_file_is_readable_after_every_single_write(tmp_path, monkeypatch, expected, steps, first, stop):
    """A kill falls between two writes to the file: try them all from step ``first`` on, lengthening and trimming too."""
    recorder: list[tuple[int, bytes | None]] = []
    change_of_disk = DiskFile._change

    def recorded(disk: DiskFile, place: int, data: bytes | memoryview | None) -> None:
        recorder.append((place, None if data is None else bytes(data)))
        change_of_disk(disk, place, data)

    monkeypatch.setattr(DiskFile, "_change", recorded)
    run = start(tmp_path / "a.vtkhdf", expected_samples=expected)
    created = len(recorder)
    done = [0] * created
    for step in range(steps):
        if stop and step == 3:
            if stop == "interrupted":
                run.finish(stop, "", {"steps": 3})
            else:
                run.close()
            run = ResultWriter.reopen(tmp_path / "a.running.vtkhdf")
            done += [step] * (len(recorder) - len(done))
        add(run, step)
        done += [step] * (len(recorder) - len(done))
    run.finish(FINISHED, "", {"steps": steps})
    done += [steps] * (len(recorder) - len(done))

    u = np.concatenate([displacement(step) for step in range(steps)])
    J = np.concatenate([jacobian(step) for step in range(steps)])
    content = bytearray()
    monkeypatch.setattr(DiskFile, "_change", change_of_disk)
    monkeypatch.setattr(stored, "_open_file", lambda _: (h5py.File(io.BytesIO(content), "r"), False))
    seen = set()
    for number, change in enumerate(recorder):
        replay(content, change)
        if number < created - 1 or done[number] < first:
            continue
        with open_result(tmp_path / "a.vtkhdf") as result:
            count = len(result.times)
            assert count in (done[number], done[number] + 1)
            # VTK copies Values into room for NSteps numbers.
            vtk = result._stored._file["VTKHDF"]
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
    assert (("interrupted", True) in seen) == (stop == "interrupted")


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


@pytest.mark.parametrize("moment", range(3, 330, 29))
def test_an_interrupt_in_the_midst_of_a_write_leaves_a_whole_file(tmp_path, monkeypatch, moment):
    """Python raises KeyboardInterrupt wherever it is, also where HDF5 calls it: HDF5 is not told, but whoever runs."""
    change, asked = DiskFile._change, []

    def interrupted(*args: object) -> None:
        asked.append(args)
        if len(asked) == moment:
            raise KeyboardInterrupt
        change(*args)

    monkeypatch.setattr(DiskFile, "_change", interrupted)
    with pytest.raises(KeyboardInterrupt), start(tmp_path / "a.vtkhdf", expected_samples=1) as run:
        for step in range(5):
            add(run, step)
        run.finish(FINISHED, "", {})
    for path in tmp_path.iterdir():
        with open_result(path) as result:
            check_steps(result, len(result.times))
