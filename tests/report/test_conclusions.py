"""Conclusions in one line, and words that depend on what was simulated."""

from __future__ import annotations

from typing import Any

import pytest

from explicitfe.app.view.page.close_loop.parts import hypotheses
from explicitfe.app.view.page.words import smooth_part, worth_of
from explicitfe.results.documents.identification import IdentifiedGroup, headline
from explicitfe.results.documents.loop_report import LoopReport, NextExperiment


def group(**changes: Any) -> IdentifiedGroup:
    given: dict[str, Any] = {"status": "fitted", "law": "yeoh", "constants": {"C10_Pa": {"value": 700.0, "ci95": [630.0, 770.0]}}}
    return given | changes  # type: ignore[return-value]


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({}, "C10 is 700 Pa ± 10 % (95 %)"),
        ({"constants": {"C10_Pa": {"value": 700.0}}}, "C10 is 700 Pa"),
        (
            {"hides": [{"if": "gravity", "C10_change": 0.04}, {"if": "sticking contact", "C10_change": -0.18}]},
            "C10 is 700 Pa ± 10 % (95 %), and 18 % lower with sticking contact",
        ),
        (
            {"laws": [{"law": "yeoh", "aicc_difference": 80.8}, {"law": "ogden-1", "aicc_difference": 0.0}]},
            "C10 is 700 Pa ± 10 % (95 %); the data support the law ogden-1 more",
        ),
        ({"undetermined": ["C20_Pa"]}, "Do not use the constants: these data do not determine C20"),
    ],
)
def test_the_conclusion_of_a_fit(changes: dict[str, Any], expected: str) -> None:
    assert headline(group(**changes)) == expected


def test_no_constants() -> None:
    assert headline({"status": "failed", "message": "it did not settle."}) == "No constants could be determined"


def test_a_set_of_causes_within_another_one_is_alone() -> None:
    test = NextExperiment(separates=["viscoelastic", "viscoelastic + softening"], separation=2116.0)
    assert worth_of(test) == 'separates "viscoelastic alone" from "viscoelastic plus softening" (by 46 standard deviations)'


def test_the_smooth_part_of_a_residual() -> None:
    report = LoopReport(discrepancy=0.0, lack_of_fit={"chi2": 10.2, "free": 22, "p": 0.98})  # type: ignore[arg-type]
    assert smooth_part(report) == "No smooth misfit remains after the fit (χ² = 10.2 for 22 functions, p = 0.98)."


def test_hypotheses_after_the_tenth_are_in_a_table_of_their_own() -> None:
    report = LoopReport(hypotheses=[{"effects": ["softening"], "fitted": True}] * 12)  # type: ignore[list-item]
    assert [len(shown.rows) for shown in hypotheses(report) if shown] == [10, 2]
    assert hypotheses(LoopReport()) == []
