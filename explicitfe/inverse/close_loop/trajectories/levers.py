"""Candidate causes of trajectories: quantities of a scenario that may be wrong, as ``--set`` settings or as a registration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.effects import EFFECTS
from explicitfe.fem.effects.effect import Sought
from explicitfe.fem.effects.material.viscoelastic import from_damping
from explicitfe.fem.model.profile import Profile
from explicitfe.inverse.close_loop.trajectories.causes import (
    added_mass,
    air_drag,
    camera_lag,
    clamp_compliance,
    dimension,
    gravity_direction,
    nonlinear_law,
    release,
    stand_off,
    viscoelastic,
)
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values, around, material_times
from explicitfe.inverse.measured.registration import Registration
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.effects import check_effects
from explicitfe.simulate.scenario.profile import profile_of
from explicitfe.simulate.scenario.transient import MuscleTable, TransientScenario

# Titles of causes that have no form of the same name.
CAUSE_TITLES = {"dimension": "error of a dimension", "gravity-direction": "direction of gravity"}
# One file each.
CAUSE_MODULES = (
    added_mass,
    air_drag,
    camera_lag,
    clamp_compliance,
    dimension,
    gravity_direction,
    nonlinear_law,
    release,
    stand_off,
    viscoelastic,
)

# Search ranges: of the values on each side of no effect the middle one is tried, which is a run for each curve, and the largest
# one is the largest plausible strength. Common factor, lengths, damping [1/s, s], weight [m/s^2], share of force.
FACTOR = Sought((0.5, 0.8, 0.9, 1.1, 1.25, 2.0), 0.1, 10.0, kind="log", none=1.0)
SIZE = Sought((0.85, 0.95, 0.98, 1.02, 1.05, 1.15), 0.7, 1.4, kind="log", none=1.0)
DAMPING, VISCOSITY = Sought((20.0, 80.0, 240.0), 0.0, 1000.0), Sought((0.02, 0.05, 0.1), 0.0, 0.3)
GRAVITY = Sought((3.0, 9.81), 0.0, 12.0)
# Decay [1/s] times the duration of a recording of markers that vibrate: a share of exp(-1) of the amplitude is left, and less.
SHOWN_DECAYS = (1.0, 3.0, 10.0, 30.0)
LARGEST_DECAY = 100.0
FALLING_SHARE = Sought((1.0,), 0.0, 1.0)
# Force of a muscle that the scenario does not list, relative to the force of all listed muscles.
FORCE_SHARE = Sought((0.1, 0.4, 1.5), 0.0, 4.0)
# A bone that is not in the scenario is searched from 20 mm away, beyond the reach of the tongue, to 3 mm closer than in the
# model: the position of the bones relative to the tongue is known within 2 mm (models/tongue/SOURCES.md). A second parameter has
# two values, so that combinations of the trials span both.
CLEARANCE_MM = Sought((4.0, 1.5, 0.0, -1.5), -3.0, 20.0, none=20.0)
BONE_UP_MM, BONE_SIDEWAYS_MM = Sought((-4.0, -2.0, -1.0, 1.0, 2.0, 4.0), -6.0, 6.0), Sought((-2.0, 2.0), -6.0, 6.0)
FRICTION = Sought((0.1, 0.3, 0.6), 0.0, 1.5)
# Side of the bones, as seen from the built-in tongue.
SIDE_OF_BONE = {"jaw": -1.0, "palate": 1.0}  # along z
HEAD_SHIFT_MM, HEAD_TURN_DEG = Sought((-2.0, 2.0), -50.0, 50.0), Sought((-2.0, 2.0), -45.0, 45.0)
MISSING, SHARE, FORCE = "missing-", "-share", "force-"


def levers_of(test: Experiment) -> dict[str, Lever]:
    """All levers of a test by name; levers of the same cause are forms of it, the usual form first."""
    scenario, registration = test.scenario, test.dataset.registration or RegistrationTable()
    totals = [total_force_N(one) for one in test.scenarios] or [total_force_N(scenario)]
    pulls = "" if max(totals) > 0.0 else "no muscle of the scenario is active"
    levers = _of_loads(scenario, pulls, known_gravity=bool(test.markers)) | _of_tissue(test)
    for bone in _bones(scenario):
        levers |= _of_bone(bone, scenario)
    for name in test.anatomy.muscles:
        levers |= _of_muscle(name, scenario, totals, pulls)
    for cause in CAUSE_MODULES:
        levers |= cause.levers(test)
    # markers at rest give the registration
    return levers if test.markers else levers | {"registration": _registration(registration)}


def title_of(name: str, levers: Mapping[str, Lever]) -> str:
    """Title of a lever, or of a cause whose forms have other names, without units."""
    title = CAUSE_TITLES.get(name) or levers[name].title
    return title.partition(" [")[0]


def total_force_N(scenario: TransientScenario) -> float:
    """Force of all muscles of a scenario [N]."""
    return sum(muscle.force_N for muscle in scenario.muscle)


def _of_loads(scenario: TransientScenario, pulls: str, *, known_gravity: bool) -> dict[str, Lever]:
    """Levers of loads and muscles. The magnitude of gravity is a candidate only where it is unknown."""
    lag = EFFECTS["activation-lag"]
    lags = [effect.strength for effect in scenario.effects.chosen if isinstance(effect, lag)]
    gravity = float(np.linalg.norm(scenario.model.gravity_m_s2))
    falls = [muscle.force_length for muscle in scenario.muscle if muscle.distribution == "stress"]
    no_fall = "" if falls and not all(falls) else 'no muscle with distribution = "stress" lacks force_length'
    return {
        "activation-lag": Lever(
            "activation-lag",
            "lag of muscle forces behind their commands [ms]",
            {"tau_ms": replace(lag.sought["tau_ms"], none=lags[0] if lags else 0.0)},
            lambda scenario, v: [f"effects.activation-lag.tau_ms={v['tau_ms']!r}"],
            reason=pulls,
        ),
        "gravity": Lever(
            "gravity",
            "weight [m/s^2]",
            {"acceleration_m_s2": replace(GRAVITY, values=(0.0,) if gravity else GRAVITY.values, none=gravity)},
            _weight,
            reason="the weight is known, apart from its direction" if known_gravity and gravity else "",
        ),
        "force-scale": Lever(
            "force-scale",
            "common factor of all muscle forces",
            {"factor": FACTOR},
            lambda scenario, v: _forces(scenario, v["factor"]),
            reason=pulls,
        ),
        "force-length": Lever(
            "force-length",
            "share of muscle force that falls off in shortened fibres",
            {"share": FALLING_SHARE},
            _falling,
            reason=pulls or no_fall,
        ),
    }


def _of_tissue(test: Experiment) -> dict[str, Lever]:
    """Levers of the body."""
    scenario, damping = test.scenario, test.scenario.model.damping
    by_mass, by_stiffness = DAMPING, VISCOSITY
    if test.markers:
        # the decay of a vibration is alpha / 2 + beta w^2 / 2
        by_mass, by_stiffness = (
            Sought(tuple(factor * d for d in SHOWN_DECAYS), 0.0, factor * LARGEST_DECAY, every=True)
            for factor in (2.0 / test.duration_s, 2.0 / test.duration_s / test.frequency_rad_s**2)
        )
    return {
        "damping": Lever(
            "damping",
            "mass-proportional damping [1/s]",
            {"alpha_per_s": around(by_mass, damping.alpha_per_s)},
            lambda scenario, v: [f"model.damping.alpha_per_s={v['alpha_per_s']!r}"],
        ),
        "viscosity": Lever(
            "viscoelastic",
            "stiffness-proportional damping [s]",
            {"beta_s": around(by_stiffness, damping.beta_s)},
            lambda scenario, v: [f"model.damping.beta_s={v['beta_s']!r}"],
            reason=_no_viscosity(scenario),
        ),
        "stiffness": Lever(
            "stiffness",
            "common factor of the moduli of the material",
            {"factor": FACTOR},
            lambda scenario, v: [f"model.material={material_times(scenario.model.material, v['factor'])}"],
        ),
        "graft-stiffness": Lever(
            "graft-stiffness",
            "common factor of the moduli of the grafts",
            {"factor": FACTOR},
            lambda scenario, v: _grafts(scenario, v["factor"]),
            reason="" if scenario.graft else "the scenario has no [[graft]]",
        ),
        "rest-shape": Lever(
            "rest-shape",
            "common factor of all lengths of the tongue and its bones",
            {"factor": SIZE},
            _resized,
            _resized_reading,
            reason="" if scenario.model.name is not None else "a box or a mesh file has dimension-x, -y and -z",
        ),
    }


def _bones(scenario: TransientScenario) -> list[str]:
    model = scenario.model.name
    known = [name for name in SIDE_OF_BONE if model and name in catalogue.bones(model)]
    return list(dict.fromkeys([*known, *(table.name for table in scenario.bone)]))


def _of_bone(name: str, scenario: TransientScenario) -> dict[str, Lever]:
    """Place and friction of a bone; one that the scenario lacks is first brought near the tongue."""
    number = next((k for k, table in enumerate(scenario.bone, 1) if table.name == name), 0)

    def add(scenario: TransientScenario, v: Values) -> list[str]:
        shift_mm = [v.get("shift_x_mm", 0.0), 0.0, SIDE_OF_BONE[name] * v["clearance_mm"]]
        return [f"bone.+={toml_value({'name': name, 'friction': v.get('friction', 0.0), 'shift_mm': shift_mm})}"]

    def move(scenario: TransientScenario, v: Values) -> list[str]:
        x, y, z = scenario.bone[number - 1].shift_mm
        return [f"bone.{number}.shift_mm={[x + v['shift_x_mm'], y, z + v['shift_z_mm']]}"]

    def rub(scenario: TransientScenario, v: Values) -> list[str]:
        return [f"bone.{number}.friction={v['friction']!r}"]

    if number:
        cause, shifts = f"{name}-shift", {"shift_z_mm": BONE_UP_MM, "shift_x_mm": BONE_SIDEWAYS_MM}
        friction = {"friction": around(FRICTION, scenario.bone[number - 1].friction)}
        return {
            cause: Lever(cause, f"shift of the {name} along z and x [mm]", shifts, move),
            f"{name}-friction": Lever(f"{name}-friction", f"coefficient of friction of the {name}", friction, rub),
        }
    cause, clearance = f"{name}-contact", {"clearance_mm": CLEARANCE_MM}
    title = f"contact with the {name}; additional distance from the tongue compared with the model [mm]"
    shifted, rough = clearance | {"shift_x_mm": BONE_SIDEWAYS_MM}, clearance | {"friction": replace(FRICTION, values=(0.3,))}
    return {
        cause: Lever(cause, title, clearance, add),
        f"{cause}-shifted": Lever(cause, f"{title}, with a shift along x [mm]", shifted, add),
        f"{cause}-rough": Lever(cause, f"{title}, with friction", rough, add),
    }


def _of_muscle(name: str, scenario: TransientScenario, totals_N: Sequence[float], pulls: str) -> dict[str, Lever]:
    """The force of one muscle: a factor where the scenario lists it; else a force that is equal or proportional in all curves.

    A muscle that is not listed has the mean activation profile of the listed ones, weighted by their forces.
    """
    numbers = [k for k, muscle in enumerate(scenario.muscle, 1) if muscle.name == name]
    if numbers:
        alone = "" if len({muscle.name for muscle in scenario.muscle}) > 1 else "force-scale is the same"
        cause, title = f"{FORCE}{name}", f"factor of the force of {name}"
        reason = pulls or alone
        return {cause: Lever(cause, title, {"factor": FACTOR}, lambda s, v: _forces(s, v["factor"], numbers), reason=reason)}
    cause, title, largest = f"{MISSING}{name}", f"force of {name}, which the scenario does not list", max(totals_N)
    sought = replace(FORCE_SHARE, values=tuple(v * largest for v in FORCE_SHARE.values), high=FORCE_SHARE.high * largest)
    equal = Lever(
        cause, f"{title}, equal in all curves [N]", {"force_N": sought}, lambda s, v: _added(s, name, v["force_N"]), reason=pulls
    )
    if len(set(totals_N)) == 1:
        return {cause: equal}
    share = Lever(
        cause,
        f"{title}, relative to the force of all listed muscles in a curve",
        {"share": FORCE_SHARE},
        lambda s, v: _added(s, name, v["share"] * total_force_N(s)),
        reason=pulls,
    )
    return {cause: equal, f"{cause}{SHARE}": share}


def _registration(table: RegistrationTable) -> Lever:
    """A rigid motion in the sagittal plane of a registration that the dataset states."""
    sought = {} if table.translation == "fit" else {"shift_x_mm": HEAD_SHIFT_MM, "shift_z_mm": HEAD_SHIFT_MM}
    sought |= {} if table.rotation == "fit" else {"turn_deg": HEAD_TURN_DEG}
    title = "motion of the registration in the sagittal plane [mm, degrees]"
    return Lever("registration", title, sought, reading=_moved, reason="" if sought else "the registration is fitted")


def _moved(registration: Registration, centre: np.ndarray, v: Values) -> Registration:
    """A registration of which the model turns about the y axis through a centre and then shifts."""
    turn = Rotation.from_rotvec([0.0, np.radians(v.get("turn_deg", 0.0)), 0.0]).as_matrix()
    shift = 1e-3 * np.array([v.get("shift_x_mm", 0.0), 0.0, v.get("shift_z_mm", 0.0)])
    # A point p of the model is seen where c + T (p - c) + d was seen before.
    back = turn.T @ (registration.translation - centre - shift) + centre
    return Registration(turn.T @ registration.rotation, back, registration.scale)


def _resized_reading(registration: Registration, centre: np.ndarray, v: Values) -> Registration:
    """A registration of which the model grows about a centre."""
    s = v["factor"]
    return Registration(registration.rotation, (registration.translation - centre) / s + centre, registration.scale / s)


def _resized(scenario: TransientScenario, v: Values) -> list[str]:
    """The similar problem in the lengths of the model: a body that is s times as large, of the same material, under equal forces.

    With x = s X the equation of motion, rho x'' = div P + rho g, becomes (s^2 rho) X'' = DIV P + (s^2 rho) (g / s), while a force
    on an area is F / s^2. Bones, their motion, and the springs that hold the tongue scale with it.
    """
    s = v["factor"]
    g = [float(x) / s for x in scenario.model.gravity_m_s2]
    settings = [f"model.material={material_times(scenario.model.material, density_factor=s**2)}", f"model.gravity_m_s2={g}"]
    settings += _forces(scenario, s**-2)
    for number, graft in enumerate(scenario.graft, 1):
        if graft.material is not None:
            settings.append(f"graft.{number}.material={material_times(graft.material, density_factor=s**2)}")
    return settings


def _no_viscosity(scenario: TransientScenario) -> str:
    """Why a scenario cannot have another viscosity; "" if it can."""
    damping = scenario.model.damping
    _, branch = from_damping(catalogue.material(scenario.model.material), VISCOSITY.high, 1e-3 * damping.tau_ms)
    chosen = scenario.effects.chosen
    try:
        check_effects((branch, *chosen), scenario.model.element)
    except InputError as error:
        return str(error)
    if any(type(effect) is type(branch) for effect in chosen):
        return "effects.viscoelastic of the scenario already is a viscosity"
    return ""


def _weight(scenario: TransientScenario, v: Values) -> list[str]:
    """A weight in the scenario's own direction, or downwards."""
    g = np.array(scenario.model.gravity_m_s2)
    down = g / np.linalg.norm(g) if g.any() else np.array([0.0, 0.0, -1.0])
    return [f"model.gravity_m_s2={[float(x) for x in v['acceleration_m_s2'] * down]}"]


def _forces(scenario: TransientScenario, factor: float, numbers: Sequence[int] = ()) -> list[str]:
    """Muscle forces multiplied: those of the tables of these numbers, or all."""
    tables = enumerate(scenario.muscle, 1)
    return [f"muscle.{k}.force_N={factor * muscle.force_N!r}" for k, muscle in tables if not numbers or k in numbers]


def _falling(scenario: TransientScenario, v: Values) -> list[str]:
    """A share of the force of every muscle that has no force-length relation gets one, as a table of its own."""
    settings, share = [], v["share"]
    for number, muscle in enumerate(scenario.muscle, 1):
        if muscle.distribution == "stress" and not muscle.force_length:
            table = muscle.model_dump(mode="json", exclude_unset=True)
            settings.append(f"muscle.{number}.force_N={(1.0 - share) * muscle.force_N!r}")
            settings.append(f"muscle.+={toml_value(table | {'force_N': share * muscle.force_N, 'force_length': True})}")
    return settings


def _grafts(scenario: TransientScenario, factor: float) -> list[str]:
    """All grafts with their moduli multiplied."""
    settings = []
    for number, graft in enumerate(scenario.graft, 1):
        if graft.material is None:
            assert graft.stiffness_ratio is not None  # the schema has checked that one of the two is given
            settings.append(f"graft.{number}.stiffness_ratio={factor * graft.stiffness_ratio!r}")
        else:
            settings.append(f"graft.{number}.material={material_times(graft.material, factor)}")
    return settings


def _added(scenario: TransientScenario, name: str, force_N: float) -> list[str]:
    """A further muscle with all its fibres, acting like the strongest one, with the mean activation profile."""
    active = [muscle for muscle in scenario.muscle if muscle.force_N > 0.0]
    if not active:
        return []
    strongest = max(active, key=lambda muscle: muscle.force_N)
    table = strongest.model_dump(mode="json", exclude_unset=True, exclude={"fibres"}) | {"name": name, "force_N": force_N}
    profiles = {_profile_keys(muscle) for muscle in active}
    if len(profiles) > 1:
        table = {key: value for key, value in table.items() if key not in ("start_ms", "rise_ms", "end_ms")}
        table |= {"profile": "table", "table": mean_profile(active)}
    return [f"muscle.+={toml_value(table)}"]


def _profile_keys(muscle: MuscleTable) -> tuple[object, ...]:
    return muscle.profile, muscle.start_ms, muscle.rise_ms, muscle.end_ms, tuple(muscle.table)


def mean_profile(muscles: Sequence[MuscleTable]) -> list[list[float]]:
    """``[time_ms, scale]`` pairs of the mean activation profile of muscles, weighted by their forces."""
    profiles = [(muscle.force_N, profile_of(muscle)) for muscle in muscles]
    total = sum(force for force, _ in profiles)
    pairs: list[list[float]] = []
    for time_s in np.unique(np.concatenate([profile.time_s for _, profile in profiles])):
        sides = [sum(force * _limit(profile, time_s, k) for force, profile in profiles) / total for k in (0, -1)]
        pairs += [[float(1e3 * time_s), float(scale)] for scale in dict.fromkeys(sides)]
    return pairs


def _limit(profile: Profile, time_s: float, side: int) -> float:
    """The scale of a profile just before (0) or just after (-1) a time."""
    here = profile.scale[profile.time_s == time_s]
    return float(here[side]) if len(here) else float(np.interp(time_s, profile.time_s, profile.scale))
