"""A result in three dimensions: what the mesh carries, colours, views, files, the window."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command
from support import ROOT, result_writer
from tiny_result import python

from explicitfe.app.view.scene.carried import CarriedPoints
from explicitfe.app.view.scene.film import film_steps
from explicitfe.app.view.scene.scene import DASH_SHARE, dashes
from explicitfe.app.view.scene.show import show
from explicitfe.app.view.scene.shown_field import rounded_down, shown_field
from explicitfe.app.view.scene.viewpoint import VIEWPOINTS, viewpoint
from explicitfe.fem.bones.tables import read_bones
from explicitfe.fem.mesh.hexmesh import MaterialPoints
from explicitfe.platform.errors import InputError, MachineError
from explicitfe.results.files import FINISHED, Quantity, open_result
from explicitfe.simulate.anatomy import catalogue

GRADIENT = np.array([[0.1, 0.02, -0.03], [0.0, 0.05, 0.01], [0.07, 0.0, -0.02]])


@pytest.fixture(scope="module")
def result_path(tmp_path_factory) -> Path:
    """The built-in tongue between palate and jaw, moved by a linear field, as one muscle pulls harder and harder."""
    anatomy = catalogue.built_in("tongue", cells=(8, 4, 4))
    mesh = anatomy.mesh
    bones = read_bones(ROOT / "models" / "tongue" / "bones.toml")
    muscle = {"name": "GGp", "force_N": 2.0, "start_ms": 0.0, "rise_ms": 100.0, "distribution": "stress"}
    path = tmp_path_factory.mktemp("scene") / "moved.vtkhdf"
    with result_writer(
        path,
        mesh=mesh,
        bones={name: (bone.surface.points, bone.surface.triangles) for name, bone in bones.items()},
        fibres=[[fibre.points for fibre in anatomy.muscles["GGp"].fibres]],
        cell_fields={"J": Quantity("1")},
        scenario_text='# --set muscle.GGp.force_N=2\ntitle = "Costs $5 and $6 [i]"\n',
        model={"muscles": [muscle], "scenario_file": "/elsewhere/other.toml"},
        provenance={},
    ) as result:
        for share in (0.0, 0.5, 1.0):
            moved = share * (mesh.points - mesh.points.mean(axis=0)) @ GRADIENT
            result.sample(0.1 * share, {}, {"displacement": moved}, {"J": np.full(mesh.element_count, 1.0 - 0.03 * share)})
        return result.finish(FINISHED, "", {})


def test_points_are_carried_by_the_mesh(result_path):
    with open_result(result_path) as result:
        mesh, u = result.mesh, result.displacement(2)
    between = mesh.points[mesh.hexes].mean(axis=1)  # centres of elements lie in no node
    places = np.concatenate([mesh.points[[3, 77]], between[:9]])
    carried = CarriedPoints.at(mesh, places)
    expected = places + (places - mesh.points.mean(axis=0)) @ GRADIENT
    np.testing.assert_allclose(carried.places(u), expected, atol=1e-9)
    np.testing.assert_array_equal(carried.places(u)[:2], (mesh.points + u)[[3, 77]])
    line = MaterialPoints(np.array([-1, 5]), np.array([[0.0] * 3, [0.5, 0.0, -0.5]]), np.array([[0.1, 0.2, 0.3], [0.0] * 3]))
    np.testing.assert_array_equal(CarriedPoints.of(mesh, line).places(u)[0], [0.1, 0.2, 0.3])


def test_the_scale_of_a_field_holds_for_all_steps(result_path):
    with open_result(result_path) as result:
        field = shown_field(result, "displacement", [0, 1, 2])
        largest = 1e3 * np.linalg.norm(result.displacement(2), axis=1)
        assert field.label == "displacement (mm)" and field.limits[0] == 0.0
        assert largest.max() <= field.limits[1] <= 1.1 * largest.max()
        np.testing.assert_allclose(field.values(result, 2), largest)
        volume = shown_field(result, "J", [0, 1, 2])
        assert volume.limits == pytest.approx((0.97, 1.03)) and volume.kind == "cell"  # as at rest is the middle
        assert shown_field(result, "none", [0]) is None
        with pytest.raises(InputError, match='no field "displacment"; did you mean "displacement"'):
            shown_field(result, "displacment", [0])
    assert [rounded_down(value) for value in (6.38, -6.38, 0.0, 100.0)] == [6.3, -6.4, 0.0, 100.0]


def test_the_front_is_at_the_left(result_path):
    front, up = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    for name, view in VIEWPOINTS.items():
        np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-15)
        across, along, _ = view.axes
        if name != "front":
            assert across @ front < 0.0
        if name != "top":
            assert along @ up > 0.8
    assert VIEWPOINTS["front"].axes[0] @ [0.0, 1.0, 0.0] == -1.0  # who is faced has the right at the viewer's left
    with pytest.raises(InputError, match='"sides" is not a viewpoint; did you mean "side"'):
        viewpoint("sides")


def test_dashes_follow_a_line_round_its_corners():
    square = np.array([[0.0, 0, 0], [10, 0, 0], [10, 0, 10], [0, 0, 10], [0, 0, 0], [np.nan] * 3])
    ends = dashes(square, 0.7).reshape(-1, 2, 3)
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(40.0 * DASH_SHARE, rel=0.03)
    for a, b in ends:  # each piece lies on a side
        assert any(a[axis] == b[axis] == side for axis in (0, 2) for side in (0.0, 10.0))
    assert len(dashes(np.full((1, 3), np.nan), 0.7)) == 0


def test_films_have_steps_equally_far_apart():
    assert film_steps(np.linspace(0.0, 0.2, 101), 100, 5) == [0, 25, 50, 75, 100]
    assert film_steps(np.linspace(0.0, 0.2, 101), 2, 80) == [0, 1, 2]
    assert film_steps(np.array([0.0]), 0, 80) == [0]


def test_view_draws_pictures_and_films(result_path, tmp_path, capsys):
    from PIL import Image

    words = ["view", str(result_path), "--png", "--gif", "--mp4", "--size", "320x240", "--out", str(tmp_path), "--json"]
    code = command(words)
    said = capsys.readouterr().out
    if code == 3 and "could not render" in json.loads(said)["failure"]["message"]:
        pytest.skip("this machine cannot render")
    assert code == 0
    answer = check_answer("view", said)
    assert answer["view"] == "midsagittal" and answer["time_ms"] == pytest.approx(100.0) and answer["warnings"] == []
    png, gif, mp4 = (tmp_path / f"moved-midsagittal.{kind}" for kind in ("png", "gif", "mp4"))
    assert answer["files"] == [str(png), str(gif), str(mp4)] and sorted(tmp_path.iterdir()) == sorted([png, gif, mp4])
    picture = np.asarray(Image.open(png).convert("RGB")).astype(int)
    assert picture.shape == (240, 320, 3)
    red = (picture[..., 0] > 180) & (picture[..., 1] < 60) & (picture[..., 2] < 110)
    assert red.sum() > 40  # fibres with all their force
    with Image.open(gif) as film:
        assert film.n_frames == 3 and film.info["duration"] == pytest.approx(1e3 * 4.0 / 3.0, abs=10.0)
        frames = []
        for number in range(3):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB")).astype(int))
    assert all(np.mean(np.abs(a - b).max(axis=2) > 30) > 0.01 for a, b in pairwise(frames))
    assert np.mean(np.abs(frames[2] - picture).max(axis=2) > 60) < 0.01
    assert mp4.read_bytes()[4:8] == b"ftyp"
    before = png.read_bytes()
    assert command(words) == 2
    assert "exists; add --overwrite" in json.loads(capsys.readouterr().out)["failure"]["message"] and png.read_bytes() == before


def test_what_cannot_be_viewed_is_a_sentence(result_path, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(InputError, match=r"there is no screen for a window .* add --png, --gif or --mp4"):
        show(result_path)
    with pytest.raises(InputError, match="time 300 ms is outside the stored samples; give a time from 0 to 100 ms"):
        show(result_path, files=["png"], folder=tmp_path, time_s=0.3)
    with pytest.raises(InputError, match="a picture of 10x99999 pixels is not possible"):
        show(result_path, files=["png"], folder=tmp_path, size_px=(10, 99999))
    with pytest.raises(InputError, match="a film of 0 s is not possible"):
        show(result_path, files=["gif"], folder=tmp_path, film_s=0.0)
    # With a display that does not exist VTK ends in a segmentation fault, which must not reach this process.
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkXOpenGLRenderWindow")
    monkeypatch.setenv("DISPLAY", ":987")
    with pytest.raises(MachineError, match="could not render"):
        show(result_path, files=["png"], folder=tmp_path)
    assert not list(tmp_path.iterdir())


def test_keys_of_the_window(result_path):
    """Off the screen, in a process of its own: a machine that cannot render ends it."""
    code = f"""
from explicitfe.results.files import open_result
from explicitfe.app.view.scene.scene import Look
from explicitfe.app.view.scene.window import Window
with open_result({str(result_path)!r}) as result:
    window = Window(result, Look(), (200, 150), None, on_screen=False)
    keys, seen = window.keys(), [window.frame]
    keys["Right"](); seen.append(window.frame)
    keys["space"](); window.tick(); seen.append(window.frame)
    keys["space"](); window.tick(); seen.append(window.frame)
    keys["o"](); keys["b"](); seen.append((window.look.view, window.look.bones, window.frame))
    print(seen)
"""
    try:
        said = python(code).stdout
    except AssertionError as failed:
        if "Traceback" in str(failed):  # an error of the program; VTK that cannot render ends the process without one
            raise
        pytest.skip("this machine cannot render")
    assert said.strip().endswith("[2, 0, 1, 1, ('oblique', False, 1)]")
