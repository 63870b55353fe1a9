"""``explicitfe doctor`` says what a machine has and what it lacks."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from answers import check_answer
from command import command

from explicitfe.app.tools import doctor
from explicitfe.app.view import opengl
from explicitfe.platform.host import code_cache
from explicitfe.results.documents.examination import Finding


@pytest.fixture
def renders(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "tried_renderer", lambda: opengl.Renderer("a card", "", 0.5))


def named(folder: Path = Path()) -> dict[str, Finding]:
    return {one["name"]: one for one in doctor.examine(folder)["findings"]}


def test_its_answer_fits_its_schema(renders: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["doctor", "--json"]) == 0
    answer = check_answer("doctor", capsys.readouterr().out)
    names = [one["name"] for one in answer["findings"]]
    assert names[:5] == ["explicitfe", "python", "libraries", "system", "cores"]
    assert {"memory", "results", "compiled kernels", "[view]", "[plots]", "[parquet]", "3D"} <= set(names)
    assert command(["doctor"]) == 0
    assert "a card" in capsys.readouterr().out


def test_a_busy_machine_is_noticed(renders: None, monkeypatch: pytest.MonkeyPatch) -> None:
    cores = os.cpu_count() or 1
    monkeypatch.setattr(os, "getloadavg", lambda: (0.9 * cores, 0.0, 0.0), raising=False)
    assert named()["load"]["state"] == "attention" and "bench" in named()["load"]["advice"]
    monkeypatch.setattr(os, "getloadavg", lambda: (0.1 * cores, 0.0, 0.0), raising=False)
    assert named()["load"]["state"] == "good"


def test_what_is_missing_is_said_with_what_to_do(renders: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "has_extra", lambda extra: False)
    monkeypatch.setattr(doctor, "available_bytes", lambda: 1e9)
    for module in (doctor, code_cache):
        monkeypatch.setattr(module, "can_write", lambda folder: False)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    findings = named(tmp_path)
    assert 'pip install ".[view]"' in findings["[view]"]["advice"]
    assert findings["3D"]["state"] == "absent"
    assert {name for name, one in findings.items() if one["state"] == "attention"} >= {"memory", "results", "compiled kernels"}
    assert "temporary folder" in findings["compiled kernels"]["value"]
    assert "NUMBA_CACHE_DIR" in findings["compiled kernels"]["advice"]
    monkeypatch.setattr(doctor, "temporary_folder", lambda: None)
    assert named(tmp_path)["compiled kernels"]["value"] == "no folder can be written"


def test_the_folder_of_machine_code_is_that_of_the_environment(
    renders: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    advice = named()["compiled kernels"]["advice"]
    assert "warmup" in advice and re.search(r"about \d*[05] s more on this machine", advice)
    (tmp_path / "kernel.nbi").write_bytes(b"x" * 2_000_000)
    assert named()["compiled kernels"]["value"] == f"2 MB in {tmp_path}"


@pytest.mark.parametrize(
    ("program", "reason"),
    [("raise SystemExit('no display')", "no display"), ("import os; os.abort()", "exit code"), ("input()", "EOF")],
)
def test_a_renderer_that_crashes_takes_nothing_with_it(
    program: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "python"
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{program}"\n', encoding="utf-8")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    assert reason in opengl.tried_renderer().why_not
