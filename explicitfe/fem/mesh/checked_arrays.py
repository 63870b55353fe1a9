"""Arrays of a Python caller, checked and copied once where they enter the package.

The rest of the package relies on it: 64-bit numbers in C order, so that no kernel is compiled again for another type, and arrays
that the caller cannot change afterwards.
"""

from __future__ import annotations

import numpy as np

from explicitfe.platform.errors import InputError, shortened

LARGEST_LENGTH_M = 10.0  # as for lengths in scenarios
FARTHEST_POINT_M = 100.0  # from the origin, along each axis


def number_array(
    name: str, values: object, shape: tuple[int | str, ...], *, largest: float = np.inf, rows: str = ""
) -> np.ndarray:
    """A read-only float64 copy of finite numbers.

    Parameters
    ----------
    name : the parameter, for the message, such as "HexMesh: points".
    values : what the caller gave: an array, or nested sequences.
    shape : the length of each axis; a letter stands for any length.
    largest : the largest magnitude that is accepted.
    rows : what a row is, such as "node", for the message.

    Raises
    ------
    InputError : not numbers, another shape, not finite, or too large.
    """
    wanted = f"numbers of shape ({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"
    copy = _read_only(name, values, "iuf", np.float64, shape, wanted)
    if not np.isfinite(copy).all():
        place = np.argwhere(~np.isfinite(copy))[0].tolist()
        where = f"{name}: {rows} {place[0]}" if rows else f"{name}{place}"
        raise InputError(f"{where} is not finite: {copy[place[0]].tolist()}.")
    if np.abs(copy).max(initial=0.0) > largest:
        place = np.argwhere(np.abs(copy) > largest)[0].tolist()
        raise InputError(f"{name}{place} = {copy[tuple(place)]:g} is out of range: the largest magnitude is {largest:g}.")
    return copy


def index_array(
    name: str, values: object, count: int | None, what: str, *, unique: bool = False, columns: int | None = None
) -> np.ndarray:
    """A read-only int64 copy of numbers of nodes or elements.

    Parameters
    ----------
    name, values : as for :func:`number_array`.
    count : how many nodes or elements there are; the numbers run from 0 to ``count`` - 1. None: not known yet.
    what : "node" or "element".
    unique : whether each number may occur only once.
    columns : length of the second axis, whose range the caller checks; None for a one-dimensional array.

    Raises
    ------
    InputError : not whole numbers, another shape, out of range, or a repeated number.
    """
    shape: tuple[int | str, ...] = ("k",) if columns is None else ("k", columns)
    copy = _read_only(name, values, "iu", np.int64, shape, f"{what} numbers, whole and 0 or more")
    if columns is None:
        check_range(name, copy, count, what)
    if unique and copy.size > 1:
        ordered = np.sort(copy, axis=None)
        twice = ordered[:-1][np.diff(ordered) == 0]
        if len(twice):
            raise InputError(f"{name}: {what} {twice[0]} occurs more than once; give each {what} once.")
    return copy


def check_range(name: str, numbers: np.ndarray, count: int | None, what: str, *, smallest: int = 0) -> None:
    """Refuse numbers of nodes or elements outside ``smallest`` to ``count`` - 1.

    Raises
    ------
    InputError : names the first number that is out of range.
    """
    if not numbers.size:
        return
    wrong = numbers.min() if numbers.min() < smallest else numbers.max()
    if wrong < smallest or (count is not None and wrong >= count):
        valid = "begin at 0" if count is None else f"run from 0 to {count - 1}"
        raise InputError(f"{name}: {what} {wrong} is not in the mesh; {what} numbers {valid}.")


def mask_array(name: str, values: object, shape: tuple[int, int], hint: str) -> np.ndarray:
    """A read-only copy of a mask of True and False.

    Raises
    ------
    InputError : another type or shape; the message ends with ``hint``.
    """
    return _read_only(name, values, "b", np.bool_, shape, f"a mask of True and False of shape {shape}", hint)


def _read_only(
    name: str, values: object, kinds: str, dtype: type[np.generic], shape: tuple[int | str, ...], wanted: str, hint: str = ""
) -> np.ndarray:
    """A read-only array of one of the ``kinds`` of numpy types, as ``dtype``; letters in ``shape`` stand for any length."""
    try:
        array = np.asarray(values)
    except (ValueError, TypeError, OverflowError):  # rows of different lengths
        array = None
    end = f"; {hint}." if hint else "."
    if array is None or array.dtype.kind == "O" or (array.dtype.kind not in kinds and (array.size or kinds == "b")):
        described = _described(values, None if array is None or array.dtype.kind == "O" else array)
        raise InputError(f"{name} must be {wanted}, not {described}{end}")
    if array.ndim != len(shape) or any(a != b for a, b in zip(array.shape, shape, strict=True) if isinstance(b, int)):
        stated = f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"
        raise InputError(f"{name} must have the shape {stated}, not {array.shape}{end}")
    if dtype is np.int64 and array.size and int(array.max()) > np.iinfo(np.int64).max:
        raise InputError(f"{name}: {array.max()} is too large a number.")
    if array.base is None and not array.flags.writeable and array.dtype == dtype and array.flags.c_contiguous:
        return array  # nobody can write into it
    with np.errstate(over="ignore"):
        copy = np.array(array, dtype=dtype, order="C")
    copy.setflags(write=False)
    return copy


def _described(values: object, array: np.ndarray | None) -> str:
    """What a caller gave, as the end of a sentence."""
    if isinstance(values, np.ndarray) and values.size > 1:
        return f"an array of {values.dtype}"
    if array is not None and array.size > 1 and not isinstance(values, str):
        return f"a {type(values).__name__} of {array.dtype}"
    return shortened(repr(values))
