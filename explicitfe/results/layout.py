"""What stands where in a result file: writer and reader both take it from here.

A result is plain HDF5 and at the same time a temporal VTKHDF UnstructuredGrid with a static mesh: N nodes, E hexes,
T stored steps. ``[T]`` marks a dataset that, until the run ends, has room for more steps than are stored: ``NSteps``
says how many are valid.

    /VTKHDF                                @Version = [2, 0]   @Type = "UnstructuredGrid", fixed-length ASCII
      NumberOfPoints = [N]   NumberOfCells = [E]   NumberOfConnectivityIds = [8E]
      Points (N, 3) m   Connectivity (8E)   Offsets (E+1)   Types (E) uint8, all 12
      PointData/<field> ([T]*N, components)    CellData/<field> ([T]*E, components)     @unit @description
      Steps                                @NSteps = T
        Values (T) s   NumberOfParts [T] = 1   PartOffsets [T] = PointOffsets [T] = 0
        CellOffsets ([T], 1) = ConnectivityIdOffsets ([T], 1) = 0
        PointDataOffsets/<field> [T] = i*N   CellDataOffsets/<field> [T] = i*E
    /explicitfe                            @format = 2
      status/state, message, summary       fixed length; summary is JSON
      scenario                             text as the user wrote it, @sha256
      model   provenance                   JSON; model has the scenario with --set and defaults as "scenario"
      node_sets/<name>                     node numbers
      named_points/<name> (4)              element, and natural coordinates there; in format 1 a node number
      bones/<name>/                        surfaces at rest; the group is missing in files older than it
        points (k, 3) m   triangles (m, 3)
      history/<name> (rows, ...)           @unit @description; the group's @rows says how many rows are valid
      restart/slot0, slot1/                <array>, and seal = [sequence, checksum]; sequence 0: never written

A dataset of one component has no second axis.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import h5py
import numpy as np
import numpy.typing as npt

from explicitfe.mesh.hexmesh import HexMesh

FORMAT_VERSION = 2
POINT_DATA = "VTKHDF/PointData"
CELL_DATA = "VTKHDF/CellData"
STEPS = "VTKHDF/Steps"
STATUS = "explicitfe/status"
SCENARIO = "explicitfe/scenario"
MODEL = "explicitfe/model"
PROVENANCE = "explicitfe/provenance"
NODE_SETS = "explicitfe/node_sets"
NAMED_POINTS = "explicitfe/named_points"
BONES = "explicitfe/bones"
HISTORY = "explicitfe/history"
RESTART_SLOTS = ("explicitfe/restart/slot0", "explicitfe/restart/slot1")

VTK_HEXAHEDRON = 12  # the number of this cell type in VTK
# Bytes kept for what is only known at the end, so that the end of a run overwrites and does not rearrange.
STATUS_BYTES = {"state": 32, "message": 4096, "summary": 262144}
# HDF5 lists up to 64 chunks in one node of its index. While that suffices, lengthening a file is safe from a kill at
# every single write; splitting the node is not. So 16 steps a chunk are safe up to 1024 steps, and beyond that for all
# steps that were foreseen when the file was made.
STEPS_PER_CHUNK = 16
NUMBERS_PER_CHUNK = 1024
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


def running_path(path: Path) -> Path:
    """What a result is called while its run goes on."""
    return path.with_name(f"{path.stem}.running.vtkhdf")


def create(
    file: h5py.File,
    *,
    mesh: HexMesh,
    bones: Mapping[str, tuple[np.ndarray, np.ndarray]],
    point_fields: Mapping[str, Quantity],
    cell_fields: Mapping[str, Quantity],
    history: Mapping[str, Quantity],
    scenario_text: str,
    model: Mapping[str, object],
    provenance: Mapping[str, object],
    restart: Mapping[str, np.ndarray],
    capacity: int,
) -> None:
    """Write everything that is known before the first step and make room for ``capacity`` steps."""
    n, m = mesh.node_count, mesh.element_count

    vtk = file.create_group("VTKHDF")
    vtk.attrs["Version"] = np.array([2, 0], dtype=np.int64)
    vtk.attrs["Type"] = np.bytes_("UnstructuredGrid")  # h5py's own strings are UTF-8: VTK before 9.5 fails on them
    vtk["NumberOfPoints"] = np.array([n], dtype=np.int64)
    vtk["NumberOfCells"] = np.array([m], dtype=np.int64)
    vtk["NumberOfConnectivityIds"] = np.array([8 * m], dtype=np.int64)
    vtk["Points"] = np.asarray(mesh.points, dtype="<f8")
    vtk["Connectivity"] = np.asarray(mesh.hexes, dtype=np.int64).ravel()
    vtk["Offsets"] = 8 * np.arange(m + 1, dtype=np.int64)
    vtk["Types"] = np.full(m, VTK_HEXAHEDRON, dtype=np.uint8)

    # VTK copies all of Values into room for NSteps: too long a dataset crashes it, so the two are lengthened together.
    # Made one after the other they stand side by side in the file, NSteps first, and HDF5 writes them as one piece.
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
    for data, count, fields in ((POINT_DATA, n, point_fields), (CELL_DATA, m, cell_fields)):
        file.create_group(data)
        for name, quantity in fields.items():
            dataset = _growing(file, f"{data}/{name}", quantity.shape, "<f8", STEPS_PER_CHUNK * count)
            dataset.attrs["unit"] = quantity.unit
            dataset.attrs["description"] = quantity.description
            _growing(file, offsets_of(f"{data}/{name}"), (), np.int64, NUMBERS_PER_CHUNK)
    make_room(file, 0, capacity)

    own = file.create_group("explicitfe")
    own.attrs["format"] = FORMAT_VERSION
    for name, size in STATUS_BYTES.items():
        file.create_dataset(f"{STATUS}/{name}", data=b"", dtype=h5py.string_dtype("utf-8", size))
    file[SCENARIO] = scenario_text
    file[SCENARIO].attrs["sha256"] = hashlib.sha256(scenario_text.encode()).hexdigest()
    file[MODEL] = to_json(model)
    file[PROVENANCE] = to_json(provenance)
    file.create_group(NODE_SETS)
    for name, nodes in mesh.node_sets.items():
        file[NODE_SETS][name] = np.asarray(nodes, dtype=np.int64)
    file.create_group(NAMED_POINTS)
    for name, point in mesh.named_points.items():
        file[NAMED_POINTS][name] = np.concatenate([point.element, point.natural[0]]).astype("<f8")

    for name, (points, triangles) in bones.items():
        file[f"{BONES}/{name}/points"] = np.asarray(points, dtype="<f8")
        file[f"{BONES}/{name}/triangles"] = np.asarray(triangles, dtype=np.int64)

    file.create_group(HISTORY).attrs["rows"] = np.int64(0)
    for name, quantity in history.items():
        dataset = _growing(file, f"{HISTORY}/{name}", quantity.shape, "<f8", NUMBERS_PER_CHUNK)
        dataset.attrs["unit"] = quantity.unit
        dataset.attrs["description"] = quantity.description
    resize(file, dict.fromkeys(file[HISTORY].values(), NUMBERS_PER_CHUNK))

    for slot in RESTART_SLOTS:
        file.create_group(slot)
        for name, array in restart.items():
            file[slot][name] = np.zeros_like(array)
        file[slot]["seal"] = np.zeros(2, dtype=np.uint64)


def make_room(file: h5py.File, start: int, stop: int) -> None:
    """Lengthen or shorten all per-step datasets but Values to ``stop`` steps; fill in the offsets from ``start`` on.

    Raises
    ------
    OSError : the disk has no room for them; the file is as it was.
    """
    steps = file[STEPS]
    constants = dict.fromkeys(("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"), 0)
    constants["NumberOfParts"] = 1
    lengths = {steps[name]: stop for name in constants}
    counts = {}
    for data, counter in ((POINT_DATA, "NumberOfPoints"), (CELL_DATA, "NumberOfCells")):
        count = int(file["VTKHDF"][counter][0])
        for name, dataset in file[data].items():
            offsets = file[offsets_of(f"{data}/{name}")]
            counts[offsets] = count
            lengths |= {dataset: stop * count, offsets: stop}
    resize(file, lengths)
    if stop > start:
        for name, value in constants.items():
            steps[name][start:] = value
        for offsets, count in counts.items():
            offsets[start:] = count * np.arange(start, stop, dtype=np.int64)


def resize(file: h5py.File, lengths: Mapping[h5py.Dataset, int]) -> None:
    """Lengthen or shorten datasets to ``lengths`` rows; OSError, and nothing changed, if the disk has no room."""
    needed = 0
    for dataset, length in lengths.items():
        chunks = -(-length // dataset.chunks[0]) + -len(dataset) // dataset.chunks[0]
        if chunks > 0:
            needed += chunks * math.prod(dataset.chunks) * dataset.dtype.itemsize
            needed += INDEX_NODE_BYTES * (1 + chunks // 32)
    if needed:
        _reserve(file, needed)
    for dataset, length in lengths.items():
        dataset.resize(length, axis=0)


def offsets_of(field: str) -> str:
    """Where the offsets of a field stand: ``VTKHDF/PointData/x`` -> ``VTKHDF/Steps/PointDataOffsets/x``."""
    _, data, name = field.split("/")
    return f"{STEPS}/{data}Offsets/{name}"


def seal(sequence: int, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """[sequence, checksum] of a restart slot, uint64: a slot that was torn by a kill does not match its seal."""
    checksum = crc32(str(sequence).encode())
    for name in sorted(arrays):
        checksum = crc32(np.ascontiguousarray(arrays[name]).tobytes(), crc32(name.encode(), checksum))
    return np.array([sequence, checksum], dtype=np.uint64)


def to_json(value: object) -> str:
    """JSON text; numpy arrays and numbers become lists and numbers."""
    return json.dumps(value, indent=1, ensure_ascii=False, default=lambda item: item.tolist())


def _reserve(file: h5py.File, size: int) -> None:
    """OSError if the disk cannot hold ``size`` bytes more; HDF5, if left to find out, ruins the file.

    Where the system cannot reserve (macOS, Windows), a full disk can cost the samples of the run that fills it.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.id.get_vfd_handle(), file.id.get_filesize(), size)


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
