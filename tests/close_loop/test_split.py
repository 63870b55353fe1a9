"""Which curves are fitted and which are held out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from explicitfe.inverse.close_loop.split import split
from explicitfe.inverse.measured.curve import Dataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError


def dataset(folder: Path, curves: dict[str, dict[str, Any]]) -> Dataset:
    """Ramps in compression: id -> rate, strain and lines of the curve."""
    folder.mkdir(exist_ok=True)
    text = 'format = "explicitfe-dataset/1"\nname = "ramps"\ntitle = "Ramps"\ntest = "compression"\n[specimen]\nshape = "point"\n'
    for name, how in curves.items():
        rate, strain = how.get("rate", 0.1), how.get("strain", 0.3)
        text += f'[[curve]]\nid = "{name}"\nfile = "{name}.csv"\n{how.get("lines", "")}\n'
        x = np.linspace(0.0, 1.0, 12)
        rows = "".join(f"{strain / rate * a:.9g},{1.0 - strain * a:.9g},{-900.0 * strain * a:.9g}\n" for a in x)
        (folder / f"{name}.csv").write_text(f"time_s,stretch,nominal_stress_Pa\n{rows}", encoding="utf-8")
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return read_dataset(folder)


def held(sides) -> list[str]:
    return [c.id for c in sides.holdout]


def test_a_condition_between_two_others_is_held_out_before_an_extreme_one(tmp_path):
    """A third of the tests: of three rates the middle one; of five rates two, both inner ones; the ends are fitted."""
    three = split(dataset(tmp_path / "a", {f"r{k}": {"rate": 10.0**-k} for k in range(3)}))
    assert held(three) == ["r1"] and [c.id for c in three.fit] == ["r0", "r2"]
    assert {c.split for c in three.fit} == {"fit"} and {c.split for c in three.holdout} == {"holdout"}
    five = held(split(dataset(tmp_path / "b", {f"r{k}": {"rate": 10.0**-k} for k in range(5)})))
    assert len(five) == 2 and not {"r0", "r4"} & set(five)


def test_two_conditions_are_both_fitted(tmp_path):
    sides = split(dataset(tmp_path, {"slow": {"rate": 0.01}, "fast": {"rate": 1.0}}))
    assert held(sides) == [] and len(sides.fit) == 2


def test_every_condition_that_was_repeated_keeps_one_in_the_fit(tmp_path):
    """Three repeats at each of two rates: the last repeat of each."""
    curves = {
        f"{name}-{k}": {"rate": rate, "lines": f'group = "one"\nconditions = {{ repeat = {k} }}'}
        for name, rate in (("slow", 0.01), ("fast", 1.0))
        for k in (1, 2, 3)
    }
    assert held(split(dataset(tmp_path, curves))) == ["slow-3", "fast-3"]


def test_whole_specimens_are_held_out(tmp_path):
    """Each of three specimens at both rates: the last one."""
    curves = {
        f"{name}-{g}": {"rate": rate, "lines": f'group = "{g}"'} for g in "abc" for name, rate in (("slow", 0.01), ("fast", 1.0))
    }
    assert held(split(dataset(tmp_path, curves))) == ["slow-c", "fast-c"]


def test_constants_are_split_by_themselves(tmp_path):
    """Two directions with constants of their own: each has a fit curve."""
    curves = {
        f"{d}-{k}": {"rate": 10.0**-k, "lines": f'constants = "{d}"\nconditions = {{ direction = "{d}" }}'}
        for d in ("fibre", "cross-fibre")
        for k in range(3)
    }
    sides = split(dataset(tmp_path, curves))
    assert held(sides) == ["fibre-1", "cross-fibre-1"]


def test_cycles_of_one_test_stay_together(tmp_path):
    curves = {
        f"{name}-{k}": {"rate": rate, "lines": f'group = "{name}"\nconditions = {{ cycle = {k}, rate_per_s = {rate} }}'}
        for name, rate in (("slow", 0.01), ("mid", 0.1), ("fast", 1.0))
        for k in (1, 2)
    }
    assert held(split(dataset(tmp_path, curves))) == ["mid-1", "mid-2"]


def test_defects_and_second_digitisations_are_left_out(tmp_path):
    curves = {
        "a": {"lines": 'conditions = { rate_per_s = 0.1, digitisation = "first" }'},
        "again": {"lines": 'conditions = { rate_per_s = 0.1, digitisation = "second" }'},
        "broken": {"rate": 1.0, "lines": 'conditions = { defect = "it slipped" }'},
        "b": {"rate": 0.01},
    }
    sides = split(dataset(tmp_path, curves))
    assert [c.id for c in sides.fit] == ["a", "b"] and held(sides) == []
    assert sides.left_out == {"again": 'a second digitisation of "a"', "broken": "defect: it slipped"}


def test_the_dataset_and_the_command_line_decide(tmp_path):
    """What stands in the file goes before the rule, the command line before both."""
    curves = {f"r{k}": {"rate": 10.0**-k, "lines": f'split = "{"holdout" if k == 2 else "fit"}"'} for k in range(3)}
    data = dataset(tmp_path, curves)
    assert held(split(data)) == ["r2"] and split(data).rule == "as the dataset says"
    assert held(split(data, ["r0"])) == ["r0"] and "--holdout" in split(data, ["r0"]).rule


@pytest.mark.parametrize(
    ("lines", "holdout", "words"),
    [
        ({}, ["r9"], ["`holdout` r9", "no such curve", "did you mean"]),
        ({"r1": 'conditions = { defect = "wet" }'}, ["r1"], ["`holdout` r1", "left out", "wet"]),
        ({"r1": 'constants = "B"'}, ["r1"], ['"r1"', '"B"', "no fit curve"]),
        ({}, ["r0", "r1", "r2"], ["no fit curve"]),
        ({f"r{k}": 'conditions = { defect = "wet" }' for k in range(3)}, [], ["no curve is left"]),
    ],
)
def test_what_cannot_be(tmp_path, lines, holdout, words):
    """A held-out curve without constants is an error that names it."""
    data = dataset(tmp_path, {f"r{k}": {"rate": 10.0**-k, "lines": lines.get(f"r{k}", "")} for k in range(3)})
    with pytest.raises(InputError) as caught:
        split(data, holdout)
    assert all(word in str(caught.value) for word in words), caught.value


def test_what_differs_is_held_out_and_repeats_stay(tmp_path):
    """Two repeats at each of three rates: both of the middle rate, so that a prediction is asked for and not a copy."""
    curves = {
        f"r{k}-{n}": {"rate": 10.0**-k, "lines": f'group = "one"\nconditions = {{ repeat = {n} }}'}
        for k in range(3)
        for n in (1, 2)
    }
    assert held(split(dataset(tmp_path, curves))) == ["r1-1", "r1-2"]


def test_the_size_between_two_others_is_held_out(tmp_path):
    """Cylinders of three heights between platens, pressed alike: the middle one, and no second test of the others."""
    text = 'format = "explicitfe-dataset/1"\nname = "heights"\ntitle = "Heights"\ntest = "compression"\n'
    text += (
        '[specimen]\nshape = "cylinder"\nradius_mm = 10.0\nheight_mm = 10.0\n[tool]\nshape = "platen"\ncontrol = "displacement"\n'
    )
    for height in (5, 10, 20):
        for n in (1, 2):
            text += f'[[curve]]\nid = "h{height}-{n}"\nfile = "{height}-{n}.csv"\nspecimen = {{ height_mm = {height}.0 }}\n'
            text += f"conditions = {{ repeat = {n} }}\n"
            rows = "time_s,displacement_mm,force_N\n0,0,0\n1,1,1\n2,2,2.1\n"
            tmp_path.joinpath(f"{height}-{n}.csv").write_text(rows, encoding="utf-8")
    tmp_path.joinpath("dataset.toml").write_text(text, encoding="utf-8")
    assert held(split(read_dataset(tmp_path))) == ["h10-1", "h10-2"]
