"""Reading of scenario files, ``--set``, and the JSON schema of scenarios."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from explicitfe.fem.inputs.bounds import with_bounds
from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import validated
from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.plain import MOST_LEVELS, check_plain
from explicitfe.platform.host.text import json_of, text_of, toml_of
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.scenario.indentation import IndentationScenario
from explicitfe.simulate.scenario.transient import TransientScenario

Scenario = TransientScenario | IndentationScenario


def kind_of(data: object) -> type[TransientScenario] | type[IndentationScenario]:
    """The schema of a parsed scenario, chosen by its model or its type of analysis."""
    model, analysis = (data.get(key) if isinstance(data, dict) else None for key in ("model", "analysis"))
    specimen = isinstance(model, dict) and model.get("name") == "specimen"
    relaxation = isinstance(analysis, dict) and analysis.get("type") == "relaxation"
    return IndentationScenario if specimen or relaxation else TransientScenario


# "format" of other files -> what they are and which command takes them.
_OTHER_FILES = {
    "explicitfe-dataset/1": "a dataset; use its folder with `explicitfe check`, `identify` or `close-loop`",
    "explicitfe-protocol/1": "a test protocol; use it with `explicitfe design-test`",
    "explicitfe-model/1": "a tissue model; use it with `explicitfe run SCENARIO --tissue` or `explicitfe predict --model`",
}


def setting_texts(settings: Sequence[str] | Mapping[str, object]) -> list[str]:
    """Settings as ``key=value`` texts, from such texts or from a dictionary.

    Raises
    ------
    InputError : they are neither, or a value is not one that a scenario can hold.
    """
    if isinstance(settings, Mapping):
        try:
            json.dumps(settings, allow_nan=False)  # refuses what no scenario can hold
        except (TypeError, ValueError):
            raise InputError(f"`settings` need finite numbers, texts or lists, not {shortened(repr(settings))}.") from None
        return [f"{key}={toml_value(value)}" for key, value in settings.items()]
    if isinstance(settings, list | tuple) and all(isinstance(text, str) for text in settings):
        return list(settings)
    raise InputError(f'`settings` must be a dictionary or a list of "key=value" texts, not {shortened(repr(settings))}.')


def canonical(setting: str) -> str:
    """A ``key=value`` text with the value as TOML, so that the same setting has one text; a malformed one as it is."""
    key, equals, text = setting.partition("=")
    return f"{key.strip()}={toml_value(_value(text, setting))}" if equals else setting


def read_transient(path: Path, settings: Sequence[str] = ()) -> TransientScenario:
    """Read a scenario file that trajectories are compared with; see :func:`read_scenario`.

    Raises
    ------
    InputError : it is an indentation.
    """
    scenario, _ = read_scenario(path, settings)
    if not isinstance(scenario, TransientScenario):
        raise InputError(f"{path}: trajectories need a transient scenario, not an indentation; give another `scenario`.")
    return scenario


def read_scenario(path: Path | str, settings: Sequence[str] = ()) -> tuple[Scenario, str]:
    """Read and validate a scenario file; return it and its text, with the settings as comments at the top.

    Parameters
    ----------
    path : TOML file; a ``.json`` file has the same tables as JSON.
    settings : ``key=value`` pairs that replace values of the file. A muscle is selected by its name
        (``muscle.GGp.force_N=1.5``) and is added if it is not listed; ``bone.+={name="palate"}`` adds any other table.

    Raises
    ------
    InputError : the file cannot be read, is not TOML, or does not fit the schema; one sentence.
    """
    path = Path(path)
    text = text_of(path, "give a scenario file (TOML) or a name from 'explicitfe list scenarios'")
    return scenario_in(text, path, settings)


def scenario_in(text: str, path: Path, settings: Sequence[str] = ()) -> tuple[Scenario, str]:
    """Parse and validate the text of a scenario as :func:`read_scenario` does; ``path`` is the file named in messages."""
    data = json_of(text, path) if path.suffix == ".json" else toml_of(text, path)
    if isinstance(data, dict) and data.get("format") in _OTHER_FILES:
        raise InputError(f"{path} is not a scenario but {_OTHER_FILES[data['format']]}.")
    for setting in settings:
        _apply(data, setting)
    try:
        scenario = validated(kind_of(data), data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, data, kind_of(data))}") from None
    header = "".join(f"# --set {' '.join(setting.splitlines())}\n" for setting in settings)
    return scenario, header + text


def json_schema() -> dict[str, object]:
    """The JSON schema of a scenario, for editors."""
    both = TypeAdapter(Scenario).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **with_bounds(both)}


# Mutually exclusive keys of a table: setting one removes the others.
_ALTERNATIVES = {
    "model.cells": ("resolution",),
    "model.resolution": ("cells",),
    "model.name": ("file", "box_mm", "scale"),
    "model.file": ("name", "resolution", "cells", "box_mm"),
    "model.box_mm": ("name", "file", "resolution"),
    "model.size_mm": ("radius_mm", "height_mm"),
    "model.radius_mm": ("size_mm",),
    "model.height_mm": ("size_mm",),
    "analysis.forces_N": ("displacements_mm", "times_s"),
    "analysis.displacements_mm": ("forces_N", "times_s"),
}


LONGEST_SETTING_CHARACTERS = 20_000  # of one setting
# Keys of an added muscle that are copied from the first listed muscle: its time course and its kind of force.
_COPIED_TO_ADDED_MUSCLE = ("profile", "start_ms", "rise_ms", "end_ms", "table", "distribution", "force_length", "direction")


def _apply(data: object, setting: str) -> None:
    """Set one ``key=value`` in the parsed scenario."""
    option = f"`settings` {shortened(setting)}"
    path, equals, text = setting.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise InputError(f"{option} is not of the form key=value; write for example `settings` muscle.GGp.force_N=1.5.")
    if len(setting) > LONGEST_SETTING_CHARACTERS or len(keys) > MOST_LEVELS:
        raise InputError(
            f"{option}: the setting is longer than {LONGEST_SETTING_CHARACTERS} characters or {MOST_LEVELS} keys; "
            "write it into the scenario file."
        )
    value = _value(text, option)
    nested: object = value
    for key in reversed(keys):
        nested = {key: nested}
    check_plain(nested, option)
    if not isinstance(data, dict):
        return  # the schema refuses it
    table = data.get(keys[0])
    if isinstance(table, dict):
        for other in _ALTERNATIVES.get(".".join(keys), ()):
            table.pop(other, None)
    at: Any = data
    for depth, key in enumerate(keys):
        place = ".".join(keys[:depth]) or "the scenario"
        if isinstance(at, list) and key == "+":
            at.append({})
            index: Any = -1
        elif isinstance(at, list):
            index = _entry(at, key, place, option)
            if index is None:
                at.append(_added_muscle(at, key))
                index = -1
        elif isinstance(at, dict):
            index = key
        else:
            raise InputError(f'{option}: {place} is a single value and has no key "{shortened(key)}"; remove this key.')
        if depth == len(keys) - 1:
            at[index] = value
        else:
            at = at[index] if isinstance(at, list) else at.setdefault(index, [] if keys[depth + 1] == "+" else {})


def _value(text: str, option: str) -> object:
    """Value of a setting: parsed as TOML, or else a bare word, which is a string."""
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text.strip()
    except RecursionError:
        raise InputError(f"{option}: too many nested lists or tables; remove brackets.") from None
    except ValueError as error:  # a whole number of thousands of digits
        raise InputError(f"{option}: the number cannot be read ({shortened(str(error))}); write fewer digits.") from None
    if table.keys() != {"value"}:
        raise InputError(f"{option}: the value has more than one line; use one `settings` for each key.")
    return table["value"]


def _entry(entries: list[object], key: str, place: str, option: str) -> int | None:
    """Index of the list entry with this name, or with this number from 1; None for a muscle that is not listed."""
    names = {k: str(entry.get("name", "")) for k, entry in enumerate(entries) if isinstance(entry, dict)}
    chosen = [k for k, name in names.items() if name == key]
    if not chosen and key.isascii() and key.isdecimal() and len(key) < 10 and 1 <= int(key) <= len(entries):
        chosen = [int(key) - 1]
    if len(chosen) > 1:
        numbers = ", ".join(f"{place}.{k + 1}" for k in chosen)
        raise InputError(f'{option}: {place} lists "{key}" {len(chosen)} times; select one by its number: {numbers}.')
    if chosen:
        return chosen[0]
    if place == "muscle" and not _is_number(key):
        return None
    if _is_number(key):
        raise InputError(f"{option}: {place} has {len(entries)} entries, counted from 1, and no entry {shortened(key)}.")
    raise InputError(
        f'{option}: {place} has no entry "{shortened(key)}"; {nearest(key, filter(None, names.values()))} '
        f"To add an entry write '{place}.+={{name=\"{shortened(key)}\", ...}}'."
    )


def _added_muscle(listed: list[object], name: str) -> dict[str, object]:
    """Table of a muscle that a setting adds, with the time course and kind of force of the first listed muscle."""
    first = listed[0] if listed and isinstance(listed[0], dict) else {}
    return {"name": name, **{key: first[key] for key in _COPIED_TO_ADDED_MUSCLE if key in first}}


def _is_number(key: str) -> bool:
    return key.removeprefix("-").isdigit()
