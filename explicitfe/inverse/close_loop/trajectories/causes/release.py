"""A body that is not let go at once, and loads that act later than the release."""

from __future__ import annotations

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values
from explicitfe.simulate.scenario.transient import TransientScenario

# Shares of the duration of a curve; all are tried, because a delay turns the phase of a vibration.
TIME_SHARES = (0.01, 0.03, 0.06, 0.1)
LARGEST_TIME_SHARE = 0.5


def levers(test: Experiment) -> dict[str, Lever]:
    """The time that the release takes, and the delay of the loads."""
    times_ms = Sought(
        tuple(1e3 * share * test.duration_s for share in TIME_SHARES),
        0.0,
        1e3 * LARGEST_TIME_SHARE * test.duration_s,
        every=True,
    )
    passive = not any(scenario.muscle for scenario in test.scenarios)
    loaded = bool(test.gravity_m_s2.any()) or any(scenario.load for scenario in test.scenarios)
    no_release = "" if passive and loaded else "only a body that moves under its weight or a load is released"
    if test.scenario.release is not None:
        no_release = "the scenario has a [release]"
    some = any(not load.is_late for scenario in test.scenarios for load in scenario.load)
    return {
        "release": Lever(
            "release",
            "time that the release takes [ms]",
            {"over_ms": times_ms},
            lambda scenario, v: [f"release.over_ms={v['over_ms']!r}"],
            reason=no_release,
        ),
        "load-delay": Lever(
            "load-delay",
            "delay of the loads behind the release [ms]",
            {"delay_ms": times_ms},
            _delay_loads,
            reason="" if some else "no curve has a [[load]] that acts from the start",
        ),
    }


def _delay_loads(scenario: TransientScenario, v: Values) -> list[str]:
    """Every force that acts from the start begins later; a load with a fixed mass is there from the start."""
    late = [
        number
        for number, load in enumerate(scenario.load, 1)
        if not load.is_late and load.force_N is not None and (load.mass_g == 0.0 or load.string_slack_mm is not None)
    ]
    return [f"load.{number}.start_ms={v['delay_ms']!r}" for number in late if v["delay_ms"] > 0.0]
