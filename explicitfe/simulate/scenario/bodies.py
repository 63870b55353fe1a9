"""Tables of a scenario for the meshes of bodies, and for contact between them."""

from __future__ import annotations

from typing import ClassVar, cast

from pydantic import Field, model_validator

from explicitfe.fem.inputs.material import Material
from explicitfe.fem.inputs.table import Cells, Name, Names, Size, Table, Vector


class MeshTable(Table):
    """Where the mesh of a body comes from: a built-in model, a model file, or a box."""

    file: str | None = Field(default=None, description="model file of your own mesh, relative to this file")
    box_mm: Size | None = Field(default=None, description="lengths of a box with a corner at the origin; cells is then required")
    scale: Vector = Field(default=(1.0, 1.0, 1.0), description="factors of the lengths of a box or a model file along x, y and z")
    resolution: str | None = Field(default=None, description="coarse | medium | fine; medium by default")
    cells: Cells | None = Field(
        default=None, description="numbers of elements along the tongue, through its thickness and across it"
    )
    fixed: Names | None = Field(default=None, description="node sets that are held; those of the model by default")

    _built_in_key: ClassVar[str]

    @property
    def built_in(self) -> str | None:
        """Name of the built-in model, if it is one."""
        return cast(str | None, getattr(self, self._built_in_key))

    @model_validator(mode="after")
    def _one_source(self) -> MeshTable:
        key = self._built_in_key
        if sum(source is not None for source in (self.built_in, self.file, self.box_mm)) != 1:
            raise ValueError(f"give either {key} (a built-in model), file (a model file) or box_mm (the lengths of a box)")
        if self.box_mm is not None and (self.cells is None or not min(self.box_mm) > 0.0):
            raise ValueError("box_mm needs three lengths above 0, and cells, such as cells = [13, 4, 4]")
        if not min(self.scale) > 0.0 or (self.built_in is not None and self.scale != (1.0, 1.0, 1.0)):
            raise ValueError("scale needs three factors above 0, and is for box_mm and file only")
        if self.resolution is not None and self.cells is not None:
            raise ValueError("give either resolution or cells, not both")
        if self.fixed is not None and len(set(self.fixed)) < len(self.fixed):
            raise ValueError("fixed names a node set twice; name each once")
        if self.file is not None and (self.resolution is not None or self.cells is not None):
            raise ValueError("resolution and cells are for built-in models: a model file brings its own mesh")
        return self


class BodyTable(MeshTable):
    """A further deformable body. Its node sets, points and muscles have its name in front, such as velum.x0."""

    name: Name = Field(description="what to call it")
    model: str | None = Field(default=None, description="a built-in model, see 'explicitfe list models'")
    material: Material | None = Field(
        default=None, description="a name, see 'explicitfe list materials', or constants, of the law of [model]; its by default"
    )
    shift_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="moves its place at rest, along x, y and z")

    _built_in_key = "model"

    @model_validator(mode="after")
    def _a_name_for_results(self) -> BodyTable:
        if not self.name.strip() or set(self.name) & set("./"):
            raise ValueError(f'"{self.name}" cannot be the name of a body; give one of letters and digits, without "." and "/"')
        return self


class ContactTable(Table):
    """Contact of the free surfaces of bodies with each other, and of each with itself."""

    friction: float = Field(default=0.0, ge=0.0, description="Coulomb's coefficient")
    stiffness_kPa_per_mm: float | None = Field(
        default=None, gt=0.0, description="pressure over depth at first touch; by default from Young's modulus and the elements"
    )
    damping: float = Field(default=0.2, ge=0.0, description="damping ratio of two equal surfaces that press on each other")
