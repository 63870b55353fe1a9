"""Rows of measured curves that say something, and those that say nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from explicitfe.inverse.close_loop.specimens.series import determined, series_of
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool

SD_N = 0.002


def pressed_by_force(shape: str = "sphere") -> Curve:
    """Ten rows in the air with a load cell's noise, a ramp to 0.5 N, and back to none; the displacement follows the force."""
    force = np.concatenate([SD_N * np.array([0.0, 1.0, -1.0, 2.0, 0.5, -2.0, 1.5, -0.5, 0.0, 1.0]), np.linspace(0.05, 0.5, 10)])
    force = np.concatenate([force, force[:9:-1], [0.0]])
    return Curve(
        id="a",
        file="a.csv",
        kind="force-displacement",
        constants="all",
        group="a",
        split=None,
        specimen=MeasuredSpecimen(shape="cylinder", radius_mm=30.0, height_mm=30.0),
        tool=MeasuredTool(shape=shape, radius_mm=5.0, control="force"),
        noise=MeasuredNoise(force_sd_N=SD_N, displacement_sd_mm=0.01),
        conditions={},
        time_s=np.arange(len(force), dtype=float),
        columns={"displacement_m": 4e-3 * force, "force_N": force},
    )


def test_a_tool_in_the_air_determines_no_displacement():
    """No force beyond three sd of the load cell: the tool may be anywhere above the specimen."""
    curve = pressed_by_force()
    rows = determined(curve)
    assert rows.tolist() == [False] * 10 + [True] * 20 + [False]
    one = series_of(curve, "a", "")
    np.testing.assert_array_equal(one.measured, curve.displacement_m[rows])
    assert len(one.time_s) == len(one.imposed_sd) == len(one.phase) == 20
    assert one.bends[0] == 0 and one.bends[-1] == 19 and 9 in one.bends and (np.diff(one.bends) > 0).all()


@pytest.mark.parametrize("shape, control", [("bonded-disc", "force"), ("sphere", "displacement")])
def test_a_tied_or_driven_tool_determines_every_row(shape, control):
    curve = pressed_by_force(shape)
    curve = replace(curve, tool=curve.tool.model_copy(update={"control": control}))
    assert determined(curve).all() and len(series_of(curve, "a", "").measured) == 31
