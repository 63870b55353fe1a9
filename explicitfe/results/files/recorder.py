"""What a run hands its samples to: a file that is written, or memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np


class Recorder(ABC):
    """Takes samples."""

    @abstractmethod
    def samples(
        self,
        times_s: np.ndarray,
        rows: Mapping[str, np.ndarray],
        point_data: Mapping[str, np.ndarray],
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Take fields and history at some times; each array has the samples along its first axis."""

    def sample(
        self,
        time_s: float,
        row: Mapping[str, float | np.ndarray],
        point_data: Mapping[str, np.ndarray],
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Take one sample; see :meth:`samples`."""
        one_row, one_point, one_cell = (
            {name: np.asarray(value)[None] for name, value in (some or {}).items()} for some in (row, point_data, cell_data)
        )
        self.samples(np.array([time_s], dtype=float), one_row, one_point, one_cell)
