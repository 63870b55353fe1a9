"""Titles and names of users are drawn as they stand, whatever they hold; a picture that fails costs no numbers."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from command import command
from identify_cases import write_homogeneous

from explicitfe.app.api.inverse import identify
from explicitfe.app.view import fit, over_time, palatogram, palette, tongue
from explicitfe.app.view.draw import draw
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.results.files import open_result
from explicitfe.simulate.run.run import run

pytestmark = pytest.mark.slow

# A formula that is none, marks of rich and of HTML, a bell, a NUL, half a character, letters that the font lacks.
TEXTS = ["costs 1 $x_{$ to \\frac $ 2 $", "[/red] [bold] <script>", "a\x07\x00\x1b[31mb\udcff", "舌の動き", "word " * 2000]
TINY = """
title = "{title}"
question = "?"
[model]
name = "tongue"
cells = [8, 4, 4]
material = "buchaillard-2009"
damping = {{ alpha_per_s = 40.0 }}
[[muscle]]
name = "GGp"
force_N = 1.0
start_ms = 0.0
end_ms = 3.0
distribution = "along"
[analysis]
duration_ms = 2.0
"""


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few dots: drawing them is most of the time here."""
    monkeypatch.setattr(palette, "DOTS_PER_INCH", 40)
    monkeypatch.setattr(palette.new_figure, "__defaults__", (40,))


@pytest.mark.parametrize("text", TEXTS, ids=["dollars", "marks", "control", "letters", "long"])
def test_any_title_of_a_run_is_drawn(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = tmp_path / "tiny.toml"
    scenario.write_text(TINY.format(title="a title"), encoding="utf-8")
    with open_result(run(scenario, tmp_path)["result"]) as result:
        monkeypatch.setattr(import_module("explicitfe.app.view.heading").Result, "summary", {"title": text})
        assert result.summary["title"] == text
        for picture in (tongue.contour_figure, over_time.probes_figure, over_time.energies_figure, palatogram.palatogram_figure):
            figure = picture(result, len(result.times) - 1)
            if figure is not None:
                palette.save(figure, tmp_path / f"{picture.__name__}.png")
    assert len(list(tmp_path.glob("*.png"))) >= 3


@pytest.mark.parametrize("text", TEXTS, ids=["dollars", "marks", "control", "letters", "long"])
def test_any_title_and_id_of_a_fit_is_drawn(text: str, tmp_path: Path) -> None:
    x = np.linspace(0.0, 1.0, 5)
    labels = {"split": "fit", "x_label": "x", "y_label": "y"}
    columns = {name: x for name in ("x", "measured", "line_x", "line_y", "sd", "predicted")}
    fit.fit(tmp_path / "fit.png", text, [{"id": text, **labels, **columns}], {"C10_Pa": 100.0, "C20_Pa": 50.0})  # type: ignore[typeddict-item]
    assert len(list(tmp_path.glob("*.png"))) == 1


def test_a_dollar_is_a_dollar_also_in_an_indentation(tmp_path: Path) -> None:
    from support import ROOT

    settings = ["model.edge_size_mm=3", "analysis.forces_N=[0.05]", "title='1 $x_{$ 2 $'"]
    summary = run(ROOT / "scenarios/indentation-rear.toml", tmp_path, settings=settings)
    assert len(draw(Path(summary["result"]))["files"]) == 2


def test_numbers_on_a_logarithmic_axis_are_no_formulas(tmp_path: Path) -> None:
    scenario = tmp_path / "tiny.toml"
    scenario.write_text(TINY.format(title="a title"), encoding="utf-8")
    with open_result(run(scenario, tmp_path)["result"]) as result:
        figure = over_time.energies_figure(result, len(result.times) - 1)
        assert figure is not None
        palette.save(figure, tmp_path / "energies.png")
    (axis,) = [axes.yaxis for axes in figure.axes if axes.get_title(loc="left").startswith("Largest error")]
    labels = [label.get_text() for label in (*axis.get_ticklabels(), *axis.get_ticklabels(minor=True))]
    assert any(labels) and not any("$" in label for label in labels)


def test_a_picture_that_fails_costs_no_constants(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    monkeypatch.setattr(import_module("explicitfe.app.view.fit"), "profiles", lambda *given: 1 / 0)
    answer = identify(data, out=tmp_path / "out")
    stored = json.loads((tmp_path / "out/identify.json").read_text(encoding="utf-8"))
    (group,) = stored["groups"].values()
    assert group["constants"]["C10_Pa"]["value"] == pytest.approx(500.0, rel=0.01)
    assert any("an internal error (ZeroDivisionError" in text for text in stored["warnings"])
    assert {Path(name).name for name in answer["files"]} == {path.name for path in (tmp_path / "out").iterdir()}

    monkeypatch.setattr(import_module("explicitfe.app.view.page.close_loop.page"), "curve_charts", lambda *given: 1 / 0)
    assert command(["close-loop", str(data), "--out", str(tmp_path / "loop"), "--json", "--max-effects", "0"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert any("an internal error (ZeroDivisionError" in text for text in report["warnings"])
    assert (tmp_path / "loop/report.json").exists() and (tmp_path / "loop/model.toml").exists()
