"""The report of a movement with contact, springs and viscosity that returns to rest: energies, forces, commands, texts."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from command import command
from gesture import write_gesture
from support import ROOT

from explicitfe.app.view.draw import draw
from explicitfe.app.view.energy_balance import energy_balance
from explicitfe.app.view.over_time import energies_figure
from explicitfe.app.view.page.chart import CHART_SIDE, Line, chart, round_ticks
from explicitfe.app.view.page.run.charts import BALANCE_TITLE, charts_of
from explicitfe.app.view.page.run.parts import scenario_words
from explicitfe.app.view.page.run.write import write_report
from explicitfe.app.view.page.words import motion_at_end, paragraphs, speed
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.results.measure.measure import measure
from explicitfe.simulate.run.run import run

STOP = ROOT / "scenarios" / "alveolar-t.toml"
COARSE = "model.cells=[8,4,4]"


@pytest.fixture(scope="module")
def stop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A [t] with jaw, palate, hyoid springs and viscous tissue that returns to rest."""
    return Path(run(STOP, tmp_path_factory.mktemp("stop"), settings=[COARSE])["result"])


@pytest.fixture(scope="module")
def page(stop: Path) -> str:
    return unescape(Path(write_report([stop])["report"]).read_text(encoding="utf-8"))


def test_the_energies_that_are_drawn_add_up_to_the_work(stop: Path) -> None:
    """Bands of the page, read back from their points, and areas of the figure: each sum is the work within the stated error."""
    with open_result(stop) as result:
        (charts,) = charts_of([result])
        balance = energy_balance(result)
        figure = energies_figure(result, 0)
        work = result.history("external_work")
        error_J = float(result.history("balance_error")[-1]) * max(
            np.abs(work).max(), result.history("kinetic_energy").max(), result.history("internal_energy").max()
        )
    assert balance is not None and figure is not None
    lost = {term.column for term, _ in balance.terms if term.is_loss}
    assert lost == {"material_loss", "damping_loss", "contact_loss"}
    assert {"contact_energy", "tied_energy"} <= {term.column for term, _ in balance.terms}
    np.testing.assert_allclose(balance.edges()[-1], work, atol=1.01 * error_J)
    assert error_J < 1e-4 * np.abs(work).max()  # without material loss two thirds of the work would be missing at the end

    shown = next(one for one in charts if one.title == BALANCE_TITLE)
    low, high = shown.y_range
    *bands, line = shown.series
    assert [band.name for band in bands] == [term.label for term, _ in balance.terms] and line.name == "external work"
    drawn = {series.name: np.array([p.split(",") for p in series.pieces[0].split()], dtype=float) for series in shown.series}
    thickness = 0.0
    for band in bands:
        points = drawn[band.name]
        half = len(points) // 2
        x = points[:half, 0]
        thickness = thickness + np.interp(drawn[line.name][:, 0], x, points[:half, 1] - points[half:, 1][::-1])
    factor, _ = balance.unit()
    to_value = (high - low) / CHART_SIDE
    rounding = (len(bands) + 1) * 0.1 * to_value  # points have one decimal place
    np.testing.assert_allclose(
        thickness * to_value, high - drawn[line.name][:, 1] * to_value, atol=rounding + 1.01 * factor * error_J
    )

    areas = figure.axes[0 if len(figure.axes) == 3 else 1].collections
    tops = [area.get_paths()[0].vertices[:, 1].max() for area in areas if area.get_paths()]
    assert max(tops) == pytest.approx(factor * work.max(), abs=2.0 * factor * error_J)


def test_each_contact_force_has_one_name(stop: Path, page: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The resultant and the sum of normal forces differ; page, terminal and JSON name both, with the same numbers."""
    middle = measure(stop, 0.1).contact["jaw"]
    assert middle.resultant_N is not None and middle.resultant_N < 0.9 * middle.force_N
    components = (middle.forward_N, middle.up_N, middle.right_N)
    assert middle.resultant_N == pytest.approx(np.linalg.norm(np.array(components, dtype=float)))
    assert command(["measure", str(stop), "--at-ms", "100"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    shown = re.search(r"contact: jaw area \d+ mm², resultant force ([\d.]+) N, normal force sum ([\d.]+) N", text)
    assert shown is not None
    assert [float(value) for value in shown.groups()] == pytest.approx([middle.resultant_N, middle.force_N], rel=0.05)
    assert command(["measure", str(stop), "--at-ms", "100", "--json"]) == 0
    stored = json.loads(capsys.readouterr().out)["results"][0]["contact"]["jaw"]
    assert (stored["resultant_N"], stored["force_N"]) == (middle.resultant_N, middle.force_N)
    assert "Resultant contact force" in page and ">Contact force<" not in page
    assert re.search(r"contact with the jaw at the end</td><td>\d+ mm², resultant force .* N, normal force sum", page)


def test_a_movement_that_has_returned_is_settled_everywhere(stop: Path, page: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Summary, measures, terminal and page agree, and no figure of a speed above 0 is 0."""
    answer = measure(stop)
    assert answer.body.settled and answer.body.largest_so_far_mm > 100.0 * answer.body.largest_displacement_mm
    assert all(point.time_to_90_ms is None for point in answer.points.values())
    assert answer.points["tip"].largest_mm > 3.0
    with open_result(stop) as result:
        assert result.summary["settled"]
    assert f"settled, fastest node {speed(answer.body.fastest_mm_s)} mm/s" in page
    assert command(["inspect", str(stop)]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "still moving" not in text and "fastest node 0 mm/s" not in text
    assert (speed(0.0), speed(0.25), speed(9.94), speed(12.3)) == ("0", "0.25", "9.9", "12")
    assert motion_at_end(True, 0.0) == "at rest" and motion_at_end(False, 0.004) == "still moving, fastest node 0.0040 mm/s"


def test_the_page_has_the_command_as_it_is_typed(stop: Path, page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The name of a scenario that comes with explicitfe instead of a path of the installation; own files by their path."""
    assert f"explicitfe run alveolar-t --set '{COARSE}'\n" in page
    assert str(ROOT) not in page.split("<h2>Commands and scenario")[1].split("<details>")[0].split("inspect")[0]
    text = STOP.read_text(encoding="utf-8")
    assert scenario_words(Path("/elsewhere/scenarios/alveolar-t.toml"), f"# --set x=1\n{text}") == "alveolar-t"
    reworded = text.replace('expect = """', 'expect = """In other words: ')
    assert reworded != text and scenario_words(Path("/elsewhere/alveolar-t.toml"), reworded) == "alveolar-t"
    assert scenario_words(STOP, "title = 'of an earlier version'\n") == "alveolar-t"
    assert scenario_words(tmp_path / "alveolar-t.toml", "title = 'my own'\n") == str(tmp_path / "alveolar-t.toml")
    monkeypatch.chdir(tmp_path)
    assert scenario_words(tmp_path / "mine.toml", text) == "mine.toml"


def test_expected_numbers_stand_next_to_those_of_the_run(tmp_path: Path) -> None:
    """With their difference; they are left out if a setting makes the run another one."""
    small = STOP.read_text(encoding="utf-8").partition("[[expected]]")[0].replace("duration_ms = 400.0", "duration_ms = 10.0")
    scenario = tmp_path / "small.toml"
    tip = "points.tip = { forward_mm = 1.0, up_mm = 0.25, sideways_mm = 0 }"
    scenario.write_text(f"{small}\n[[expected]]\ntime_ms = 10\n{tip}\nairway.formants.F1_hz = 500\n".replace("medium", "coarse"))

    def page(*settings: str) -> str:
        summary = run(scenario, tmp_path, settings=settings, overwrite=True)
        return Path(write_report([Path(summary["result"])], tmp_path / "page.html", overwrite=True)["report"]).read_text()

    seen = measure(Path(run(scenario, tmp_path)["result"]), formants=True)
    forward_mm, f1_hz = seen.points["tip"].forward_mm, seen.airway.formants[0].frequency_hz
    for settings in ((), ("analysis.threads=1", "record.every_ms=1")):
        text = page(*settings)
        cells = f'10</td><td class="n">1.00</td><td class="n">{forward_mm:z.2f}</td><td class="n">{forward_mm - 1.0:+z.2f}</td>'
        assert f'<td>tip forward (mm)</td><td class="n">{cells}' in text
        assert f'<td class="n">500</td><td class="n">{f1_hz:.0f}</td>' in text
        assert '<td>tip sideways (mm)</td><td class="n">10</td><td class="n">0.00</td><td class="n">–</td>' in text
    assert "Expected result" not in page("muscle.SL.force_N=0.1")
    scenario.write_text(scenario.read_text().replace("time_ms = 10", "time_ms = 90"))
    assert '90</td><td class="n">1.00</td></tr>' in page()  # the run has no such time


def test_texts_of_a_scenario_are_paragraphs(tmp_path: Path) -> None:
    """Line breaks of the file are no line breaks of the page."""
    path = write_gesture(tmp_path / "push.vtkhdf", question="Does it\nmove?\n\nWhere\nto?\n")
    text = Path(write_report([path])["report"]).read_text(encoding="utf-8")
    assert '<p class="lede">Does it move?</p>\n<p class="lede">Where to?</p>' in text
    assert paragraphs("a\nb\n\n c \n") == ["a b", "c"] and paragraphs(" \n") == []


@pytest.mark.parametrize(("every_ms", "samples"), [(3.0, 1), (2.0, 2)])
def test_few_samples(every_ms: float, samples: int, tmp_path: Path) -> None:
    """Runs that store hardly anything have a page and pictures all the same."""
    settings = [COARSE, "analysis.duration_ms=2", f"record.every_ms={every_ms:g}"]
    path = Path(run(STOP, tmp_path, settings=settings)["result"])
    with open_result(path) as result:
        assert len(result.times) in (samples, samples + 1)  # the last state is stored too
    write_report([path, path], tmp_path / "both.html")
    drawn = draw(path, only=["contour", "coronal", "probes", "energies", "palatogram"], file_format="svg")
    assert len(drawn["files"]) >= 2
    assert measure(path).time_ms == pytest.approx(2.0)


def test_a_result_with_one_sample_has_a_page(tmp_path: Path) -> None:
    for frames in (1, 2, 3):
        path = write_gesture(tmp_path / f"{frames}.vtkhdf", frames=frames)
        text = Path(write_report([path])["report"]).read_text(encoding="utf-8")
        assert ('class="chart"' in text) == (frames > 1)
        drawn = draw(path, only=["contour", "probes", "energies"])
        assert len(drawn["files"]) == (1 if frames == 1 else 3)
    with pytest.raises(InputError, match="no sample"):
        write_report([write_gesture(tmp_path / "none.vtkhdf", frames=0)])


def test_charts_of_a_single_value() -> None:
    """A line of which one value is finite has an axis, and a dot in the place of a line."""
    one = chart("t", [Line("a", np.array([0.0, 200.0]), np.array([np.nan, 3.0]))])
    assert one is not None and one.x_range == (0.0, 200.0)
    first, second = one.series[0].pieces[0].split()
    assert first == second
    same = chart("t", [Line("a", np.array([5.0, 5.0]), np.array([1.0, 2.0]))], x_range=(5.0, 5.0))
    assert same is not None and same.x_range[0] < 5.0 < same.x_range[1]


@pytest.mark.parametrize(("low", "high"), [(-1.48e-9, -1.31e-9), (8.65e-12, 1.137e-11), (1.2345e8, 1.2346e8)])
def test_marks_with_powers_of_ten_differ(low: float, high: float) -> None:
    numbers, words = round_ticks(low, high)
    assert len(set(words)) == len(numbers) >= 2
    assert [float(word) for word in words] == pytest.approx(numbers, rel=1e-9)
