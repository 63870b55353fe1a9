"""Recordings of markers: placing them on the model, bad recordings, fast answers, and a hidden effect that is found."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_beam import BEAM, short_beam

from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.inverse.close_loop.close import find_causes
from explicitfe.inverse.close_loop.outlook import check_dataset
from explicitfe.inverse.close_loop.statistics.system import Candidate
from explicitfe.inverse.close_loop.trajectories.emulator import vibration_of
from explicitfe.inverse.close_loop.trajectories.markers import place_on_model, remarks, rotation_sds
from explicitfe.inverse.close_loop.trajectories.runs import TouchingElements, scenario_with
from explicitfe.inverse.close_loop.trajectories.trajectories import trajectory_system
from explicitfe.inverse.close_loop.trajectories.vibration import features_of
from explicitfe.inverse.measured.curve import TrajectoryDataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError
from studies.moving.make import draw, write_case

ROOT = Path(__file__).resolve().parents[2]
START_S = 0.06  # of the release, up to 2 ms earlier or later (ATTRIBUTION.md)


def test_the_dataset_is_that_of_its_script(tmp_path: Path) -> None:
    """One curve of it, made again; rows are rounded to six digits."""
    body = draw(np.random.default_rng(5))
    rows = np.loadtxt(BEAM / "load0.csv", delimiter=",", skiprows=1)
    write_case(tmp_path / "again", replace(body, loads=body.loads[:1]), "load-mass", 1.0, 6)
    again = np.loadtxt(tmp_path / "again" / "load0.csv", delimiter=",", skiprows=1)
    assert np.abs(again - rows).max() < 2e-3


def dataset(folder: Path) -> TrajectoryDataset:
    data = read_dataset(folder)
    assert isinstance(data, TrajectoryDataset)
    return data


def with_change(folder: Path, change: Callable[[list[str], np.ndarray], np.ndarray], name: str = "load0") -> TrajectoryDataset:
    """The dataset with one of its tables changed: ``change`` gets the names of the columns and the rows."""
    copy = folder / "beam"
    shutil.copytree(BEAM, copy)
    path = copy / f"{name}.csv"
    head = path.read_text(encoding="utf-8").split("\n", 1)[0]
    rows = change(head.split(","), np.loadtxt(path, delimiter=",", skiprows=1))
    lines = [head, *(",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return dataset(copy)


def columns_of(names: list[str], marker: str) -> list[int]:
    return [k for k, name in enumerate(names) if name.startswith(f"{marker}_")]


def placed(data: TrajectoryDataset, name: str = "load0") -> list[str]:
    """Remarks on a curve."""
    curve = next(curve for curve in data.curves if curve.id == name)
    return remarks(curve, place_on_model(curve, data.sensors), data.sensors)


def test_a_recording_is_placed_by_its_rest() -> None:
    data = dataset(BEAM)
    for curve in data.curves:
        one = place_on_model(curve, data.sensors)
        assert abs(one.start_s - START_S) < 2.0 * one.interval_s
        # the places err by 0.2 mm along each axis; the registration takes up six of the 18 coordinates
        assert one.mismatch_m < 2.0 * np.sqrt(3.0) * 2e-4
        sag = one.displacement(curve, "m0")[-1]
        assert sag[2] < -1e-3 and abs(sag[1]) < 0.05 * abs(sag[2])
        assert 1e-6 < one.noise_m < 1e-4
    assert not placed(data)


def test_swapped_markers_are_refused(tmp_path: Path) -> None:
    def swap(names: list[str], rows: np.ndarray) -> np.ndarray:
        first, second = columns_of(names, "m0"), columns_of(names, "m3")
        rows[:, first + second] = rows[:, second + first]
        return rows

    data = with_change(tmp_path, swap)
    with pytest.raises(InputError, match='"m0" and "m3" are swapped'):
        placed(data)
    with pytest.raises(InputError, match='"m0" and "m3" are swapped'):  # `check` says so too
        check_dataset(data.path)


def test_another_unit_is_refused(tmp_path: Path) -> None:
    def times(factor: float) -> Callable[[list[str], np.ndarray], np.ndarray]:
        return lambda names, rows: np.column_stack([rows[:, 0], factor * rows[:, 1:]])

    with pytest.raises(InputError, match=r"0\.0394 times as far as .*check the units"):
        placed(with_change(tmp_path / "inches", times(1.0 / 25.4)))
    with pytest.raises(InputError, match=r"load0\.csv, line .*give mm"):  # before the markers are compared with the model
        with_change(tmp_path / "metres", times(1e-3))


def test_a_recording_that_begins_too_late_is_refused(tmp_path: Path) -> None:
    def late(names: list[str], rows: np.ndarray) -> np.ndarray:
        rows = rows[13:]
        rows[:, 0] -= rows[0, 0]
        return rows

    with pytest.raises(InputError, match="already move"):
        placed(with_change(tmp_path, late))


def test_the_start_is_seen_in_noise_of_two_percent(tmp_path: Path) -> None:
    """Noise alone passes the smallest displacement that counts as motion; the start must still err by two rows at most."""
    rng = np.random.default_rng(4)

    def noisy(names: list[str], rows: np.ndarray) -> np.ndarray:
        moved = np.ptp(rows[:, columns_of(names, "m0")], axis=0).max()
        rows[:, 1:] += rng.normal(scale=0.02 * moved, size=rows[:, 1:].shape)
        return rows

    for k in range(5):
        (curve,) = (c for c in with_change(tmp_path / str(k), noisy).curves if c.id == "load0")
        assert abs(place_on_model(curve, dataset(BEAM).sensors).start_s - START_S) < 2.0 / 200.0


def test_a_stated_start_far_from_the_motion_is_reported(tmp_path: Path) -> None:
    def later(names: list[str], rows: np.ndarray) -> np.ndarray:
        rest = np.repeat(rows[:1], 100, axis=0)
        rest[:, 0] = np.arange(100) / 200.0
        rows[:, 0] += 0.5
        return np.concatenate([rest, rows])

    curve = with_change(tmp_path, later).curves[0]
    sensors = dataset(BEAM).sensors
    for start_s, notes in ((0.1, 1), (0.5 + START_S, 0)):
        stated = replace(curve, start_s=start_s)
        found = remarks(stated, place_on_model(stated, sensors), sensors)
        assert len(found) == notes, found
        assert all("begin to move at 0.56" in note and "start_s is 0.1 s" in note for note in found)


def test_missing_rows_are_reported_and_not_used(tmp_path: Path) -> None:
    def gap(names: list[str], rows: np.ndarray) -> np.ndarray:
        missing = (rows[:, 0] > 0.2) & (rows[:, 0] < 0.5)
        rows[np.ix_(missing, columns_of(names, "m1"))] = np.nan
        return rows

    data = with_change(tmp_path, gap)
    assert any('"m1" is missing in 59 rows (0.295 s' in note for note in placed(data))
    system = trajectory_system(data, data.curves)
    lengths = {one.id: len(one.measured) for one in system.series if one.curve == "load0"}
    assert lengths["load0 m0 z"] - lengths["load0 m1 z"] == 59


def test_a_loose_clamp_marker_is_reported(tmp_path: Path) -> None:
    def loose(names: list[str], rows: np.ndarray) -> np.ndarray:
        rows[rows[:, 0] > 0.1, columns_of(names, "m4")[0]] += 0.5
        return rows

    data = with_change(tmp_path, loose)
    notes = placed(data)
    assert notes == check_dataset(data.path)["warnings"] and check_dataset(BEAM)["warnings"] == []
    assert len(notes) == 1 and 'fixed marker "m4" moves by' in notes[0]


def test_a_marker_on_the_plane_of_symmetry_stays_in_it() -> None:
    """A symmetric field with slopes across the plane, which differ by sign in the elements on both sides."""
    mesh = box((4, 4, 4), (0.1, 0.03, 0.03))
    x, y, _ = mesh.points.T
    across = np.abs(y - 0.015)
    field = np.column_stack([0.4 * across, np.zeros_like(x), 0.2 * x - 0.6 * across])
    places = np.array([[0.1, 0.015, 0.03], [0.06, 0.015, 0.011], [0.06, 0.01, 0.011]])
    slopes = TouchingElements.of(mesh, locate_in_mesh(mesh, places)).gradient(field)
    expected = np.zeros((3, 3))
    expected[2, 0] = 0.2
    assert np.allclose(slopes[:2], expected, atol=1e-12)
    expected[0, 1], expected[2, 1] = -0.4, 0.6  # inside of an element it is the slope of that element
    assert np.allclose(slopes[2], expected, atol=1e-12)


def test_the_registration_errs_by_the_places_of_the_markers() -> None:
    """Two markers at +-r on each axis: the variance of a rotation about one is sd^2 / (4 r^2), by those on the two others."""
    r, sd = 0.05, 1e-3
    places = np.concatenate([r * np.eye(3), -r * np.eye(3)])
    assert np.allclose(rotation_sds(places, np.full(6, sd)), sd / (2.0 * r))


def test_features_of_a_damped_cosine() -> None:
    t = np.arange(0.0, 1.5, 0.01)
    y = -6.5 + 4.2 * np.exp(-3.1 * t) * np.cos(2.0 * np.pi * 7.4 * t + np.radians(20.0))
    one = features_of(t, y)
    found = (one.frequency_Hz, one.decay_per_s, one.phase_deg, one.amplitude, one.end)
    assert np.allclose(found, (7.4, 3.1, 20.0, 4.2, -6.5), rtol=1e-6)
    still = features_of(t, 1.0 - np.exp(-2.0 * t))
    assert still.frequency_Hz is None and still.end is not None
    assert vibration_of(t[:5], y[:5, None]) is None


def test_fast_answers_are_near_those_of_the_simulator() -> None:
    """Two effects at other strengths than tried: the error is a third of that of samples that change in proportion, or less."""
    data = dataset(BEAM)
    system = trajectory_system(data, data.curves[2:], only=("load-mass", "damping"))
    start = system.start()
    library = {c.effect: c for c in system.candidates(start) if not c.reason}
    table = dict(zip(library, system.changes(start, list(library.values())), strict=True))
    model, (before,) = start, system.answers([start])
    assert before is not None
    linear = np.concatenate(before)
    for name, strength in (("load-mass", 0.6), ("damping", 20.0)):
        model = model.plus(library[name].term, (strength,))
        none, trial = start_of(library[name]), library[name].trials[0][0]
        change = table[name][0]
        assert change is not None
        linear = linear + (strength - none) / (trial - none) * change
    (fast,), (full,) = system.sketched([model]), system.answers([model])
    assert fast is not None and full is not None
    exact = np.concatenate(full)
    assert np.linalg.norm(np.concatenate(fast) - exact) < np.linalg.norm(linear - exact) / 3.0


def start_of(candidate: Candidate) -> float:
    """The strength that is none."""
    return candidate.term.parameters[0].sought.none


def test_a_load_that_is_a_mass_is_found(tmp_path: Path) -> None:
    """The dataset is made by a beam, from which a solid differs by up to 2 % of the 11 mm; its truth is a share of 1, fixed."""
    documents = find_causes(
        short_beam(tmp_path / "beam"), effects=["load-mass", "damping", "release"], max_effects=1, processes=1
    )
    report = documents.report
    assert report.verdict == "effect-found"
    assert [name for name, one in report.causes.items() if one.decision == "present"] == ["load-mass"]
    share = report.final.parameters[f"{report.effects[0]}.share"]
    assert abs(getattr(share, "value", 0.0) - 1.0) < 0.1
    held_out = report.final.error.curves["load1"]
    assert held_out.split == "holdout" and held_out.rmse is not None and held_out.rmse < 0.02 * 11.0
    assert {one.marker for one in report.motion} == {"m0", "m1", "m2"} and len(documents.markers) == 3


def test_repeats_share_a_run(tmp_path: Path) -> None:
    """Curves with the same settings are read from one run, which reaches to the end of the longest."""
    copy = tmp_path / "beam"
    shutil.copytree(BEAM, copy)
    rows = (copy / "load0.csv").read_text(encoding="utf-8").splitlines()
    (copy / "again.csv").write_text("\n".join(rows[:100]) + "\n", encoding="utf-8")
    text = (copy / "dataset.toml").read_text(encoding="utf-8")
    (copy / "dataset.toml").write_text(
        text + '\n[[curve]]\nid = "again"\nfile = "again.csv"\nstart_s = "fit"\nconditions.load_N = 0.0\n', encoding="utf-8"
    )
    data = dataset(copy)
    system = trajectory_system(data, data.curves)
    jobs = dict(zip([curve.id for curve in data.curves], system.jobs(system.start()), strict=True))
    assert jobs["again"] == jobs["load0"]
    assert jobs["load1"] != jobs["load0"]


def test_a_cause_stands_for_its_forms() -> None:
    data = dataset(BEAM)
    assert trajectory_system(data, data.curves, only=("dimension",)).considered == ["dimension-x", "dimension-y", "dimension-z"]
    with pytest.raises(InputError, match="no such effect"):
        trajectory_system(data, data.curves, only=("dimensions-of-time",))


@pytest.mark.parametrize("order", [("load-mass", "load-delay"), ("load-delay", "load-mass")])
def test_a_fixed_mass_is_there_from_the_start(order: tuple[str, str]) -> None:
    """Both effects can be combined in either order: a load with a fixed mass is not delayed."""
    data = dataset(BEAM)
    system = trajectory_system(data, data.curves)
    known = {one.effect: one for one in system.candidates(system.start())}
    model = system.start()
    for name in order:
        model = model.plus(known[name].term, ({"load-mass": 1.0, "load-delay": 20.0}[name],))
    (load,) = scenario_with(system.runs.path, system.settings(model, data.curves[2])).load
    assert load.mass_g > 0.0
    assert load.start_ms == 0.0


def test_a_scenario_that_is_none_is_refused(tmp_path: Path) -> None:
    """`check` did not read it, and answered for any text file."""
    folder = shutil.copytree(BEAM, tmp_path / "beam")
    toml = folder / "dataset.toml"
    stated = next(line for line in toml.read_text().splitlines() if line.startswith("scenario"))
    (folder / "notes.txt").write_text("root:x:0:0\n")
    toml.write_text(toml.read_text().replace(stated, 'scenario = "notes.txt"'))
    with pytest.raises(InputError, match=r"notes\.txt"):
        check_dataset(folder)
