"""Masses that a scenario lacks: a load that is a weight, markers, and a body that is heavier than stated."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever, Values, material_times
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.scenario.loads import LoadTable
from explicitfe.simulate.scenario.transient import TransientScenario

# Share of a load that is a weight, with its inertia.
LOAD_SHARE = Sought((0.5, 1.0, 1.5), 0.0, 2.0)
# Mass of each marker relative to that of the body, and factor of the density.
MARKER_SHARE = (0.003, 0.01, 0.03)
DENSITY = Sought((0.8, 0.9, 0.95, 1.05, 1.1, 1.25), 0.5, 2.0, kind="log", none=1.0)
# A load is a weight only if it acts along gravity: the cosine of the angle between them.
ALONG_GRAVITY = 0.98
KG_PER_G = 1e-3


def levers(test: Experiment) -> dict[str, Lever]:
    """The share of the loads that are weights, the mass of each marker, and the density."""
    weights = any(_is_weight(load, test.gravity_m_s2) for scenario in test.scenarios for load in scenario.load)
    own_mesh = test.scenario.model.name is None
    mass_g = test.mass_kg / KG_PER_G
    marker = Sought(tuple(share * mass_g for share in MARKER_SHARE), 0.0, 10.0 * MARKER_SHARE[-1] * mass_g)
    no_weight = "" if weights else "no curve has a [[load]] with a force along gravity"
    return {
        "load-mass": Lever(
            "load-mass",
            "share of the load that is a mass, fixed to the body",
            {"share": LOAD_SHARE},
            lambda scenario, v: _as_mass(scenario, v["share"]),
            reason=no_weight,
        ),
        "load-mass-hanging": Lever(
            "load-mass",
            "share of the load that is a mass, on a string",
            {"share": LOAD_SHARE},
            lambda scenario, v: _as_mass(scenario, v["share"], hanging=True),
            reason=no_weight,
        ),
        "marker-mass": Lever(
            "marker-mass",
            "mass of each marker [g]",
            {"mass_g": marker},
            lambda scenario, v: _on_markers(test, v),
            reason="" if test.markers and own_mesh else "only markers (at_mm) on a box or a mesh file can have a mass",
        ),
        "density": Lever(
            "density",
            "factor of the density",
            {"factor": DENSITY},
            lambda scenario, v: [f"model.material={material_times(scenario.model.material, 1.0, v['factor'])}"],
            reason="" if own_mesh else "the density of the tongue is known",
        ),
    }


def _is_weight(load: LoadTable, gravity: np.ndarray) -> bool:
    force = np.array(load.force_N or (0.0, 0.0, 0.0))
    size = float(np.linalg.norm(force) * np.linalg.norm(gravity))
    return size > 0.0 and not load.follows and float(force @ gravity) > ALONG_GRAVITY * size


def _as_mass(scenario: TransientScenario, share: float, *, hanging: bool = False) -> list[str]:
    """A share of each load along gravity becomes a mass of the same weight."""
    gravity = np.array(scenario.model.gravity_m_s2)
    settings = []
    for number, load in enumerate(scenario.load, 1):
        if not _is_weight(load, gravity):
            continue
        force = np.array(load.force_N)
        mass_g = load.mass_g + share * float(np.linalg.norm(force) / np.linalg.norm(gravity)) / KG_PER_G
        settings.append(f"load.{number}.force_N={[float(x) for x in (1.0 - share) * force]}")
        settings.append(f"load.{number}.mass_g={mass_g!r}")
        if hanging and mass_g > 0.0:
            settings.append(f"load.{number}.string_slack_mm=0.0")
        elif mass_g > 0.0 and load.start_ms > 0.0:  # a fixed mass is there from the start
            settings.append(f"load.{number}.start_ms=0.0")
    return settings


def _on_markers(test: Experiment, v: Values) -> list[str]:
    """A mass at the foot of each marker that moves."""
    settings, scale = [], np.array(test.scenario.model.scale)
    for foot in test.feet_m:
        at_mm = [float(x) for x in 1e3 * foot / scale]  # a point of the body before model.scale
        settings.append(f"load.+={toml_value({'at_mm': at_mm, 'mass_g': v['mass_g']})}")
    return settings if v["mass_g"] > 0.0 else []
