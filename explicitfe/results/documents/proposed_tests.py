"""What ``explicitfe design-test --propose`` answers."""

from __future__ import annotations

from pydantic import Field

from explicitfe.results.documents.document import Document
from explicitfe.results.documents.loop_report import NextExperiment


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
