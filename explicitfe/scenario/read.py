"""A scenario's file becomes a scenario: its reading, what --set changes, its schema."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from explicitfe.errors import InputError, nearest
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
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"{path}: the scenario cannot be read ({error.strerror}); 'explicitfe list scenarios' names those at hand."
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: this is not a text file; a scenario is written in TOML.") from None
    try:
        data = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        kind = "JSON" if path.suffix == ".json" else "TOML"
        raise InputError(f"{path}: this is not valid {kind}: {error}.") from None
    for setting in settings:
        _apply(data, setting)
    try:
        scenario = validated(kind_of(data), data)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, data, kind_of(data))}") from None
    header = "".join(f"# --set {setting}\n" for setting in settings)
    return scenario, header + text


def json_schema() -> dict[str, object]:
    """The JSON schema of a scenario, for editors."""
    both = TypeAdapter(Scenario).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **both}


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


def _apply(data: dict[str, object], setting: str) -> None:
    """Set one ``key=value`` in the parsed scenario."""
    path, equals, text = setting.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise InputError(f"--set {setting}: write key=value, for example --set muscle.GGp.force_N=1.5.")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a bare word is a string
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
            names = [entry.get("name", "") for entry in at if isinstance(entry, dict)]
            entries = [k for k, name in enumerate(names) if name == key] or ([int(key)] if key.isdigit() else [])
            if len(entries) > 1:
                numbers = ", ".join(f"{place}.{k}" for k in entries)
                raise InputError(f'--set {setting}: "{key}" stands {len(entries)} times in {place}; say which: {numbers}.')
            if not entries or entries[0] >= len(at):
                raise InputError(f'--set {setting}: {place} has no entry "{key}"; {nearest(key, names)}')
            index = entries[0]
        elif isinstance(at, dict):
            index = key
        else:
            raise InputError(f"--set {setting}: {place} is a value, it has no key {key!r}.")
        if depth == len(keys) - 1:
            at[index] = value
        else:
            at = at[index] if isinstance(at, list) else at.setdefault(index, [] if keys[depth + 1] == "+" else {})
