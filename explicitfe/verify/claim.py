"""What a claim is: a sentence, what it is compared with, how far off it may be, where it fails, and how it is computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from explicitfe.errors import RunError
from explicitfe.host import shipped
from explicitfe.results.run_summary import RunSummary
from explicitfe.run.run import run

Evidence = Literal["closed form", "other program", "published", "measured data", "own data"]
"""What a claim is compared with. "own data" are those of this program with other numerics, or with a secret in them."""


@dataclass(frozen=True)
class ClaimFigure:
    """What a claim came to.

    Attributes
    ----------
    text : the figures, in words.
    off : how far from the reference, in the unit of the claim.
    """

    text: str
    off: float


@dataclass
class Workshop:
    """Where claims are computed; what one has run another one need not run again.

    Attributes
    ----------
    folder : for results and datasets; nothing in it is kept.
    """

    folder: Path
    _summaries: dict[tuple[str, ...], RunSummary] = field(default_factory=dict)

    def run(self, scenario: str, *settings: str) -> RunSummary:
        """The summary of a run of a scenario that comes with the program.

        Raises
        ------
        RunError : it did not come to its end.
        """
        key = (scenario, *settings)
        if key not in self._summaries:
            place = self.folder / f"run-{len(self._summaries)}"
            self._summaries[key] = run(shipped.scenario_file(scenario), place, settings=settings)
        summary = self._summaries[key]
        if summary["status"] != "finished":
            raise RunError(f"{scenario}: {summary['message']}")
        return summary


@dataclass(frozen=True)
class Claim:
    """One line of the page.

    Attributes
    ----------
    name : by which ``explicitfe verify --only`` asks for it.
    sentence : what is claimed.
    reference, source : what it is compared with, and from where that is.
    allowed, unit : the largest deviation at which it holds, and why that much stands in ``because``.
    fails : how far it goes: where it does not hold, or is not known to.
    figure : computes it.
    seconds : about how long that takes, by which progress goes on.
    """

    name: str
    sentence: str
    evidence: Evidence
    reference: str
    source: str
    allowed: float
    unit: str
    because: str
    fails: str
    figure: Callable[[Workshop], ClaimFigure]
    seconds: float
