"""Limits of a testing machine: the table [rig] of a dataset, used when further tests are proposed."""

from __future__ import annotations

from pydantic import Field

from explicitfe.fem.inputs.table import Table


class RigLimits(Table):
    """Limits of a machine; defaults follow from the tests that were made on it."""

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
