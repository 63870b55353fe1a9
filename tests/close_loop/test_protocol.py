"""Estimate of the noise-free course of an imposed column: corners, covariance, noise, and what it changes in the evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from outside_data import SHARED_DATA, needs
from scipy.stats import binom, chi2, norm

from explicitfe.inverse.close_loop.statistics.protocol import EstimatedProtocol, estimate_protocol
from explicitfe.inverse.measured.curve import programme_of, sd_of
from explicitfe.inverse.measured.read import read_dataset

SEEDS = 200
# Two-sided probability at which a sum over all seeds counts as wrong.
LEAST_PROBABILITY = 1e-4


@dataclass(frozen=True)
class Machine:
    """A protocol with knots, or a function of time, and the noise of its rows."""

    time_s: np.ndarray
    knots_s: tuple[float, ...]
    values: tuple[float, ...]
    sd: float
    smooth: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def true(self) -> np.ndarray:
        return self.smooth(self.time_s) if self.smooth else np.interp(self.time_s, self.knots_s, self.values)

    def rows(self, seed: int) -> np.ndarray:
        return self.true + self.sd * np.random.default_rng(seed).standard_normal(len(self.time_s))


def _dense_at_corners(knots: tuple[float, ...], count: int) -> np.ndarray:
    """Rows that are unequally spaced, as a recorder sets them that samples ramps more densely."""
    equal = np.linspace(knots[0], knots[-1], count // 2)
    after = [corner + (knots[-1] - knots[0]) * np.geomspace(1e-3, 0.1, count // 8) for corner in knots[:-1]]
    every = np.unique(np.round(np.concatenate([equal, *after]), 4))
    return every[every <= knots[-1]]


RAMP_HOLD = (0.0, 3.03, 33.0, 36.1)
CYCLES = (0.0, 15.0, 30.0, 45.0, 60.0, 85.0, 110.0, 135.0, 160.0)
STEPS = (0.0, 1.0, 20.0, 21.0, 40.0, 41.0, 60.0, 61.0, 80.0, 81.0, 100.0)
MACHINES = {
    "ramp and hold": Machine(_dense_at_corners(RAMP_HOLD, 300), RAMP_HOLD, (1.0, 0.7, 0.7, 1.0), 1e-3),
    "fast ramp": Machine(np.linspace(0.0, 60.0, 300), (0.0, 0.27, 40.1, 40.5, 60.0), (1.0, 1.5, 1.5, 1.0, 1.0), 4e-4),
    "one ramp": Machine(np.linspace(0.0, 500.0, 268), (0.0, 500.0), (0.0, 0.5), 2e-4),
    "cycles": Machine(np.linspace(0.0, 160.0, 400), CYCLES, (1.0, 1.3, 1.0, 1.3, 1.0, 1.5, 1.0, 1.5, 1.0), 4e-4),
    "noisy cycles": Machine(np.linspace(0.0, 160.0, 400), CYCLES, (1.0, 1.3, 1.0, 1.3, 1.0, 1.5, 1.0, 1.5, 1.0), 2e-2),
    "steps": Machine(np.linspace(0.0, 100.0, 1000), STEPS, (0.0, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.4, 0.4, 0.0, 0.0), 1e-3),
    "force steps": Machine(5.0 * np.arange(16), (0.0, 40.0, 75.0), (0.0, 0.8, 0.1), 2e-3),
    "sine": Machine(np.linspace(0.0, 10.0, 400), (), (), 1e-3, lambda t: 0.1 * (1.0 - np.cos(0.6 * np.pi * t))),
}
POLYLINES = [name for name, machine in MACHINES.items() if machine.smooth is None]


@cache
def _estimates(name: str, stated: float | None, seeds: int = SEEDS) -> list[EstimatedProtocol]:
    machine = MACHINES[name]
    return [estimate_protocol(machine.time_s, machine.rows(seed), stated) for seed in range(seeds)]


def _assert_is_chi2(total: float, free: int) -> None:
    assert LEAST_PROBABILITY / 2.0 < chi2.cdf(total, free) < 1.0 - LEAST_PROBABILITY / 2.0, (total, free)


def _line(t: np.ndarray, sd: float, at: float) -> tuple[np.ndarray, float]:
    """Weights (k,) of the rows in the value of a fitted line at a time, and its variance."""
    basis = np.column_stack([np.ones(len(t)), t - at])
    weights = np.linalg.pinv(basis)[0]
    return weights, float(sd**2 * weights @ weights)


def _sd_of_corners(machine: Machine) -> np.ndarray:
    """Standard deviation of each corner: where two independently fitted lines intersect."""
    t, knots = machine.time_s, np.array(machine.knots_s)
    slopes = np.diff(machine.values) / np.diff(knots)
    sds = []
    for i, corner in enumerate(knots[1:-1]):
        before, after = (t >= knots[i]) & (t <= corner), (t >= corner) & (t <= knots[i + 2])
        variance = _line(t[before], machine.sd, corner)[1] + _line(t[after], machine.sd, corner)[1]
        sds.append(np.sqrt(variance) / abs(slopes[i + 1] - slopes[i]))
    return np.array(sds)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(MACHINES))
def test_true_course_lies_in_the_modes_and_residual_is_noise(name):
    machine, inside, outside, sizes, residual, free = MACHINES[name], 0.0, 0.0, 0, 0.0, 0
    for estimate in _estimates(name, machine.sd):
        error = (machine.true - estimate.fitted) / machine.sd
        size = np.linalg.lstsq(estimate.modes / machine.sd, error, rcond=None)[0]
        inside += float(size @ size)
        outside += float(error @ error - size @ size)
        sizes += len(size)
        residual, free = residual + estimate.chi2, free + estimate.free
        assert estimate.row_sd == 0.0
    _assert_is_chi2(inside, sizes)
    _assert_is_chi2(residual, free)
    # What the form cannot represent stays below a tenth of the variance that the modes state.
    assert outside < 0.1 * inside


@pytest.mark.slow
@pytest.mark.parametrize("name", POLYLINES)
def test_corners_are_found_where_they_are_and_no_others(name):
    machine = MACHINES[name]
    estimates = _estimates(name, machine.sd)
    right = [estimate for estimate in estimates if len(estimate.time_s) == len(machine.knots_s)]
    assert len(right) >= 0.95 * SEEDS
    if len(machine.knots_s) == 2:
        return
    z = (np.array([estimate.time_s[1:-1] for estimate in right]) - machine.knots_s[1:-1]) / _sd_of_corners(machine)
    allowed = binom.isf(LEAST_PROBABILITY, z.size, 2.0 * norm.sf(3.0))
    assert (np.abs(z) > 3.0).sum() <= max(allowed, 1), np.sqrt((z**2).mean(axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("name", list(MACHINES))
def test_unknown_noise_is_estimated_within_its_error(name):
    machine = MACHINES[name]
    estimates = [estimate for estimate in _estimates(name, None, seeds=50) if estimate.form != "rows"]
    assert len(estimates) >= 48
    for estimate in estimates:
        assert estimate.noise_sd == estimate.estimated_sd
    ratio = np.array([estimate.noise_sd / machine.sd for estimate in estimates])
    # The mean of s^2 over the truth has the standard error sqrt(2 / free / n).
    error = np.sqrt(2.0 / estimates[0].free / len(estimates))
    assert abs((ratio**2).mean() - 1.0) < 4.0 * error


@pytest.mark.parametrize("name", ["ramp and hold", "cycles", "sine"])
@pytest.mark.parametrize("factor", [1.0 / 3.0, 3.0])
def test_wrong_stated_noise_is_shown_by_chi2_and_can_be_replaced(name, factor):
    machine = MACHINES[name]
    for estimate in _estimates(name, factor * machine.sd, seeds=20):
        assert estimate.probability < 1e-6
        assert estimate.noise_sd == factor * machine.sd
        assert estimate.estimated_sd == pytest.approx(machine.sd, rel=4.0 / np.sqrt(2.0 * estimate.free))
        own = estimate.with_noise(estimate.estimated_sd)
        assert own.chi2 == pytest.approx(own.free)
        np.testing.assert_allclose(own.modes, estimate.modes * own.noise_sd / estimate.noise_sd)


def test_right_stated_noise_is_seldom_doubted():
    doubted = sum(estimate.probability < 0.01 for estimate in _estimates("ramp and hold", 1e-3))
    assert doubted <= binom.isf(LEAST_PROBABILITY, SEEDS, 0.01)


def test_rows_stay_free_where_no_simple_course_fits():
    t = 5.0 * np.arange(16)
    uneven = 0.8 * np.cumsum(np.random.default_rng(0).uniform(0.2, 1.8, 16)) / 16.0
    for seed in range(20):
        column = uneven + 2e-3 * np.random.default_rng(seed).standard_normal(16)
        estimate = estimate_protocol(t, column, 2e-3)
        assert estimate.form == "rows"
        assert estimate.modes.shape == (16, 0)
        assert estimate.row_sd == 2e-3
        np.testing.assert_array_equal(estimate.fitted, column)
        np.testing.assert_array_equal(estimate.at(t), column)


def test_recorded_wandering_of_a_drive_is_kept():
    rng = np.random.default_rng(0)
    wander = np.cumsum(1e-3 * rng.standard_normal(800))
    t = np.linspace(0.0, 80.0, 800)
    column = 0.01 * t + wander + 1e-5 * rng.standard_normal(800)
    estimate = estimate_protocol(t, column, 1e-5)
    assert estimate.form == "rows"
    np.testing.assert_array_equal(estimate.fitted, column)


@pytest.mark.parametrize("stated", [0.0, None, 1e-3])
def test_column_without_noise_is_returned_with_the_corner_between_its_rows(stated):
    t = np.array([0.0, 0.9, 2.3, 3.4, 4.6, 5.2, 6.8, 7.9, 9.1, 12.0, 14.7, 20.0])
    column = 1.0 - np.minimum(0.05 * t, 0.3)
    estimate = estimate_protocol(t, column, stated)
    assert estimate.form == "column"
    np.testing.assert_array_equal(estimate.fitted, column)
    assert estimate.modes.shape == (12, 0)
    assert estimate.row_sd == estimate.noise_sd == 0.0
    np.testing.assert_allclose(np.setdiff1d(estimate.time_s, t), [6.0], rtol=1e-6)
    assert estimate.at(np.array([6.0]))[0] == pytest.approx(0.7)


def test_nominal_corner_is_used_where_no_row_determines_it():
    t = np.linspace(0.0, 100.0, 201)
    column = np.minimum(2.0 * t, 0.3) + 1e-3 * np.random.default_rng(1).standard_normal(201)
    conditions = {"rate_per_s": 2.0, "max_strain": 0.3, "hold_s": 100.0}
    estimate = estimate_protocol(t, column, 1e-3, conditions)
    assert estimate.form == "polyline"
    assert estimate.time_s[1] == pytest.approx(0.15, abs=1e-3)
    wrong = estimate_protocol(t, column, 1e-3, conditions | {"rate_per_s": 0.02})
    assert wrong.time_s[1] < t[1]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 9])
def test_few_rows(count):
    t = np.arange(count, dtype=float)
    column = 0.1 * t + 1e-3 * np.random.default_rng(count).standard_normal(count)
    estimate = estimate_protocol(t, column, 1e-3)
    assert estimate.fitted.shape == (count,)
    assert np.all(np.diff(estimate.time_s) > 0.0)
    np.testing.assert_allclose(estimate.fitted, 0.1 * t, atol=5e-3)


def test_constant_column():
    estimate = estimate_protocol(np.arange(20.0), np.full(20, 0.3), None)
    np.testing.assert_array_equal(estimate.fitted, np.full(20, 0.3))
    assert estimate.form == "column"


OTHER_PROGRAMS = SHARED_DATA / "other-programs"


@needs(OTHER_PROGRAMS)
def test_protocols_of_other_programs_are_polylines_of_the_stated_noise():
    total, free = 0.0, 0
    for path in sorted(OTHER_PROGRAMS.glob("*/dataset.toml")):
        for curve in read_dataset(path).curves:
            estimate = estimate_protocol(curve.time_s, programme_of(curve), sd_of(curve, curve.imposed), curve.conditions)
            assert estimate.form == "polyline", curve.id
            total, free = total + estimate.chi2, free + estimate.free
    _assert_is_chi2(total, free)
