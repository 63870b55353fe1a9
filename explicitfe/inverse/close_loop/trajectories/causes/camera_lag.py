"""Lag of a recording behind the motion."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever

# Sampling intervals.
LAG_INTERVALS = (-3.0, -1.0, 1.0, 3.0)
LARGEST_LAG_INTERVALS = 10.0


def levers(test: Experiment) -> dict[str, Lever]:
    """A lag that is the same in all curves."""
    fitted = any(curve.start_s is None for curve in test.dataset.curves)
    reason = "the starts of the motion are fitted" if fitted else ("" if test.markers else "only recordings of markers (at_mm)")
    interval_ms = 1e3 * test.interval_s
    lag = Sought(
        tuple(k * interval_ms for k in LAG_INTERVALS), -LARGEST_LAG_INTERVALS * interval_ms, LARGEST_LAG_INTERVALS * interval_ms
    )
    return {
        "camera-lag": Lever(
            "camera-lag",
            "lag of the recording behind the motion [ms]",
            {"lag_ms": lag},
            lag_s=lambda v: 1e-3 * v["lag_ms"],
            reason=reason,
        )
    }
