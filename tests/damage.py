"""Damage to result files, and what reading them comes to: each in a process of its own, as HDF5 may end it.

What a reading may come to, from good to bad: "right", "sentence" (an InputError), and then "wrong", "traceback", "hang", "crash".
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from explicitfe.platform.errors import InputError
from explicitfe.results.files import Result, open_result

LONGEST_READING_S = 20.0
OUTCOMES = ("right", "sentence", "wrong", "traceback", "hang", "crash")


class Damage(NamedTuple):
    """A change to a file: what kind, and the bytes that remain."""

    kind: str
    data: bytes


def readings(path: Path) -> dict[str, Callable[[Result], Any]]:
    """Everything that can be read of a result, by name; taken from a whole one."""
    with open_result(path) as result:
        steps, fields, histories = range(len(result.times)), [*result.fields], [*result.history_names]
        probes = [*result.mesh.named_points]
    calls: dict[str, Callable[[Result], Any]] = {
        "inspect": lambda r: r.contents() | {"path": ""},
        "texts": lambda r: (r.status, r.message, r.scenario_text, r.scenario_sha256, r.model, r.provenance, r.summary),
        "times": lambda r: r.times,
        "mesh": lambda r: (r.mesh.points, r.mesh.hexes, r.mesh.node_sets, [p.position for p in r.mesh.named_points.values()]),
        "bones": lambda r: {name: tuple(bone) for name, bone in r.placed_bones().items()},
        "fibres": lambda r: [[(line.element, line.natural, line.position) for line in lines] for lines in r.fibres],
        "restart": lambda r: r.restart_state(),
    }
    for name in fields:
        for step in steps:
            calls[f"{name} {step}"] = lambda r, name=name, step=step: r.field(name, step)
    calls |= {f"history {name}": lambda r, name=name: r.history(name) for name in histories}
    calls |= {f"probe {name}": lambda r, name=name: r.probe(name) for name in probes}
    calls |= {f"mesh_at {step}": lambda r, step=step: _arrays(r.mesh_at(step)) for step in [*steps][-1:]}
    return calls


def read_all(path: Path, calls: dict[str, Callable[[Result], Any]]) -> dict[str, Any]:
    """What each reading gives; an InputError is given as itself."""
    values: dict[str, Any] = {}
    try:
        result = open_result(path)
    except InputError as error:
        return dict.fromkeys(calls, error)
    with result:
        for name, call in calls.items():
            try:
                values[name] = call(result)
            except InputError as error:
                values[name] = error
    return values


def outcome(path: Path, calls: dict[str, Callable[[Result], Any]], truth: dict[str, Any], older: list[Any]) -> tuple[str, str]:
    """The worst that reading a file comes to, in a child process, and what it was.

    Parameters
    ----------
    older : restart states that are right answers too: one that is damaged is passed over.
    """
    source, sink = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(source)
        answer = _compared(path, calls, truth, older)
        os.write(sink, pickle.dumps(answer)[:60000])
        os._exit(0)
    os.close(sink)
    end = time.monotonic() + LONGEST_READING_S
    ready, _, _ = select.select([source], [], [], LONGEST_READING_S)
    data = os.read(source, 65536) if ready else b""
    os.close(source)
    if not ready and time.monotonic() >= end:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return "hang", ""
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status) or not data:
        return "crash", f"status {status}"
    return pickle.loads(data)


def damages(path: Path, rng: np.random.Generator, counts: dict[str, int]) -> Iterator[Damage]:
    """Damaged versions of a file: so many of each kind."""
    whole = path.read_bytes()
    structure = structure_bytes(path)
    for _ in range(counts.get("cut", 0)):
        yield Damage("cut", whole[: rng.integers(len(whole))])
    for _ in range(counts.get("byte", 0)):
        yield Damage("byte", _changed(whole, rng.integers(len(whole)), bytes([rng.integers(1, 256)])))
    for _ in range(counts.get("structure byte", 0)):
        yield Damage("structure byte", _changed(whole, rng.choice(structure), bytes([rng.integers(1, 256)])))
    for _ in range(counts.get("structure bytes", 0)):
        size = int(rng.choice([2, 4, 8, 16, 64]))
        fill = [rng.bytes(size), b"\xff" * size, b"\x00" * size][rng.integers(3)]
        place = int(rng.choice(structure))
        yield Damage("structure bytes", (whole[:place] + fill + whole[place + size :])[: len(whole)])
    for _ in range(counts.get("block", 0)):
        place = int(rng.integers(max(1, len(whole) // 4096))) * 4096
        yield Damage("block", (whole[:place] + bytes(4096) + whole[place + 4096 :])[: len(whole)])


def structure_bytes(path: Path) -> np.ndarray:
    """Places of the bytes that are no numbers of datasets: headers, names, and lists of chunks."""
    structure = np.ones(path.stat().st_size, dtype=bool)

    def strike(_: str, item: h5py.Dataset | h5py.Group) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        if item.chunks:
            for number in range(item.id.get_num_chunks()):
                chunk = item.id.get_chunk_info(number)
                structure[chunk.byte_offset : chunk.byte_offset + chunk.size] = False
        elif item.id.get_offset() is not None:
            structure[item.id.get_offset() : item.id.get_offset() + item.id.get_storage_size()] = False

    with h5py.File(path) as file:
        file.visititems(strike)
    return np.flatnonzero(structure)


def same(one: Any, other: Any) -> bool:
    """Whether two answers are the same, number by number."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        one, other = np.asarray(one), np.asarray(other)
        return one.shape == other.shape and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)) and isinstance(other, (list, tuple)):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    return bool(one == other)


def _compared(path: Path, calls: dict[str, Callable[[Result], Any]], truth: dict[str, Any], older: list[Any]) -> tuple[str, str]:
    try:
        values = read_all(path, calls)
    except BaseException as error:
        import traceback

        return "traceback", "".join(traceback.format_exception(error))[-3000:]
    worst = ("right", "")
    for name, value in values.items():
        if isinstance(value, InputError):
            if "\n" in str(value):
                return "traceback", f"{name}: not one line: {value}"
            worst = ("sentence", str(value)) if worst[0] == "right" else worst
        elif not same(value, truth[name]) and not (name == "restart" and any(same(value, right) for right in older)):
            return "wrong", name
    return worst


def _changed(data: bytes, place: int, by: bytes) -> bytes:
    return data[:place] + bytes([data[place] ^ by[0]]) + data[place + 1 :]


def _arrays(grid: Any) -> dict[str, np.ndarray]:
    arrays = {"points": np.array(grid.points), "cells": np.array(grid.cells_dict[12])}
    return arrays | {name: np.array(grid[name]) for name in grid.array_names}
