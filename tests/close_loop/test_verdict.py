"""The verdict follows the posterior: in documents, in outcomes, and in the report of a tensile test with hysteresis."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from synthetic import elastic
from test_loop import EFFECTS

from explicitfe.close_loop.close import close_loop
from explicitfe.close_loop.posterior import Posterior, evidence_of
from explicitfe.close_loop.search import Outcome, search
from explicitfe.close_loop.verdict import by_named_forms, concluding, follow_posterior
from explicitfe.results.loop_report import LoopReport
from explicitfe.results.verdict_text import details, headline, sentence
from explicitfe.view.terminal.close_loop import loop_tables

NONE = frozenset()
WAVE, RATE, BUMP = (frozenset({name}) for name in ("wave", "rate", "bump"))


# ---- documents ----


def document(verdict: str, **more: object) -> LoopReport:
    titles = {"power-law": "power-law relaxation", "softening": "softening"}
    return LoopReport.model_validate({"verdict": verdict, "effect_titles": titles, "split": {"fit": ["a", "b"]}, **more})


@pytest.mark.parametrize("verdict", ["ambiguous", "effect-found"])
def test_the_headline_names_the_most_probable_cause(verdict):
    """It said "softening explains it" above "power-law 0.70, softening 0.03"."""
    report = document(verdict, effects=["softening"], posterior={"power-law": 0.70, "other": 0.05, "softening": 0.03})
    assert headline(report) == "Most probable cause: power-law relaxation (probability 0.70)"
    assert "softening" not in sentence(report)


def test_an_unexplained_residual_names_the_most_probable_cause():
    """It said "no candidate explains" above "softening 0.70, other 0.05"."""
    probabilities = {"softening": 0.70, "other": 0.05}
    report = document("unexplained", nearest=["softening"], posterior=probabilities)
    assert headline(report).startswith("Most probable cause: softening (probability 0.70); a residual remains")
    assert details(report) == "The model with softening leaves a significant residual."
    alone = document("unexplained", posterior={"other": 0.6, "softening": 0.3})
    assert headline(alone) == "An effect is missing that no candidate explains"


def test_no_dominant_cause_is_ambiguous():
    report = document("ambiguous", effects=["softening"], posterior={"softening": 0.41, "power-law": 0.38, "other": 0.06})
    assert headline(report) == "Ambiguous cause: softening (0.41) or power-law relaxation (0.38)"


def test_causes_that_include_the_effect_support_it():
    report = document("effect-found", effects=["softening"], posterior={"power-law + softening": 0.5, "softening": 0.4})
    assert headline(report) == "The model lacks softening"


def test_a_document_without_probabilities():
    assert headline(document("ambiguous", effects=["softening"])) == "Possible cause: softening"
    rivals = document("ambiguous", effects=["softening"], ambiguous_with=["power-law"])
    assert headline(rivals) == "Ambiguous cause: softening or power-law relaxation"


def test_a_residual_that_is_not_significant():
    report = document("no-missing-effect", posterior={"softening": 0.6, "nothing": 0.3})
    assert sentence(report).endswith("The most probable cause is nevertheless softening (0.60).")


# ---- outcomes ----


@pytest.fixture(scope="module")
def found():
    """A system with a hidden wave, and an outcome that names it."""
    system = elastic(np.random.default_rng(1), tests=4, effects=EFFECTS, hidden={"wave": 0.05})
    outcome = search(system, max_effects=2)
    assert (outcome.verdict, outcome.effects) == ("effect-found", ("wave",))
    return system, outcome


def follow(found, closed: dict, other: float = 0.05, single: bool = False, max_effects: int = 2) -> Outcome:
    system, outcome = found
    outcome = replace(outcome, verdict="ambiguous") if single else outcome
    posterior = Posterior(closed, {NONE: other})
    return follow_posterior(outcome, posterior, concluding(system, outcome, evidence_of(outcome, system), max_effects))


def test_a_posterior_that_agrees_changes_nothing(found):
    assert follow(found, {NONE: 0.05, WAVE: 0.9}) is found[1]
    assert follow(found, {NONE: 0.05, WAVE: 0.45, WAVE | BUMP: 0.40, BUMP: 0.05}) is found[1]


@pytest.mark.parametrize("single", [False, True])
def test_the_model_becomes_that_of_the_most_probable_cause(found, single):
    outcome = follow(found, {NONE: 0.02, RATE: 0.70, WAVE: 0.03, BUMP: 0.2}, single=single)
    assert (outcome.verdict, outcome.effects) == ("ambiguous", ("rate",))
    assert outcome.keeps_effects and outcome.rounds[-1].fit.model.effects == ("rate",)
    assert outcome.rounds[0].chosen == "rate" and "its probability is 0.03" in outcome.rounds[0].why_not["wave"]
    assert outcome.rounds[-1].ambiguous_with == ("wave",)


def test_a_model_of_more_effects_than_permitted_is_not_fitted(found):
    outcome = follow(found, {NONE: 0.02, WAVE | RATE: 0.90, WAVE: 0.03}, max_effects=1)
    assert len(outcome.rounds[-1].fit.model.effects) <= 1


def test_no_cause_dominates(found):
    outcome = follow(found, {NONE: 0.05, WAVE: 0.40, RATE: 0.30, BUMP: 0.20})
    assert (outcome.verdict, outcome.effects) == ("ambiguous", ("wave",))


def test_something_else_is_more_probable(found):
    outcome = follow(found, {NONE: 0.05, WAVE: 0.25}, other=0.70)
    assert (outcome.verdict, outcome.effects, outcome.nearest) == ("unexplained", (), ("wave",))


def test_an_unexplained_residual_that_a_candidate_explains(found):
    system, outcome = found
    unexplained = replace(outcome, verdict="unexplained", effects=(), nearest=("wave",))
    assert follow((system, unexplained), {WAVE: 0.3}, other=0.7) is unexplained
    assert follow((system, unexplained), {WAVE: 0.9}).verdict == "ambiguous"


def test_forms_of_a_mechanism_count_under_the_named_one():
    """Below a third of the other form, the name is that of the other one."""
    effects = EFFECTS | {"twin": replace(EFFECTS["rate"], variant_of="rate")}
    outcome = search(elastic(np.random.default_rng(1), tests=4, effects=effects, hidden={"rate": 0.05}), max_effects=2)
    assert outcome.effects == ("rate",)
    twin = frozenset({"twin"})
    near, far = (by_named_forms(Posterior({RATE: a, twin: b}, {NONE: 0.05}), outcome) for a, b in ((0.4, 0.5), (0.1, 0.8)))
    assert near.closed == {RATE: pytest.approx(0.9)} and far.closed == {twin: pytest.approx(0.9)}


# ---- a tensile machine ----


def write_tensile_test(folder: Path) -> Path:
    """An Ogden strip (mu 25 kPa, alpha 4) up to a stretch of 1.6 and back, with 18 % hysteresis and 0.5 % noise."""
    t = np.linspace(0.0, 60.0, 61)
    stretch = 1.0 + 0.6 * (1.0 - np.abs(t / 30.0 - 1.0))
    stress = 2.0 * 25e3 / 4.0 * (stretch**3.0 - stretch**-3.0)
    loading = t <= 30.0
    loop = np.where(loading, 0.0, (stretch - 1.0) * (1.6 - stretch))
    work, area = (abs(np.trapezoid(y, stretch[part])) for y, part in ((stress[loading], loading), (loop[~loading], ~loading)))
    stress = stress - 0.18 * work / area * loop
    stress = stress + np.random.default_rng(1).normal(0.0, 0.005 * stress.max(), len(t))
    table = np.column_stack([t, stretch, stress])
    header = "time_s,stretch,nominal_stress_Pa"
    np.savetxt(folder / "cycle.csv", table, delimiter=",", header=header, comments="", fmt="%.8g")
    (folder / "dataset.toml").write_text(
        'format = "explicitfe-dataset/1"\nname = "tensile"\ntitle = "Tensile machine"\ntest = "tension"\n'
        '[specimen]\nshape = "point"\n[[curve]]\nid = "cycle"\nfile = "cycle.csv"\n',
        encoding="utf-8",
    )
    return folder


@pytest.fixture(scope="module")
def tensile(tmp_path_factory) -> LoopReport:
    folder = write_tensile_test(tmp_path_factory.mktemp("tensile"))
    return close_loop(folder, out=folder / "report", effects=["softening", "power-law", "compliance"], processes=1)


def test_the_report_of_a_tensile_test_agrees_with_its_probabilities(tensile):
    """The search ends at softening with compliance; the posterior favours softening with power-law relaxation."""
    top, probability = next(iter(tensile.posterior.items()))
    assert top == "power-law + softening" and probability > 0.5
    assert tensile.verdict == "ambiguous" and set(tensile.effects) == {"power-law", "softening"}
    assert {name.partition(".")[0] for name in tensile.final.parameters} >= {"power-law", "softening"}
    head = f"Most probable cause: power-law relaxation and softening by past load (Mullins) (probability {probability:.2f})"
    assert headline(tensile) == head


def test_terminal_document_and_page_say_the_same(tensile):
    folder = Path(tensile.files[0]).parent
    stream = io.StringIO()
    Console(file=stream, width=300).print(loop_tables(tensile))
    stored = LoopReport.model_validate_json((folder / "report.json").read_text(encoding="utf-8"))
    assert stored.sentence == tensile.sentence == sentence(stored)
    assert tensile.sentence in " ".join(stream.getvalue().split())
    assert f">{headline(stored)}</h1>" in (folder / "report.html").read_text(encoding="utf-8")
