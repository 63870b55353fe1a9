"""Tables of a scenario for bones and for the motion of jaw and hyoid."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from explicitfe.fem.inputs.table import Name, Table, Vector
from explicitfe.simulate.scenario.profile import MotionTable, PathTable

# Built-in bones that have a part whose place a [[body]] can take, and the key that leaves it out where it is false.
SOFT_PARTS = {"palate": "velum", "pharynx": "side_walls"}


class BoneTable(PathTable):
    """A rigid surface that the body can rest on: one that a built-in model brings, or a closed surface of triangles in a file."""

    name: Name = Field(description="palate, jaw or pharynx of the built-in tongue; of a file: what to call it")
    file: str | None = Field(default=None, description="STL, OBJ, PLY or VTP file, relative to this file")
    length_unit: Literal["m", "cm", "mm"] | None = Field(default=None, description="of the file")
    friction: float = Field(default=0.0, ge=0.0, description="Coulomb's coefficient; 0 for a wet palate")
    damping: float = Field(default=0.5, ge=0.0, description="damping ratio of a point of the body that presses on it")
    shift_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="moves its place at rest, along x (back), y (right), z (up)")
    hard_palate_mm: float | None = Field(
        default=None,
        gt=0.0,
        description="length of the hard palate, from the edge of the incisors along the midline",
    )
    plate_mm: float = Field(
        default=0.0,
        ge=0.0,
        description="thickness of the plate of the palatogram, whose electrodes are on where the tongue is within it",
    )
    velum: bool = Field(
        default=True, description="false: the built-in palate ends where the velum begins, which is then a [[body]]"
    )
    side_walls: bool = Field(
        default=True, description="false: the built-in pharynx is its posterior wall only, and its side walls are a [[body]]"
    )
    smooth: bool = Field(
        default=False,
        description="whether its surface is rounded over a cell of its distance grid, so that its force has no jumps: gradients "
        "need it",
    )
    with_jaw: bool | None = Field(
        default=None, description='whether it moves with the jaw; by default true for the bone "jaw" only'
    )

    @model_validator(mode="after")
    def _keys_that_go_together(self) -> BoneTable:
        if (self.file is None) != (self.length_unit is None):
            raise ValueError("give both file and length_unit, because a surface file has no unit of length")
        if (self.path or self.path_file) and self.moves_with_jaw:
            raise ValueError("a bone with a path cannot move with the jaw: set with_jaw = false")
        if "/" in self.name or not self.name.strip(" ."):
            raise ValueError(f'"{self.name}" cannot be a name in a result file: give one of letters and digits, without "/"')
        for key in ("hard_palate_mm", "plate_mm"):
            if getattr(self, key) and self.name != "palate":
                raise ValueError(f'"{self.name}" has no hard palate: {key} belongs to the bone called "palate"')
        for owner, key in SOFT_PARTS.items():
            if not getattr(self, key) and (self.name != owner or self.file is not None):
                part = key.replace("_", " ")
                raise ValueError(f'"{self.name}" has no {part}: {key} = false belongs to the built-in bone "{owner}"')
        return self

    @property
    def is_whole(self) -> bool:
        """Whether no body takes the place of its soft part."""
        return self.velum and self.side_walls

    @property
    def moves_with_jaw(self) -> bool:
        return self.name == "jaw" if self.with_jaw is None else self.with_jaw


# The condyles glide forward by so much for each degree that the jaw turns: Muto & Kanazawa (1996), J. Oral Maxillofac. Surg.
# 54:970-974, 20.5 mm and 39.1 degrees in 29 men, 18.1 mm and 36.3 degrees in 31 women, at the widest opening. That the path is
# straight in speech too, of a slope that hangs on speaker and sound, say Vatikiotis-Bateson & Ostry (1995). That all of it goes
# forward, and none down, is this project's choice.
GLIDE_MM_PER_DEG = 0.5


class JawTable(MotionTable):
    """How the jaw opens: it turns about the axis through the condyles, and shifts along with it."""

    opening_deg: float | None = Field(
        default=None, ge=-20.0, le=40.0, description="turn about the condyles; positive opens the mouth; 0 by default"
    )
    opening_mm: float | None = Field(
        default=None, ge=-10.0, le=40.0, description="the same, as how far the turn lowers the edge of the incisors"
    )
    forward_mm: float | None = Field(
        default=None, ge=-30.0, le=30.0, description="shift of the condyles; 0.5 mm for each degree of rotation by default"
    )
    down_mm: float = Field(default=0.0, ge=-30.0, le=30.0, description="shift of the condyles")
    axis_mm: Vector | None = Field(
        default=None, description="a point of the axis, which runs along y; that of the built-in tongue by default"
    )
    incisor_mm: Vector | None = Field(
        default=None, description="the edge of the lower incisors, with opening_mm; that of the built-in tongue by default"
    )

    @model_validator(mode="after")
    def _one_opening(self) -> JawTable:
        if self.opening_deg is not None and self.opening_mm is not None:
            raise ValueError("give either opening_deg or opening_mm, not both")
        return self


# Eight springs of 220 N/m hold the hyoid bone in the model of S. Buchaillard: ArtiSynth, artisynth_models,
# jawTongue/BadinJawHyoid.java, setHyoidSpringStiffness, which names her model.
HYOID_STIFFNESS_N_PER_MM = 1.76


class HyoidTable(Table):
    """How the hyoid bone is held: by springs, so that it gives way without turning."""

    stiffness_N_per_mm: float = Field(
        default=HYOID_STIFFNESS_N_PER_MM, gt=0.0, description="of the springs that hold it, along every axis"
    )
