"""What is known of a scenario before it runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explicitfe.platform.errors import Progress, silent
from explicitfe.results.documents.run_summary import CheckReport
from explicitfe.simulate.run.prepare import prepare


def check(path: Path | str, settings: Sequence[str] = (), progress: Progress = silent) -> CheckReport:
    """Validate, build and measure a scenario; nothing is run and nothing written.

    The wall time is predicted from the time that the element forces take now, on this machine.

    Parameters
    ----------
    path : scenario file, or the name of a scenario that comes with the program.
    settings : ``key=value`` pairs that replace what the file says.
    progress : called with the stage and the share of it that is done.

    Raises
    ------
    InputError : what is wrong with it, in one sentence.
    """
    return prepare(path, settings).check(progress)
