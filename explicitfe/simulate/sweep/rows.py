"""The row of a run: computed from its settings and nothing else."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.platform.errors import InputError, MachineError, RunError, silent
from explicitfe.platform.host.files import REFUSALS, reason
from explicitfe.results.documents.run_summary import IndentationSummary, TransientSummary
from explicitfe.results.files import FINISHED, Recorded, ResultInMemory
from explicitfe.results.measure.contact import contacts
from explicitfe.results.measure.formants import airway_of
from explicitfe.results.measure.leak import leak
from explicitfe.results.measure.measure import constriction_of
from explicitfe.results.measure.motion import body_motion, point_motions
from explicitfe.results.measure.numbers import flat, numbers_of_curve
from explicitfe.results.measure.palatogram import palatogram
from explicitfe.results.measure.reactions import reactions
from explicitfe.results.measure.sections import X, Z, midsagittal
from explicitfe.results.measure.shape import grooves, highest_point
from explicitfe.results.measure.steps import last_step
from explicitfe.simulate.run.prepare import analysis_of
from explicitfe.simulate.scenario.read import scenario_in
from explicitfe.simulate.scenario.transient import TransientScenario
from explicitfe.simulate.sweep.own_measure import OwnMeasure

Cell = float | int | bool | str | list[int] | None
Row = dict[str, Cell]

# Statuses of a run that the simulation did not set.
REFUSED, FAULT, LOST, FAILED = "refused", "fault", "lost", "failed"
WITHOUT_RESULT = (REFUSED, FAULT, LOST, FAILED)
NUMBER, NAME, STATUS, MESSAGE = "member", "name", "status", "message"
MEMBER_S, COURSE_S = "member_s", "course_s"  # of the whole run, and of time steps, stability checks and samples alone
CONTOUR = "contour"
CONTOUR_UNIT_M = 1e-5
# Columns of rows that a table omits: times, which differ on each computation, and the outline.
BESIDE_THE_TABLE = ("wall_s", COURSE_S, MEMBER_S, CONTOUR)
# Groups of measures of a run in time; docs/reference/measures.md defines each number.
PARTS: dict[str, Callable[[Recorded, int], object]] = {
    "points": point_motions,
    "highest": lambda result, step: highest_point(result.mesh, result.displacement(step)),
    "grooves": lambda result, step: grooves(result.mesh, result.displacement(step)),
    "constriction": constriction_of,
    "contact": contacts,
    "reactions": reactions,
    "body": body_motion,
    "palatogram": palatogram,
    "leak": leak,
    "airway": airway_of,
    CONTOUR: lambda result, step: contour(result.mesh, result.displacement(step)),
}
USUAL_PARTS = ("points", "highest", "grooves", "constriction", "contact", "body", CONTOUR)
# Entries of the summary of a run that a row has: they show whether the run is reliable.
SUMMARY_CELLS = ("steps", "iterations", "wall_s", "energy_balance_error", "hourglass_share", "min_J", "settled")


@dataclass(frozen=True)
class Task:
    """The input of a worker that computes runs; it is small, as it is sent with each bundle.

    Attributes
    ----------
    path, text : the scenario file and its content.
    parts : names of the measures, of ``PARTS`` and of ``own``.
    folder : of the result files.
    keep : "none", "all", "failed", or "every:N".
    own : custom measures by their full names.
    """

    path: Path
    text: str
    parts: tuple[str, ...]
    folder: Path
    keep: str = "none"
    own: Mapping[str, OwnMeasure] = field(default_factory=dict)


@dataclass(frozen=True)
class Member:
    """A run of a sweep: its number, a hash of its inputs as its name, and its settings."""

    number: int
    name: str
    settings: tuple[str, ...]


def number_of(row: Row) -> int:
    """The number of the run of a row."""
    return cast(int, row[NUMBER])


def cause_of(message: str) -> str:
    """A message with its numbers replaced by #, so that runs that failed for one reason are counted together."""
    return re.sub(r"(?<![\w.-])[-+]?\d+(\.\d+)?(e[-+]?\d+)?(?![\w-])", "#", message)


def counted_causes(messages: Iterable[str]) -> dict[str, int]:
    """Frequency of each cause, in decreasing order; a cause keeps its numbers if all its messages agree."""
    by_cause: dict[str, list[str]] = {}
    for message in messages:
        by_cause.setdefault(cause_of(message), []).append(message)
    frequent = sorted(by_cause.items(), key=lambda entry: -len(entry[1]))
    return {same[0] if len(set(same)) == 1 else cause: len(same) for cause, same in frequent}


class WrittenRow(NamedTuple):
    """A serialized row: the worker writes it, so that the main process does little work per run.

    Attributes
    ----------
    number, status, seconds : of its run.
    columns, cells : names and values, as JSON lists.
    """

    number: int
    status: str
    seconds: float
    columns: str
    cells: str

    @property
    def row(self) -> Row:
        """The row itself."""
        return dict(zip(json.loads(self.columns), json.loads(self.cells), strict=True))


def written(row: Row) -> WrittenRow:
    """Serialize a row."""
    seconds = cast(float, row.get(MEMBER_S) or 0.0)
    return WrittenRow(
        number_of(row), str(row[STATUS]), seconds, _columns_of(tuple(row)), json.dumps([*row.values()], allow_nan=False)
    )


@lru_cache(maxsize=64)
def _columns_of(names: tuple[str, ...]) -> str:
    """Names of columns as JSON; the rows of a bundle share one text, which is sent once."""
    return json.dumps(names)


def written_rows_of(task: Task, members: Sequence[Member]) -> list[WrittenRow]:
    """Compute some runs: the task of a worker."""
    return [written(row_of(task, member)) for member in members]


def row_of(task: Task, member: Member) -> Row:
    """Compute one run. Its row reports any failure, which does not stop the other runs."""
    begin = time.perf_counter()
    try:
        status, message, cells = _computed(task, member)
    except InputError as error:
        status, message, cells = REFUSED, str(error), {}
    except MachineError:
        raise  # no run has caused a full disk
    except RunError as error:
        status, message, cells = FAILED, str(error), {}
    except Exception as error:
        if isinstance(error, OSError) and error.errno in REFUSALS:
            raise MachineError(f"a worker: {error.filename or 'its machine'}: {reason(error)}.") from None
        status, message, cells = (
            FAULT,
            f"internal error of explicitfe ({type(error).__name__}: {error}); please report it with the settings of this run",
            {},
        )
    row: Row = {NUMBER: member.number, NAME: member.name, STATUS: status, MESSAGE: message}
    return row | cells | {MEMBER_S: time.perf_counter() - begin}


def lost(member: Member, message: str) -> Row:
    """The row of a run whose process ended each time."""
    return {NUMBER: member.number, NAME: member.name, STATUS: LOST, MESSAGE: message}


def result_name(number: int) -> str:
    """Name of the result file of a run."""
    return f"member-{number:07d}.vtkhdf"


def _computed(task: Task, member: Member) -> tuple[str, str, Row]:
    """Status, message, and cells."""
    scenario, text = scenario_in(task.text, task.path, member.settings)
    result = ResultInMemory(task.path)
    analysis = analysis_of(task.path, scenario, text)
    summary = analysis.run(result, overwrite=False, progress=silent)
    if is_kept(task.keep, member.number, summary["status"]):
        try:
            analysis.write(result, summary, task.folder / result_name(member.number))
        except InputError as error:  # the scenario has run, so the machine has caused this
            raise MachineError(str(error)) from None
    cells: Row = {key: cast(Cell, summary[key]) for key in SUMMARY_CELLS if key in summary}  # type: ignore[literal-required]
    if "loop_s" in summary:
        ran = cast(TransientSummary, summary)
        cells[COURSE_S] = ran["loop_s"] + ran["look_s"] + ran["sample_s"]
    cells["folded_elements"] = summary["folded"]["elements"]
    cells["warnings"] = len(summary["warnings"])
    if isinstance(scenario, TransientScenario):
        if summary["status"] == FINISHED:
            step = last_step(result)
            for part in task.parts:
                if part == CONTOUR:
                    cells[CONTOUR] = cast(Cell, PARTS[part](result, step))
                elif part in task.own:
                    cells |= flat(task.own[part].of(result, step), task.own[part].name)
                else:
                    cells |= flat(PARTS[part](result, step), part)
    else:
        cells |= numbers_of_curve(cast(IndentationSummary, summary)["curve"])
        if summary["status"] == FINISHED:
            for measure in task.own.values():
                cells |= flat(measure.of(result, last_step(result)), measure.name)
    status, message = summary["status"], summary["message"]
    wrong = [name for name, value in cells.items() if isinstance(value, float) and not math.isfinite(value)]
    if wrong and status == FINISHED:
        status, message = (
            FAULT,
            f"internal error of explicitfe: {wrong[0]} is not a finite number; please report it with the settings of this run",
        )
    return status, message, {name: None if name in wrong else value for name, value in cells.items()}


def contour(mesh: HexMesh, displacement: np.ndarray) -> list[int]:
    """The midsagittal outline: x and z of each point in turn, in units of 0.01 mm; empty if there is none."""
    cut = midsagittal(mesh)
    if not cut.loops:
        return []
    outline = cut.at(mesh.points + displacement)[max(cut.loops, key=len)][:, [X, Z]]
    return np.rint(outline.ravel() / CONTOUR_UNIT_M).astype(int).tolist()


def is_kept(keep: str, number: int, status: str) -> bool:
    """Whether ``--keep`` requests the result file of a run with this status."""
    kind, _, every = keep.partition(":")
    return kind == "all" or (kind == "failed" and status != FINISHED) or (kind == "every" and number % int(every) == 0)
