"""What an error of a stated length does to the answers, as a floor of the search."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.close_loop.thresholds import THRESHOLDS
from explicitfe.inverse.measured.read import read_dataset

DATASET = """format = "explicitfe-dataset/1"
name = "platens"
title = "Cylinders of two heights between platens"
test = "compression"
[specimen]
shape = "cylinder"
radius_mm = 15.0
height_mm = 20.0
base = "frictionless"
[tool]
shape = "platen"
control = "displacement"
friction = 0.0
[[curve]]
id = "tall"
file = "tall.csv"
[[curve]]
id = "flat"
file = "flat.csv"
specimen = { height_mm = 10.0 }
"""


def test_stated_lengths_err(tmp_path: Path):
    """A radius changes the force as its square. Each of two heights errs by itself; at a stretch of 0.8 the force on a specimen
    that is a share taller is that of a strain smaller by this share.
    """
    (tmp_path / "dataset.toml").write_text(DATASET, encoding="utf-8")
    for name, height_mm in (("tall", 20.0), ("flat", 10.0)):
        d = np.linspace(0.0, 0.2 * height_mm, 12)
        rows = "".join(f"{t:g},{x:.9g},{0.3 * x / height_mm:.9g}\n" for t, x in enumerate(d))
        (tmp_path / f"{name}.csv").write_text(f"time_s,displacement_mm,force_N\n{rows}", encoding="utf-8")
    dataset = read_dataset(tmp_path)
    system = Specimens(dataset, dataset.curves, Simulator(1))
    model = system.start()
    (usual,) = system.answers([model])
    changed = system.assumptions(model)
    share = THRESHOLDS.stated_length_error_share
    of = f"{100.0 * share:g} % of specimen"
    by_radius = changed.pop(f"{of}.radius_mm = 15")
    for own, before in zip(by_radius, usual, strict=True):
        np.testing.assert_allclose(own[1:], (1.0 + share) ** 2 * before[1:], rtol=1e-9)
    assert set(changed) == {f"{of}.height_mm = 20", f"{of}.height_mm = 10"}
    tall, flat = (changed[f"{of}.height_mm = {height}"] for height in (20, 10))
    np.testing.assert_array_equal(tall[1], usual[1])
    np.testing.assert_array_equal(flat[0], usual[0])
    assert flat[1][-1] == pytest.approx(tall[0][-1], rel=1e-6)
    assert -3.0 * share < tall[0][-1] / usual[0][-1] - 1.0 < -share
