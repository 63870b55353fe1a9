"""Digests that identify compiled code: of all sources, constants and byte code that it depends on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from weakref import WeakKeyDictionary

from numba.core.dispatcher import Dispatcher

from explicitfe.platform.compiled.lanes import WIDTH

_PACKAGE = Path(__file__).parents[2]
# Sources that compiled code depends on.
_KERNEL_SOURCES = (
    "platform/compiled",
    "fem/elements",
    "fem/materials",
    "fem/effects/effect.py",
    "fem/effects/material",
    "fem/forces",
    "fem/tangent",
    "fem/solve/boundary.py",
    "fem/solve/step.py",
    "fem/solve/relax_step.py",
    "fem/solve/look.py",
    "fem/solve/course.py",
)
_Own = tuple[bytes, list[FunctionType]]
_OWN: WeakKeyDictionary[FunctionType, _Own] = WeakKeyDictionary()
_DIGESTS: WeakKeyDictionary[FunctionType, str] = WeakKeyDictionary()


def digest_of_bindings(bindings: Mapping[str, object]) -> str:
    """Digest of the sources of all kernels and of the values that are bound to placeholders."""
    sums = hashlib.sha256(_package_digest())
    for name, value in sorted(bindings.items()):
        sums.update(name.encode())
        if isinstance(value, Dispatcher):
            sums.update(_reached(value.py_func, _own))
        else:
            sums.update(repr(value).encode())
    return sums.hexdigest()[:16]


def digest_of_part(function: FunctionType) -> str:
    """Digest of the sources of all kernels, of a function and of the functions that it calls; computed once."""
    if function not in _DIGESTS:
        sums = hashlib.sha256(_package_digest())
        sums.update(_reached(function, _own_once))
        _DIGESTS[function] = sums.hexdigest()[:16]
    return _DIGESTS[function]


def name_of_part(function: FunctionType) -> str:
    """Name of a function with the digest of its code."""
    return f"{function.__module__}.{function.__qualname__}_{digest_of_part(function)}"


def _reached(function: FunctionType, own: Callable[[FunctionType], _Own]) -> bytes:
    """Digests of a function and of all functions that it calls, one after the other."""
    parts: list[bytes] = []
    waiting, seen = [function], set()
    while waiting:
        current = waiting.pop()
        if id(current) not in seen:
            seen.add(id(current))
            part, called = own(current)
            parts.append(part)
            waiting += called
    return b"".join(parts)


def _own_once(function: FunctionType) -> _Own:
    """Cached :func:`_own`."""
    if function not in _OWN:
        _OWN[function] = _own(function)
    return _OWN[function]


def _own(function: FunctionType) -> _Own:
    """Digest of the name, byte code, constants and source files of a function, and the functions that it calls."""
    parts = [f"{function.__module__}.{function.__qualname__}".encode(), _file_bytes(function.__code__.co_filename)]
    reads: dict[str, object] = {}
    codes = [function.__code__]
    while codes:  # inner functions and comprehensions too: the repr of their code would carry an address
        code = codes.pop()
        parts += [code.co_code, repr(code.co_names).encode()]
        parts += [repr(constant).encode() for constant in code.co_consts if not isinstance(constant, CodeType)]
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        reads |= {name: function.__globals__[name] for name in code.co_names if name in function.__globals__}
    cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    reads |= {name: cell.cell_contents for name, cell in cells.items()}
    called = []
    for name, value in reads.items():
        if isinstance(value, Dispatcher):
            called.append(value.py_func)
        elif isinstance(value, int | float | tuple):
            parts.append(f"{name} = {value!r}".encode())
        elif isinstance(value, ModuleType):  # a leaf called as module.leaf: its whole file counts
            parts.append(_file_bytes(getattr(value, "__file__", None) or ""))
        elif name in cells:
            parts.append(f"{name} = {value!r}".encode())
    return hashlib.sha256(b"\0".join(parts)).digest(), called


@cache
def _package_digest() -> bytes:
    sums = hashlib.sha256(f"{WIDTH} lanes".encode())
    for source in _KERNEL_SOURCES:
        path = _PACKAGE / source
        for file in [path] if path.is_file() else sorted(path.rglob("*.py")):
            sums.update(file.relative_to(_PACKAGE).as_posix().encode())
            sums.update(file.read_bytes())
    return sums.digest()


def _file_bytes(path: str) -> bytes:
    try:
        return _digest_of_file(path, Path(path).stat().st_mtime_ns) if path.endswith(".py") else b""
    except FileNotFoundError:
        return b""


@cache
def _digest_of_file(path: str, written_ns: int) -> bytes:
    """Of a source as it is since that time: the same files stand behind most kernels."""
    return hashlib.sha256(Path(path).read_bytes()).digest()
