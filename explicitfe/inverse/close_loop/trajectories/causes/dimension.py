"""A dimension of the body that is not as stated."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values
from explicitfe.simulate.scenario.transient import TransientScenario

DIMENSION_FACTOR = Sought((0.9, 0.95, 0.98, 1.02, 1.05, 1.1), 0.7, 1.4, kind="log", none=1.0)


def levers(test: Experiment) -> dict[str, Lever]:
    """A factor of the lengths along each axis."""
    reason = "" if test.scenario.model.name is None else "the built-in tongue has rest-shape"

    def along(axis: int) -> Lever:
        def settings(scenario: TransientScenario, v: Values) -> list[str]:
            factors = list(scenario.model.scale)
            factors[axis] *= v["factor"]
            return [f"model.scale={factors}"]

        return Lever(
            "dimension", f"factor of the lengths along {'xyz'[axis]}", {"factor": DIMENSION_FACTOR}, settings, reason=reason
        )

    return {f"dimension-{letter}": along(axis) for axis, letter in enumerate("xyz")}
