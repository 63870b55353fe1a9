"""Whether the numbers of a run may be quoted, and if not, why."""

from __future__ import annotations

from dataclasses import dataclass

from explicitfe.results import Result
from explicitfe.results.layout import FINISHED, RUNNING


@dataclass(frozen=True)
class Quotability:
    """A verdict on a run; ``reasons`` are the sentences that speak against quoting it, none where it may be quoted."""

    reasons: list[str]

    @property
    def is_quotable(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.reasons


def quotability(result: Result) -> Quotability:
    """Whether a run finished, and none of the checks that every run makes of itself had anything to warn of."""
    warnings = [str(sentence) for sentence in result.summary.get("warnings") or []]
    return Quotability([*_ending(result), *warnings])


def _ending(result: Result) -> list[str]:
    """What is to be said where a run did not come to its end."""
    if result.status == FINISHED:
        return []
    if result.status == RUNNING:
        return ["the run goes on; this is what it has stored so far." if result.live else "the run was killed before its end."]
    return [f"the run ended early ({result.status}): {result.message or 'no reason is stored.'}"]
