"""Drag of the air on the free surface."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, around

# Rates [1/s] at which linear drag slows the body down.
RATES_PER_S = (1.0, 4.0, 16.0)
# Drag coefficients: a bluff body has 1 to 2; ten times as much says that something else drags.
DRAG_COEFFICIENT = Sought((2.0, 10.0, 50.0), 0.0, 500.0)


def levers(test: Experiment) -> dict[str, Lever]:
    """Quadratic and linear drag."""
    air = test.scenario.air
    per_rate = test.mass_kg / test.silhouette_m2
    linear = Sought(tuple(rate * per_rate for rate in RATES_PER_S), 0.0, 20.0 * RATES_PER_S[-1] * per_rate)
    reason = "" if test.scenario.model.name is None else "the air does not slow a tongue noticeably"
    return {
        "air-drag": Lever(
            "air-drag",
            "drag coefficient of the body in air",
            {"coefficient": around(DRAG_COEFFICIENT, 0.0 if air is None else air.drag_coefficient)},
            lambda scenario, v: [f"air.drag_coefficient={v['coefficient']!r}"],
            reason=reason,
        ),
        "air-drag-linear": Lever(
            "air-drag",
            "linear drag of the air [Pa s/m]",
            {"pressure_Pa_s_m": around(linear, 0.0 if air is None else air.linear_Pa_s_m)},
            lambda scenario, v: [f"air.linear_Pa_s_m={v['pressure_Pa_s_m']!r}"],
            reason=reason,
        ),
    }
