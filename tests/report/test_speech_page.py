"""The page of a run of the tongue: contact, areas, formants, leak and fibres follow the slider, and are those of ``measure``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import command
from gesture import write_gesture
from opened_page import NARROW, WIDE, Opened
from support import ROOT
from test_run_report import unpacked

from explicitfe.app.view.page.run import speech
from explicitfe.app.view.page.run.playback import playback
from explicitfe.app.view.page.run.speech import MOST_ACOUSTIC_SAMPLES, speech_of
from explicitfe.app.view.page.run.write import write_report
from explicitfe.app.view.scene.carried import CarriedPoints, joined
from explicitfe.results.acoustics.speakers import spoken_vowels
from explicitfe.results.files import open_result
from explicitfe.results.measure.leak import leak_history
from explicitfe.results.measure.palatogram import contact_history
from explicitfe.simulate.run.run import run

# The lips of this [k] are closed from 150 to 300 ms. There is contact with the palate from 30 to 202 ms.
SETTINGS = [
    "model.cells=[8,4,4]",
    "lips={table=[[0,150,10],[150,0,10],[300,0,10],[400,150,10]]}",
    *(f"muscle.{name}.table=[[0,0],[50,1],[150,1],[190,0]]" for name in ("STY", "TRANSm", "TRANSp", "GGp", "MH", "PG")),
]


@pytest.fixture(scope="module")
def stop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(run(ROOT / "scenarios" / "velar-k.toml", tmp_path_factory.mktemp("stop"), settings=SETTINGS)["result"])


@pytest.fixture(scope="module")
def report(stop: Path) -> Path:
    return Path(write_report([stop])["report"])


@pytest.fixture(scope="module")
def opened(browser: Any, report: Path) -> Opened:
    return Opened(browser, report, WIDE)


def said(opened: Opened, name: str) -> str:
    return str(opened.page.locator(f'output[data-of="{name}"]').first.inner_text())


def measured(stop: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    assert command(["measure", str(stop), "--formants", "--json", *options]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)["results"][0]
    return answer


def touched(opened: Opened) -> list[int]:
    script = "[...document.querySelectorAll('.palatogram rect')].map((one) => (one.matches('.on') ? 1 : 0))"
    states: list[int] = opened.page.evaluate(script)
    return states


@pytest.mark.parametrize("at_ms", [400.0, 70.0])
def test_the_numbers_are_those_of_measure(opened: Opened, stop: Path, capsys: pytest.CaptureFixture[str], at_ms: float) -> None:
    """At the end, and at a sample in between whose acoustics the page has."""
    opened.slide(at_ms)
    time_ms = float(said(opened, "time").removesuffix(" ms"))
    now, heard = measured(stop, capsys, "--at-ms", str(at_ms)), measured(stop, capsys, "--at-ms", str(time_ms))
    assert abs(time_ms - at_ms) < 400.0 / MOST_ACOUSTIC_SAMPLES
    pattern = now["palatogram"]["now"]
    assert touched(opened) == [int(on) for row in pattern["electrodes"] for on in row if on is not None]
    assert said(opened, "contacts") == str(pattern["contacts"])
    shown = [float(said(opened, name)) for name in ("F1", "F2", "F3")]
    np.testing.assert_allclose(shown, [each["frequency_hz"] for each in heard["airway"]["formants"]], atol=0.5)
    # The area function that is seen is that of the same sample.
    seen = opened.page.locator(".areas svg g.shown")
    assert seen.count() == 2
    points = seen.last.locator("polyline").get_attribute("points")
    x, y = np.array([pair.split(",") for pair in str(points).split()], dtype=float).T
    ranges = [
        [float(part) for part in str(opened.page.locator(".areas .chart").get_attribute(f"data-{axis}")).split()] for axis in "xy"
    ]
    sections = heard["airway"]["sections"]
    along, area = (low + share * (high - low) for (low, high), share in zip(ranges, (x / 1000.0, 1.0 - y / 1000.0), strict=True))
    np.testing.assert_allclose(along[1::2], [section["to_mm"] for section in sections], atol=0.1)
    np.testing.assert_allclose(area[::2], [section["area_mm2"] for section in sections], atol=0.5)
    dot, field = opened.page.locator(".vowels .dot").bounding_box(), opened.page.locator(".vowels .field").bounding_box()
    (left, right), (bottom, top) = (
        [float(part) for part in str(opened.page.locator(".vowels .chart").get_attribute(f"data-{axis}")).split()]
        for axis in "xy"
    )
    assert left > right and bottom > top  # F2 runs to the left, and F1 down
    assert dot["x"] + dot["width"] / 2 - field["x"] == pytest.approx((shown[1] - left) / (right - left) * field["width"], abs=1.5)
    assert dot["y"] + dot["height"] / 2 - field["y"] == pytest.approx(
        (shown[0] - top) / (bottom - top) * field["height"], abs=1.5
    )


def test_contact_and_closure_follow_the_slider(opened: Opened) -> None:
    opened.slide(0.0)
    assert sum(touched(opened)) == 0
    opened.slide(130.0)
    assert sum(touched(opened)) > 0 and not opened.page.locator(".moment .closed").is_visible()
    opened.slide(220.0)
    assert opened.page.locator(".moment .closed").is_visible() and not opened.page.locator(".moment dl").is_visible()
    assert not opened.page.locator(".vowels .dot").is_visible() and opened.complaints == []
    opened.slide(400.0)


def test_what_is_in_front_and_what_can_be_chosen(opened: Opened) -> None:
    """Energies are behind a closed part; groups of speakers and muscles can be hidden."""
    energies = opened.page.locator("figure", has_text="Energy balance: stored")
    assert energies.count() == 1 and not energies.is_visible()
    opened.page.locator(".numerical > summary").click()
    assert energies.is_visible() and opened.page.locator(".numerical td", has_text="hourglass share").is_visible()
    opened.page.locator(".numerical > summary").click()
    for text in ("Leak: widest open way", "Muscle forces", "Named points: up"):
        assert opened.page.locator("figure", has_text=text).first.is_visible()
    women = opened.page.locator(".vowels .field .s2 >> visible=true")
    assert women.count() > 0
    opened.page.locator(".vowels [value=women]").uncheck()
    assert women.count() == 0 and opened.page.locator(".vowels .field .s0 >> visible=true").count() > 0
    opened.page.evaluate("scrollTo(0, 0)")
    opened.slide(100.0)
    pulling = opened.picture("canvas")
    reds = (pulling[..., 0] > 180) & (pulling[..., 1] < 40) & (pulling[..., 2] < 100)
    assert reds.sum() > 200
    opened.page.locator("[data-show=muscles]").uncheck()
    without = opened.picture("canvas")
    assert not ((without[..., 0] > 180) & (without[..., 1] < 40) & (without[..., 2] < 100)).any()
    assert opened.complaints == [] and len(opened.requests) == 1


def test_it_fits_a_telephone(browser: Any, report: Path) -> None:
    opened = Opened(browser, report, NARROW, color_scheme="dark")
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= NARROW["width"] and opened.complaints == []


def test_contact_and_fibres_of_each_frame(stop: Path) -> None:
    with open_result(stop) as result:
        last = len(result.times) - 1
        header, arrays = unpacked(playback(result, last, share=0.03))
        steps = [int(np.argmin(np.abs(1e3 * result.times - time))) for time in arrays["times"]]
        history = contact_history(result, last)
        assert history is not None and 10 < len(steps) < last
        np.testing.assert_array_equal(arrays["contacts"].reshape(len(steps), 62), history.on[steps])
        assert header["electrodes"][:7] == [1, 2, 3, 4, 5, 6, 8]
        assert [muscle["name"] for muscle in header["muscles"]] == ["STY", "TRANSm", "TRANSp", "GGp", "MH", "PG"]
        points = joined([CarriedPoints.of(result.mesh, line) for lines in result.fibres for line in lines])
        changes = arrays["fibres_moved"].reshape(len(steps), -1)
        moved = np.cumsum(changes, axis=0, dtype=changes.dtype).reshape(len(steps), 3, -1).transpose(0, 2, 1)
        for frame, step in enumerate(steps):
            places = arrays["fibres"].reshape(-1, 3) + header["rounding_mm"] * moved[frame]
            np.testing.assert_allclose(
                places, 1e3 * points.places(result.displacement(step)), atol=0.51 * header["rounding_mm"] + 1e-4
            )


def test_the_way_for_air_of_each_frame(stop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line begins and ends where the widest way does, and no point of it lies off that way; it says when it is closed."""
    monkeypatch.setattr(speech, "TOUCHING_GAP_M", 3e-3)  # so coarse a tongue leaves some 2 mm open
    with open_result(stop) as result:
        header, arrays = unpacked(playback(result, len(result.times) - 1, share=0.03))
        history = leak_history(result, len(result.times) - 1)
        assert history is not None
        steps = [int(np.argmin(np.abs(1e3 * result.times - time))) for time in arrays["times"]]
        ways = [history.widest(step) for step in steps]
    drawn = arrays["leak"].reshape(len(steps), header["leak"], 3)
    np.testing.assert_array_equal(arrays["leak_closed"] == 1, [one.width_m <= 3e-3 for one in ways])
    assert 0 < arrays["leak_closed"].sum() < len(steps)
    for line, one in zip(drawn, ways, strict=True):
        np.testing.assert_allclose(line[[0, -1]], 1e3 * one.path[[0, -1]], atol=1e-3)
        apart = np.linalg.norm(line[:, None] - 1e3 * one.path[None], axis=2).min(axis=1)
        assert apart.max() <= 0.51 * 1e3 * np.linalg.norm(np.diff(one.path, axis=0), axis=1).max()


def test_the_closed_samples_have_no_formants(stop: Path) -> None:
    with open_result(stop) as result:
        heard = speech_of(result, len(result.times) - 1)
    assert heard is not None and len(heard.times_ms) == MOST_ACOUSTIC_SAMPLES and heard.times_ms[-1] == pytest.approx(400.0)
    for time, formants in zip(heard.times_ms, heard.formants_hz, strict=True):
        assert (formants is None) == (150.0 <= time <= 300.0)


def test_speakers() -> None:
    """Formants of men are below those of women, and these below those of children; an ellipse is a line of equal distance."""
    spoken = {(one.group, one.vowel): one for one in spoken_vowels()}
    assert len(spoken) == 30 and {one.utterances for one in spoken.values()} == {66, 56, 30}
    means = [np.array([one.mean_hz for one in spoken.values() if one.group == group]) for group in ("men", "women", "children")]
    assert (means[0] < means[1]).all() and (means[1] < means[2]).all()
    one = spoken["women", "ɔ"]
    spread = np.diag(one.deviation_hz)
    covariance = spread @ np.array([[1.0, one.correlation], [one.correlation, 1.0]]) @ spread
    away = one.ellipse(1.5) - one.mean_hz
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away), 1.5**2)


def test_other_models_keep_their_page(tmp_path: Path) -> None:
    text = Path(write_report([write_gesture(tmp_path / "push.vtkhdf")])["report"]).read_text(encoding="utf-8")
    body = text.split("<script", 1)[0].split("</head>")[1]
    assert "Energy balance: stored" in body and not re.search(
        "<details class=.numerical|Contact with the palate|Area function", body
    )
