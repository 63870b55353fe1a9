"""Data of the page of a sweep, read from its folder: columns, outlines, indices and causes of failures."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from explicitfe.platform.errors import InputError, Progress, silent
from explicitfe.platform.host.shipped import name_of
from explicitfe.platform.host.text import json_of, text_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.results.documents.sweep_to_draw import FactorIndex, MeasureIndices, SweepCause, SweepColumn, SweepToDraw
from explicitfe.results.documents.sweep_words import factors_in_words, measure_in_words
from explicitfe.results.files import FINISHED
from explicitfe.simulate.sweep.definition import ROWS_FOLDER, members_of
from explicitfe.simulate.sweep.journal import Stored
from explicitfe.simulate.sweep.members import LARGEST_TABLE_OF_MEMBERS_BYTES
from explicitfe.simulate.sweep.outlines import drawn_members, many_outlines, outline_of
from explicitfe.simulate.sweep.repeating import BegunSweep, begun_sweep, commands_of, design_in_words
from explicitfe.simulate.sweep.rows import BESIDE_THE_TABLE, MEMBER_S, MESSAGE, NAME, NUMBER, STATUS, cause_of, number_of
from explicitfe.simulate.sweep.sensitivity import ABOUT_THE_RUN, Index, MeasureSensitivity, Sensitivity
from explicitfe.simulate.sweep.sweep import SENSITIVITY_FILE

# Main measures of a tongue in decreasing order of importance; without them the page shows the first columns of numbers.
MAIN_MEASURES = (
    "points.tip.up_mm",
    "points.tip.forward_mm",
    "points.dorsum.up_mm",
    "points.dorsum.forward_mm",
    "constriction.width_mm",
    "constriction.place_mm",
    "grooves.front.depth_mm",
    "grooves.dorsum.depth_mm",
    "grooves.back.depth_mm",
    "contact.palate.area_mm2",
    "contact.jaw.area_mm2",
    "highest.up_mm",
)
MOST_MAIN_MEASURES = 12
# They show whether a run is reliable, and are listed separately.
CHECKS = ("steps", "energy_balance_error", "hourglass_share", "min_J", "folded_elements", "warnings")
# Their runs share values of factors; sensitivity indices replace the shares of variance.
DESIGNS_IN_GROUPS = ("sobol", "morris")
# A column whose numbers are all below this, or vary by less than this share of their size, contains rounding errors only.
SMALLEST_NUMBER_SHOWN, SMALLEST_SHOWN_SPREAD_SHARE = 1e-9, 1e-9
MOST_MEMBERS_NAMED_PER_CAUSE = 20


def sweep_to_draw(folder: Path, progress: Progress = silent) -> SweepToDraw:
    """The stored part of the sweep in a folder.

    Raises
    ------
    InputError : the folder contains no sweep, a damaged one, or no rows.
    """
    begun, members = begun_sweep(folder), members_of(folder)
    progress("draw", 0.0)
    stored = Stored(folder / ROWS_FOLDER, len(members))
    numbers = sorted(stored.places)
    if not numbers:
        raise InputError(f"{folder}: no run of this sweep is finished yet. Rerun the command of the sweep to resume it.")
    rows = rows_together(stored, numbers)
    progress("draw", 0.5)
    factors = factor_columns(members.keys, [members.values[number] for number in numbers])
    measures = [column for column in rows.columns if column.name not in CHECKS]
    finished = [place for place, status in enumerate(rows.statuses) if status == FINISHED]
    outlined = [place for place in finished if rows.has_outline[place]]
    of_outlined = [numbers[place] for place in outlined]
    main = main_measures(measures)
    drawn = drawn_members(begun, members, stored, of_outlined, [_at(factor, outlined) for factor in factors])
    progress("draw", 0.9)
    indices, note = _indices(folder, begun, main)
    shown = drawn[0].number if drawn else numbers[finished[0]] if finished else None
    return SweepToDraw(
        title=_title(begun),
        scenario=name_of(begun.scenario),
        folder=str(folder),
        design=design_in_words(begun),
        members=len(members),
        stored=len(numbers),
        is_balanced=begun.design not in DESIGNS_IN_GROUPS,
        warned=int(np.count_nonzero(rows.warnings[finished] > 0.0)),
        member_s=rows.member_s,
        numbers=np.array(numbers),
        statuses=rows.statuses,
        finished=FINISHED,
        factors=factors,
        measures=measures,
        checks=[column for column in rows.columns if column.name in CHECKS],
        main_measures=main,
        drawn=drawn,
        outlines=many_outlines(stored, of_outlined),
        outlines_of=len(outlined),
        indices=indices,
        indices_note=note,
        causes=rows.causes,
        commands=commands_of(folder, begun, members, shown),
        facts=[("version", begun.version), ("folder", str(folder)), ("measures", ", ".join(begun.measures))],
    )


def factor_columns(keys: Sequence[str], values: Sequence[Sequence[object]]) -> list[SweepColumn]:
    """One column per varied key with the values of each run; values that are no numbers become levels."""
    columns = []
    for key, (words, unit), cells in zip(keys, factors_in_words(keys), zip(*values, strict=True), strict=True):
        if all(isinstance(cell, (int, float)) and not isinstance(cell, bool) for cell in cells):
            columns.append(SweepColumn(key, words, unit, np.array(cells, dtype=float)))
            continue
        texts = [cell if isinstance(cell, str) else toml_value(cell) for cell in cells]
        levels = tuple(dict.fromkeys(texts))
        place = {level: number for number, level in enumerate(levels)}
        columns.append(SweepColumn(key, words, unit, np.array([place[text] for text in texts], dtype=float), levels))
    return columns


@dataclass(frozen=True, eq=False)
class RowsTogether:
    """Data of all rows that the page needs, in the order of the runs.

    Attributes
    ----------
    columns : all numbers that vary, in the order of their first occurrence.
    statuses : of the runs.
    member_s, warnings : (n,) duration [s] and number of warnings of each run; NaN where unknown.
    has_outline : (n,) whether a run has an outline.
    causes : causes of failures in decreasing frequency.
    """

    columns: list[SweepColumn]
    statuses: list[str]
    member_s: np.ndarray
    warnings: np.ndarray
    has_outline: np.ndarray
    causes: list[SweepCause]


def rows_together(stored: Stored, numbers: Sequence[int]) -> RowsTogether:
    """Read the rows of some runs, each once."""
    left_out = {NUMBER, NAME, STATUS, MESSAGE, *BESIDE_THE_TABLE}
    names = [*(name for name in stored.names() if name not in left_out), MEMBER_S]
    place_of = {name: place for place, name in enumerate(names)}
    values = np.full((len(names), len(numbers)), np.nan)
    has_outline = np.zeros(len(numbers), dtype=bool)
    statuses: list[str] = []
    causes: dict[tuple[str, str], SweepCause] = {}
    for at, row in enumerate(stored.rows(numbers)):
        status = str(row[STATUS])
        statuses.append(status)
        for name, cell in row.items():
            if name in place_of and isinstance(cell, (int, float)) and not isinstance(cell, bool):
                values[place_of[name], at] = cell
        has_outline[at] = len(outline_of(row)) > 0
        if status != FINISHED:
            message = str(row.get(MESSAGE, ""))
            cause = causes.setdefault((status, cause_of(message)), SweepCause(status, 0, message, []))
            which = [*cause.members, number_of(row)][:MOST_MEMBERS_NAMED_PER_CAUSE]
            causes[status, cause_of(message)] = replace(cause, count=cause.count + 1, members=which)
    columns = [SweepColumn(name, *measure_in_words(name), values[place]) for name, place in place_of.items() if name != MEMBER_S]
    unknown = np.full(len(numbers), np.nan)
    return RowsTogether(
        [column for column in columns if _varies(column.values)],
        statuses,
        values[place_of[MEMBER_S]],
        values[place_of["warnings"]] if "warnings" in place_of else unknown,
        has_outline,
        sorted(causes.values(), key=lambda cause: -cause.count),
    )


def _varies(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    largest = float(np.abs(known).max(initial=0.0))
    return largest > SMALLEST_NUMBER_SHOWN and float(np.ptp(known)) > SMALLEST_SHOWN_SPREAD_SHARE * largest


def main_measures(measures: Sequence[SweepColumn]) -> list[str]:
    """Names of the main measures; for another body those of the first measures that vary."""
    names = [measure.name for measure in measures]
    known = [name for name in MAIN_MEASURES if name in names]
    others = [name for name in names if name not in ABOUT_THE_RUN]
    return (known or others)[:MOST_MAIN_MEASURES]


def _indices(folder: Path, begun: BegunSweep, main: Sequence[str]) -> tuple[list[MeasureIndices], str]:
    """The indices of the main measures, and a note."""
    if begun.design not in DESIGNS_IN_GROUPS:
        return [], ""
    path = folder / SENSITIVITY_FILE
    if not path.exists():
        return [], "The indices are computed when all runs have finished."
    text = text_of(path, "give the folder of a sweep", largest_bytes=LARGEST_TABLE_OF_MEMBERS_BYTES)
    try:
        sensitivity = TypeAdapter(Sensitivity).validate_python(json_of(text, path))
    except ValidationError:
        raise InputError(f"{path}: this file is damaged. Delete it, and rerun the command of the sweep.") from None
    by_name = {entry["measure"]: entry for entry in sensitivity["measures"]}
    left_out = sensitivity["members_left_out"]
    note = f"{left_out} runs are not used, because a run of their group did not finish." if left_out else ""
    words = dict(zip(begun.keys, factors_in_words(begun.keys), strict=True))
    return [_measure_indices(by_name[name], words) for name in main if name in by_name], note


def _measure_indices(entry: MeasureSensitivity, words: Mapping[str, tuple[str, str]]) -> MeasureIndices:
    factors: dict[str, dict[str, tuple[float, float]]] = {}
    kinds: dict[str, list[Index]] = {"total": entry["total"], "first": entry["first"], "effect": entry["effect"]}
    for kind, indices in kinds.items():
        for index in indices:
            factors.setdefault(index["factor"], {})[kind] = (index["value"], index["half_width"])
    name, unit = measure_in_words(entry["measure"])
    ordered = [FactorIndex(words.get(factor, (factor, ""))[0], values) for factor, values in factors.items()]
    return MeasureIndices(f"{name} ({unit})" if unit else name, unit if entry["effect"] else "", ordered)


def _title(begun: BegunSweep) -> str:
    try:
        title = tomllib.loads(begun.scenario_text).get("title")
    except tomllib.TOMLDecodeError:  # one in JSON has none
        title = None
    return title if isinstance(title, str) and title else Path(begun.scenario).stem


def _at(factor: SweepColumn, places: Sequence[int]) -> SweepColumn:
    return SweepColumn(factor.name, factor.words, factor.unit, factor.values[list(places)], factor.levels)
