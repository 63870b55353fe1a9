"""The kinds of analysis in the terminal: each is a module with the same four functions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from rich.console import RenderableType

from explicitfe.app.view.terminal import indentation, transient
from explicitfe.app.view.terminal.rows import StoredTimes


class AnalysisTables(Protocol):
    """Functions of the module of a kind of analysis."""

    def summary_table(self, summary: Any) -> RenderableType:
        """Summary of a run."""

    def check_table(self, file: str, report: Any) -> RenderableType:
        """Check of a scenario before it is run."""

    def times_text(self, times: StoredTimes) -> str:
        """Times of the stored samples."""

    def stored_rows(self, summary: Any) -> Iterator[tuple[str, str]]:
        """Rows on the results of a stored run."""


# analysis.type of a scenario -> the module that describes a run of that kind.
KINDS: dict[str, AnalysisTables] = {"transient": transient, "relaxation": indentation}
