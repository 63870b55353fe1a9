"""Blind studies that are killed go on where they were: nothing twice, nothing half, and in the end the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from killing import killed_at
from support import ROOT

from explicitfe.platform.errors import InputError
from studies.blind import score as scoring
from studies.blind.__main__ import main
from studies.blind.make import make
from studies.blind.score import score

pytestmark = pytest.mark.slow

KINDS = {"control": 2}
STUDY = f"""
from pathlib import Path
import sys
from studies.blind.make import make
from studies.blind.score import score

if __name__ == "__main__":
    study = Path(sys.argv[1])
    make(study, seed=3, kinds={KINDS})
    score(study, processes=1, max_effects=0, pages=False)
"""


def contents(folder: Path) -> dict[str, object]:
    """The bytes of all files; of JSON what it holds, without when and where it was computed, and for how long."""
    files: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            name = path.relative_to(folder).as_posix()
            files[name] = _timeless(json.loads(path.read_text())) if path.suffix == ".json" else path.read_bytes()
    # The line about seconds.
    files.pop("score.md", None)
    return files


def _timeless(value: object) -> object:
    if isinstance(value, dict):
        return {key: _timeless(inner) for key, inner in value.items() if key not in ("wall_s", "seconds", "provenance")}
    return [_timeless(inner) for inner in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that nobody interrupts."""
    study = tmp_path_factory.mktemp("blind") / "study"
    make(study, seed=3, kinds=KINDS)
    score(study, processes=2, max_effects=0, pages=False)
    return study


def reached(study: Path, cases: int, reports: int) -> bool:
    """Whether a study has come so far."""
    made, closed = (len(list(study.glob(pattern))) for pattern in ("cases/case-*", "reports/case-*/report.json"))
    return made >= cases and closed >= reports


@pytest.mark.parametrize(("cases", "reports"), [(1, 0), (2, 1)])
def test_a_killed_study_ends_the_same(cases: int, reports: int, whole: Path, tmp_path: Path) -> None:
    study, script = tmp_path / "study", tmp_path / "study.py"
    script.write_text(STUDY)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    killed = subprocess.Popen([sys.executable, script, study], env=environment, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60.0
    while not reached(study, cases, reports) and killed.poll() is None and time.monotonic() < end:
        time.sleep(0.002)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert not (study / "score.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in [*study.glob("cases/case-*"), *study.glob("reports/case-*/report.json")]}
    make(study, seed=3, kinds=KINDS)
    score(study, processes=2, max_effects=0, pages=False)
    assert contents(study) == contents(whole)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept, "a finished case was computed again"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_every_instant_of_the_making(whole: Path, tmp_path: Path) -> None:
    """Whenever it is killed, the same command ends with the same bytes, and with nothing else in the folder."""
    scored = ("reports", "score", "confusion", "reliability")
    wanted = {name: file for name, file in contents(whole).items() if not name.startswith(scored)}
    instant = 0
    while True:
        study = tmp_path / f"{instant}"
        killed = killed_at(instant, lambda study=study: make(study, seed=3, kinds=KINDS))
        for path in study.rglob(".*.part"):  # What stands empty may be of a process that is just about to lock it.
            os.utime(path, (0, 0))
        make(study, seed=3, kinds=KINDS)
        assert contents(study) == wanted
        assert not list(study.rglob(".*"))
        if not killed:
            break
        instant += 1
    assert instant > 20


def test_what_is_half_written_is_not_taken_for_a_case(whole: Path, tmp_path: Path) -> None:
    make(tmp_path / "study", seed=3, kinds=KINDS)
    half = tmp_path / "study" / "cases" / ".case-0002.abcdefgh.part"
    (tmp_path / "study" / "cases" / "case-0002").rename(half)
    (half / "dataset.toml").unlink()
    with pytest.raises(InputError, match="1 of 2 cases exist; create the others"):
        score(tmp_path / "study")
    make(tmp_path / "study", seed=3, kinds=KINDS)
    assert not half.exists()
    made = contents(tmp_path / "study")
    assert made == {name: file for name, file in contents(whole).items() if name in made}


def test_two_commands_in_one_folder(whole: Path) -> None:
    with (
        scoring.alone_in(whole),
        pytest.raises(InputError, match="another command is using this folder"),
    ):
        make(whole, seed=3, kinds=KINDS)


def test_a_study_of_another_seed_is_kept(whole: Path) -> None:
    before = contents(whole)
    for seed, kinds in ((6, KINDS), (3, {"single": 2})):
        with pytest.raises(InputError, match="contains 2 cases of the family homogeneous with seed 3"):
            make(whole, seed=seed, kinds=kinds)
    make(whole, seed=3, kinds=KINDS)
    assert contents(whole) == before


def test_damaged_files_are_named(tmp_path: Path) -> None:
    study = tmp_path / "study"
    make(study, seed=3, kinds={"control": 1})
    report = study / "reports" / "case-0001" / "report.json"
    report.parent.mkdir(parents=True)
    report.write_text('{"verdict": "unexplained"}')
    sealed = study / "sealed" / "case-0001.json"
    truth = sealed.read_text()
    for text, words in ((truth[:100], "not valid JSON"), ("{}", "is missing"), ("[]", "is missing")):
        sealed.write_text(text)
        with pytest.raises(InputError, match=words) as caught:
            score(study)
        assert "case-0001.json" in str(caught.value)
    sealed.unlink()
    with pytest.raises(InputError, match="No such file"):
        score(study)
    sealed.write_text(truth)
    (study / "made.json").write_text("{}")
    with pytest.raises(InputError, match=r"made.json: the key"):
        make(study, seed=3, kinds={"control": 1})


OPTIONS = [
    (["--seed", "-1"], "seed = -1 is out of range"),
    (["--seed", "9" * 30], "seed = 9"),
    (["--seed", "1", "--count", "0"], "count = 0 is out of range"),
    (["--seed", "1", "--count", "1000000000"], "from 1 to 9999"),
    (["--seed", "1", "--family", "homogenous"], 'did you mean "homogeneous"?'),
]


@pytest.mark.parametrize(("options", "words"), OPTIONS, ids=[" ".join(options)[:30] for options, _ in OPTIONS])
def test_options_that_cannot_be(options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make", str(tmp_path / "study"), *options]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "study").exists()


def test_folders_that_cannot_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("x")
    long = tmp_path / ("x" * 300)
    for folder, words in (
        (tmp_path / "file", "is a file"),
        (tmp_path / "file" / "in", "Not a directory"),
        (tmp_path, "contains other files"),
        (long, "too long"),
    ):
        assert main(["make", str(folder), "--seed", "1"]) == 2
        assert words in capsys.readouterr().err
    for folder in (tmp_path, tmp_path / "none", tmp_path / "file", long):
        assert main(["score", str(folder)]) == 2
        assert "this folder contains no cases" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
