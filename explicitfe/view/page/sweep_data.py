"""What the page of a sweep is drawn from: members, factors, measures, outlines, indices and causes, as arrays and words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SweepColumn:
    """One factor or one measure of all members that have a row.

    Attributes
    ----------
    name : as the table of the sweep has it.
    words, unit : how people call it; a unit of "" is none.
    values : (n,) numbers, NaN where there is none; of a factor with words their places in ``levels``.
    levels : what a factor is where that is no number; empty for numbers.
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
    """The outline of one member in the midsagittal plane, x backwards and z up, mm.

    Attributes
    ----------
    number : of the member.
    outline : (k, 2) closed: the last point joins the first.
    at_rest : (j, 2) the same before anything pulls; empty where that is not known.
    palate : (p, 2) the midline of the palate; empty where there is none.
    settings : what the member varies, as pairs of words and a value with its unit.
    remark : what to know before its outline is believed; "": nothing.
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
    """Why some members did not finish: their status, how many, what the first of them says, and the first numbers."""

    status: str
    count: int
    message: str
    members: list[int]


@dataclass(frozen=True, eq=False)
class SweepToDraw:
    """A sweep as its page shows it.

    Attributes
    ----------
    title, scenario, folder : of the scenario, its file, and where the sweep is.
    design : what the members are, such as "60 random draws".
    members, stored : how many there are to be, and how many have a row.
    is_balanced : whether factors were drawn independently or in all combinations, so that shares of the variance add up.
    warned : how many of those that finished have something to warn of.
    member_s : (n,) s that each took; NaN where that is not known.
    numbers, statuses : (n,) of the members that have a row, and how each ended.
    finished : what the status of a member is that came to its end.
    factors, measures : the columns; ``checks`` are those that say whether to believe the others.
    main_measures : names of the measures that matter most, first the first.
    drawn : members spread over the sweep; ``outlines`` are those of many members, (k, 2) mm each.
    outlines_of : of how many members outlines are known.
    indices : of a sensitivity analysis, of the measures that matter most; ``indices_note`` says where there are none yet.
    causes : why members did not finish.
    commands : what repeats the sweep, one member, and this page.
    facts : what else is to be known of it, as pairs.
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
