"""Fast answers for vibrating markers: what the features of a motion keep, and how effects combine in them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_beam import short_beam

from explicitfe.fem.effects.effect import Sought
from explicitfe.inverse.close_loop.baseline import fitted_baseline
from explicitfe.inverse.close_loop.statistics.system import Scales, candidate
from explicitfe.inverse.close_loop.trajectories.emulate import emulator_near
from explicitfe.inverse.close_loop.trajectories.emulator import Responses, Vibration, add_change, change_of, vibration_of
from explicitfe.inverse.close_loop.trajectories.mapping import fit_by_mapping
from explicitfe.inverse.close_loop.trajectories.trajectories import trajectory_system
from explicitfe.inverse.measured.curve import TrajectoryDataset
from explicitfe.inverse.measured.read import read_dataset

TIME_S = np.linspace(0.0, 1.5, 301)


def oscillator(frequency_Hz: float = 8.0, decay_per_s: float = 3.0, end: float = 6e-3, ripple: float = 0.0) -> np.ndarray:
    """Closed form of two coordinates of a damped oscillator that is released at rest, with a ripple of a higher mode."""
    w = 2.0 * np.pi * frequency_Hz
    wave = np.exp(-decay_per_s * TIME_S) * (np.cos(w * TIME_S) + decay_per_s / w * np.sin(w * TIME_S))
    higher = ripple * np.exp(-4.0 * TIME_S) * np.sin(6.27 * w * TIME_S) ** 2
    return np.column_stack([end * (1.0 - wave) + higher, -0.5 * end * (1.0 - wave)])


def features(y: np.ndarray, first: Vibration | None = None) -> Vibration:
    one = vibration_of(TIME_S, y, first)
    assert one is not None
    return one


def test_features_give_the_motion_back():
    """The damped vibration and its remainder are the motion, also where it is no single damped vibration."""
    y = oscillator(ripple=4e-4)
    assert features(y).at(TIME_S) == pytest.approx(y, abs=2e-6)  # a spline with two knots for each row
    assert features(y).at(np.array([-0.1, 0.0])) == pytest.approx(np.zeros((2, 2)), abs=1e-12)


def test_a_change_leads_from_one_motion_to_another():
    before = features(oscillator())
    after = features(oscillator(6.0, 5.0, 9e-3, ripple=2e-4), before)
    again = add_change(before, change_of(before, after, 1e-2))
    assert again.at(TIME_S) == pytest.approx(after.at(TIME_S), abs=1e-12)


def test_effects_multiply_where_a_body_comes_to_rest():
    """A softer and longer body sags by the product of both factors, (1 / 0.8) 1.06^4 of the sag, and not by their sum."""
    before = features(oscillator())
    softer, longer = (features(oscillator(end=6e-3 * factor), before) for factor in (1.25, 1.06**4))
    both = add_change(before, change_of(before, softer, 1e-2) + change_of(before, longer, 1e-2))
    assert both.end[0] / before.end[0] == pytest.approx(1.25 * 1.06**4, rel=1e-4)
    assert np.abs(both.amplitude[0] / before.amplitude[0]) == pytest.approx(1.25 * 1.06**4, rel=1e-4)


def test_a_coordinate_that_hardly_moves_has_differences():
    """Its sign may change, of which there is no logarithm."""
    before = features(np.column_stack([oscillator()[:, 0], 1e-5 * np.ones_like(TIME_S) * (TIME_S > 0.0)]))
    after = features(np.column_stack([oscillator()[:, 0], -2e-5 * np.ones_like(TIME_S) * (TIME_S > 0.0)]), before)
    again = add_change(before, change_of(before, after, 1e-2))
    assert again.end == pytest.approx(after.end, abs=1e-12)


def test_responses_are_exact_at_their_trials_and_linear_between_them():
    """Of trials at 1, 2 and 4 with changes that are not proportional; of the other sign as of the first trial, with its sign."""
    changes = np.array([[1.0], [3.0], [4.0]])
    one = Responses(np.array([[1.0], [2.0], [4.0]]), {"a": changes})
    for strength, change in ((0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (1.5, 2.0), (2.0, 3.0), (3.0, 3.5), (4.0, 4.0), (6.0, 5.0)):
        assert one.at("a", np.array([strength])) == pytest.approx([change])
    assert one.at("a", np.array([-0.5])) == pytest.approx([-0.5])
    both = Responses(np.array([[-1.0], [2.0]]), {"a": np.array([[5.0], [6.0]])})
    assert both.at("a", np.array([-0.5])) == pytest.approx([2.5])
    assert both.at("a", np.array([1.0])) == pytest.approx([3.0])


def test_a_response_that_is_not_proportional_has_all_its_strengths_tried():
    sought = Sought((2.0, 8.0, 1.0), 0.0, 10.0)
    usual = candidate("delay", 1, "delay", {"ms": sought}, Scales())
    every = candidate("delay", 1, "delay", {"ms": replace(sought, every=True)}, Scales())
    assert usual.trials == ((2.0,),)
    assert every.trials == ((1.0,), (2.0,), (8.0,))


def test_a_fit_is_right_if_fast_answers_are_wrong_by_a_factor(tmp_path: Path):
    """Responses of a third of their size mislead fast answers; the simulator's derivatives of the features mend that."""
    dataset = read_dataset(short_beam(tmp_path / "beam"))
    assert isinstance(dataset, TrajectoryDataset)
    system = trajectory_system(dataset, [curve for curve in dataset.curves if curve.split != "holdout"], only=["load-mass"])
    system, covariance, baseline = fitted_baseline(system, system.rows, lambda stage, share: None)
    mass = system.candidates(baseline.model)[0]
    emulator = emulator_near(system, baseline.model, [mass])
    assert emulator is not None
    known = emulator.responses["load-mass"]
    wrong = replace(known, changes={curve: change / 3.0 for curve, change in known.changes.items()})
    emulator = replace(emulator, responses={**emulator.responses, "load-mass": wrong})
    fit, mapped = fit_by_mapping(system, emulator, baseline.model.plus(mass.term, mass.trials[0]), covariance)
    assert mapped.model is fit.model
    assert fit.whitened < 0.02 * baseline.whitened
    assert fit.model.values[-1] == pytest.approx(1.0, abs=0.05)  # all of the load is a mass (ATTRIBUTION.md)
