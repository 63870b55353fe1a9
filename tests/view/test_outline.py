"""Outlines as they are drawn: smooth curves through the points of a cut."""

from __future__ import annotations

import numpy as np
from support import result_writer

from explicitfe.app.view.outline import PIECES_BETWEEN_POINTS, outline_mm, smooth_loop
from explicitfe.results.files import FINISHED, open_result
from explicitfe.results.measure.sections import midsagittal
from explicitfe.simulate.anatomy import catalogue


def test_a_curve_goes_through_its_points_and_is_round():
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    curve = smooth_loop(circle)
    np.testing.assert_array_equal(curve[::PIECES_BETWEEN_POINTS], circle)
    assert np.abs(np.linalg.norm(curve, axis=1) - 1.0).max() < 2e-3  # straight lines miss it by 0.034


def test_long_and_short_pieces_make_no_loops():
    points = np.array([[0.0, 0], [10, 0], [10, 0.1], [10.1, 1], [0, 1]])
    curve = smooth_loop(points)
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(np.concatenate([curve, curve[:2]]), axis=0).T[::-1])))
    assert np.isclose(turns.sum(), 2.0 * np.pi, atol=0.5)
    assert curve.min() > -0.6 and curve[:, 0].max() < 11.0


def test_only_a_tongue_is_drawn_round(tmp_path):
    mesh = catalogue.built_in("tongue", cells=(8, 4, 4)).mesh
    cut = midsagittal(mesh)
    straight = 1e3 * cut.outline(mesh.points)
    for name, model in (("tongue", {"airway": {}}), ("other", {})):
        path = tmp_path / f"{name}.vtkhdf"
        with result_writer(path, mesh=mesh, model=model) as result:
            result.sample(0.0, {}, {"displacement": np.zeros_like(mesh.points)}, {})
            result.finish(FINISHED, "", {})
        with open_result(path) as result:
            drawn = outline_mm(result, cut, mesh.points)
        if name == "other":
            np.testing.assert_array_equal(drawn, straight)
        else:
            np.testing.assert_array_equal(drawn[::PIECES_BETWEEN_POINTS][: len(straight) - 1], straight[:-1])
            assert len(drawn) == PIECES_BETWEEN_POINTS * (len(straight) - 2) + 2
