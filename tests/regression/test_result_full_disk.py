"""A disk that fills while a result is written: a sentence, nothing that was stored lost, and the run can be gone on with."""

from __future__ import annotations

import errno
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from failing_disk import SAMPLES, FullDisk, questions, run_on
from support import ROOT
from tiny_result import add, check_steps, displacement, python, start, write

from explicitfe.platform.errors import MachineError
from explicitfe.platform.host import files
from explicitfe.results.files import FINISHED, ResultWriter, open_result

EVERY = 47  # questions to the disk are tried; all of them in studies/benchmarks/full_disk.py


@pytest.mark.parametrize("torn", [False, True])
@pytest.mark.parametrize("room_at_the_end", [False, True])
def test_a_disk_that_is_full_from_some_write_on(tmp_path, torn, room_at_the_end):
    ended = set()
    for number, left in enumerate(range(0, questions() + EVERY, EVERY)):
        folder = tmp_path / str(number)
        folder.mkdir()
        attempt = run_on(FullDisk(left, torn), folder, room_at_the_end=room_at_the_end)
        ended.add(attempt.ended)
        assert attempt.sentence or attempt.kept == SAMPLES
        if attempt.ended == "refused":
            assert attempt.sentence.endswith("free disk space or use another disk.")
        elif attempt.sentence:
            assert "free disk space" in attempt.sentence or "cannot rename" in attempt.sentence
    assert ended >= {"refused", "finished"}


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="this system cannot reserve room on the disk")
def test_a_limit_on_the_size_of_files(tmp_path):
    code = f"""
import resource, sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from pathlib import Path
from tiny_result import add, start
from explicitfe.platform.errors import RunError
from explicitfe.results.files import FAILED
resource.setrlimit(resource.RLIMIT_FSIZE, (900_000, 900_000))
folder = Path({str(tmp_path)!r})
try:
    start(folder / "large.vtkhdf", expected_samples=10_000)
except RunError as error:
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
    assert at_start.startswith(f"cannot write results to {tmp_path} (File too large)")
    assert f"The {samples} samples stored so far are readable" in later
    assert [*tmp_path.iterdir()] == [tmp_path / "a.vtkhdf"]
    with open_result(tmp_path / "a.vtkhdf") as result:
        assert result.status == "failed"
        np.testing.assert_array_equal(result.times, 1e-3 * np.arange(int(samples)))
        np.testing.assert_array_equal(result.displacement(), displacement(int(samples) - 1))


@pytest.fixture
def small_disk(tmp_path: Path):
    """A file system of 1 MB, where this user may make one."""
    folder = tmp_path / "small"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1000k", "tmpfs", folder], capture_output=True).returncode != 0:
        pytest.skip("only root can make a small file system")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


@pytest.mark.skipif(not Path("/proc/mounts").exists(), reason="a small file system is made as Linux does")
def test_a_small_file_system_fills_up(small_disk):
    path, filler = small_disk / "a.vtkhdf", small_disk / "filler"
    done = 0
    with (
        pytest.raises(MachineError, match=r"No space left.*free disk space, then resume the run with"),
        start(path) as run,
    ):
        for done in range(10_000):
            add(run, done)
    running = small_disk / "a.running.vtkhdf"
    with open_result(running) as result:
        check_steps(result, done)
    filler.write_bytes(b"")
    with pytest.raises(OSError, match="No space"):
        filler.write_bytes(bytes(10**6))
    with pytest.raises(MachineError, match="No space"), ResultWriter.reopen(running) as run:
        for step in range(10_000):
            add(run, step)
    filler.unlink()
    subprocess.run(["mount", "-o", "remount,size=4000k", small_disk], check=True)
    with ResultWriter.reopen(running) as run:
        for step in range(done + 5):
            add(run, step)
        run.finish(FINISHED, "", {})
    with open_result(path) as result:
        np.testing.assert_array_equal(result.times, 1e-3 * np.arange(done + 5))
        np.testing.assert_array_equal(result.displacement(done), displacement(done))


def test_nothing_is_renamed_before_it_is_on_the_disk(tmp_path, monkeypatch):
    """A disk that fails in the last moment: the result is whole, and stays under its running name."""

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(files, "sync", fail)
    with pytest.raises(MachineError, match="Input/output error"):
        write(tmp_path / "a.vtkhdf", 2)
    assert [path.name for path in tmp_path.iterdir()] == ["a.running.vtkhdf"]
    with open_result(tmp_path / "a.running.vtkhdf") as result:
        check_steps(result, 2)
