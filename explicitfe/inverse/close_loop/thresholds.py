"""The numbers that decide a verdict, each with its unit and the experiment or the reason that fixed it.

They are stored in ``report.json``; docs/reference/close-loop-thresholds.md prints them. Numbers that only steer a computation,
such as steps of derivatives, stay beside the code that uses them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TypeVar

Number = TypeVar("Number", int, float)


def threshold(value: Number, unit: str, reason: str) -> Number:
    """An entry of the table."""
    return field(default=value, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class Thresholds:
    """The table; :func:`entries` gives unit and reason of each entry."""

    # ---- the verdict ----
    decisive_probability: float = threshold(
        0.9,
        "probability",
        "A cause is named from this probability on, and a candidate counts as detectable if its largest plausible strength could "
        "reach it. Users act on one verdict in ten being wrong at most.",
    )
    credible_set: float = threshold(
        0.95, "probability", "An ambiguous verdict lists the smallest collection of sets of causes with this probability."
    )
    majority_probability: float = threshold(
        0.5, "probability", "The verdict is unexplained if something that no candidate describes is more probable than this."
    )
    form_error_odds: float = threshold(
        0.3,
        "odds",
        "Prior odds that the best form of a cause is not exact: about one measured material in four of those in the studies.",
    )
    something_else_odds: float = threshold(
        0.1, "odds", "Prior odds that something is present that no candidate describes: about what measured data sets have shown."
    )
    larger_noise_odds: float = threshold(
        0.1,
        "odds",
        "Prior odds that the noise of the rows is larger than the dataset says: sources state that of the sensor, and rows also "
        "scatter by friction of the drive, rounding and cycles that differ.",
    )
    negligible_probability: float = threshold(
        0.05,
        "probability relative to the best",
        "A hypothesis that its signatures cannot bring nearer to the best one is not fitted: it keeps the evidence of its "
        "screening, which is linear in the strengths and right to some tenths for effects so weak.",
    )
    # ---- noise ----
    stated_noise_factor: float = threshold(
        1.6,
        "times the stated noise",
        "Rows that differ by more are rougher than the dataset says, and their noise is estimated instead. Thirty rows with the "
        "stated noise look rougher than this in one case of a hundred.",
    )
    unknown_noise_share: float = threshold(
        0.01,
        "share of a curve's largest value",
        "Noise where none is stated and the protocol bends at every row, so that nothing shows it: load cells and digitised "
        "curves are seldom worse. It is also the scatter of a motion that was not repeated: repeats of a silicone beam differ by "
        "0.7 %, and a beam and a solid of the same constants by 0.5 %.",
    )
    specimen_spread: float = threshold(
        0.2,
        "standard deviation of the log of stiffness",
        "Specimens that differ by less are served by one set of constants and a scatter of tests.",
    )
    assumed_length_error_share: float = threshold(
        0.1, "share of a length", "Standard deviation of a length that the source does not state: it is read off pictures."
    )
    stated_length_error_share: float = threshold(
        0.003, "share of a length", "Standard deviation of a stated length: a calliper gives 0.05 mm in twenty."
    )
    # ---- numerics ----
    numerics_bound_share: float = threshold(
        0.3,
        "share of the noise",
        "Where the numerical error is larger and the verdict depends on it, the verdict is limited by numerics.",
    )
    # ---- the split ----
    held_out_share: float = threshold(1.0 / 3.0, "share of the tests", "Enough to check a prediction; most tests are fitted.")
    fitted_curves_under_a_tool: int = threshold(6, "curves", "A bound on the time: each costs seconds for every model.")


THRESHOLDS = Thresholds()


def entries() -> list[tuple[str, float, str, str]]:
    """Name, value, unit and reason of each threshold."""
    return [(f.name, getattr(THRESHOLDS, f.name), f.metadata["unit"], f.metadata["reason"]) for f in fields(THRESHOLDS)]


def markdown_table() -> str:
    """The table of docs/reference/close-loop-thresholds.md."""
    rows = [f"| `{name}` | {value:.3g} | {unit} | {reason} |" for name, value, unit, reason in entries()]
    return "\n".join(["| threshold | value | unit | reason |", "|---|---|---|---|", *rows]) + "\n"
