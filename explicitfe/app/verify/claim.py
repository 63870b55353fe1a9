"""A claim: its sentence, reference, tolerance, limits and computation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from explicitfe.platform.errors import RunError
from explicitfe.platform.host import shipped
from explicitfe.results.documents.run_summary import RunSummary
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.measure import measure
from explicitfe.simulate.run.run import run

Evidence = Literal["closed form", "other program", "published", "measured data", "own data"]
"""Kind of reference. "own data" are simulated with this program, with other numerical settings or with a hidden effect."""


@dataclass(frozen=True)
class ClaimFigure:
    """The computed figure of a claim.

    Attributes
    ----------
    text : the figures as a text.
    off : deviation from the reference, in the unit of the claim.
    """

    text: str
    off: float


@dataclass
class Workshop:
    """A temporary folder in which claims are computed; runs are shared between claims.

    Attributes
    ----------
    folder : for results and datasets; it is deleted afterwards.
    """

    folder: Path
    _summaries: dict[tuple[str, ...], RunSummary] = field(default_factory=dict)

    def run(self, scenario: str, *settings: str) -> RunSummary:
        """Run a scenario that comes with the program, unless another claim has run it, and give its summary.

        Raises
        ------
        RunError : the run did not finish.
        """
        key = (scenario, *settings)
        if key not in self._summaries:
            place = self.folder / f"run-{len(self._summaries)}"
            self._summaries[key] = run(shipped.scenario_file(scenario), place, settings=settings)
        summary = self._summaries[key]
        if summary["status"] != "finished":
            raise RunError(f"{scenario}: {summary['message']}")
        return summary

    def measures(self, scenario: str, *settings: str, formants: bool = False) -> Measures:
        """Measures at the end of such a run."""
        return measure(Path(self.run(scenario, *settings)["result"]), formants=formants)


@dataclass(frozen=True)
class Claim:
    """One row of the page "Is it true?".

    Attributes
    ----------
    name : name for ``explicitfe verify --only``.
    sentence : the claim.
    evidence : kind of the reference.
    reference, source : value of the reference, and its origin.
    allowed, unit, because : largest permitted deviation, its unit, and its reason.
    fails : limits of the claim.
    figure : computes the figure.
    seconds : approximate duration, for the progress display.
    """

    name: str
    sentence: str
    evidence: Evidence
    reference: str
    source: str
    allowed: float
    because: str
    fails: str
    figure: Callable[[Workshop], ClaimFigure]
    seconds: float
    unit: str = ""
