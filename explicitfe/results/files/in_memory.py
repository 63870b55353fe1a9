"""A result that is never a file: filled by a run as a result file is, measured as one is, and gone with its process."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.results.files import layout
from explicitfe.results.files.contents import FieldInfo, StoredBone
from explicitfe.results.files.layout import Declaration, Quantity
from explicitfe.results.files.recorded import Recorded, Recorder


class ResultInMemory(Recorded, Recorder):
    """The samples of one run.

    A run begins it, appends samples and finishes it, with the methods that :class:`~.writer.ResultWriter` has;
    afterwards it is read as :class:`~.reader.Result` is. States to go on from are not kept.

    Parameters
    ----------
    path : what messages call it.

    Attributes
    ----------
    last_row : name -> number or (components,), the last row of the history; empty before the first sample.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.last_row: dict[str, np.ndarray] = {}
        self._status = layout.RUNNING
        self._times: list[np.ndarray] = []
        self._rows: dict[str, list[np.ndarray]] = {}
        self._data: dict[str, list[np.ndarray]] = {}

    # ---- filled by a run ----

    def begin(self, declared: Declaration, model: Mapping[str, object]) -> Self:
        """Declare what will be stored."""
        self._mesh, self._model = declared.mesh, model
        self._bones = {name: StoredBone(*surface) for name, surface in declared.bones.items()}
        self._fields = {name: FieldInfo("point", quantity) for name, quantity in declared.points.items()}
        self._fields |= {name: FieldInfo("cell", quantity) for name, quantity in declared.cell_fields.items()}
        self._history_names = declared.columns
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        """Nothing is to be closed."""

    def samples(
        self,
        times_s: np.ndarray,
        rows: Mapping[str, np.ndarray],
        point_data: Mapping[str, np.ndarray],
        cell_data: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Append samples: times (k,) s, columns (k, ...) of the history, fields (k, N or E, ...)."""
        if not len(times_s):
            return
        self._times.append(np.array(times_s, dtype=float))
        for name, column in {"time": times_s, **rows}.items():
            self._rows.setdefault(name, []).append(np.array(column, dtype=float))
        for name, array in {**point_data, **(cell_data or {})}.items():
            self._data.setdefault(name, []).extend(np.array(array, dtype=float))
        self.last_row = {name: parts[-1][-1] for name, parts in self._rows.items()}

    def restart(self, arrays: Mapping[str, npt.ArrayLike]) -> None:
        """Pass over a state to go on from."""

    def place(self, status: str) -> Path:
        """What messages call it."""
        return self.path

    def finish(self, status: str, message: str, summary: Mapping[str, object]) -> Path:
        """Note how the run ended."""
        self._status = status
        return self.path

    def hand_to(self, recorder: Recorder) -> None:
        """Give all samples to another recorder, such as a file that is written."""
        rows = {name: np.concatenate(parts) for name, parts in self._rows.items() if name != "time"}
        points, cells = (
            {name: np.array(data) for name, data in self._data.items() if self._fields[name].kind == kind}
            for kind in ("point", "cell")
        )
        recorder.samples(self.times, rows, points, cells)

    def copy_with(self, last: np.ndarray, histories: Mapping[str, np.ndarray]) -> ResultInMemory:
        """A copy whose last displacements are changed by ``last`` (N, 3) m, and some histories by ``histories``."""
        other = copy.copy(self)
        before = self._data["displacement"]
        other._data = {**self._data, "displacement": [*before[:-1], before[-1] + last]}
        other._rows = {**self._rows, **{name: [self.history(name) + change] for name, change in histories.items()}}
        return other

    # ---- read ----

    @property
    def status(self) -> str:
        return self._status

    @property
    def model(self) -> Mapping[str, Any]:
        return self._model

    @property
    def mesh(self) -> HexMesh:
        return self._mesh

    @property
    def times(self) -> np.ndarray:
        return np.concatenate([np.zeros(0), *self._times])

    @property
    def fields(self) -> dict[str, FieldInfo]:
        return self._fields

    @property
    def history_names(self) -> dict[str, Quantity]:
        return self._history_names

    @property
    def bones(self) -> dict[str, StoredBone]:
        return self._bones

    def history(self, name: str) -> np.ndarray:
        return np.concatenate(self._rows[name])

    def _of_step(self, name: str, step: int) -> np.ndarray:
        return self._data[name][step].copy()  # as a file gives it: the reader's own
