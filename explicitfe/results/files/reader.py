"""Reading of result files: of finished, failed, killed and running simulations."""

from __future__ import annotations

import hashlib
import shlex
import time
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast, overload

import numpy as np

from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.extras import require
from explicitfe.results.documents.run_summary import TransientModelDescription, kind_of, point_at_rest, with_history
from explicitfe.results.files import layout
from explicitfe.results.files.contents import (
    FieldInfo,
    NoSummary,
    RestartState,
    ResultContents,
    StoredBone,
    StoredField,
    StoredQuantity,
    StoredRestart,
)
from explicitfe.results.files.description import description_of
from explicitfe.results.files.export.table import table_of
from explicitfe.results.files.fibres import read_fibres
from explicitfe.results.files.layout import Quantity
from explicitfe.results.files.provenance import Provenance
from explicitfe.results.files.recorded import Recorded
from explicitfe.results.files.stored import BusyError, StoredFile

if TYPE_CHECKING:
    import pandas
    import pyvista


# A run changes its file for a few milliseconds at a time.
ATTEMPTS_AT_A_LIVE_FILE = 10
BETWEEN_ATTEMPTS_S = 0.02


class Result(Recorded):
    """An open result file. Numbers are read when they are needed.

    Only complete samples are read; after a killed run these are all samples up to the last stored one. Numbers are compared with
    their checksums, and every method raises InputError if the file is damaged.

    Parameters
    ----------
    path : the file; see :func:`explicitfe.open_result`.

    Attributes
    ----------
    path : the file.
    live : whether another process is writing it now. A ``status`` of ``"running"`` that is not live is a killed run.
    format : version of the layout; 3 is the present one.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._stored = StoredFile(self.path)
        self.live, self.format = self._stored.live, self._stored.format
        self._whole: dict[str, np.ndarray] = {}  # name of a field -> which of its steps were compared with their checksums
        try:
            self._check_layout()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; afterwards only what was read before is known."""
        self._stored.close()

    @cached_property
    def status(self) -> str:
        """``"finished"``, ``"inverted"``, ``"diverged"``, ``"unstable"`` or ``"interrupted"``; ``"running"`` if the run continues
        or was killed. ``message`` is the reason of an early end.
        """
        return self._stored.text(layout.STATE, in_header=True)

    @property
    def message(self) -> str:
        """One sentence on how the run ended; may be empty."""
        return self._ending[0]

    @property
    def summary(self) -> Mapping[str, Any]:
        """Summary of the run, with the keys of ``explicitfe run --json``; empty until it ends."""
        return self._ending[1]

    @property
    def scenario_text(self) -> str:
        """The scenario file as the user wrote it."""
        text = self._stored.text(layout.SCENARIO)
        if hashlib.sha256(text.encode()).hexdigest() != self._stored.text_attribute(layout.SCENARIO, "sha256"):
            raise self._stored.damaged("its scenario is not what was stored")
        return text

    @property
    def scenario_sha256(self) -> str:
        """SHA-256 of the scenario text, hexadecimal."""
        return hashlib.sha256(self.scenario_text.encode()).hexdigest()

    @property
    def model(self) -> Mapping[str, Any]:
        """The model that was run; ``model["scenario"]`` is its scenario with ``--set`` and defaults filled in."""
        return self._stored.table(layout.MODEL)

    @property
    def provenance(self) -> Provenance:
        """Versions, commit, machine and start time."""
        return cast(Provenance, self._stored.table(layout.PROVENANCE))

    @cached_property
    def mesh(self) -> HexMesh:
        """The reference mesh with its node sets and named points."""
        points = self._stored.numbers("VTKHDF/Points", axes=(2,))
        corners = self._stored.numbers("VTKHDF/Connectivity", "i", axes=(1,))
        if points.shape[1] != 3 or not np.isfinite(points).all():
            raise self._stored.damaged("VTKHDF/Points are no positions")
        if len(corners) % 8 or not _within(corners, len(points)):
            raise self._stored.damaged("VTKHDF/Connectivity has no eight nodes of the mesh for each element")
        sets = {
            name: self._numbers_of_nodes(f"{layout.NODE_SETS}/{name}", len(points))
            for name in self._stored.names(layout.NODE_SETS)
        }
        mesh = HexMesh(points, corners.reshape(-1, 8), sets)
        return replace(mesh, named_points={name: self._point(mesh, name) for name in self._stored.names(layout.NAMED_POINTS)})

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the stored steps, (T,), s."""
        values = self._stored.numbers(f"{layout.STEPS}/Values", rows=slice(None), axes=(1,))
        # The two are two writes: a kill may fall between them.
        count = self._stored.whole_number(layout.STEPS, "NSteps")
        if self.status != layout.RUNNING and count != len(values):
            raise self._stored.damaged(f"it counts {count} steps and has {len(values)} times")
        times = values[:count]
        if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
            raise self._stored.damaged("the times of its steps do not rise")
        return times

    @cached_property
    def fields(self) -> dict[str, FieldInfo]:
        """The stored fields by name."""
        return {
            name: FieldInfo(kind, self._quantity(f"{data}/{name}"))
            for kind, data in (("point", layout.POINT_DATA), ("cell", layout.CELL_DATA))
            for name in self._stored.names(data)
        }

    @cached_property
    def history_names(self) -> dict[str, Quantity]:
        """Names and units of the histories, including ``time``."""
        return {name: self._quantity(f"{layout.HISTORY}/{name}") for name in self._stored.names(layout.HISTORY)}

    def history(self, name: str) -> np.ndarray:
        """Read one history: a quantity at every sample.

        Parameters
        ----------
        name : one of ``history_names``, such as ``"time"`` or ``"kinetic_energy"``.

        Returns
        -------
        (rows,) or (rows, components), in its unit. A row is a sample; files of format 2 and before may have more rows.

        Raises
        ------
        InputError : no such history.
        """
        if name not in self.history_names:
            raise InputError(f'{self.path} has no history "{name}"; {nearest(name, self.history_names)}')
        return self._histories[name]

    @cached_property
    def bones(self) -> dict[str, StoredBone]:
        """Surfaces of the bones at rest, by name; empty if the run had none."""
        names = self._stored.names(layout.BONES) if self._stored.has(layout.BONES) else []
        return {name: self._bone(f"{layout.BONES}/{name}") for name in names}

    @cached_property
    def fibres(self) -> list[list[MaterialPoints]]:
        """For each muscle of ``model["muscles"]`` the lines of its fibres; empty if none are stored."""
        return read_fibres(self._stored, self.mesh, len(self.model.get("muscles", [])))

    def mesh_at(self, step: int = -1, *, time_s: float | None = None, warped: bool = False) -> pyvista.UnstructuredGrid:
        """The mesh with all fields at one step, as a mesh of pyvista.

        It is built from checked arrays, as VTK's own reader ends the process if the file is damaged.

        Parameters
        ----------
        step, time_s : as in :meth:`field`.
        warped : whether the points are the deformed positions instead of the reference positions.
        """
        step = self._step(step, time_s)
        require("view", "a mesh for pyvista")
        import pyvista  # takes a second, so only where it is used

        points = self.mesh.points + self.displacement(step) if warped else self.mesh.points
        grid = pyvista.UnstructuredGrid({layout.VTK_HEXAHEDRON: self.mesh.hexes}, points)
        for name, (kind, _) in self.fields.items():
            data = grid.point_data if kind == "point" else grid.cell_data
            data[name] = self._of_step(name, step)
        return grid

    def restart_state(self) -> RestartState | None:
        """The newest complete restart state; None if none was stored."""
        return max(self.restart_states(), key=lambda state: state.sequence, default=None)

    def restart_states(self) -> list[RestartState]:
        """The complete restart states, two at most; one that was interrupted while it was written is skipped."""
        states = []
        for slot in layout.RESTART_SLOTS:
            try:
                arrays = self._stored.all_of(slot)
            except InputError:
                continue
            seal = arrays.pop("seal", np.zeros(0))
            sequence = int(seal[0]) if seal.shape == (2,) and seal.dtype == np.uint64 else 0
            if sequence and np.array_equal(seal, layout.seal(sequence, arrays)):
                stored_at = float(arrays.pop("stored_at")) if "stored_at" in arrays else None
                states.append(RestartState(sequence, stored_at, arrays))
        return states

    def _restart(self) -> StoredRestart | None:
        """The state from which the run can be resumed, if it was stopped or killed."""
        state = None if self.live or self.status not in (layout.RUNNING, layout.INTERRUPTED) else self.restart_state()
        if state is None or "samples" not in state.arrays:
            return None
        moment = None if state.stored_at is None else datetime.fromtimestamp(state.stored_at, UTC).isoformat(timespec="seconds")
        return {
            "samples": int(state.arrays["samples"]),
            "stored_utc": moment,
            "command": f"explicitfe resume {shlex.quote(str(self.path))}",
        }

    def to_pandas(self, *, positions: bool = False, history: bool = False) -> pandas.DataFrame:
        """Probes over time, or the curve of an indentation, as a table of pandas.

        Parameters
        ----------
        positions : positions of the probes in the frame of the model instead of displacements.
        history : the other columns of the history too; an indentation always has them.

        Returns
        -------
        A row for each sample, with ``time_ms`` as index, or ``indentation_mm`` for an indentation. Columns have their unit in the
        name, such as ``tip_forward_mm`` and ``tip_speed_mm_s``.

        Raises
        ------
        InputError : pandas is not installed, or the file is damaged.
        """
        require("pandas", "a table of pandas")
        import pandas

        table = pandas.DataFrame(table_of(self, positions=positions, history=history))
        return table.set_index("time_ms" if kind_of(self.model) == "transient" else "indentation_mm")

    def __repr__(self) -> str:
        try:
            return description_of(self)
        except InputError as error:  # a damaged or closed file
            return f"Result {str(self.path)!r}: {error}"

    def contents(self) -> ResultContents:
        """Contents of the file as a dictionary for JSON: what ``explicitfe inspect --json`` prints."""
        rows = len(self.history("time"))
        return {
            "path": str(self.path),
            "status": self.status,
            "live": self.live,
            "message": self.message,
            "summary": cast(NoSummary, self.summary),
            "nodes": self.mesh.node_count,
            "elements": self.mesh.element_count,
            "steps": len(self.times),
            "time_s": [float(time) for time in self.times[[0, -1]]] if len(self.times) else [],
            "every_s": float(np.ptp(self.times)) / (len(self.times) - 1) if len(self.times) > 1 else None,
            "fields": [
                cast(StoredField, {"name": name, **vars(info.quantity), "kind": info.kind}) for name, info in self.fields.items()
            ],
            "history": [cast(StoredQuantity, {"name": name, **vars(of)}) for name, of in self.history_names.items()],
            "history_rows": rows,
            "last": {name: self.history(name)[-1].tolist() for name in self.history_names} if rows else {},
            "node_sets": {name: len(nodes) for name, nodes in self.mesh.node_sets.items()},
            "named_points": {name: point_at_rest(point) for name, point in self.mesh.named_points.items()},
            "scenario_sha256": self.scenario_sha256,
            "model": cast(TransientModelDescription, self.model),
            "provenance": self.provenance,
            "restart": self._restart(),
        }

    # ---- inside ----

    def _of_step(self, name: str, step: int) -> np.ndarray:
        """A field at a step, 0 to T - 1, compared with its checksum."""
        path, count = self._field(name)
        array = self._stored.numbers(path, rows=slice(step * count, (step + 1) * count))
        if self.format >= layout.FIRST_FORMAT_WITH_CHECKSUMS:
            if name not in self._whole:
                self._whole[name] = self._stored.numbers(layout.checksums_of(path), "i", slice(0, len(self.times)), axes=(1,))
            if layout.checksums(array[None])[0] != self._whole[name][step]:
                raise self._stored.damaged(f"{name} of step {step} is not what was stored")
        return array

    def _field(self, name: str) -> tuple[str, int]:
        """Where a field stands, and how many rows of it are one step."""
        if self.fields[name].kind == "point":
            return f"{layout.POINT_DATA}/{name}", self.mesh.node_count
        return f"{layout.CELL_DATA}/{name}", self.mesh.element_count

    @cached_property
    def _histories(self) -> dict[str, np.ndarray]:
        """All of the history, compared with its checksums."""
        old = self.format < layout.FIRST_FORMAT_WITH_CHECKSUMS
        count = self._stored.whole_number(layout.HISTORY, "rows") if old else len(self.times)
        columns = {
            name: self._stored.numbers(f"{layout.HISTORY}/{name}", rows=slice(0, count), axes=(1, 2))
            for name in self.history_names
        }
        if "time" not in columns or any(len(column) != count for column in columns.values()):
            raise self._stored.damaged(f"its history is shorter than {count} rows")
        if not old and count:
            sums = self._stored.numbers(layout.HISTORY_CHECKSUMS, "i", slice(0, count), axes=(1,))
            if not np.array_equal(sums, layout.checksums(layout.history_table(columns))):
                raise self._stored.damaged("its history is not what was stored")
            if not np.array_equal(columns["time"], self.times):
                raise self._stored.damaged("its steps and its history have different times")
        return columns

    @cached_property
    def _ending(self) -> tuple[str, dict[str, Any]]:
        """Message and summary."""
        if self.format < layout.FIRST_FORMAT_WITH_CHECKSUMS:
            return self._stored.text("explicitfe/status/message"), self._stored.table("explicitfe/status/summary")
        if self.status == layout.RUNNING:
            return "", {}
        ending = self._stored.table(layout.ENDING)
        message, summary = ending.get("message"), ending.get("summary")
        if not isinstance(message, str) or not isinstance(summary, dict):
            raise self._stored.damaged(f"{layout.ENDING} has no message or no summary")
        return message, with_history(summary, self._histories)

    def _check_layout(self) -> None:
        """InputError unless the file has everything that the other methods take for granted."""
        parts = (layout.STATE, layout.SCENARIO, layout.MODEL, layout.PROVENANCE, layout.NODE_SETS, layout.NAMED_POINTS)
        for part in (*parts, layout.HISTORY, *layout.RESTART_SLOTS):
            if not self._stored.has(part):
                raise self._stored.damaged(f"{part} is missing")
        if "displacement" not in self.fields or self.fields["displacement"].kind != "point":
            raise self._stored.damaged("it has no displacement")
        for name, (_, quantity) in self.fields.items():
            path, count = self._field(name)
            if self._stored.shape(path, axes=(1, 2))[0] < len(self.times) * count:
                raise self._stored.damaged(f"{name} is shorter than {len(self.times)} steps")
            if name == "displacement" and quantity.components != 3:
                raise self._stored.damaged("its displacement has no three components")

    def _quantity(self, name: str) -> Quantity:
        shape = self._stored.shape(name, axes=(1, 2))
        unit, description = (self._stored.text_attribute(name, key) for key in ("unit", "description"))
        return Quantity(unit, int(shape[1]) if len(shape) == 2 else 1, description)

    def _numbers_of_nodes(self, name: str, count: int, axes: tuple[int, ...] = (1,)) -> np.ndarray:
        numbers = self._stored.numbers(name, "i", axes=axes)
        if not _within(numbers, count):
            raise self._stored.damaged(f"{name} has numbers of no node")
        return numbers

    def _point(self, mesh: HexMesh, name: str) -> MaterialPoints:
        """A named point as stored: an element and natural coordinates, or, in format 1, a node number."""
        path = f"{layout.NAMED_POINTS}/{name}"
        if self.format == 1:
            return mesh.points_at_nodes([int(self._numbers_of_nodes(path, mesh.node_count, axes=(0,)))])
        stored = self._stored.numbers(path, axes=(1,))
        if stored.shape != (4,) or not 0 <= stored[0] < mesh.element_count or not (np.abs(stored[1:]) <= 1.0 + 1e-9).all():
            raise self._stored.damaged(f"{path} is no point of the mesh")
        return mesh.points_in(stored[:1].astype(np.int64), stored[None, 1:])

    def _bone(self, path: str) -> StoredBone:
        points = self._stored.numbers(f"{path}/points", axes=(2,))
        triangles = self._numbers_of_nodes(f"{path}/triangles", len(points), axes=(2,))
        if points.shape[1] != 3 or triangles.shape[1] != 3:
            raise self._stored.damaged(f"{path} is no surface")
        return StoredBone(points, triangles)


ResultT = TypeVar("ResultT", bound=Result)


@overload
def open_result(path: Path | str) -> Result: ...
@overload
def open_result(path: Path | str, kind: type[ResultT]) -> ResultT: ...
def open_result(path: Path | str, kind: type[Result] = Result) -> Result:
    """Open a result file; use it in a ``with`` block.

    Parameters
    ----------
    path : the file.
    kind : class of the open result.

    Raises
    ------
    InputError : ``path`` is missing, a folder, no HDF5 file, HDF5 but no result, or damaged.
    """
    for _ in range(ATTEMPTS_AT_A_LIVE_FILE - 1):
        try:
            return kind(path)
        except BusyError:
            time.sleep(BETWEEN_ATTEMPTS_S)
    return kind(path)


def _within(numbers: np.ndarray, count: int) -> bool:
    return bool((numbers >= 0).all() and (numbers < count).all())
