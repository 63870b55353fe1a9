"""Measures of a user's own: functions, which members of a sweep are measured with beside the built-in ones."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from explicitfe.errors import InputError, RunError
from explicitfe.results import Recorded

Measuring = Callable[[Recorded, int], Mapping[str, object]]
"""Gives numbers by their names, of a result at a step."""


@dataclass(frozen=True)
class OwnMeasure:
    """A function of the user's. Workers import it by its name.

    Raises
    ------
    InputError : it stands in no module, where a worker could find it.
    """

    function: Measuring

    def __post_init__(self) -> None:
        if "<" in getattr(self.function, "__qualname__", "<"):
            raise InputError(f"measures: {self.function!r} cannot be found by a worker; give a function that a module defines.")

    @property
    def name(self) -> str:
        """Of the function: columns begin with it."""
        return self.function.__name__

    @property
    def full_name(self) -> str:
        """With its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"

    @property
    def sha256(self) -> str:
        """Of its source, as far as that is known: a changed measure makes another sweep."""
        try:
            source = inspect.getsource(self.function)
        except (OSError, TypeError):
            source = self.full_name
        return hashlib.sha256(source.encode()).hexdigest()

    def of(self, result: Recorded, step: int) -> dict[str, Any]:
        """What the function gives for a step of a result.

        Raises
        ------
        RunError : it ended with an exception, or gave something other than numbers by their names.
        """
        try:
            value = self.function(result, step)
        except Exception as error:  # whatever a user's code does is to be a sentence
            raise RunError(f"measure {self.full_name} ended with {type(error).__name__}: {error}") from None
        if not isinstance(value, Mapping):
            raise RunError(f"measure {self.full_name} gave {type(value).__name__}; it is to give a dict of numbers.")
        return {str(key): self._plain(str(key), cell) for key, cell in value.items()}

    def _plain(self, key: str, cell: object) -> Any:
        """A cell as a table has it."""
        if isinstance(cell, Mapping):
            return {str(inner): self._plain(f"{key}.{inner}", part) for inner, part in cell.items()}
        if isinstance(cell, np.generic):
            cell = cell.item()
        if cell is None or isinstance(cell, (bool, int, float)):
            return cell
        raise RunError(
            f'measure {self.full_name} gave "{key}" as {type(cell).__name__}; numbers, booleans, None and dicts of them are kept.'
        )
