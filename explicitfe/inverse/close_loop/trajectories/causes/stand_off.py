"""Markers that stand off the body by more or less than stated."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever

MORE_MM = Sought((-5.0, -2.0, 2.0, 5.0), -30.0, 30.0)


def levers(test: Experiment) -> dict[str, Lever]:
    """A change of the stand-off that all markers share."""
    return {
        "stand-off": Lever(
            "stand-off",
            "further stand-off of all markers [mm]",
            {"more_mm": MORE_MM},
            stand_off_m=lambda v: 1e-3 * v["more_mm"],
            reason="" if test.markers else "only markers (at_mm) stand off",
        )
    }
