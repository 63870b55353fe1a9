"""Checks when a run starts: free disk space for its result, and its duration."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path

from explicitfe.platform.errors import InputError, MachineError, RunWarning
from explicitfe.platform.host.memory import in_words

# The smallest tongue takes 3 us a step: with more steps than this it takes five weeks, and any other mesh years.
MOST_STEPS = 1e12
LONG_RUN_S = 86_400.0
_DAYS_OF_A_YEAR = 365.25


def check_room(target: Path, result_bytes: float, advice: str) -> None:
    """Refuse a run whose result would not fit on the disk.

    Parameters
    ----------
    target : path of the result; its folder need not exist yet.
    result_bytes : estimated size of the result.
    advice : what to change; ends the sentence.

    Raises
    ------
    MachineError : the free space is smaller than the estimated size.
    """
    folder = next((parent for parent in target.absolute().parents if parent.is_dir()), None)
    if folder is None:
        return  # the writer reports what is wrong with it
    free = shutil.disk_usage(folder).free
    if result_bytes > free:
        raise MachineError(
            f"the result needs about {in_words(result_bytes)}, but only {in_words(free)} are free in {folder}; {advice}."
        )


def check_steps(steps: float, step_s: float) -> None:
    """Refuse a run of an impossible number of steps.

    Raises
    ------
    InputError : the run would take more than ``MOST_STEPS`` steps.
    """
    if steps > MOST_STEPS:
        raise InputError(
            f"the run would take {steps:.2g} steps of {1e6 * step_s:.3g} microseconds; the limit is {MOST_STEPS:.0e}. Reduce "
            "analysis.duration_ms, use a coarser mesh or softer or denser tissue, and remove analysis.step_us."
        )


def warn_of_long_run(seconds: float, work: str) -> None:
    """Warn of a run that will take more than a day."""
    if seconds > LONG_RUN_S:
        days = seconds / LONG_RUN_S
        time = f"{days:.2g} days" if days < _DAYS_OF_A_YEAR else f"{days / _DAYS_OF_A_YEAR:.2g} years"
        warnings.warn(
            f"at the present speed this run takes {time} ({work}); Ctrl-C interrupts it, 'explicitfe resume' continues it later.",
            RunWarning,
            stacklevel=2,
        )
