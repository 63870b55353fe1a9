"""Distances of an outline from a range of outlines, on circles: there they are known.

A polygon of 400 chords lies up to r (1 - cos(pi / 400)) = 4e-4 mm inside of its circle for r = 13 mm. Both ends of the open line
are left out: its normals, from one-sided differences there, may miss the end of another line.
"""

from __future__ import annotations

import numpy as np
import pytest
from mri_outlines import band_of, cell, clockwise, outside

CHORD_MM = 1e-3
RADII_MM = np.linspace(8.0, 12.0, 21)  # 5 and 95 % of them: 8.2 and 11.8 mm


def circle(radius_mm: float, back_mm: float = 0.0) -> np.ndarray:
    """A closed clockwise circle, (401, 2) mm."""
    angle = np.linspace(np.pi, -np.pi, 401)
    return radius_mm * np.column_stack([np.cos(angle), np.sin(angle)]) + [back_mm, 0.0]


BAND = band_of(np.array([circle(radius) for radius in RADII_MM]))


@pytest.mark.parametrize(("radius_mm", "off_mm"), [(7.0, -1.2), (8.1, -0.1), (9.0, 0.0), (11.7, 0.0), (13.0, 1.2)])
def test_a_circle_has_its_distance_from_a_range_of_circles(radius_mm: float, off_mm: float) -> None:
    np.testing.assert_allclose(outside(BAND, circle(radius_mm))[1:-1], off_mm, atol=CHORD_MM)


def test_a_shifted_circle_leaves_the_range_on_both_sides() -> None:
    """Along a normal at an angle, a circle of radius r shifted by d is d cos + sqrt(r^2 - d^2 sin^2) from the middle."""
    cosine, sine = BAND.normal.T
    at = 3.0 * cosine + np.sqrt(100.0 - (3.0 * sine) ** 2)
    exact = np.maximum(at - 11.8, 0.0) - np.maximum(8.2 - at, 0.0)
    np.testing.assert_allclose(outside(BAND, circle(10.0, 3.0))[1:-1], exact[1:-1], atol=CHORD_MM)
    assert exact.min() < -1.1 and exact.max() > 1.1


def test_only_a_line_in_the_direction_of_the_mean_counts() -> None:
    """The other side of a thin tongue is no place of its upper side."""
    assert np.isnan(outside(BAND, circle(13.0)[::-1])).all()
    np.testing.assert_array_equal(clockwise(circle(13.0)[::-1]), circle(13.0))


def test_a_line_further_away_than_any_tongue_is_not_compared() -> None:
    off = outside(BAND, circle(30.0))
    assert np.isnan(off).all()
    assert cell(off) == "no crossing"


def test_a_cell_tells_the_largest_distance_and_the_share() -> None:
    assert cell(np.array([0.0, 0.5, -2.25, np.nan, 0.0])) == "−2.2 (50 %)"
    assert cell(np.array([0.0, 0.04, np.nan])) == "within"
