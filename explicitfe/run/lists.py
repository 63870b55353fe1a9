"""Lists of what comes with the program: models, muscles, scenarios, materials, effects."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from explicitfe.effects import EFFECTS
from explicitfe.model import catalogue
from explicitfe.results.run_summary import Json
from explicitfe.scenario.read import read_scenario

Row = dict[str, Json]
"""One entry; its first key is what a user has to type."""


def _models() -> list[Row]:
    rows: list[Row] = []
    for name in catalogue.model_folders():
        for resolution, cells in catalogue.contour(name).resolutions.items():
            rows.append({"model": name, "resolution": resolution, "cells": list(cells), "hexes": int(np.prod(cells))})
    rows.append({"model": "specimen", "resolution": "from the tool", "cells": [], "hexes": None})
    return rows


def _muscles() -> list[Row]:
    return [
        {
            "muscle": muscle.name,
            "name": muscle.title,
            "action": muscle.action,
            "fibres": len(muscle.fibres),
            "max_force_N": muscle.max_force_N,
            "model": model,
        }
        for model in catalogue.model_folders()
        for muscle in catalogue.built_in(model).muscles.values()
    ]


def _scenarios() -> list[Row]:
    rows: list[Row] = []
    for path in catalogue.scenario_files():
        scenario, _ = read_scenario(path)
        rows.append({"scenario": path.name, "title": scenario.title, "question": scenario.question, "file": str(path)})
    return rows


def _materials() -> list[Row]:
    return [
        {
            "material": name,
            "law": law.law,
            "constants": {key: value for key, value in law.model_dump().items() if key not in ("law", "source")},
            "source": law.source,
        }
        for name, law in catalogue.materials().items()
    ]


def _effects() -> list[Row]:
    return [
        {
            "effect": name,
            "title": kind.about.title,
            "where": kind.about.where,
            "keys": list(kind.model_fields),
            "needs": kind.about.needs,
            "source": kind.about.source,
        }
        for name, kind in EFFECTS.items()
    ]


# Name of a list -> what makes it.
LISTS: dict[str, Callable[[], list[Row]]] = {
    "models": _models,
    "muscles": _muscles,
    "scenarios": _scenarios,
    "materials": _materials,
    "effects": _effects,
}
