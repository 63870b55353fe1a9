"""The page of a sweep: what it says of rows that are written here, and how it behaves in a browser. Nothing is simulated."""

from __future__ import annotations

import json
import re
import shutil
from base64 import b64decode
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any
from zlib import decompress

import numpy as np
import pytest
from answers import check_answer
from command import command
from written_sweeps import FORCES, indices, write_sweep

from explicitfe.app.view.page.sweep.effects import main_effect
from explicitfe.app.view.page.sweep.report import write_sweep_report
from explicitfe.app.view.page.sweep.scatter import MOST_SCATTERED_MEMBERS, MOST_SCATTERED_NUMBERS, sample_of
from explicitfe.platform.errors import InputError
from explicitfe.results.documents.sweep_to_draw import SweepColumn
from explicitfe.results.documents.sweep_words import factors_in_words, measure_in_words
from explicitfe.results.documents.units_of_keys import words_and_unit
from explicitfe.simulate.sweep import members as designs
from explicitfe.simulate.sweep.factors import factor_of, factors_of
from explicitfe.simulate.sweep.outlines import spread_out
from explicitfe.simulate.sweep.page_data import MAIN_MEASURES, factor_columns, sweep_to_draw
from explicitfe.simulate.sweep.repeating import begun_sweep, commands_of, vary_text
from explicitfe.simulate.sweep.rows import Row

EVIL = "</style><script>alert(1)</script>"
PATIENCE_MS = 60_000  # of a machine that does much else


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random draws, of which some failed."""
    members = designs.random(factors_of(FORCES), 60, 0)
    return write_sweep(tmp_path_factory.mktemp("page") / "draws of mine", members)


def words(page: str) -> str:
    """What a reader sees, on one line."""
    body = re.sub(r"<(style|script|svg)[^>]*>.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def page_of(folder: Path, out: Path) -> str:
    write_sweep_report(sweep_to_draw, folder, out, overwrite=True)
    return out.read_text(encoding="utf-8")


def test_what_the_page_says(folder: Path, tmp_path: Path) -> None:
    page = page_of(folder, tmp_path / "page.html")
    text = words(page)
    for part in (
        "Vowel [i]: posterior and anterior genioglossus",
        "60 random samples of 2 keys (seed 0).",
        "51 of 60 runs finished 9 did not finish",
        "120 runs per minute and worker (median 0.50 s per run)",
        "GGp force (N)",
        "24 of 51 runs",
        "tip: up (mm)",
        "contact with the palate: area (mm²)",
        "All 60 runs that have a row.",
        "inverted 9 at 3.5 ms element 3 folded. 3, 10, 17, 24, 31, 38, …",
        "explicitfe sweep vowel-i",
        "--vary muscle.GGp.force_N=0:4",
        "--vary muscle.GGa.force_N=0:1",
        "--random 60",
    ):
        assert part in text, part
    assert page.count('class="body"') == 24 and page.count('class="rest"') == 25
    assert "right (mm)" not in text  # a number that is rounding
    assert re.findall(r"https?://[^\"]+", page) == ["http://www.w3.org/2000/svg"]  # a name, which nobody looks up


def test_the_outlines_are_drawn_beside_rest_and_palate(folder: Path) -> None:
    drawn = sweep_to_draw(folder).drawn
    numbers = [member.number for member in drawn]
    assert len(set(numbers)) == 24 and not any(number % 7 == 3 for number in numbers)
    forces = [float(dict(member.settings)["GGp force"].split()[0]) for member in drawn]
    assert forces == sorted(forces)
    np.testing.assert_allclose(drawn[0].outline[2], 2 * [10.0 + 0.1 * numbers[0]])
    assert np.ptp(drawn[0].at_rest[:, 0]) > 30.0  # a tongue, mm
    near = np.abs(drawn[0].palate[:, 0] - drawn[0].at_rest[:, 0].mean()) < 10.0
    assert drawn[0].palate[near, 1].min() > drawn[0].at_rest[:, 1].mean()
    odd = [member for member in drawn if member.number % 2]
    assert odd and all(member.remark == "1 warning" for member in odd)


def test_a_scenario_whose_files_are_gone(tmp_path: Path) -> None:
    """Outlines are then drawn against that of the first member."""
    folder = write_sweep(tmp_path / "sweep", designs.random(factors_of(FORCES), 8, 0))
    path = folder / "sweep.json"
    begun = json.loads(path.read_text())
    begun["scenario_text"] = begun["scenario_text"].replace('name = "tongue"', 'file = "gone.toml"')
    begun["settings"] = []
    path.write_text(json.dumps(begun))
    text = words(page_of(folder, tmp_path / "page.html"))
    assert "Dashed: the first of these runs; the outline at rest is not available." in text and "is the palate" not in text


@pytest.mark.parametrize("count", [9, 60])
def test_main_effects(count: int) -> None:
    """Few values stay what they are, many are binned, and the share that a factor explains is said."""
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 4.0, count).repeat(10)
    y = 2.0 * x + rng.normal(0.0, 0.1, len(x))
    factor, other = SweepColumn("a", "a", "N", x), SweepColumn("b", "b", "", rng.permutation(x))
    measure = SweepColumn("m", "m", "mm", np.where(np.arange(len(x)) == 0, np.nan, y))
    effect = main_effect(factor, measure)
    assert effect is not None and effect.binned == (count > 12) and len(effect.x) == (9 if count == 9 else 12)
    np.testing.assert_allclose(effect.mean, 2.0 * effect.x, atol=0.15)
    # the sd of ten numbers scatters by 0.1 / sqrt(18) = 0.024: of nine such, three times that and a little
    assert effect.share > 0.97 and (count > 12 or effect.sd == pytest.approx(np.full(9, 0.1), abs=0.08))
    unrelated = main_effect(other, measure)
    assert unrelated is not None and unrelated.share < 0.1
    assert main_effect(SweepColumn("c", "c", "", np.ones(len(x))), measure) is None


def test_words_are_levels() -> None:
    columns = factor_columns(["model.material", "model.cells", "model.barrier", "analysis.duration_ms"], [
        ("b", [8, 4, 4], True, 4), ("a", [8, 4, 4], False, 5.0), ("b", [10, 6, 6], True, 6),
    ])  # fmt: skip
    assert [column.levels for column in columns] == [("b", "a"), ("[8, 4, 4]", "[10, 6, 6]"), ("true", "false"), ()]
    assert columns[0].values.tolist() == [0.0, 1.0, 0.0] and columns[3].title == "duration (ms)"


def test_names_in_words() -> None:
    assert measure_in_words("points.tip.peak_speed_mm_s") == ("tip: peak speed", "mm/s")
    assert measure_in_words("contact.jaw.cells.left.front.area_mm2") == ("contact with the jaw, left front: area", "mm²")
    assert measure_in_words("grooves.back.depth_mm") == ("groove at the back: depth", "mm")
    assert measure_in_words("load.2.force_N") == ("load 2: force", "N")
    assert words_and_unit("rate_mm_s") == ("rate", "mm/s") and words_and_unit("tau_s") == ("tau", "s")
    assert factors_in_words(["muscle.GGp.force_N", "model.material"]) == [("GGp force", "N"), ("material", "")]
    same = ["a.GGp.force_N", "b.GGp.force_N"]
    assert factors_in_words(same) == [(same[0], "N"), (same[1], "N")]


@pytest.mark.parametrize(
    "text",
    [
        "muscle.GGp.force_N=0:4",
        "muscle.GGp.force_N=0:4:9",
        "muscle.GGp.force_N=0.1:0.3:3",
        "muscle.GGp.force_N=0.0,1.0,4.0",
        "model.material=gerard-2005,buchaillard-2009",
        'model.material="a,b","1"',
        "model.cells=[8, 4, 4],[10, 6, 6]",
    ],
)
def test_a_factor_is_repeated_as_it_was_given(text: str) -> None:
    factor = factor_of(text)
    again = factor_of(vary_text(factor))
    assert again == factor or (again.is_range and (again.low, again.high) == (factor.low, factor.high))
    assert vary_text(factor) == text


def test_a_table_is_repeated(tmp_path: Path) -> None:
    table = tmp_path / "members.csv"
    table.write_text("muscle.GGp.force_N\n1.0\n2.0\n3.0\n")
    members = designs.from_table(table)
    folder = write_sweep(tmp_path / "my sweep", members, design="table", factors=())
    lines = commands_of(folder, begun_sweep(folder), members, 1)
    assert f"--table '{folder / 'members.csv'}'" in lines[0] and "--set 'model.cells=[8,4,4]'" in lines[0]
    assert lines[1] == f"explicitfe report '{folder}' --overwrite"
    assert "--set muscle.GGp.force_N=2.0" in lines[3]
    page = page_of(folder, tmp_path / "page.html")
    assert "3 runs of a table of 1 key" in words(page) and "Effect of GGp force" in words(page)
    assert "<details" not in page  # of one factor all charts are seen at once


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_sensitivity(tmp_path: Path, method: str) -> None:
    pytest.importorskip("SALib")
    members = getattr(designs, method)(factors_of(FORCES), 8, 0)
    folder = write_sweep(tmp_path / "sweep", members, design=method)
    assert "The indices are computed when all runs have finished." in words(page_of(folder, tmp_path / "page.html"))
    (folder / "sensitivity.json").write_text(json.dumps(indices(method, "points.tip.up_mm")))
    page = page_of(folder, tmp_path / "page.html")
    text = words(page)
    assert "4 runs are not used" in text and "share of a measure" not in text
    if method == "sobol":
        assert "0.75 ± 0.05 0.50 ± 0.05" in text and "0.00 ± 2.50" in text and "−0.00" not in text
        assert 'style="width: 75.0%"' in page and 'style="left: 70.0%; width: 10.0%"' in page
        assert 'style="left: -100.0%; width: 300.0%"' in page  # from beyond one end to beyond the other
    else:
        assert "8.000 ± 0.050" in text and "8.05 mm" in text
    (folder / "sensitivity.json").write_text("[]")
    with pytest.raises(InputError, match="this file is damaged"):
        sweep_to_draw(folder)


def test_a_large_sweep_is_sampled(tmp_path: Path) -> None:
    assert len(sample_of(60_000, 20)) == MOST_SCATTERED_MEMBERS
    some = sample_of(60_000, 400)
    assert len(some) == MOST_SCATTERED_NUMBERS // 400 and np.array_equal(some, sample_of(60_000, 400))
    members = designs.random(factors_of(FORCES), MOST_SCATTERED_MEMBERS + 500, 0)
    folder = write_sweep(tmp_path / "sweep", members)
    answer = write_sweep_report(sweep_to_draw, folder)
    assert answer["scattered"] == MOST_SCATTERED_MEMBERS and answer["size_MB"] < 1.5
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert f"{MOST_SCATTERED_MEMBERS} of {MOST_SCATTERED_MEMBERS + 500} runs, sampled at random" in words(page)
    # Without a script every one of them is drawn that has both numbers, not only the outermost.
    assert page.partition("data-scatter")[2].count("<polyline") > 2500


def test_the_numbers_of_the_scatter(folder: Path, tmp_path: Path) -> None:
    """What a script reads: whole steps of each column, 65535 where there is no number."""
    page = page_of(folder, tmp_path / "page.html")
    packed = re.search(r'<script type="application/octet-stream">([^<]+)</script>', page)
    assert packed is not None
    block = decompress(b64decode(packed[1]))
    size = int.from_bytes(block[:4], "little")
    header = json.loads(block[4 : 4 + size])
    titles = [column["title"] for column in header["columns"]]
    place = titles.index("tip: up (mm)")
    _, first, count = header["arrays"][f"column_{place}"]
    steps = np.frombuffer(block, "<u2", count, 4 + size + first)
    values = header["columns"][place]["low"] + header["columns"][place]["size"] * steps / header["steps"]
    force = np.array([value[0] for value in designs.random(factors_of(FORCES), 60, 0).values])
    failed = np.arange(60) % 7 == 3
    assert np.array_equal(steps == 65535, failed)
    np.testing.assert_allclose(values[~failed], 2.0 * force[~failed], atol=1e-3)
    assert header["statuses"] == ["finished", "inverted"] and "smallest volume ratio J" not in titles  # it does not vary


def test_a_sweep_that_is_not_complete_and_one_where_all_failed(tmp_path: Path) -> None:
    members = designs.random(factors_of(FORCES), 20, 0)
    assert "8 are not computed yet" in words(page_of(write_sweep(tmp_path / "part", members, stored=12), tmp_path / "a.html"))

    def failed(number: int, values: tuple[Any, ...]) -> Row:
        return {"member": number, "name": "", "status": "refused", "message": f"{EVIL} {values[0]}"}

    page = page_of(write_sweep(tmp_path / "none", members, failed), tmp_path / "b.html")
    assert "0 of 20 runs finished 20 did not finish" in words(page) and "refused 20" in words(page)
    assert "alert" in page and EVIL not in page
    with pytest.raises(InputError, match="no run of this sweep is finished yet"):
        write_sweep_report(sweep_to_draw, write_sweep(tmp_path / "empty", members, stored=0))


def test_another_body(tmp_path: Path) -> None:
    """Of measures with other names the first that vary are shown; without an outline there is none."""

    def pressed(number: int, values: tuple[Any, ...]) -> Row:
        row: Row = {"member": number, "name": "", "status": "finished", "message": "", "steps": number}
        return row | {"load.1.force_N": float(values[0]), "load.1.displacement_mm": 1.0 + float(values[1])}

    folder = write_sweep(tmp_path / "sweep", designs.random(factors_of(FORCES), 20, 0), pressed)
    sweep = sweep_to_draw(folder)
    assert sweep.main_measures == ["load.1.force_N", "load.1.displacement_mm"] and not sweep.drawn
    assert "load 1: force (N)" in words(page_of(folder, tmp_path / "page.html"))


def test_the_main_measures_have_names_of_rows() -> None:
    assert all(words_and_unit(name.rpartition(".")[2])[1] in ("mm", "mm²") for name in MAIN_MEASURES)


def test_members_that_are_spread() -> None:
    places = np.array([[0.0], [0.1], [0.5], [0.9], [1.0], [1.0]])
    assert spread_out(places, 3).tolist() == [0, 4, 2]
    assert len(spread_out(places, 24)) == 5  # the same place is taken once


def test_the_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["report", str(folder), "--json"]) == 0
    answer = check_answer("report", capsys.readouterr().out)
    assert answer["report"] == str(folder / "report.html") and answer["finished"] == 51 and answer["outlines"] == 24
    assert answer["size_MB"] == pytest.approx((folder / "report.html").stat().st_size / 1e6)
    assert command(["report", str(folder)]) == 2
    assert "add --overwrite" in capsys.readouterr().err
    assert command(["report", str(folder), str(folder), "--out", str(tmp_path / "a.html")]) == 2
    assert "which has a report of its own" in capsys.readouterr().err
    assert command(["report", str(folder), "--out", str(tmp_path / "b.html")]) == 0
    assert "24 outlines, 60 points" in capsys.readouterr().out


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="pages are tested with playwright: pip install playwright")
    with sync_api.sync_playwright() as playwright:
        own = next((path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None)
        if own is None and not Path(playwright.chromium.executable_path).exists():
            pytest.skip("there is no Chromium here: install it, or run `playwright install chromium`")
        with playwright.chromium.launch(executable_path=own, args=["--no-sandbox"]) as started:
            yield started


@pytest.mark.parametrize("width, scheme", [(1280, "light"), (390, "dark")])
def test_in_a_browser(browser: Any, folder: Path, tmp_path: Path, width: int, scheme: str) -> None:
    path = Path(write_sweep_report(sweep_to_draw, folder, tmp_path / "page.html")["report"])
    page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme).new_page()
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("main[data-ready]", timeout=PATIENCE_MS)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    legend = page.locator(".scatter .legend")
    assert legend.inner_text().split("\n") == ["finished (51)"]
    assert "9 runs lack one" in page.locator("[data-lacking]").inner_text()
    page.select_option("[data-axis=y]", label="GGa force (N)")
    assert legend.inner_text().split("\n") == ["finished (51)", "inverted (9)"]
    assert page.locator(".scatter .y-label").inner_text() == "GGa force (N)"
    ends = [path.get_attribute("d").count("M") for path in page.locator(".scatter .dots > path").all()]
    assert ends == [51, 9]
    # The dot of a member says whose it is.
    first = page.locator(".scatter .dots > path").first.get_attribute("d").split("h")[0].removeprefix("M").split()
    field = page.locator(".scatter .field")
    field.scroll_into_view_if_needed()
    box = field.bounding_box()
    page.mouse.move(box["x"] + box["width"] * float(first[0]) / 1000, box["y"] + box["height"] * float(first[1]) / 1000)
    assert page.locator("[data-said]").inner_text().startswith("run 0, finished: GGp force (N)")
    assert complaints == [] and requests == [path.as_uri()]
