"""The scenario file: its schema, its reading, and sentences about what is wrong with it."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    ValidationError,
    create_model,
    model_validator,
)

from explicitfe.effects import EFFECTS, Effect
from explicitfe.errors import InputError, nearest
from explicitfe.materials import LAWS

FieldName = Literal["displacement", "velocity", "J", "hourglass_energy"]
FIELDS: tuple[str, ...] = get_args(FieldName)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_AnyTable = TypeVar("_AnyTable", bound=BaseModel)


def validated(table: type[_AnyTable], data: dict[str, Any]) -> _AnyTable:
    """Parsed TOML as a table of the schema, strictly: "2" is no number. Strict JSON lets arrays be tuples, 2 be 2.0.

    Raises
    ------
    ValidationError : see :func:`explain`.
    """
    return table.model_validate_json(json.dumps(data, default=str), strict=True)


def _row(length: int, what: str) -> Callable[[Any], Any]:
    def check(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or len(value) != length:
            raise ValueError(f"must be {what}")
        return tuple(value)

    return check


Vector = Annotated[tuple[float, float, float], BeforeValidator(_row(3, "three numbers [x, y, z]"))]
Cells = Annotated[tuple[int, int, int], BeforeValidator(_row(3, "three whole numbers, such as [16, 8, 10]"))]
Pair = Annotated[tuple[float, float], BeforeValidator(_row(2, "a pair [time_ms, scale]"))]


def _material_kind(value: Any) -> str:
    if isinstance(value, str):
        return "name"
    return value.get("law", "yeoh") if isinstance(value, dict) else getattr(value, "law", "yeoh")


# A name, or the constants of any law of the table: a new law is possible in scenarios without a word here.
_kinds = [Annotated[str, Tag("name")], *(Annotated[law, Tag(name)] for name, (law, _) in LAWS.items())]
Material = Annotated[Union[tuple(_kinds)], Discriminator(_material_kind)]  # noqa: UP007


class Damping(_Table):
    """Mass-proportional damping, and damping in proportion to the stiffness of the tissue's shear."""

    alpha_per_s: float = Field(default=0.0, ge=0.0, description="Rayleigh alpha [1/s]; 40 is usual for tongue models")
    beta_s: float = Field(
        default=0.0, ge=0.0, description="Rayleigh beta [s], by a Maxwell branch; 0.03 is usual for tongue models"
    )
    tau_ms: float = Field(default=5.0, gt=0.0, description="relaxation time of that branch [ms]: it damps below 1 / (2 pi tau)")


class ModelTable(_Table):
    """What is computed: a built-in model by name, or a mesh of one's own by its model file."""

    name: str | None = Field(default=None, description="a built-in model, see 'explicitfe list models'")
    file: str | None = Field(default=None, description="model file of a mesh of one's own, relative to this file")
    resolution: str | None = Field(default=None, description="coarse | medium | fine; medium if left out")
    cells: Cells | None = Field(
        default=None, description="numbers of elements along the tongue, through its thickness and across it"
    )
    material: Material = Field(default="gerard-2005", description="a name, see 'explicitfe list materials', or constants")
    element: Literal["hex8", "hex8-stiffness", "hex8-full"] = Field(
        default="hex8",
        description="one point with assumed-strain hourglass control, one point with plain stiffness, or eight points",
    )
    damping: Damping = Damping()
    fixed: list[str] | None = Field(default=None, description="node sets that are held; the model's own if left out")
    gravity_m_s2: Vector = Field(default=(0.0, 0.0, 0.0), description="acceleration of gravity")

    @model_validator(mode="after")
    def _one_source(self) -> ModelTable:
        if (self.name is None) == (self.file is None):
            raise ValueError("give either name (a built-in model) or file (a model file), and not both")
        if self.resolution is not None and self.cells is not None:
            raise ValueError("give either resolution or cells, not both")
        if self.file is not None and (self.resolution is not None or self.cells is not None):
            raise ValueError("resolution and cells are for built-in models: a model file brings its own mesh")
        return self


class MuscleTable(_Table):
    """One muscle's pull."""

    name: str = Field(description="see 'explicitfe list muscles'")
    force_N: float = Field(ge=0.0, description="force summed over all fibres of the sides named [N]")
    profile: Literal["step", "ramp", "table"] = "step"
    start_ms: float = Field(default=0.0, ge=0.0)
    rise_ms: float = Field(default=0.0, ge=0.0, description="time in which a ramp rises [ms]")
    end_ms: float | None = Field(default=None, description="time at which the pull ends [ms]; never if left out")
    table: list[Pair] = Field(default=[], description="[time_ms, scale] pairs, linear in between")
    distribution: Literal["ends", "along", "volume"] = "ends"
    direction: Literal["reference", "following"] = "reference"
    side: Literal["both", "left", "right"] = "both"

    @model_validator(mode="after")
    def _profile_is_whole(self) -> MuscleTable:
        if self.end_ms is not None and self.end_ms <= self.start_ms + self.rise_ms:
            raise ValueError("end_ms must come after start_ms + rise_ms")
        if (self.profile == "ramp") != (self.rise_ms > 0.0):
            raise ValueError('profile = "ramp" and rise_ms above 0 go together')
        if (self.profile == "table") != bool(self.table):
            raise ValueError('profile = "table" and a table of [time_ms, scale] pairs go together')
        if self.profile == "table" and (self.start_ms > 0.0 or self.end_ms is not None):
            raise ValueError('start_ms and end_ms do not go with profile = "table": put the times into the table')
        times = [time for time, _ in self.table]
        if times != sorted(times) or any(time < 0.0 for time in times):
            raise ValueError("the times of table must not be negative and must not decrease")
        if any(scale < 0.0 for _, scale in self.table):
            raise ValueError("the scales of table must not be negative: a muscle pulls, it does not push")
        return self


Threads = Annotated[
    int | None, Field(ge=1, le=256, description="that share a step; as many as pay for a mesh of this size if left out")
]


class AnalysisTable(_Table):
    """How it is computed."""

    type: Literal["transient"] = "transient"
    duration_ms: float = Field(gt=0.0, description="simulated time [ms]")
    step_us: float | None = Field(
        default=None, gt=0.0, description="fixed time step [microseconds]; the largest stable one if left out"
    )
    threads: Threads = None


class RecordTable(_Table):
    """What is stored."""

    every_ms: float = Field(default=1.0, gt=0.0)
    fields: list[FieldName] = list(FIELDS)
    probes: list[str] | None = Field(default=None, description="named points; all of the model if left out")


class _Effects(_Table):
    """What the elastic model lacks, each by its name."""

    @property
    def chosen(self) -> tuple[Effect, ...]:
        """The effects that are there, in the order of the table."""
        there = (getattr(self, name) for name in type(self).model_fields)
        return tuple(effect for effect in there if effect is not None)

    def without(self, effects: Sequence[Effect]) -> _Effects:
        """The others."""
        names = [name for name in type(self).model_fields if any(getattr(self, name) is effect for effect in effects)]
        return self.model_copy(update=dict.fromkeys(names))


# One key an effect: a new effect is possible in scenarios without a word here. Names have dashes, attributes cannot.
EffectsTable = create_model(
    "EffectsTable",
    __base__=_Effects,
    **{
        name.replace("-", "_"): (kind | None, Field(default=None, alias=name, description=kind.about.title))
        for name, kind in EFFECTS.items()
    },
)


class Scenario(_Table):
    """One run, as its file states it."""

    title: str
    question: str = ""
    expect: str = Field(default="", description="what the run should show, with the number to expect")
    model: ModelTable
    muscle: list[MuscleTable] = []
    effects: EffectsTable = EffectsTable()
    analysis: AnalysisTable
    record: RecordTable = RecordTable()


Size = Annotated[tuple[float, float, float], BeforeValidator(_row(3, "three lengths [x, y, z] in mm"))]


class SpecimenTable(_Table):
    """A cylinder or a block of tissue, base at z = 0, under a tool that comes down the z axis."""

    name: Literal["specimen"] = "specimen"
    symmetry: Literal["sector", "quarter", "half", "whole"] = Field(
        default="sector", description="the part that is computed; a sector stands for a body of revolution"
    )
    radius_mm: float | None = Field(default=None, gt=0.0, description="of a cylinder")
    height_mm: float | None = Field(default=None, gt=0.0, description="of a cylinder")
    size_mm: Size | None = Field(default=None, description="of a block, instead of radius and height: [x, y, z]")
    layer_mm: float = Field(default=0.0, ge=0.0, description="thickness of a surface layer, such as the mucosa")
    layer_stiffness_ratio: float = Field(default=1.0, gt=0.0, description="its moduli relative to the tissue below")
    base: Literal["bonded", "sliding"] = "bonded"
    bonded_radius_mm: float | None = Field(
        default=None, gt=0.0, description="a bonded base is so only within this distance of the axis, and slides beyond"
    )
    material: Material = Field(default="gerard-2005", description="a name, see 'explicitfe list materials', or constants")
    element: Literal["hex8", "hex8-stiffness", "hex8-full"] = "hex8"
    gravity_m_s2: Vector = Field(default=(0.0, 0.0, 0.0), description="acceleration of gravity; it acts before the tool touches")
    edge_size_mm: float | None = Field(
        default=None, gt=0.0, description="size of the elements at the tool's edge; from the tool if left out"
    )
    refinement: float = Field(default=1.0, gt=0.0, description="divides all element sizes")

    @model_validator(mode="after")
    def _one_shape(self) -> SpecimenTable:
        round_ = self.radius_mm is not None and self.height_mm is not None
        if (self.radius_mm is not None or self.height_mm is not None) and self.size_mm is not None:
            raise ValueError("give radius_mm and height_mm (a cylinder) or size_mm (a block), not both")
        if not round_ and self.size_mm is None:
            raise ValueError("give radius_mm and height_mm (a cylinder) or size_mm (a block)")
        if self.size_mm is not None and min(self.size_mm) <= 0.0:
            raise ValueError("the lengths of size_mm must be above 0")
        if self.size_mm is not None and self.symmetry == "sector":
            raise ValueError('a sector is for a cylinder; for a block take symmetry = "quarter", "half" or "whole"')
        if self.layer_mm >= self.thickness_mm:
            raise ValueError("layer_mm must be less than the height of the specimen")
        if self.bonded_radius_mm is not None and self.base != "bonded":
            raise ValueError('bonded_radius_mm goes with base = "bonded"')
        sideways = [k for k, free in (("x", ("half", "whole")), ("y", ("whole",))) if self.symmetry not in free]
        if any(self.gravity_m_s2["xyz".index(k)] for k in sideways):
            raise ValueError(f"gravity_m_s2 must not act along {' or '.join(sideways)}: symmetry = {self.symmetry!r} excludes it")
        return self

    @property
    def thickness_mm(self) -> float:
        """Along z."""
        if self.size_mm is not None:
            return self.size_mm[2]
        assert self.height_mm is not None
        return self.height_mm


def _coefficient(value: Any) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if value != "stick" and not (number and 0.0 <= value <= 1.0):
        raise ValueError('must be a coefficient from 0 to 1, or "stick"')
    return value


Friction = Annotated[float | Literal["stick"], BeforeValidator(_coefficient)]


class ToolTable(_Table):
    """A rigid tool that comes down the z axis."""

    shape: Literal["flat-cylinder", "sphere", "platen", "bonded-disc"]
    radius_mm: float | None = Field(default=None, gt=0.0, description="of all but a platen, which is wider than the specimen")
    edge_radius_mm: float | None = Field(default=None, gt=0.0, description="of a flat cylinder; 1 if left out")
    friction: Friction = Field(default=0.0, description='a coefficient from 0 to 1, or "stick"')

    @model_validator(mode="after")
    def _whole(self) -> ToolTable:
        if (self.shape == "platen") != (self.radius_mm is None):
            raise ValueError("radius_mm goes with every shape but a platen")
        if self.edge_radius_mm is not None and self.shape != "flat-cylinder":
            raise ValueError('edge_radius_mm goes with shape = "flat-cylinder"')
        if self.shape == "flat-cylinder" and self.rounding_mm > (self.radius_mm or 0.0):
            raise ValueError("edge_radius_mm must not be above radius_mm")
        if self.shape == "bonded-disc" and self.friction != 0.0:
            raise ValueError("a bonded disc is tied, it knows no friction")
        return self

    @property
    def rounding_mm(self) -> float:
        """Radius of the edge of a flat cylinder."""
        return 1.0 if self.edge_radius_mm is None else self.edge_radius_mm


class RelaxationTable(_Table):
    """One equilibrium after the other, by dynamic relaxation."""

    type: Literal["relaxation"]
    forces_N: list[Annotated[float, Field(ge=0.0)]] | None = Field(
        default=None, description="of the whole tool, one after the other"
    )
    displacements_mm: list[float] | None = Field(
        default=None, description="of the tool into the tissue, instead of forces; negative: away from it"
    )
    times_s: list[float] | None = Field(default=None, description="when; 1 s a load if left out")
    tolerance: float = Field(default=1e-4, ge=1e-9, le=1e-2, description="relative force residual")
    threads: Threads = None

    @model_validator(mode="after")
    def _one_course(self) -> RelaxationTable:
        if (self.forces_N is None) == (self.displacements_mm is None):
            raise ValueError("give either forces_N or displacements_mm, and not both")
        if not self.course:
            raise ValueError("at least one load is needed")
        if self.times_s is not None and len(self.times_s) != len(self.course):
            raise ValueError(f"times_s has {len(self.times_s)} entries and the loads are {len(self.course)}")
        if self.times_s is not None and any(b <= a for a, b in zip([0.0, *self.times_s], self.times_s, strict=False)):
            raise ValueError("times_s must rise from above 0")
        return self

    @property
    def course(self) -> list[float]:
        """The loads, N or mm."""
        return (self.displacements_mm if self.forces_N is None else self.forces_N) or []


class SpecimenRecordTable(_Table):
    """What is stored."""

    fields: list[Literal["displacement", "J", "strain_energy_density", "hourglass_energy"]] = [
        "displacement",
        "J",
        "strain_energy_density",
        "hourglass_energy",
    ]


class Indentation(_Table):
    """One indentation, as its file states it."""

    title: str
    question: str = ""
    expect: str = Field(default="", description="what the run should show, with the number to expect")
    model: SpecimenTable
    tool: ToolTable
    effects: EffectsTable = EffectsTable()
    analysis: RelaxationTable
    record: SpecimenRecordTable = SpecimenRecordTable()


def kind_of(data: Any) -> type[Scenario] | type[Indentation]:
    """The schema that parsed TOML is meant for: by its model or its type of analysis."""
    model, analysis = (data.get(key) if isinstance(data, dict) else None for key in ("model", "analysis"))
    specimen = isinstance(model, dict) and model.get("name") == "specimen"
    relaxation = isinstance(analysis, dict) and analysis.get("type") == "relaxation"
    return Indentation if specimen or relaxation else Scenario


def read_scenario(path: Path | str, settings: Sequence[str] = ()) -> tuple[Scenario | Indentation, str]:
    """A scenario file, checked, and its text with the settings noted at its head.

    Parameters
    ----------
    path : the file; one that ends in .json holds the same tables as JSON, as a result does.
    settings : ``key=value`` pairs that replace what the file says; a muscle is reached by its name
        (``muscle.GGp.force_N=1.5``).

    Raises
    ------
    InputError : the file cannot be read, is not TOML, or does not fit the schema; one sentence.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"{path}: the scenario cannot be read ({error.strerror}); 'explicitfe list scenarios' names those at hand."
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: this is not a text file; a scenario is written in TOML.") from None
    try:
        data = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        kind = "JSON" if path.suffix == ".json" else "TOML"
        raise InputError(f"{path}: this is not valid {kind}: {error}.") from None
    for setting in settings:
        _apply(data, setting)
    try:
        scenario = validated(kind_of(data), data)
    except ValidationError as error:
        raise InputError(f"{path}: {_explain(error, data, kind_of(data))}") from None
    header = "".join(f"# --set {setting}\n" for setting in settings)
    return scenario, header + text


def json_schema() -> dict[str, Any]:
    """The JSON schema of a scenario, for editors."""
    both = TypeAdapter(Scenario | Indentation).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **both}


def explain(error: ValidationError, data: Any, table: type[BaseModel]) -> str:
    """The first thing that is wrong, as one sentence with the key and what to do."""
    return _explain(error, data, table)


def _explain(error: ValidationError, data: Any, table: type[BaseModel]) -> str:
    # A misspelt key comes before the key that is missing for it.
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    problem = problems[0]
    keys = [key for key in problem["loc"] if key not in {"name", *LAWS} or key == problem["loc"][-1]]
    where = _where(keys, data)
    if problem["type"] == "extra_forbidden":
        sentence = f'unknown key "{keys[-1]}"{_inside(where[:-1])}; {nearest(str(keys[-1]), _valid_keys(table, keys[:-1]))}'
    elif problem["type"] == "missing":
        sentence = f'the key "{keys[-1]}" is missing{_inside(where[:-1])}; add it'
    elif problem["type"] == "union_tag_invalid":
        sentence = f"unknown law{_inside(where)}; {nearest(str(problem['ctx']['tag']), LAWS)}"
    elif problem["type"] == "literal_error":
        sentence = f"{'.'.join(where)} = {problem['input']!r} is not possible; it must be {problem['ctx']['expected']}"
    elif problem["type"] == "value_error":
        sentence = f"{'.'.join(where) or 'the scenario'}: {problem['ctx']['error']}"
    else:
        message = problem["msg"][0].lower() + problem["msg"][1:]
        sentence = f"{'.'.join(where) or 'the whole'} = {problem['input']!r} is not possible: {message}"
    more = f" ({len(problems) - 1} more after this one)" if len(problems) > 1 else ""
    return f"{sentence.rstrip('.')}{more}" + ("" if sentence.endswith("?") and not more else ".")


def _where(keys: Iterable[Any], data: Any) -> list[str]:
    """The path of a key as a user would say it: entries of an array by their name."""
    path: list[str] = []
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            data = None
        if isinstance(data, dict) and isinstance(key, int) and path:
            # A table of an array: by its name, or else by its number, from 1 as a person counts.
            name = data.get("name")
            path[-1:] = [path[-1], name] if isinstance(name, str) else [f"{path[-1]} {key + 1}"]
        else:
            path.append(str(key))
    return path


def _inside(path: list[str]) -> str:
    return f" in [{'.'.join(path)}]" if path else ""


def _valid_keys(table: type[BaseModel], keys: Sequence[Any]) -> list[str]:
    """Keys that the table at this place knows."""
    current: Any = table
    for key in keys:
        if isinstance(key, int) or not isinstance(current, type):
            continue
        named = {field.alias or name: field for name, field in current.model_fields.items()}
        inner = named[key].annotation if key in named else None
        current = next((t for t in _tables(inner)), None)
    return [field.alias or name for name, field in current.model_fields.items()] if isinstance(current, type) else []


def _tables(annotation: Any) -> Iterable[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _tables(inner)


# What is set replaces its alternatives, keys of the same table.
_REPLACES = {
    "model.cells": ("resolution",),
    "model.resolution": ("cells",),
    "model.name": ("file",),
    "model.file": ("name", "resolution", "cells"),
    "model.size_mm": ("radius_mm", "height_mm"),
    "model.radius_mm": ("size_mm",),
    "model.height_mm": ("size_mm",),
    "analysis.forces_N": ("displacements_mm", "times_s"),
    "analysis.displacements_mm": ("forces_N", "times_s"),
}


def _apply(data: dict[str, Any], setting: str) -> None:
    """Set one ``key=value`` in the parsed scenario."""
    path, equals, text = setting.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise InputError(f"--set {setting}: write key=value, for example --set muscle.GGp.force_N=1.5.")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()  # a bare word is a string
    if isinstance(data.get(keys[0]), dict):
        for other in _REPLACES.get(".".join(keys), ()):
            data[keys[0]].pop(other, None)
    at: Any = data
    for depth, key in enumerate(keys):
        place = ".".join(keys[:depth]) or "the scenario"
        if isinstance(at, list):
            names = [entry.get("name", "") for entry in at if isinstance(entry, dict)]
            found = [k for k, name in enumerate(names) if name == key] or ([int(key)] if key.isdigit() else [])
            if len(found) > 1:
                numbers = ", ".join(f"{place}.{k}" for k in found)
                raise InputError(f'--set {setting}: "{key}" stands {len(found)} times in {place}; say which: {numbers}.')
            if not found or found[0] >= len(at):
                raise InputError(f'--set {setting}: {place} has no entry "{key}"; {nearest(key, names)}')
            key = found[0]
        elif not isinstance(at, dict):
            raise InputError(f"--set {setting}: {place} is a value, it has no key {key!r}.")
        if depth == len(keys) - 1:
            at[key] = value
        else:
            at = at[key] if isinstance(at, list) else at.setdefault(key, {})
