"""A dataset from tables of a testing machine: columns in the units, signs and zeros of a dataset, and a folder of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from explicitfe.errors import InputError, shortened
from explicitfe.host.shipped import DATASET_FILE
from explicitfe.host.toml_text import toml_key, toml_value
from explicitfe.measured.curve import TIME
from explicitfe.measured.export import Export
from explicitfe.measured.files import LARGEST_CURVE_ROWS, SMALLEST_CURVE_ROWS
from explicitfe.measured.quantities import QUANTITIES, Choice, Quantity
from explicitfe.measured.read import read_dataset
from explicitfe.measured.tables import RawTable, TestKind
from explicitfe.measured.units import FAR_FROM_ZERO_SHARE
from explicitfe.results.folder import whole_folder

LARGEST_FIRST_STRAIN = 0.5
_NOT_IN_A_NAME = re.compile(r"[^a-z0-9.]+")


class NewCurve(TypedDict):
    """A curve of a new dataset: where it is from, and what it holds."""

    id: str
    file: str
    source: str
    rows: int
    duration_s: float


class NewDataset(TypedDict):
    """A dataset that was written: its folder, its curves, which column became what, and what was done to the numbers."""

    dataset: str
    test: str
    columns: dict[str, str]
    curves: list[NewCurve]
    notes: list[str]


@dataclass(frozen=True)
class Strip:
    """A specimen between clamps that is strained evenly along its free length."""

    length_mm: float
    area_mm2: float


@dataclass(frozen=True)
class TestDescription:
    """What tables of numbers do not say.

    Attributes
    ----------
    specimen, tool, noise : tables of the dataset; no tool where the columns are stretch and stress.
    contact_force_N : rows before the force reaches it are left out; None keeps all rows.
    rate_per_s : pace of the imposed column, in its unit, where no column is the time; rows in which it stands still are left out.
    strip : length and cross-section of a strip between clamps, whose displacement and force become stretch and stress.
    one_specimen : whether all files were measured on one and the same specimen.
    """

    test: TestKind
    title: str
    specimen: RawTable
    tool: RawTable | None
    noise: RawTable = field(default_factory=dict)
    source: str = ""
    license: str = ""
    contact_force_N: float | None = None
    rate_per_s: float | None = None
    strip: Strip | None = None
    one_specimen: bool = False


def quantities_of(test: TestKind, with_tool: bool) -> tuple[Quantity, ...]:
    """What a test has to give, the first being time."""
    if test == "shear":
        return "time", "shear-strain", "shear-stress"
    return ("time", "displacement", "force") if with_tool else ("time", "stretch", "stress")


def usual_folder(files: Sequence[Path]) -> Path:
    """A name for the dataset of some files: what their names begin with, or that of the first."""
    stems = [file.stem for file in files]
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*stems, strict=False))
    common = "".join(letters[0] for letters in alike)
    return Path(plain_name(common if len(common.strip("-_ .")) > 1 else stems[0]))


def plain_name(text: str) -> str:
    """A text in small letters, digits, points and hyphens, as names of datasets and curves are."""
    return _NOT_IN_A_NAME.sub("-", text.lower()).strip("-.") or "dataset"


def write_new_dataset(out: Path, sources: Mapping[Path, Sequence[Choice]], description: TestDescription) -> NewDataset:
    """Write a dataset's folder: dataset.toml, and a CSV for each file.

    Parameters
    ----------
    out : folder, which must not exist or be empty.
    sources : file -> the columns of what :func:`quantities_of` names, or all but the time where a rate is given.

    Raises
    ------
    InputError : the folder is taken, or the numbers cannot be right; the sentence says which. Nothing is written.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: this exists already; name another folder with --out.")
    notes: list[str] = []
    ids = _ids(list(sources))
    tables = {ids[file]: _rows(file, choices, description, notes) for file, choices in sources.items()}
    first = next(iter(sources.values()))
    measured: tuple[Quantity, ...] = ("stretch", "stress") if description.strip else tuple(c.quantity for c in first[-2:])
    columns = [TIME, *(QUANTITIES[quantity].column for quantity in measured)]
    origins = [f"{choice.column.name} [{choice.unit}]" for choice in first]
    origins = origins if len(origins) == len(columns) else [f"the rate, {description.rate_per_s:g} per s", *origins]
    try:
        with whole_folder(out) as folder:
            (folder / DATASET_FILE).write_text(_toml(plain_name(out.resolve().name), list(tables), description), encoding="utf-8")
            for name, rows in tables.items():
                lines = [",".join(columns), *(",".join(f"{number:.9g}" for number in row) for row in rows)]
                (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
            _check(folder, out)
    except InputError as error:
        raise InputError(str(error).replace(f"{DATASET_FILE}, line", f"{DATASET_FILE} (not written), line")) from None
    return {
        "dataset": str(out),
        "test": description.test,
        "columns": dict(zip(columns, origins, strict=True)),
        "curves": [
            {
                "id": ids[file],
                "file": f"{ids[file]}.csv",
                "source": str(file),
                "rows": len(tables[ids[file]]),
                "duration_s": float(tables[ids[file]][-1, 0]),
            }
            for file in sources
        ],
        "notes": list(dict.fromkeys(notes)),
    }


def _check(folder: Path, out: Path) -> None:
    """Raise InputError, about the place where the folder is to stand, if it is no dataset."""
    try:
        read_dataset(folder)
    except InputError as error:
        raise InputError(str(error).replace(str(folder), str(out))) from None


def _ids(files: Sequence[Path]) -> dict[Path, str]:
    """A name for each curve, from that of its file."""
    ids: dict[Path, str] = {}
    for file in files:
        name = plain_name(file.stem)
        number = 2
        while name in ids.values():
            name, number = f"{plain_name(file.stem)}-{number}", number + 1
        ids[file] = name
    return ids


def _rows(file: Path, choices: Sequence[Choice], description: TestDescription, notes: list[str]) -> np.ndarray:
    """What a file holds in the units, signs and zeros of a dataset (k, columns)."""
    values = [choice.column.values * choice.factor for choice in choices]
    rows = np.column_stack(values if len(values) > 2 else [np.zeros(len(values[0])), *values])
    complete = np.isfinite(rows).all(axis=1)
    if not complete.all():
        notes.append(f"{file}: {(~complete).sum()} rows with an empty cell are left out.")
    rows = rows[complete]
    if not len(rows):
        raise InputError(f"{file}: no row has a number in each of the columns that were chosen.")
    rows = _turned(file, rows, choices[-2:], description.test, notes)
    if len(choices) == 2:
        imposed = 2 if description.tool is not None and description.tool["control"] == "force" else 1
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(rows[:, imposed])))])
        rows[:, 0] = path / (description.rate_per_s or 1.0)
    later = np.append(True, np.diff(np.maximum.accumulate(rows[:, 0])) > 0.0)
    if not later.all():
        notes.append(f"{file}: {(~later).sum()} rows whose time does not increase are left out.")
    rows = rows[later]
    if description.contact_force_N is not None and choices[-1].quantity == "force":
        rows = _from_contact(file, rows, description.contact_force_N, notes)
    if len(rows) < SMALLEST_CURVE_ROWS:
        raise InputError(f"{file}: {len(rows)} rows are left, and a curve needs {SMALLEST_CURVE_ROWS} at least.")
    rows[:, 0] -= rows[0, 0]
    if description.strip is not None:  # pulling is negative until here
        rows[:, 1] = 1.0 - rows[:, 1] / description.strip.length_mm
        rows[:, 2] = -rows[:, 2] / (1e-6 * description.strip.area_mm2)
    every = -(-len(rows) // LARGEST_CURVE_ROWS)
    if every > 1:
        notes.append(f"{file}: one row in {every} is kept, since no more than {LARGEST_CURVE_ROWS} are computed.")
    return rows[::every]


def _turned(file: Path, rows: np.ndarray, choices: Sequence[Choice], test: TestKind, notes: list[str]) -> np.ndarray:
    """Zeros and signs as a dataset has them: into the tissue and compression are positive; of stresses, tension is."""
    first, second = choices[0].quantity, choices[1].quantity
    pulls = test == "tension"
    if first == "stretch":
        # A strain begins at 0, a stretch at 1.
        if abs(rows[0, 1]) < LARGEST_FIRST_STRAIN:
            notes.append(
                f'"{choices[0].column.name}" begins near 0, so it is a strain: the stretch is 1 + strain, below 1 in compression.'
            )
            rows[:, 1] = 1.0 + _signed(rows[:, 1], 1.0 if pulls else -1.0)
        rows[:, 2] = _signed(rows[:, 2], 1.0 if pulls else -1.0)
        return rows
    if first == "displacement":
        start, extent = rows[0, 1], float(np.ptp(rows[:, 1]))
        if abs(start) > FAR_FROM_ZERO_SHARE * extent:
            notes.append(f"{file}: the displacement begins at {start:.4g} mm; it is counted from there.")
            rows[:, 1] -= start
        for column, what in ((1, first), (2, second)):
            turned = _signed(rows[:, column], -1.0 if pulls else 1.0)
            if not np.array_equal(turned, rows[:, column]):
                wanted = "pulling is negative" if pulls else "compression is positive"
                notes.append(f"the sign of the {what} was turned: in a dataset {wanted}.")
            rows[:, column] = turned
    return rows


def _signed(values: np.ndarray, sign: float) -> np.ndarray:
    """The values, turned around if the largest has the other sign."""
    if np.sign(values[np.abs(values).argmax()]) in (0.0, sign):
        return values
    return -values + 0.0  # no -0


def _from_contact(file: Path, rows: np.ndarray, force_N: float, notes: list[str]) -> np.ndarray:
    """The rows from the first one on in which the tool presses with this force; the displacement is counted from there."""
    pressing = np.flatnonzero(np.abs(rows[:, 2]) >= force_N)
    if not len(pressing):
        raise InputError(f"{file}: the force never reaches the contact force of {force_N:g} N; give a smaller one.")
    begin = int(pressing[0])
    if begin:
        notes.append(f"{file}: {begin} rows before contact ({force_N:g} N) are left out; the displacement is counted from there.")
    rows = rows[begin:].copy()
    rows[:, 1] -= rows[0, 1]
    return rows


def _toml(name: str, ids: Sequence[str], description: TestDescription) -> str:
    """The text of dataset.toml."""
    lines = ["# Every key: explicitfe schema dataset. What is right and what is missing: explicitfe check, with this folder."]
    head = {
        "format": "explicitfe-dataset/1",
        "name": name,
        "title": description.title,
        "test": description.test,
        "source": description.source,
        "license": description.license,
    }
    lines += [f"{key} = {toml_value(value)}" for key, value in head.items() if value]
    for key, table in (("specimen", description.specimen), ("tool", description.tool), ("noise", description.noise)):
        if table:
            lines += ["", f"[{key}]", *(f"{toml_key(inner)} = {toml_value(value)}" for inner, value in table.items())]
    for curve in ids:
        lines += ["", "[[curve]]", f"id = {toml_value(curve)}", f"file = {toml_value(f'{curve}.csv')}"]
        if description.one_specimen and len(ids) > 1:
            lines.append('group = "specimen"')
    return "\n".join(lines) + "\n"


def missing(export: Export, quantity: Quantity) -> InputError:
    """What to say where nobody said which column is a quantity, or in which unit."""
    names = ", ".join(shortened(column.name) for column in export.columns)
    units = ", ".join(QUANTITIES[quantity].units)
    otherwise = "; without such a column give --rate" if quantity == "time" else ""
    return InputError(
        f"{export.path}: which column is the {quantity}, and in which unit? The columns are {names}; say it by "
        f'--{quantity} "COLUMN:UNIT" (units: {units}){otherwise}.'
    )
