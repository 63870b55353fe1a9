"""A result as arrays, for Python and MATLAB: mesh, times, fields, history, all in SI units."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping

import numpy as np
import scipy

from explicitfe.platform.errors import InputError, Progress
from explicitfe.platform.host.memory import available_bytes, in_words
from explicitfe.results.files.layout import to_json
from explicitfe.results.files.reader import Result

LARGEST_MAT_BYTES = 2**31 - 1  # of a variable in a file of MATLAB's version 5
LONGEST_MATLAB_NAME = 63
BYTES_PER_NUMBER = 8


def npz_bytes(result: Result, progress: Progress) -> bytes:
    """An archive of numpy arrays: ``points``, ``hexes``, ``time``, ``field_<name>``, ``history_<name>``, ``nodes_<set>``.

    ``units`` and ``model`` are texts of JSON: units of fields and history, and the model with its scenario.
    """
    file = io.BytesIO()
    arrays = {
        "points": result.mesh.points,
        "hexes": result.mesh.hexes,
        "time": result.times,
        **{f"field_{name}": values for name, values in _fields(result, progress).items()},
        **{f"history_{name}": result.history(name) for name in result.history_names},
        **{f"nodes_{name}": nodes for name, nodes in result.mesh.node_sets.items()},
        "units": np.array(to_json(_units(result))),
        "model": np.array(to_json(result.model)),
    }
    np.savez_compressed(file, allow_pickle=False, **arrays)
    return file.getvalue()


def mat_bytes(result: Result, progress: Progress) -> bytes:
    """A MATLAB file (version 5) of one struct, ``result``; numbers of nodes and elements count from 1 there.

    Raises
    ------
    InputError : an array is larger than such a file can hold.
    """
    fields = _fields(result, progress)
    largest = max(fields, key=lambda name: fields[name].nbytes)
    if fields[largest].nbytes > LARGEST_MAT_BYTES:
        raise InputError(
            f"{result.path}: {largest} has {in_words(fields[largest].nbytes)}, and a .mat file holds arrays of up to "
            f"{in_words(LARGEST_MAT_BYTES)}; take `to` npz."
        )
    units = _units(result)
    content: dict[str, object] = {
        "points": result.mesh.points,
        "hexes": result.mesh.hexes + 1,
        "time": result.times[:, None],
        "fields": _struct(fields),
        "history": _struct({name: result.history(name) for name in result.history_names}),
        "node_sets": _struct({name: nodes[:, None] + 1 for name, nodes in result.mesh.node_sets.items()}),
        "units": {part: _struct(names) for part, names in units.items()},
        "model": to_json(result.model),
    }
    file = io.BytesIO()
    scipy.io.savemat(file, {"result": content}, long_field_names=True, do_compression=True, oned_as="column")
    return file.getvalue()


def _fields(result: Result, progress: Progress) -> dict[str, np.ndarray]:
    """Fields (T, N or E, ...) by name.

    Raises
    ------
    InputError : they do not fit into the memory of this machine.
    """
    counts = {"point": result.mesh.node_count, "cell": result.mesh.element_count}
    shapes = {name: (counts[kind], *quantity.shape) for name, (kind, quantity) in result.fields.items()}
    needed = BYTES_PER_NUMBER * len(result.times) * sum(int(np.prod(shape)) for shape in shapes.values())
    if needed > available_bytes():
        raise InputError(
            f"{result.path}: its fields have {in_words(needed)}, more than is free in memory; read single steps with "
            "explicitfe.open_result."
        )
    fields = {name: np.empty((len(result.times), *shape)) for name, shape in shapes.items()}
    for number, (name, values) in enumerate(fields.items()):
        for step in range(len(result.times)):
            progress("export", (number + step / len(result.times)) / len(fields))
            values[step] = result.field(name, step)
    progress("export", 1.0)
    return fields


def _units(result: Result) -> dict[str, dict[str, str]]:
    return {
        "fields": {name: info.quantity.unit for name, info in result.fields.items()},
        "history": {name: quantity.unit for name, quantity in result.history_names.items()},
    }


def _struct(values: Mapping[str, object]) -> dict[str, object]:
    """The same with names that MATLAB takes: letters, digits and underscores, a letter in front."""
    named: dict[str, object] = {}
    for name, value in values.items():
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = (plain if re.match("[A-Za-z]", plain) else f"x{plain}")[:LONGEST_MATLAB_NAME]
        while plain in named:
            plain = f"{plain[: LONGEST_MATLAB_NAME - 2]}_{len(named)}"[:LONGEST_MATLAB_NAME]
        named[plain] = value
    return named
