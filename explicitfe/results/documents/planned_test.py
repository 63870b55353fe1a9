"""Answers of ``explicitfe design-test``: a planned test, and proposed tests. Only keys that were set are written."""

from __future__ import annotations

from pydantic import BaseModel, Field

from explicitfe.results.documents.document import Document
from explicitfe.results.documents.loop_report import NextExperiment


class EffectInTest(BaseModel):
    """What a planned test could say of one effect.

    Attributes
    ----------
    strength, unit : the parameter that is its strength, and the unit of ``smallest`` and ``largest_plausible``; "" is none.
    shows : whether its largest plausible strength would show.
    visible : squared distance to the model without it, at that strength, over the covariance.
    smallest : the smallest strength that would show; None if it is beyond the bounds.
    hides_in : constant -> the relative change that would imitate the effect up to there; of one that is 0, over the other one.
    reason : why it does not show.
    nearest, separation : of the effects that the test tells from it (of all where it tells none) the one that imitates it best,
        and how far off that one stays.
    cannot_tell_from : effects that the test would not tell from it.
    """

    effect: str
    strength: str
    unit: str = ""
    shows: bool
    visible: float = 0.0
    largest_plausible: float | None = None
    smallest: float | None = None
    hides_in: dict[str, float] = {}
    reason: str = ""
    nearest: str | None = None
    separation: float | None = None
    cannot_tell_from: list[str] = []


class PlannedTest(Document):
    """What a planned test can find and tell apart.

    Attributes
    ----------
    protocol, file : its title, and where it is described.
    n_eff : number of independent data that it would give.
    constants : of the tissue that is expected.
    effects : those that show most first.
    runs : of the simulator.
    files : what was written; the key is there if a folder was asked for.
    """

    protocol: str
    file: str
    n_eff: float
    constants: dict[str, float]
    effects: list[EffectInTest]
    runs: int
    files: list[str] = Field(default=[])


class ProposedTests(Document):
    """Tests that would settle what is open in a dataset, the best first.

    Attributes
    ----------
    dataset, file : its name, and where it stands.
    verdict, sure : of the closed loop, and the probability that it is right.
    posterior : cause -> probability.
    tests : none where no test within the limits of the rig is expected to tell much.
    files : what was written; the key is there if a folder was asked for.
    """

    dataset: str
    file: str
    verdict: str
    sure: float | None
    posterior: dict[str, float]
    tests: list[NextExperiment]
    files: list[str] = Field(default=[])
