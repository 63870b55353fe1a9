"""What is drawn around a built-in tongue: teeth that move with the jaw and keep clear of the tongue, and a thin palate."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import command
from scipy.spatial.transform import Rotation
from support import ROOT, result_writer
from tiny_result import python

from explicitfe.app.view.mouth import CROWNS_MM, drawn_bones, teeth_of
from explicitfe.fem.bones.surface import TriangleSurface, depth_inside
from explicitfe.fem.bones.tables import read_bones
from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.results.files import FINISHED, Quantity, StoredBone, open_result
from explicitfe.simulate.anatomy import catalogue

TURN_DEG, SHIFT_M = -10.0, np.array([-0.001, 0.0, -0.002])
# How far a drawn crown may reach into the tongue at rest. The jaw in contact reaches in by up to 2.5 mm, at its attachments.
INTO_TONGUE_MM = 0.5


def write_mouth(path: Path, **scenario: object) -> Path:
    """The coarse tongue at rest, and with an open jaw."""
    mesh = catalogue.built_in("tongue", resolution="coarse").mesh
    bones = read_bones(ROOT / "models" / "tongue" / "bones.toml")
    rotation = Rotation.from_euler("y", TURN_DEG, degrees=True).as_matrix()
    placements = [np.append(np.eye(3), np.zeros(3)), np.append(rotation, SHIFT_M)]
    with result_writer(
        path,
        mesh=mesh,
        bones={name: (bone.surface.points, bone.surface.triangles) for name, bone in bones.items()},
        history={"bone_jaw_placement": Quantity("1", 12)},
        model={"airway": {}, "scenario": scenario},
    ) as result:
        for number, placement in enumerate(placements):
            result.sample(0.1 * number, {"bone_jaw_placement": placement}, {"displacement": np.zeros_like(mesh.points)}, {})
        return result.finish(FINISHED, "", {})


@pytest.fixture(scope="module")
def mouth(tmp_path_factory) -> Path:
    return write_mouth(tmp_path_factory.mktemp("mouth") / "open.vtkhdf")


def test_crowns_are_closed_and_as_large_as_stated(mouth):
    with open_result(mouth) as result:
        arches = teeth_of(result)
        assert set(arches) == set(CROWNS_MM)
        for name, teeth in arches.items():
            points, crowns = 1e3 * teeth.points, 2 * len(CROWNS_MM[name])
            assert TriangleSurface(points, teeth.triangles).volume_m3 > 0.0  # seen from outside
            np.testing.assert_allclose(points[: len(points) // 2] * [1.0, -1.0, 1.0], points[len(points) // 2 :])
            widths = [np.ptp(crown, axis=0)[:2].sum() for crown in points.reshape(crowns, -1, 3)]
            for width, (_, mesiodistal, labiolingual) in zip(widths, CROWNS_MM[name], strict=False):
                assert 0.5 < width / (mesiodistal + labiolingual) < 1.5  # turned, it is wider
        # The edges of the incisors are those of the bones.
        for name, end in (("palate", np.min), ("jaw", np.max)):
            front = result.bones[name].points[np.abs(result.bones[name].points[:, 1]) < 0.002]
            near = front[front[:, 0] < front[:, 0].min() + 0.005, 2]
            incisor = arches[name].points[np.abs(arches[name].points[:, 1]) < 0.004, 2]
            assert 1e3 * abs(end(incisor) - end(near)) < 0.7


def test_teeth_keep_clear_of_the_tongue_at_rest(mouth):
    with open_result(mouth) as result:
        corners, _ = surface_triangles(result.mesh, result.mesh.points)
        tongue = TriangleSurface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        for teeth in teeth_of(result).values():
            assert 1e3 * depth_inside(tongue, teeth.points).max() < INTO_TONGUE_MM


def test_the_palate_is_thin_and_its_underside_the_stored_one(mouth):
    with open_result(mouth) as result:
        stored, drawn = result.bones["palate"], drawn_bones(result)["palate"]
        assert drawn_bones(result)["jaw"] is result.bones["jaw"]
    lowered = stored.points[:, 2] - drawn.points[:, 2]
    np.testing.assert_allclose(drawn.points[:, :2], stored.points[:, :2], atol=1e-12)
    assert lowered.min() > -1e-12 and 1e3 * lowered.max() == pytest.approx(13.0, abs=0.1)
    underside = np.isclose(lowered, 0.0)
    assert underside.mean() > 0.4


@pytest.mark.parametrize("model", ["tongue", "tongue-1"])
def test_teeth_are_shifted_with_their_bone(model):
    shift = np.array([0.002, -0.001, 0.003])
    bones = catalogue.bones(model)
    assert bones["palate"].hard is not None
    for name, surface in (("palate", bones["palate"].hard), ("jaw", bones["jaw"].surface)):
        stated = {"model": {"airway": {}}, "bones": {name: StoredBone(surface.points, surface.triangles)}}
        moved = stated | {"bones": {name: StoredBone(surface.points + shift, surface.triangles)}}
        at_rest, shifted = (teeth_of(SimpleNamespace(**given))[name].points for given in (stated, moved))
        np.testing.assert_allclose(shifted, at_rest + shift, atol=1e-12)


def test_bones_of_a_file_have_no_drawn_teeth(tmp_path):
    own = write_mouth(tmp_path / "own.vtkhdf", bone=[{"name": "palate", "file": "own.stl"}, {"name": "jaw", "file": None}])
    with open_result(own) as result:
        assert list(teeth_of(result)) == ["jaw"]
        assert drawn_bones(result)["palate"] is result.bones["palate"]


def test_teeth_move_with_the_jaw(mouth):
    code = f"""
import pyvista
from explicitfe.results.files import open_result
from explicitfe.app.view.scene.scene import Look, Scene
with open_result({str(mouth)!r}) as result:
    scene = Scene(result, [0, 1], Look("side"), pyvista.Plotter(off_screen=True))
    scene.show(1)
    ivory = [actor for actor in scene.plotter.actors.values() if getattr(getattr(actor, "prop", None), "specular", 0.0) == 0.3]
    print([actor.user_matrix[:3, 3].round(6).tolist() for actor in ivory])
"""
    try:
        said = python(code).stdout
    except AssertionError as failed:
        if "Traceback" in str(failed):  # an error of the program; VTK that cannot render ends the process without one
            raise
        pytest.skip("this machine cannot render")
    shifts = json.loads(said.strip().splitlines()[-1])
    assert len(shifts) == 4  # behind and in front of the plane, above and below
    assert sorted(shifts) == sorted(2 * [[0.0, 0.0, 0.0]] + 2 * [(1e3 * SHIFT_M).tolist()])


def test_an_unknown_viewpoint_is_a_sentence(mouth, tmp_path, capsys):
    assert command(["view", str(mouth), "--from", "behind", "--png", "--out", str(tmp_path)]) == 2
    assert (
        capsys.readouterr()
        .err.strip()
        .endswith('"behind" is not a viewpoint; valid are: front, midsagittal, oblique, side, top.')
    )
    assert not list(tmp_path.iterdir())
