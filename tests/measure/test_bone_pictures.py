"""Pictures of results with bones: what is cut of them, where they were at rest, and the constriction as it is measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import ROOT, result_writer

from explicitfe.app.view.bones import AROUND_TONGUE_MM
from explicitfe.app.view.draw import draw
from explicitfe.app.view.tongue import contour_figure, coronal_figure
from explicitfe.fem.bones.tables import read_bones
from explicitfe.results.files import FINISHED, Quantity, Result, open_result
from explicitfe.results.measure.measure import measures_of, nearest_of
from explicitfe.simulate.anatomy import catalogue

JAW_DOWN_M = 0.004


@pytest.fixture(scope="module")
def result_path(tmp_path_factory) -> Path:
    """The built-in tongue, its front raised by up to 4 mm, and the jaw 4 mm lower at the end."""
    mesh = catalogue.built_in("tongue", cells=(8, 4, 4)).mesh
    bones = read_bones(ROOT / "models" / "tongue" / "bones.toml")
    raised = np.zeros_like(mesh.points)
    raised[:, 2] = 0.004 * np.exp(-(((mesh.points[:, 0] - 0.08) / 0.02) ** 2)) * np.clip((mesh.points[:, 2] - 0.08) / 0.03, 0, 1)
    path = tmp_path_factory.mktemp("bones") / "raised.vtkhdf"
    with result_writer(
        path,
        mesh=mesh,
        bones={name: (bone.surface.points, bone.surface.triangles) for name, bone in bones.items()},
        history={"bone_jaw_placement": Quantity("1", 12)},
        scenario_text="",
        model={"scenario": {"title": "Raised"}},
        provenance={},
    ) as result:
        for share in (0.0, 0.5, 1.0):
            placement = np.concatenate([np.eye(3).ravel(), [0.0, 0.0, -JAW_DOWN_M * share]])
            result.sample(0.1 * share, {"bone_jaw_placement": placement}, {"displacement": share * raised})
        return result.finish(FINISHED, "", {})


@pytest.fixture
def result(result_path):
    with open_result(result_path) as opened:
        yield opened


def bone_patches(axes) -> list[np.ndarray]:
    """The filled outlines of bones in a panel."""
    labelled = next(patch for patch in axes.patches if str(patch.get_label()).startswith("bone"))
    colour = labelled.get_facecolor()
    return [patch.get_xy() for patch in axes.patches if patch.get_facecolor() == colour]


def test_the_contour_shows_palate_and_jaw_and_the_constriction(result: Result):
    figure = contour_figure(result, 2)
    axes = figure.axes[0]
    outlines = bone_patches(axes)
    assert len(outlines) == 2  # one of each bone in the midsagittal plane
    palate = max(outlines, key=lambda outline: outline[:, 1].max())
    # The underside of the table in the midline: z = 122 mm at x = 90 and 100 mm, 101 mm at the edge of the incisors, x = 50 mm.
    for x, z in ((90.0, 122.0), (100.0, 122.0), (50.0, 101.0)):
        assert np.linalg.norm(palate - [x, z], axis=1).min() < 0.2
    nearest = nearest_of(result, 2)
    answer = measures_of(result, 2).constriction
    assert 1e3 * nearest.width == pytest.approx(answer.width_mm)
    assert 1e3 * np.linalg.norm(nearest.on_palate - nearest.on_tongue) == pytest.approx(answer.width_mm)
    assert f"{answer.width_mm:.1f} mm" in [text.get_text() for text in axes.texts]
    line = next(line for line in axes.lines if line.get_label() == "constriction")
    np.testing.assert_allclose(line.get_xydata(), 1e3 * np.stack([nearest.on_tongue, nearest.on_palate]))


def test_a_bone_that_has_moved_is_seen_at_rest_too(result: Result):
    axes = contour_figure(result, 2).axes[0]
    at_rest = next(line for line in axes.lines if line.get_label() == "bone at rest").get_xydata()
    jaw = min(bone_patches(axes), key=lambda outline: outline[:, 1].max())
    np.testing.assert_allclose(jaw[:, 1].max(), at_rest[:, 1].max() - 1e3 * JAW_DOWN_M)
    halfway = contour_figure(result, 1).axes[0]
    jaw = min(bone_patches(halfway), key=lambda outline: outline[:, 1].max())
    np.testing.assert_allclose(jaw[:, 1].max(), at_rest[:, 1].max() - 0.5e3 * JAW_DOWN_M)


def test_the_coronal_section_shows_bones_where_it_is_now(result: Result):
    figure = coronal_figure(result, 2)
    where, axes = figure.axes
    palate = max(bone_patches(axes), key=lambda outline: outline[:, 1].max())
    # The point "front" rises straight up, so the section stays at its x = 78.3 mm, where the underside is 120.4 mm high.
    lowest_in_midline = palate[np.abs(palate[:, 0]) < 0.5, 1].min()
    assert lowest_in_midline == pytest.approx(120.4, abs=0.5)
    assert len(where.patches) >= 2


def test_panels_keep_to_the_tongue(result: Result):
    mesh = result.mesh
    figure = contour_figure(result, 2)
    low, high = 1e3 * mesh.points.min(axis=0), 1e3 * (mesh.points + result.displacement(2)).max(axis=0)
    assert figure.axes[0].get_xlim() == pytest.approx((low[0] - AROUND_TONGUE_MM, high[0] + AROUND_TONGUE_MM))
    assert figure.axes[0].get_ylim()[0] == pytest.approx(low[2] - AROUND_TONGUE_MM)


def test_all_pictures_are_drawn(result_path: Path, tmp_path: Path):
    from matplotlib.image import imread

    paths = [Path(name) for name in draw(result_path, tmp_path)["files"]]
    assert [path.name for path in paths[:2]] == ["raised-contour.png", "raised-coronal.png"]
    for path in paths:
        pixels = imread(path)[:, :, :3]
        rows, columns = pixels.min(axis=(1, 2)), pixels.min(axis=(0, 2))
        assert min(*rows[:4], *rows[-4:], *columns[:4], *columns[-4:]) == 1.0  # nothing is cut off
