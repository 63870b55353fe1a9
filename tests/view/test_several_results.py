"""Several results in one picture and side by side in films; a disk that is full while pictures and pages are written."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from gesture import write_gesture, write_indentation

from explicitfe.app.view.heading import common_stem
from explicitfe.app.view.overlay import contours_figure, curves_figure
from explicitfe.app.view.scene.film import steps_side_by_side
from explicitfe.platform.errors import InputError
from explicitfe.results.files import folder, open_result
from explicitfe.results.measure.sections import X, Z, midsagittal


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A push, and one twice as far with a sample every 20 ms instead of every 10 ms."""
    place = tmp_path_factory.mktemp("several")
    near = write_gesture(place / "near.vtkhdf")
    far = write_gesture(place / "far.vtkhdf", push=2.0, frames=6, muscle=[{"name": "GGp", "force_N": 4.0}])
    return near, far


def test_contours_are_those_of_each_result_at_the_same_time(pair: tuple[Path, Path]) -> None:
    from contextlib import ExitStack

    with ExitStack() as opened:
        results = [opened.enter_context(open_result(path)) for path in pair]
        figure = contours_figure(results, [0.04, 0.1])
        panels = [axes for axes in figure.axes if axes.axison]
        assert [axes.get_title() for axes in panels] == ["40 ms", "100 ms"]
        for axes, time_s in zip(panels, (0.04, 0.1), strict=True):
            lines = {line.get_label(): line.get_xydata() for line in axes.lines}
            for result in results:
                step = int(np.argmin(np.abs(result.times - time_s)))
                outline = 1e3 * midsagittal(result.mesh).outline(result.mesh.points + result.displacement(step))
                np.testing.assert_allclose(lines[result.path.stem], outline[:, [X, Z]])
            assert "at rest" in lines  # once, as both have the same shape at rest
            assert sum(np.array_equal(line, lines["at rest"], equal_nan=True) for line in lines.values()) == 1
        legend = [text.get_text() for text in figure.legends[0].get_texts()]
        assert legend[-2:] == ["near", "far"]
        words = " ".join(" ".join(text.get_text().split()) for text in figure.texts)
        assert "muscle.GGp.force_N: 2, 4" in words
        # The nearest sample of one result is at another time, and the picture says so.
        (axes,) = contours_figure(results, [0.05]).axes
        assert axes.get_title() in ("50 ms (far at 40 ms)", "50 ms (far at 60 ms)")


def test_the_commands_take_several_results(pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["plot", *map(str, pair), "--times", "50", "--format", "svg", "--out", str(tmp_path), "--json"]
    assert command(words) == 0
    answer = check_answer("plot", capsys.readouterr().out)
    assert answer["files"] == [str(tmp_path / "near-far-contour.svg")] and answer["results"] == [str(path) for path in pair]
    assert Path(answer["files"][0]).read_bytes().startswith(b"<?xml")
    ball = write_indentation(tmp_path / "ball.vtkhdf")
    for more, sentence in (
        ([str(ball)], "is a run in time and"),
        (["--only", "probes"], 'the picture "probes" shows one result; of several results only "contour" is drawn.'),
        (["--times", "900"], "time 900 ms is outside the stored samples"),
        ([], "exists; add --overwrite"),
    ):
        assert command([*words, *more]) == 2
        assert sentence in json.loads(capsys.readouterr().out)["failure"]["message"]
    assert command(["view", *map(str, pair), "--json"]) == 2
    assert "a window shows one result" in json.loads(capsys.readouterr().out)["failure"]["message"]
    assert command(["plot", str(ball), str(ball), "--out", str(tmp_path)]) == 0
    with open_result(ball) as one, open_result(ball) as other:
        (axes,) = curves_figure([one, other]).axes
        np.testing.assert_allclose([line.get_xydata()[-1] for line in axes.lines if line.get_label()[0] != "_"], [[2.0, 2.0]] * 2)
    assert common_stem([Path("a.vtkhdf"), Path("b.vtkhdf")]) == "a-b"
    assert len(common_stem([Path(f"{'x' * 60}{k}.vtkhdf") for k in range(8)])) < 140


def test_films_show_the_same_times(pair: tuple[Path, Path]) -> None:
    with open_result(pair[0]) as near, open_result(pair[1]) as far:
        first, second = steps_side_by_side([near, far], None, 80)
        assert len(first) == len(second) == 11
        assert np.abs(near.times[first] - far.times[second]).max() <= 0.0101
        assert steps_side_by_side([near, far], 0.06, 1) == [[6], [3]]
        assert steps_side_by_side([near, far], 0.06, 80)[0][-1] == 6
        with pytest.raises(InputError, match="outside the stored samples"):
            steps_side_by_side([near, far], 0.2, 80)


def test_a_film_side_by_side(pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As wide as both, with one camera: the shape at rest is at the same place in both halves, and the halves differ later."""
    from PIL import Image

    words = [
        "view",
        *map(str, pair),
        "--gif",
        "--png",
        "--size",
        "320x240",
        "--field",
        "none",
        "--without",
        "rest",
        "--out",
        str(tmp_path),
        "--json",
    ]
    code = command(words)
    said = capsys.readouterr().out
    if code == 3 and "could not render" in json.loads(said)["failure"]["message"]:
        pytest.skip("this machine cannot render")
    assert code == 0
    answer = check_answer("view", said)
    assert answer["files"] == [str(tmp_path / f"near-far-midsagittal.{kind}") for kind in ("png", "gif")]
    with Image.open(answer["files"][1]) as film:
        assert film.size == (640, 240) and film.n_frames == 11
        frames = []
        for number in (0, 10):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB")).astype(int)[60:190])  # without the words
    different = [np.mean(np.abs(frame[:, :320] - frame[:, 320:]).max(axis=2) > 40) for frame in frames]
    assert different[0] < 0.003 and different[1] > 0.01


@pytest.mark.parametrize("kind", ["plot", "several", "3d", "report", "view"])
def test_a_full_disk_is_one_sentence_with_the_right_file(
    kind: str, pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 3, and nothing half-written."""
    near, far = map(str, pair)
    out = tmp_path / "out"
    words = {
        "plot": ["plot", near, "--only", "contour", "--out", str(out)],
        "several": ["plot", near, far, "--out", str(out)],
        "3d": ["plot", near, "--only", "3d", "--out", str(out)],
        "report": ["report", near, "--out", str(out / "page.html")],
        "view": ["view", near, "--png", "--out", str(out)],
    }[kind]
    name = {
        "plot": "near-contour.png",
        "several": "near-far-contour.png",
        "3d": "near-3d.png",
        "report": "page.html",
        "view": "near-midsagittal.png",
    }[kind]
    if kind in ("3d", "view"):  # drawn in a process of its own: a limit on the size of files acts there too
        script = f"import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n{LIMITED}"
        (tmp_path / "sitecustomize.py").write_text(script)
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    else:

        def full(*given: object, **more: object) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(folder, "create_private", full)
    assert command([*words, "--json"]) == 3
    failure = json.loads(capsys.readouterr().out)["failure"]
    if "could not render" in failure["message"]:
        pytest.skip("this machine cannot render")
    assert failure["kind"] == "machine" and failure["message"].startswith(f"cannot write {out / name} (")
    assert "vtkhdf" not in failure["message"] and failure["message"].count("\n") == 0
    assert not out.exists() or [*out.iterdir()] == []


LIMITED = "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
