"""Custom measures: functions of the user that are evaluated for each run of a sweep."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from explicitfe.platform.errors import InputError, RunError
from explicitfe.results.files import Recorded

Measuring = Callable[[Recorded, int], Mapping[str, object]]
"""Returns named numbers of a result at a step."""


@dataclass(frozen=True)
class OwnMeasure:
    """A custom measure. Workers import the function by its name.

    Raises
    ------
    InputError : the function is not defined at the top level of a module.
    """

    function: Measuring

    def __post_init__(self) -> None:
        if "<" in getattr(self.function, "__qualname__", "<"):
            raise InputError(
                f"measures: workers cannot import {self.function!r}. Define the function at the top level of a module."
            )

    @property
    def name(self) -> str:
        """Name of the function; its columns begin with it."""
        return self.function.__name__

    @property
    def full_name(self) -> str:
        """Name of the function with its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"

    @property
    def sha256(self) -> str:
        """Checksum of its source, or of its name if the source is not available; a changed measure defines another sweep."""
        try:
            source = inspect.getsource(self.function)
        except (OSError, TypeError):
            source = self.full_name
        return hashlib.sha256(source.encode()).hexdigest()

    def of(self, result: Recorded, step: int) -> dict[str, Any]:
        """Evaluate the function for a step of a result.

        Raises
        ------
        RunError : the function raised an exception, or did not return a dict of numbers.
        """
        try:
            value = self.function(result, step)
        except Exception as error:  # user code may raise anything
            raise RunError(f"measure {self.full_name} raised {type(error).__name__}: {error}") from None
        if not isinstance(value, Mapping):
            raise RunError(f"measure {self.full_name} returned {type(value).__name__}; it must return a dict of numbers.")
        return {str(key): self._plain(str(key), cell) for key, cell in value.items()}

    def _plain(self, key: str, cell: object) -> Any:
        """A value of a table."""
        if isinstance(cell, Mapping):
            return {str(inner): self._plain(f"{key}.{inner}", part) for inner, part in cell.items()}
        if isinstance(cell, np.generic):
            cell = cell.item()
        if cell is None or isinstance(cell, (bool, int, float)):
            return cell
        raise RunError(
            f'measure {self.full_name} returned "{key}" as {type(cell).__name__}; valid types are numbers, booleans, None and '
            "dicts of them."
        )
