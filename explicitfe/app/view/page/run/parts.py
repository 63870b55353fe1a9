"""Texts and tables of the report of runs, without HTML."""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import JsonValue

from explicitfe.app.view.context import context_of
from explicitfe.app.view.heading import title_of
from explicitfe.app.view.muscles import muscles_of, pull_in_words
from explicitfe.app.view.page.chart import Chart
from explicitfe.app.view.page.run.checks import Checks, checks_of
from explicitfe.app.view.page.run.playback import frame_count, playback
from explicitfe.app.view.page.run.speech import Speech, fibre_points, speech_of
from explicitfe.app.view.page.tables import PageTable, table
from explicitfe.app.view.page.words import (
    DASH,
    bare,
    finite,
    motion_at_end,
    number,
    paragraphs,
    percent,
    reaction_in_words,
    speed,
    steps_in_words,
)
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import shipped
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.documents.units_of_keys import terms_of, words_and_unit
from explicitfe.results.files import FINISHED, Result
from explicitfe.results.files.differing_keys import WORDS, differing_keys, table_in_words
from explicitfe.results.measure.document import BoneContact, Measures
from explicitfe.results.measure.formants import airway_of
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.numbers import Number, flat, numbers_at
from explicitfe.results.measure.steps import last_step, step_at

# Longer values of a scenario are cut in the table of differences.
LONGEST_VALUE_CHARACTERS = 80
# A column in which all displacements are smaller is omitted: it would show 0.00 throughout.
SMALLEST_SHOWN_MM = 0.005
TIME, TIP = "time_ms", "tip"
# Prefix of the lines at the head of a stored scenario that record the settings of the run.
SETTING = "# --set "


@dataclass(frozen=True)
class RunOnPage:
    """One result as the page shows it.

    Attributes
    ----------
    label : short name, unique on the page: that of its file.
    question : paragraphs of the scenario; empty where it has none.
    expect, expected : paragraphs, and measures next to their expected values; empty and None if the run is another one than the
        scenario file states.
    facts, numerical : name -> value, in words, of the table of the run and its results, and of its numerical solution.
    moved : displacement of each named point; None where there are none.
    charts : drawn from its history.
    playback : data of the animation, with ``frames`` of the ``stored`` samples.
    speech : its acoustics; None for a run of another model than the tongue.
    has_fibres : whether muscle fibres are part of the animation.
    scenario : text of the scenario file; ``commands`` repeat the run and show more of it.
    kind : "indentation", or of a run in time "tongue" where the mesh has the named point of a tongue's tip, else "body".
    has_context : whether lips, hyoid bone and larynx are drawn around it.
    """

    label: str
    title: str
    checks: Checks
    question: list[str]
    expect: list[str]
    expected: PageTable | None
    facts: dict[str, str]
    numerical: dict[str, str]
    moved: PageTable | None
    charts: list[Chart]
    playback: str
    frames: int
    stored: int
    speech: Speech | None
    has_fibres: bool
    provenance: dict[str, str]
    scenario: str
    commands: list[str]
    kind: str
    has_context: bool


def run_on_page(result: Result, measures: Measures | None, label: str, charts: list[Chart], share: float) -> RunOnPage:
    """One result as the page shows it.

    Parameters
    ----------
    measures : at its last step; None for an indentation.
    share : its part of the size that a page may have.
    """
    scenario, last = result.model.get("scenario", {}), last_step(result)
    return RunOnPage(
        label=label,
        title=title_of(result),
        checks=checks_of(result),
        question=paragraphs(str(scenario.get("question") or "")),
        expect=paragraphs(str(scenario.get("expect") or "")) if _is_as_expected(result) else [],
        expected=_expectation_table(result, measures, scenario.get("expected") or []) if _is_as_expected(result) else None,
        facts=dict(_facts(result, measures)),
        numerical=dict(_numerical_facts(result)),
        moved=None if measures is None or not result.mesh.named_points else _moved(measures),
        charts=charts,
        playback=playback(result, last, share),
        frames=frame_count(result, last, share),
        stored=len(result.times),
        speech=speech_of(result, last),
        has_fibres=fibre_points(result) is not None,
        provenance={key.replace("_", " "): str(value) for key, value in result.provenance.items() if value is not None},
        scenario=result.scenario_text,
        commands=list(_commands(result)),
        kind="indentation" if kind_of(result.model) == "relaxation" else "tongue" if TIP in result.mesh.named_points else "body",
        has_context=bool(context_of(result, 0)),
    )


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


def table_of_runs(runs: Sequence[RunOnPage], values: Sequence[Mapping[str, str]]) -> PageTable | None:
    """The facts or the provenance of all runs, one column per result."""
    names = list(dict.fromkeys(name for own in values for name in own))
    rows = [(name, *(own.get(name, "") for own in values)) for name in names]
    return table(("", *([run.label for run in runs] if len(runs) > 1 else [""])), rows, "t" * (1 + len(runs)))


def _facts(result: Result, measures: Measures | None) -> Iterator[tuple[str, str]]:
    """Names and values of the run and its results, in words."""
    model, scenario = result.model, result.model.get("scenario", {})
    yield "status", result.status
    size = f"{result.mesh.element_count} elements, {result.mesh.node_count} nodes"
    yield "mesh", f"{model['name']}, {size}" if model.get("name") else size
    if material := dict(model.get("material") or {}):
        source = material.pop("source", "")
        yield "material", ", ".join(_constant(key, material[key]) for key in terms_of(material))
        yield "source of the material", str(source)
    if muscles := muscles_of(result):
        yield "muscles", "; ".join(pull_in_words(muscle) for muscle in muscles)
    if result.bones:
        yield "bones", ", ".join(result.bones)
    if tool := model.get("tool"):
        yield "tool", ", ".join(_constant(key, value) for key, value in tool.items() if value is not None)
    if len(result.times) and kind_of(model) == "transient":
        yield "simulated", f"{1e3 * result.times[-1]:.4g} ms, {len(result.times)} samples stored"
    if kind_of(model) == "relaxation" and len(result.history("force")):
        most = int(np.argmax(result.history("force")))
        depth_mm = 1e3 * result.history("indentation")[most]
        yield "maximum force", f"{number(result.history('force')[most])} N at {number(depth_mm)} mm"
    if measures is not None:
        yield "at the end", motion_at_end(measures.body.settled, measures.body.fastest_mm_s)
        for name, reaction in measures.reactions.items():
            if reaction.displacement_mm is not None:
                yield f"reaction force at {name} at the end", reaction_in_words(reaction)
        for name, contact in measures.contact.items():
            yield f"contact with the {name} at the end", _contact(contact)
    if scenario.get("effects"):
        yield "effects", ", ".join(sorted(key.replace("_", "-") for key in scenario["effects"]))


def _numerical_facts(result: Result) -> Iterator[tuple[str, str]]:
    """Names and values of the numerical solution, in words."""
    summary = result.summary
    if finite(summary.get("steps")) and finite(summary.get("dt_s")):
        yield "time steps", steps_in_words(summary["steps"], summary["dt_s"])
    if finite(summary.get("energy_balance_error")):
        yield "energy balance error", f"at most {percent(summary['energy_balance_error'])}".replace("at most <", "less than")
    if finite(summary.get("hourglass_share")):
        yield "hourglass share", f"at most {percent(summary['hourglass_share'])} of the elastic energy"
    if finite(summary.get("min_J")):
        yield "minimum volume ratio J", f"{summary['min_J']:.3f}"
    if folded := summary.get("folded"):
        undecided = f", {folded['undecided']} undecided" if folded.get("undecided") else " (certified)"
        yield "inverted elements", f"{folded['elements']} of {result.mesh.element_count}{undecided}"
    if finite(summary.get("wall_s")):
        yield "wall time", f"{number(summary['wall_s'], 2)} s"


def _constant(key: str, value: object) -> str:
    """Such as "C10 1037 Pa", with all digits of the number."""
    words, unit = words_and_unit(key)
    text = f"{value:.10g}" if finite(value) else str(value)
    return text if key in ("law", "shape") else f"{words} {text} {unit}".rstrip()


def _contact(contact: BoneContact) -> str:
    """Contact with a bone: its area and both forces, with the digits that distinguish them."""
    if not contact.area_mm2:
        return "none"
    forces = [] if contact.resultant_N is None else [f"resultant force {number(contact.resultant_N)} N"]
    return ", ".join([f"{contact.area_mm2:.0f} mm²", *forces, f"normal force sum {number(contact.force_N)} N"])


def _moved(measures: Measures) -> PageTable | None:
    """The displacement of each named point at the end and its largest one, from the measures of the result."""
    points = measures.points
    moves_aside = any(abs(point.right_mm) >= SMALLEST_SHOWN_MM for point in points.values())
    rows = [
        (
            name,
            *(f"{mm:z.2f}" for mm in (point.forward_mm, point.up_mm)),
            f"{point.right_mm:z.2f}" if moves_aside else "",
            f"{point.largest_mm:.2f}",
            f"{point.largest_at_ms:.0f}",
            speed(point.peak_speed_mm_s),
            "" if point.time_to_90_ms is None else f"{point.time_to_90_ms:.0f}",
        )
        for name, point in points.items()
    ]
    head = ("point", "forward (mm)", "up (mm)", "right (mm)", "largest (mm)", "at (ms)", "peak speed (mm/s)", "time to 90 % (ms)")
    return table(head, rows, "tnnnnnnn")


def _is_as_expected(result: Result) -> bool:
    """Whether a run has ended, with the values of its scenario file but for keys that change no measure."""
    keys = [setting.partition("=")[0].strip() for setting in _settings(result)]
    return result.status == FINISHED and all(key in (*WORDS, "analysis.threads") or key.startswith("record.") for key in keys)


def _expectation_table(result: Result, measures: Measures | None, expected: Sequence[Mapping[str, float]]) -> PageTable | None:
    """Compare the expected measures of the scenario with those of this run; ``measures`` are those at its last step."""
    digits: dict[str, int] = {}  # of numbers with the same unit: the most that the scenario states
    for name, value in (pair for numbers in expected for pair in numbers.items()):
        unit = words_and_unit(name)[1]
        digits[unit] = max(digits.get(unit, 0), len(f"{value!r}".partition(".")[2].rstrip("0")))
    rows: list[tuple[str, ...]] = []
    for numbers in expected:
        time_ms = numbers.get(TIME)
        time_s = None if time_ms is None else 1e-3 * time_ms
        try:
            seen = _numbers(result, measures, time_s, any(name.startswith("airway.") for name in numbers))
        except InputError:  # no airway, or no such time
            seen = {}
        for name, value in numbers.items():
            *group, key = name.removeprefix("points.").split(".")
            words, unit = words_and_unit(key)
            now, form = seen.get(name), f"z.{digits[unit]}f"
            compared = (DASH, "") if now is None else (f"{now:{form}}", f"{now - value:+{form}}")
            label = " ".join([*group, words]) + (f" ({unit})" if unit else "")
            if name != TIME:
                rows.append((label, "" if time_ms is None else f"{time_ms:g}", f"{value:{form}}", *compared))
    return table(("measure", "at (ms)", "author's value", "this run", "difference"), rows, "tnnnn")


def _numbers(result: Result, last: Measures | None, time_s: float | None, with_airway: bool) -> dict[str, Number]:
    """As :func:`numbers_at`, from the measures at the last step where that is the step."""
    if last is None:
        return numbers_at(result, time_s)
    step = step_at(result, time_s)
    measures = last if step == last_step(result) else measures_of(result, step)
    return flat(measures.model_copy(update={"airway": airway_of(result, step)}) if with_airway else measures)


def _commands(result: Result) -> Iterator[str]:
    """The command that repeats the run, and those that show more of it."""
    stored = result.model
    file = Path(str(stored.get("scenario_file") or f"{result.path.stem}.toml"))
    settings = "".join(f" --set {shlex.quote(setting)}" for setting in _settings(result))
    name = result.path.stem.removesuffix(".running")
    named = "" if name == file.stem else f" --name {shlex.quote(name)}"
    yield f"explicitfe run {shlex.quote(scenario_words(file, result.scenario_text))}{settings}{named}"
    yield f"explicitfe inspect {shlex.quote(str(result.path))}"
    if kind_of(stored) == "transient":
        yield f"explicitfe measure {shlex.quote(str(result.path))}"


def scenario_words(file: Path, text: str) -> str:
    """What a user types to run a stored scenario again.

    The name alone of a scenario that comes with explicitfe, whatever the folder of the installation; otherwise the path, relative
    where it is in the working directory.

    Parameters
    ----------
    file : the scenario file of the run.
    text : the text of that scenario, which may begin with the settings of the run.
    """
    own = shipped.scenarios().get(file.stem)
    if own is not None and (file == own or _without_words(own.read_text(encoding="utf-8")) == _without_words(text)):
        return file.stem
    return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


def _without_words(text: str) -> dict[str, Any] | None:
    """The keys of a scenario that a run depends on; None for a text that cannot be read."""
    try:
        return {key: value for key, value in tomllib.loads(text).items() if key not in WORDS}
    except tomllib.TOMLDecodeError:
        return None


def _settings(result: Result) -> list[str]:
    """The ``--set`` options of a run, as recorded at the head of its stored scenario."""
    head = takewhile(lambda line: line.startswith(SETTING), result.scenario_text.splitlines())
    return [line.removeprefix(SETTING) for line in head]
