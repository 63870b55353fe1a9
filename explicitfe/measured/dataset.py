"""Measured curves in a folder: ``dataset.toml`` and one CSV a curve (explicitfe-dataset/1), read, checked and turned into SI."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from explicitfe.errors import InputError, nearest
from explicitfe.scenario.scenario import Vector, explain, validated

Kind = Literal["force-displacement", "uniaxial", "shear", "trajectory"]
Test = Literal["indentation", "compression", "tension", "shear", "trajectory"]
Split = Literal["fit", "holdout"]
FILE_NAME = "dataset.toml"
TIME = "time_s"
SMALLEST_CURVE = 3  # rows

# Column of the file -> name and factor in SI.
COLUMNS: dict[Kind, dict[str, tuple[str, float]]] = {
    "force-displacement": {"displacement_mm": ("displacement_m", 1e-3), "force_N": ("force_N", 1.0)},
    "uniaxial": {"stretch": ("stretch", 1.0), "nominal_stress_Pa": ("nominal_stress_Pa", 1.0)},
    "shear": {"shear_strain": ("shear_strain", 1.0), "shear_stress_Pa": ("shear_stress_Pa", 1.0)},
}
# Noise that a kind of curve can have, and the column that it is of.
NOISE: dict[Kind, dict[str, str]] = {
    "force-displacement": {"force_sd_N": "force_N", "displacement_sd_mm": "displacement_mm"},
    "uniaxial": {"stress_sd_Pa": "nominal_stress_Pa", "stretch_sd": "stretch"},
    "shear": {"stress_sd_Pa": "shear_stress_Pa"},
    "trajectory": {"displacement_sd_mm": "the coordinates"},
}
# Conditions that say which measurement a curve is: what was asked for (digitised, so equal to a few percent), and of what.
_PROGRAMME = ("rate_per_s", "rate_mm_per_s", "max_strain", "max_stretch", "max_displacement_mm", "hold_s")
_IDENTITY = (
    "direction", "material", "sample", "spot", "piece", "day", "repeat", "cycle", "order", "phases", "site",
)  # fmt: skip
_SAME_PROGRAMME = 0.05
_NUMBERS = (*_PROGRAMME, "preload_N", "first_force_N")
_LARGEST = float(np.finfo(float).max)

# Keys that belong to a shape: a curve that overrides the shape brings its own.
_SHAPED = {"radius_mm", "height_mm", "size_mm", "edge_radius_mm"}

# What lies outside was given in another unit. Wide: a curve that is merely unusual must pass.
_LENGTH_MM = (0.1, 1000.0)
_THIN_MM = (0.01, 1000.0)  # layers and rounded edges
_DENSITY_KG_M3 = (100.0, 20_000.0)
_RATIO = (1e-3, 1e3)
_STRETCH = (0.05, 10.0)
_SHEAR = 10.0
_STRAIN_IN_METRES = 1e-3  # of the thickness: no displacement that was meant in metres exceeds it
_DENT_IN_METRES = 1e-2  # of the tool's radius
_PULL = 10.0  # thicknesses
_PRESSURE_PA = (1.0, 1e8)
_STRESS_PA = (1e-2, 1e9)
_STIFFNESS_PA = (10.0, 1e9)  # largest stress over largest strain
_COORDINATE_MM = (0.2, 1000.0)

_CELL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_SENSOR = re.compile(r"(.+)_([xyz])_mm")
_HEADER = re.compile(r"""\s*(\[\[?)\s*([A-Za-z_"'][^\[\],]*?)\s*\]\]?\s*(#.*)?$""")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _within(limits: tuple[float, float], unit: str, zero: bool = False) -> AfterValidator:
    low, high = limits

    def check(value: float) -> float:
        if not (low <= value <= high or (zero and value == 0.0)):
            raise ValueError(f"{value:g} does not lie between {low:g} and {high:g}; give it in {unit}")
        return value

    return AfterValidator(check)


Length = Annotated[float, _within(_LENGTH_MM, "mm")]
Thickness = Annotated[float, _within(_THIN_MM, "mm", zero=True)]


def _three(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise ValueError("must be three numbers [x, y, z]")
    return tuple(value)


def _friction(value: Any) -> Any:
    number = _is_number(value) and value >= 0.0
    if not number and value not in ("stick", "unknown"):
        raise ValueError(f'{value!r} is not possible; it must be a number from 0 up, "stick" or "unknown"')
    return float(value) if number else value


class _Described(_Table):
    """A table some of whose keys are inferred and not stated by the source."""

    assumed: tuple[str, ...] = Field(default=(), description="keys of this table that the source does not state")

    @model_validator(mode="after")
    def _assumed_is_given(self) -> _Described:
        given = self.model_fields_set - {"assumed"}
        for key in self.assumed:
            if key not in given:
                raise ValueError(f'assumed names "{key}", which this table does not give; {nearest(key, given)}')
        return self

    def _only(self, shape: str, needed: Iterable[str], possible: Iterable[str]) -> None:
        """ValueError where a key of a shape is missing, or one stands that the shape does not have."""
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f'shape = "{shape}" needs {key}; add it')
        for key in sorted(self.model_fields_set & set(possible) - set(needed)):
            raise ValueError(f'shape = "{shape}" has no {key}; take it out')


class SpecimenTable(_Described):
    """What was tested. A block's third size is its thickness, along the load."""

    shape: Literal["point", "cylinder", "block"] = Field(description="point: a homogeneous state of no known size")
    radius_mm: Length | None = None
    height_mm: Length | None = None
    size_mm: Annotated[tuple[Length, Length, Length], BeforeValidator(_three)] | None = None
    density_kg_m3: Annotated[float, _within(_DENSITY_KG_M3, "kg/m3")] = 1040.0
    base: Literal["bonded", "frictionless", "unknown"] = "unknown"
    layer_mm: Thickness = Field(default=0.0, description="thickness of a surface layer; 0 is none")
    layer_stiffness_ratio: Annotated[float, _within(_RATIO, "layer over body")] = 1.0

    @model_validator(mode="after")
    def _whole(self) -> SpecimenTable:
        needed = {"point": [], "cylinder": ["radius_mm", "height_mm"], "block": ["size_mm"]}[self.shape]
        self._only(self.shape, needed, ["radius_mm", "height_mm", "size_mm"])
        if self.layer_mm > 0.0 and self.shape == "point":
            raise ValueError('shape = "point" has no layer; take layer_mm out')
        if self.layer_mm > 0.0 and self.layer_mm >= self.thickness_mm:
            raise ValueError(f"layer_mm = {self.layer_mm:g} is no less than the specimen's height, {self.thickness_mm:g} mm")
        if "layer_stiffness_ratio" in self.model_fields_set and self.layer_mm == 0.0:
            raise ValueError("layer_stiffness_ratio needs the thickness layer_mm; add it")
        return self

    @property
    def thickness_mm(self) -> float:
        """Height along the load [mm]; not of a point."""
        return self.height_mm if self.size_mm is None else self.size_mm[2]

    @property
    def face_mm2(self) -> float:
        """Area of the loaded face [mm2]; not of a point."""
        return math.pi * self.radius_mm**2 if self.size_mm is None else self.size_mm[0] * self.size_mm[1]


class ToolTable(_Described):
    """What pressed or pulled, and which column it imposed."""

    shape: Literal["flat-cylinder", "sphere", "platen", "bonded-disc"]
    radius_mm: Length | None = None
    edge_radius_mm: Thickness = Field(default=0.0, description="rounding of a flat cylinder's edge")
    control: Literal["force", "displacement"] = Field(description="the column that is imposed; the other one is predicted")
    friction: Annotated[float | Literal["stick", "unknown"], BeforeValidator(_friction)] = "unknown"

    @model_validator(mode="after")
    def _whole(self) -> ToolTable:
        needed = [] if self.shape == "platen" else ["radius_mm"]
        rounded = [] if self.shape == "flat-cylinder" else ["edge_radius_mm"]
        self._only(self.shape, needed, ["radius_mm", *rounded])
        if self.radius_mm is not None and self.edge_radius_mm > self.radius_mm:
            raise ValueError(f"edge_radius_mm = {self.edge_radius_mm:g} exceeds radius_mm = {self.radius_mm:g}")
        return self


class NoiseTable(_Table):
    """Standard deviations of one row; None is unknown, 0 is exact."""

    force_sd_N: float | None = Field(default=None, ge=0.0)
    displacement_sd_mm: float | None = Field(default=None, ge=0.0)
    stress_sd_Pa: float | None = Field(default=None, ge=0.0)
    stretch_sd: float | None = Field(default=None, ge=0.0)
    repeat_sd_fraction: float | None = Field(default=None, ge=0.0, le=1.0, description="scatter between equal tests")


class SensorTable(_Table):
    """A sensor of a trajectory and the model's point that it sits on."""

    name: str = Field(min_length=1)
    model_point: str = Field(min_length=1, description="named point of the scenario's model")


def _fit_or(check: Callable[[Any], Any]) -> BeforeValidator:
    return BeforeValidator(lambda value: value if value == "fit" else check(value))


def _rotation(value: Any) -> Any:
    rows = value if isinstance(value, list) else []
    if [len(row) if isinstance(row, list) and all(map(_is_number, row)) else 0 for row in rows] == [3, 3, 3]:
        matrix = np.array(rows, dtype=float)
        if np.abs(matrix).max() < 2.0 and np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) and np.linalg.det(matrix) > 0.0:
            return tuple(tuple(map(float, row)) for row in rows)
    raise ValueError('must be "fit" or three rows of three numbers that make a rotation matrix')


def _translation(value: Any) -> Any:
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
        raise ValueError('must be "fit" or three numbers [x, y, z] in mm')
    return tuple(map(float, value))


def _scale(value: Any) -> Any:
    if not _is_number(value) or value <= 0.0:
        raise ValueError('must be "fit" or a number above 0')
    return value


class RegistrationTable(_Table):
    """From the sensors' frame to the model's: x_model = scale * rotation x + translation; "fit" leaves a part to the program."""

    rotation: Annotated[tuple[Vector, Vector, Vector] | Literal["fit"], _fit_or(_rotation)] = (
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
    )
    translation: Annotated[Vector | Literal["fit"], _fit_or(_translation)] = Field(default=(0.0, 0.0, 0.0), description="mm")
    scale: Annotated[float | Literal["fit"], _fit_or(_scale)] = 1.0


def _is_number(value: Any) -> bool:
    # Whole numbers have no limit in TOML; not all of them are floats, and none is compared wrongly.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


class CurveTable(_Table):
    """One curve, as the file states it; its tables are merged over those of the dataset."""

    id: str
    file: str
    constants: str = Field(default="all", min_length=1, description="curves of one name share their constants")
    group: str | None = Field(default=None, min_length=1, description="what shares one specimen or site; its own id if left out")
    split: Split | None = None
    specimen: dict[str, Any] = {}
    tool: dict[str, Any] = {}
    noise: dict[str, Any] = {}
    conditions: dict[str, Any] = {}

    @field_validator("id", "file")
    @classmethod
    def _plain_name(cls, name: str) -> str:
        if not name.strip() or name.startswith(".") or set(name) & set("/\\") or not name.isprintable():
            raise ValueError(f"{name!r} must be a plain name, without a folder")
        return name

    @field_validator("file")
    @classmethod
    def _is_csv(cls, name: str) -> str:
        if not name.lower().endswith(".csv"):
            raise ValueError(f'"{name}" must end in .csv')
        return name

    @field_validator("conditions")
    @classmethod
    def _plain_values(cls, conditions: dict[str, Any]) -> dict[str, Any]:
        for key, value in conditions.items():
            for entry in value if isinstance(value, list) else [value]:
                if not isinstance(entry, str | bool) and not _is_number(entry):
                    raise ValueError(f"{key} must be a string, a finite number, true or false, or an array of these")
            if key in _NUMBERS and not _is_number(value):
                raise ValueError(f"{key} = {value!r} must be a number")
            if key == "defect" and not (isinstance(value, str) and value.strip()):
                raise ValueError("defect must say in words what is wrong; leave it out where nothing is")
        return conditions


class DatasetFile(_Table):
    """The schema of ``dataset.toml``."""

    format: Literal["explicitfe-dataset/1"]
    name: str = Field(pattern=r"^[a-z0-9]+([-.][a-z0-9]+)*$", description="kebab-case")
    title: str
    test: Test
    source: str = ""
    license: str = ""
    notes: str = ""
    scenario: str | None = Field(default=None, min_length=1, description="scenario of a trajectory, relative to this file")
    sensor: list[SensorTable] = []
    registration: RegistrationTable | None = None
    specimen: dict[str, Any] | None = None
    tool: dict[str, Any] | None = None
    noise: dict[str, Any] = {}
    curve: list[CurveTable] = Field(min_length=1)


class _Setup(_Table):
    """The tables of one curve, merged."""

    specimen: SpecimenTable | None = None
    tool: ToolTable | None = None
    noise: NoiseTable = NoiseTable()


@dataclass(frozen=True, eq=False)
class Curve:
    """One measured curve, in SI.

    Parameters
    ----------
    id, file, constants, group, split, conditions : as in the file; split is None where the program chooses.
    kind : what the columns are.
    specimen, tool, noise : the dataset's tables with the curve's own laid over them; tool is None for a homogeneous state,
        specimen too for a trajectory.
    time_s (k,) : 0 in the first row, strictly increasing [s].
    columns : name in SI -> (k,), see :data:`COLUMNS`; empty for a trajectory.
    sensors : name -> positions (k, 3) [m]; a trajectory only.
    """

    id: str
    file: str
    kind: Kind
    constants: str
    group: str
    split: Split | None
    specimen: SpecimenTable | None
    tool: ToolTable | None
    noise: NoiseTable
    conditions: dict[str, Any]
    time_s: np.ndarray
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    sensors: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def defect(self) -> str | None:
        """What is wrong with the curve, in words; None if nothing is known."""
        return self.conditions.get("defect")

    @property
    def imposed(self) -> str:
        """Name of the column that the test imposed; not of a trajectory."""
        return self._driven()[0]

    @property
    def predicted(self) -> str:
        """Name of the column that a model has to predict; not of a trajectory."""
        return self._driven()[1]

    @property
    def displacement_m(self) -> np.ndarray:
        """Of the tool, positive into the tissue (k,) [m]."""
        return self.columns["displacement_m"]

    @property
    def force_N(self) -> np.ndarray:
        """On the tool, positive in compression (k,) [N]."""
        return self.columns["force_N"]

    @property
    def stretch(self) -> np.ndarray:
        """Length over length at rest (k,)."""
        return self.columns["stretch"]

    @property
    def nominal_stress_Pa(self) -> np.ndarray:
        """First Piola stress, tension positive (k,) [Pa]."""
        return self.columns["nominal_stress_Pa"]

    @property
    def shear_strain(self) -> np.ndarray:
        """Amount of simple shear (k,)."""
        return self.columns["shear_strain"]

    @property
    def shear_stress_Pa(self) -> np.ndarray:
        """Shear stress (k,) [Pa]."""
        return self.columns["shear_stress_Pa"]

    def _driven(self) -> tuple[str, str]:
        first, second = self.columns
        return (second, first) if self.tool is not None and self.tool.control == "force" else (first, second)


@dataclass(frozen=True, eq=False)
class Dataset:
    """Curves of one test.

    Parameters
    ----------
    path : the dataset.toml.
    scenario, sensors, registration : of a trajectory; sensors maps a sensor to the model's named point. Without a scenario
        there is nothing to compare with.
    """

    name: str
    title: str
    test: Test
    source: str
    license: str
    notes: str
    path: Path
    curves: tuple[Curve, ...]
    scenario: Path | None = None
    sensors: dict[str, str] = field(default_factory=dict)
    registration: RegistrationTable | None = None

    def constants_groups(self) -> dict[str, tuple[Curve, ...]]:
        """Name of the constants -> the curves that share them, in the order of the file."""
        groups: dict[str, tuple[Curve, ...]] = {}
        for curve in self.curves:
            groups[curve.constants] = (*groups.get(curve.constants, ()), curve)
        return groups

    def regrouped(self, key: str) -> Dataset:
        """The same curves with their constants shared by ``group`` or by a key of their conditions.

        Raises
        ------
        InputError : a curve has no such condition, or a held-out curve is left without a fit curve.
        """
        common = set.intersection(*(set(curve.conditions) for curve in self.curves)) | {"group"}
        if key not in common:
            lacking = next(curve.id for curve in self.curves if key not in curve.conditions)
            raise InputError(
                f'{self.path}: the constants cannot be grouped by "{key}": curve "{lacking}" has no such condition; '
                f"{nearest(key, common)}"
            )
        names = [curve.group if key == "group" else _name_of(curve.conditions[key]) for curve in self.curves]
        curves = tuple(replace(curve, constants=name) for curve, name in zip(self.curves, names, strict=True))
        _check_constants(curves, str(self.path))
        return replace(self, curves=curves)


def folder_name(path: Path | str) -> str:
    """Name of the folder that a dataset is in."""
    path = Path(path).resolve()
    return path.parent.name if path.name == FILE_NAME else path.name


def same_measurement(one: Curve, other: Curve) -> bool:
    """Whether two curves differ in ``digitisation`` only, so that they must stand on one side of a split.

    The programme's numbers may differ by 5 %, for they are digitised too; a group that was left out says nothing.
    """
    if one.conditions.get("digitisation") == other.conditions.get("digitisation"):
        return False
    if one.group != other.group and one.group != one.id and other.group != other.id:
        return False
    if (one.specimen, one.tool, one.constants) != (other.specimen, other.tool, other.constants):
        return False
    if any(one.conditions.get(key) != other.conditions.get(key) for key in _IDENTITY):
        return False
    for key in _PROGRAMME:
        a, b = one.conditions.get(key), other.conditions.get(key)
        if (a is None) != (b is None) or (a is not None and not math.isclose(a, b, rel_tol=_SAME_PROGRAMME)):
            return False
    return True


def read_dataset(path: Path | str) -> Dataset:
    """A dataset, checked, in SI.

    Parameters
    ----------
    path : the folder, or the dataset.toml in it.

    Raises
    ------
    InputError : a file cannot be read or cannot be right; one sentence that names the file, the line or key, and what to do.
    """
    path = Path(path)
    source = _Source(path / FILE_NAME if path.is_dir() else path)
    try:
        table = validated(DatasetFile, source.data)
    except ValidationError as error:
        raise source.misfit(error, source.data, DatasetFile) from None
    _check_tables(table, source)
    _check_files(table, source)
    curves = tuple(_curve(table, number, source) for number in range(len(table.curve)))
    _check_constants(curves, str(source.path))
    _check_sides(curves, str(source.path))
    return Dataset(
        name=table.name,
        title=table.title,
        test=table.test,
        source=table.source,
        license=table.license,
        notes=table.notes,
        path=source.path,
        curves=curves,
        scenario=None if table.scenario is None else source.path.parent / table.scenario,
        sensors={sensor.name: sensor.model_point for sensor in table.sensor},
        registration=table.registration,
    )


class _Source:
    """``dataset.toml``: its path, its parsed tables, and errors that know their line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines = _lines(path, f"give the dataset's folder, with a {FILE_NAME} and a CSV for each curve in it")
        try:
            self.data = tomllib.loads("\n".join(self.lines))
        except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
            raise InputError(f"{path}: this is not valid TOML: {error}.") from None

    def fault(self, keys: Sequence[str | int], sentence: str) -> InputError:
        """An error at a key, or at the table that should hold it."""
        line = self._line(keys)
        return InputError(f"{self.path}{'' if line is None else f', line {line}'}: {sentence}")

    def misfit(
        self,
        error: ValidationError,
        data: Any,
        table: type[BaseModel],
        place: Callable[[Sequence[str | int]], Sequence[str | int]] = tuple,
        prefix: str = "",
    ) -> InputError:
        """What does not fit the schema; ``place`` turns a key's path in the data into one in the file."""
        # The same one that the sentence is about: a misspelt key comes before the key that is missing for it.
        problem = min(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        return self.fault(place(problem["loc"]), prefix + explain(error, data, table))

    def _line(self, keys: Sequence[str | int]) -> int | None:
        """Line of a key; of its table's head if it is not there."""
        names = [key for key in keys if isinstance(key, str)] or [""]
        entry = next((key for key in keys[1:2] if isinstance(key, int)), 0)
        block: list[tuple[int, str]] = []
        section, seen = "", -1
        for number, line in enumerate(self.lines, 1):
            head = _HEADER.match(line)
            if head:
                section = head[2].split(".")[0].strip("\"' ")
                seen += head[1] == "[[" and head[2] == section == names[0]
            if section == names[0] and entry == max(seen, 0):
                block.append((number, line))
        if not block:  # a key at the top, or an inline table
            top = next((k for k, line in enumerate(self.lines) if _HEADER.match(line)), len(self.lines))
            block = list(enumerate(self.lines[:top], 1))
        elif len(names) > 1:
            names = names[1:]
        for name in reversed(names):
            pattern = re.compile(rf"""(?:^|[{{,.\[])\s*["']?{re.escape(name)}["']?\s*[=.\]]""")
            for number, line in block:
                if pattern.search(line):
                    return number
        return block[0][0] if block and _HEADER.match(block[0][1]) else None


def _lines(path: Path, advice: str) -> list[str]:
    """Lines of a text file of any system, without a byte-order mark."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: this cannot be read ({error.strerror}); {advice}.") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: this is not UTF-8 text; save the file as UTF-8.") from None
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _check_tables(table: DatasetFile, source: _Source) -> None:
    """Tables that the test needs or cannot have, and names that stand twice."""
    if table.test == "trajectory":
        owners: list[tuple[tuple[str | int, ...], BaseModel]] = [((), table)]
        owners += [(("curve", number), curve) for number, curve in enumerate(table.curve)]
        for keys, owner in owners:
            for name in ("specimen", "tool"):
                if getattr(owner, name):
                    raise source.fault((*keys, name), f"a trajectory has no [{name}]; take it out.")
        for name in ("sensor", "registration"):
            if table.scenario is None and getattr(table, name):
                raise source.fault((name,), f"[{name}] needs a scenario to compare with; add the key scenario.")
        if table.scenario is not None and not (source.path.parent / table.scenario).is_file():
            raise source.fault(("scenario",), f'the scenario "{table.scenario}" is missing; put it beside {source.path.name}.')
    else:
        for name in ("scenario", "sensor", "registration"):
            if getattr(table, name):
                raise source.fault((name,), f'{name} is for test = "trajectory" only; take it out.')
        if table.specimen is None and not all(curve.specimen for curve in table.curve):
            raise source.fault(("test",), '[specimen] is missing; add it, with shape = "point" for a state of no known size.')
        tooled = [table.tool is not None or bool(curve.tool) for curve in table.curve]
        if table.test == "indentation" and not all(tooled):
            raise source.fault(("test",), "an indentation needs a [tool]; add it.")
        if table.test == "shear" and any(tooled):
            raise source.fault(("tool",), "a shear test is a homogeneous state and has no [tool]; take it out.")
        if any(tooled) and not all(tooled):
            raise source.fault(("curve", tooled.index(True), "tool"), "either all curves have a tool or none; add a [tool].")
    for array, key in (("sensor", "name"), ("curve", "id"), ("curve", "file")):
        names = [getattr(entry, key) for entry in getattr(table, array)]
        for number, name in enumerate(names):
            first = names.index(name)
            if first != number:
                sentence = f'two {array}s have the {key} "{name}", numbers {first + 1} and {number + 1}; give each its own.'
                raise source.fault((array, number, key), sentence)


def _check_files(table: DatasetFile, source: _Source) -> None:
    """Every curve has its CSV, and every CSV of the folder its curve."""
    folder = source.path.parent
    there = {entry.name for entry in folder.iterdir() if entry.is_file() and not entry.name.startswith(".")}
    unlisted = sorted(name for name in there - {curve.file for curve in table.curve} if name.lower().endswith(".csv"))
    for number, curve in enumerate(table.curve):
        if curve.file not in there:
            hint = nearest(curve.file, unlisted) if unlisted else f"put it beside {source.path.name}."
            raise source.fault(("curve", number, "file"), f'the file "{curve.file}" of curve "{curve.id}" is missing; {hint}')
    if unlisted:
        raise InputError(f"{folder / unlisted[0]}: no curve of {source.path.name} has this file; list it there or take it out.")


def _curve(table: DatasetFile, number: int, source: _Source) -> Curve:
    entry = table.curve[number]
    setup = _setup(table, number, source)
    kind: Kind = (
        "force-displacement" if setup.tool is not None else table.test if table.test in ("shear", "trajectory") else "uniaxial"
    )
    if setup.tool is not None and setup.specimen.shape == "point":
        raise source.fault(("specimen", "shape"), 'a specimen of shape "point" has no place for a [tool]; give it a size.')
    csv = _Csv(source.path.parent / entry.file, kind, [sensor.name for sensor in table.sensor])
    _check_units(csv, setup)
    _check_noise(csv, setup, table, number, source)
    si = {name: factor * csv.data[column] for column, (name, factor) in COLUMNS.get(kind, {}).items()}
    return Curve(
        id=entry.id,
        file=entry.file,
        kind=kind,
        constants=entry.constants,
        group=entry.id if entry.group is None else entry.group,
        split=entry.split,
        specimen=setup.specimen,
        tool=setup.tool,
        noise=setup.noise,
        conditions=entry.conditions,
        time_s=csv.data[TIME],
        columns=si,
        sensors={name: 1e-3 * position for name, position in csv.sensors().items()},
    )


def _merged(common: dict[str, Any] | None, own: dict[str, Any]) -> dict[str, Any] | None:
    if common is None:
        return own or None
    if "shape" in own and own["shape"] != common.get("shape"):
        common = {key: value for key, value in common.items() if key not in _SHAPED}
        if isinstance(common.get("assumed"), list):
            common["assumed"] = [key for key in common["assumed"] if key not in _SHAPED]
    return common | own


def _setup(table: DatasetFile, number: int, source: _Source) -> _Setup:
    entry = table.curve[number]
    merged = {name: _merged(getattr(table, name), getattr(entry, name)) for name in ("specimen", "tool", "noise")}
    try:
        return validated(_Setup, merged)
    except ValidationError as error:

        def own(keys: Sequence[str | int]) -> bool:
            table_of_curve = getattr(entry, str(keys[0]))
            return bool(table_of_curve) and (len(keys) == 1 or keys[1] in table_of_curve or not source.data.get(keys[0]))

        def place(keys: Sequence[str | int]) -> Sequence[str | int]:
            return ("curve", number, *keys) if own(keys) else keys

        touched = any(getattr(entry, str(problem["loc"][0])) for problem in error.errors())
        raise source.misfit(error, merged, _Setup, place, f'curve "{entry.id}": ' if touched else "") from None


class _Csv:
    """The columns of one file by name, as they stand there, with the lines they came from."""

    def __init__(self, path: Path, kind: Kind, sensors: Iterable[str]) -> None:
        self.path = path
        self.kind = kind
        lines = _lines(path, "make it readable")
        self.line_of = [number for number, line in enumerate(lines, 1) if line.strip()]
        filled = [lines[number - 1] for number in self.line_of]
        if not filled:
            raise InputError(f"{path}: the file is empty; write a header and {SMALLEST_CURVE} rows at least.")
        names = self._names(filled[0], sensors)
        del self.line_of[0]
        rows = self._numbers(filled[1:], names)
        self.data = {name: np.ascontiguousarray(rows[:, k]) for k, name in enumerate(names)}
        self._check_time()

    def fault(self, row: int, sentence: str) -> InputError:
        """An error in a row, by its line."""
        return InputError(f"{self.path}, line {self.line_of[row]}: {sentence}")

    def sensors(self) -> dict[str, np.ndarray]:
        """Name -> positions (k, 3) [mm], in the order of the file; empty unless a trajectory."""
        if self.kind != "trajectory":
            return {}
        names = dict.fromkeys(_SENSOR.fullmatch(column)[1] for column in self.data if column != TIME)
        return {name: np.column_stack([self.data[f"{name}_{axis}_mm"] for axis in "xyz"]) for name in names}

    def _names(self, header: str, sensors: Iterable[str]) -> list[str]:
        names = [name.strip().strip('"') for name in header.split(",")]
        where = f"{self.path}, line {self.line_of[0]}:"
        if len(names) == 1 and set(header) & set(";\t"):
            raise InputError(f"{where} the columns must be separated by commas, with a point in decimal numbers.")
        if self.kind == "trajectory":
            found = dict.fromkeys(match[1] for match in map(_SENSOR.fullmatch, names) if match)
            valid = [TIME, *(f"{sensor}_{axis}_mm" for sensor in dict.fromkeys([*found, *sensors]) for axis in "xyz")]
            should = f"a trajectory has {TIME} and, for each sensor, <sensor>_x_mm, <sensor>_y_mm and <sensor>_z_mm"
        else:
            valid = [TIME, *COLUMNS[self.kind]]
            what = {"force-displacement": "with a [tool]", "uniaxial": "without a [tool]", "shear": "of a shear test"}[self.kind]
            should = f"a curve {what} has {','.join(valid)}"
        for name in names:
            if name not in valid:
                raise InputError(f'{where} unknown column "{name}" ({should}); {nearest(name, valid)}')
            if names.count(name) > 1:
                raise InputError(f'{where} the column "{name}" stands twice; take one of them out.')
        for name in valid:
            if name not in names:
                raise InputError(f'{where} the column "{name}" is missing ({should}); add it.')
        if len(valid) == 1:
            raise InputError(f"{where} there is no sensor ({should}); add its columns.")
        return names

    def _numbers(self, rows: list[str], names: list[str]) -> np.ndarray:
        """All cells (k, columns)."""
        if len(rows) < SMALLEST_CURVE:
            last = self.line_of[-1] if rows else 1
            count = f"{len(rows)} row{'' if len(rows) == 1 else 's'}"
            raise InputError(f"{self.path}, line {last}: the curve ends after {count}; it needs {SMALLEST_CURVE} at least.")
        try:
            numbers = np.loadtxt(rows, delimiter=",", comments=None, ndmin=2)
            if numbers.shape[1] == len(names) and np.isfinite(numbers).all():
                return numbers
            reason = "the cells are no finite numbers"
        except ValueError as error:
            reason = str(error)
        for row, line in enumerate(rows):
            cells = [cell.strip() for cell in line.split(",")]
            if len(cells) != len(names):
                raise self.fault(row, f"{len(cells)} cells, but {len(names)} columns; each row needs a number in each column.")
            for cell, name in zip(cells, names, strict=True):
                if not _CELL.fullmatch(cell) or not math.isfinite(float(cell)):
                    raise self.fault(row, f'{name} = "{cell}" is no finite number; correct it or leave the row out.')
        raise InputError(f"{self.path}: this cannot be read as a table of numbers: {reason}.")

    def _check_time(self) -> None:
        time = self.data[TIME]
        if time[0] != 0.0:
            raise self.fault(0, f"{TIME} starts at {time[0]:g}; it must start at 0.")
        late = np.flatnonzero(np.diff(time) <= 0.0)
        if len(late):
            before, now = time[late[0]], time[late[0] + 1]
            what = "stands twice" if now == before else f"runs backwards, from {before:.9g}"
            raise self.fault(late[0] + 1, f"{TIME} = {now:.9g} {what}; it must increase from row to row.")


def _check_units(csv: _Csv, setup: _Setup) -> None:
    """InputError where values cannot be right unless in another unit."""
    if csv.kind == "force-displacement":
        _check_tool_curve(csv, setup.specimen, setup.tool)
    elif csv.kind == "trajectory":
        low, high = _COORDINATE_MM
        coordinates = np.column_stack(list(csv.sensors().values()))
        largest = np.abs(coordinates).max(axis=1)
        row = int(largest.argmax())
        if not low <= largest[row] <= high:
            raise csv.fault(row, f"the largest coordinate is {largest[row]:.3g} mm, too {_extent(largest[row], low)}; give mm.")
    else:
        _check_homogeneous(csv)


def _check_homogeneous(csv: _Csv) -> None:
    first, second = COLUMNS[csv.kind]
    deformation, stress = csv.data[first], np.abs(csv.data[second])
    if csv.kind == "uniaxial":
        low, high = _STRETCH
        odd, advice = (deformation <= low) | (deformation >= high), "give length over length at rest, 1 at rest, no percent"
        strain = np.abs(deformation - 1.0)
    else:
        odd, advice = np.abs(deformation) > _SHEAR, "give the tangent of the angle, no percent"
        strain = np.abs(deformation)
    if odd.any():
        row = int(odd.argmax())
        raise csv.fault(row, f"{first} = {deformation[row]:g} is not possible; {advice}.")
    row, low, high = int(stress.argmax()), *_STRESS_PA
    if not low <= stress[row] <= high:
        raise csv.fault(row, f"the largest {second} is {stress[row]:.3g} Pa, too {_extent(stress[row], low)}; give Pa.")
    _check_stiffness(csv, second, row, stress[row], strain.max(), "give Pa")


def _check_tool_curve(csv: _Csv, specimen: SpecimenTable, tool: ToolTable) -> None:
    displacement, force = csv.data["displacement_mm"], np.abs(csv.data["force_N"])
    thickness, radius = specimen.thickness_mm, tool.radius_mm
    deepest, highest = int(displacement.argmax()), int(displacement.argmin())
    if displacement[deepest] >= thickness:
        sentence = f"displacement_mm = {displacement[deepest]:g} is deeper than the specimen is high, {thickness:g} mm"
        raise csv.fault(deepest, f"{sentence}; give both in mm.")
    if displacement[highest] < -_PULL * thickness:
        sentence = f"displacement_mm = {displacement[highest]:g} pulls a specimen of {thickness:g} mm"
        raise csv.fault(highest, f"{sentence} to over {_PULL:g} times its height; give both in mm.")
    farthest = int(np.abs(displacement).argmax())
    largest = abs(displacement[farthest])
    # A small indenter needs only a small dent, in a high specimen too.
    if largest < _STRAIN_IN_METRES * thickness and (radius is None or largest < _DENT_IN_METRES * radius):
        sentence = f"the largest displacement_mm is {largest:.3g}, next to nothing for a specimen of {thickness:g} mm"
        raise csv.fault(farthest, f"{sentence}; give it in mm.")
    if radius is None:
        area, strain = specimen.face_mm2, largest / thickness
    else:
        contact = min(radius, math.sqrt(2.0 * radius * largest)) if tool.shape == "sphere" else radius
        area, strain = math.pi * contact**2, largest / contact
    row, low, high = int(force.argmax()), *_PRESSURE_PA
    pressure = force[row] / (1e-6 * area)
    if not low <= pressure <= high:
        sentence = f"the largest force_N, {force[row]:.3g}, is {pressure:.3g} Pa on {area:.3g} mm2, too {_extent(pressure, low)}"
        raise csv.fault(row, f"{sentence}; give N, and lengths in mm.")
    _check_stiffness(csv, "force_N", row, pressure, strain, "give N, and lengths in mm")


def _check_stiffness(csv: _Csv, column: str, row: int, stress: float, strain: float, advice: str) -> None:
    low, high = _STIFFNESS_PA
    # Held at rest, no stiffness shows.
    if strain > 0.0 and not low <= stress / strain <= high:
        sentence = (
            f"the largest {column} means a stiffness of about {stress / strain:.2g} Pa, too {_extent(stress / strain, low)}"
        )
        raise csv.fault(row, f"{sentence} for anything soft; {advice}.")


def _extent(value: float, low: float) -> str:
    return "small" if value < low else "large"


def _check_noise(csv: _Csv, setup: _Setup, table: DatasetFile, number: int, source: _Source) -> None:
    possible = NOISE[csv.kind]
    curve = table.curve[number]
    for key in setup.noise.model_fields_set - {"repeat_sd_fraction"}:
        keys = ("curve", number, "noise", key) if key in curve.noise else ("noise", key)
        if key not in possible:
            valid = ", ".join([*possible, "repeat_sd_fraction"])
            raise source.fault(keys, f'[noise] {key} is not for curve "{curve.id}"; of such a curve it can be {valid}.')
        columns = [possible[key]] if possible[key] in csv.data else [name for name in csv.data if name != TIME]
        largest = max(np.abs(csv.data[column] - (column == "stretch")).max() for column in columns)
        sd = getattr(setup.noise, key)
        # A stretch held at 1 has no size to compare with.
        if sd > largest > 0.0:
            sentence = f"[noise] {key} = {sd:g} exceeds all that {possible[key]} of {curve.file} holds, {largest:.3g}"
            raise source.fault(keys, f"{sentence}; give the standard deviation of one row in the key's unit.")


def _check_constants(curves: Sequence[Curve], where: str) -> None:
    """InputError where a held-out curve has constants that nothing can be fitted to."""
    fitted = {curve.constants for curve in curves if curve.split != "holdout"}
    for curve in curves:
        if curve.constants not in fitted:
            raise InputError(
                f'{where}: curve "{curve.id}" is held out, and no fit curve shares its constants "{curve.constants}"; '
                f'give one of them split = "fit", or let the curves share their constants.'
            )


def _check_sides(curves: Sequence[Curve], where: str) -> None:
    """InputError where one measurement stands on both sides of the split."""
    for one, other in combinations(curves, 2):
        if {one.split, other.split} == {"fit", "holdout"} and same_measurement(one, other):
            raise InputError(
                f'{where}: curves "{one.id}" and "{other.id}" are digitisations of one measurement and stand on two sides of '
                f"the split; give both the same split."
            )


def _name_of(value: Any) -> str:
    """A condition as a name: true for True, "a, b" for an array."""
    if isinstance(value, bool):
        return str(value).lower()
    return ", ".join(map(_name_of, value)) if isinstance(value, list) else str(value)
