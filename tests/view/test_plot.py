"""``explicitfe plot``, ``run --name``: chosen pictures, formats and times, and variants that can be told apart."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from support import ROOT, result_writer

from explicitfe.app.view.draw import PICTURES, draw
from explicitfe.app.view.heading import variant_of
from explicitfe.app.view.tongue import contour_figure, coronal_figure
from explicitfe.fem.mesh.box import box
from explicitfe.platform.errors import InputError, RunWarning
from explicitfe.results.files import FINISHED, open_result
from explicitfe.simulate.run.run import result_path, run

VOWEL = ROOT / "scenarios" / "vowel-i.toml"
TINY = ["model.cells=[8,4,4]", "analysis.duration_ms=4", "bone=[]", "title='2 $x_{$ 3 $'"]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    """A short run of a coarse tongue under a name of its own."""
    return Path(run(VOWEL, tmp_path_factory.mktemp("plot"), name="stronger", settings=[*TINY, "muscle.GGp.force_N=3"])["result"])


def test_a_variant_has_its_name_and_says_what_was_set(tiny, tmp_path):
    assert tiny.name == "stronger.vtkhdf"
    with open_result(tiny) as result:
        words = variant_of(result)
        texts = [text.get_text() for text in contour_figure(result, 2).texts]
    assert words.startswith("stronger, model.cells=[8,4,4]") and words.endswith("muscle.GGp.force_N=3")
    assert any("muscle.GGp.force_N=3" in " ".join(text.split()) for text in texts)
    plain = Path(run(VOWEL, tmp_path, settings=[TINY[0], "analysis.duration_ms=0.1"])["result"])
    with open_result(plain) as result:
        assert variant_of(result) == "model.cells=[8,4,4], analysis.duration_ms=0.1"
    for name in ("a/b", "", ".hidden", "..", "a\nb"):
        with pytest.raises(InputError, match="cannot be the name of a file"):
            result_path(VOWEL, tmp_path, name)


def test_pictures_formats_and_times_are_chosen(tiny, tmp_path, capsys):
    words = ["plot", str(tiny), "--only", "probes,contour", "--times", "1.9,4", "--out", str(tmp_path), "--json"]
    for kind, begin in (("pdf", b"%PDF"), ("svg", b"<?xml"), ("png", b"\x89PNG")):
        assert command([*words, "--format", kind]) == 0
        answer = check_answer("plot", capsys.readouterr().out)
        assert [Path(name).name for name in answer["files"]] == [f"stronger-contour.{kind}", f"stronger-probes.{kind}"]
        assert all(Path(name).read_bytes().startswith(begin) for name in answer["files"])
    svg = (tmp_path / "stronger-contour.svg").read_bytes()
    assert command([*words, "--format", "svg"]) == 2
    assert "exists; add --overwrite" in json.loads(capsys.readouterr().out)["failure"]["message"]
    assert command([*words, "--format", "svg", "--overwrite"]) == 0
    assert (tmp_path / "stronger-contour.svg").read_bytes() == svg  # the same picture is the same file
    capsys.readouterr()
    for more, sentence in (
        (["--only", "contur"], 'no picture "contur"; did you mean "contour"?'),
        (["--format", "jpg"], '--format "jpg" is not a file format of pictures'),
        (["--times", "1,x"], '"x" is not a number of milliseconds'),
        (["--times", "9"], "time 9 ms is outside the stored samples; give a time from 0 to 4 ms"),
    ):
        assert command(["plot", str(tiny), "--out", str(tmp_path / "none"), "--json", *more]) == 2
        assert sentence in json.loads(capsys.readouterr().out)["failure"]["message"]
    assert not (tmp_path / "none").exists()


def test_chosen_times_are_those_that_are_drawn(tiny):
    with open_result(tiny) as result:
        for picture in (contour_figure, coronal_figure):
            labels = [text.get_text() for text in picture(result, 2, [1, 2]).axes[-1].get_legend().get_texts()]
            assert [label for label in labels if label.endswith("ms")] == ["2.0 ms", "4.0 ms"]


def test_a_picture_without_anything_to_show_is_named(tiny, tmp_path):
    drawn = draw(tiny, tmp_path, only=["palatogram", "probes"])
    assert [Path(name).name for name in drawn["files"]] == ["stronger-probes.png"]
    assert drawn["warnings"] == [f"{tiny} has no data for: palatogram."]


def test_a_mesh_that_begins_at_zero_is_cut_in_its_middle(tmp_path):
    """As that of the tutorial on a mesh of one's own: its side lies at y = 0."""
    mesh = box((4, 2, 2), (0.04, 0.02, 0.02))
    with result_writer(tmp_path / "bar.vtkhdf", mesh=mesh, scenario_text="", model={}, provenance={}) as writer:
        for step in range(2):
            bent = np.zeros_like(mesh.points)
            bent[:, 2] = step * (0.1 * mesh.points[:, 0] + 0.2 * mesh.points[:, 1])
            writer.sample(0.1 * step, {}, {"displacement": bent})
        path = writer.finish(FINISHED, "", {})
    with open_result(path) as result:
        line = contour_figure(result, 1).axes[0].lines[1].get_xydata()
    assert np.nanmax(line[:, 1]) == pytest.approx(20.0 + 4.0 + 2.0)  # mm: in the middle half of what the far side rises by


def test_warnings_of_libraries_are_not_for_users(tiny, tmp_path, capsys, monkeypatch):
    def picture(*given: object) -> None:
        warnings.warn("constrained_layout not applied", UserWarning, stacklevel=1)
        warnings.warn("this takes long", RunWarning, stacklevel=1)

    monkeypatch.setitem(PICTURES["transient"], "contour", picture)
    assert command(["plot", str(tiny), "--only", "contour", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().err
    assert "note: this takes long" in said and "constrained_layout" not in said
