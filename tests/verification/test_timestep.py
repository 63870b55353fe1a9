"""The stable step: the bound is a bound, the estimate is close, 0.9 of it is stable, and a step too long is refused or seen.

Reference: central differences are stable for dt < 2 / omega_max, omega_max^2 the largest eigenvalue of M^-1 K, here of the
dense tangent by differences of the internal force, good to 1e-9.
"""

from __future__ import annotations

import numpy as np
import pytest
from support import LAWS, balance, block_mesh, deformed, mean_edge, model_of, random_rotation, tongue, true_limit

from explicitfe.build import Simulation
from explicitfe.errors import InputError
from explicitfe.model.model import NodalLoad
from explicitfe.model.profile import Profile
from explicitfe.run import INVERTED, UNSTABLE, Transient

BOTH_LAWS = pytest.mark.parametrize("law", list(LAWS))
LIMIT_TURNS = 40  # of the Lanczos iteration, as at the start of a run


def strongly_deformed(mesh, rng: np.random.Generator) -> np.ndarray:
    """Stretches between 0.5 and 1.8 along random axes, turned, plus 5 % of the edge at each node."""
    F = random_rotation(rng) @ np.diag(np.exp(rng.uniform(np.log(0.5), np.log(1.8), 3))) @ random_rotation(rng)
    return mesh.points @ (F - np.eye(3)).T + deformed(mesh, rng, 0.0, 0.05) - deformed_rotation_of(mesh, rng)


def deformed_rotation_of(mesh, rng):
    raise NotImplementedError
