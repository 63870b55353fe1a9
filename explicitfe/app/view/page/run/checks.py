"""The checks of a stored run: whether it finished, and which warnings its own checks gave."""

from __future__ import annotations

from dataclasses import dataclass

from explicitfe.results.files import Result
from explicitfe.results.files.layout import FINISHED, RUNNING


@dataclass(frozen=True)
class Checks:
    """Outcome of the checks of a run; ``failed`` has one sentence per check that failed."""

    failed: list[str]

    @property
    def all_passed(self) -> bool:
        """Whether no check failed."""
        return not self.failed


def checks_of(result: Result) -> Checks:
    """Outcome of the checks of a run: that it finished, and those of energy, mesh and contact whose warnings it stored."""
    warnings = [str(sentence) for sentence in result.summary.get("warnings") or []]
    return Checks([*_unfinished(result), *warnings])


def _unfinished(result: Result) -> list[str]:
    """The sentence on a run that has not finished; empty for a finished run."""
    if result.status == FINISHED:
        return []
    if result.status == RUNNING:
        return (
            ["the run is still in progress; this page shows the samples stored so far."]
            if result.live
            else ["the run was killed before it finished; this page shows the samples stored until then."]
        )
    return [f"the run ended early ({result.status}): {result.message or 'no reason is stored.'}"]
