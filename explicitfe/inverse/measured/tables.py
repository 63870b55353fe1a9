"""The schema of ``dataset.toml``: specimen, tool, noise and curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, Literal, TypeGuard

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from explicitfe.fem.inputs.table import LONGEST_NAME_CHARACTERS, MOST_TABLES_OF_A_KIND, Name, Table, Title, Vector, row_of
from explicitfe.platform.errors import nearest, shortened

SpecimenTest = Literal["indentation", "compression", "tension", "equibiaxial", "planar", "shear"]
TestKind = Literal[SpecimenTest, "trajectory"]
Split = Literal["fit", "holdout"]
ConditionValue = str | int | float | bool | list[str | int | float | bool]
Conditions = Mapping[str, ConditionValue]
RawTable = dict[str, Any]  # A table of the file that is checked only when it is merged with that of the dataset.

# Two groups of conditions identify a measurement: the loading protocol, which is digitised and therefore equal within a few
# percent only, and what was measured.
PROGRAMME_CONDITIONS = ("rate_per_s", "rate_mm_per_s", "max_strain", "max_stretch", "max_displacement_mm", "hold_s")
IDENTITY_CONDITIONS = (
    "direction", "material", "sample", "spot", "piece", "day", "repeat", "cycle", "order", "phases", "site",
)  # fmt: skip
NUMERIC_CONDITIONS = (*PROGRAMME_CONDITIONS, "preload_N", "first_force_N")

# Whole numbers have no limit in TOML: a larger one is no float.
LARGEST_FLOAT = float(np.finfo(float).max)


# These keys belong to a shape: a curve that overrides the shape needs its own.
SHAPE_KEYS = {"radius_mm", "height_mm", "size_mm", "edge_radius_mm"}

# A value outside these limits was given in another unit. They are wide: a test that is merely unusual must pass.
_LENGTH_MM = (0.1, 1000.0)
_THIN_MM = (0.01, 1000.0)  # Layers and rounded edges are thinner than specimens.
_DENSITY_KG_M3 = (100.0, 20_000.0)
_STIFFNESS_RATIO = (1e-3, 1e3)


def _within(limits: tuple[float, float], unit: str, zero: bool = False) -> AfterValidator:
    low, high = limits

    def check(value: float) -> float:
        if not (low <= value <= high or (zero and value == 0.0)):
            raise ValueError(f"{value:g} does not lie between {low:g} and {high:g}; give it in {unit}")
        return value

    return AfterValidator(check)


Length = Annotated[float, _within(_LENGTH_MM, "mm")]
Thickness = Annotated[float, _within(_THIN_MM, "mm", zero=True)]


def _friction(value: object) -> object:
    if _is_number(value) and value >= 0.0:
        return float(value)
    if value not in ("stick", "unknown"):
        raise ValueError(f'{value!r} is not possible; it must be a number from 0 up, "stick" or "unknown"')
    return value


class _Described(Table):
    """A table that may list those of its keys that were inferred because the source does not state them."""

    assumed: tuple[str, ...] = Field(default=(), description="keys of this table whose values the source does not state")

    @model_validator(mode="after")
    def _assumed_is_given(self) -> _Described:
        given = self.model_fields_set - {"assumed"}
        for key in self.assumed:
            if key not in given:
                raise ValueError(f'assumed names "{shortened(key)}", which is not in this table; {nearest(key, given)}')
        return self

    def _only(self, shape: str, needed: Iterable[str], possible: Iterable[str]) -> None:
        """Raise ValueError where a key of the shape is missing, or a key is given that the shape does not have."""
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f'shape = "{shape}" needs {key}; add it')
        for key in sorted(self.model_fields_set & set(possible) - set(needed)):
            raise ValueError(f'shape = "{shape}" has no {key}; remove it')


class MeasuredSpecimen(_Described):
    """The specimen. The third dimension of a block is its thickness, along the load."""

    shape: Literal["point", "cylinder", "block"] = Field(description="point: a homogeneous state of no known size")
    radius_mm: Length | None = Field(default=None, description="of a cylinder: half its diameter")
    height_mm: Length | None = Field(default=None, description="of a cylinder, along the load")
    size_mm: Annotated[tuple[Length, Length, Length], row_of(3, "three numbers [x, y, z]")] | None = Field(
        default=None, description="of a block: [x, y, z], z along the load"
    )
    density_kg_m3: Annotated[float, _within(_DENSITY_KG_M3, "kg/m3")] = 1040.0
    base: Literal["bonded", "frictionless", "unknown"] = Field(
        default="unknown", description="support of the lower face: glued, sliding or unknown"
    )
    layer_mm: Thickness = Field(default=0.0, description="thickness of a surface layer; 0 is none")
    layer_stiffness_ratio: Annotated[float, _within(_STIFFNESS_RATIO, "layer over body")] = Field(
        default=1.0, description="ratio of the moduli of the layer to those of the body"
    )

    @model_validator(mode="after")
    def _whole(self) -> MeasuredSpecimen:
        needed: list[str] = {"point": [], "cylinder": ["radius_mm", "height_mm"], "block": ["size_mm"]}[self.shape]
        self._only(self.shape, needed, ["radius_mm", "height_mm", "size_mm"])
        if self.layer_mm > 0.0 and self.shape == "point":
            raise ValueError('shape = "point" has no layer; remove layer_mm')
        if self.layer_mm > 0.0 and self.layer_mm >= self.thickness_mm:
            raise ValueError(f"layer_mm = {self.layer_mm:g} is not below the height of the specimen, {self.thickness_mm:g} mm")
        if "layer_stiffness_ratio" in self.model_fields_set and self.layer_mm == 0.0:
            raise ValueError("layer_stiffness_ratio needs the thickness layer_mm; add it")
        return self

    @property
    def thickness_mm(self) -> float:
        """Height along the load [mm]; a point has none."""
        height_mm = self.height_mm if self.size_mm is None else self.size_mm[2]
        assert height_mm is not None
        return height_mm

    @property
    def face_mm2(self) -> float:
        """Area of the loaded face [mm2]; a point has none."""
        if self.size_mm is not None:
            return self.size_mm[0] * self.size_mm[1]
        assert self.radius_mm is not None
        return math.pi * self.radius_mm**2


class MeasuredTool(_Described):
    """The tool, and the column that was imposed."""

    shape: Literal["flat-cylinder", "sphere", "platen", "bonded-disc"] = Field(
        description="platen: a plate wider than the specimen; bonded-disc: a disc glued to the specimen"
    )
    radius_mm: Length | None = Field(default=None, description="half the diameter; not for a platen")
    edge_radius_mm: Thickness = Field(default=0.0, description="fillet radius of the edge of a flat cylinder")
    control: Literal["force", "displacement"] = Field(description="the imposed column; the other one is predicted")
    friction: Annotated[float | Literal["stick", "unknown"], BeforeValidator(_friction)] = Field(
        default="unknown", description='a coefficient, "stick", or "unknown"'
    )

    @model_validator(mode="after")
    def _whole(self) -> MeasuredTool:
        needed = [] if self.shape == "platen" else ["radius_mm"]
        rounded = [] if self.shape == "flat-cylinder" else ["edge_radius_mm"]
        self._only(self.shape, needed, ["radius_mm", *rounded])
        if self.radius_mm is not None and self.edge_radius_mm > self.radius_mm:
            raise ValueError(f"edge_radius_mm = {self.edge_radius_mm:g} exceeds radius_mm = {self.radius_mm:g}")
        return self


class MeasuredNoise(Table):
    """Standard deviations of one row; None means unknown, 0 means exact."""

    force_sd_N: float | None = Field(default=None, ge=0.0, description="of a force [N]")
    displacement_sd_mm: float | None = Field(default=None, ge=0.0, description="of a displacement, or of a coordinate [mm]")
    stress_sd_Pa: float | None = Field(default=None, ge=0.0, description="of a stress [Pa]")
    stretch_sd: float | None = Field(default=None, ge=0.0, description="of a stretch; in shear, of the shear strain")
    repeat_sd_fraction: float | None = Field(default=None, ge=0.0, le=1.0, description="relative scatter of repeated tests")


class SensorTable(Table):
    """A sensor of a trajectory, and where it sits on the model."""

    name: str = Field(min_length=1, description="as in the columns of the CSV: NAME_x_mm, NAME_y_mm, NAME_z_mm")
    model_point: str | None = Field(default=None, min_length=1, description="named point of the model of the scenario")
    at_mm: Vector | None = Field(
        default=None,
        description="position of the centre of a marker at rest, in the frame of the model [mm]; it stands off the nearest point "
        "of the body and turns with it",
    )
    fixed: bool = Field(default=False, description="whether it sits on what holds the body, and so does not move; needs at_mm")
    place_sd_mm: float = Field(default=1.0, ge=0.0, description="likely error of at_mm along each axis [mm]")

    @model_validator(mode="after")
    def _has_a_place(self) -> SensorTable:
        if (self.model_point is None) == (self.at_mm is None):
            raise ValueError("give either model_point, a named point of the model, or at_mm, the position of a marker at rest")
        if self.at_mm is None and (self.fixed or "place_sd_mm" in self.model_fields_set):
            raise ValueError("fixed and place_sd_mm go with at_mm")
        return self


def _fit_or(check: Callable[[object], object]) -> BeforeValidator:
    return BeforeValidator(lambda value: value if value == "fit" else check(value))


def _rotation(value: object) -> object:
    rows = value if isinstance(value, list) else []
    if [len(row) if isinstance(row, list) and all(map(_is_number, row)) else 0 for row in rows] == [3, 3, 3]:
        matrix = np.array(rows, dtype=float)
        if np.abs(matrix).max() < 2.0 and np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) and np.linalg.det(matrix) > 0.0:
            return tuple(tuple(map(float, row)) for row in rows)
    raise ValueError('must be "fit" or three rows of three numbers that make a rotation matrix')


def _translation(value: object) -> object:
    if not isinstance(value, list) or len(value) != 3 or not all(map(_is_number, value)):
        raise ValueError('must be "fit" or three numbers [x, y, z] in mm')
    return tuple(map(float, value))


def _scale(value: object) -> object:
    if not _is_number(value) or value <= 0.0:
        raise ValueError('must be "fit" or a number above 0')
    return value


class RegistrationTable(Table):
    """From the sensor frame to the model frame: x_model = scale * rotation x + translation; "fit" fits a part."""

    rotation: Annotated[tuple[Vector, Vector, Vector] | Literal["fit"], _fit_or(_rotation)] = (
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
    )
    translation: Annotated[Vector | Literal["fit"], _fit_or(_translation)] = Field(default=(0.0, 0.0, 0.0), description="mm")
    scale: Annotated[float | Literal["fit"], _fit_or(_scale)] = 1.0


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_FLOAT


class CurveTable(Table):
    """One curve; its tables override single keys of those of the dataset."""

    id: Name = Field(description="unique name of the curve")
    file: Name = Field(description="its CSV, in the folder of the dataset")
    constants: Name = Field(default="all", description="curves with the same name share their material constants")
    group: Name | None = Field(default=None, description="curves of one specimen or site have the same group; default: the id")
    test: SpecimenTest | None = Field(
        default=None,
        description="where it differs from the dataset's: the curve then has its own [specimen], a point if omitted, and [tool]",
    )
    start_s: float | Literal["fit"] = Field(
        default=0.0,
        description='time in the file at which the motion of the scenario begins; "fit": seen in the rows, and fitted within two '
        "sampling intervals",
    )
    until_s: float | None = Field(default=None, gt=0.0, description="time in the file after which rows are not used")
    contact: Literal["fit"] | None = Field(
        default=None,
        description='"fit": the displacement of first contact is fitted with the constants; default: the tool touches at 0',
    )
    split: Split | None = Field(default=None, description="fit, or holdout: predicted, not fitted; default: chosen by a rule")
    specimen: RawTable = Field(default={}, description="keys that differ from those of [specimen]")
    tool: RawTable = Field(default={}, description="keys that differ from those of [tool]")
    noise: RawTable = Field(default={}, description="keys that differ from those of [noise]")
    conditions: RawTable = Field(
        default={},
        description="conditions of the test: "
        + ", ".join((*PROGRAMME_CONDITIONS, *IDENTITY_CONDITIONS, "preload_N", "digitisation", "defect"))
        + ", or any other key",
    )

    @field_validator("id", "file")
    @classmethod
    def _plain_name(cls, name: str) -> str:
        if not name.strip() or name.startswith(".") or set(name) & set("/\\") or not name.isprintable():
            raise ValueError(f'"{shortened(name)}" must be a plain name, without a folder')
        return name

    @field_validator("file")
    @classmethod
    def _is_csv(cls, name: str) -> str:
        if not name.lower().endswith(".csv"):
            raise ValueError(f'"{shortened(name)}" must end in .csv')
        return name

    @field_validator("conditions")
    @classmethod
    def _plain_values(cls, conditions: RawTable) -> RawTable:
        for key, value in conditions.items():
            for entry in value if isinstance(value, list) else [value]:
                if not isinstance(entry, str | bool) and not _is_number(entry):
                    raise ValueError(f"{shortened(key)} must be a string, a finite number, true or false, or an array of these")
            if key in NUMERIC_CONDITIONS and not _is_number(value):
                raise ValueError(f"{key} = {shortened(repr(value))} must be a number")
            if key == "defect" and not (isinstance(value, str) and value.strip()):
                raise ValueError("defect must describe in words what is wrong; omit the key if nothing is")
        return conditions


class RigLimits(Table):
    """Limits of the machine, used when further tests are proposed; defaults follow from the tests that were made on it."""

    largest_force_N: float | None = Field(default=None, gt=0.0, description="of the load cell [N]")
    largest_displacement_mm: float | None = Field(default=None, gt=0.0, description="of the tool into the tissue [mm]")
    largest_strain: float | None = Field(
        default=None, gt=0.0, description="of a test without a tool: |stretch - 1|, or the shear"
    )
    shortest_ramp_s: float | None = Field(default=None, gt=0.0, description="shortest time to the largest load [s]")
    longest_test_s: float | None = Field(default=None, gt=0.0, description="of one test [s]")
    tool_radii_mm: list[float] = Field(default=[], description="radii of other available tools [mm]")
    specimen_heights_mm: list[float] = Field(default=[], description="heights of other specimens that can be cut [mm]")
    handling_min: float = Field(default=5.0, ge=0.0, description="time to set up one test, in addition to its duration [min]")


class DatasetFile(Table):
    """The schema of ``dataset.toml``."""

    format: Literal["explicitfe-dataset/1"] = Field(description="format and version of the file")
    name: str = Field(pattern=r"^[a-z0-9]+([-.][a-z0-9]+)*$", max_length=LONGEST_NAME_CHARACTERS, description="kebab-case")
    title: Title
    test: TestKind = Field(description="kind of test; it determines the columns of the CSV files")
    source: str = Field(default="", description="who measured the data, and where they are published")
    license: str = Field(default="", description="license of the data")
    notes: str = Field(default="", description="remarks for readers")
    scenario: str | None = Field(default=None, min_length=1, description="scenario of a trajectory, relative to this file")
    sensor: list[SensorTable] = Field(default=[], max_length=MOST_TABLES_OF_A_KIND)
    registration: RegistrationTable | None = None
    fit: list[Name] = Field(
        default=[],
        description='constants that are always fitted, by the name of their effect, such as ["stiffness"]',
    )
    specimen: RawTable | None = Field(default=None, description="the specimen; required except for a trajectory")
    tool: RawTable | None = Field(default=None, description="the tool; without it the CSV has stretch and stress")
    noise: RawTable = Field(default={}, description="known standard deviations; others are estimated")
    rig: RigLimits | None = Field(default=None, description="limits of the machine, for proposed tests")
    curve: list[CurveTable] = Field(min_length=1, max_length=MOST_TABLES_OF_A_KIND)


class MergedTables(Table):
    """The tables of one curve, merged."""

    specimen: MeasuredSpecimen | None = None
    tool: MeasuredTool | None = None
    noise: MeasuredNoise = MeasuredNoise()
