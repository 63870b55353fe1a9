"""A sentence on a result whose run has not finished."""

from __future__ import annotations

from explicitfe.results.files.layout import FINISHED, RUNNING
from explicitfe.results.files.reader import Result


def note_on_ending(result: Result) -> str:
    """A sentence that the run was interrupted or killed, has failed or is in progress; empty if it is finished."""
    if result.status == FINISHED:
        return ""
    if result.status == RUNNING:
        reached = f"{1e3 * result.times[-1]:.6g} ms" if len(result.times) else "its first sample"
        state = "is in progress and has reached" if result.live else "was killed after"
        return f"{result.path} is not finished: its run {state} {reached}."
    return f"{result.path} is not finished: {result.message or result.status}"
