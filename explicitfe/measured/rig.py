"""What the machine of a test can do: the table [rig] of a dataset, by which further tests are proposed."""

from __future__ import annotations

from pydantic import Field

from explicitfe.scenario.table import Table


class RigLimits(Table):
    """Limits of a machine; what is left out follows from the tests that were made on it."""

    largest_force_N: float | None = Field(default=None, gt=0.0, description="of the load cell [N]")
    largest_displacement_mm: float | None = Field(default=None, gt=0.0, description="of the tool into the tissue [mm]")
    largest_strain: float | None = Field(
        default=None, gt=0.0, description="of a test without a tool: |stretch - 1|, or the shear"
    )
    shortest_ramp_s: float | None = Field(default=None, gt=0.0, description="in which the machine can reach the largest load [s]")
    longest_test_s: float | None = Field(default=None, gt=0.0, description="of one test [s]")
    tool_radii_mm: list[float] = Field(default=[], description="of other tools that are at hand [mm]")
    specimen_heights_mm: list[float] = Field(default=[], description="of other specimens that can be cut [mm]")
    handling_min: float = Field(default=5.0, ge=0.0, description="to set up one test, beside its own duration [min]")
