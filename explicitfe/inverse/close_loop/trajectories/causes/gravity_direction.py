"""Gravity in another direction than stated, such as by a rig that is not level."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values
from explicitfe.simulate.scenario.transient import TransientScenario

ANGLE_DEG = Sought((-5.0, -2.0, 2.0, 5.0), -45.0, 45.0)


def levers(test: Experiment) -> dict[str, Lever]:
    """A rotation of gravity about each of the two axes that are most nearly normal to it."""
    gravity = test.gravity_m_s2
    reason = "" if gravity.any() else "the scenario has no gravity"

    def about(axis: int) -> Lever:
        letter = "xyz"[axis]

        def settings(scenario: TransientScenario, v: Values) -> list[str]:
            turn = Rotation.from_rotvec(np.radians(v[f"about_{letter}_deg"]) * np.eye(3)[axis])
            return [f"model.gravity_m_s2={[float(x) for x in turn.apply(np.array(scenario.model.gravity_m_s2))]}"]

        title = f"rotation of gravity about {letter} [degrees]"
        return Lever("gravity-direction", title, {f"about_{letter}_deg": ANGLE_DEG}, settings, reason=reason)

    return {
        f"gravity-direction-{'xyz'[axis]}": about(int(axis)) for axis in sorted(np.argsort(np.abs(gravity))[:2], reverse=True)
    }
