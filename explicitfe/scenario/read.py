"""A scenario's file becomes a scenario: its reading, what --set changes, its schema."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from explicitfe.errors import InputError, nearest, shortened
from explicitfe.host.plain import MOST_LEVELS, check_plain
from explicitfe.host.text import json_of, text_of, toml_of
from explicitfe.scenario.bounds import with_bounds
from explicitfe.scenario.indentation import IndentationScenario
from explicitfe.scenario.sentences import explain
from explicitfe.scenario.table import validated
from explicitfe.scenario.transient import TransientScenario

Scenario = TransientScenario | IndentationScenario


def kind_of(data: object) -> type[TransientScenario] | type[IndentationScenario]:
    """The schema that parsed TOML is meant for: by its model or its type of analysis."""
    model, analysis = (data.get(key) if isinstance(data, dict) else None for key in ("model", "analysis"))
    specimen = isinstance(model, dict) and model.get("name") == "specimen"
    relaxation = isinstance(analysis, dict) and analysis.get("type") == "relaxation"
    return IndentationScenario if specimen or relaxation else TransientScenario


# What other files of a user say of themselves under "format" -> what they are for.
_OTHER_FILES = {
    "explicitfe-dataset/1": "a dataset: give its folder to `explicitfe check`, `identify` or `close-loop`",
    "explicitfe-protocol/1": "the protocol of a test: give it to `explicitfe design-test`",
    "explicitfe-model/1": "a tissue: give it to `explicitfe run SCENARIO` with --tissue, or to `explicitfe predict` with --model",
}


def read_scenario(path: Path | str, settings: Sequence[str] = ()) -> tuple[Scenario, str]:
    """A scenario file, checked, and its text with the settings noted at its head.

    Parameters
    ----------
    path : the file; one that ends in .json holds the same tables as JSON, as a result does.
    settings : ``key=value`` pairs that replace what the file says; a muscle is reached by its name
        (``muscle.GGp.force_N=1.5``), and ``bone.+={name="palate"}`` adds a table.

    Raises
    ------
    InputError : the file cannot be read, is not TOML, or does not fit the schema; one sentence.
    """
    path = Path(path)
    text = text_of(path, "a scenario is a TOML file; 'explicitfe list scenarios' names those at hand")
    return scenario_in(text, path, settings)


def scenario_in(text: str, path: Path, settings: Sequence[str] = ()) -> tuple[Scenario, str]:
    """A scenario in a text, as :func:`read_scenario` gives it; ``path`` is where messages say that it stands."""
    data = json_of(text, path) if path.suffix == ".json" else toml_of(text, path)
    if isinstance(data, dict) and data.get("format") in _OTHER_FILES:
        raise InputError(f"{path}: this is no scenario but {_OTHER_FILES[data['format']]}.")
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


# Keys that exclude each other: whoever sets one takes its alternatives, keys of the same table, out.
_ALTERNATIVES = {
    "model.cells": ("resolution",),
    "model.resolution": ("cells",),
    "model.name": ("file",),
    "model.file": ("name", "resolution", "cells"),
    "model.size_mm": ("radius_mm", "height_mm"),
    "model.radius_mm": ("size_mm",),
    "model.height_mm": ("size_mm",),
    "analysis.forces_N": ("displacements_mm", "times_s"),
    "analysis.displacements_mm": ("forces_N", "times_s"),
}


LONGEST_SETTING_CHARACTERS = 20_000  # of one --set: what is longer belongs into a file


def _apply(data: object, setting: str) -> None:
    """Set one ``key=value`` in the parsed scenario."""
    option = f"--set {shortened(setting)}"
    path, equals, text = setting.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise InputError(f"{option}: write key=value, for example --set muscle.GGp.force_N=1.5.")
    if len(setting) > LONGEST_SETTING_CHARACTERS or len(keys) > MOST_LEVELS:
        raise InputError(
            f"{option}: this is too long; up to {LONGEST_SETTING_CHARACTERS} characters and {MOST_LEVELS} keys are possible, "
            "so write it into the scenario."
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
        elif isinstance(at, dict):
            index = key
        else:
            raise InputError(f'{option}: {place} is a value, it has no key "{key}".')
        if depth == len(keys) - 1:
            at[index] = value
        else:
            at = at[index] if isinstance(at, list) else at.setdefault(index, [] if keys[depth + 1] == "+" else {})


def _value(text: str, option: str) -> object:
    """What a setting's text says: TOML, or else a bare word, which is text."""
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text.strip()
    except RecursionError:
        raise InputError(f"{option}: lists or tables stand too deep inside each other; take some brackets out.") from None
    except ValueError as error:  # a whole number of thousands of digits
        raise InputError(f"{option}: this number cannot be read ({shortened(str(error))}).") from None
    if table.keys() != {"value"}:
        raise InputError(f"{option}: there is more than one line; give each key with a --set of its own.")
    return table["value"]


def _entry(entries: list[object], key: str, place: str, option: str) -> int:
    """The place of the entry of a list that has this name, or else this number."""
    names = {k: str(entry.get("name", "")) for k, entry in enumerate(entries) if isinstance(entry, dict)}
    chosen = [k for k, name in names.items() if name == key]
    if not chosen and key.isascii() and key.isdecimal() and len(key) < 10 and int(key) < len(entries):
        chosen = [int(key)]
    if len(chosen) > 1:
        numbers = ", ".join(f"{place}.{k}" for k in chosen)
        raise InputError(f'{option}: "{key}" stands {len(chosen)} times in {place}; say which: {numbers}.')
    if not chosen:
        raise InputError(f'{option}: {place} has no entry "{shortened(key)}"; {nearest(key, filter(None, names.values()))}')
    return chosen[0]
