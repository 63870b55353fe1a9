"""The report of runs: its animation is what is stored, failed checks and all energies are shown, and it is one harmless file."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from gesture import DURATION_S, FRAMES, displacement, write_gesture, write_indentation
from support import tongue

from explicitfe.app.view.heading import labels_of
from explicitfe.app.view.page.chart import Line, chart, round_ticks
from explicitfe.app.view.page.run.parts import differences
from explicitfe.app.view.page.run.playback import ROUNDING_MM, playback
from explicitfe.app.view.page.run.write import MOST_RESULTS, write_report
from explicitfe.fem.mesh.hexmesh import free_faces
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result


@pytest.fixture(scope="module")
def gesture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_gesture(tmp_path_factory.mktemp("gesture") / "push.vtkhdf")


def unpacked(text: str) -> tuple[dict, dict[str, np.ndarray]]:
    """Header and arrays of a block, as scene.js reads them; frames are summed up, and whole numbers wrap around."""
    block = zlib.decompress(base64.b64decode(text))
    size = int(np.frombuffer(block, "<u4", 1)[0])
    header = json.loads(block[4 : 4 + size])
    arrays = {
        name: np.frombuffer(block, kind, count, 4 + size + first).copy()
        for name, (kind, first, count) in header["arrays"].items()
    }
    frames = len(arrays["times"])
    for name in ["moved", *(f"field_{field['name']}" for field in header["fields"])]:
        changes = arrays[name].reshape(frames, -1)
        arrays[name] = np.cumsum(changes, axis=0, dtype=changes.dtype)
    return header, arrays


def test_what_moves_is_what_is_stored(gesture: Path) -> None:
    with open_result(gesture) as result:
        header, arrays = unpacked(playback(result, FRAMES - 1))
        np.testing.assert_allclose(arrays["times"], 1e3 * result.times, rtol=1e-6)
        points = 1e3 * result.mesh.points
        shown = arrays["points"].reshape(-1, 3)
        nodes = np.array([int(np.argmin(np.abs(points - place).sum(axis=1))) for place in shown])
        np.testing.assert_allclose(points[nodes], shown, atol=1e-4)
        for frame in range(FRAMES):
            moved = header["rounding_mm"] * arrays["moved"][frame].reshape(3, -1).T
            np.testing.assert_allclose(moved, 1e3 * result.displacement(frame)[nodes], atol=0.51 * ROUNDING_MM)
        J = next(field for field in header["fields"] if field["name"] == "J")
        values = J["low"] + (J["high"] - J["low"]) * arrays["field_J"] / 255.0
        assert values.min() == pytest.approx(J["low"]) and values.max() == pytest.approx(J["high"])
        np.testing.assert_allclose(values[0], 1.0, atol=(J["high"] - J["low"]) / 255.0)
        tip = arrays["point_tip"].reshape(FRAMES, 3)
        np.testing.assert_allclose(tip - tip[0], 1e3 * result.probe("tip"), atol=1e-3)


def test_large_moves_and_long_runs_fit(tmp_path: Path) -> None:
    """Ten metres are kept to a 32000th, and of many samples as many as the page has room for, both ends among them."""
    path = write_gesture(tmp_path / "far.vtkhdf", push=1500.0, frames=30)
    with open_result(path) as result:
        header, arrays = unpacked(playback(result, 29, share=1e-3))
        assert header["rounding_mm"] > ROUNDING_MM and 2 < len(arrays["times"]) < 30
        np.testing.assert_allclose(arrays["times"][[0, -1]], 1e3 * result.times[[0, -1]])
        largest = header["rounding_mm"] * np.abs(arrays["moved"][-1]).max()
        assert largest == pytest.approx(1e3 * np.abs(displacement(1500.0)).max(), rel=1e-4)


def test_the_half_is_closed_by_the_cut(gesture: Path) -> None:
    """The right side and the cut together are a closed surface: each edge belongs to two triangles, in opposite directions."""
    with open_result(gesture) as result:
        _, arrays = unpacked(playback(result, FRAMES - 1))
    corners = np.concatenate([arrays["faces_right"], arrays["faces_cut"]]).reshape(-1, 3)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there, back = {tuple(edge) for edge in edges.tolist()}, {tuple(edge) for edge in edges[:, ::-1].tolist()}
    assert len(there) == len(edges) and there == back
    element, _ = free_faces(tongue().mesh.hexes)
    assert len(arrays["faces_left"]) + len(arrays["faces_right"]) == 6 * 4 * len(element)


def test_the_command_writes_one_page(gesture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.html"
    assert command(["report", str(gesture), "--out", str(page), "--json"]) == 0
    answer = check_answer("report", capsys.readouterr().out)
    assert answer["results"][0] | {"result": ""} == {
        "result": "",
        "checks_passed": True,
        "quotable": True,
        "reasons": [],
        "frames": FRAMES,
    }
    text = page.read_text(encoding="utf-8")
    assert (
        "All checks passed" in text
        and "Does it go forward?" in text
        and answer["size_MB"] == pytest.approx(len(text.encode()) / 1e6)
    )
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", text.split("<script>")[0])  # nothing is fetched
    assert "default-src 'none'" in text
    assert "explicitfe run push.toml --set muscle.GGp.force_N=2.0 --set 'title=It'\"'\"'s a push'\n" in unescape(text)
    assert command(["report", str(gesture), "--out", str(page)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert command(["report", str(gesture), "--out", str(page), "--overwrite"]) == 0
    assert command(["report", str(gesture), "--out", str(tmp_path / "page.pdf")]) == 2
    assert ".html" in capsys.readouterr().err


def test_a_warning_is_a_reason(tmp_path: Path) -> None:
    path = write_gesture(tmp_path / "bad.vtkhdf", warnings=["2 elements are folded <b>here</b>."])
    answer = write_report([path])
    assert answer["report"] == str(tmp_path / "bad-report.html")
    assert answer["results"][0]["reasons"] == ["2 elements are folded <b>here</b>."] and not answer["results"][0]["checks_passed"]
    text = Path(answer["report"]).read_text(encoding="utf-8")
    assert "1 check failed" in text and "&lt;b&gt;here" in text and "<b>here" not in text


def test_results_side_by_side(gesture: Path, tmp_path: Path) -> None:
    """What differs between their scenarios is named, and the same charts have the same axes."""
    other = write_gesture(tmp_path / "push.vtkhdf", push=2.0, muscle=[{"name": "GGp", "force_N": 4.0, "end_ms": 50.0}])
    answer = write_report([gesture, other], tmp_path / "two.html")
    assert answer["differing_keys"] == ["muscle.GGp.force_N", "muscle.GGp.end_ms"]
    text = (tmp_path / "two.html").read_text(encoding="utf-8")
    assert text.count("<article data-run") == 2 and "absent" in text and "<details open><summary>2 keys" in text
    forward = re.findall(r'data-y="([^"]*)"[^>]*>\s*<figcaption>Named points: forward', text)
    assert len(forward) == 2 and len(set(forward)) == 1
    with pytest.raises(InputError, match=f"at most {MOST_RESULTS} results"):
        write_report([gesture] * (MOST_RESULTS + 1), tmp_path / "many.html")


def test_hostile_text_does_nothing(tmp_path: Path) -> None:
    """Names and sentences of a scenario stand in the page as they are, and no script but ours is named by the policy."""
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(1)>"
    path = write_gesture(tmp_path / "evil.vtkhdf", title=evil, question=evil, muscle=[{"name": evil, "force_N": 1.0}])
    text = Path(write_report([path])["report"]).read_text(encoding="utf-8")
    assert "<img" not in text and "<script>alert" not in text
    policy = re.search(r"script-src ([^;]*)", unescape(text))
    assert policy is not None and len(policy[1].split()) == text.count("<script>") == 3


def test_labels_tell_results_apart() -> None:
    assert labels_of([Path("a/x.vtkhdf"), Path("b/x.vtkhdf")]) == ["a/x", "b/x"]
    assert labels_of([Path("x.vtkhdf"), Path("y.vtkhdf")]) == ["x", "y"]
    assert labels_of([Path("x.vtkhdf"), Path("x.vtkhdf")]) == ["x (1)", "x (2)"]


def test_an_indentation_goes_by_its_loads(tmp_path: Path) -> None:
    """Frames are loads, in words; the tool goes down with them, to where the section through its axis gives way to it."""
    path = write_indentation(tmp_path / "ball.vtkhdf")
    with open_result(path) as result:
        header, arrays = unpacked(playback(result, 2))
    assert header["moments"] == ["0 N at 0 mm", "1 N at 1 mm", "2 N at 2 mm"] and header["indentation"] == [0.0, 1.0, 2.0]
    np.testing.assert_allclose(arrays["tool_heights"], [10.0, 9.0, 8.0], rtol=1e-6)
    tool = arrays["tool_points"].reshape(-1, 3)
    assert tool[:, 2].min() == pytest.approx(0.0, abs=1e-6) and np.abs(tool[:, :2]).max() == pytest.approx(5.0, abs=0.02)
    ends = arrays["points"].reshape(-1, 3)[arrays["cut_ends"].reshape(-1, 2)]
    np.testing.assert_allclose(ends[:, 0, 1], 0.0, atol=1e-6)  # the section is that through the axis
    text = Path(write_report([path])["report"]).read_text(encoding="utf-8")
    assert 'data-follows="indentation"' in text and "section through the axis" in text and "2.00 N at 2.00 mm" in text


def test_what_differs() -> None:
    assert differences([{"a": 1}, {"a": 1}], ["x", "y"]) is None
    shown = differences([{"title": "p", "a": 1, "b": "l" * 100}, {"title": "q", "a": 2}], ["x", "y"])
    assert shown is not None
    assert [row.cells for row in shown.rows] == [["a", "1", "2"], ["b", "l" * 79 + "…", "absent"]]


@pytest.mark.parametrize("low, high", [(0.0, 1.0), (-3.2e-7, 5e-7), (1.0, 1.0001), (0.0, 3e8), (-120.0, -3.0)])
def test_marks_are_round_and_within(low: float, high: float) -> None:
    numbers, words = round_ticks(low, high)
    assert 2 <= len(numbers) <= 7 and len(set(words)) == len(words)
    assert all(low - 1e-9 * (high - low) <= x <= high + 1e-9 * (high - low) for x in numbers)


def test_a_chart_keeps_extremes_and_gaps() -> None:
    x = np.linspace(0.0, 1.0, 5000)
    y = np.sin(300.0 * x)
    y[2500] = 7.0
    drawn = chart("t", [Line("a", x, y)])
    assert drawn is not None
    points = np.array([pair.split(",") for pair in drawn.series[0].pieces[0].split()], dtype=float)
    low, high = drawn.y_range
    assert len(points) < 700 and high - points[:, 1].min() / 1000.0 * (high - low) == pytest.approx(7.0, abs=0.01)
    y[100:200] = np.nan
    broken = chart("t", [Line("a", x, y)])
    assert broken is not None and len(broken.series[0].pieces) == 2
    assert chart("t", [Line("a", x, np.full(5000, np.nan))]) is None
    constant = chart("t", [Line("a", x, np.zeros(5000))])
    assert constant is not None and constant.y_range[0] < 0.0 < constant.y_range[1]


def test_the_duration_is_on_the_axis(gesture: Path) -> None:
    text = Path(write_report([gesture], overwrite=True)["report"]).read_text(encoding="utf-8")
    spans = set(re.findall(r'data-x="([^"]*)" data-y="[^"]*" data-follows="time"', text))
    assert spans == {f"0.0 {1e3 * DURATION_S}"}


def test_constants_have_all_their_digits(tmp_path: Path) -> None:
    """Constants are not rounded, a column of zeros is omitted, and decades are written alike."""
    path = write_gesture(tmp_path / "digits.vtkhdf", material={"law": "yeoh", "C10_Pa": 1037.25, "density_kg_m3": 1040.0})
    text = Path(write_report([path])["report"]).read_text(encoding="utf-8")
    assert "yeoh, C10 1037.25 Pa, density 1040 kg/m³" in text
    assert "forward (mm)" in text and "right (mm)" not in text and ">-0.00<" not in text
    errors = chart("error", [Line("", np.arange(3.0), np.array([1e-6, 1e-5, 1e-3]))], logarithmic=True)
    assert errors is not None and [tick.label for tick in errors.y_ticks] == ["10⁻⁶", "10⁻⁵", "10⁻⁴", "10⁻³"]
