"""Anderson's mixing of the corrections of a fixed-point iteration (Anderson 1965)."""

from __future__ import annotations

import numpy as np

# More corrections add little, as the systems that are solved are nearly linear.
MIXED_CORRECTIONS = 6


class Mixing:
    """The last states of an iteration and their corrections."""

    def __init__(self) -> None:
        self._states: list[np.ndarray] = []
        self._changes: list[np.ndarray] = []

    def next(self, state: np.ndarray, change: np.ndarray) -> np.ndarray:
        """The next state: the combination of the last corrections that leaves least to change."""
        if self._changes and np.abs(change).max() > np.abs(self._changes[-1]).max():
            self._states, self._changes = [], []  # The mixing has led astray: a plain step is next.
        self._states = [*self._states[-MIXED_CORRECTIONS:], state]
        self._changes = [*self._changes[-MIXED_CORRECTIONS:], change]
        moves, drops = np.diff(self._states, axis=0).T, np.diff(self._changes, axis=0).T
        return state + change - (moves + drops) @ np.linalg.lstsq(drops, change, rcond=None)[0]
