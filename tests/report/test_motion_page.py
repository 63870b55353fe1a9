"""The page of a loop on markers that move: the film, the charts and the tables, with damped cosines in place of runs."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html import unescape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageChops
from rich.console import Console

from explicitfe.app.view.page.close_loop.motion_charts import amplitude_spectrum
from explicitfe.app.view.page.close_loop.motion_film import choose_curve
from explicitfe.app.view.page.close_loop.motion_tables import feature_table, motion_errors
from explicitfe.app.view.page.close_loop.page import write
from explicitfe.app.view.terminal.close_loop import loop_tables
from explicitfe.inverse.close_loop.trajectories.vibration import features_of
from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.motion_report import MarkerMotion, MovingMarkers, ReportedRepeats, VibrationFeatures

MOST_BYTES_OF_FILM = 1_500_000
MOTION_FILES = ["motion.gif", "markers.png"]
ALL_MARKERS = ["tip-high", "tip-low", "top", "clamp-left", "clamp-right", "clamp-back"]
MOVING = ALL_MARKERS[:3]
AT_REST = np.array([[116.0, 11.0, 13.5], [116.0, 11.0, 4.5], [66.0, 11.0, 24.0]])
# Share of the deflection of the tip, and of the rotation: markers further out than the surface swing along x.
SHAPE = np.array([[0.06, 0.0, -1.0], [-0.05, 0.0, -1.0], [0.08, 0.0, -0.42]])
SIZE_MM = {"own weight": 6.0, "load 1": 9.0, "load 2": 14.0}
# Frequency (Hz), decay (1/s), and deflection at the end as a share of that of the data.
DATA, BEFORE, AFTER = (5.1, 3.4, 1.0), (5.6, 2.0, 0.93), (5.12, 3.3, 1.01)


def box_edges(size: tuple[float, float, float]) -> np.ndarray:
    """The twelve edges (12, 2, 3) of a box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * np.array(size)
    pairs = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]
    return corners[np.array(pairs)]


def released(time_s: np.ndarray, size_mm: float, law: tuple[float, float, float]) -> np.ndarray:
    """Displacements (k, 3, 3) mm after a release: a damped cosine around the new position at rest."""
    frequency, decay, end = law
    course = end * size_mm * (1.0 - np.exp(-decay * time_s) * np.cos(2.0 * np.pi * frequency * time_s))
    return course[:, None, None] * SHAPE


def moving_markers(curve: str, held_out: bool = False) -> MovingMarkers:
    time_s = np.arange(0.0, 1.6, 0.005)
    measured, before, after = (released(time_s, SIZE_MM[curve], law) for law in (DATA, BEFORE, AFTER))
    measured = measured + np.random.default_rng(len(curve)).normal(0.0, 0.05, measured.shape)
    measured[40:44, 1] = np.nan
    split: Any = "holdout" if held_out else "fit"
    return MovingMarkers(curve, split, time_s, MOVING, AT_REST, measured, before, after, box_edges((110.0, 22.0, 18.0)))


def motion_of(one: MovingMarkers) -> list[MarkerMotion]:
    """As the loop reports it, along z."""
    rows = []
    for number, name in enumerate(one.names):
        paths = {key: getattr(one, key)[:, number] for key in ("measured", "before", "after")}
        rms = [float(np.sqrt(np.nanmean(np.sum((paths[key] - paths["measured"]) ** 2, axis=1)))) for key in ("before", "after")]
        features: dict[str, Any] = {key: features_of(one.time_s, path[:, 2]) for key, path in paths.items()}
        rows.append(MarkerMotion(curve=one.curve, marker=name, axis="z", **features, rms_before=rms[0], rms_after=rms[1]))
    return rows


def moving_report(**changes: Any) -> tuple[LoopReport, list[MovingMarkers]]:
    """A report on three curves of which the one with the largest load is held out."""
    markers = [moving_markers("own weight"), moving_markers("load 1"), moving_markers("load 2", held_out=True)]
    error = {"fit": {"nrmse": 0.2, "rmse": 2.0}, "holdout": {"nrmse": 0.21, "rmse": 2.1}}
    smaller = {"fit": {"nrmse": 0.02, "rmse": 0.2}, "holdout": {"nrmse": 0.03, "rmse": 0.3}}
    given: dict[str, Any] = {
        "dataset": "released beam",
        "unit": "mm",
        "verdict": "effect-found",
        "effects": ["viscoelastic"],
        "effect_titles": {"viscoelastic": "viscoelastic relaxation"},
        "split": {"fit": ["own weight", "load 1"], "holdout": ["load 2"]},
        "baseline": {"error": error},
        "final": {"error": smaller},
        "motion": [row for one in markers for row in motion_of(one)],
        "repeats": ReportedRepeats(pairs=2, rms={"own weight": 0.11, "load 2": 0.26}),
    }
    return LoopReport(**given | changes), markers


@pytest.fixture(scope="module")
def report_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("motion")
    assert write(folder, moving_report()[0], [], moving_report()[1])[-2:] == MOTION_FILES
    return folder


def words(page: str) -> str:
    """What a reader sees, on one line."""
    plain = re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL))
    return " ".join(unescape(plain).split())


def page_of(folder: Path, report: LoopReport, markers: list[MovingMarkers]) -> str:
    write(folder, report, [], markers)
    return (folder / "report.html").read_text(encoding="utf-8")


def test_the_film_moves_and_is_small(report_folder: Path) -> None:
    film = (report_folder / "motion.gif").read_bytes()
    assert len(film) < MOST_BYTES_OF_FILM
    with Image.open(io.BytesIO(film)) as image:
        durations, frames = [], []
        for number in range(image.n_frames):
            image.seek(number)
            durations.append(image.info["duration"])
            frames.append(image.convert("RGB"))
    assert len(frames) > 40 and 7000 < sum(durations) < 10_000
    # The first frame is for paper: it stands longer than the others, and shows more.
    assert durations[0] > 10 * durations[1]
    assert all(ImageChops.difference(one, other).getbbox() for one, other in pairwise(frames))


def test_the_page_holds_the_film_and_the_charts(report_folder: Path) -> None:
    page = (report_folder / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/gif;base64,") == 1 and not re.search(r"https?:|<script|<link|url\(", page)
    assert re.findall(r'<img alt="([^"]+)"', page) == ["Animation: measured and simulated markers, before and after."]
    charts = re.findall(r'<figure class="chart".*?<figcaption>(.*?)</figcaption>', page, flags=re.DOTALL)
    assert charts[:4] == [f"held out: load 2, {name}" for name in MOVING] + ["spectra of tip-low along z"] and len(charts) == 12
    assert (report_folder / "markers.png").read_bytes().startswith(b"\x89PNG")


def test_the_tables_have_features_and_errors(report_folder: Path) -> None:
    text = words((report_folder / "report.html").read_text(encoding="utf-8"))
    errors = motion_errors(moving_report()[0])
    assert [row.curve for row in errors] == ["load 2", "own weight", "load 1"]
    for row in errors:
        assert row.before is not None and row.after is not None and row.before > 5.0 * row.after
    held_out = errors[0]
    # The curve without repeats has a dash.
    assert f"load 2 held out {held_out.before:.2f} {held_out.after:.3f} 0.260" in text
    assert re.search(r"load 1 fitted \d+\.\d+ 0\.\d+ –", text)
    assert "from 2 pairs" in text and "frequency (Hz) decay (1/s) rest position (mm) phase (°)" in text
    assert re.search(
        r"load 2, held out tip-high, z measured 5\.\d{3} 3\.\d+ -1[34]\.\d \S+ before 5\.600 2\.00 -13\.0 0\.0", text
    )


def test_phases_are_near_the_measured_one() -> None:
    """359 and 1 degree differ by two."""
    features = [VibrationFeatures(phase_deg=angle) for angle in (175.0, 190.0, 20.0)]
    motion = MarkerMotion(curve="c", marker="m", axis="z", measured=features[0], before=features[1], after=features[2])
    features_on_page = feature_table(moving_report(motion=[motion])[0])
    assert features_on_page is not None
    assert [row.cells[-1] for row in features_on_page.rows] == ["175.0", "190.0", "20.0"]


@pytest.mark.parametrize("lost", [None, float("nan"), float("inf")])
def test_a_missing_value_is_a_dash(tmp_path: Path, lost: float | None) -> None:
    report, markers = moving_report()
    report.motion[0] = report.motion[0].model_copy(
        update={"after": VibrationFeatures(end=lost, frequency_Hz=lost), "rms_before": lost, "rms_after": lost}
    )
    report.repeats = ReportedRepeats(pairs=1, rms={"load 2": float("nan")})
    for row in report.motion:
        if row.curve == "load 1":
            row.rms_after = lost
    text = words(page_of(tmp_path, report, markers))
    assert re.search(r"tip-high, z measured \S+ \S+ \S+ \S+ before \S+ \S+ \S+ \S+ after – – – –", text)
    assert re.search(r"load 1 fitted \d+\.\d+ –", text)
    assert "nan" not in text and "inf " not in text
    assert LoopReport.model_validate_json(report.model_dump_json()).motion[0].rms_after is None


def test_markers_without_a_value_are_left_out(tmp_path: Path) -> None:
    report, markers = moving_report()
    for one in markers:
        one.measured[:, 2] = np.nan
        one.after[100:] = np.nan
    assert write(tmp_path, report, [], markers)[-2:] == MOTION_FILES
    for one in markers:
        one.measured[:] = np.nan
    (tmp_path / "none").mkdir()
    assert "motion.gif" not in write(tmp_path / "none", report, [], markers)


def test_any_name_is_drawn(tmp_path: Path) -> None:
    """Names are text: no formula, no tag, and no letter that a font must have."""
    report, markers = moving_report(title="<b>$x_$</b>")
    hostile = "$x_{$ \u4e2d</figure><script>\x00"
    named = [replace(one, curve=hostile, names=[hostile] * 3) for one in markers[:1]]
    page = page_of(tmp_path, report, named)
    assert "<script" not in page and page.count("</figure>") == page.count("<figure")


def test_one_model_has_one_panel(tmp_path: Path, report_folder: Path) -> None:
    """Where no effect was added, nothing is called before and after."""
    report, markers = moving_report(effects=[], verdict="no-missing-effect")
    report.final = report.baseline
    page = page_of(tmp_path, report, markers)
    section = page[page.index('<section id="motion">') :]
    section = words(section[: section.index("</section>")])
    assert "rms distance (mm)" in section and "after" not in section and "model 5.600" in section


def test_other_reports_have_no_such_section(tmp_path: Path) -> None:
    report, _ = moving_report(motion=[], repeats=None)
    names = write(tmp_path, report, [])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not set(names) & set(MOTION_FILES) and ">Motion<" not in page and "image/gif" not in page
    assert "rms distance" not in printed(report)


def printed(report: LoopReport) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(loop_tables(report))
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_the_terminal_has_the_errors() -> None:
    text = " ".join(printed(moving_report()[0]).replace("│", " ").split())
    error = motion_errors(moving_report()[0])[0]
    assert f"load 2 held out {error.before:.2f} {error.after:.3f} 0.260" in text


def test_the_film_shows_the_held_out_curve_with_the_largest_motion() -> None:
    fitted, small, large = moving_markers("load 2"), moving_markers("own weight", True), moving_markers("load 1", True)
    chosen = choose_curve([fitted, small, large])
    assert chosen is large and choose_curve([fitted]) is fitted and choose_curve([]) is None


def test_an_amplitude_is_that_of_the_harmonic() -> None:
    time_s = np.arange(0.0, 2.0, 0.01)
    y = 3.0 + 0.7 * np.cos(2.0 * np.pi * 5.0 * time_s)
    y[30] = np.nan
    frequency, amplitude = amplitude_spectrum(time_s, y)
    assert frequency[np.argmax(amplitude)] == pytest.approx(5.0, abs=0.3) and amplitude.max() == pytest.approx(0.7, abs=0.02)
