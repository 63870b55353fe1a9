"""Sentences and tables of the page of a closed loop."""

from __future__ import annotations

from explicitfe.app.view.page.close_loop.parts import hypotheses
from explicitfe.app.view.page.words import smooth_part, worth_of
from explicitfe.results.documents.loop_report import LoopReport, NextExperiment


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
