"""A result file as versions before wrote it, format 1 or 2: written here by hand, as the layout was documented."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import h5py
import numpy as np
from tiny_result import MESH, SCENARIO, E, N, displacement, jacobian

from explicitfe.results.files.layout import seal

TEXT = h5py.string_dtype("utf-8")  # of variable length


def write_old(path: Path, steps: int, *, number: int = 2) -> Path:
    """A finished result of format ``number`` with so many steps."""
    u = np.concatenate([displacement(step) for step in range(steps)])
    J = np.concatenate([jacobian(step) for step in range(steps)])
    with h5py.File(path, "w", libver=("earliest", "v108")) as file:
        vtk = file.create_group("VTKHDF")
        vtk.attrs["Version"] = np.array([2, 0])
        vtk.attrs["Type"] = np.bytes_("UnstructuredGrid")
        vtk["NumberOfPoints"], vtk["NumberOfCells"], vtk["NumberOfConnectivityIds"] = [N], [E], [8 * E]
        vtk["Points"], vtk["Connectivity"] = MESH.points, MESH.hexes.ravel()
        vtk["Offsets"], vtk["Types"] = 8 * np.arange(E + 1), np.full(E, 12, dtype=np.uint8)
        file.create_group("VTKHDF/Steps").attrs["NSteps"] = np.int64(steps)
        vtk["Steps/Values"] = 1e-3 * np.arange(steps)
        vtk["Steps/NumberOfParts"] = np.ones(steps, dtype=np.int64)
        for name in ("PartOffsets", "PointOffsets"):
            vtk[f"Steps/{name}"] = np.zeros(steps, dtype=np.int64)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            vtk[f"Steps/{name}"] = np.zeros((steps, 1), dtype=np.int64)
        for data, count, fields in (("PointData", N, {"displacement": u, "velocity": -u}), ("CellData", E, {"J": J})):
            for name, values in fields.items():
                _numbers(file, f"VTKHDF/{data}/{name}", values)
                vtk[f"Steps/{data}Offsets/{name}"] = count * np.arange(steps)
        own = file.create_group("explicitfe")
        own.attrs["format"] = number
        status = {
            "state": (32, "finished"),
            "message": (4096, "größer"),
            "summary": (262144, json.dumps({"steps": steps})),
        }
        for name, (size, text) in status.items():
            own.create_dataset(f"status/{name}", data=text.encode(), dtype=h5py.string_dtype("utf-8", size))
        own.create_dataset("scenario", data=SCENARIO, dtype=TEXT).attrs["sha256"] = hashlib.sha256(SCENARIO.encode()).hexdigest()
        own.create_dataset("model", data=json.dumps({"density": 1040.0}), dtype=TEXT)
        own.create_dataset("provenance", data=json.dumps({"explicitfe": "old"}), dtype=TEXT)
        own["node_sets/jaw"] = MESH.node_sets["jaw"]
        own["named_points/tip"] = np.int64(11) if number == 1 else np.array([1.0, 1.0, 1.0, 1.0])
        _numbers(file, "explicitfe/history/time", 1e-3 * np.arange(steps + 1))  # a run could have more rows than samples
        _numbers(file, "explicitfe/history/kinetic_energy", np.arange(steps + 1) + 0.5)
        own["history"].attrs["rows"] = np.int64(steps + 1)
        for slot, sequence in (("slot0", steps - 1), ("slot1", steps)):
            arrays = {"step": np.asarray(sequence - 1)}
            own[f"restart/{slot}/step"] = arrays["step"]
            own[f"restart/{slot}/seal"] = seal(sequence, arrays)
    return path


def _numbers(file: h5py.File, name: str, values: np.ndarray) -> None:
    file[name] = values
    file[name].attrs["unit"], file[name].attrs["description"] = "m", "of the nodes"
