"""A kind of analysis is one file of a room: every kind of scenario has its analysis, its tables and its pictures."""

from __future__ import annotations

import ast
from typing import get_args

import pytest
from support import ROOT

from explicitfe.app.view.draw import PICTURES
from explicitfe.app.view.terminal.stored import KINDS
from explicitfe.simulate.run.analysis import Analysis
from explicitfe.simulate.run.prepare import ANALYSES, prepare
from explicitfe.simulate.scenario.read import Scenario

KINDS_OF_SCENARIO = get_args(Scenario)


def test_every_scenario_has_its_analysis():
    assert set(ANALYSES) == set(KINDS_OF_SCENARIO)
    assert all(issubclass(analysis, Analysis) for analysis in ANALYSES.values())


@pytest.mark.parametrize("kind", KINDS_OF_SCENARIO)
def test_every_kind_can_be_shown(kind):
    """The word that a scenario has for its kind of analysis, and a result keeps, leads to tables and pictures."""
    (word,) = get_args(kind.model_fields["analysis"].annotation.model_fields["type"].annotation)
    assert set(KINDS) == set(PICTURES) and word in KINDS


@pytest.mark.parametrize("scenario", ["vowel-i", "indentation-ball"])
def test_an_analysis_is_prepared_from_a_file(scenario):
    analysis = prepare(ROOT / "scenarios" / f"{scenario}.toml", notes=["read me"])
    assert type(analysis) is ANALYSES[type(analysis.scenario)]
    assert analysis.notes == ("read me",) and analysis.prepare_s > 0.0
    assert analysis.describe()["hexes"] == analysis.model.mesh.element_count


def test_nobody_who_computes_or_shows_asks_which_kind_it_is():
    """In the rooms that run and show scenarios; the tables above are the only places."""
    kinds = {kind.__name__ for kind in (*KINDS_OF_SCENARIO, *ANALYSES.values())}
    files = [*(ROOT / "explicitfe" / "simulate" / "run").glob("*.py"), *(ROOT / "explicitfe" / "app" / "view").rglob("*.py")]
    for path in [*files, *(ROOT / "explicitfe" / "app" / "cli").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("isinstance", "issubclass"):
                asked = {name.id for name in ast.walk(node.args[1]) if isinstance(name, ast.Name)}
                assert not asked & kinds, f"{path.name}:{node.lineno}"
