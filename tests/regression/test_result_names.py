"""Which files a run writes, and which it leaves alone."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
from abuse import abuse
from support import ROOT
from tiny_result import E, add, check_steps, displacement, python, start, write

from explicitfe.platform.errors import InputError
from explicitfe.results.files import FINISHED, ResultWriter, open_result

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
    with pytest.raises(InputError, match="exists; add `overwrite` to replace it or choose another `out` folder"):
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


def test_what_a_killed_run_left_goes_only_with_overwrite_and_at_the_first_sample(tmp_path):
    running = tmp_path / "a.running.vtkhdf"
    with start(tmp_path / "a.vtkhdf") as run:
        add(run, 7)
    before = running.read_bytes()
    with pytest.raises(InputError, match=r"holds 1 samples of an interrupted run; resume it with .*a\.running"):
        start(tmp_path / "a.vtkhdf")
    with start(tmp_path / "a.vtkhdf", overwrite=True) as run:  # refused before its first sample, as for a step that is too long
        assert running.read_bytes() == before
    assert [*tmp_path.iterdir()] == [running]
    assert running.read_bytes() == before
    with open_result(write(tmp_path / "a.vtkhdf", 2, overwrite=True)) as result:
        check_steps(result, 2)
    assert [*tmp_path.iterdir()] == [tmp_path / "a.vtkhdf"]


@pytest.mark.parametrize("stem", ["a", "a.running"])
@pytest.mark.parametrize("foreign", ["text", "empty", "HDF5", "link", "dangling link", "pipe"])
def test_what_is_no_result_is_never_replaced(tmp_path, stem, foreign):
    path, elsewhere = tmp_path / f"{stem}.vtkhdf", tmp_path / "elsewhere.vtkhdf"
    if foreign == "HDF5":
        with h5py.File(path, "w") as file:
            file["x"] = 1
    elif foreign.endswith("link"):
        if foreign == "link":
            write(elsewhere, 1)
        path.symlink_to(elsewhere)
    elif foreign == "pipe":
        os.mkfifo(path)
    else:
        path.write_text("mine" if foreign == "text" else "")
    files = {file: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    with pytest.raises(InputError, match=str(path)) as caught:
        start(tmp_path / "a.vtkhdf", overwrite=True)
    assert "\n" not in str(caught.value)
    assert {file: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()} == files
    assert path.is_symlink() == foreign.endswith("link")


def test_a_name_of_an_unfinished_result_is_refused(tmp_path):
    """A scenario x.running.toml would take the place in which x.toml writes."""
    with start(tmp_path / "x.vtkhdf") as run:
        add(run, 0)
        with pytest.raises(InputError, match='is the name of an unfinished result of "x"; choose another name with `name`'):
            start(tmp_path / "x.running.vtkhdf", overwrite=True)
    # One that an older version has finished under such a name is not taken for the rest of x.toml's run.
    write(tmp_path / "y.vtkhdf", 1).rename(tmp_path / "x.running.vtkhdf")
    with pytest.raises(InputError, match="is a complete result that was not renamed"):
        start(tmp_path / "x.vtkhdf", overwrite=True)
    with open_result(tmp_path / "x.running.vtkhdf") as result:
        check_steps(result, 1)


def test_a_stopped_run_goes_on(tmp_path):
    running, path = tmp_path / "a.running.vtkhdf", tmp_path / "a.vtkhdf"
    with start(path) as run:
        for step in range(3):
            add(run, step)
    with ResultWriter.reopen(running) as run:
        assert run.path == path
        np.testing.assert_array_equal(run.last_row["probe_tip_displacement"], displacement(2)[11])
        for step in range(1, 7):  # from an older restart state: what is there already is passed over
            add(run, step)
        assert run.finish("interrupted", "stopped by hand", {}) == running
    assert [*tmp_path.iterdir()] == [running]
    with open_result(running) as result:
        assert (result.status, result.message) == ("interrupted", "stopped by hand")
    with ResultWriter.reopen(running) as run:
        assert [*tmp_path.iterdir()] == [running]
        with open_result(running) as result:
            assert (result.status, result.message, result.summary) == ("running", "", {})
        add(run, 7)
        assert run.finish(FINISHED, "", {"steps": 8}) == path
    assert [*tmp_path.iterdir()] == [path]
    with open_result(path) as result:
        np.testing.assert_array_equal(result.times, 1e-3 * np.arange(8))
        for step in range(8):
            np.testing.assert_array_equal(result.displacement(step), displacement(step))
        np.testing.assert_array_equal(result.history("kinetic_energy"), np.arange(8) + 0.5)
        assert result.restart_state().arrays["step"] == 7
        assert result.summary == {"steps": 8}
    with pytest.raises(InputError, match="is finished; there is nothing to resume"):
        ResultWriter.reopen(path)


def test_a_file_that_a_live_run_writes_is_left_alone(tmp_path):
    with start(tmp_path / "a.vtkhdf") as run:
        add(run, 0)
        code = f"""
import sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from pathlib import Path
from tiny_result import check_steps, start
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
try:
    start(Path({str(tmp_path / "a.vtkhdf")!r}))
except InputError as error:
    print(error)
with open_result({str(run.running_path)!r}) as result:
    check_steps(result, 1)
    print(result.status, result.live)
"""
        refusal, state = python(code).stdout.splitlines()
        assert refusal.startswith(f"another run is writing {run.running_path}; wait")
        assert state == "running True"
        with open_result(run.running_path) as result:
            assert result.live and result.mesh_at().n_cells == E
        add(run, 1)
        run.finish(FINISHED, "", {})
    with open_result(tmp_path / "a.vtkhdf") as result:
        check_steps(result, 2)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="each attempt is a process of its own")
def test_many_processes_in_one_folder(tmp_path):
    """The long study of the same is studies/benchmarks/abused_folder.py."""
    counts: Counter[tuple[str, str]] = Counter()
    for seed in range(18, 28):  # who comes first is the machine's choice: on until runs were replaced and killed
        (tmp_path / str(seed)).mkdir()
        counts += abuse(tmp_path / str(seed), attempts=50, at_once=6, seed=seed)
        if counts["run over", "finished"] and counts["killed run", "killed"]:
            return
    pytest.fail(f"no run was replaced, or none killed, in 500 attempts: {counts}")
    assert sum(counts.values()) == 50


def test_what_may_not_be_written_is_refused():
    """Root may write everything, so another user tries, in a folder of its own: pytest closes its folders to other users."""
    with TemporaryDirectory(prefix="explicitfe-") as name:
        folder = Path(name)
        folder.chmod(0o777)
        write(folder / "a.vtkhdf", 1).chmod(0o444)
        (folder / "closed").mkdir(mode=0o555)
        before = (folder / "a.vtkhdf").read_bytes()
        code = f"""
import os, sys
sys.path.insert(0, {str(ROOT / "tests")!r})
from pathlib import Path
from tiny_result import start
from explicitfe.platform.errors import InputError
if os.getuid() == 0:
    os.setuid(65534)
for name in ("a.vtkhdf", "closed/b.vtkhdf"):
    try:
        start(Path({name!r}) / name, overwrite=True).sample(0.0, {{}}, {{}})
    except InputError as error:
        print(error)
"""
        file, closed = python(code).stdout.splitlines()
        assert file.startswith(f"{folder / 'a.vtkhdf'} cannot be replaced (Permission denied)")
        assert closed.startswith(f"cannot write results to {folder / 'closed'} (Permission denied)")
        assert (folder / "a.vtkhdf").read_bytes() == before
        assert {path.name for path in folder.iterdir()} == {"a.vtkhdf", "closed"}


def test_two_runs_of_a_result_at_once(tmp_path):
    """Whoever has the first sample goes on; the other is told, and leaves nothing."""
    path = tmp_path / "a.vtkhdf"
    with start(path) as one, start(path) as other:
        add(other, 0)
        with pytest.raises(InputError, match="another run is writing"):
            add(one, 0)
        other.finish(FINISHED, "", {})
    assert [*tmp_path.iterdir()] == [path]
    with start(path, overwrite=True) as one, start(tmp_path / "b.vtkhdf") as other:
        add(one, 0)
        add(other, 0)
        one.finish(FINISHED, "", {})
        write(tmp_path / "c.vtkhdf", 1).rename(tmp_path / "b.vtkhdf")  # without --overwrite it stays
        with pytest.raises(InputError, match=r"was created by another program .*; the complete result is .*b\.running"):
            other.finish(FINISHED, "", {})
    assert {file.name for file in tmp_path.iterdir()} == {"a.vtkhdf", "b.vtkhdf", "b.running.vtkhdf"}


def test_what_dead_processes_left_is_cleared_away(tmp_path):
    with start(tmp_path / "a.vtkhdf") as run:
        (going,) = tmp_path.iterdir()
        old, young, other = (tmp_path / f".{stem}.{number:016x}.part" for stem, number in (("a", 1), ("a", 2), ("b", 3)))
        for path in (old, young, other):
            path.write_bytes(b"x")
        for path in (going, old, other):
            os.utime(path, (0, 0))
        with start(tmp_path / "a.vtkhdf"):
            assert going.exists() and young.exists() and other.exists() and not old.exists()
        add(run, 0)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot write results to .*file/sub \(Not a directory\); choose another `out`"):
        start(tmp_path / "file" / "sub" / "a.vtkhdf")
    (tmp_path / "b.vtkhdf").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        start(tmp_path / "b.vtkhdf")
    with pytest.raises(InputError, match=r"must end in \.vtkhdf"):
        start(tmp_path / "b.h5")
    with pytest.raises(InputError, match="File name too long"):
        start(tmp_path / f"{250 * 'x'}.vtkhdf")
    with pytest.raises(InputError, match="File name too long"):
        start(tmp_path / f"{240 * 'x'}.vtkhdf")  # the result's own would do, but not what it is called until then


def test_an_open_result_is_not_replaced(tmp_path):
    path = write(tmp_path / "a.vtkhdf", 1)
    with open_result(path), pytest.raises(InputError, match=r"a\.vtkhdf is open for reading, here or in another program"):
        start(path, overwrite=True).sample(0.0, {}, {})
    write(path, 1, overwrite=True)
