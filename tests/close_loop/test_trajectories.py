"""Sensors of a moving tongue: a hidden lag is found, nothing where nothing is hidden, what is written back is the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_study import SHIFT_M, TURN, simulate_sensors

from explicitfe.inverse.close_loop.comparison import compare
from explicitfe.inverse.close_loop.split import split
from explicitfe.inverse.close_loop.statistics.budget import Budget, SearchLimits
from explicitfe.inverse.close_loop.statistics.covariance import Covariance
from explicitfe.inverse.close_loop.statistics.intervals import intervals
from explicitfe.inverse.close_loop.statistics.noise import scatter
from explicitfe.inverse.close_loop.statistics.refit import refit
from explicitfe.inverse.close_loop.trajectories.close import close_trajectories
from explicitfe.inverse.close_loop.trajectories.trajectories import Trajectories, trajectory_system
from explicitfe.inverse.close_loop.verdict import Outcome, conclude
from explicitfe.inverse.measured.curve import Dataset, Sensor
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError, silent
from explicitfe.results.files.reader import open_result
from explicitfe.simulate.run.run import run

LAG_MS = 15.0
QUICK = {"duration_ms": 50.0, "gestures": ("strong", "weak"), "mesh": "cells = [8, 4, 6]"}
NAMES = [f"turn_{axis}_rad" for axis in "xyz"] + [f"shift_{axis}_mm" for axis in "xyz"]
OTHER_NUMERICS = ("model.element=hex8-stiffness", "analysis.step_us=20.0")


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Sensors in a frame of their own, with a lag that the scenario does not have."""
    hidden = {"*": [f"effects.activation-lag.tau_ms={LAG_MS}"]}
    return simulate_sensors(tmp_path_factory.mktemp("lag") / "data", hidden=hidden, numerics=OTHER_NUMERICS, **QUICK)


@pytest.fixture(scope="module")
def closed(lagging: Dataset) -> tuple[Trajectories, Outcome]:
    system = trajectory_system(lagging, lagging.curves, only=("activation-lag", "gravity"))
    return system, conclude(compare(system, max_effects=1, rows=system.rows))


def test_a_hidden_lag_is_found(closed: tuple[Trajectories, Outcome]) -> None:
    _, outcome = closed
    assert (outcome.verdict, outcome.effects) == ("effect-found", ("activation-lag",))
    fit, covariance = outcome.final.fit, outcome.final.covariance
    assert fit is not None and covariance is not None
    low, high = intervals(fit, covariance)[-1]
    # the 95 % interval is of 1.96 standard deviations; three of them miss in 0.3 % of all data
    assert abs(fit.model.values[-1] - LAG_MS) < 3.0 / 1.96 * 0.5 * (high - low)
    assert high - low < 5.0


def test_a_hidden_jaw_is_found(tmp_path: Path) -> None:
    """The tip comes down on a jaw that the scenario does not have, and that lies 1 mm lower than in the model."""
    hidden = {"*": ['bone.+={name="jaw", shift_mm=[0.0, 0.0, -1.0]}']}
    dataset = simulate_sensors(tmp_path / "data", hidden=hidden, numerics=OTHER_NUMERICS, **QUICK)
    system = trajectory_system(dataset, dataset.curves, only=("gravity", "jaw-contact", "missing-GGh"))
    outcome = conclude(compare(system, max_effects=1, rows=system.rows))
    assert (outcome.verdict, outcome.present) == ("effect-found", ("jaw-contact",))


def test_nothing_is_found_where_nothing_is_hidden(tmp_path: Path) -> None:
    """With the registration given, so that the baseline has no parameter at all."""
    dataset = simulate_sensors(tmp_path / "data", numerics=OTHER_NUMERICS, registration="given", **QUICK)
    system = trajectory_system(dataset, dataset.curves, only=("activation-lag", "gravity", "force-scale", "registration"))
    assert system.base == ()
    outcome = conclude(compare(system, max_effects=1, rows=system.rows))
    assert (outcome.verdict, outcome.effects) == ("no-missing-effect", ())


def test_a_moved_head_costs_no_run(tmp_path: Path) -> None:
    """Sensors that are 2 mm higher than stated, and turned by 2 degrees about their centre."""
    dataset = simulate_sensors(tmp_path / "data", numerics=OTHER_NUMERICS, registration="given", **QUICK)
    system = trajectory_system(dataset, dataset.curves, only=("registration",))
    start = system.start()
    before = np.concatenate(system.answers([start])[0] or [])
    count = system.runs.workers.budget.spent
    (candidate,) = system.candidates(start)
    moved = system.answers([start.plus(candidate.term, (0.0, 2.0, 0.0))])[0]
    vertical = np.concatenate([np.full(len(one.measured), one.id.endswith(" z")) for one in system.series])
    assert moved is not None
    assert np.abs(np.concatenate(moved) - before - 2e-3 * vertical).max() < 1e-12
    assert system.runs.workers.budget.spent == count


def test_the_registration_is_recovered(tmp_path: Path) -> None:
    """Noise of 0.01 mm in 88 positions within 40 mm: below 1e-3 rad, and 0.1 mm at the origin, 120 mm away."""
    dataset = simulate_sensors(tmp_path / "data", noise_mm=0.01, **QUICK)
    system = trajectory_system(dataset, dataset.curves)
    table = system.registration(system.start()).table
    assert np.abs(np.array(table.rotation) - TURN).max() < 1e-3
    assert np.abs(np.array(table.translation) - 1e3 * SHIFT_M).max() < 0.1
    # the search from elsewhere leads to the same place
    start = system.start()
    far = start.at(start.x + np.array([0.05, -0.05, 0.05, 2.0, -2.0, 2.0]))
    again = refit(system, far, Covariance(system.series, system.rows, scatter(system.series, system.rows)))
    assert np.abs(again.model.x - start.x).max() < 1e-2


def test_the_reported_registration_is_that_of_the_sensors(tmp_path: Path) -> None:
    """The parameters are the whole registration, x_model = R x + t, not a correction of the one that the fit starts from."""
    dataset = simulate_sensors(tmp_path / "data", noise_mm=0.01, **QUICK)
    turn_rad, shift_mm = Rotation.from_matrix(TURN).as_rotvec(), 1e3 * SHIFT_M
    sides = split(dataset)
    report = close_trajectories(dataset, sides, ["gravity"], SearchLimits(0, Budget(), 1), silent).report
    estimates = [report.baseline.parameters[name] for name in NAMES]
    intervals = np.array([estimate.ci95 for estimate in estimates])
    assert np.abs([estimate.value for estimate in estimates] - np.array([*turn_rad, *shift_mm])).max() < 0.2
    assert np.all(intervals[:, 0] <= [*turn_rad, *shift_mm]) and np.all(intervals[:, 1] >= [*turn_rad, *shift_mm])


def test_a_written_scenario_gives_the_answers_again(lagging: Dataset, tmp_path: Path) -> None:
    system = trajectory_system(lagging, lagging.curves)
    model = system.start()
    for name, strengths in (
        ("activation-lag", [12.3]),
        ("stiffness", [1.3]),
        ("force-scale", [0.8]),
        ("gravity", [5.0]),
        ("jaw-contact-rough", [1.0, 0.2]),
        ("missing-GGh-share", [0.5]),
        ("rest-shape", [1.05]),
    ):
        model = model.plus(next(c.term for c in system.candidates(model) if c.effect == name), strengths)
    (answer,) = system.answers([model])
    assert answer is not None
    for curve in lagging.curves:
        path = tmp_path / f"{curve.id}.toml"
        path.write_text(system.scenario_text(model, curve), encoding="utf-8")
        assert run(path, tmp_path)["status"] == "finished"
        with open_result(tmp_path / f"{curve.id}.vtkhdf") as result:
            # samples of every millisecond: the rows, of every 5 ms, are among them
            rows = [int(np.searchsorted(result.times, t - 1e-9)) for t in curve.time_s]
            late = (curve.time_s - result.times[rows])[:, None]
            for number, (sensor, place) in enumerate(lagging.sensors.items()):
                u = result.history(f"probe_{place.point}_displacement")
                v = result.history(f"probe_{place.point}_velocity")
                placed = system.registration(model).to_sensors(system.runs.sites.position[number] + u[rows] + late * v[rows])
                for one, y in zip(system.series, answer, strict=True):
                    if one.id.startswith(f"{curve.id} {sensor} "):
                        axis = "xyz".index(one.id[-1])
                        assert np.abs(y + curve.sensors[sensor][0, axis] - placed[:, axis]).max() < 1e-12


def test_other_curves_share_the_models(closed: tuple[Trajectories, Outcome], lagging: Dataset) -> None:
    system, outcome = closed
    model = outcome.final.model
    (both,) = system.answers([model])
    (one,) = system.for_curves(lagging.curves[1:]).answers([model])
    assert both is not None and one is not None
    assert all(np.array_equal(a, b) for a, b in zip(both[-len(one) :], one, strict=True))


def test_answers_are_smooth_in_every_strength(lagging: Dataset) -> None:
    """Secants over 1e-3 and 1e-2 of what lies between two trials differ by the curvature, a percent, and by roughness.

    Without the barrier: a corner that vibrates against it in this scenario does so differently after any change. Without bones:
    points that begin to touch, one by one, bend the answer within less than that.
    """
    first = lagging.curves[0]
    curve = replace(first, conditions={**first.conditions, "settings": [*first.conditions["settings"], "model.barrier=false"]})
    system = trajectory_system(lagging, [curve])
    start = system.start()
    for candidate in system.candidates(start):
        if candidate.reason or "-contact" in candidate.effect:
            continue
        sought = candidate.term.parameters[0].sought
        middle = 0.5 * (sought.coordinate(candidate.trials[-1][0]) + sought.coordinate(sought.none))
        step = middle - sought.coordinate(sought.none)
        model = start.plus(candidate.term, [sought.value(middle), *candidate.trials[-1][1:]])
        along = np.arange(len(model.x)) == len(start.x)
        shifted = [model.at(model.x + k * step * along) for k in (1e-3, 1e-2)]
        here, near, far = (np.concatenate(a) for a in system.answers([model, *shifted]) if a is not None)
        small, large = (near - here) / 1e-3, (far - here) / 1e-2
        assert np.linalg.norm(small - large) < 0.05 * np.linalg.norm(large), candidate.effect


def test_what_cannot_be_compared_is_refused(lagging: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nose"):
        dataset = read_dataset(lagging.path)
        dataset.sensors["TT"] = Sensor("nose")
        trajectory_system(dataset, dataset.curves)
    with pytest.raises(InputError, match="missing-HM"):
        trajectory_system(lagging, lagging.curves, only=("missing-HM",))
