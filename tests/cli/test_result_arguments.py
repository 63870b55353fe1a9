"""Results are given by path or by name; names that do not exist, and unusual paths, are one sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import tiny_result
from command import command
from support import ROOT

from explicitfe.app.cli.completion import complete_result, complete_unfinished_result
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.result_files import find_result
from explicitfe.results.files import open_result
from explicitfe.results.files.ending import note_on_ending

SMALL = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=4", "--set", "record.every_ms=2"]
READERS = (["inspect"], ["measure"], ["report"], ["view", "--png"], ["plot", "--only", "contour"], ["export", "--to", "csv"])


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with outputs/vowel-i.vtkhdf."""
    folder = tmp_path_factory.mktemp("work")
    assert command(["run", "vowel-i", "--out", str(folder / "outputs"), *SMALL]) == 0
    return folder


@pytest.fixture
def outputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder outputs, with a finished result "a" and an interrupted one "b"."""
    tiny_result.write(tmp_path / "outputs" / "a.vtkhdf", 2)
    with tiny_result.start(tmp_path / "outputs" / "b.vtkhdf") as run:
        tiny_result.add(run, 0)
        run.finish("interrupted", "interrupted by Ctrl-C at 0.000 ms of 9 ms", {})
    monkeypatch.chdir(tmp_path)
    return tmp_path / "outputs"


@pytest.mark.parametrize("words", READERS, ids=lambda words: words[0])
def test_every_command_takes_the_name_of_a_result(
    words: list[str], run_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(run_folder)
    assert command([words[0], "vowel-i", *words[1:]]) == 0
    capsys.readouterr()
    assert command([words[0], "vowel-e", *words[1:]]) == 2
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert sentence.startswith("error: vowel-e does not exist, and no result in outputs/ has this name")
    assert 'did you mean "vowel-i"?' in sentence or "explicitfe run vowel-e" in sentence


def test_compare_takes_two_names(run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(run_folder)
    assert command(["compare", "vowel-i", "outputs/vowel-i.vtkhdf"]) == 0


def test_names_and_paths(outputs: Path) -> None:
    finished, unfinished = Path("outputs/a.vtkhdf"), Path("outputs/b.running.vtkhdf")
    for name in ("a", "a.vtkhdf", "outputs/a", "outputs/a.vtkhdf"):
        assert find_result(Path(name)) == finished
    for name in ("b", "b.running", "b.running.vtkhdf", "outputs/b"):
        assert find_result(Path(name)) == unfinished
    for name in ("b", "b.vtkhdf", "outputs/b.vtkhdf", "outputs/b.running.vtkhdf"):
        assert find_result(Path(name), unfinished_first=True) == unfinished
    with pytest.raises(InputError, match=r"outputs/b\.vtkhdf does not exist; an interrupted run has left outputs/b\.running"):
        find_result(Path("outputs/b.vtkhdf"))
    with pytest.raises(InputError, match=r"vowel-a does not exist.*compute it with 'explicitfe run vowel-a'"):
        find_result(Path("vowel-a"))
    with pytest.raises(InputError, match="cannot be the name of a file"):
        find_result(Path("x" * 300))
    with pytest.raises(InputError, match="does not exist"):
        find_result(Path("x\0y"))
    assert complete_result("") == ["a", "b.running", "outputs/"] and complete_unfinished_result("") == ["b", "outputs/"]


def test_an_interrupted_result_never_looks_finished(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It keeps its running name, and its ending is a sentence."""
    assert sorted(path.name for path in outputs.iterdir()) == ["a.vtkhdf", "b.running.vtkhdf"]
    with open_result("outputs/b.running.vtkhdf") as result:
        assert "not finished: interrupted by Ctrl-C at 0.000 ms of 9 ms" in note_on_ending(result)
    with open_result("outputs/a.vtkhdf") as result:
        assert note_on_ending(result) == ""


def test_a_muscle_that_is_not_listed_is_added(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the time course of the first muscle; entries of a list are counted from 1."""
    words = ["run", "vowel-i", "--out", str(tmp_path), *SMALL, "--set", "muscle.STY.force_N=2", "--set", "muscle.1.force_N=1"]
    assert command(words) == 0
    with open_result(tmp_path / "vowel-i.vtkhdf") as result:
        first, *_, added = result.model["muscles"]
    assert (first["name"], first["force_N"], added["name"], added["force_N"]) == ("GGp", 1.0, "STY", 2.0)
    assert (added["profile"], added["rise_ms"], added["distribution"]) == ("ramp", 50.0, "stress")
    for setting, sentence in (
        ("muscle.STX.force_N=1", "STX"),
        ("muscle.0.force_N=1", "muscle has 3 entries, counted from 1"),
        ("muscle.4.force_N=1", "muscle has 3 entries, counted from 1"),
        ("bone.hyoid.friction=1", """To add an entry write 'bone.+={name="hyoid", ...}'."""),
    ):
        capsys.readouterr()
        assert command(["check", "vowel-i", *SMALL, "--set", setting]) == 2
        assert sentence in capsys.readouterr().err.splitlines()[-1], setting


def test_a_long_name_is_refused_with_its_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["run", "vowel-i", "--out", str(tmp_path), "--name", "x" * 250, *SMALL]) == 2
    assert "has 250 bytes; at most 200 are possible: choose a shorter --name." in capsys.readouterr().err
    assert command(["run", "vowel-i", "--out", str(tmp_path), "--name", "x" * 200, *SMALL]) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_path_that_is_not_utf8(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path) + b"/caf\xe9"
    Path(os.fsdecode(folder)).mkdir()
    Path(os.fsdecode(folder), "v.toml").write_bytes((ROOT / "scenarios/vowel-i.toml").read_bytes())
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYVISTA_OFF_SCREEN": "true"}
    for words in (
        [b"run", folder + b"/v.toml", b"--out", folder + b"/out", *map(str.encode, SMALL)],
        [b"inspect", folder + b"/out/v.vtkhdf", b"--json"],
        [b"report", folder + b"/out/v.vtkhdf"],
        [b"export", folder + b"/out/v.vtkhdf", b"--to", b"csv"],
        [b"resume", folder + b"/out/v"],
    ):
        done = subprocess.run([sys.executable, "-m", "explicitfe", *words], env=environment, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr.decode()


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="needs /proc")
def test_special_files_are_no_results(capsys: pytest.CaptureFixture[str]) -> None:
    """/proc/kmsg is a regular file without size, and reading it waits for the next message of the kernel."""
    for name in ("/proc/kmsg", "/proc/self/maps", "/dev/zero", "/dev/null"):
        if Path(name).exists():
            assert command(["inspect", name]) == 2
            assert "so it is not a result of explicitfe" in capsys.readouterr().err


def test_a_bone_that_is_penetrated_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=60", "--set", "model.damping.alpha_per_s=1000"]
    thrown = ["--set", "model.gravity_m_s2=[0,0,2000]"]  # by two hundred times its weight
    command(["run", "vowel-i", "--out", str(tmp_path), *settings, *thrown])
    assert 'mm deep into "palate" near (' in capsys.readouterr().err
    command(["run", "vowel-i", "--out", str(tmp_path), "--overwrite", *settings])
    assert "mm deep into" not in capsys.readouterr().err
