"""Data of the page of a sweep: runs, factors, measures, outlines, indices and causes of failures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SweepColumn:
    """One factor or one measure of all runs that have a row.

    Attributes
    ----------
    name : name of the column in the table.
    words, unit : label and unit; "" for no unit.
    values : (n,) numbers, NaN if missing; for a factor with texts their indices in ``levels``.
    levels : the texts of a factor; empty for numbers.
    """

    name: str
    words: str
    unit: str
    values: np.ndarray
    levels: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Its words, with the unit in brackets."""
        return f"{self.words} ({self.unit})" if self.unit else self.words


@dataclass(frozen=True, eq=False)
class DrawnMember:
    """The outline of one run in the midsagittal plane, x backwards and z up, mm.

    Attributes
    ----------
    number : of the run.
    outline : (k, 2) closed: the last point joins the first.
    at_rest : (j, 2) the same in the reference state; empty if unknown.
    palate : (p, 2) the midline of the palate; empty if there is none.
    settings : what the run varies, as pairs of words and a value with its unit.
    remark : a warning, or "".
    """

    number: int
    outline: np.ndarray
    at_rest: np.ndarray
    palate: np.ndarray
    settings: list[tuple[str, str]]
    remark: str = ""


@dataclass(frozen=True)
class FactorIndex:
    """What one factor does to a measure: the factor in words, and (value, half width of its 95 % interval) of each index."""

    factor: str
    values: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class MeasureIndices:
    """The indices of one measure in words; ``unit`` is that of elementary effects, and "" for Sobol's shares."""

    measure: str
    unit: str
    factors: list[FactorIndex]


@dataclass(frozen=True)
class SweepCause:
    """A cause of failure: the status, the number of runs, the message and the numbers of the first runs."""

    status: str
    count: int
    message: str
    members: list[int]


@dataclass(frozen=True, eq=False)
class SweepToDraw:
    """Content of the page of a sweep.

    Attributes
    ----------
    title, scenario, folder : title and file of the scenario, and folder of the sweep.
    design : such as "60 random samples".
    members, stored : number of runs, and of those that have a row.
    is_balanced : whether factors were drawn independently or in all combinations, so that shares of the variance add up.
    warned : number of finished runs with warnings.
    member_s : (n,) duration of each run [s]; NaN if unknown.
    numbers, statuses : (n,) of the runs that have a row.
    finished : status of a finished run.
    factors, measures : the columns; ``checks`` are those that show whether a run is reliable.
    main_measures : names of the main measures in decreasing order of importance.
    drawn : individual runs; ``outlines`` are those of the overlay, (k, 2) mm each.
    outlines_of : number of runs with an outline.
    indices : sensitivity indices of the main measures; ``indices_note`` explains missing ones.
    causes : causes of failures.
    commands : commands that repeat the sweep, one run, and this page.
    facts : further facts as pairs.
    """

    title: str
    scenario: str
    folder: str
    design: str
    members: int
    stored: int
    is_balanced: bool
    warned: int
    member_s: np.ndarray
    numbers: np.ndarray
    statuses: list[str]
    finished: str
    factors: list[SweepColumn]
    measures: list[SweepColumn]
    checks: list[SweepColumn]
    main_measures: list[str]
    drawn: list[DrawnMember]
    outlines: list[np.ndarray]
    outlines_of: int
    indices: list[MeasureIndices]
    indices_note: str
    causes: list[SweepCause]
    commands: list[str]
    facts: list[tuple[str, str]]

    @property
    def shown_measures(self) -> list[SweepColumn]:
        """The main measures that the sweep has, in their order."""
        by_name = {measure.name: measure for measure in self.measures}
        return [by_name[name] for name in self.main_measures if name in by_name]
