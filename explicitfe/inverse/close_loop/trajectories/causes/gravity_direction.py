"""Gravity in another direction than stated, such as by a rig that is not level."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values
from explicitfe.simulate.scenario.transient import TransientScenario

ANGLE_DEG = Sought((-5.0, -2.0, 2.0, 5.0), -45.0, 45.0)


def levers(test: Experiment) -> dict[str, Lever]:
    """Two angles about the axes that are most nearly normal to gravity."""
    gravity = test.gravity_m_s2
    reason = "" if gravity.any() else "the scenario has no gravity"
    first, second = (int(k) for k in np.sort(np.argsort(np.abs(gravity))[:2]))

    def turn_gravity(scenario: TransientScenario, v: Values) -> list[str]:
        angles = np.zeros(3)
        angles[[first, second]] = [v[f"about_{'xyz'[first]}_deg"], v[f"about_{'xyz'[second]}_deg"]]
        g = Rotation.from_rotvec(np.radians(angles)).apply(np.array(scenario.model.gravity_m_s2))
        return [f"model.gravity_m_s2={[float(x) for x in g]}"]

    # The angle that turns gravity out of the plane of the motion changes least; each is the strength of one form.
    def form(strength: int, other: int) -> Lever:
        names = [f"about_{'xyz'[strength]}_deg", f"about_{'xyz'[other]}_deg"]
        return Lever(
            "gravity-direction",
            f"rotation of gravity about {'xyz'[strength]} [degrees]",
            {names[0]: ANGLE_DEG},
            lambda scenario, v: turn_gravity(scenario, {names[1]: 0.0, **v}),
            reason=reason,
        )

    return {
        f"gravity-direction-{'xyz'[second]}": form(second, first),
        f"gravity-direction-{'xyz'[first]}": form(first, second),
    }
