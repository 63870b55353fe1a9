"""Strokes of movements with known figures: least jerk, half a sine, noise, and movements that follow each other."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.results.measure.strokes import strokes

STEP_S = 0.001


def least_jerk(share: np.ndarray) -> np.ndarray:
    """From 0 to 1 while ``share`` goes from 0 to 1, with least jerk (Flash and Hogan 1985); at rest before and after."""
    share = np.clip(share, 0.0, 1.0)
    return 10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5


def to_and_fro(distance_m: float, duration_s: float, count: int = 4, step_s: float = STEP_S) -> tuple[np.ndarray, np.ndarray]:
    """A point that goes ``count`` times along a line in the plane and back, without a stop: times and positions (t, 2)."""
    times = np.arange(0.0, count * duration_s + 0.5 * step_s, step_s)
    number = np.minimum((times / duration_s).astype(int), count - 1)
    share = least_jerk(times / duration_s - number)
    along = np.where(number % 2 == 0, share, 1.0 - share)
    return times, distance_m * along[:, None] * [0.6, -0.8]


def test_least_jerk_has_its_peak_at_1_875_times_its_mean_speed():
    times, place = to_and_fro(0.005, 0.09)
    every = strokes(times, place)
    assert len(every) == 4
    for number, stroke in enumerate(every):
        # speed differenced over 2 ms: off by (dt / T)^2 of the peak, 1e-3 or less; both ends and the peak lie on samples, 1 ms of
        # 90 apart, so the duration is off by two of them, and the share of the peak by one
        assert stroke.start_s == pytest.approx(0.09 * number, abs=STEP_S)
        assert stroke.duration_s == pytest.approx(0.09, abs=2.0 * STEP_S)
        assert stroke.distance_m == pytest.approx(0.005, rel=1e-3)
        assert stroke.peak_speed_m_s == pytest.approx(1.875 * 0.005 / 0.09, rel=2e-3)
        assert stroke.peak_over_mean == pytest.approx(1.875, rel=0.02)
        assert stroke.peak_share == pytest.approx(0.5, abs=0.015)


def test_a_sine_has_its_peak_at_half_pi_times_its_mean_speed():
    times = np.arange(0.0, 1.0, STEP_S)
    place = 0.003 * np.cos(np.pi * times / 0.1)[:, None]  # half a period of 100 ms over 6 mm
    every = strokes(times, place)
    assert len(every) == 10
    for stroke in every[1:-1]:
        assert stroke.distance_m == pytest.approx(0.006, rel=1e-3)
        assert stroke.peak_speed_m_s == pytest.approx(0.5 * np.pi * 0.006 / 0.1, rel=1e-3)
        assert stroke.peak_over_mean == pytest.approx(0.5 * np.pi, rel=0.02)


def test_a_share_of_the_peak_bounds_a_stroke_that_begins_and_ends_at_rest():
    times = np.arange(0.0, 0.4, STEP_S)
    place = 0.005 * least_jerk((times - 0.15) / 0.09)[:, None]
    whole = strokes(times, place)
    assert [(stroke.start_s, stroke.end_s) for stroke in whole] == [pytest.approx((0.15, 0.24), abs=2.0 * STEP_S)]
    # The speed is 30 s^2 (1 - s)^2 D / T: a fifth of its peak where s (1 - s) = sqrt(0.2) / 4, from s = 0.1282 to 0.8718.
    (stroke,) = strokes(times, place, edge_share=0.2)
    edge = 0.5 - np.sqrt(0.25 - 0.25 * np.sqrt(0.2))
    assert stroke.start_s == pytest.approx(0.15 + 0.09 * edge, abs=2e-4)
    assert stroke.duration_s == pytest.approx(0.09 * (1.0 - 2.0 * edge), rel=3e-3)
    assert stroke.distance_m == pytest.approx(0.005 * (1.0 - 2.0 * float(least_jerk(np.array(edge)))), rel=3e-3)
    assert stroke.peak_over_mean == pytest.approx(1.444, rel=5e-3)


def test_a_movement_that_starts_fast_and_comes_to_rest_slowly():
    # The speed is (t / tau)^2 exp(-t / tau) times 0.1 m/s: its peak is 4 exp(-2) of that, at 2 tau.
    tau = 0.02
    times = np.arange(0.0, 0.5, STEP_S)
    speed = (times / tau) ** 2 * np.exp(-times / tau)
    place = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * STEP_S])
    (stroke,) = strokes(times, 0.1 * place[:, None], edge_share=0.2)
    assert stroke.peak_s == pytest.approx(2.0 * tau, abs=1e-4)
    assert stroke.peak_speed_m_s == pytest.approx(0.4 * np.exp(-2.0), rel=1e-3)
    assert stroke.peak_share < 0.4


def test_noise_makes_no_strokes():
    random = np.random.default_rng(3)
    times = np.arange(0.0, 3.0, 0.01)
    noise = 0.02e-3 * random.standard_normal((len(times), 2))
    assert strokes(times, noise, cutoff_hz=20.0) == []
    moves = 0.01 * (random.standard_normal(2) * least_jerk((times - 1.0) / 0.1)[:, None])
    assert len(strokes(times, moves + noise, cutoff_hz=20.0, edge_share=0.2)) == 1


def test_samples_of_10_ms_and_the_filter_leave_peak_and_distance():
    # A filter at 20 Hz passes what a movement of 100 ms is about: below 1 % at the peak, and the rest of the ends of the record.
    fine = strokes(*to_and_fro(0.006, 0.1, 10), edge_share=0.2)[2:-2]
    coarse = strokes(*to_and_fro(0.006, 0.1, 10, step_s=0.01), cutoff_hz=20.0, edge_share=0.2)[2:-2]
    assert len(fine) == len(coarse) == 6
    for a, b in zip(fine, coarse, strict=True):
        assert b.peak_speed_m_s == pytest.approx(a.peak_speed_m_s, rel=0.05)
        assert b.distance_m == pytest.approx(a.distance_m, rel=0.05)
        assert b.duration_s == pytest.approx(a.duration_s, abs=0.005)
