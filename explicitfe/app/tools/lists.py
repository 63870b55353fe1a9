"""Lists of what comes with the program: models, muscles, scenarios, datasets, protocols, materials, effects.

What needs numpy or the compiler, which take their time to import, is imported by the list that needs it.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence

from pydantic import JsonValue
from typing_extensions import TypedDict

from explicitfe.platform.host import shipped

Row = Mapping[str, object]
"""One entry; its first key is what a user has to type."""


class ListedModel(TypedDict):
    """A built-in model at one resolution; ``hexes`` is None where the scenario decides."""

    model: str
    resolution: str
    cells: list[int]
    hexes: int | None


class ListedMuscle(TypedDict):
    """A muscle of a model: its full name, what it does, its fibres, and the largest force that it can be given."""

    muscle: str
    name: str
    action: str
    fibres: int
    max_force_N: float
    model: str


class ListedScenario(TypedDict):
    """A scenario that comes with the program, the question that it answers, and where its file is."""

    scenario: str
    title: str
    question: str
    file: str


class ListedDataset(TypedDict):
    """A dataset that comes with the program: its test, how many curves, under which licence, and where its folder is."""

    dataset: str
    title: str
    test: str
    curves: int
    license: str
    folder: str


class ListedProtocol(TypedDict):
    """A protocol of a planned test that comes with the program, and where its file is."""

    protocol: str
    title: str
    test: str
    file: str


class ListedMaterial(TypedDict):
    """A tissue with its law, the constants of the law and where they are from."""

    material: str
    law: str
    constants: dict[str, JsonValue]
    source: str


class ListedEffect(TypedDict):
    """An effect: where it acts, the keys of its table, what it needs of a scenario, and where it is from."""

    effect: str
    title: str
    where: str
    keys: list[str]
    needs: str
    source: str


def _models() -> list[ListedModel]:
    from explicitfe.simulate.anatomy import catalogue

    rows: list[ListedModel] = []
    for name in catalogue.model_folders():
        for resolution, cells in catalogue.contour(name).resolutions.items():
            rows.append({"model": name, "resolution": resolution, "cells": list(cells), "hexes": math.prod(cells)})
    rows.append({"model": "specimen", "resolution": "from the tool", "cells": [], "hexes": None})
    return rows


def _muscles() -> list[ListedMuscle]:
    from explicitfe.simulate.anatomy import catalogue

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


def _scenarios() -> list[ListedScenario]:
    rows: list[ListedScenario] = []
    for name, path in shipped.scenarios().items():
        stated = tomllib.loads(path.read_text(encoding="utf-8"))
        rows.append({"scenario": name, "title": stated["title"], "question": stated["question"], "file": str(path)})
    return rows


def _datasets() -> list[ListedDataset]:
    rows: list[ListedDataset] = []
    for name, folder in shipped.datasets().items():
        stated = tomllib.loads((folder / shipped.DATASET_FILE).read_text(encoding="utf-8"))
        rows.append(
            {
                "dataset": name,
                "title": stated["title"],
                "test": stated["test"],
                "curves": len(stated["curve"]),
                "license": stated["license"],
                "folder": str(folder),
            }
        )
    return rows


def _protocols() -> list[ListedProtocol]:
    rows: list[ListedProtocol] = []
    for name, path in shipped.protocols().items():
        stated = tomllib.loads(path.read_text(encoding="utf-8"))
        rows.append({"protocol": name, "title": stated["title"], "test": stated["test"], "file": str(path)})
    return rows


def _materials() -> list[ListedMaterial]:
    from explicitfe.simulate.anatomy import catalogue

    return [
        {
            "material": name,
            "law": law.law,
            "constants": {key: value for key, value in law.model_dump().items() if key not in ("law", "source")},
            "source": law.source,
        }
        for name, law in catalogue.materials().items()
    ]


def _effects() -> list[ListedEffect]:
    from explicitfe.fem.effects import EFFECTS

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
LISTS: dict[str, Callable[[], Sequence[Row]]] = {
    "models": _models,
    "muscles": _muscles,
    "scenarios": _scenarios,
    "datasets": _datasets,
    "protocols": _protocols,
    "materials": _materials,
    "effects": _effects,
}
