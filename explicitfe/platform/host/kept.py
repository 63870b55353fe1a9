"""Answers that are kept: what a function computed of the same arrays before, it does not compute again in this process.

Members of a sweep share a mesh, and most of what follows from it. Arrays are compared by their content.
"""

from __future__ import annotations

import hashlib
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from functools import wraps
from threading import Lock
from typing import ParamSpec, TypeVar

import numpy as np

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")


def kept(most: int) -> Callable[[Callable[Parameters, Answer]], Callable[Parameters, Answer]]:
    """Keep the last ``most`` answers of a function of arrays, numbers and texts, alone or in tuples.

    The arrays of an answer are shared by all who get it, and cannot be written.
    """

    def decorated(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
        answers: OrderedDict[Hashable, Answer] = OrderedDict()
        lock = Lock()

        @wraps(function)
        def answered(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Answer:
            key = content_key((args, tuple(sorted(kwargs.items()))))
            with lock:
                if key in answers:
                    answers.move_to_end(key)
                    return answers[key]
            answer = function(*args, **kwargs)
            _lock_arrays(answer)
            with lock:
                answers[key] = answer
                while len(answers) > most:
                    answers.popitem(last=False)
            return answer

        return answered

    return decorated


def content_key(value: object) -> Hashable:
    """What tells inputs apart: an array counts by what it holds."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, _digest(value)
    if isinstance(value, tuple):
        return tuple(content_key(part) for part in value)
    if isinstance(value, dict):
        return tuple((name, content_key(part)) for name, part in value.items())
    if is_dataclass(value):
        return tuple(content_key(getattr(value, field.name)) for field in fields(value))
    assert isinstance(value, Hashable)
    return value


def _digest(array: np.ndarray) -> bytes:
    """Of what an array holds; of one that cannot be written it is computed once."""
    fixed = array.base is None and not array.flags.writeable
    if fixed:
        known = _digests.get(id(array))
        if known is not None and known[0]() is array:
            return known[1]
    digest = hashlib.blake2b(np.ascontiguousarray(array).data, digest_size=16).digest()
    if fixed:
        name = id(array)
        _digests[name] = weakref.ref(array, lambda _: _digests.pop(name, None)), digest
    return digest


# The digests of arrays that cannot be written, by their identity; gone with the array.
_digests: dict[int, tuple[weakref.ref[np.ndarray], bytes]] = {}


def _lock_arrays(value: object) -> None:
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, (tuple, list)):
        for part in value:
            _lock_arrays(part)
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            _lock_arrays(getattr(value, field.name))
