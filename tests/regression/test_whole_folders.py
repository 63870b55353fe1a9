"""Answers of commands are whole folders: killed at any instant there is the old one, the new one or none."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from killing import killed_at
from support import ROOT

from explicitfe.platform.errors import InputError, MachineError
from explicitfe.results.files.folder import checked_target, whole_file, whole_folder

SUMMARY = "answer.json"


def answer(target: Path, word: str) -> None:
    """Write an answer of two files and its summary, as commands do."""
    checked_target(target, True, summary=SUMMARY, what="answer")
    names = [SUMMARY, f"{word}.csv", "model.toml"]
    with whole_folder(target, summary=SUMMARY) as folder:
        for name in names[1:]:
            (folder / name).write_text(word)
        (folder / SUMMARY).write_text(json.dumps({"word": word, "files": [str(target / name) for name in names]}))


def state(target: Path) -> str:
    """The word of a whole answer; "" where there is none."""
    if not target.exists():
        return ""
    document = json.loads((target / SUMMARY).read_text())
    assert all(Path(name).read_text() for name in document["files"])
    assert (target / "model.toml").read_text() == document["word"]
    return document["word"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_every_instant(tmp_path: Path) -> None:
    """The user's own file is never lost; the next command finds a whole answer and leaves nothing of the killed one."""
    instant, moments = 0, set()
    while True:
        target = tmp_path / f"{instant}" / "report"
        answer(target, "old")
        (target / "notes.txt").write_text("my own")
        if not killed_at(instant, lambda target=target: answer(target, "new")):
            break
        moments.add(state(target))
        for path in target.parent.iterdir():  # What stands empty may be of a process that is just about to lock it.
            os.utime(path, (0, 0))
        checked_target(target, True, summary=SUMMARY, what="answer")
        assert state(target) in ("old", "new")
        assert (target / "notes.txt").read_text() == "my own"
        assert [path.name for path in target.parent.iterdir()] == ["report"]
        assert (target / "old.csv").exists() != (target / "new.csv").exists()
        shutil.rmtree(target.parent)
        instant += 1
    assert moments == {"old", "", "new"}
    assert instant > 12
    assert state(target) == "new" and not (target / "old.csv").exists()


def test_what_another_process_fills_is_left(tmp_path: Path) -> None:
    target = tmp_path / "report"
    with whole_folder(target, summary=SUMMARY) as folder:
        (folder / "model.toml").write_text("half")
        answer(target, "other")
        assert (folder / "model.toml").read_text() == "half"
        (folder / SUMMARY).write_text("{}")
    assert sorted(path.name for path in target.iterdir()) == [SUMMARY, "model.toml"]
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_a_failure_leaves_the_old_answer(tmp_path: Path) -> None:
    target = tmp_path / "report"
    answer(target, "old")
    with pytest.raises(MachineError, match="cannot write"), whole_folder(target, summary=SUMMARY) as folder:
        (folder / "model.toml").write_text("half")
        raise OSError(28, "No space left on device")
    assert state(target) == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["report"]


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    (tmp_path / "report").symlink_to("far")
    answer(tmp_path / "report", "new")
    answer(tmp_path / "report", "newer")
    assert (tmp_path / "report").is_symlink() and state(tmp_path / "far") == "newer"


def test_places_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("x")
    monkeypatch.chdir(tmp_path / "other")
    for out, words in (
        (tmp_path / "file", "is a file"),
        (tmp_path / "file" / "in", "cannot write"),
        (tmp_path / "loop", "cannot write"),
        (Path(), "contains the current folder"),
        (Path(".."), "contains the current folder"),
        (tmp_path / ("x" * 300), "cannot write"),
        (tmp_path / "a\0b", "cannot be the name"),
        (Path("/proc/none/report"), "cannot write"),
    ):
        with pytest.raises(InputError, match=words):
            checked_target(out, True, summary=SUMMARY, what="answer")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="contains other files"):
        checked_target(tmp_path / "other", True, summary=SUMMARY, what="answer")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "loop", "other"]


def test_a_file_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    whole_file(path, "old")

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", full)
        with pytest.raises(OSError, match="No space"):
            whole_file(path, "new")
    assert path.read_text() == "old" and [entry.name for entry in tmp_path.iterdir()] == ["a.json"]
    whole_file(path, b"new")
    assert path.read_text() == "new"


WORKER = """
import sys, time
from multiprocessing import get_context
from explicitfe.platform.host.stopping import leave_signals_to_the_parent

def work():
    leave_signals_to_the_parent()
    time.sleep(60.0)

if __name__ == "__main__":
    child = get_context("spawn").Process(target=work)
    child.start()
    print(child.pid, flush=True)
    child.join()
"""


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="reads /proc")
def test_workers_end_with_a_killed_parent(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(WORKER)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, env=environment) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        time.sleep(0.5)
        parent.send_signal(signal.SIGKILL)
        parent.wait()
        end = time.monotonic() + 20.0
        while Path(f"/proc/{worker}/stat").exists() and time.monotonic() < end:
            if Path(f"/proc/{worker}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                break
            time.sleep(0.05)
        else:
            assert not Path(f"/proc/{worker}").exists(), "a worker outlives its parent"
