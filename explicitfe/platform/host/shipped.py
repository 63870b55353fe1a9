"""What comes with the program as files: models, scenarios, protocols, datasets. A user names them without a folder.

Where a file of a user has the name as well, it is the user's.
"""

from __future__ import annotations

from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Literal

from explicitfe.platform.errors import InputError, nearest, shortened

DATASET_FILE = "dataset.toml"
# Files that may be recordings of markers: text tables, and those of programs that record nothing else.
TABLE_SUFFIXES = (".csv", ".txt", ".tsv")
MARKER_SUFFIXES = (".c3d", ".trc", ".mot", ".sto", ".pos", ".mat")
_PACKAGE = Path(__file__).resolve().parents[2]


def folder_of(kind: Literal["models", "scenarios"]) -> Path:
    """models/ or scenarios/: inside an installed package, at the top of a checkout."""
    installed = _PACKAGE / "_data" / kind
    return installed if installed.is_dir() else _PACKAGE.parent / kind


def scenarios() -> dict[str, Path]:
    """Name of a scenario -> its file."""
    return _by_stem(folder_of("scenarios"))


def name_of(file: str) -> str:
    """What a user types for a scenario: the name alone of one that comes with the program, otherwise its file."""
    path = Path(file)
    return path.stem if scenarios().get(path.stem) == path else file


def protocols() -> dict[str, Path]:
    """Name of a protocol of a planned test -> its file."""
    return _by_stem(folder_of("scenarios") / "protocols")


def datasets() -> dict[str, Path]:
    """Name of a dataset -> its folder."""
    files = sorted((folder_of("scenarios") / "datasets").glob(f"*/{DATASET_FILE}"))
    return {path.parent.name: path.parent for path in files}


def exports() -> dict[str, Path]:
    """Name of a table that becomes a dataset in a tutorial, or belongs to a dataset -> its file."""
    return {path.name: path for path in sorted((folder_of("scenarios") / "datasets").glob("*/*.csv"))}


def scenario_file(path: Path | str) -> Path:
    """The scenario that a user names: a file of theirs, or the name of one that comes with the program.

    Raises
    ------
    InputError : it is the name of neither.
    """
    return _named(path, "scenario", scenarios(), ".toml")


def protocol_file(path: Path | str) -> Path:
    """The protocol that a user names; see :func:`scenario_file`."""
    return _named(path, "protocol", protocols(), ".toml")


def dataset_folder(path: Path | str) -> Path:
    """The folder of the dataset that a user names, or its dataset.toml; see :func:`scenario_file`."""
    return _named(path, "dataset", datasets(), "")


def is_dataset(path: Path | str) -> bool:
    """Whether a user names a dataset, where a scenario is possible as well.

    Raises
    ------
    InputError : it is the name of neither.
    """
    path = Path(path)
    with suppress(OSError, ValueError):
        if path.exists():
            return path.is_dir() or path.name == DATASET_FILE
    if len(path.parts) == 1 and path.name not in datasets() and not path.suffix and path.stem not in scenarios():
        _named(path, "scenario or dataset", {**scenarios(), **datasets()}, "")
    return path.name in datasets() and len(path.parts) == 1


def export_file(path: Path | str) -> Path:
    """The table of a testing machine that a user names; see :func:`scenario_file`."""
    return _named(path, "table", exports(), "")


def _by_stem(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def _named(given: Path | str, what: str, shipped: dict[str, Path], suffix: str) -> Path:
    if not isinstance(given, str | PathLike):
        raise InputError(f"{what} must be a path or a name, not {shortened(repr(given))}.")
    path = Path(given)
    with suppress(OSError, ValueError):  # The name may be none that a file can have; opening it says so.
        if path.exists() and (path.is_file() or path.name not in shipped or (path / DATASET_FILE).is_file()):
            return path
    name = path.name.removesuffix(suffix)
    if len(path.parts) == 1 and name in shipped:
        return shipped[name]
    if name in shipped:
        raise InputError(f'{path}: this cannot be read; "{name}" alone names the {what} that comes with the program.')
    if path.parts == (name,) and not path.suffix:
        hint = nearest(name, shipped)
        raise InputError(f'there is no file "{shortened(name)}", and no {what} of that name comes with the program; {hint}')
    return path
