"""The airway of known channels, and of the built-in tongue at rest and moved as a rigid body: no run is needed for that."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import check_answer
from command import command
from pydantic import ValidationError
from support import result_writer

from explicitfe.app.view.airway import airway_figure
from explicitfe.app.view.palette import save
from explicitfe.platform.errors import InputError
from explicitfe.results.files import FINISHED, Quantity, open_result
from explicitfe.results.files.airway_table import AirwayTable
from explicitfe.results.measure.airway import (
    Surroundings,
    airway_midline,
    airway_table,
    cut_sections,
    open_area,
    surroundings,
    wall_surface,
)
from explicitfe.results.measure.courses import constriction_course, formant_course
from explicitfe.results.measure.formants import Piece, airway, formants_of, limit_by_leak
from explicitfe.results.measure.measure import measure
from explicitfe.results.measure.tract import SectionPlane
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.run.transient import TransientAnalysis
from explicitfe.simulate.scenario.lips import LipsTable
from explicitfe.simulate.scenario.transient import TransientScenario

TABLE = catalogue.airway("tongue")
assert TABLE is not None
AIRWAY = TABLE.model_dump(mode="json")
TIMES_S = (0.0, 0.1)
REGIONS = ["larynx", "epiglottis", "pharynx", "mouth", "lips"]


def tongue(
    path: Path,
    shift_mm: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    lips: dict[str, Any] | None = None,
    bone: Sequence[dict[str, Any]] = (),
    bones: Sequence[str] = ("palate", "jaw"),
    jaw_down_mm: float = 0.0,
    wider: float = 1.0,
    stored: dict[str, Any] | None = AIRWAY,
) -> Path:
    """A result in which the built-in tongue goes from rest to a shift along x, y and z as a rigid body, and the jaw down.

    Its width may be multiplied on the way.
    """
    mesh = catalogue.built_in("tongue", "coarse").mesh
    shapes = {name: catalogue.bones("tongue")[name].surface for name in bones}
    scenario = {"title": "Shifted", "analysis": {"type": "transient"}, "bone": list(bone), **({"lips": lips} if lips else {})}
    with result_writer(
        path,
        mesh=mesh,
        bones={name: (shape.points, shape.triangles) for name, shape in shapes.items()},
        point_fields={},
        history={"bone_jaw_placement": Quantity("1", 12)},
        scenario_text="",
        model={"name": "tongue", "scenario": scenario, "airway": stored},
        provenance={},
        overwrite=True,
    ) as result:
        for time, share in zip(TIMES_S, (0.0, 1.0), strict=True):
            placement = np.concatenate([np.eye(3).ravel(), [0.0, 0.0, -1e-3 * share * jaw_down_mm]])
            result.sample(
                time,
                {"bone_jaw_placement": placement},
                {"displacement": share * (1e-3 * np.array(shift_mm) + mesh.points * [0.0, wider - 1.0, 0.0])},
            )
        return result.finish(FINISHED, "", {})


def sheet(line: np.ndarray, half_width: float) -> np.ndarray:
    """Triangles (m, 3, 3) of a line (k, 2) in x and z that is drawn out to both sides."""
    sides = [np.column_stack([line[:, 0], np.full(len(line), y), line[:, 1]]) for y in (-half_width, half_width)]
    a, b, c, d = sides[0][:-1], sides[0][1:], sides[1][1:], sides[1][:-1]
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def bend(radius: float, straight: float) -> np.ndarray:
    """A line up along z, around a quarter of a circle about the origin, and forward along -x."""
    turn = np.linspace(0.0, 0.5 * np.pi, 400)
    arc = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    return np.concatenate([[[radius, -straight]], arc, [[-straight, radius]]])


def test_a_bent_channel_of_one_width():
    outer, inner, straight, half_width, below = 0.040, 0.030, 0.030, 0.011, 0.004
    around = Surroundings(
        # Longer than the line, so that the midline ends with it.
        outer=sheet(bend(outer, straight + 0.01), half_width),
        inner=sheet(bend(inner, straight + 0.01), half_width),
        line=bend(outer, straight),
        incisors=None,
        middle=0.0,
        lowest=below - straight,
    )
    line = airway_midline(around)
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    # A Gaussian of 5 mm takes 5^2 / (2 R) = 0.36 mm off the bend's radius R of 35 mm, and 0.6 mm off the length; that is rounded
    # to 0.05 mm, half a thousandth, and where the bend begins and ends the Gaussian takes off less.
    assert length == pytest.approx(2.0 * straight - below + 0.5 * np.pi * 0.5 * (outer + inner) - 0.6e-3, rel=0.001)
    sections = cut_sections(line, around)
    for section in sections:
        assert section.area == pytest.approx((outer - inner) * 2.0 * half_width, rel=0.01)
    assert [section.region for section in sections] == sorted([section.region for section in sections], reverse=True)


def test_the_air_in_the_place_of_half_a_tongue_counts():
    level = np.array([[0.03, 0.0], [-0.03, 0.0]])
    halves = [sheet(level + [0.0, z], 0.011) for z in (0.010, -0.005)]
    for half, side in zip(halves, (-1.0, 1.0), strict=True):
        half[:, :, 1] = 0.5 * (half[:, :, 1] + side * 0.011)
    around = Surroundings(
        outer=sheet(level + [0.0, 0.020], 0.011),
        inner=np.concatenate(halves),
        line=level,
        incisors=None,
        middle=0.0,
        lowest=0.0,
    )
    plane = SectionPlane(np.array([0.0, 0.0, 0.016]), np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]))
    assert open_area(plane, around) == pytest.approx(0.011 * (0.010 + 0.025), rel=1e-6)


@pytest.mark.parametrize(
    "lips, says",
    [
        ({}, "give area_mm2 and length_mm"),
        ({"area_mm2": 100.0}, "give area_mm2 and length_mm"),
        ({"area_mm2": 100.0, "length_mm": 9.0, "table": [[0.0, 100.0, 9.0]]}, "and not both"),
        ({"table": [[10.0, 100.0, 9.0], [10.0, 90.0, 9.0]]}, "must rise"),
        ({"table": [[0.0, -1.0, 9.0]]}, "must not be negative"),
    ],
)
def test_lips_that_make_no_sense_are_refused(lips, says):
    with pytest.raises(ValidationError, match=says):
        LipsTable.model_validate(lips)


def test_a_run_stores_what_the_airway_needs(tmp_path):
    scenario = {
        "title": "Rest",
        "model": {"name": "tongue", "resolution": "coarse"},
        "bone": [{"name": "palate"}],
        "lips": {"area_mm2": 80.0, "length_mm": 12.0},
        "analysis": {"duration_ms": 1.0},
    }
    lines = TransientAnalysis.prepare(tmp_path / "rest.toml", TransientScenario.model_validate(scenario), "").describe()
    assert AirwayTable.model_validate(lines["airway"]) == TABLE
    assert lines["scenario"]["lips"] == scenario["lips"] | {"table": []}


@pytest.mark.parametrize("lips", [None, {"area_mm2": 0.0, "length_mm": 10.0}], ids=["open", "closed"])
def test_the_picture_of_the_airway(tmp_path, lips):
    path = tongue(tmp_path / "a.vtkhdf", lips=lips)
    with open_result(path) as result:
        figure = airway_figure(result, 1, over_time=True)
    assert figure is not None
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert "area function" in titles and "formants over time" in titles
    assert ("closed: no formants" in titles) == (lips is not None)
    save(figure, tmp_path / "a.png")
    with open_result(tongue(tmp_path / "b.vtkhdf", stored=None)) as result:
        assert airway_figure(result, 1) is None


def test_the_wall_passes_its_figures_and_is_its_own_mirror_image():
    assert TABLE is not None
    triangles, line = wall_surface(TABLE.wall)
    np.testing.assert_allclose(
        np.interp(TABLE.wall.height_mm, 1e3 * line[:, 1], 1e3 * line[:, 0]), [row[0] for row in TABLE.wall.back_mm], atol=0.05
    )
    corners = triangles.reshape(-1, 3)
    mirrored = np.unique(np.round(corners * [1.0, -1.0, 1.0], 9), axis=0)
    np.testing.assert_allclose(mirrored, np.unique(np.round(corners, 9), axis=0), atol=1e-9)
    for row in (0, 5):
        level = corners[np.abs(corners[:, 2] - 1e-3 * TABLE.wall.height_mm[row]) < 1.3e-3]
        assert 1e3 * np.abs(level[:, 1]).max() == pytest.approx(TABLE.wall.half_width_mm[row], abs=1.0)


def test_the_tongue_at_rest_is_nearly_a_uniform_tube(tmp_path):
    answer = airway(tongue(tmp_path / "a.vtkhdf"))
    sections = answer.sections
    ends = [section.to_mm for section in sections]
    assert [section.from_mm for section in sections] == pytest.approx([0.0, *ends[:-1]])
    assert sorted({section.region for section in sections}, key=REGIONS.index) == REGIONS
    assert [section.region for section in sections] == sorted([section.region for section in sections], key=REGIONS.index)
    assert {section.region for section in sections if section.source == "geometry"} == {"pharynx", "mouth"}
    assert answer.length_mm == ends[-1] and 150.0 < answer.length_mm < 175.0
    assert (sections[0].area_mm2, sections[-1].area_mm2) == (28.0, 150.0)
    quarter_hz = 350.0 / (4e-3 * answer.length_mm) * np.array([1.0, 3.0, 5.0])
    np.testing.assert_allclose([formant.frequency_hz for formant in answer.formants], quarter_hz, rtol=0.15)
    measured = [section.area_mm2 for section in sections if section.source == "geometry"]
    assert answer.smallest_area_mm2 == min(measured) and not answer.closed


def test_a_tongue_that_is_forward_and_up_lowers_f1_and_raises_f2(tmp_path):
    at_rest = airway(tongue(tmp_path / "a.vtkhdf", (-4.0, 0.0, 2.0)), 0.0)
    moved = airway(tmp_path / "a.vtkhdf")
    assert moved.formants[0].frequency_hz < at_rest.formants[0].frequency_hz - 50.0
    assert moved.formants[1].frequency_hz > at_rest.formants[1].frequency_hz + 50.0
    # 4 mm forward and 2 mm up widen the gap by 2 to 4 mm, less where the tongue faces the velum, over a width of some 40 mm.
    pharynx = [np.mean([s.area_mm2 for s in each.sections if s.region == "pharynx"]) for each in (at_rest, moved)]
    assert 80.0 < pharynx[1] - pharynx[0] < 160.0


def test_lips_of_the_scenario_and_what_they_change(tmp_path):
    neutral = airway(tongue(tmp_path / "a.vtkhdf"))
    half = airway(tongue(tmp_path / "b.vtkhdf", lips={"area_mm2": 75.0, "length_mm": 10.0}))
    assert neutral.shifts is not None
    assert neutral.shifts.lips_area_times_half == pytest.approx([formant.frequency_hz for formant in half.formants])
    assert neutral.shifts.larynx_tube_5_mm_longer[2] < neutral.formants[2].frequency_hz
    rounding = {"table": [[0.0, 150.0, 10.0], [200.0, 50.0, 20.0]]}
    course = tongue(tmp_path / "c.vtkhdf", lips=rounding)
    last = airway(course).sections[-1]
    assert (last.area_mm2, last.to_mm - last.from_mm) == pytest.approx((100.0, 15.0))
    frequency = [formant.frequency_hz for formant in neutral.formants]
    with open_result(course) as result:
        formants = formant_course(result)
        constriction = constriction_course(result)
    assert formants.time.tolist() == list(TIMES_S)
    assert formants.frequency[0] == pytest.approx(frequency)
    assert np.all(formants.frequency[1] < formants.frequency[0])
    measured = measure(course).constriction
    assert measured is not None
    assert (1e3 * constriction.width[-1], 1e3 * constriction.place[-1]) == pytest.approx((measured.width_mm, measured.place_mm))
    shut = airway(tongue(tmp_path / "d.vtkhdf", lips={"area_mm2": 0.0, "length_mm": 10.0}))
    assert shut.closed and shut.formants == [] and shut.shifts is None


def test_a_tongue_pressed_to_the_palate_closes_the_airway(tmp_path):
    path = tongue(tmp_path / "a.vtkhdf", (0.0, 0.0, 11.0), wider=1.3)
    answer = airway(path)
    assert answer.closed and answer.smallest_area_mm2 == 0.0
    with open_result(path) as result:
        assert np.isnan(formant_course(result).frequency[1]).all()


def test_a_tongue_that_leaves_a_way_beside_the_molars_does_not_close_the_airway(tmp_path):
    # The plane sections end at its sides, and have no area.
    path = tongue(tmp_path / "a.vtkhdf", (0.0, 0.0, 11.0), wider=0.7)
    answer, leak = airway(path), measure(path).leak
    assert leak is not None and leak.over_plate_mm == 0.0 and leak.width_mm > 1.0 and abs(leak.side_mm) > 10.0
    assert not answer.closed and len(answer.formants) == 3
    assert answer.smallest_area_mm2 == pytest.approx(leak.area_mm2)


def test_a_closed_leak_closes_the_narrowest_section_of_the_mouth():
    pieces = [Piece("pharynx", "geometry", 1.0, 5.0), *(Piece("mouth", "geometry", 1.0, area) for area in (30.0, 20.0, 40.0))]
    assert [piece.area_mm2 for piece in limit_by_leak(pieces, 0.0)] == [5.0, 30.0, 0.0, 40.0]
    assert limit_by_leak(pieces, 25.0) == pieces
    shut = [*pieces, Piece("mouth", "geometry", 1.0, 0.0)]
    assert [piece.area_mm2 for piece in limit_by_leak(shut, 25.0)] == [5.0, 30.0, 25.0, 40.0, 25.0]


def test_the_jaw_opens_the_front(tmp_path):
    opened = tongue(tmp_path / "a.vtkhdf", (15.0, 0.0, 0.0), jaw_down_mm=10.0)
    shut = tongue(tmp_path / "b.vtkhdf", (15.0, 0.0, 0.0))
    fronts = [np.mean([s.area_mm2 for s in airway(path).sections[-4:-1]]) for path in (opened, shut)]
    assert fronts[0] > fronts[1] + 100.0  # 10 mm more over a width of more than 10 mm
    without = airway(tongue(tmp_path / "c.vtkhdf", bones=("palate",)))
    assert (without.sections[-2].region, without.sections[-2].source) == ("teeth", "assumed")
    assert len(formants_of(without.sections)) == 3


def test_the_wall_goes_with_a_palate_that_is_shifted(tmp_path):
    lines = []
    for name, bone in (("a", {"name": "palate"}), ("b", {"name": "palate", "shift_mm": [2.0, 0.0, -1.0]})):
        with open_result(tongue(tmp_path / f"{name}.vtkhdf", bone=[bone])) as result:
            around = surroundings(result, 0, airway_table(result))
            lines.append(around.line[0])
            lowest = around.lowest
    np.testing.assert_allclose(lines[1] - lines[0], [2e-3, -1e-3], atol=1e-12)
    assert lowest == pytest.approx(71e-3)


def test_what_has_no_airway_is_refused(tmp_path, capsys):
    with pytest.raises(InputError, match="run the scenario again"):
        airway(tongue(tmp_path / "a.vtkhdf", stored=None))
    with pytest.raises(InputError, match='named "palate"'):
        airway(tongue(tmp_path / "b.vtkhdf", bones=("jaw",)))
    assert command(["measure", str(tmp_path / "a.vtkhdf"), "--formants"]) == 2
    assert "has no airway" in capsys.readouterr().err


def test_the_command_prints_and_stores_it(tmp_path, capsys):
    path = tongue(tmp_path / "a.vtkhdf")
    assert command(["measure", str(path), "--formants", "--json"]) == 0
    (answer,) = check_answer("measure", capsys.readouterr().out)["results"]
    expected = airway(path)
    assert answer["airway"] == json.loads(expected.model_dump_json())
    assert command(["measure", str(path), "--formants"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert f"F1 {expected.formants[0].frequency_hz:.0f} Hz" in text
    assert command(["measure", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["results"][0]["airway"] is None
