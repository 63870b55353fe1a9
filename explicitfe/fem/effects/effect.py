"""What every effect has in common: parameters with units, what it is and where it acts, how strong it is.

An effect is one file. One of the material brings compiled leaves beside its parameters and names the slots that they fill;
``forces/response.py`` binds them into the element's forces. Its numbers stand in ``Blocks.effects`` from place AT on, what it
remembers in ``Blocks.old`` and ``new`` from place MEMORY on: placeholders that are bound where the kernel is made.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

from explicitfe.fem.effects.affected import LawT, ModelT, SpecimenT, ToolT
from explicitfe.fem.effects.record import Record
from explicitfe.fem.materials.kinematics import plus, times
from explicitfe.platform.compiled.jit import Template, leaf
from explicitfe.platform.compiled.simd import WIDTH, load, store

Conditions = Mapping[str, object]  # of a measured test, as its dataset states them


@dataclass(frozen=True)
class Description:
    """An effect in words, for reports and for whoever looks for what is missing in a model.

    Attributes
    ----------
    title, equation, source : what it is.
    where : material | specimen | contact | boundary | loading | measurement.
    strength : the coordinate in which its response grows about linearly, and its unit.
    plausible : largest plausible strength.
    needs : the data that can show it.
    neighbours : what it is mistaken for, and the test that tells them apart.
    """

    title: str
    equation: str
    source: str
    where: str
    strength: str
    plausible: float
    needs: str
    neighbours: str


@dataclass(frozen=True)
class Sought:
    """A parameter that is varied where the effect is looked for in measured data.

    Attributes
    ----------
    values : tried first: of a strength a small, a middle and the largest plausible one, of both signs where both are possible;
        of a shape, such as a time, its grid.
    low, high : physical bounds.
    scale : what values and bounds are multiples of, as the test gives it (``duration_s``, ``force_N``, ...); "" is 1.
    kind : coordinate in which it is sought, so that the response is about linear in it: the value itself, its logarithm, its
        square, or -log(1 - value) of a share.
    none : the value without an effect; a strength only.
    every : whether all values of a strength are tried, because the response is not proportional; else the middle ones.
    """

    values: tuple[float, ...]
    low: float
    high: float
    scale: str = ""
    kind: Literal["linear", "log", "square", "rest"] = "linear"
    none: float = 0.0
    every: bool = False

    def coordinate(self, value: float) -> float:
        """Where a value stands on the coordinate."""
        if self.kind == "log":
            return math.log(value)
        if self.kind == "square":
            return value**2
        return -math.log1p(-value) if self.kind == "rest" else value

    def value(self, coordinate: float) -> float:
        """The value at a place of the coordinate."""
        if self.kind == "log":
            return math.exp(coordinate)
        if self.kind == "square":
            return math.sqrt(max(coordinate, 0.0))
        return -math.expm1(-coordinate) if self.kind == "rest" else coordinate


@dataclass(frozen=True)
class Rig:
    """The machine between the tool and what is read, where a state is homogeneous and needs no tool of its own.

    Attributes
    ----------
    compliance_m_N : what the rig gives way by [m/N].
    preload_N : the force at which displacements begin to count [N].
    compliance_per_Pa : what the rig gives way by in a test of strain and stress, as a strain per nominal stress [1/Pa].
    """

    compliance_m_N: float = 0.0
    preload_N: float = 0.0
    compliance_per_Pa: float = 0.0


class Effect(BaseModel, ABC):
    """Parameters of one effect, as a scenario or a model file states them, and what the effect says of itself.

    Whoever computes a test asks these questions, and never which effect it is: a new effect then needs no line elsewhere.

    Attributes
    ----------
    about : the effect in words.
    sought : parameter -> how it is looked for; the first one is the strength.
    sought_without_tool : the same for a test of strain and stress, where that has parameters of its own.
    requires : what the data must have to show it: time | unloading | two directions | repeats | tool | strain (without a
        tool) | flat tool | edge | bonded base | force that pulls | muscles.
    terms : how often it can be added, each time with parameters of its own.
    extends : the effect that it changes, without which it means nothing; "" is none.
    variant_of : the effect that is the usual form of the same mechanism, which is named where data cannot tell the two apart.
    shares_of_remainder : parameters that are a share of what the terms before leave, where there are several terms.
    acts_on : what it changes: the material, the specimen (its shape, its layers, what holds it, its weight), the tool and the rig
        that drives it, the reading, or the muscles.
    searched : it is a candidate like the others. One that is composed from what they leave is not.
    pointwise : a homogeneous state stays homogeneous with it, so that one point of material answers and no mesh is needed.
    without_tool : a test without a tool, such as a uniaxial one, can have it.
    remembers : the material has a memory, so that a whole history must be computed.
    depends_on_path : what came before changes the answer: it has a memory, or a contact that slips or sticks.
    changes_volume : the tissue is compressible with it, so that it has no incompressible limit.
    in_revolution : a body of revolution stays one with it, and the section of it shows it.
    needs_half_body : at least a half of the body is computed with it, where a sector or a quarter does otherwise: a large mesh.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    about: ClassVar[Description]
    sought: ClassVar[Mapping[str, Sought]]
    sought_without_tool: ClassVar[Mapping[str, Sought]] = {}
    requires: ClassVar[tuple[str, ...]] = ()
    terms: ClassVar[int] = 1
    extends: ClassVar[str] = ""
    variant_of: ClassVar[str] = ""
    shares_of_remainder: ClassVar[tuple[str, ...]] = ()
    acts_on: ClassVar[Literal["material", "specimen", "tool", "reading", "muscle"]]
    searched: ClassVar[bool] = True
    pointwise: ClassVar[bool] = False
    without_tool: ClassVar[bool] = False
    remembers: ClassVar[bool] = False
    depends_on_path: ClassVar[bool] = False
    needs_half_body: ClassVar[bool] = False
    in_revolution: ClassVar[bool] = True
    changes_volume: ClassVar[bool] = False

    @model_validator(mode="after")
    def _some_key(self) -> Self:
        keys = [key for kind in (self.sought, self.sought_without_tool) for key in kind]
        if self.sought_without_tool and not self.model_fields_set:
            raise ValueError(f"give {' or '.join(dict.fromkeys(keys))}")
        return self

    @classmethod
    def from_terms(cls, terms: Sequence[Mapping[str, float]]) -> Self:
        """The effect from the values of what is sought, one mapping a term."""
        (values,) = terms
        return cls.model_validate(values)

    @classmethod
    def sought_in(cls, *, tool: bool) -> Mapping[str, Sought]:
        """How its parameters are looked for in tests with a tool, or without one."""
        return cls.sought if tool or not cls.sought_without_tool else cls.sought_without_tool

    def stands_in(self, *, tool: bool) -> bool:
        """Whether a key of it is given that tests with a tool have, or those without one."""
        if not self.sought_without_tool:
            return tool or self.without_tool
        return bool(self.model_fields_set & set(self.sought_in(tool=tool)))

    @classmethod
    def stated_in(cls, conditions: Conditions) -> Self | None:
        """The effect, where the conditions of a measured test state it themselves: a preload that was measured."""
        return None

    @property
    @abstractmethod
    def strength(self) -> float:
        """Along the coordinate that ``about`` names; 0 is no effect."""

    @property
    def transient(self) -> bool:
        """Whether time passes in it: something happens while nothing moves."""
        return False

    @property
    def breaks_symmetry(self) -> bool:
        """Whether a thin sector of a body of revolution does not show it, so that a quarter at least is computed."""
        return False

    def in_test(self, conditions: Conditions) -> Self:
        """The effect as it stands in a test under these conditions, such as with its fibres turned into the test's direction."""
        return self

    def in_law(self, law: LawT) -> LawT:
        """A law with the effect in its constants."""
        return law

    def on_rig(self, rig: Rig) -> Rig:
        """A rig with the effect in it, for tests that are computed without a tool's mesh."""
        return rig

    def in_materials(self, effects: Sequence[MaterialEffect]) -> tuple[MaterialEffect, ...]:
        """The effects that the kernels compute beside the law, with this one among them, or in one of them."""
        return tuple(effects)

    @property
    def base_compliance_m_Pa(self) -> float:
        """Sideways displacement of a bonded base per stress [m/Pa]."""
        return 0.0

    def stiffness_at(self, r_m: np.ndarray, depth_m: np.ndarray, height_m: float, spread_m: np.ndarray) -> np.ndarray:
        """Factor (n,) of the moduli at points of a specimen.

        Parameters
        ----------
        r_m, depth_m, height_m : distance from the tool's axis, depth below the surface, and height of the specimen.
        spread_m : (n,) length over which a jump is spread, about an element.
        """
        return np.ones(len(r_m))

    def prepare(self, specimen: SpecimenT, tool: ToolT) -> tuple[SpecimenT, ToolT]:
        """The tables of a specimen and its tool with the effect in them, before they are meshed."""
        return specimen, tool

    def apply(self, model: ModelT) -> ModelT:
        """The model with the effect in it."""
        return model


class Measurement(Effect):
    """An effect of the measurement: the model is what it is, and is read differently.

    It says what the specimen does where the machine reads something, and the other way round: of the motion and of the load, see
    :class:`explicitfe.fem.effects.record.Record`. Keys of ``sought_without_tool`` stand for tests without a tool.
    """

    acts_on = "reading"
    pointwise = True

    def true_motion(self, read: np.ndarray, record: Record) -> np.ndarray:
        """The motion of the specimen (k,) where the machine reads ``read``."""
        return read

    def read_motion(self, true: np.ndarray, record: Record) -> np.ndarray:
        """What the machine reads (k,) where the motion is ``true``: the inverse of ``true_motion``."""
        return true

    def true_load(self, read: np.ndarray, record: Record) -> np.ndarray:
        """The load on the specimen (k,) where the machine reads ``read``: the inverse of ``read_load``."""
        return read

    def read_load(self, true: np.ndarray, record: Record) -> np.ndarray:
        """What the machine reads (k,) where the load is ``true``."""
        return true


class MaterialEffect(Effect):
    """An effect of the material: it changes what an element answers to its deformation."""

    acts_on = "material"
    pointwise = True
    without_tool = True

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: object) -> None:
        """Refuse a class with ``memory`` that is not declared as history-dependent, because its history would be ignored."""
        remembers = cls.memory is not MaterialEffect.memory
        if cls.remembers != remembers or (remembers and not cls.depends_on_path):
            raise TypeError(
                f"{cls.__name__}: effects with ``memory`` must set ``remembers`` and ``depends_on_path``, others must not"
            )

    def in_materials(self, effects: Sequence[MaterialEffect]) -> tuple[MaterialEffect, ...]:
        return (*effects, self)

    def apply(self, model: ModelT) -> ModelT:
        return in_materials(self, model)

    @property
    def transient(self) -> bool:
        return self.values(1.0) != self.values(0.0)

    @property
    def numbers(self) -> int:
        """How many numbers its leaves read."""
        return len(self.values(0.0))

    @property
    def memory(self) -> int:
        """How many numbers it remembers."""
        return 0

    @property
    def long_term_share(self) -> float:
        """What is left of a shear stress after a long time."""
        return 1.0

    @property
    def shape(self) -> Mapping[str, int]:
        """What its leaves are compiled for beside its place, by placeholder: such as the number of terms."""
        return {}

    @classmethod
    @abstractmethod
    def leaves(cls) -> Mapping[str, Template]:
        """Slot of the response -> the leaf of this effect that fills it; ``SLOTS`` of forces/response.py lists the slots."""

    @abstractmethod
    def values(self, increment_s: float) -> tuple[float, ...]:
        """The numbers that its leaves read, for a time increment [s]."""

    def values_along(self, increments_s: np.ndarray) -> np.ndarray:
        """``values`` (n, numbers) of each of n time increments [s]."""
        return np.array([self.values(float(increment)) for increment in increments_s])


def readings_of(effects: Iterable[Effect]) -> tuple[Measurement, ...]:
    """Those that change only what is read."""
    return tuple(effect for effect in effects if isinstance(effect, Measurement))


def physics_of(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Those that change what happens, and not only what is read."""
    return tuple(effect for effect in effects if not isinstance(effect, Measurement))


def with_leaves(effects: Iterable[Effect]) -> tuple[MaterialEffect, ...]:
    """Those that the kernels compute beside the law."""
    materials: tuple[MaterialEffect, ...] = ()
    for effect in effects:
        materials = effect.in_materials(materials)
    return materials


def in_materials(effect: Effect, model: ModelT) -> ModelT:
    """A model with an effect of the material beside those that it has."""
    return replace(model, effects=effect.in_materials([e for e in model.effects if isinstance(e, MaterialEffect)]))


@leaf
def number(blocks, block, place):
    """A number of an effect for W elements."""
    return load(blocks.effects, (block * blocks.effects.shape[1] + place) * WIDTH)


@leaf
def remembered(blocks, block, place):
    """What W elements remember of the last accepted instant."""
    return load(blocks.old, (block * blocks.old.shape[1] + place) * WIDTH)


@leaf
def remember(blocks, block, place, value):
    """What W elements will remember if the present state is accepted."""
    store(blocks.new, (block * blocks.new.shape[1] + place) * WIDTH, value)


@leaf
def remembered_tensor(blocks, block, place):
    """A symmetric tensor (11, 22, 33, 12, 13, 23) as W elements remember it, from ``place`` on."""
    return (
        remembered(blocks, block, place),
        remembered(blocks, block, place + 1),
        remembered(blocks, block, place + 2),
        remembered(blocks, block, place + 3),
        remembered(blocks, block, place + 4),
        remembered(blocks, block, place + 5),
    )


@leaf
def remember_tensor(blocks, block, place, S):
    """What ``remembered_tensor`` gives at the next instant if the present state is accepted."""
    remember(blocks, block, place, S[0])
    remember(blocks, block, place + 1, S[1])
    remember(blocks, block, place + 2, S[2])
    remember(blocks, block, place + 3, S[3])
    remember(blocks, block, place + 4, S[4])
    remember(blocks, block, place + 5, S[5])


@leaf
def renew(blocks, block, place, kept, gain, new):
    """A symmetric tensor that is remembered from ``place`` on becomes ``kept`` times itself and ``gain`` times a new one."""
    S = plus(times(kept, remembered_tensor(blocks, block, place)), times(gain, new))
    remember_tensor(blocks, block, place, S)
    return S
