"""Whether verdicts are as often right as they say: bins of cases whose outcome is known."""

from __future__ import annotations

import pytest

from studies.blind.reliability import is_right, reliability, reliability_lines, reliability_picture

pytestmark = pytest.mark.slow


def scored(sure: float | None, outcome: str, kind: str = "single", **more) -> dict:
    separation = {"baseline": 100.0, "rivals": {"viscoelastic": 3.0}, "nearest": "viscoelastic"} | more
    truth = {"kind": kind, "separation": None if kind == "control" else separation}
    return {"case": "case-0001", "truth": truth, "outcome": outcome, "report": {"sure": sure, "effects": ["viscoelastic"]}}


def test_what_counts_as_right():
    assert is_right(scored(0.9, "right")) and is_right(scored(0.9, "no-missing-effect", "control"))
    assert not is_right(scored(0.9, "confidently wrong")) and not is_right(scored(0.9, "effect-found", "control"))
    # What the data cannot show is not there for them: a single below 25 of the baseline, one of two that the other stands for.
    assert is_right(scored(0.9, "missed", baseline=24.0)) and not is_right(scored(0.9, "missed", baseline=26.0))
    assert is_right(scored(0.9, "one, said to be all", "double"))
    assert not is_right(scored(0.9, "one, said to be all", "double", rivals={"viscoelastic": 30.0}))
    assert is_right(scored(0.9, "unexplained", "outside")) and not is_right(scored(0.9, "unexplained"))


def test_bins():
    """Of eight verdicts at 0.75 six are right, a certain one is in the last bin, and one without a probability in none."""
    rows = [scored(0.75, "right" if k < 6 else "confidently wrong") for k in range(8)]
    bins = reliability([*rows, scored(1.0, "right"), scored(None, "failed")])
    assert [one["cases"] for one in bins] == [0] * 7 + [8, 0, 1]
    assert bins[7]["right"] == 0.75 and bins[7]["mean_probability"] == 0.75
    # Clopper and Pearson: 6 of 8 is between 0.349 and 0.968.
    assert bins[7]["ci95"] == pytest.approx([0.349, 0.968], abs=5e-4)
    lines = reliability_lines(bins)
    assert lines[-2] == "| 0.7 to 0.8 | 8 | 0.75 | 0.75 | 0.35 to 0.97 | yes |"
    assert reliability_picture(bins).startswith(b"\x89PNG")
    assert reliability_lines(reliability([scored(None, "failed")])) == []
