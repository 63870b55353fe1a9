"""Make a dataset from tables of a testing machine: convert units, signs and zeros, and write the folder."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from typing_extensions import TypedDict

from explicitfe.inverse.measured.columns import Choice, candidates, set_value
from explicitfe.inverse.measured.contact import CONTACT_POWERS, approach_of, contact_before
from explicitfe.inverse.measured.curve import TIME
from explicitfe.inverse.measured.export import TWO_UNITS, Export, ExportColumn
from explicitfe.inverse.measured.files import LARGEST_CURVE_ROWS, SMALLEST_CURVE_ROWS, later_rows
from explicitfe.inverse.measured.quantities import QUANTITIES, Quantity, is_unit, measure_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.tables import RawTable, TestKind
from explicitfe.inverse.measured.units import FAR_FROM_ZERO_SHARE
from explicitfe.platform.errors import InputError, shortened
from explicitfe.platform.host.shipped import DATASET_FILE
from explicitfe.platform.host.toml_text import toml_key, toml_value
from explicitfe.results.files.folder import whole_folder

LARGEST_FIRST_STRAIN = 0.5
FAR_FROM_ZERO_SDS = 3.0  # A mean force before contact beyond so many standard errors is the zero of the load cell.
# A number that is so many times all others marks missing values if programs use it for that; any other needs the square of it,
# and must be repeated in few rows.
FAR_OUTSIDE, MOST_MARKS_SHARE = 10.0, 0.1
_MARK = re.compile(r"9{3,}(\.9+)?|.*e\+\d+|3276[78]|65535|16512|2147483647|2147483648")
_NOT_IN_A_NAME = re.compile(r"[^a-z0-9.]+")


class NewCurve(TypedDict):
    """A curve of a new dataset, with its source file, number of rows and duration."""

    id: str
    file: str
    source: str
    rows: int
    duration_s: float


class NewDataset(TypedDict):
    """A dataset that was written: its folder, curves, the origin of each column, and what was changed in the numbers."""

    dataset: str
    test: str
    columns: dict[str, str]
    curves: list[NewCurve]
    notes: list[str]


@dataclass(frozen=True)
class Strip:
    """A strip between clamps, with uniform strain along its free length."""

    length_mm: float
    area_mm2: float


@dataclass(frozen=True, kw_only=True)
class DatasetDescription:
    """Properties of any dataset that its files do not state."""

    title: str
    test: TestKind
    source: str = ""
    license: str = ""


@dataclass(frozen=True, kw_only=True)
class TestDescription(DatasetDescription):
    """Properties of a test that its tables do not state.

    Attributes
    ----------
    specimen, tool, noise : tables of the dataset; tool is None where the columns are stretch and stress.
    contact_force_N : rows before the force first reaches this value are omitted, and the displacement at contact follows from the
        rows behind; if None, rows whose force is within the noise are recognised as the approach.
    rate_per_s : rate of the imposed column, in its unit per second, where there is no time column. Rows in which that column does
        not change are omitted.
    strip : length and cross-section of a strip between clamps. Its displacement and force are converted to stretch and stress.
    one_specimen : whether all files were measured on the same specimen.
    tests : of each file, where they are not all the same; all columns are then stretch and stress, or those of shear.
    """

    specimen: RawTable
    tool: RawTable | None
    noise: RawTable = field(default_factory=dict)
    contact_force_N: float | None = None
    rate_per_s: float | None = None
    strip: Strip | None = None
    one_specimen: bool = False
    tests: tuple[TestKind, ...] = ()

    @property
    def presses(self) -> bool:
        """Whether a tool comes into contact and presses."""
        return self.tool is not None and self.test != "tension" and self.tool["shape"] != "bonded-disc"


def quantities_of(test: TestKind, with_tool: bool) -> tuple[Quantity, ...]:
    """Return the quantities that a test must provide; the first is time."""
    if test == "shear":
        return "time", "shear-strain", "shear-stress"
    return ("time", "displacement", "force") if with_tool else ("time", "stretch", "stress")


def usual_folder(files: Sequence[Path]) -> Path:
    """Return the default dataset folder: the common beginning of the file names, or the name of the first file."""
    stems = [file.stem for file in files]
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*stems, strict=False))
    common = "".join(letters[0] for letters in alike)
    return Path(plain_name(common if len(common.strip("-_ .")) > 1 else stems[0]))


def plain_name(text: str) -> str:
    """Convert a text to lower-case letters, digits, points and hyphens, as required for names of datasets and curves."""
    return _NOT_IN_A_NAME.sub("-", text.lower()).strip("-.") or "dataset"


def write_new_dataset(out: Path, sources: Sequence[tuple[Export, Sequence[Choice]]], description: TestDescription) -> NewDataset:
    """Write the folder of a dataset: dataset.toml, and a CSV for each file.

    Parameters
    ----------
    out : a folder that does not exist or is empty.
    sources : tables, and their columns of the quantities of :func:`quantities_of`, without time where a rate is given.

    Raises
    ------
    InputError : the folder is not empty, or a value is outside its physical range. Nothing is written.
    """
    check_free(out)
    notes: list[str] = []
    curves: list[CurveToWrite] = []
    origins: dict[str, str] = {}
    tests = description.tests or len(sources) * (description.test,)
    for (export, choices), test in zip(sources, tests, strict=True):
        rows = _rows(export, choices, replace(description, test=test), notes)
        measured: tuple[Quantity, ...] = ("stretch", "stress") if description.strip else tuple(c.quantity for c in choices[-2:])
        columns = [TIME, *(QUANTITIES[quantity].column for quantity in measured)]
        own_origins = [f"{choice.column.name} [{choice.unit}]" for choice in choices]
        if len(own_origins) < len(columns):
            own_origins.insert(0, f"the rate, {description.rate_per_s:g} per s")
        origins = dict(zip(columns, own_origins, strict=True)) | origins
        keys = [f"test = {toml_value(test)}"] if test != description.test else []
        keys += ['group = "specimen"'] if description.one_specimen and len(sources) > 1 else []
        if description.presses and rows[0, 1] != 0.0:
            keys.append('contact = "fit"  # The displacement of first contact is fitted with the constants.')
        curves.append(CurveToWrite(export.path, columns, rows, keys))
    tables = []
    for key, table in (("specimen", description.specimen), ("tool", description.tool), ("noise", description.noise)):
        if table:
            tables += ["", f"[{key}]", *(f"{toml_key(inner)} = {toml_value(value)}" for inner, value in table.items())]
    curves_written = write_folder(out, description, tables, curves)
    return {
        "dataset": str(out),
        "test": ", ".join(dict.fromkeys(tests)),
        "columns": origins,
        "curves": curves_written,
        "notes": list(dict.fromkeys(notes)),
    }


class CurveToWrite(NamedTuple):
    """A curve of a new dataset: its source, columns, rows (k, columns), and lines of TOML in and above its table."""

    file: Path
    columns: Sequence[str]
    rows: np.ndarray
    keys: Sequence[str]
    comments: Sequence[str] = ()


def write_folder(
    out: Path,
    described: DatasetDescription,
    tables: Sequence[str],
    curves: Sequence[CurveToWrite],
    *,
    scenario: str | None = None,
    files: Mapping[str, bytes] | None = None,
) -> list[NewCurve]:
    """Write dataset.toml, a CSV for each curve and other files, and read the dataset back.

    Parameters
    ----------
    tables : lines of dataset.toml between its first keys and the curves.
    files : name -> content.

    Raises
    ------
    InputError : a value is outside its physical range. Nothing is written.
    """
    lines = ["# All keys: explicitfe schema dataset. Validate this folder with: explicitfe check FOLDER"]
    head = {
        "format": "explicitfe-dataset/1",
        "name": plain_name(out.resolve().name),
        **{key: getattr(described, key) for key in ("title", "test", "source", "license")},
        "scenario": scenario,
    }
    lines += [*(f"{key} = {toml_value(value)}" for key, value in head.items() if value), *tables]
    ids = curve_names([curve.file for curve in curves])
    with whole_folder(out) as folder:
        for name, content in (files or {}).items():
            (folder / name).write_bytes(content)
        for curve in curves:
            file = f"{ids[curve.file]}.csv"
            lines += ["", *curve.comments, "[[curve]]", f"id = {toml_value(ids[curve.file])}", f"file = {toml_value(file)}"]
            lines += curve.keys
            rows = [",".join(curve.columns), *(",".join(f"{number:.9g}" for number in row) for row in curve.rows)]
            (folder / file).write_text("\n".join(rows) + "\n", encoding="utf-8")
        (folder / DATASET_FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
        try:
            read_dataset(folder)
        except InputError as error:
            sentence = str(error).replace(str(folder), str(out))
            for curve in curves:
                written = f"{ids[curve.file]}.csv"
                sentence = sentence.replace(str(out / written), f"{curve.file}, converted to {written} (not written)")
            raise InputError(sentence.replace(f"{DATASET_FILE}, line", f"{DATASET_FILE} (not written), line")) from None
    return [
        {
            "id": ids[curve.file],
            "file": f"{ids[curve.file]}.csv",
            "source": str(curve.file),
            "rows": len(curve.rows),
            "duration_s": float(curve.rows[-1, 0]),
        }
        for curve in curves
    ]


def check_free(out: Path) -> None:
    """Raise InputError if a folder exists and is not empty."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: this already exists; name another folder with `out`.")


def curve_names(files: Sequence[Path]) -> dict[Path, str]:
    """Name each curve after its file, without repetition."""
    ids: dict[Path, str] = {}
    for file in files:
        name = plain_name(file.stem)
        number = 2
        while name in ids.values():
            name, number = f"{plain_name(file.stem)}-{number}", number + 1
        ids[file] = name
    return ids


def _rows(export: Export, choices: Sequence[Choice], description: TestDescription, notes: list[str]) -> np.ndarray:
    """Convert the columns of a file to the units, signs and zeros of a dataset: (rows, columns)."""
    file = export.path
    notes += export.notes
    values = [_without_marks(export, choice, notes) * choice.factor for choice in choices]
    for choice in choices:
        if other := set_value(export, choice):
            notes.append(f'{file}: "{choice.column.name}" is taken as the {choice.quantity}, not the set value "{other}".')
    rows = np.column_stack(values if len(values) > 2 else [np.zeros(len(values[0])), *values])
    complete = np.isfinite(rows).all(axis=1)
    if not complete.all():
        line = export.line_of[~complete][0]
        notes.append(
            f"{file}: {(~complete).sum()} rows without a number in each column are omitted, the first one in line {line}."
        )
    rows, line_of = rows[complete], export.line_of[complete]
    if not len(rows):
        raise InputError(f"{file}: no row has a number in every selected column; check the columns.")
    rows = _with_signs(file, rows, choices[-2:], description, notes)
    if len(choices) == 2:
        imposed = 2 if description.tool is not None and description.tool["control"] == "force" else 1
        path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(rows[:, imposed])))])
        rows[:, 0] = path / (description.rate_per_s or 1.0)
    later = later_rows(file, rows[:, 0], line_of)
    if not later.all():
        why = "whose time does not increase" if len(choices) > 2 else "in which the load does not change, and so have no time,"
        notes.append(f"{file}: {(~later).sum()} rows {why} are omitted, the first one in line {line_of[~later][0]}.")
    rows = rows[later]
    if description.presses:
        rows = _from_contact(file, rows, description, notes)
    if len(rows) < SMALLEST_CURVE_ROWS:
        raise InputError(f"{file}: {len(rows)} usable rows; a curve needs at least {SMALLEST_CURVE_ROWS}.")
    rows[:, 0] -= rows[0, 0]
    if description.strip is not None:
        rows[:, 1] = 1.0 + rows[:, 1] / description.strip.length_mm
        rows[:, 2] = rows[:, 2] / (1e-6 * description.strip.area_mm2)
    return thinned(file, rows, notes)


def _without_marks(export: Export, choice: Choice, notes: list[str]) -> np.ndarray:
    """The values of a column, nan where a number such as -9999 or 1e30 marks a missing one."""
    values = choice.column.values.copy()
    while choice.quantity != "time" and np.isfinite(values).any():
        mark = values[np.nanargmax(np.abs(values))]
        rows = values == mark
        others = np.nanmax(np.abs(values[~rows]), initial=0.0)
        looks = _MARK.fullmatch(f"{abs(mark):.10g}".rstrip("0").rstrip(".")) is not None
        far = FAR_OUTSIDE if looks else FAR_OUTSIDE**2
        if not (0.0 < far * others < abs(mark) and (looks or 1 < rows.sum() <= MOST_MARKS_SHARE * len(rows))):
            break
        notes.append(
            f'{export.path}: {mark:g} in the column "{choice.column.name}" is far outside all other values and is taken as '
            f"missing in {rows.sum()} rows, first in line {export.line_of[rows][0]}."
        )
        values[rows] = np.nan
    return values


def thinned(file: Path, rows: np.ndarray, notes: list[str]) -> np.ndarray:
    """Keep every n-th row of a table with more rows than a curve may have."""
    every = -(-len(rows) // LARGEST_CURVE_ROWS)
    if every > 1:
        notes.append(f"{file}: one row in {every} is kept, because a curve has at most {LARGEST_CURVE_ROWS} rows.")
    return rows[::every]


def _with_signs(
    file: Path, rows: np.ndarray, choices: Sequence[Choice], description: TestDescription, notes: list[str]
) -> np.ndarray:
    """Zeros and signs of a dataset, with a note on each change.

    With a tool, a displacement into the tissue and a compressive force are positive. Of stretches and stresses, and of a strip
    before they are computed, tension is positive.
    """
    first = choices[0].quantity
    pulls = description.test in ("tension", "equibiaxial", "planar")
    if first == "stretch":
        signs, convention = (1.0 if pulls else -1.0), "tension is positive"
        strain, stress = (measure_of(choice.quantity, choice.column.name) for choice in choices)
        name, of_stress = (choice.column.name for choice in choices)
        # A strain begins at 0, a stretch at 1.
        if strain is not None:
            notes.append(f'"{name}" is taken as a {strain.title}: stretch = {strain.formula}.')
            rows[:, 1] = strain.convert(_signed(rows[:, 1], signs, "strain", convention, notes), rows[:, 1])
        elif abs(rows[0, 1]) < LARGEST_FIRST_STRAIN:
            notes.append(f'"{name}" begins near 0 and is taken as a strain: stretch = 1 + strain, below 1 in compression.')
            rows[:, 1] = 1.0 + _signed(rows[:, 1], signs, "strain", convention, notes)
        rows[:, 2] = _signed(rows[:, 2], signs, "stress", convention, notes)
        if stress is not None:
            notes.append(
                f'"{of_stress}" is taken as a {stress.title}: nominal stress = {stress.formula}, without change of volume.'
            )
            rows[:, 2] = stress.convert(rows[:, 2], rows[:, 1])
    for choice in choices if first == "shear-strain" else ():
        if measure_of("stretch", choice.column.name) or measure_of("stress", choice.column.name):
            raise InputError(
                f'{file}: "{shortened(choice.column.name)}" is no measure of simple shear; give the tangent of the angle and '
                "the force over the area."
            )
    if first == "displacement":
        start, extent = rows[0, 1], float(np.ptp(rows[:, 1]))
        if abs(start) > FAR_FROM_ZERO_SHARE * extent:
            notes.append(f"{file}: the displacement begins at {start:.4g} mm; this value is subtracted.")
            rows[:, 1] -= start
        signs, convention = 1.0, "compression is positive"
        if pulls:
            signs, convention = (1.0, "tension is positive") if description.strip else (-1.0, "the pull of a tool is negative")
        for column, choice in enumerate(choices, 1):
            rows[:, column] = _signed(rows[:, column], signs, choice.quantity, convention, notes)
    return rows


def _signed(values: np.ndarray, sign: float, what: str, convention: str, notes: list[str]) -> np.ndarray:
    """The values, with reversed signs if the largest one has the other sign."""
    if np.sign(values[np.abs(values).argmax()]) in (0.0, sign):
        return values
    notes.append(f"the sign of the {what} is reversed: in a dataset, {convention}.")
    return -values + 0.0  # no -0


def _from_contact(file: Path, rows: np.ndarray, description: TestDescription, notes: list[str]) -> np.ndarray:
    """The rows with the displacement zero at first contact, and the force zero before."""
    assert description.tool is not None
    power, force_N = CONTACT_POWERS.get(description.tool["shape"], 1.0), description.contact_force_N
    approach = approach_of(rows[:, 1], rows[:, 2], power, description.noise.get("force_sd_N", 0.0))
    rows = rows.copy()
    if approach is not None:
        rows[:, 1] -= approach.contact
        notes.append(
            f"{file}: the tool does not touch in the first {approach.rows} rows: their force is within the noise. The "
            f"displacement is zero at contact, {approach.contact:.4g} mm by the power {power:g} of the force; identify fits it."
        )
        if abs(approach.force) > FAR_FROM_ZERO_SDS * approach.sd / np.sqrt(approach.rows):
            rows[:, 2] -= approach.force
            notes.append(f"{file}: the mean force of these rows, {approach.force:.3g} N, is subtracted.")
    if force_N is None:
        return rows
    pressing = np.flatnonzero(np.abs(rows[:, 2]) >= force_N)
    if not len(pressing):
        raise InputError(f"{file}: the force never reaches the contact force of {force_N:g} N; give a smaller `contact_force_N`.")
    begin = int(pressing[0])
    rows = rows[begin:]
    if begin and approach is None and len(rows) >= SMALLEST_CURVE_ROWS:
        contact = contact_before(rows[:, 1], rows[:, 2], power)
        rows[:, 1] -= contact
        notes.append(f"{file}: the displacement is zero at contact, {contact:.4g} mm by the power {power:g} of the force.")
    if begin:
        notes.append(f"{file}: {begin} rows before contact ({force_N:g} N) are omitted.")
    return rows


def missing(export: Export, quantity: Quantity, column: ExportColumn | None = None) -> str:
    """The option that states the column of a quantity and its unit, and why it is needed."""
    possible = candidates(export, quantity) if column is None else [column]
    units = list(QUANTITIES[quantity].units)
    otherwise = ", or --rate PER_S without a time column," if quantity == "time" else ""
    name, unit, why = "COLUMN", units[0], f"no column is known as the {quantity}"
    if len(possible) > 1:
        named = ", ".join(f'{export.columns.index(c) + 1} "{shortened(c.name)}"' for c in possible)
        return f"--{quantity} COLUMN ({len(possible)} columns may be it: {named}; give the name or the number of one)"
    if possible:
        name, stated = shortened(possible[0].name), shortened(possible[0].unit)
        if not stated:
            why = "its unit is not stated"
        elif TWO_UNITS in stated:
            unit, why = "UNIT", f"its name and the row of units state different ones, {stated}"
        elif is_unit(stated):
            name, why = "COLUMN", f'"{name}" is in {stated}'
        else:
            unit, why = "UNIT", f'"{stated}" is no known unit: convert the column to one of those that are'
    return f'--{quantity} "{name}:{unit}"{otherwise} ({why}; units: {", ".join(units)})'
