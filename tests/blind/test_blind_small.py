"""A small blind set through the whole loop: data made with other numerics, with no effect or one effect hidden in them.

The verdicts are compared with the sealed truth. Seven cases prove no rate; they show that the chain works and that no verdict
is confidently wrong here. The study with its rates is studies/benchmarks/blind_study.py. It is slow: about 20 s on two
cores, and longer where kernels have to be compiled first.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from explicitfe.app.view.json_text import json_text
from studies.blind.make import make
from studies.blind.score import StudyScore, score

pytestmark = pytest.mark.slow

SEED = 12


def test_a_small_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # The processes are the parallel part.
    make(tmp_path / "cases", seed=SEED, kinds={"control": 3, "single": 4}, family="homogeneous", processes=2)
    result = score(tmp_path / "cases", processes=2, pages=False)
    TypeAdapter(StudyScore).validate_python(json.loads(json_text(result)))
    outcomes = {case["case"]: (case["kind"], case["outcome"], case["true"]) for case in result["cases"]}
    assert len(outcomes) == 7
    assert all(outcome == "no-missing-effect" for kind, outcome, _ in outcomes.values() if kind == "control"), outcomes
    assert not any(outcome in ("confidently wrong", "failed") for _, outcome, _ in outcomes.values()), outcomes
    assert sum(outcome == "right" for _, outcome, _ in outcomes.values()) >= 2, outcomes
    assert (tmp_path / "cases" / "score.md").is_file() and (tmp_path / "cases" / "confusion.png").is_file()
