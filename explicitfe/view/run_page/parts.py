"""What the report of runs says: texts and tables, without a mark of HTML."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import JsonValue

from explicitfe.measure.measure import measures_of
from explicitfe.results import Result
from explicitfe.results.differing_keys import differing_keys, table_in_words
from explicitfe.results.run_summary import kind_of
from explicitfe.results.units_of_keys import words_and_unit
from explicitfe.view.heading import title_of
from explicitfe.view.muscles import muscles_of, pull_in_words
from explicitfe.view.page.chart import Chart
from explicitfe.view.report.tables import PageTable, table
from explicitfe.view.report.words import bare, finite, number, percent
from explicitfe.view.run_page.playback import frame_count, playback
from explicitfe.view.run_page.quotable import Quotability, quotability

# So many characters of a value of a scenario stand in the table of what differs.
LONGEST_VALUE_CHARACTERS = 80
# What is less than this everywhere is 0.00 in a table, and says nothing.
SMALLEST_SHOWN_MM = 0.005
# So begins each line in which a stored scenario notes a setting that it was run with.
SETTING = "# --set "


@dataclass(frozen=True)
class RunOnPage:
    """One result as the page shows it.

    Attributes
    ----------
    label : short name, unlike that of any other result of the page: its file.
    question, expect : of the scenario; empty where it has none.
    facts : name -> what was run and what it came to, in words.
    moved : what each named point did; None where there are none.
    charts : drawn from its history; ``playback`` is what moves, of ``frames`` of the ``stored`` samples.
    scenario : the scenario file as the user wrote it; ``commands`` repeat the run and look at it closer.
    is_tongue : whether it is a run in time, and not an indentation.
    """

    label: str
    title: str
    verdict: Quotability
    question: str
    expect: str
    facts: dict[str, str]
    moved: PageTable | None
    charts: list[Chart]
    playback: str
    frames: int
    stored: int
    provenance: dict[str, str]
    scenario: str
    commands: list[str]
    is_tongue: bool


def run_on_page(result: Result, last: int, label: str, charts: list[Chart], share: float) -> RunOnPage:
    """One result as the page shows it, up to a step; ``share`` is its part of the size that a page may have."""
    scenario = result.model.get("scenario", {})
    return RunOnPage(
        label=label,
        title=title_of(result),
        verdict=quotability(result),
        question=str(scenario.get("question") or "").strip(),
        expect=str(scenario.get("expect") or "").strip(),
        facts=dict(_facts(result)),
        moved=_moved(result, last),
        charts=charts,
        playback=playback(result, last, share),
        frames=frame_count(result, last, share),
        stored=len(result.times),
        provenance={key: str(value) for key, value in result.provenance.items() if value is not None},
        scenario=result.scenario_text,
        commands=list(_commands(result)),
        is_tongue=kind_of(result.model) == "transient",
    )


def labels_of(paths: Sequence[Path]) -> list[str]:
    """A short name for each result, no two the same: its file's, with as many folders as it takes, or a number."""
    for depth in range(1, 1 + max(len(path.parts) for path in paths)):
        labels = ["/".join([*path.parts[-depth:-1], path.stem]) for path in paths]
        if len(set(labels)) == len(labels):
            return labels
    return [f"{path.stem} ({number})" for number, path in enumerate(paths, 1)]


def differences(scenarios: Sequence[Mapping[str, Any]], labels: Sequence[str]) -> PageTable | None:
    """The keys whose values differ between scenarios, with all defaults filled in; None where there are none."""
    rows = [(key, *map(_value, values)) for key, values in differing_keys(scenarios).items()]
    return table(("key", *labels), rows, "t" * (1 + len(labels)))


def _value(value: JsonValue) -> str:
    if value is None:
        return "absent"
    if isinstance(value, dict):
        return table_in_words(value)
    text = bare(value) if finite(value) else str(value)
    return text if len(text) <= LONGEST_VALUE_CHARACTERS else f"{text[: LONGEST_VALUE_CHARACTERS - 1]}…"


def facts_table(runs: Sequence[RunOnPage]) -> PageTable | None:
    """What was run and what it came to, a column a result."""
    names = list(dict.fromkeys(name for run in runs for name in run.facts))
    rows = [(name, *(run.facts.get(name, "") for run in runs)) for name in names]
    return table(("", *([run.label for run in runs] if len(runs) > 1 else [""])), rows, "t" * (1 + len(runs)))


def provenance_table(runs: Sequence[RunOnPage]) -> PageTable | None:
    """Versions, commit and machine of each run."""
    names = list(dict.fromkeys(name for run in runs for name in run.provenance))
    rows = [(name.replace("_", " "), *(run.provenance.get(name, "") for run in runs)) for name in names]
    return table(("", *([run.label for run in runs] if len(runs) > 1 else [""])), rows, "t" * (1 + len(runs)))


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    """What was run and what it came to, in words."""
    model, summary, scenario = result.model, result.summary, result.model.get("scenario", {})
    yield "status", result.status
    size = f"{result.mesh.element_count} elements, {result.mesh.node_count} nodes"
    yield "mesh", f"{model['name']}, {size}" if model.get("name") else size
    if material := dict(model.get("material") or {}):
        source = material.pop("source", "")
        yield "material", ", ".join(_constant(key, value) for key, value in material.items())
        yield "source of the material", str(source)
    if muscles := muscles_of(result):
        yield "muscles", "; ".join(pull_in_words(muscle) for muscle in muscles)
    if result.bones:
        yield "bones", ", ".join(result.bones)
    if tool := model.get("tool"):
        yield "tool", ", ".join(_constant(key, value) for key, value in tool.items() if value is not None)
    if len(result.times) and kind_of(model) == "transient":
        yield "simulated", f"{1e3 * result.times[-1]:.4g} ms, {len(result.times)} samples stored"
    if finite(summary.get("steps")) and finite(summary.get("dt_s")):
        yield "steps", f"{summary['steps']} of {1e6 * summary['dt_s']:.3g} µs or longer"
    if kind_of(model) == "relaxation" and len(result.history("force")):
        most = int(np.argmax(result.history("force")))
        depth_mm = 1e3 * result.history("indentation")[most]
        yield "largest force", f"{number(result.history('force')[most])} N at {number(depth_mm)} mm"
    if finite(summary.get("energy_balance_error")):
        yield "energy balance", f"off by at most {percent(summary['energy_balance_error'])}".replace("at most <", "less than")
    if finite(summary.get("hourglass_share")):
        yield "hourglass share", f"{percent(summary['hourglass_share'])} of the elastic energy at most"
    if finite(summary.get("min_J")):
        yield "smallest J", f"{summary['min_J']:.3f}"
    if folded := summary.get("folded"):
        undecided = f", {folded['undecided']} undecided" if folded.get("undecided") else ", certified"
        yield "folded elements", f"{folded['elements']} of {result.mesh.element_count}{undecided}"
    if "settled" in summary:
        speed = f"fastest node {number(summary.get('largest_speed_mm_s'), 2)} mm/s"
        yield "at the end", f"{'settled' if summary['settled'] else 'still moving'}, {speed}"
    if finite(summary.get("wall_s")):
        yield "computed in", f"{number(summary['wall_s'], 2)} s"
    if scenario.get("effects"):
        yield "effects", ", ".join(sorted(key.replace("_", "-") for key in scenario["effects"]))


def _constant(key: str, value: object) -> str:
    """Such as "C10 1037 Pa": the number as it stands, for it may be quoted."""
    words, unit = words_and_unit(key)
    text = f"{value:.10g}" if finite(value) else str(value)
    return text if key in ("law", "shape") else f"{words} {text} {unit}".rstrip()


def _moved(result: Result, last: int) -> PageTable | None:
    """What each named point of a tongue did, from the measures of the result."""
    if kind_of(result.model) != "transient" or not result.mesh.named_points:
        return None
    points = measures_of(result, last).points
    moves_aside = any(abs(point.right_mm) >= SMALLEST_SHOWN_MM for point in points.values())
    rows = [
        (
            name,
            *(f"{mm:z.2f}" for mm in (point.forward_mm, point.up_mm)),
            f"{point.right_mm:z.2f}" if moves_aside else "",
            f"{point.peak_speed_mm_s:.0f}",
            "" if point.time_to_90_ms is None else f"{point.time_to_90_ms:.0f}",
        )
        for name, point in points.items()
    ]
    head = ("point", "forward (mm)", "up (mm)", "right (mm)", "fastest (mm/s)", "90 % after (ms)")
    return table(head, rows, "tnnnnn")


def _commands(result: Result) -> Iterator[str]:
    """The command that repeats the run, and those that look at it closer."""
    stored = result.model
    file = shlex.quote(str(stored.get("scenario_file") or f"{result.path.stem}.toml"))
    settings = "".join(f" --set {shlex.quote(setting)}" for setting in _settings(result))
    yield f"explicitfe run {file}{settings}"
    yield f"explicitfe inspect {shlex.quote(str(result.path))}"
    if kind_of(stored) == "transient":
        yield f"explicitfe measure {shlex.quote(str(result.path))}"


def _settings(result: Result) -> list[str]:
    """The ``--set`` of a run, as its scenario notes them at its head."""
    head = takewhile(lambda line: line.startswith(SETTING), result.scenario_text.splitlines())
    return [line.removeprefix(SETTING) for line in head]
