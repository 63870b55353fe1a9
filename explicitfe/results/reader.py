"""Reads result files: finished, failed, killed, or still being written."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypedDict

import h5py
import numpy as np

from explicitfe.errors import InputError, nearest
from explicitfe.mesh.hexmesh import HexMesh, MaterialPoints, shape_functions
from explicitfe.results import layout
from explicitfe.results.layout import Quantity
from explicitfe.results.provenance import Provenance
from explicitfe.results.run_summary import PointAtRest, point_at_rest

if TYPE_CHECKING:
    import pyvista

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


class FieldInfo(NamedTuple):
    """A stored field: ``kind`` is ``"point"`` or ``"cell"``; ``quantity`` has unit, components and description."""

    kind: str
    quantity: Quantity


class RestartState(NamedTuple):
    """The state to go on from: ``sequence`` counts the states that the run stored, ``arrays`` is name -> array."""

    sequence: int
    arrays: dict[str, np.ndarray]


class StoredBone(NamedTuple):
    """The surface of a bone: ``points`` (k, 3) m, ``triangles`` (m, 3), counter-clockwise seen from outside the bone."""

    points: np.ndarray
    triangles: np.ndarray


class StoredQuantity(TypedDict):
    """A stored quantity as ``inspect`` names it."""

    name: str
    unit: str
    components: int
    description: str


class StoredField(StoredQuantity):
    """A stored field: ``kind`` is ``"point"`` or ``"cell"``."""

    kind: str


class ResultContents(TypedDict):
    """What a result file holds: the answer of ``explicitfe inspect --json``.

    ``time_s`` has the first and the last stored time, ``every_s`` the mean time between samples, ``last`` the last row of the
    history; ``node_sets`` says how many nodes each set has. ``summary`` and ``model`` are as :class:`Result` gives them.
    """

    path: str
    status: str
    live: bool
    message: str
    summary: Mapping[str, Any]
    nodes: int
    elements: int
    steps: int
    time_s: list[float]
    every_s: float | None
    fields: list[StoredField]
    history: list[StoredQuantity]
    history_rows: int
    last: dict[str, float | list[float]]
    node_sets: dict[str, int]
    named_points: dict[str, PointAtRest]
    scenario_sha256: str
    model: Mapping[str, Any]
    provenance: Provenance


def open_result(path: Path | str) -> Result:
    """Open a result file; use it in a ``with`` block.

    Raises
    ------
    InputError : ``path`` is missing, a folder, no HDF5 file, HDF5 but no result, or damaged.
    """
    return Result(path)


class Result:
    """A result file opened for reading; numbers are read when asked for.

    Only the valid steps are shown: after a kill that is up to the last stored sample.

    Attributes
    ----------
    path : the file.
    live : whether another process is writing it now. A ``status`` of ``"running"`` that is not live is a killed run.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._file, self.live = _open_file(self.path)
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
        """Close the file."""
        self._file.close()

    @property
    def status(self) -> str:
        """``"finished"``, ``"inverted"``, ``"diverged"``, ``"unstable"`` or ``"interrupted"``; ``"running"`` when the run goes
        on or was killed. ``message`` says why a run ended early.
        """
        return self._text(f"{layout.STATUS}/state")

    @property
    def message(self) -> str:
        """One sentence on how the run ended; may be empty."""
        return self._text(f"{layout.STATUS}/message")

    @property
    def summary(self) -> Mapping[str, Any]:
        """What the run came to, as ``results/run_summary.py`` describes it; empty until it ends."""
        stored: dict[str, object] = json.loads(self._text(f"{layout.STATUS}/summary"))
        return stored

    @property
    def scenario_text(self) -> str:
        """The scenario file as the user wrote it."""
        return self._text(layout.SCENARIO)

    @property
    def scenario_sha256(self) -> str:
        """SHA-256 of the scenario text, hexadecimal."""
        return self._file[layout.SCENARIO].attrs["sha256"]

    @property
    def model(self) -> Mapping[str, Any]:
        """The model that was run; ``model["scenario"]`` is its scenario with ``--set`` and defaults filled in."""
        stored: dict[str, object] = json.loads(self._text(layout.MODEL))
        return stored

    @property
    def provenance(self) -> Provenance:
        """Versions, commit, machine and start time."""
        stored: Provenance = json.loads(self._text(layout.PROVENANCE))
        return stored

    @cached_property
    def mesh(self) -> HexMesh:
        """The reference mesh with its node sets and named points."""
        vtk = self._file["VTKHDF"]
        mesh = HexMesh(
            points=self._read(vtk["Points"]),
            hexes=self._read(vtk["Connectivity"]).reshape(-1, 8),
            node_sets={name: self._read(nodes) for name, nodes in self._file[layout.NODE_SETS].items()},
        )
        named = {name: self._read(point) for name, point in self._file[layout.NAMED_POINTS].items()}
        return replace(mesh, named_points={name: _point(mesh, stored) for name, stored in named.items()})

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the stored steps, (T,), s."""
        steps = self._file[layout.STEPS]
        return self._read(steps["Values"], slice(0, int(steps.attrs["NSteps"])))

    @cached_property
    def fields(self) -> dict[str, FieldInfo]:
        """The stored fields by name."""
        return {
            name: FieldInfo(kind, _quantity(dataset))
            for kind, data in (("point", layout.POINT_DATA), ("cell", layout.CELL_DATA))
            for name, dataset in self._file[data].items()
        }

    @cached_property
    def history_names(self) -> dict[str, Quantity]:
        """The history by name, ``time`` among it."""
        return {name: _quantity(dataset) for name, dataset in self._file[layout.HISTORY].items()}

    def field(self, name: str, step: int = -1, *, time_s: float | None = None) -> np.ndarray:
        """One field at one step.

        Parameters
        ----------
        name : one of ``fields``.
        step : 0 to T - 1, or from the end, -1 the last.
        time_s : s; when given, the stored step nearest to it is taken instead of ``step``.

        Returns
        -------
        (N,) or (N, components) for point fields, (E,) or (E, components) for cell fields, in the field's unit.

        Raises
        ------
        InputError : no such field or step, or a time outside the stored ones.
        """
        if name not in self.fields:
            raise InputError(f'{self.path} has no field "{name}"; {nearest(name, self.fields)}')
        step = self._step(step, time_s)
        dataset, count = self._field(name)
        return self._read(dataset, slice(step * count, (step + 1) * count))

    def displacement(self, step: int = -1, *, time_s: float | None = None) -> np.ndarray:
        """Displacement of the nodes from their reference positions at one step, (N, 3), m."""
        return self.field("displacement", step, time_s=time_s)

    def history(self, name: str) -> np.ndarray:
        """One history, (rows,) or (rows, components), in its unit; ``history("time")`` has the times of the rows."""
        if name not in self.history_names:
            raise InputError(f'{self.path} has no history "{name}"; {nearest(name, self.history_names)}')
        rows = int(self._file[layout.HISTORY].attrs["rows"])
        return self._read(self._file[layout.HISTORY][name], slice(0, rows))

    def probe(self, name: str) -> np.ndarray:
        """Displacement of a named point at each of ``times``, (T, 3), m."""
        points = self.mesh.named_points
        if name not in points:
            raise InputError(f'{self.path} has no named point "{name}"; {nearest(name, points)}')
        dataset, count = self._field("displacement")
        shares = shape_functions(points[name].natural[0])
        corners = np.flatnonzero(shares)  # mostly fewer than eight: a point lies on the surface, or in a plane of symmetry
        nodes = self.mesh.hexes[points[name].element[0], corners]
        moved = [[self._read(dataset, step * count + node) for node in nodes] for step in range(len(self.times))]
        return np.einsum("a,tai->ti", shares[corners], np.array(moved).reshape(-1, len(corners), 3))

    @cached_property
    def bones(self) -> dict[str, StoredBone]:
        """The bones that the body may touch, by name, at rest; empty where the run had none."""
        stored = self._file.get(layout.BONES, {})
        return {name: StoredBone(self._read(bone["points"]), self._read(bone["triangles"])) for name, bone in stored.items()}

    def placement(self, bone: str, step: int = -1, *, time_s: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Where a bone is at one step, given as in :meth:`field`: R (3, 3) and s (3,) m; its point X is at R X + s."""
        if f"bone_{bone}_placement" not in self.history_names:
            return np.eye(3), np.zeros(3)
        row = int(np.argmin(np.abs(self.history("time") - self.times[self._step(step, time_s)])))
        entries = self.history(f"bone_{bone}_placement")[row]
        return entries[:9].reshape(3, 3), entries[9:]

    def placed_bones(self, step: int = -1, *, time_s: float | None = None) -> dict[str, StoredBone]:
        """The bones where they are at one step, given as in :meth:`field`."""
        placed = {}
        for name, bone in self.bones.items():
            rotation, shift = self.placement(name, step, time_s=time_s)
            placed[name] = bone._replace(points=bone.points @ rotation.T + shift)
        return placed

    def mesh_at(self, step: int = -1, *, time_s: float | None = None, warped: bool = False) -> pyvista.UnstructuredGrid:
        """The mesh with all fields at one step, as pyvista and ParaView see it.

        Parameters
        ----------
        step, time_s : as in :meth:`field`.
        warped : whether the points are the deformed positions instead of the reference positions.
        """
        if self.live:
            raise InputError(f"{self.path} is being written; pyvista can open it when the run has ended")
        step = self._step(step, time_s)
        import pyvista  # takes a second: only those who draw pay for it

        # pyvista's own reader has no notion of time for this format (up to 0.49.1): ask VTK's.
        reader = pyvista.get_reader(self.path).reader
        reader.UpdateTimeStep(self.times[step])
        grid = pyvista.wrap(reader.GetOutputDataObject(0))
        # VTK before 9.3 shows the first step at all times and says nothing.
        if not np.array_equal(grid.point_data.get("displacement"), self.displacement(step), equal_nan=True):
            version = ".".join(map(str, pyvista.vtk_version_info))
            raise InputError(f"VTK {version} does not show step {step} of {self.path} as stored; install VTK 9.3 or later")
        if warped:
            grid.points = grid.points + grid.point_data["displacement"]
        return grid

    def restart_state(self) -> RestartState | None:
        """The newest whole restart state; None when none was stored. A slot that a kill tore is passed over."""
        states = []
        for slot in layout.RESTART_SLOTS:
            try:
                arrays = {name: dataset[()] for name, dataset in self._file[slot].items()}
            except OSError:
                continue
            stored = arrays.pop("seal")
            sequence = int(stored[0])
            if sequence and np.array_equal(stored, layout.seal(sequence, arrays)):
                states.append(RestartState(sequence, arrays))
        return max(states, key=lambda state: state.sequence, default=None)

    def contents(self) -> ResultContents:
        """What the file holds, ready for JSON."""
        rows = int(self._file[layout.HISTORY].attrs["rows"])
        return {
            "path": str(self.path),
            "status": self.status,
            "live": self.live,
            "message": self.message,
            "summary": self.summary,
            "nodes": self.mesh.node_count,
            "elements": self.mesh.element_count,
            "steps": len(self.times),
            "time_s": [float(time) for time in self.times[[0, -1]]] if len(self.times) else [],
            "every_s": float(np.ptp(self.times)) / (len(self.times) - 1) if len(self.times) > 1 else None,
            "fields": [_stored_field(name, info) for name, info in self.fields.items()],
            "history": [_stored_quantity(name, quantity) for name, quantity in self.history_names.items()],
            "history_rows": rows,
            "last": {name: self.history(name)[-1].tolist() for name in self.history_names} if rows else {},
            "node_sets": {name: len(nodes) for name, nodes in self.mesh.node_sets.items()},
            "named_points": {name: point_at_rest(point) for name, point in self.mesh.named_points.items()},
            "scenario_sha256": self.scenario_sha256,
            "model": self.model,
            "provenance": self.provenance,
        }

    def _step(self, step: int, time_s: float | None) -> int:
        """Number of a stored step, 0 to T - 1."""
        count = len(self.times)
        if not count:
            raise InputError(f"{self.path} holds no stored step")
        if time_s is None:
            if not -count <= step < count:
                raise InputError(f"{self.path} has no step {step}; it has 0 to {count - 1}")
            return step % count
        first, last = self.times[0], self.times[-1]
        rounding = 1e-9 * max(abs(first), abs(last))
        if not first - rounding <= time_s <= last + rounding:
            raise InputError(f"{self.path} has no time {time_s} s; it has {first} s to {last} s")
        return int(np.argmin(np.abs(self.times - time_s)))

    def _text(self, name: str) -> str:
        return self._read(self._file[name]).decode()

    def _read(self, dataset: h5py.Dataset, rows: slice | np.integer | tuple[()] = ()) -> Any:
        try:
            return dataset[rows]
        except OSError as error:
            raise self._damaged(f"{dataset.name} cannot be read") from error

    def _check_layout(self) -> None:
        """InputError unless the file has everything that the other methods take for granted."""
        try:
            if "explicitfe" not in self._file or "VTKHDF" not in self._file:
                raise InputError(f"{self.path} is an HDF5 file but no result of explicitfe")
            version = int(self._file["explicitfe"].attrs["format"])
            if version > layout.FORMAT_VERSION:
                raise InputError(f"{self.path} has format {version}, newer than this explicitfe; install a newer one")
            parts = (layout.STATUS, layout.SCENARIO, layout.MODEL, layout.PROVENANCE, layout.NODE_SETS)
            for part in (*parts, layout.NAMED_POINTS, layout.HISTORY, *layout.RESTART_SLOTS):
                if part not in self._file:
                    raise self._damaged(f"{part} is missing")
            for name in self.fields:
                dataset, count = self._field(name)
                if len(dataset) < len(self.times) * count:
                    raise self._damaged(f"{name} is shorter than {len(self.times)} steps")
        except (KeyError, RuntimeError, OSError) as error:
            raise self._damaged(str(error)) from error

    def _field(self, name: str) -> tuple[h5py.Dataset, int]:
        """The dataset of a field and how many rows of it are one step."""
        if self.fields[name].kind == "point":
            return self._file[layout.POINT_DATA][name], self.mesh.node_count
        return self._file[layout.CELL_DATA][name], self.mesh.element_count

    def _damaged(self, what: str) -> InputError:
        return InputError(f"{self.path} is damaged ({what}); run the scenario again")


def _point(mesh: HexMesh, stored: np.ndarray) -> MaterialPoints:
    """A named point as stored: an element and natural coordinates, or, in format 1, a node number."""
    if stored.ndim == 0:
        return mesh.points_at_nodes([int(stored)])
    return mesh.points_in(stored[:1].astype(np.int64), stored[None, 1:])


def _stored_quantity(name: str, quantity: Quantity) -> StoredQuantity:
    return {
        "name": name,
        "unit": quantity.unit,
        "components": quantity.components,
        "description": quantity.description,
    }


def _stored_field(name: str, info: FieldInfo) -> StoredField:
    quantity = info.quantity
    return {
        "name": name,
        "kind": info.kind,
        "unit": quantity.unit,
        "components": quantity.components,
        "description": quantity.description,
    }


def _quantity(dataset: h5py.Dataset) -> Quantity:
    components = dataset.shape[1] if dataset.ndim == 2 else 1
    return Quantity(dataset.attrs["unit"], int(components), dataset.attrs["description"])


def _open_file(path: Path) -> tuple[h5py.File, bool]:
    """The open file, and whether another process is writing it."""
    if path.is_dir():
        raise InputError(f"{path} is a folder; name the .vtkhdf file in it")
    try:
        with path.open("rb") as file:
            signature = file.read(len(HDF5_SIGNATURE))
    except FileNotFoundError as error:
        left = layout.running_path(path)
        hint = f"; a run that goes on or was killed has {left}" if left.exists() else ""
        raise InputError(f"{path} does not exist{hint}") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error
    if signature != HDF5_SIGNATURE:
        raise InputError(f"{path} is no HDF5 file, so it is no result of explicitfe")
    try:
        try:
            return h5py.File(path, "r"), False
        except BlockingIOError:
            return h5py.File(path, "r", locking=False), True
    except OSError as error:
        raise InputError(f"{path} is damaged (HDF5 cannot open it: {error}); run the scenario again") from error
