"""Reading a file with a library that trusts it, in a process of its own.

On a damaged file some readers never end, some ask for more memory than there is, and some crash. Here they may: a child takes
some time and some memory, and no more, and hands over arrays or a sentence.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from explicitfe.platform.errors import InputError

Reader = Callable[[str], Mapping[str, np.ndarray]]
"""Reads a file; a function of a module, which the child finds by its name. It may raise InputError."""

# A process begins within two seconds; the slowest readers of sound files take a third of this per MB.
SECONDS_TO_BEGIN, SECONDS_PER_MB = 10.0, 3.0
# Some readers hold forty times what stands in the file.
MEMORY_TO_BEGIN_BYTES, MEMORY_PER_FILE_BYTE = 4 * 2**30, 60


def read_in_child(reader: Reader, path: Path, damaged: str) -> dict[str, np.ndarray]:
    """The arrays that ``reader`` finds in a file.

    Parameters
    ----------
    damaged : the sentence after the file's name, where the child took too long, or crashed.

    Raises
    ------
    InputError : ``damaged``, or what ``reader`` raised, after the file's name.
    """
    limit_s = SECONDS_TO_BEGIN + SECONDS_PER_MB * path.stat().st_size / 1e6
    # The package is found as it is found here, whatever the folder is called from which the command runs.
    code = f"import sys; sys.path[:] = {sys.path!r}; from {reader.__module__} import {reader.__qualname__} as reader; "
    code += f"from {__name__} import answer; answer(reader, sys.argv[1])"
    command = [sys.executable, "-c", code, str(path)]
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        child = subprocess.run(
            command, capture_output=True, timeout=limit_s, stdin=subprocess.DEVNULL, env=one_thread, check=False
        )
        head, _, arrays = child.stdout.partition(b"\n")
        document = json.loads(head)
    except (subprocess.TimeoutExpired, ValueError):  # it ended before it could say why
        raise InputError(f"{path}: {damaged}") from None
    if "fault" in document:
        raise InputError(f"{path}: {document['fault']}")
    stream = io.BytesIO(arrays)
    return {name: np.load(stream, allow_pickle=False) for name in document["names"]}


def answer(reader: Reader, path: str) -> None:
    """The child: it writes a line of JSON and then arrays to stdout, or a line that says what is wrong."""
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    _limit_memory(MEMORY_TO_BEGIN_BYTES + MEMORY_PER_FILE_BYTE * Path(path).stat().st_size)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is no answer
    try:
        arrays = reader(path)
    except InputError as error:
        out.write(json.dumps({"fault": str(error)}).encode() + b"\n")
    else:
        out.write(json.dumps({"names": list(arrays)}).encode() + b"\n")
        for array in arrays.values():
            packed = io.BytesIO()  # straight into a pipe numpy cannot write
            np.save(packed, array, allow_pickle=False)
            out.write(packed.getbuffer())
    out.flush()


def _limit_memory(most_bytes: int) -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):  # no such limits on Windows
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
