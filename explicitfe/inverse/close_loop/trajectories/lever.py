"""A quantity of a scenario that may be wrong: what every candidate cause of a trajectory consists of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from explicitfe.fem.effects.effect import Sought
from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.fem.mesh.surface_points import projected_areas
from explicitfe.fem.model.gravity import nodal_mass
from explicitfe.inverse.close_loop.trajectories.emulator import vibration_of
from explicitfe.inverse.measured.curve import TrajectoryDataset
from explicitfe.inverse.measured.registration import Registration
from explicitfe.platform.host.toml_text import toml_value
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.scenario.transient import TransientScenario

Values = Mapping[str, float]
Settings = Callable[[TransientScenario, Values], list[str]]
Reading = Callable[[Registration, np.ndarray, Values], Registration]


@dataclass(frozen=True)
class Lever:
    """A quantity of a scenario that may be wrong: one term of a form of a cause.

    Attributes
    ----------
    cause : the cause of which it is a form, by the name of its usual form.
    title : description.
    sought : search range of each parameter in this scenario, in the unit of its name.
    settings : ``key=value`` pairs that set the parameters in a scenario; a reading has none.
    reading : for a quantity that only changes how positions are read, and so costs no run: the registration with it, from the
        one without it, the centre (3,) m of the sensors at rest, and the values.
    lag_s : for a lag of the recording: how much later than it happens the motion is seen [s].
    stand_off_m : for markers: how much further they stand off the body [m].
    reason : why the lever does not apply to this scenario; "" if it does.
    """

    cause: str
    title: str
    sought: Mapping[str, Sought]
    settings: Settings = lambda scenario, values: []
    reading: Reading | None = None
    lag_s: Callable[[Values], float] = lambda values: 0.0
    stand_off_m: Callable[[Values], float] = lambda values: 0.0
    reason: str = ""


@dataclass(frozen=True)
class Experiment:
    """What candidates depend on.

    Attributes
    ----------
    scenario : as its file states it.
    anatomy : its body.
    dataset : the recording.
    scenarios : that of each curve.
    """

    scenario: TransientScenario
    anatomy: Anatomy
    dataset: TrajectoryDataset
    scenarios: Sequence[TransientScenario]

    @property
    def duration_s(self) -> float:
        """Longest time that a curve lasts from its start [s]."""
        lasts = [float(curve.time_s[-1] - (curve.start_s or 0.0)) for curve in self.dataset.curves]
        return max(lasts, default=1e-3 * self.scenario.analysis.duration_ms)

    @property
    def interval_s(self) -> float:
        """Longest sampling interval of a curve [s]."""
        return max((float(np.median(np.diff(curve.time_s))) for curve in self.dataset.curves), default=1e-2)

    @property
    def frequency_rad_s(self) -> float:
        """Angular frequency at which the markers of most curves vibrate [rad/s]; of one period where they do not."""
        known = []
        for curve in self.dataset.curves:
            y = np.concatenate([y for y in curve.sensors.values() if np.isfinite(y).all()], axis=1)
            vibration = vibration_of(curve.time_s[1:], np.diff(y, axis=0))  # in which the step of a release is short
            known += [float(np.exp(vibration.rate[0]))] if vibration else []
        return float(np.median(known)) if known else 2.0 * np.pi / self.duration_s

    @property
    def extent_m(self) -> float:
        """Largest extent of the body [m]."""
        return float(np.ptp(self.anatomy.mesh.points, axis=0).max())

    @property
    def gravity_m_s2(self) -> np.ndarray:
        """(3,) acceleration of gravity."""
        return np.array(self.scenario.model.gravity_m_s2)

    @property
    def mass_kg(self) -> float:
        """Mass of the body [kg]."""
        return float(nodal_mass(self.anatomy.mesh, catalogue.material(self.scenario.model.material)).sum())

    @property
    def silhouette_m2(self) -> float:
        """Mean area of the silhouette along the three axes [m^2]."""
        return float(projected_areas(self.anatomy.mesh).sum(axis=0).mean())

    @cached_property
    def feet_m(self) -> list[np.ndarray]:
        """Points (3,) m of the body that are nearest to the markers that move."""
        return list(locate_in_mesh(self.anatomy.mesh, np.array(self.markers), np.inf).position)

    @property
    def markers(self) -> list[np.ndarray]:
        """Positions (3,) m of the markers that move."""
        return [s.at_m for s in self.dataset.sensors.values() if s.at_m is not None and not s.fixed]


def around(sought: Sought, now: float) -> Sought:
    """Strengths about the one that the scenario has: none at all, and larger ones by what would be tried without it."""
    more = tuple(now + v for v in sought.values)
    return replace(sought, values=(0.0, *more) if now > 0.0 else more, high=now + sought.high, none=now)


def material_times(material: str | Law, factor: float = 1.0, density_factor: float = 1.0) -> str:
    """A material with its moduli and its density multiplied, as a setting has it."""
    law = catalogue.material(material)
    table = law.model_dump(exclude_defaults=True) | {"law": law.law, "density_kg_m3": density_factor * law.density_kg_m3}
    return toml_value({key: factor * v if key.endswith("_Pa") else v for key, v in table.items() if key != "source"})
