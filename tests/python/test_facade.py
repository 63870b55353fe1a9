"""The commands as Python functions: what they take, and what they give."""

from __future__ import annotations

import json
import sys
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import explicitfe as fe
from explicitfe.platform.host import extras

SETTINGS = {"model.resolution": "coarse", "analysis.duration_ms": 20, "record.every_ms": 2}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("python")


@pytest.fixture(scope="module")
def ended(folder):
    """What ``fe.run`` gives, for a short run on the coarse mesh."""
    return fe.run("vowel-i", folder / "outputs", settings=SETTINGS)


@pytest.fixture
def here(folder, ended, monkeypatch) -> Path:
    """The folder whose outputs/ has the run."""
    monkeypatch.chdir(folder)
    return folder


def test_a_run_gives_its_summary_and_its_result(ended, folder):
    assert ended.finished and ended["status"] == "finished"
    assert ended.path == folder / "outputs" / "vowel-i.vtkhdf" and ended["result"] == str(ended.path)
    assert json.loads(json.dumps(ended)) == ended  # a dictionary as before
    lines = repr(ended).splitlines()
    assert lines[0].startswith("Vowel [i]") and "finished" in lines[0] and any("tip: " in line for line in lines)
    with ended.open() as result:
        assert len(result.times) == 11


def test_settings_as_texts_are_those_of_the_command(ended, folder):
    texts = [f"{key}={value}" for key, value in SETTINGS.items()]
    again = fe.run("vowel-i", folder / "texts", settings=texts)
    assert fe.compare(ended, again).identical


def test_every_way_to_name_a_result(ended, here):
    with ended.open() as result:
        named = [fe.measure(given) for given in (ended, result, ended.path, str(ended.path), "vowel-i", Path("vowel-i"))]
    assert all(measures.points["tip"] == named[0].points["tip"] for measures in named)
    assert fe.measure("vowel-i", time_s=0.01).time_ms == pytest.approx(10.0, abs=0.5)


def test_a_result_describes_itself(ended):
    with fe.open_result(ended) as result:
        said = repr(result)
        assert said.startswith(f"Result '{ended.path}': finished\n  Vowel [i]")
        assert "384 elements" in said and "11 samples from 0 to 20 ms" in said and "displacement" in said and "tip" in said
    assert "was closed; open it again" in repr(result)
    with pytest.raises(fe.InputError, match="was closed"):
        result.displacement(3)


def test_a_notebook_shows_the_report(ended):
    with fe.open_result(ended) as result:
        html = result._repr_html_()
    assert html.startswith('<iframe srcdoc="') and html.endswith("</iframe>") and html.count('"') == html.count('="') * 2
    page = unescape(html.partition('srcdoc="')[2].partition('" width')[0])
    assert page == fe.report(ended, out=ended.path.parent / "page.html").read_text(encoding="utf-8")
    assert ended._repr_html_() == html


def test_a_table_of_pandas(ended):
    with fe.open_result(ended) as result:
        table = result.to_pandas()
        assert table.index.name == "time_ms" and np.allclose(table.index, 1e3 * result.times)
        forward_up = np.array([-1e3, 0.0, 1e3]) * result.probe("tip")
        assert np.allclose(table[["tip_forward_mm", "tip_up_mm"]], forward_up[:, [0, 2]], atol=1e-9)
        assert "tip_speed_mm_s" in table.columns and "kinetic_energy_J" not in table.columns
        rest = result.to_pandas(positions=True) - table
        assert np.ptp(rest["tip_up_mm"]) < 1e-9 and rest["tip_up_mm"].iloc[0] != 0.0
        assert "kinetic_energy_J" in result.to_pandas(history=True).columns


def test_without_pandas_a_sentence_says_how_to_install_it(ended, monkeypatch):
    monkeypatch.setitem(extras.PACKAGES, "pandas", "no_such_package")
    with fe.open_result(ended) as result, pytest.raises(fe.InputError, match=r'pip install "\.\[pandas\]"'):
        result.to_pandas()


def test_figures(ended, here, tmp_path):
    from matplotlib.figure import Figure

    figure = fe.plot(ended)
    assert isinstance(figure, Figure) and figure.axes
    fe.plot("vowel-i", "probes").savefig(tmp_path / "probes.svg")
    assert (tmp_path / "probes.svg").stat().st_size > 1000
    assert len(fe.plot(ended, "contour", times_s=[0.01, 0.02]).axes[0].lines) > 0


def test_a_plotter_and_an_image(ended, folder):
    from pyvista import Plotter

    plotter = fe.view(ended, "oblique", size_px=(200, 150))
    image = plotter.screenshot(return_img=True)
    plotter.close()
    assert isinstance(plotter, Plotter) and image.min() < image.max()
    path = fe.view(ended, file="png", folder=folder, size_px=(200, 150))
    assert path == folder / "vowel-i-midsagittal.png" and path.read_bytes().startswith(b"\x89PNG")


def test_a_model_built_in_python_is_stored_as_a_scenario_is(tmp_path):
    """The result holds what the samples of the same simulation show; its motion is measured; it is not replaced or resumed."""
    mesh = fe.box(cells=(6, 2, 2), size_m=(0.03, 0.01, 0.01))
    law, end = fe.Yeoh(C10_Pa=1037.0, C20_Pa=486.0), mesh.node_sets["x1"]
    beam = fe.Model(mesh, law, held=mesh.held("x0"), loads=(fe.face_load(mesh, "x1", (0.0, 0.0, -1e-4)),), alpha_per_s=40.0)
    ended = fe.save(fe.Simulation(beam), tmp_path / "new" / "beam", duration_s=0.02, every_s=0.005, title="A beam")
    assert ended.finished and ended.path == tmp_path / "new" / "beam.vtkhdf" and ended["title"] == "A beam"
    shown = list(fe.Transient(fe.Simulation(beam), duration_s=0.02).samples(every_s=0.005))
    with fe.open_result(ended) as result:
        assert result.times.tolist() == [sample.time_s for sample in shown]
        assert np.array_equal(result.displacement(-1), shown[-1].displacement)
        assert result.displacement(-1)[end, 2].mean() < -1e-5
    assert fe.measure(ended).body.largest_displacement_mm > 0.01
    with pytest.raises(fe.InputError, match="`overwrite`"):
        fe.save(fe.Simulation(beam), ended.path, duration_s=0.02)
    with pytest.raises(fe.InputError, match="advanced already"):
        simulation = fe.Simulation(beam)
        simulation.advance(1, 1e-6)
        fe.save(simulation, tmp_path / "late", duration_s=0.02)


def test_a_probe_of_a_sample():
    model = fe.tongue_model({"SL": 0.5}, resolution="coarse")
    *_, sample = fe.Transient(fe.Simulation(model), duration_s=0.01).samples(every_s=0.01)
    assert (
        np.allclose(sample.probe("tip"), model.mesh.at(model.probes["tip"], sample.displacement)[0]) and sample.probe("tip").any()
    )
    with pytest.raises(fe.InputError, match='no named point "tipp"; did you mean "tip"'):
        sample.probe("tipp")


WRONG = {
    "no such result": (lambda: fe.measure("vowel-x"), "vowel-x"),
    "a number": (lambda: fe.open_result(3), "result"),
    "no result": (lambda: fe.report(), "results"),
    "no such picture": (lambda: fe.plot("vowel-i", "contours"), "contour"),
    "a rendered picture": (lambda: fe.plot("vowel-i", "3d"), "view"),
    "a time that is none": (lambda: fe.plot("vowel-i", times_s=["x"]), "times_s"),
    "a time outside": (lambda: fe.measure("vowel-i", time_s=9.0), "9000 ms"),
    "a time of text": (lambda: fe.measure("vowel-i", time_s="1"), "time_s"),
    "no such viewpoint": (lambda: fe.view("vowel-i", "below"), "below"),
    "no such field": (lambda: fe.view("vowel-i", field="stress"), "stress"),
    "no such file format": (lambda: fe.view("vowel-i", file="jpg"), "file"),
    "settings in one text": (lambda: fe.run("vowel-i", settings="model.resolution=coarse"), "settings"),
    "a number as scenario": (lambda: fe.run(3), "scenario"),
    "a number as folder": (lambda: fe.run("vowel-i", out=3), "out"),
    "a number as name": (lambda: fe.run("vowel-i", name=3), "name"),
    "no settings": (lambda: fe.run("vowel-i", settings=None), "settings"),
    "a setting that is no number": (lambda: fe.run("vowel-i", settings={"model.resolution": float("nan")}), "settings"),
    "a number as dataset": (lambda: fe.identify(3), "dataset"),
    "a tolerance of text": (lambda: fe.compare("vowel-i", "vowel-i", "x"), "tolerance"),
    "a number as page": (lambda: fe.report("vowel-i", out=3), "out"),
    "a size in words": (lambda: fe.view("vowel-i", size_px="large"), "size_px"),
    "no such format": (lambda: fe.export("vowel-i", "xls"), "xls"),
    "no such scenario": (lambda: fe.run("vowel-x"), "vowel-x"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_named(name, here):
    call, word = WRONG[name]
    with pytest.raises(fe.InputError, match=word):
        call()


def test_reading_a_result_needs_no_compiler():
    """Neither does asking for the functions."""
    import subprocess

    code = "import explicitfe as fe, sys; fe.open_result, fe.plot, fe.measure; print('explicitfe.fem.solve' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
