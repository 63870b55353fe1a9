"""The pictures of a result, and the numbers that they are drawn from.

Sections are checked on shapes whose cut is known: a box cut along an axis is a rectangle, cut anywhere.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from explicitfe.app.view import hourglass, muscles, times, tongue
from explicitfe.app.view.draw import draw
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.results.measure import sections
from explicitfe.results.measure.sections import X, Y, Z, section
from explicitfe.results.measure.steps import last_step
from explicitfe.simulate.run.run import run

CELLS = (8, 4, 4)
SCENARIO = f"""
title = "Tiny tongue"
[model]
name = "tongue"
cells = {list(CELLS)}
material = "buchaillard-2009"
damping = {{ alpha_per_s = 40.0 }}
[[muscle]]
name = "GGp"
force_N = 1.0
start_ms = 1.0
end_ms = 3.0
distribution = "along"
[analysis]
duration_ms = 5.0
[record]
every_ms = 0.5
"""


@pytest.fixture(scope="module")
def result_path(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("figures")
    scenario = folder / "tiny.toml"
    scenario.write_text(SCENARIO, encoding="utf-8")
    summary = run(scenario, folder)
    assert summary["status"] == "finished"
    return Path(summary["result"])


def box(cells: tuple[int, int, int], lower=(0.0, -0.5, 0.0), upper=(2.0, 0.5, 1.0)) -> HexMesh:
    ny, nz = cells[1] + 1, cells[2] + 1
    axes = [np.linspace(a, b, count + 1) for a, b, count in zip(lower, upper, cells, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    i, j, k = (index.ravel() for index in np.meshgrid(*map(np.arange, cells), indexing="ij"))
    node = (i * ny + j) * nz + k
    corners = [0, ny * nz, ny * nz + nz, nz]
    return HexMesh(points, np.column_stack([node + c + up for up in (0, 1) for c in corners]))


def area(loop: np.ndarray) -> float:
    """Area in a closed polygon, (k, 2)."""
    x, y = loop.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def test_every_picture_is_drawn(result_path, tmp_path):
    from matplotlib.image import imread

    paths = [Path(name) for name in draw(result_path, tmp_path / "pictures")["files"]]
    names = [path.name for path in paths]
    drawn = ["contour", "coronal", "probes", "energies"]
    # A machine that cannot render gives a sentence and four pictures, see the test below.
    assert names[:4] == [f"tiny-{name}.png" for name in drawn]
    assert names[4:] in ([], ["tiny-3d.png", "tiny-hourglass.png"])
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == sorted(names)
    for path in paths:
        pixels = imread(path)[:, :, :3]
        assert pixels.shape[1] == 1600
        assert pixels.shape[0] > 600
        assert pixels.std() > 0.05
        if path.stem.endswith(("-3d", "-hourglass")):  # more than the colour bar is coloured
            assert np.mean(np.ptp(pixels, axis=2) > 0.2) > 0.08
        # Nothing is cut off: what is drawn keeps away from the edges.
        rows, columns = pixels.min(axis=(1, 2)), pixels.min(axis=(0, 2))
        assert min(*rows[:4], *rows[-4:], *columns[:4], *columns[-4:]) == 1.0


def test_without_opengl_the_other_pictures_are_drawn(result_path, tmp_path, monkeypatch):
    # With a display that does not exist VTK ends in a segmentation fault, which must not reach this process.
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkXOpenGLRenderWindow")
    monkeypatch.setenv("DISPLAY", ":987")
    drawn = draw(result_path, tmp_path, only=["energies", "3d", "hourglass"])
    assert [Path(name).name for name in drawn["files"]] == ["tiny-energies.png"]
    (note,) = drawn["warnings"]
    assert note.startswith("the pictures 3d and hourglass were not drawn: this machine could not render it")


def test_a_result_without_a_step_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        draw(tmp_path / "none.vtkhdf")


def test_midsagittal_outline_of_the_tongue(result_path):
    with open_result(result_path) as result:
        mesh, u = result.mesh, result.displacement()
    cut = sections.midsagittal(mesh)
    assert len(cut.loops) == 1
    # One point for each node on the edge of the grid of elements along the tongue and through its thickness.
    assert len(cut.loops[0]) == len(cut.share) == 2 * (CELLS[0] + CELLS[1])
    assert len(set(cut.loops[0])) == len(cut.loops[0])
    np.testing.assert_array_equal(cut.ends[:, 0], cut.ends[:, 1])
    np.testing.assert_array_equal(cut.at(mesh.points)[:, Y], 0.0)
    # Both sides are pulled alike: the plane stays one, to rounding.
    assert np.abs(cut.at(u)[:, Y]).max() < 1e-9 * np.abs(u).max()
    outline = cut.outline(mesh.points)
    # The named points lie on the outline: on a straight piece between two of its points.
    for point in mesh.named_points.values():
        legs = np.linalg.norm(outline[:-1] - point.position, axis=1)
        assert np.nanmin(legs[:-1] + legs[1:] - np.linalg.norm(np.diff(outline[:-1], axis=0), axis=1)) < 1e-12
    np.testing.assert_array_equal(outline[0], outline[-2])
    assert np.isnan(outline[-1]).all()


def test_coronal_section_of_the_tongue(result_path):
    with open_result(result_path) as result:
        mesh = result.mesh
    position = sections.station(mesh, "front")
    assert position == mesh.named_points["front"].position[0, X]
    cut = section(mesh, X, position)
    assert len(cut.loops) == 1
    points = cut.at(mesh.points)
    np.testing.assert_allclose(points[:, X], position, rtol=0.0, atol=1e-15)
    # As wide to the left as to the right, point by point.
    mirrored = points * [1.0, -1.0, 1.0]
    assert max(np.linalg.norm(points - p, axis=1).min() for p in mirrored) < 1e-12
    top = sections.midline(points)[-1]
    np.testing.assert_allclose(points[top], mesh.named_points["front"].position[0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("axis", [X, Y, Z])
@pytest.mark.parametrize("share", [0.5, 0.37])
def test_section_of_a_box_is_a_rectangle(axis, share):
    mesh = box((4, 2, 3))
    size = np.ptp(mesh.points, axis=0)
    cut = section(mesh, axis, mesh.points[:, axis].min() + share * size[axis])
    assert len(cut.loops) == 1
    others = [k for k in (X, Y, Z) if k != axis]
    np.testing.assert_allclose(area(cut.at(mesh.points)[cut.loops[0]][:, others]), np.prod(size[others]), rtol=1e-12)
    # The outline moves with the material: a linear field is interpolated exactly.
    gradient = np.array([[0.1, 0.2, -0.3], [0.0, 0.5, 0.1], [0.7, 0.0, -0.2]])
    np.testing.assert_allclose(cut.at(mesh.points @ gradient), cut.at(mesh.points) @ gradient, atol=1e-15)


def test_section_of_an_odd_number_of_elements_and_of_a_half():
    odd = box((2, 3, 2))
    assert sections.middle(odd) == 0.0
    assert len(sections.midsagittal(odd).loops[0]) == 8
    shifted = box((2, 3, 2), lower=(0.0, 1.0, 0.0), upper=(2.0, 2.0, 1.0))
    assert sections.middle(shifted) == 1.5
    # A plane that is a side of the body cuts that side; the middle of such a body is elsewhere.
    for half in (box((2, 2, 2), lower=(0.0, 0.0, 0.0)), box((2, 2, 2), upper=(2.0, 0.0, 1.0))):
        cut = section(half, Y, 0.0)
        np.testing.assert_array_equal(cut.at(half.points)[:, Y], 0.0)
        assert abs(sections.middle(half)) == 0.25
        np.testing.assert_array_equal(np.abs(sections.midsagittal(half).at(half.points)[:, Y]), 0.25)
        assert area(cut.at(half.points)[cut.loops[0]][:, [X, Z]]) == pytest.approx(2.0)


def test_section_through_two_bodies_has_two_loops():
    near, far = box((2, 2, 2)), box((2, 2, 2), lower=(5.0, -0.5, 0.0), upper=(6.0, 0.5, 1.0))
    both = HexMesh(np.concatenate([near.points, far.points]), np.concatenate([near.hexes, far.hexes + near.node_count]))
    cut = sections.midsagittal(both)
    assert sorted(len(loop) for loop in cut.loops) == [8, 8]
    assert np.isnan(cut.outline(both.points)[:, 0]).sum() == 2
    assert not section(both, X, 3.5).loops


def test_front_station_without_a_named_point():
    assert sections.station(box((5, 2, 2)), "front") == pytest.approx(0.8)


def test_groove_depth():
    mesh = box((2, 8, 2))
    cut = section(mesh, X, 0.7)
    reference = cut.at(mesh.points)[cut.loops[0]]
    assert sections.groove_depth(reference, reference) == 0.0

    def deformed(height):
        return reference + np.outer(reference[:, Z] * height(reference[:, Y]), [0.0, 0.0, 1.0])

    assert sections.groove_depth(reference, deformed(lambda y: 0.4 * y**2)) == pytest.approx(0.1)
    assert sections.groove_depth(reference, deformed(lambda y: -0.4 * y**2)) == 0.0
    # A slope to one side is no groove.
    assert sections.groove_depth(reference, deformed(lambda y: 0.4 * y)) == 0.0


def test_held_sets_and_last_step(result_path):
    with open_result(result_path) as result:
        step = last_step(result)
        assert step == len(result.times) - 1
        assert sorted(tongue.attachments(result, step)) == sorted(result.mesh.node_sets)
        assert tongue.attachments(result, 0) == {}
        np.testing.assert_allclose(np.nanmax(hourglass.hourglass_share(result)), result.summary["hourglass_share"], rtol=1e-12)


def test_hourglass_map(result_path):
    with open_result(result_path) as result:
        step = last_step(result)
        numbers = hourglass.hourglass_map(result, step)
        mesh, energy = result.mesh, result.field("hourglass_energy", step)
        elastic = result.history("internal_energy")[-1] + result.history("hourglass_energy")[-1]
        summary = result.summary
    volume = volumes(mesh.points, mesh.hexes)
    k = int(np.argmax(energy / volume))
    assert numbers.worst[0] == k
    np.testing.assert_allclose(numbers.percent[k], 100.0 * energy[k] / volume[k] * volume.sum() / elastic, rtol=1e-12)
    # The mean over the volume is the share that the run reports.
    np.testing.assert_allclose(np.average(numbers.percent, weights=volume), numbers.share, rtol=1e-12)
    np.testing.assert_allclose(numbers.share, 100.0 * summary["hourglass_share_end"], rtol=1e-9)
    assert len(set(numbers.worst)) == hourglass.NUMBERED_ELEMENTS
    assert np.all(np.diff(numbers.percent[numbers.worst]) <= 0.0)
    assert np.delete(numbers.percent, numbers.worst).max() <= numbers.percent[numbers.worst[-1]]


class OneStep:
    """What the hourglass map reads of a result."""

    def __init__(self, mesh, energy, displacement, internal):
        self.mesh, self.energy, self.u, self.internal = mesh, energy, displacement, internal
        self.fields, self.times = {"hourglass_energy": None}, np.array([0.0])

    def field(self, name, step):
        return self.energy

    def displacement(self, step):
        return self.u

    def history(self, name):
        return np.array([0.0 if name == "time" else self.internal])


def test_hourglass_map_of_known_numbers():
    mesh = box((4, 1, 1))
    points = mesh.points.copy()
    points[points[:, X] == 2.0, X] = 3.5  # the last element has four times the volume of the others: 2 of 3.5
    mesh = HexMesh(points, mesh.hexes)
    u = np.zeros_like(mesh.points)
    result = OneStep(mesh, np.array([0.0, 1.0, 3.0, 4.0]), u, internal=27.0)
    numbers = hourglass.hourglass_map(result, 0)
    np.testing.assert_allclose(numbers.percent, 100.0 * np.array([0.0, 2.0, 6.0, 2.0]) / 10.0)
    np.testing.assert_array_equal(numbers.worst, [2, 1, 3, 0])
    assert numbers.share == pytest.approx(100.0 * 8.0 / 35.0)
    assert not numbers.folded.any()
    # The corner at one end of the body comes in beyond the next nodes: that element is folded, the others are not.
    u[np.flatnonzero(np.all(mesh.points == [0.0, -0.5, 0.0], axis=1)), X] = 0.6
    np.testing.assert_array_equal(hourglass.hourglass_map(result, 0).folded, [True, False, False, False])
    result.energy = np.zeros(4)
    assert hourglass.hourglass_map(result, 0) is None
    result.fields = {}
    assert hourglass.hourglass_map(result, 0) is None


def test_hourglass_map_is_seen_from_where_the_energy_is():
    mesh = box((4, 4, 4))
    middle = mesh.points[mesh.hexes].mean(axis=1)

    def view(corner):
        return hourglass.outside_view(mesh.points, mesh.hexes, np.exp(9.0 * (middle @ corner)))

    assert view(np.array([1.0, -1.0, 1.0])) == "from behind, left and above"
    assert view(np.array([-1.0, 1.0, -1.0])) == "from the front, right and below"
    assert view(np.zeros(3)) == next(iter(hourglass.OUTSIDE_VIEWS))


def test_times_that_are_drawn():
    assert times.drawn_steps(np.linspace(0.0, 0.12, 121), 120) == [20, 40, 60, 80, 100, 120]
    assert times.drawn_steps(np.linspace(0.0, 0.12, 121), 60) == [10, 20, 30, 40, 50, 60]
    assert times.drawn_steps(np.array([0.0, 0.001, 0.002]), 2) == [1, 2]
    assert times.drawn_steps(np.array([0.0]), 0) == []


def test_activation_of_muscles():
    step = {"name": "a", "force_N": 1.0, "start_ms": 10.0, "rise_ms": 5.0, "end_ms": 40.0}
    ramp = {"name": "b", "force_N": 1.0, "start_ms": 30.0, "end_ms": None}
    table = {"name": "c", "force_N": 1.0, "table": [[0.0, 0.0], [60.0, 0.0], [70.0, 1.0], [80.0, 0.0]]}
    corners, scales = muscles.activation(step, 100.0)
    np.testing.assert_array_equal(corners, [0.0, 10.0, 15.0, 40.0, 40.0, 100.0])
    np.testing.assert_array_equal(scales, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    assert muscles.on_times([step], 100.0) == [(10.0, 40.0)]
    assert muscles.on_times([table, step], 100.0) == [(10.0, 40.0), (60.0, 80.0)]
    assert muscles.on_times([step, ramp], 100.0) == [(10.0, 100.0)]
    assert muscles.on_times([ramp | {"force_N": 0.0}], 100.0) == []
    assert muscles.on_times([step], 20.0) == [(10.0, 20.0)]
