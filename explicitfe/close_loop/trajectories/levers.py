"""Candidate effects of trajectories: quantities of a scenario that may be wrong, as --set settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from explicitfe.effects import EFFECTS
from explicitfe.effects.effect import Sought
from explicitfe.effects.material.viscoelastic import from_damping
from explicitfe.errors import InputError
from explicitfe.host.toml_text import toml_value
from explicitfe.materials import Law
from explicitfe.model import catalogue
from explicitfe.model.effects import check_effects
from explicitfe.scenario.transient import MuscleTable, TransientScenario

# Search ranges of a common factor, the weight [m/s^2], and the two damping coefficients [1/s, s].
FACTOR = Sought((0.5, 0.8, 1.25, 2.0), 0.1, 10.0, kind="log", none=1.0)
GRAVITY = Sought((0.0, 3.0, 9.81), 0.0, 12.0)
DAMPING = Sought((0.0, 20.0, 80.0, 240.0), 0.0, 1000.0)
VISCOSITY = Sought((0.0, 0.02, 0.05, 0.1), 0.0, 0.3)
# A bone that is not in the scenario is searched from 20 mm away, beyond the reach of the tongue, to 3 mm closer than in the
# model: the position of the bones relative to the tongue is known within 2 mm (models/tongue/SOURCES.md).
CLEARANCE_MM = Sought((4.0, 1.5, 0.0, -1.5), -3.0, 20.0, none=20.0)
# Side of the bones, as seen from the built-in tongue.
SIDE_OF_BONE = {"jaw": -1.0, "palate": 1.0}  # along z
# Force of a muscle that the scenario lacks, relative to that of the muscle with the same activation profile.
MUSCLE_SHARE = Sought((0.1, 0.4, 1.0), 0.0, 4.0)
# Muscles that scenarios often lack, and the muscle whose activation profile they get; others are tried with --effects.
# GGh: authors before Calka et al. (2025) count it among GGp. MH: it braces most postures with GGp (Liu et al. 2022).
OFTEN_MISSING = {"GGh": "GGp", "MH": "GGp"}
MISSING = "missing-"


@dataclass(frozen=True)
class Lever:
    """A quantity of a scenario that may be wrong.

    Attributes
    ----------
    title : description, with the unit of the strength.
    parameter : name of the strength.
    sought : search range for a scenario, or the reason why the lever does not apply.
    settings : ``key=value`` pairs that set a strength in the scenario.
    usual : whether it is tried without ``--effects``.
    """

    title: str
    parameter: str
    sought: Callable[[TransientScenario], Sought | str]
    settings: Callable[[TransientScenario, float], list[str]]
    usual: bool = True


def _lag(scenario: TransientScenario) -> Sought | str:
    """The lag about that of the scenario."""
    if not _pulls(scenario):
        return "no muscle of the scenario is active"
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
    return [f"muscle.{k}.force_N={factor * muscle.force_N!r}" for k, muscle in enumerate(scenario.muscle, 1)]


def _moduli(scenario: TransientScenario, factor: float) -> list[str]:
    """The material with all its moduli multiplied."""
    return [f"model.material={_stiffer(scenario.model.material, factor)}"]


def _stiffer(material: str | Law, factor: float) -> str:
    """A material with its moduli multiplied, as a setting has it."""
    table = catalogue.material(material).model_dump(exclude_defaults=True)
    scaled = {key: factor * value if key.endswith("_Pa") else value for key, value in table.items() if key != "source"}
    return toml_value(scaled)


def _grafts(scenario: TransientScenario, factor: float) -> list[str]:
    """All grafts with their moduli multiplied."""
    settings = []
    for number, graft in enumerate(scenario.graft, 1):
        if graft.material is None:
            assert graft.stiffness_ratio is not None  # the schema has checked that one of the two is given
            settings.append(f"graft.{number}.stiffness_ratio={factor * graft.stiffness_ratio!r}")
        else:
            settings.append(f"graft.{number}.material={_stiffer(graft.material, factor)}")
    return settings


def _about(sought: Sought, now: float) -> Sought:
    """Strengths about the one that the scenario has: none at all, and larger ones by what would be tried without it."""
    more = tuple(now + v for v in sought.values if v > 0.0)
    return replace(sought, values=(0.0, *more) if now > 0.0 else more, high=now + sought.high, none=now)


def _viscosity(scenario: TransientScenario) -> Sought | str:
    """The viscosity about that of the scenario, which may be none."""
    now = scenario.model.damping
    _, branch = from_damping(catalogue.material(scenario.model.material), VISCOSITY.high, 1e-3 * now.tau_ms)
    chosen = scenario.effects.chosen
    try:
        check_effects((branch, *chosen), scenario.model.element)
    except InputError as error:
        return str(error)
    if any(type(effect) is type(branch) for effect in chosen):
        return "effects.viscoelastic of the scenario already is a viscosity"
    return _about(VISCOSITY, now.beta_s)


def _bone(name: str) -> Lever:
    """Contact with a bone of the built-in tongue that the scenario does not have."""

    def sought(scenario: TransientScenario) -> Sought | str:
        if any(table.name == name for table in scenario.bone):
            return f"the scenario has the bone {name}"
        model = scenario.model.name
        return CLEARANCE_MM if model and name in catalogue.bones(model) else f"the model has no bone {name}"

    def settings(scenario: TransientScenario, clearance_mm: float) -> list[str]:
        shift_mm = [0.0, 0.0, SIDE_OF_BONE[name] * clearance_mm]
        return [f"bone.+={toml_value({'name': name, 'shift_mm': shift_mm})}"]

    title = f"contact with the {name}; additional distance from the tongue compared with the model [mm]"
    return Lever(title, "clearance_mm", sought, settings)


def _missing(name: str) -> Lever:
    """A muscle of the model that the scenario does not list: it pulls with a share of a listed one, and with its course."""

    def leader(scenario: TransientScenario) -> str:
        """The listed muscle whose course it has: that of the table, else the strongest."""
        listed = {muscle.name: muscle.force_N for muscle in scenario.muscle}
        partner = OFTEN_MISSING.get(name, "")
        return partner if partner in listed else max(listed, key=lambda muscle: listed[muscle])

    def sought(scenario: TransientScenario) -> Sought | str:
        if any(muscle.name == name for muscle in scenario.muscle):
            return f"the scenario lists {name}"
        return MUSCLE_SHARE if _pulls(scenario) else "no muscle of the scenario is active"

    def settings(scenario: TransientScenario, share: float) -> list[str]:
        partner = leader(scenario)
        return [f"muscle.+={toml_value(_pull_of(name, share, muscle))}" for muscle in scenario.muscle if muscle.name == partner]

    title = f"activation of {name}, which the scenario does not list; force relative to the muscle with the same profile"
    return Lever(title, "share", sought, settings, usual=name in OFTEN_MISSING)


def _pull_of(name: str, share: float, partner: MuscleTable) -> dict[str, object]:
    """The table of a muscle that pulls as another one does, with all of its own fibres."""
    table = partner.model_dump(mode="json", exclude_unset=True, exclude={"fibres"})
    return table | {"name": name, "force_N": share * partner.force_N}


LEVERS: dict[str, Lever] = {
    "activation-lag": Lever(
        "lag of muscle forces behind their commands [ms]",
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
        _viscosity,
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
        lambda scenario: FACTOR if _pulls(scenario) else "no muscle of the scenario is active",
        _forces,
    ),
    "stiffness": Lever("common factor of the moduli of the material", "factor", lambda scenario: FACTOR, _moduli),
    "graft-stiffness": Lever(
        "common factor of the moduli of the grafts",
        "factor",
        lambda scenario: FACTOR if scenario.graft else "the scenario has no [[graft]]",
        _grafts,
    ),
    **{f"{bone}-contact": _bone(bone) for bone in SIDE_OF_BONE},
}


def levers_of(muscles: Iterable[str]) -> dict[str, Lever]:
    """All levers of a model with these muscles."""
    return LEVERS | {MISSING + name: _missing(name) for name in muscles}
