"""What may be wrong in the scenario of a moving tongue: each candidate is a few --set settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.effects import EFFECTS
from explicitfe.effects.effect import Sought
from explicitfe.model import catalogue
from explicitfe.predict.tissue import toml_value
from explicitfe.scenario.transient import TransientScenario

# How a common factor, the weight [m/s^2], and the two dampings [1/s, s] are looked for.
FACTOR = Sought((0.5, 0.8, 1.25, 2.0), 0.1, 10.0, kind="log", none=1.0)
GRAVITY = Sought((0.0, 3.0, 9.81), 0.0, 12.0)
DAMPING = Sought((0.0, 20.0, 80.0, 240.0), 0.0, 1000.0)
VISCOSITY = Sought((0.0, 0.02, 0.05, 0.1), 0.0, 0.3)


@dataclass(frozen=True)
class Lever:
    """A quantity of a scenario that may be wrong.

    Attributes
    ----------
    title : in words, with the unit of the strength.
    parameter : the name of the strength.
    sought : how it is looked for, given what the scenario says, or why it cannot be.
    settings : ``key=value`` pairs that give the scenario a strength.
    """

    title: str
    parameter: str
    sought: Callable[[TransientScenario], Sought | str]
    settings: Callable[[TransientScenario, float], list[str]]


def _lag(scenario: TransientScenario) -> Sought | str:
    """The lag about that of the scenario."""
    if not _pulls(scenario):
        return "no muscle of the scenario pulls"
    lag = EFFECTS["activation-lag"]
    present = [effect.strength for effect in scenario.effects.chosen if isinstance(effect, lag)]
    return replace(lag.sought["tau_ms"], none=present[0] if present else 0.0)


def _pulls(scenario: TransientScenario) -> bool:
    """Whether a muscle of the scenario has a force."""
    return any(muscle.force_N > 0.0 for muscle in scenario.muscle)


def _weight(scenario: TransientScenario, strength: float) -> list[str]:
    """A weight in the scenario's own direction, or downwards."""
    g = np.array(scenario.model.gravity_m_s2)
    down = g / np.linalg.norm(g) if g.any() else np.array([0.0, 0.0, -1.0])
    return [f"model.gravity_m_s2={[float(x) for x in strength * down]}"]


def _forces(scenario: TransientScenario, factor: float) -> list[str]:
    """All muscle forces multiplied."""
    return [f"muscle.{k}.force_N={factor * muscle.force_N!r}" for k, muscle in enumerate(scenario.muscle)]


def _moduli(scenario: TransientScenario, factor: float) -> list[str]:
    """The material with all its moduli multiplied."""
    table = catalogue.material(scenario.model.material).model_dump(exclude_defaults=True)
    scaled = {key: factor * value if key.endswith("_Pa") else value for key, value in table.items() if key != "source"}
    return [f"model.material={toml_value(scaled)}"]


LEVERS: dict[str, Lever] = {
    "activation-lag": Lever(
        "lag of the muscles' forces behind their commands [ms]",
        "tau_ms",
        _lag,
        lambda scenario, tau: [f"effects.activation-lag.tau_ms={tau!r}"],
    ),
    "damping": Lever(
        "mass-proportional damping [1/s]",
        "alpha_per_s",
        lambda scenario: _about(DAMPING, scenario.model.damping.alpha_per_s),
        lambda scenario, alpha: [f"model.damping.alpha_per_s={alpha!r}"],
    ),
    "viscosity": Lever(
        "stiffness-proportional damping [s]",
        "beta_s",
        lambda scenario: (
            _about(VISCOSITY, scenario.model.damping.beta_s)
            if scenario.model.damping.beta_s > 0.0
            else "the scenario has no model.damping.beta_s"
        ),
        lambda scenario, beta: [f"model.damping.beta_s={beta!r}"],
    ),
    "gravity": Lever(
        "weight [m/s^2]",
        "acceleration_m_s2",
        lambda scenario: replace(GRAVITY, none=float(np.linalg.norm(scenario.model.gravity_m_s2))),
        _weight,
    ),
    "force-scale": Lever(
        "common factor of all muscle forces",
        "factor",
        lambda scenario: FACTOR if _pulls(scenario) else "no muscle of the scenario pulls",
        _forces,
    ),
    "stiffness": Lever("common factor of the material's moduli", "factor", lambda scenario: FACTOR, _moduli),
}


def _about(sought: Sought, now: float) -> Sought:
    """Strengths about the one that the scenario has: none at all, and larger ones by what would be tried without it."""
    return replace(sought, values=(0.0, *(now + v for v in sought.values if v > 0.0)), high=now + sought.high, none=now)
