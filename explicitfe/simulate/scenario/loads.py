"""The tables of a scenario for what acts on a body from outside: loads, elastic supports, a release, the air."""

from __future__ import annotations

from pydantic import Field, model_validator

from explicitfe.fem.inputs.table import Name, Names, Table, Vector
from explicitfe.simulate.scenario.profile import MotionTable, PathTable, ProfileTable


class LoadTable(ProfileTable):
    """A force on nodes, or a mass that is fixed to them or hangs from them."""

    nodes: Names = Field(
        default=[],
        description='node sets; the load acts on the nodes that are in all of them: ["x1", "z1"] is the upper edge of an end',
    )
    at_mm: Vector | None = Field(default=None, description="a point of the body instead of node sets, before model.scale [mm]")
    radius_mm: float = Field(
        default=0.0,
        ge=0.0,
        description="with at_mm: the load is spread evenly over the surface within this distance of the point [mm]",
    )
    force_N: Vector | None = Field(default=None, description="resultant force, constant in direction or following [N]")
    follows: bool = Field(default=False, description="whether the force turns with the body")
    mass_g: float = Field(default=0.0, ge=0.0, description="mass, with its inertia and its weight under model.gravity_m_s2 [g]")
    pressure_kPa: float | None = Field(
        default=None,
        description="pressure on the faces of the surface between the nodes, which it follows; positive presses inwards [kPa]",
    )
    body_force_N_m3: Vector | None = Field(
        default=None, description="force per volume at rest, on the elements between the nodes; without nodes on all [N/m^3]"
    )
    string_slack_mm: float | None = Field(
        default=None, ge=0.0, description="the mass hangs on a string with this slack [mm]; it is rigidly fixed by default"
    )

    @model_validator(mode="after")
    def _is_a_load(self) -> LoadTable:
        of_all = self.body_force_N_m3 is not None and not self.nodes and self.at_mm is None
        if bool(self.nodes) == (self.at_mm is not None) and not of_all:
            raise ValueError('give either nodes, such as ["x1"], or at_mm, and not both')
        if self.radius_mm > 0.0 and self.at_mm is None:
            raise ValueError("radius_mm goes with at_mm: node sets have their own extent")
        of_regions = self.pressure_kPa is not None or self.body_force_N_m3 is not None
        if self.force_N is None and self.mass_g == 0.0 and not of_regions:
            raise ValueError("give force_N, pressure_kPa, body_force_N_m3 or mass_g")
        if of_regions and self.at_mm is not None:
            raise ValueError("pressure_kPa and body_force_N_m3 go with nodes, not with at_mm")
        if of_all and (self.pressure_kPa is not None or self.force_N is not None or self.mass_g > 0.0):
            raise ValueError("without nodes, body_force_N_m3 acts on the whole body; give the others a [[load]] of their own")
        if self.follows and self.force_N is None:
            raise ValueError("follows goes with force_N: a mass does not follow")
        if self.string_slack_mm is not None and self.mass_g == 0.0:
            raise ValueError("string_slack_mm goes with mass_g")
        if self.mass_g > 0.0 and self.string_slack_mm is None and self.is_late:
            raise ValueError("a mass that is rigidly fixed is there from the start; remove its times, or give string_slack_mm")
        return self

    @property
    def is_late(self) -> bool:
        """Whether the load does not act fully from time 0 on."""
        return self.start_ms > 0.0 or self.end_ms is not None or self.profile != "step"


class SupportTable(MotionTable):
    """An elastic foundation that holds a patch of the surface in place of rigidly fixed nodes, and may move it."""

    name: Name = Field(description="node set of the patch, such as x0 or, of a further body, velum.levator")
    normal_kPa_per_mm: float = Field(gt=0.0, description="pressure over displacement along the normal of the patch [kPa/mm]")
    tangential_kPa_per_mm: float = Field(gt=0.0, description="shear stress over displacement along the patch [kPa/mm]")
    shift_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="how far the foundation moves, along x, y and z [mm]")


class ReleaseTable(Table):
    """A body that is held before it moves freely."""

    hold: Names = Field(
        default=[],
        description="node sets that are held until the release; by default the whole body is held as it is meshed",
    )
    shift_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="displacement of the held node sets [mm]")
    at_ms: float = Field(default=0.0, ge=0.0, description="time at which the release begins [ms]")
    over_ms: float = Field(default=0.0, ge=0.0, description="time in which the holding forces fall to zero [ms]")

    @model_validator(mode="after")
    def _shifts_what_it_holds(self) -> ReleaseTable:
        if any(self.shift_mm) and not self.hold:
            raise ValueError('shift_mm needs hold, the node sets that are displaced, such as hold = ["x1"]')
        return self


class PathOfNodesTable(PathTable):
    """Nodes that move along a given path."""

    nodes: Names = Field(min_length=1, description="node sets; the nodes that are in any of them move")

    @model_validator(mode="after")
    def _has_a_path(self) -> PathOfNodesTable:
        if len(self.path) < 2 and self.path_file is None:
            raise ValueError("give a path with two rows at least, or path_file")
        return self


class InitialTable(Table):
    """Velocity of the body, or of some node sets, at time 0."""

    nodes: Names = Field(default=[], description="node sets that have the velocity; the whole body by default")
    velocity_m_s: Vector = Field(description="velocity at time 0, along x, y and z [m/s]")


class AirTable(Table):
    """Drag of the air on the free surface."""

    linear_Pa_s_m: float = Field(default=0.0, ge=0.0, description="pressure over velocity on the projected area [Pa s/m]")
    drag_coefficient: float = Field(default=0.0, ge=0.0, description="quadratic drag; about 1 to 2 for a bluff body")
    density_kg_m3: float = Field(default=1.2, gt=0.0, description="density of the air [kg/m^3]")
