"""Names of result files, and finding one by its path or by its name in the output folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from explicitfe.platform.errors import InputError, nearest, shortened
from explicitfe.platform.host.files import reason
from explicitfe.platform.host.shipped import scenarios

SUFFIX = ".vtkhdf"
RUNNING_SUFFIX = ".running"  # before the suffix, until the run has ended

OUTPUT_FOLDER = Path("outputs")
"""Folder of results if ``--out`` is not given."""

SWEEP_FILE = "sweep.json"
"""A folder with this file is a sweep."""


def running_path(path: Path) -> Path:
    """Path of an unfinished result: ``NAME.vtkhdf`` -> ``NAME.running.vtkhdf``."""
    return path.with_name(f"{path.stem}{RUNNING_SUFFIX}{SUFFIX}")


def final_path(path: Path) -> Path:
    """Path of a result after its run has ended: ``NAME.running.vtkhdf`` -> ``NAME.vtkhdf``; another name is unchanged."""
    return path.with_name(path.stem.removesuffix(RUNNING_SUFFIX) + SUFFIX) if path.stem.endswith(RUNNING_SUFFIX) else path


def find_result(given: Path, *, unfinished_first: bool = False) -> Path:
    """Path of a result that is given by its path, or by its name with or without suffix.

    A name is looked up in the current folder and then in ``outputs``. If a finished and an unfinished result have the same name,
    the finished one is found.

    Parameters
    ----------
    given : such as ``vowel-i``, ``vowel-i.vtkhdf`` or ``runs/vowel-i.vtkhdf``.
    unfinished_first : find the unfinished result ``NAME.running.vtkhdf`` even if a finished one exists, to resume it.

    Raises
    ------
    InputError : there is no such file; the message suggests the nearest name.
    """
    try:
        if given.exists() and not (unfinished_first and _unfinished(given).exists()):
            return given
        for path in _candidates(given, unfinished_first):
            if path.is_file() or (path / SWEEP_FILE).is_file():
                return path
        suggestion = _suggestion(given)
    except (OSError, ValueError) as error:  # too long, or with a NUL character
        raise InputError(f'"{shortened(str(given))}" cannot be the name of a file ({reason(error)}).') from None
    searched = f", and no result in {OUTPUT_FOLDER}/ has this name" if given.parent == Path() else ""
    raise InputError(f"{given} does not exist{searched}; {suggestion}")


def result_names(folder: Path = OUTPUT_FOLDER) -> list[str]:
    """Names of the results in a folder, without suffix, sorted; an unfinished result ends in ``.running``."""
    try:
        return sorted(path.name.removesuffix(SUFFIX) for path in folder.iterdir() if _is_visible_result(path))
    except OSError:
        return []


# ---- inside ----


def _candidates(given: Path, unfinished_first: bool) -> Iterator[Path]:
    """Where a result of a name can be, in the order of preference."""
    for path in (given, OUTPUT_FOLDER / given) if given.parent == Path() else (given,):
        finished, unfinished = path.with_name(path.name.removesuffix(SUFFIX) + SUFFIX), _unfinished(path)
        if unfinished_first:
            yield unfinished
        yield from (finished, path)
        if path.suffix != SUFFIX:  # a complete file name means this file and no other
            yield unfinished


def _unfinished(path: Path) -> Path:
    """``NAME`` or ``NAME.vtkhdf`` -> ``NAME.running.vtkhdf``."""
    name = path.name.removesuffix(SUFFIX).removesuffix(RUNNING_SUFFIX)
    return path.with_name(f"{name}{RUNNING_SUFFIX}{SUFFIX}")


def _suggestion(given: Path) -> str:
    unfinished = _unfinished(given)
    if unfinished.exists():
        return f"an interrupted run has left {unfinished}, which 'explicitfe resume' completes."
    if given.name in scenarios():
        return f"compute it with 'explicitfe run {given.name}'."
    names = result_names(OUTPUT_FOLDER if given.parent == Path() else given.parent)
    if not names:
        return "run a scenario first, or give the path of a .vtkhdf file."
    return nearest(given.name.removesuffix(SUFFIX), names)


def _is_visible_result(path: Path) -> bool:
    return path.suffix == SUFFIX and not path.name.startswith(".")
