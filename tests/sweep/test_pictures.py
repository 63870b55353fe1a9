"""Pictures of a sweep, of rows that are written here: which there are, what they say, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from written_sweeps import FORCES, indices, write_sweep

from explicitfe.app.view.page.sweep.heat_map import heat_maps
from explicitfe.app.view.page.sweep.page import sweep_page
from explicitfe.app.view.page.sweep.pictures import PICTURES, against, draw_sweep
from explicitfe.platform.errors import InputError
from explicitfe.simulate.sweep import members as designs
from explicitfe.simulate.sweep.factors import factors_of
from explicitfe.simulate.sweep.page_data import sweep_to_draw


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Random draws, of which some failed."""
    return write_sweep(tmp_path_factory.mktemp("pictures") / "draws", designs.random(factors_of(FORCES), 60, 0))


def test_the_command(folder, tmp_path, capsys):
    words = ["plot", str(folder), "--out", str(tmp_path), "--json"]
    assert command(words) == 0
    answer = check_answer("plot", capsys.readouterr().out)
    # The draws have no indices, and no two factors on a grid.
    assert [Path(path).name for path in answer["files"]] == ["draws-outlines.png", "draws-effects.png"]
    assert answer["warnings"] == [] and all(Path(path).stat().st_size > 10_000 for path in answer["files"])
    assert command(words) == 2
    assert "add --overwrite" in capsys.readouterr().out
    assert command(["plot", str(folder), "--only", "indices", "--out", str(tmp_path), "--json"]) == 0
    assert check_answer("plot", capsys.readouterr().out)["warnings"] == [f"{folder} has no data for: indices."]
    assert command(["plot", str(folder), "--times", "20"]) == 2
    assert "a sweep, which has no times" in capsys.readouterr().err


def test_maps_over_two_factors(tmp_path):
    """A cell is the mean of its runs; the rows of the page go from high to low, and both pictures come of the same numbers."""
    members = designs.grid(factors_of(["muscle.GGp.force_N=1:3:3", "muscle.GGa.force_N=0,0.5"]))
    sweep = sweep_to_draw(write_sweep(tmp_path / "grid", members, design="grid"))
    one = next(iter(heat_maps(sweep)))
    at = {tuple(map(float, pair)): value for pair, value in zip(members.values, one.measure.values, strict=True)}
    assert one.mean.shape == (2, 3) and one.mean[1, 2] == at[3.0, 0.5] and one.mean[0, 1] == at[2.0, 0.0]
    (top, cells), _ = one.table
    assert top == "0.5" and float(cells[2][0]) == pytest.approx(at[3.0, 0.5], abs=0.006 * np.ptp(one.mean))
    assert {strength for _, row in one.table for _, strength in row} >= {"6", "50"}
    assert command(["plot", str(tmp_path / "grid"), "--only", "maps", "--json"]) == 0
    text, _ = sweep_page(sweep)
    assert text.count('class="heat"') == len(list(heat_maps(sweep))) and f'<th scope="row">{top}</th>' in text


def test_two_columns_against_each_other(folder):
    figure = PICTURES["effects"](sweep_to_draw(folder))
    assert figure is not None and figure.axes[0].get_ylabel() == "tip: up (mm)"
    sweep = sweep_to_draw(folder)
    axes = against(sweep, "muscle.GGp.force_N", "points.tip.up_mm").axes[0]
    (finished,) = [line for line in axes.lines if not line.get_label().startswith("_")]  # those that folded have no measure
    x, y = finished.get_data()
    assert len(x) == 51 and y == pytest.approx(2.0 * x)
    assert axes.get_xlabel() == "GGp force (N)" and axes.get_ylabel() == "tip: up (mm)"


@pytest.mark.parametrize(
    ("only", "says"),
    [
        ("outline", 'no picture "outline"; did you mean "outlines"'),
        ("points.tip.up:steps", 'no column "points.tip.up"; did you mean "points.tip.up_mm"'),
    ],
)
def test_what_is_not_there(folder, tmp_path, only, says):
    with pytest.raises(InputError, match=says):
        draw_sweep(sweep_to_draw, folder, tmp_path, only=[only])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_indices_have_their_intervals(tmp_path, method):
    pytest.importorskip("SALib")
    folder = write_sweep(tmp_path / "sweep", getattr(designs, method)(factors_of(FORCES), 8, 0), design=method)
    (folder / "sensitivity.json").write_text(json.dumps(indices(method, "points.tip.up_mm")))
    figure = PICTURES["indices"](sweep_to_draw(folder))
    assert figure is not None
    panel = figure.axes[0]
    widths = [bar.get_width() for bars in panel.containers if hasattr(bars, "patches") for bar in bars.patches]
    assert widths == pytest.approx([0.75, -0.001, 0.5, -0.001] if method == "sobol" else [8.0, -0.001])
    assert panel.get_xlabel() == ("share of the variance" if method == "sobol" else "elementary effect (mm)")
