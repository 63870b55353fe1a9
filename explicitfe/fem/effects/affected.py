"""What effects may change, as they see it: the tables of a specimen and its tool, and the model. Types only.

Tables and model stand higher up in the house, so an effect names no class of theirs: it says which entries it reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from explicitfe.fem.materials.law import Law
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.platform.compiled.arrays import Springs


class AffectedTable(Protocol):
    """A table of a scenario: a frozen pydantic model."""

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self: ...

    def model_dump(self) -> dict[str, Any]: ...

    @classmethod
    def model_validate(cls, obj: Any) -> Self: ...


class AffectedSpecimen(AffectedTable, Protocol):
    """The table of a specimen."""

    @property
    def symmetry(self) -> str: ...


class AffectedPart(Protocol):
    """A frozen dataclass: ``replace`` makes another one of it."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


class AffectedLoad(AffectedPart, Protocol):
    """A load with its course in time."""

    @property
    def name(self) -> str: ...

    @property
    def profile(self) -> AffectedPart: ...


class AffectedNodalLoad(AffectedLoad, Protocol):
    """Forces on nodes."""

    @property
    def of_muscle(self) -> bool: ...


class AffectedSector(Protocol):
    """Nodes on the far side of a sector, and their partners on the near one."""

    @property
    def nodes(self) -> np.ndarray: ...

    @property
    def partners(self) -> np.ndarray: ...


class AffectedModel(AffectedPart, Protocol):
    """The physics of one run."""

    @property
    def mesh(self) -> HexMesh: ...

    @property
    def material(self) -> Law: ...

    @property
    def held(self) -> np.ndarray: ...

    @property
    def stiffness(self) -> np.ndarray | None: ...

    @property
    def effects(self) -> tuple[object, ...]: ...

    @property
    def loads(self) -> tuple[AffectedNodalLoad, ...]: ...

    @property
    def pulls(self) -> tuple[AffectedLoad, ...]: ...

    @property
    def stresses(self) -> tuple[AffectedLoad, ...]: ...

    @property
    def tool(self) -> AffectedPart | None: ...

    @property
    def support(self) -> Springs | None: ...

    @property
    def sector(self) -> AffectedSector | None: ...


LawT = TypeVar("LawT", bound=Law)
SpecimenT = TypeVar("SpecimenT", bound=AffectedSpecimen)
ToolT = TypeVar("ToolT", bound=AffectedTable)
ModelT = TypeVar("ModelT", bound=AffectedModel)


def tool_of(model: AffectedModel) -> AffectedPart:
    """The tool of a model; effects that act on a tool are applied to models that have one."""
    assert model.tool is not None
    return model.tool
