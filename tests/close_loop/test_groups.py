"""Constants by specimen, where equal tests say that one set cannot serve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from explicitfe import close_loop
from explicitfe.inverse.close_loop.specimens.groups import grouping_of
from explicitfe.inverse.measured.curve import SpecimenDataset
from explicitfe.inverse.measured.read import read_dataset

pytestmark = pytest.mark.slow

C10, C20, NOISE_PA = 900.0, 300.0, 2.0


def dataset(
    folder: Path, stiffness: dict[str, float], tests: list[tuple[float, float]], seed: int = 0, scatter: float = 0.0
) -> SpecimenDataset:
    """Ramps of an incompressible Yeoh tissue: spot -> its factor; a test is a strain and a rate. The closed form is exact."""
    rng = np.random.default_rng(seed)
    text = 'format = "explicitfe-dataset/1"\nname = "spots"\ntitle = "Spots"\ntest = "compression"\n[specimen]\nshape = "point"\n'
    text += f"[noise]\nstress_sd_Pa = {NOISE_PA}\nstretch_sd = 0.0\n"
    for spot, factor in stiffness.items():
        for k, (strain, rate) in enumerate(tests):
            name = f"{spot}-{k}"
            text += f'[[curve]]\nid = "{name}"\nfile = "{name}.csv"\nconditions = {{ spot = "{spot}", rate_per_s = {rate} }}\n'
            stretch = 1.0 - strain * np.linspace(0.0, 1.0, 30)
            I1 = stretch**2 + 2.0 / stretch - 3.0
            stress = factor * (1.0 + scatter * rng.standard_normal()) * 2.0 * (stretch - stretch**-2) * (C10 + 2.0 * C20 * I1)
            stress = stress + NOISE_PA * rng.standard_normal(len(stress)) * (stretch < 1.0)
            rows = zip((1.0 - stretch) / rate, stretch, stress, strict=True)
            lines = "".join(f"{t:.9g},{x:.9g},{y:.9g}\n" for t, x, y in rows)
            (folder / f"{name}.csv").write_text(f"time_s,stretch,nominal_stress_Pa\n{lines}", encoding="utf-8")
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return read_dataset(folder)


THREE_SPOTS = {"a": 1.0, "b": 1.6, "c": 2.6}
THREE_TESTS = [(0.1, 0.1), (0.2, 0.1), (0.3, 0.1)]


def test_spots_that_differ_have_constants_of_their_own(tmp_path):
    """The ratio is that of the stiffness, though the tests go to different strains."""
    grouping = grouping_of(dataset(tmp_path, THREE_SPOTS, THREE_TESTS))
    assert grouping is not None and grouping.by == "spot"
    assert grouping.ratio == pytest.approx(2.6, rel=0.01) and grouping.p is not None and grouping.p < 1e-6
    assert grouping.spread == pytest.approx(np.std(np.log([1.0, 1.6, 2.6]), ddof=1), rel=0.01)


def test_what_is_held_out_is_not_looked_at(tmp_path):
    """With all of the spots but one held out nothing can be compared, and a spot without a fitted curve gets no constants."""
    data = dataset(tmp_path, THREE_SPOTS, THREE_TESTS)
    assert grouping_of(data, [c.id for c in data.curves if c.conditions["spot"] != "a"]) is None


def test_a_difference_that_may_be_the_tests_is_none_of_the_specimens(tmp_path):
    """Each spot with a strain of its own: the stiffer one may be strained more."""
    data = dataset(tmp_path, {"a": 1.0}, [(0.1, 0.1)])
    other = tmp_path / "other"
    other.mkdir()
    more = dataset(other, {"b": 2.0}, [(0.3, 0.1)])
    both = replace(data, curves=(*data.curves, *more.curves))
    assert grouping_of(both) is None


@pytest.mark.parametrize("scatter", [0.0, 0.05, 0.15])
def test_specimens_of_one_stiffness_share_their_constants(tmp_path, scatter):
    """Ten datasets of four equal specimens, whose tests scatter by so much: none is split."""
    for seed in range(100, 110):
        folder = tmp_path / str(seed)
        folder.mkdir()
        assert grouping_of(dataset(folder, dict.fromkeys("abcd", 1.0), THREE_TESTS[:2], seed, scatter)) is None


def test_the_loop_fits_each_spot_and_gives_mean_and_spread(tmp_path):
    """A plain Yeoh tissue in three spots: nothing is missing, and the mean of all spots is far less certain than each."""
    dataset(tmp_path, THREE_SPOTS, THREE_TESTS)
    report = close_loop(tmp_path, processes=1)
    assert report.verdict == "no-missing-effect", report.sentence
    assert set(report.final.parameters["C10_Pa"]) == {"a", "b", "c"}
    assert report.groups is not None and report.groups.by == "spot" and report.groups.text in report.warnings
    mean = report.groups.constants["C10_Pa"].mean
    assert mean is not None and mean.value == pytest.approx(C10 * (1.0 * 1.6 * 2.6) ** (1.0 / 3.0), rel=0.02)
    assert mean.ci95[1] / mean.ci95[0] > 5.0
    assert len(report.split.holdout) == 3  # a strain between two others in each spot
