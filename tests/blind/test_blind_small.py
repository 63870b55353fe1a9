"""A small blind set: data of other numerics with nothing, one effect or two hidden in them, through the whole loop.

What the tool says is compared with what was sealed before. Seven cases prove no rate; they show that the chain holds together and
that nothing of it is confidently wrong here. The study with its rates is benchmarks/blind_study.py.
"""

from __future__ import annotations

from pathlib import Path

from explicitfe.blind.make import make
from explicitfe.blind.score import score

SEED = 12


def test_a_small_set(tmp_path: Path) -> None:
    make(tmp_path / "cases", seed=SEED, kinds={"control": 3, "single": 4}, family="homogeneous")
    found = score(tmp_path / "cases", processes=2)
    outcomes = {case["case"]: (case["kind"], case["outcome"], case["true"]) for case in found["cases"]}
    assert len(outcomes) == 7
    assert all(outcome == "no-missing-effect" for kind, outcome, _ in outcomes.values() if kind == "control"), outcomes
    assert not any(outcome in ("confidently wrong", "failed") for _, outcome, _ in outcomes.values()), outcomes
    assert sum(outcome == "right" for _, outcome, _ in outcomes.values()) >= 2, outcomes
    assert (tmp_path / "cases" / "score.md").is_file() and (tmp_path / "cases" / "confusion.png").is_file()
