"""The report of runs in a browser: it moves, obeys slider, keys and colours, fits a telephone, and has nothing to complain of.

The browser is the Chromium of the system or the one that playwright installs; where there is neither, these tests are skipped.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gesture import write_gesture, write_indentation
from opened_page import LAPTOP, NARROW, PATIENCE_MS, WIDE, Opened, accessibility_faults

from explicitfe.app.view.page.run.write import write_report


@pytest.fixture(scope="module")
def gesture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_gesture(tmp_path_factory.mktemp("pages") / "push.vtkhdf", warnings=["a mesh is <coarse>."])


@pytest.fixture(scope="module")
def report(gesture: Path) -> Path:
    return Path(write_report([gesture])["report"])


@pytest.fixture(scope="module")
def opened(browser: Any, report: Path) -> Opened:
    """The page on a wide screen of a reader who wants no motion, shared by the tests that ask for nothing else."""
    return Opened(browser, report, WIDE)


def changed(one: np.ndarray, other: np.ndarray) -> float:
    """The share of the dots of two pictures that differ."""
    return float((np.abs(one - other).sum(axis=2) > 30).mean())


def test_the_slider_moves_body_outline_and_marks(opened: Opened, report: Path) -> None:
    assert opened.clock == "100 ms"  # who wants no motion sees the end
    end, outline = opened.picture("canvas"), opened.page.locator(".contour .body path").get_attribute("d")
    assert opened.share_drawn > 0.05
    opened.slide(0.0)
    start = opened.picture("canvas")
    assert opened.clock == "0 ms" and changed(end, start) > 0.005
    assert opened.page.locator(".contour .body path").get_attribute("d") != outline
    opened.slide(100.0)
    assert changed(opened.picture("canvas"), end) < 0.001
    figure = opened.page.locator("figure[data-follows=time]", has_text="Named points: forward")
    figure.scroll_into_view_if_needed()
    mark = figure.locator(".now")
    opened.slide(50.0)
    box, field = mark.bounding_box(), figure.locator(".field").bounding_box()
    assert box["x"] - field["x"] == pytest.approx(0.5 * field["width"], abs=2.0)
    tip = figure.locator(".legend li", has_text="tip").locator("output")
    opened.page.wait_for_timeout(400)
    assert 0.5 < float(tip.inner_text()) < 6.0
    assert opened.complaints == [] and opened.requests == [report.as_uri()]


def test_keys(opened: Opened) -> None:
    keys = opened.page.keyboard
    keys.press("Home")
    assert opened.clock == "0 ms"
    for _ in range(3):
        keys.press("ArrowRight")
    assert opened.clock == "3 ms"
    keys.press("ArrowLeft")
    assert opened.clock == "2 ms"
    keys.press("End")
    assert opened.clock == "100 ms"
    keys.press("Space")
    assert opened.page.locator("[data-control=play]").inner_text() == "Pause"
    opened.page.wait_for_selector("main[data-drawn]", timeout=PATIENCE_MS)
    keys.press("Space")
    assert opened.page.locator("[data-control=play]").inner_text() == "Play"
    # Every control is reached by the tab key, and says what it is.
    named = opened.page.evaluate(
        "[...document.querySelectorAll('.player button, .player input, .player select')].every("
        "(e) => e.tabIndex >= 0 && (e.ariaLabel || e.labels?.length || e.textContent.trim()))"
    )
    assert named and opened.complaints == []


def test_it_plays_by_itself(browser: Any, report: Path) -> None:
    opened = Opened(browser, report, WIDE, reduced_motion="no-preference")
    opened.page.wait_for_selector("main[data-drawn]", timeout=PATIENCE_MS)
    assert opened.page.locator("[data-control=play]").inner_text() == "Pause" and opened.complaints == []


def test_what_is_shown_can_be_chosen(opened: Opened) -> None:
    opened.page.evaluate("scrollTo(0, 0)")
    shown = opened.picture("canvas")
    for action in (
        lambda: opened.page.click("[data-view=side]"),
        lambda: opened.page.click("[data-show=lines]"),
        lambda: opened.page.click("[data-show=cut]"),
        lambda: opened.page.click("[data-show=bones]"),
        lambda: opened.page.click("[data-show=rest]"),
        lambda: opened.page.click("[data-zoom='1.25']"),
        lambda: opened.page.select_option("[data-control=colour]", "J"),
        lambda: opened.page.select_option("[data-control=colour]", ""),
    ):
        before = shown
        action()
        shown = opened.picture("canvas")
        assert changed(before, shown) > 0.0005
    names = opened.page.locator("[data-control=colour] option").all_inner_texts()
    assert names == ["plain tissue", "displacement (mm)", "speed (mm/s)", "volume ratio J"][: len(names)] and len(names) > 2
    opened.page.mouse.move(300, 500)
    opened.page.mouse.down()
    opened.page.mouse.move(420, 500, steps=3)
    opened.page.mouse.up()
    assert changed(shown, opened.picture("canvas")) > 0.005 and opened.complaints == []


@pytest.mark.parametrize("viewport, scheme", [(WIDE, "light"), (NARROW, "dark")], ids=["1280 light", "390 dark"])
def test_screens_and_colours(browser: Any, report: Path, viewport: dict[str, int], scheme: str) -> None:
    """Nothing is wider than the screen, the ground is of the colours asked for, and letters stand out from it."""
    opened = Opened(browser, report, viewport, color_scheme=scheme)
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
    ground, ink = (opened.colour(name) for name in ("backgroundColor", "color"))
    assert (sum(ground) > 600) == (scheme == "light") and abs(sum(ground) - sum(ink)) > 450
    other = "dark" if scheme == "light" else "light"
    opened.page.locator(f"label:has(#theme-{other})").click()
    assert (sum(opened.colour("backgroundColor")) > 600) == (other == "light")
    assert opened.share_drawn > 0.03 and opened.complaints == []


def test_all_that_moves_is_above_the_player_of_a_laptop(browser: Any, gesture: Path, tmp_path: Path) -> None:
    """Of a run whose checks passed; a low screen folds the options away."""
    clean = Path(write_report([write_gesture(tmp_path / "clean.vtkhdf")])["report"])
    for viewport in (LAPTOP, {"width": 1280, "height": 640}):
        opened = Opened(browser, clean, viewport)
        player = opened.page.locator(".player").bounding_box()
        for selector in ("canvas", ".scale", ".contour svg", ".contour figcaption"):
            box = opened.page.locator(selector).bounding_box()
            assert box["y"] + box["height"] <= player["y"], (viewport, selector)


def test_the_picture_is_turned_and_zoomed_by_keyboard(browser: Any, report: Path) -> None:
    opened = Opened(browser, report, LAPTOP)
    opened.page.locator("canvas").focus()
    shown, clock = opened.picture("canvas"), opened.clock
    for key in ("ArrowLeft", "ArrowUp", "ArrowRight", "ArrowDown", "+", "-"):
        before = shown
        opened.page.keyboard.press(key)
        shown = opened.picture("canvas")
        assert changed(before, shown) > 0.005, key
    assert opened.clock == clock  # the same keys move in time where no picture is selected
    for _ in range(60):
        opened.page.keyboard.press("ArrowDown")  # not beyond the pole
    assert opened.share_drawn > 0.02 and opened.complaints == []


def test_bones_are_cut_too(browser: Any, gesture: Path, tmp_path: Path) -> None:
    """The half of the palate on the speaker's left is gone, and comes back."""
    opened = Opened(browser, Path(write_report([gesture], tmp_path / "cut.html")["report"]), LAPTOP)
    opened.page.click("[data-view=front]")
    for name in ("points", "muscles"):
        if opened.page.locator(f"[data-show={name}]").count():
            opened.page.uncheck(f"[data-show={name}]")
    whole = opened.picture("canvas")
    opened.page.check("[data-show=cut]")
    half = opened.picture("canvas")
    drawn = [np.abs(picture - picture[3, 20]).sum(axis=2)[12:, 12:-12] > 12 for picture in (whole, half)]  # no round corners
    widths = [np.ptp(np.flatnonzero(one[: one.shape[0] // 2].any(axis=0))) for one in drawn]
    assert widths[1] == pytest.approx(0.5 * widths[0], rel=0.1)
    opened.page.uncheck("[data-show=cut]")
    assert changed(opened.picture("canvas"), whole) < 0.001


@pytest.mark.parametrize("viewport", [LAPTOP, NARROW], ids=["laptop", "telephone"])
def test_the_page_is_accessible(browser: Any, report: Path, viewport: dict[str, int]) -> None:
    assert accessibility_faults(Opened(browser, report, viewport).page) == []


def test_two_runs_move_together(browser: Any, gesture: Path, tmp_path: Path) -> None:
    other = write_gesture(tmp_path / "other.vtkhdf", push=-1.0, muscle=[{"name": "GGp", "force_N": 1.0}])
    opened = Opened(browser, Path(write_report([gesture, other], tmp_path / "two.html")["report"]), WIDE)
    outlines = opened.page.locator(".contour .body path")
    outlines.last.scroll_into_view_if_needed()  # only what is on the screen is drawn
    opened.page.wait_for_selector(".contour .body path[d] >> nth=1", timeout=PATIENCE_MS)
    end = [outlines.nth(k).get_attribute("d") for k in range(2)]
    opened.slide(0.0)
    start = [outlines.nth(k).get_attribute("d") for k in range(2)]
    assert start[0] == start[1] and len({*start, *end}) == 3
    assert opened.page.locator("td", has_text="muscle.GGp.force_N").count() == 1
    assert opened.complaints == []


def test_the_loads_of_a_tool(browser: Any, tmp_path: Path) -> None:
    opened = Opened(browser, Path(write_report([write_indentation(tmp_path / "ball.vtkhdf")])["report"]), WIDE)
    assert opened.clock == "2 N at 2 mm"
    tool = opened.page.locator(".contour .bones path").get_attribute("transform")
    opened.page.keyboard.press("Home")
    assert opened.clock == "0 N at 0 mm" and opened.page.locator(".contour .bones path").get_attribute("transform") != tool
    assert opened.share_drawn > 0.03 and opened.complaints == []


def test_without_3d_the_outline_still_moves(browser: Any, report: Path) -> None:
    """Where a browser shows no WebGL."""
    context = browser.new_context(viewport=WIDE, reduced_motion="reduce")
    context.add_init_script(
        "const make = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        "  return kind.startsWith('webgl') ? null : make.call(this, kind, ...more); };"
    )
    page = context.new_page()
    page.goto(report.as_uri())
    page.wait_for_selector("main[data-ready]", timeout=PATIENCE_MS)
    assert page.locator(".no-3d").is_visible() and not page.locator("canvas").is_visible()
    end = page.locator(".contour .body path").get_attribute("d")
    page.keyboard.press("Home")
    assert page.locator(".contour .body path").get_attribute("d") != end
