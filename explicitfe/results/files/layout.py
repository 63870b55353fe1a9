"""What stands where in a result file: writer and reader both take it from here.

A result is plain HDF5 and at the same time a temporal VTKHDF UnstructuredGrid with a static mesh: N nodes, E hexes,
T stored steps. ``[T]`` marks a dataset that, until the run ends, has room for more steps than are stored: ``NSteps``
says how many are valid.

    /VTKHDF                                @Version = [2, 0]   @Type = "UnstructuredGrid", fixed-length ASCII
      NumberOfPoints = [N]   NumberOfCells = [E]   NumberOfConnectivityIds = [8E]
      Points (N, 3) m   Connectivity (8E)   Offsets (E+1)   Types (E) uint8, all 12
      PointData/<field> ([T]*N, components)    CellData/<field> ([T]*E, components)     @unit @description
      Steps                                @NSteps = T, the only counter
        Values (T) s   NumberOfParts [T] = 1   PartOffsets [T] = PointOffsets [T] = 0
        CellOffsets ([T], 1) = ConnectivityIdOffsets ([T], 1) = 0
        PointDataOffsets/<field> [T] = i*N   CellDataOffsets/<field> [T] = i*E
    /explicitfe                            @format = 3
      status/state                         fixed length; part of its header
      status/ending                        JSON: message, summary; of any length, as bytes; counts once the state is not "running"
      scenario                             text as the user wrote it, @sha256
      model   provenance                   JSON; model has the scenario with --set and defaults as "scenario"
      node_sets/<name>                     node numbers
      named_points/<name> (4)              element, and natural coordinates there; in format 1 a node number
      bones/<name>/                        surfaces at rest; the group is missing in files older than it
        points (k, 3) m   triangles (m, 3)
      fibres/<number>/                     of each muscle of the scenario; the group is missing in files older than it
        element (k)   natural (k, 3)   position (k, 3) m   begin (f), of the first point of each line
      history/<name> ([T], ...)            a row for each step; @unit @description
      checksums/PointData/<field> [T]      CRC-32 of the numbers of each step; likewise CellData/<field>
      checksums/history [T]                CRC-32 of each row, columns in the order of their names
      restart/slot0, slot1/                <array>; stored_at, unix time in s; seal = [sequence, checksum], 0: never written

Every dataset that does not grow with the steps, and status/ending, has the CRC-32 of its bytes as @crc32. Attributes, headers and
names are checked by HDF5 itself: the file is of the format of HDF5 1.8, and no string is of variable length.

Format 2 had status/message and status/summary of fixed lengths, no checksums, no stored_at, strings of variable length, and a
history of its own length, @rows of its group.

A dataset of one component has no second axis.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from zlib import crc32

import h5py
import numpy as np
import numpy.typing as npt

from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints

FORMAT_VERSION = 3
FIRST_FORMAT_WITH_CHECKSUMS = 3
POINT_DATA = "VTKHDF/PointData"
CELL_DATA = "VTKHDF/CellData"
STEPS = "VTKHDF/Steps"
STATE = "explicitfe/status/state"
ENDING = "explicitfe/status/ending"
SCENARIO = "explicitfe/scenario"
MODEL = "explicitfe/model"
PROVENANCE = "explicitfe/provenance"
NODE_SETS = "explicitfe/node_sets"
NAMED_POINTS = "explicitfe/named_points"
BONES = "explicitfe/bones"
FIBRES = "explicitfe/fibres"
HISTORY = "explicitfe/history"
CHECKSUMS = "explicitfe/checksums"
HISTORY_CHECKSUMS = "explicitfe/checksums/history"
RESTART_SLOTS = ("explicitfe/restart/slot0", "explicitfe/restart/slot1")

RUNNING, FINISHED, FAILED, INTERRUPTED = "running", "finished", "failed", "interrupted"
VTK_HEXAHEDRON = 12  # the number of this cell type in VTK
STATE_BYTES = 32
ENDING_BYTES_PER_CHUNK = 65536  # the first chunk is there from the beginning: a usual run needs no room when it ends
# What HDF5 itself checks when it reads: all but numbers and what lists the chunks. VTK reads it since it reads such files.
LIBRARY_VERSIONS = ("v108", "v108")
# HDF5 lists up to 64 chunks in one node of its index. While that suffices, lengthening a file is safe from a kill at
# every single write; splitting the node is not. So 16 steps a chunk are safe up to 1024 steps, and beyond that for all
# steps that were foreseen when the file was made.
STEPS_PER_CHUNK = 16
NUMBERS_PER_CHUNK = 1024
# Thousands of probes have thousands of columns: a chunk of each is not to fill the disk.
HISTORY_ROOM_BYTES = 2**21
FEWEST_ROWS_PER_CHUNK = 64
VALUES_PER_CHUNK = 16384  # the times cannot be lengthened ahead of their count: one chunk for all that are likely
INDEX_NODE_BYTES = 4096


@dataclass(frozen=True)
class Quantity:
    """What a stored number means.

    Attributes
    ----------
    unit : SI unit, such as ``"m"``; ``"1"`` for a ratio.
    components : 1 for a scalar, 3 for a vector.
    description : one line for whoever opens the file without this package.
    """

    unit: str
    components: int = 1
    description: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one value: ``()`` for a scalar."""
        return () if self.components == 1 else (self.components,)


DISPLACEMENT = Quantity("m", 3, "displacement of the nodes from their reference positions")
TIME = Quantity("s", 1, "time of each row of the history")


@dataclass(frozen=True)
class Declaration:
    """What a run will store, declared before its first sample.

    Attributes
    ----------
    mesh : the reference mesh; its node sets and named points are stored too.
    point_fields, cell_fields : name -> quantity of each field in addition to ``displacement`` (m), which is always stored.
    history : name -> quantity of each column of the history in addition to the time.
    bones : name -> points (k, 3) m and triangles (m, 3) of the surface of each bone at rest.
    fibres : fibre lines of each muscle of ``model["muscles"]``.
    """

    mesh: HexMesh
    point_fields: Mapping[str, Quantity] = field(default_factory=dict)
    cell_fields: Mapping[str, Quantity] = field(default_factory=dict)
    history: Mapping[str, Quantity] = field(default_factory=dict)
    bones: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    fibres: Sequence[Sequence[MaterialPoints]] = ()

    @property
    def points(self) -> dict[str, Quantity]:
        """All fields of nodes."""
        return {"displacement": DISPLACEMENT, **self.point_fields}

    @property
    def columns(self) -> dict[str, Quantity]:
        """All columns of the history."""
        return {"time": TIME, **self.history}


@dataclass(frozen=True)
class Origin:
    """Where a result comes from.

    Attributes
    ----------
    scenario_text : the scenario file as the user wrote it.
    model, provenance : JSON-able dicts.
    """

    scenario_text: str
    model: Mapping[str, object]
    provenance: Mapping[str, object]


def create(
    file: h5py.File,
    declared: Declaration,
    origin: Origin,
    *,
    fibres: Mapping[str, np.ndarray],
    restart: dict[str, np.ndarray],
    capacity: int,
    reserve: Callable[[int], None],
) -> None:
    """Write everything that is known before the first step and make room for ``capacity`` steps; see :func:`resize`."""
    mesh, history = declared.mesh, declared.columns
    n, m = mesh.node_count, mesh.element_count

    vtk = file.create_group("VTKHDF")
    vtk.attrs["Version"] = np.array([2, 0], dtype=np.int64)
    vtk.attrs["Type"] = np.bytes_("UnstructuredGrid")  # h5py's own strings are UTF-8: VTK before 9.5 fails on them
    for name, array in (
        ("NumberOfPoints", np.array([n])),
        ("NumberOfCells", np.array([m])),
        ("NumberOfConnectivityIds", np.array([8 * m])),
        ("Points", mesh.points),
        ("Connectivity", mesh.hexes.ravel()),
        ("Offsets", 8 * np.arange(m + 1)),
        ("Types", np.full(m, VTK_HEXAHEDRON, dtype=np.uint8)),
    ):
        _put(file, f"VTKHDF/{name}", array)

    # VTK copies all of Values into room for NSteps: too long a dataset crashes it, so the two are lengthened together.
    # Made one after the other they stand side by side in the file, NSteps first, and HDF5 writes them in this order.
    file.create_group(STEPS).attrs["NSteps"] = np.int64(0)
    _growing(file, f"{STEPS}/Values", (), "<f8", VALUES_PER_CHUNK).resize(1, axis=0)
    for name, shape in (
        ("NumberOfParts", ()),
        ("PartOffsets", ()),
        ("PointOffsets", ()),
        ("CellOffsets", (1,)),
        ("ConnectivityIdOffsets", (1,)),
    ):
        _growing(file, f"{STEPS}/{name}", shape, np.int64, NUMBERS_PER_CHUNK)
    own = file.create_group("explicitfe")
    own.attrs["format"] = FORMAT_VERSION
    for data, count, fields in ((POINT_DATA, n, declared.points), (CELL_DATA, m, declared.cell_fields)):
        file.create_group(data)
        for name, quantity in fields.items():
            _describe(_growing(file, f"{data}/{name}", quantity.shape, "<f8", STEPS_PER_CHUNK * count), quantity)
            _growing(file, offsets_of(f"{data}/{name}"), (), np.int64, NUMBERS_PER_CHUNK)
            _growing(file, checksums_of(f"{data}/{name}"), (), np.uint32, NUMBERS_PER_CHUNK)
    file.create_group(HISTORY)
    row_bytes = 8 * sum(quantity.components for quantity in history.values())
    rows = min(NUMBERS_PER_CHUNK, max(FEWEST_ROWS_PER_CHUNK, HISTORY_ROOM_BYTES // row_bytes))
    for name, quantity in history.items():
        _describe(_growing(file, f"{HISTORY}/{name}", quantity.shape, "<f8", rows), quantity)
    _growing(file, HISTORY_CHECKSUMS, (), np.uint32, NUMBERS_PER_CHUNK)
    make_room(file, 0, capacity, reserve)

    _create_state(file)
    _growing(file, ENDING, (), np.uint8, ENDING_BYTES_PER_CHUNK).resize(1, axis=0)
    file[ENDING].attrs["crc32"] = np.uint32(0)
    _put(file, SCENARIO, origin.scenario_text)
    file[SCENARIO].attrs["sha256"] = _text(hashlib.sha256(origin.scenario_text.encode()).hexdigest())
    _put(file, MODEL, to_json(origin.model))
    _put(file, PROVENANCE, to_json(origin.provenance))
    file.create_group(NODE_SETS)
    for name, nodes in mesh.node_sets.items():
        _put(file, f"{NODE_SETS}/{name}", np.asarray(nodes, dtype=np.int64))
    file.create_group(NAMED_POINTS)
    for name, point in mesh.named_points.items():
        _put(file, f"{NAMED_POINTS}/{name}", np.concatenate([point.element, point.natural[0]]).astype("<f8"))
    for name, (points, triangles) in declared.bones.items():
        _put(file, f"{BONES}/{name}/points", np.asarray(points, dtype="<f8"))
        _put(file, f"{BONES}/{name}/triangles", np.asarray(triangles, dtype=np.int64))
    for name, array in fibres.items():
        _put(file, name, array)

    for slot in RESTART_SLOTS:
        file.create_group(slot)
        for name, array in (restart | {"stored_at": np.zeros(())}).items():
            file[slot][name] = np.zeros_like(array)
        file[slot]["seal"] = np.zeros(2, dtype=np.uint64)


def make_room(file: h5py.File, start: int, stop: int, reserve: Callable[[int], None]) -> None:
    """Lengthen or shorten all per-step datasets but Values to ``stop`` steps; fill in the offsets from ``start`` on.

    Raises
    ------
    OSError : the disk has no room for them; the file is as it was.
    """
    steps = file[STEPS]
    constants = dict.fromkeys(("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"), 0)
    constants["NumberOfParts"] = 1
    lengths = {steps[name]: stop for name in constants}
    lengths |= dict.fromkeys([*file[HISTORY].values(), file[HISTORY_CHECKSUMS]], stop)
    counts = {}
    for data, counter in ((POINT_DATA, "NumberOfPoints"), (CELL_DATA, "NumberOfCells")):
        count = int(file["VTKHDF"][counter][0])
        for name, dataset in file[data].items():
            offsets = file[offsets_of(f"{data}/{name}")]
            counts[offsets] = count
            lengths |= {dataset: stop * count, offsets: stop, file[checksums_of(f"{data}/{name}")]: stop}
    resize(lengths, reserve)
    if stop > start:
        for name, value in constants.items():
            steps[name][start:] = value
        for offsets, count in counts.items():
            offsets[start:] = count * np.arange(start, stop, dtype=np.int64)


def resize(lengths: Mapping[h5py.Dataset, int], reserve: Callable[[int], None]) -> None:
    """Lengthen or shorten datasets to ``lengths`` rows.

    Parameters
    ----------
    reserve : makes sure of so many bytes more on the disk, all or nothing.

    Raises
    ------
    OSError : the disk has no room for them; nothing was changed.
    """
    needed = 0
    for dataset, length in lengths.items():
        chunks = -(-length // dataset.chunks[0]) + -len(dataset) // dataset.chunks[0]
        if chunks > 0:
            needed += chunks * math.prod(dataset.chunks) * dataset.dtype.itemsize
            needed += INDEX_NODE_BYTES * (1 + chunks // 32)
    if needed:
        reserve(needed)
    for dataset, length in lengths.items():
        dataset.resize(length, axis=0)


def offsets_of(field: str) -> str:
    """Where the offsets of a field stand: ``VTKHDF/PointData/x`` -> ``VTKHDF/Steps/PointDataOffsets/x``."""
    _, data, name = field.split("/")
    return f"{STEPS}/{data}Offsets/{name}"


def checksums_of(field: str) -> str:
    """Where the checksums of a field stand: ``VTKHDF/PointData/x`` -> ``explicitfe/checksums/PointData/x``."""
    return f"{CHECKSUMS}/{field.removeprefix('VTKHDF/')}"


def seal(sequence: int, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """[sequence, checksum] of a restart slot, uint64: a slot that was torn by a kill does not match its seal."""
    checksum = crc32(str(sequence).encode())
    for name in sorted(arrays):
        checksum = crc32(np.ascontiguousarray(arrays[name]).tobytes(), crc32(name.encode(), checksum))
    return np.array([sequence, checksum], dtype=np.uint64)


def checksums(steps: np.ndarray) -> np.ndarray:
    """CRC-32 of each step of an array (k, ...), as it is stored: (k,) uint32."""
    return np.array([crc32(step) for step in np.ascontiguousarray(steps)], dtype=np.uint32)


def history_table(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Rows of the history, (k,) or (k, components) each, as their checksums take them: (k, numbers) in the order of the names."""
    return np.concatenate([columns[name].reshape(len(columns[name]), -1) for name in sorted(columns)], axis=1)


def to_json(value: object) -> str:
    """JSON text; numpy arrays and numbers become lists and numbers."""
    text = json.dumps(value, indent=1, ensure_ascii=False, default=lambda item: item.tolist())
    return text.encode(errors="backslashreplace").decode()  # bytes of a path that are not UTF-8, as JSON escapes such as \udcff


def _put(file: h5py.File, name: str, value: np.ndarray | str) -> None:
    """Store what does not change any more, with its checksum."""
    data = value.encode() if isinstance(value, str) else value.tobytes()
    file[name] = _text(value) if isinstance(value, str) else value
    file[name].attrs["crc32"] = np.uint32(crc32(data))


def _text(text: str) -> np.ndarray:
    """A string of fixed length, UTF-8: HDF5 keeps those of variable length where it checks nothing."""
    data = text.encode()
    return np.array(data, dtype=h5py.string_dtype("utf-8", max(1, len(data))))


def _describe(dataset: h5py.Dataset, quantity: Quantity) -> None:
    dataset.attrs["unit"] = _text(quantity.unit)
    dataset.attrs["description"] = _text(quantity.description)


def _create_state(file: h5py.File) -> None:
    """The state, as part of its dataset's header: written at once, and checked by HDF5."""
    compact = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    compact.set_layout(h5py.h5d.COMPACT)
    kind = h5py.h5t.py_create(h5py.string_dtype("utf-8", STATE_BYTES), logical=True)
    folder = file.require_group(STATE.rpartition("/")[0])
    h5py.h5d.create(folder.id, b"state", kind, h5py.h5s.create(h5py.h5s.SCALAR), dcpl=compact)


def _growing(file: h5py.File, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike, chunk: int) -> h5py.Dataset:
    """An empty dataset that can be lengthened along its first axis.

    Its chunks are placed in the file and filled with zeros when it is lengthened. So storing a step writes numbers and
    no structure, which keeps the file readable when the process is killed in between, and the file is never shorter
    than its header says.
    """
    placed_early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    placed_early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    placed_early.set_fill_time(h5py.h5d.FILL_TIME_ALLOC)
    return file.create_dataset(
        name, shape=(0, *shape), maxshape=(None, *shape), dtype=dtype, chunks=(chunk, *shape), dcpl=placed_early
    )
