"""Answers that are stored: what a function computed of the same inputs before, later processes load instead of computing it.

They lie beside the compiled kernels (``code_cache.py``), each in a file with a checksum, which is named after all that it depends
on. Nothing in these files is executed. A file that is missing, damaged or of another answer only costs the time to compute it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from explicitfe.platform.host.code_cache import kernel_folder
from explicitfe.platform.host.files import create_private, remove_stale
from explicitfe.platform.host.kept import content_key

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")

# The answers that were used last.
MOST_STORED_BYTES, MOST_STORED = 300e6, 500
DIGEST_BYTES = 32
_SUFFIX = ".stored"
_PACKAGE = Path(__file__).resolve().parents[2]


def store_answers(
    *kinds: type, sources: tuple[str, ...]
) -> Callable[[Callable[Parameters, Answer]], Callable[Parameters, Answer]]:
    """Store the answers of a function of arrays, numbers and texts, alone, in tuples or in dataclasses.

    An answer is loaded if its inputs, the code, the versions of the libraries and the processor are the same. It has the same
    bits, and its arrays are read-only.

    Parameters
    ----------
    kinds : the dataclasses in an answer, which else holds arrays, numbers, texts, tuples and dictionaries by name.
    sources : modules and folders of the package whose code decides what is computed, such as "fem/mesh".
    """

    def decorate(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
        @wraps(function)
        def answer_of(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Answer:
            inputs = content_key((args, tuple(sorted(kwargs.items()))))
            key = _digest(repr((function.__module__, function.__qualname__, inputs, _circumstances(sources))).encode()).hex()
            content = _read(key)
            if content is None:
                content = _content_of(key, function(*args, **kwargs))
                _write(key, content)
            return _answer_in(content, kinds)  # A new answer is read back too, so that it equals a stored one.

        return answer_of

    return decorate


@cache
def _circumstances(sources: tuple[str, ...]) -> tuple[str, ...]:
    """All but its inputs that an answer depends on."""
    import scipy
    from llvmlite.binding import get_host_cpu_features

    code = hashlib.blake2b()
    for source in ("platform/host/stored.py", *sources):
        path = _PACKAGE / source
        for file in [path] if path.is_file() else sorted(path.rglob("*.py")):
            code.update(file.read_bytes())
    return np.__version__, scipy.__version__, get_host_cpu_features().flatten(), code.hexdigest()


def _digest(content: bytes | memoryview) -> bytes:
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()


def _content_of(key: str, answer: object) -> bytes:
    """An answer as the content of a file: a description in one line, then its arrays, one after the other."""
    arrays: list[np.ndarray] = []
    head = json.dumps([key, _description(answer, arrays)]).encode()
    return b"".join([head, b"\n", *(array.tobytes() for array in arrays)])


def _description(value: object, arrays: list[np.ndarray]) -> object:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": value.dtype.str, "shape": value.shape}
    if is_dataclass(value):
        return {"kind": type(value).__name__, "of": [_description(getattr(value, field.name), arrays) for field in fields(value)]}
    if isinstance(value, Mapping):
        return {"table": [[name, _description(part, arrays)] for name, part in value.items()]}
    if isinstance(value, tuple):
        return {"tuple": [_description(part, arrays) for part in value]}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"an answer with a {type(value).__name__} cannot be stored")


def _answer_in(content: bytes, kinds: tuple[type, ...]) -> Any:
    head, _, _ = content.partition(b"\n")
    kind_of = {kind.__name__: kind for kind in kinds}
    place = len(head) + 1

    def value_of(node: Any) -> Any:
        nonlocal place
        if not isinstance(node, dict):
            return node
        if "array" in node:
            array = np.frombuffer(content, node["array"], math.prod(node["shape"]), place).reshape(node["shape"]).copy()
            array.setflags(write=False)
            place += array.nbytes
            return array
        if "table" in node:
            return {name: value_of(part) for name, part in node["table"]}
        parts = [value_of(part) for part in node["tuple" if "tuple" in node else "of"]]
        return tuple(parts) if "tuple" in node else kind_of[node["kind"]](*parts)

    return value_of(json.loads(head)[1])


def _read(key: str) -> bytes | None:
    """The content that is stored under a key; None if there is none, or not what was stored."""
    folder = _folder()
    if folder is None:
        return None
    path = folder / (key + _SUFFIX)
    try:
        content = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):
        os.utime(path)  # what was used last is kept
    content, digest = content[:-DIGEST_BYTES], content[-DIGEST_BYTES:]
    return content if digest == _digest(content) and content.startswith(f'["{key}", '.encode()) else None


def _write(key: str, content: bytes) -> None:
    """Store a content under a key, and remove those that were not used for longest where all together are too large."""
    folder = _folder()
    if folder is None:
        return
    with suppress(OSError):  # a full disk: the next process computes it again
        folder.mkdir(parents=True, exist_ok=True)
        remove_stale(folder, "stored")
        number, path = create_private(folder, "stored")
        with os.fdopen(number, "wb") as file:
            file.write(content)
            file.write(_digest(content))
        path.replace(folder / (key + _SUFFIX))
        room = MOST_STORED_BYTES
        answers = sorted(folder.glob("*" + _SUFFIX), key=lambda answer: answer.stat().st_mtime, reverse=True)
        for count, answer in enumerate(answers):
            room -= answer.stat().st_size
            if room < 0.0 or count >= MOST_STORED:
                answer.unlink()


def _folder() -> Path | None:
    folder = kernel_folder()
    return None if folder is None else folder / "__pycache__"
