"""What is known of a run when it begins: whether its result has room, and whether anybody will see its end."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path

from explicitfe.errors import InputError, RunWarning
from explicitfe.host.memory import in_words

# The smallest tongue takes 3 us a step: with more steps than this it takes five weeks, and any other mesh years.
MOST_STEPS = 1e12
LONG_RUN_S = 86_400.0
_DAYS_OF_A_YEAR = 365.25


def check_room(target: Path, result_bytes: float, advice: str) -> None:
    """Refuse a result that the disk has no room for, before anything is computed.

    Parameters
    ----------
    target : where the result goes; its folder need not exist yet.
    result_bytes : about how large it will be.
    advice : what to change; ends the sentence.

    Raises
    ------
    InputError : says how large it would be, and what there is.
    """
    folder = next((parent for parent in target.absolute().parents if parent.is_dir()), None)
    if folder is None:
        return  # the writer says what is wrong with it
    free = shutil.disk_usage(folder).free
    if result_bytes > free:
        raise InputError(
            f"the result would have about {in_words(result_bytes)}, and {in_words(free)} are free in {folder}; {advice}."
        )


def check_steps(steps: float, step_s: float) -> None:
    """Refuse a run that no machine ends.

    Raises
    ------
    InputError : says how many steps it would take.
    """
    if steps > MOST_STEPS:
        raise InputError(
            f"the run would take {steps:.2g} steps of {1e6 * step_s:.3g} microseconds, and no machine does more than "
            f"{MOST_STEPS:.0e}; take a shorter analysis.duration_ms, a coarser mesh, or softer or heavier tissue, and leave "
            "analysis.step_us out."
        )


def warn_of_long_run(seconds: float, work: str) -> None:
    """Say how long a run will take, where nobody waits for it: more than a day."""
    if seconds > LONG_RUN_S:
        days = seconds / LONG_RUN_S
        time = f"{days:.2g} days" if days < _DAYS_OF_A_YEAR else f"{days / _DAYS_OF_A_YEAR:.2g} years"
        warnings.warn(
            f"at its present speed this run takes {time} ({work}); it can be stopped with Ctrl-C and gone on with later.",
            RunWarning,
            stacklevel=2,
        )
