"""Answers that are kept: computed once for the same arrays, and never changed by who gets them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from explicitfe.platform.host.kept import kept


@dataclass(frozen=True)
class Shape:
    points: np.ndarray
    sets: dict[str, np.ndarray]


def test_the_same_arrays_have_one_answer():
    calls = []

    @kept(2)
    def doubled(array: np.ndarray, factor: float = 2.0) -> np.ndarray:
        calls.append(factor)
        return factor * array

    one = np.arange(3.0)
    first = doubled(one)
    assert doubled(one.copy()) is first and doubled(np.arange(6.0)[:3]) is first and len(calls) == 1
    assert doubled(one, 3.0).tolist() == [0.0, 3.0, 6.0] and len(calls) == 2
    for other in (one.astype(np.float32), one.reshape(3, 1), np.array([0.0, 1.0, np.nextafter(2.0, 3.0)])):
        assert doubled(other) is not first
    assert doubled(one) is not first  # it was two answers ago, and is computed again
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 1.0


def test_tables_of_arrays_are_compared_by_content():
    @kept(4)
    def count(shape: Shape) -> Shape:
        return Shape(shape.points + len(shape.sets), {})

    points = np.eye(3)
    first = count(Shape(points, {"a": np.arange(2)}))
    assert count(Shape(points.copy(), {"a": np.arange(2)})) is first
    assert count(Shape(points, {"b": np.arange(2)})) is not first
    assert count(Shape(points, {"a": np.arange(3)})) is not first
    assert not first.points.flags.writeable


def test_an_error_is_no_answer():
    @kept(1)
    def inverse(array: np.ndarray) -> np.ndarray:
        return np.linalg.inv(array)

    for _ in range(2):
        with pytest.raises(np.linalg.LinAlgError):
            inverse(np.zeros((2, 2)))
