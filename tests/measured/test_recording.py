"""Recordings of sensors: reading them, comparing a result with them, and datasets of them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_result
from answers import check_answer
from command import command
from outside_data import SHARED_DATA, needs
from scipy.spatial.transform import Rotation
from support import ROOT

from explicitfe.fem.mesh.box import box
from explicitfe.inverse.measured.coils import read_coils, read_trace
from explicitfe.inverse.measured.compare_recording import compare_recording
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import shipped
from explicitfe.results.files import FINISHED, Quantity

# Nodes of a box of 40 x 30 x 20 mm, which do not lie in one plane; the origin is outside, as a sensor there is missing.
CORNER = (0.05, 0.01, 0.03)
POINTS = {"tip": (0.05, 0.01, 0.03), "front": (0.07, 0.01, 0.05), "dorsum": (0.09, 0.01, 0.05), "side": (0.09, 0.04, 0.03)}
TIMES_S = np.arange(0.0, 0.1001, 0.002)
MAPPING = {"tip": "T1", "front": "T2", "dorsum": "T3", "side": "T4"}
# Sensor frame of the tests: x forward, y to the left, and a turned head.
TURN = Rotation.from_euler("zyx", [180.0, 6.0, 3.0], degrees=True).as_matrix()
SHIFT_M = np.array([0.03, -0.02, 0.05])


def motion(times_s: np.ndarray, name: str) -> np.ndarray:
    """Displacement (t, 3) m of a point: at rest for 20 ms, then a smooth movement of its own."""
    phase = 0.5 - 0.5 * np.cos(np.pi * np.clip((times_s - 0.02) / 0.06, 0.0, 1.0))
    k = list(POINTS).index(name)
    return phase[:, None] * np.array([-4e-3 - 1e-3 * k, 2e-4 * k, 1e-3 * (k - 1.5)])


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh = box((2, 2, 1), [0.04, 0.03, 0.02])
    mesh = replace(mesh, points=mesh.points + CORNER)
    nodes = {name: int(np.argmin(np.linalg.norm(mesh.points - place, axis=1))) for name, place in POINTS.items()}
    mesh = mesh.with_named_nodes(nodes)
    history = {f"probe_{name}_displacement": Quantity("m", 3) for name in POINTS}
    model = {"scenario": {"analysis": {"type": "transient"}}, "probes": {name: {} for name in POINTS}}
    path = tmp_path_factory.mktemp("result") / "made.vtkhdf"
    with tiny_result.start(path, mesh=mesh, point_fields={}, cell_fields={}, history=history, model=model) as writer:
        for k, time_s in enumerate(TIMES_S):
            row = {f"probe_{name}_displacement": motion(TIMES_S, name)[k] for name in POINTS}
            writer.sample(float(time_s), row, {"displacement": np.zeros((mesh.node_count, 3))}, {})
        return Path(writer.finish(FINISHED, "", {}))


def places(start_s: float = 0.0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (k,) s of a recording whose movement begins ``start_s`` later, and positions (k, 3) m in the frame of the model."""
    times_s = np.arange(0.0, 0.1601, 0.002)
    return times_s, {sensor: np.array(POINTS[name]) + motion(times_s - start_s, name) for name, sensor in MAPPING.items()}


def write_csv(path: Path, times_s: np.ndarray, positions: dict[str, np.ndarray], axes: str = "xyz", unit: str = "mm") -> Path:
    factor = {"mm": 1e3, "m": 1.0}[unit]
    names = [f"{name}_{axis}_{unit}" for name in positions for axis in axes]
    columns = [factor * place[:, "xyz".index(axis)] for place in positions.values() for axis in axes]
    rows = "\n".join(",".join(f"{value:.12g}" for value in row) for row in np.column_stack([times_s, *columns]))
    path.write_text(",".join(["time_s", *names]) + "\n" + rows + "\n", encoding="utf-8")
    return path


def in_sensor_frame(positions: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: (place - SHIFT_M) @ TURN for name, place in positions.items()}


@pytest.mark.parametrize("register", ["rest", "movement"])
def test_the_same_movement_in_another_frame_agrees(register: str, result: Path, tmp_path: Path) -> None:
    times_s, positions = places()
    coils = read_coils(write_csv(tmp_path / "a.csv", times_s, in_sensor_frame(positions)))
    comparison, tracks = compare_recording(result, coils, MAPPING, register=register)
    assert comparison.rms_mm < 1e-6 and comparison.rows == 51 and comparison.offset_s == 0.0
    registration = comparison.registration
    np.testing.assert_allclose(registration.rotation, TURN, atol=1e-7)
    np.testing.assert_allclose(registration.translation_mm, 1e3 * SHIFT_M, atol=1e-5)
    assert registration.rotation_deg == pytest.approx(np.degrees(Rotation.from_matrix(TURN).magnitude()), abs=1e-5)
    for point in comparison.points.values():
        assert point.forward.correlation == pytest.approx(1.0) and point.forward.model_range_mm > 3.9
    np.testing.assert_allclose(tracks.recorded["side"], tracks.model["side"], atol=1e-9)


def test_a_known_difference_without_registration(result: Path, tmp_path: Path) -> None:
    """A constant difference of 1 mm upwards, and twice the forward movement of the tip."""
    times_s, positions = places()
    positions["T1"] = positions["T1"] + [0.0, 0.0, 1e-3] + motion(times_s, "tip") * [1.0, 0.0, 0.0]
    coils = read_coils(write_csv(tmp_path / "a.csv", times_s, positions))
    comparison, _ = compare_recording(result, coils, MAPPING, register="none")
    tip = comparison.points["tip"]
    assert tip.up.rms_mm == pytest.approx(1.0) and tip.up.correlation == pytest.approx(1.0)
    assert tip.forward.recorded_range_mm == pytest.approx(8.0) and tip.forward.model_range_mm == pytest.approx(4.0)
    assert tip.forward.rms_mm == pytest.approx(1e3 * np.sqrt(np.mean(motion(TIMES_S, "tip")[:, 0] ** 2)), rel=1e-6)
    assert tip.centred_rms_mm == pytest.approx(1e3 * np.std(motion(TIMES_S, "tip")[:, 0]), rel=1e-6)
    assert tip.largest_mm == pytest.approx(np.hypot(1.0, 4.0)) and comparison.points["front"].rms_mm < 1e-9
    assert comparison.rms_mm == pytest.approx(np.sqrt(tip.rms_mm**2 / 4))
    assert comparison.registration.residual_mm is None and comparison.registration.rotation_deg == 0.0


def test_a_delay_is_recovered(result: Path, tmp_path: Path) -> None:
    """A delay between two rows is found within a tenth of the sampling interval."""
    times_s, positions = places(start_s=0.0371)
    coils = read_coils(write_csv(tmp_path / "a.csv", times_s, in_sensor_frame(positions)))
    comparison, _ = compare_recording(result, coils, MAPPING, offset_s="fit")
    assert comparison.offset_fitted and comparison.offset_s == pytest.approx(0.0371, abs=2e-4)
    assert comparison.rms_mm < 0.02
    wrong, _ = compare_recording(result, coils, MAPPING, offset_s=0.0)
    assert wrong.rms_mm > 1.0
    still = {name: np.repeat(place[:1], 10_000, axis=0) for name, place in coils.positions.items()}
    long = replace(coils, time_s=0.002 * np.arange(10_000), positions=still)
    with pytest.raises(InputError, match="the recording lasts 20 s, and `offset_s` fit searches at most 10 s; give an offset"):
        compare_recording(result, long, MAPPING, offset_s="fit")


@pytest.mark.parametrize("count", [1, 4])
def test_motion_of_the_head_is_removed(count: int, result: Path, tmp_path: Path) -> None:
    """Rotation and translation with four sensors on the head; with one, the translation."""
    times_s, positions = places()
    head = {f"H{k}": np.repeat([place], len(times_s), axis=0) for k, place in enumerate(np.vstack([np.eye(3), np.ones(3)]) / 10)}
    turn_deg = 2.0 * np.sin(20.0 * times_s) if count > 1 else 0.0 * times_s
    turns = Rotation.from_euler("y", turn_deg[:, None], degrees=True).as_matrix()
    shifts = 2e-3 * np.sin(30.0 * times_s)[:, None] * [1.0, 0.5, 1.0]
    seen = {name: np.einsum("kij,kj->ki", turns, place) + shifts for name, place in {**positions, **head}.items()}
    coils = read_coils(write_csv(tmp_path / "a.csv", times_s, in_sensor_frame(seen)))
    removed, _ = compare_recording(result, coils, MAPPING, head=list(head)[:count], reference_s=(0.0, 0.0005))
    assert removed.rms_mm < 1e-5 and removed.registration.head_sensors == list(head)[:count]
    assert compare_recording(result, coils, MAPPING)[0].rms_mm > 0.5
    assert any("as a translation" in sentence for sentence in removed.warnings) == (count == 1)


def test_a_planar_recording_in_directions_and_metres(result: Path, tmp_path: Path) -> None:
    """Two coordinates, named by direction: the lateral one is neither needed nor compared."""
    times_s, positions = places()
    lines = ["t (ms),T1_forward (m),T1_up (m),T2_forward (m),T2_up (m),T3_forward (m),T3_up (m),volume"]
    for k, time_s in enumerate(times_s):
        columns = [value for sensor in ("T1", "T2", "T3") for value in (-positions[sensor][k, 0], positions[sensor][k, 2])]
        lines.append(",".join(f"{value:.9g}" for value in (1e3 * time_s, *columns, 1.0)))
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    coils = read_coils(tmp_path / "a.csv")
    assert coils.planar and coils.axes == "anatomical" and coils.time_s[1] == pytest.approx(0.002)
    assert coils.notes == [f"{tmp_path / 'a.csv'}: columns that are no coordinates are ignored: volume."]
    comparison, _ = compare_recording(result, coils, {"tip": "T1", "front": "T2", "dorsum": "T3"}, register="none")
    assert comparison.rms_mm < 1e-4 and comparison.points["tip"].right is None


def test_rows_with_a_missing_value_are_omitted(result: Path, tmp_path: Path) -> None:
    times_s, positions = places()
    path = write_csv(tmp_path / "a.csv", times_s, positions)
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[11] = lines[11].rpartition(",")[0] + ","  # a dropout of T4
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    comparison, _ = compare_recording(result, read_coils(path), MAPPING, register="none")
    assert comparison.rows == 50 and "1 rows with a missing value are omitted." in comparison.warnings[0]
    assert compare_recording(result, read_coils(path), {"tip": "T1"}, register="none")[0].rows == 51


def test_one_sensor_is_registered_by_translation(result: Path, tmp_path: Path) -> None:
    times_s, positions = places()
    coils = read_coils(write_csv(tmp_path / "a.csv", times_s, {"T1": positions["T1"] + SHIFT_M}))
    comparison, _ = compare_recording(result, coils, {"tip": "T1"})
    assert comparison.rms_mm < 1e-6 and comparison.registration.what.startswith("translation fitted")
    assert comparison.warnings == ["registration by translation only: a rotation needs three sensors that do not lie on a line."]


def test_the_command_compares_and_draws(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    times_s, positions = places()
    write_csv(tmp_path / "coils.csv", times_s, in_sensor_frame(positions), unit="m")
    shutil.copy(result, tmp_path / "made.vtkhdf")
    words = ["compare", "made", "coils.csv", *(f"--map={point}={sensor}" for point, sensor in MAPPING.items())]
    assert command([*words, "--picture", "paths.png", "--json"]) == 0
    answer = check_answer("compare", capsys.readouterr().out)
    assert answer["rms_mm"] < 1e-6 and answer["points"]["tip"]["sensor"] == "T1" and answer["picture"] == "paths.png"
    assert (tmp_path / "paths.png").read_bytes().startswith(b"\x89PNG")
    assert command([*words, "--picture", "paths.png"]) == 2
    assert "paths.png exists; add --overwrite" in capsys.readouterr().err
    assert command(words) == 0
    table = capsys.readouterr().out
    assert "0.00 mm rms over all sensors" in table and "rotation and translation fitted to the positions at rest" in table


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ([], "--map is missing; map at least one point"),
        (["--map", "tip"], "--map tip: write POINT=SENSOR"),
        (["--map", "tip=T1", "--map", "front=T1"], 'the sensor "T1" is mapped twice'),
        (["--map", "tpi=T1"], 'the model has no point "tpi"; did you mean "tip"?'),
        (["--map", "tip=T9"], 'coils.csv: there is no sensor "T9"; did you mean'),
        (["--map", "tip=T1", "--head", "H1"], 'there is no sensor "H1"'),
        (["--map", "tip=T1", "--register", "jaw"], '--register "jaw" is not possible'),
        (["--map", "tip=T1", "--offset-s", "late"], '--offset-s "late" is not possible'),
        (["--map", "tip=T1", "--offset-s", "7"], "0 rows lie within the simulation (0.1 s) if it starts at 7 s"),
        (["--map", "tip=T1", "--reference-s", "2:1"], "--reference-s 2:1: write START:END in seconds"),
        (["--map", "tip=T1", "--reference-s", "5:6"], "no row lies between 5 and 6 s; give another --reference-s"),
        (["--map", "tip=T1", "--tolerance", "0.1"], "--tolerance is for two results, and coils.csv is a recording"),
        (["--map", "tip=T1", "--picture", "a.gif"], 'pictures cannot be drawn as "gif"'),
        (["--map", "tip=T1", "--rate-hz", "-5"], "--rate-hz -5 is not possible"),
    ],
)  # fmt: skip
def test_bad_options_get_one_sentence(
    options: list[str], sentence: str,
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    write_csv(tmp_path / "coils.csv", *places())
    before = set(tmp_path.iterdir())
    assert command(["compare", str(result), "coils.csv", *options]) == 2
    assert sentence in capsys.readouterr().err
    assert set(tmp_path.iterdir()) == before


def test_an_indentation_is_refused(tmp_path: Path) -> None:
    model = {"scenario": {"analysis": {"type": "relaxation"}}}
    with tiny_result.start(tmp_path / "punch.vtkhdf", history={}, model=model, point_fields={}, cell_fields={}) as writer:
        for load in range(3):
            writer.sample(float(load), {}, {"displacement": tiny_result.displacement(load)}, {})
        punch = writer.finish(FINISHED, "", {})
    with pytest.raises(InputError, match="this is an indentation; compare the result of a transient run"):
        compare_recording(punch, write_csv(tmp_path / "a.csv", *places()), {"tip": "T1"})


@pytest.mark.parametrize(
    ("head", "sentence"),
    [
        ("time_s,T1,T2", "no column is a coordinate of a sensor; name them SENSOR_AXIS_UNIT"),
        ("time_s,T1_x_mm,T1_x_mm", 'two columns are called "T1_x"'),
        ("time_s,T1_x,T1_z", 'the unit of "T1_x" is not known; give `unit` mm or `unit` m'),
        ("time_s,T1_x (N),T1_z (N)", '"N" of "T1_x" is no unit of length'),
        ("row,T1_x_mm,T1_z_mm", "there is no time column; name one time_s, or give the sampling rate with `rate_hz`"),
        ("time,T1_x_mm,T1_z_mm", 'the unit of "time" is not known; name the column time_s or time_ms'),
        ("time_s,T1_x_mm,T1_up_mm", "some columns have the axes x, y, z and others directions"),
        ("time_s,T1_y_mm,T1_z_mm", 'sensor "T1" has the axes y, z; give x, y, z'),
        ("time_s,T1_left_mm,T1_right_mm", 'sensor "T1" has the axes left, right'),
    ],
)  # fmt: skip
def test_bad_columns_get_one_sentence(head: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(head + "\n0,1,2\n1,2,3\n2,3,4\n", encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_coils(tmp_path / "a.csv")
    assert sentence in str(error.value)


def test_a_trajectory_dataset_from_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The bundled table of an articulograph: 100 ms of rest are cut off, directions become the axes of the model."""
    monkeypatch.chdir(tmp_path)
    mapping = ["--map", "tip=TT", "--map", "front=TB", "--map", "dorsum=TD", "--map", "back=TR"]
    options = ["--test", "trajectory", "--scenario", "vowel-i", "--noise-mm", "0.2", "--interval-s", "0.1:0.3"]
    assert command(["new", "dataset", "ema-vowel-i.csv", *mapping, *options, "--out", "speaker", "--json"]) == 0
    answer = check_answer("new-dataset", capsys.readouterr().out)
    assert answer["columns"]["TT"] == "on tip" and answer["columns"]["NA"] == "not mapped to a point"
    assert any("converted to the axes of the model" in note for note in answer["notes"])
    dataset = read_dataset("speaker")
    (curve,) = dataset.curves
    points = {name: sensor.point for name, sensor in dataset.sensors.items()}
    assert points == {"TT": "tip", "TB": "front", "TD": "dorsum", "TR": "back"}
    assert dataset.registration is not None and dataset.registration.rotation == "fit"
    assert curve.noise.displacement_sd_mm == 0.2 and curve.time_s[[0, -1]].tolist() == [0.0, 0.2]
    assert dataset.scenario is not None
    assert dataset.scenario.read_bytes() == (ROOT / "scenarios" / "vowel-i.toml").read_bytes()
    coils = read_coils(shipped.export_file("ema-vowel-i.csv")).select(["TT"], 0.1, 0.3)
    np.testing.assert_allclose(curve.sensors["TT"], coils.positions["TT"], atol=1e-9)
    assert np.ptp(curve.sensors["TT"][:, 0]) > 4e-3
    assert command(["check", "speaker"]) == 0
    shown = capsys.readouterr()
    assert "0.2 mm" in shown.out and "TT on tip" in shown.out and "not stated" not in shown.out + shown.err


def test_the_noise_of_a_trajectory_is_stated(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["check", "simulated-ema", "--json"]) == 0
    answer = check_answer("check", capsys.readouterr().out)
    assert [curve["noise_sd"] for curve in answer["curves"]] == [0.2, 0.2, 0.2]
    assert answer["sensors"]["TT"] == "tip" and answer["warnings"] == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--map", "tip=T1"], "--map needs a scenario whose points are mapped; add --scenario"),
        (["--scenario", "vowel-i"], "--map is missing; map at least one point of the scenario to a sensor"),
        (["--scenario", "vowel-i", "--map", "nose=T1"], "--map nose: the model of vowel-i has no such point"),
        (["--scenario", "vowel-x", "--map", "tip=T1"], "vowel-x"),
        (["--scenario", "vowel-i", "--map", "tip=T5"], 'there is no sensor "T5"'),
        (["--interval-s", "5:6"], "every sensor has missing values"),
        (["--force", "x"], "--force is not for --test trajectory; omit it."),
        (["--tool", "sphere"], "--tool is not for --test trajectory"),
    ],
)  # fmt: skip
def test_what_cannot_become_a_trajectory_is_refused(
    options: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_csv(tmp_path / "a.csv", *places())
    assert command(["new", "dataset", "a.csv", "--test", "trajectory", *options, "--out", "b"]) == 2
    assert sentence in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


def test_options_of_trajectories_are_for_trajectories(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    write_csv(tmp_path / "a.csv", *places())
    assert command(["new", "dataset", "a.csv", "--test", "shear", "--map", "tip=T1"]) == 2
    assert "--map is for --test trajectory only; omit it." in capsys.readouterr().err


def test_a_recording_without_times_or_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows at a given rate and lengths in a given unit become a dataset of data alone."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("T1_x;T1_y;T1_z\n0,01;0;0,1\n0,02;0;0,1\n0,03;0;0,11\n", encoding="utf-8")
    assert command(["new", "dataset", "a.csv", "--test", "trajectory", "--rate-hz", "200", "--unit", "m", "--out", "b"]) == 0
    dataset = read_dataset("b")
    np.testing.assert_allclose(dataset.curves[0].time_s, [0.0, 0.005, 0.01])
    np.testing.assert_allclose(dataset.curves[0].sensors["T1"][:, 0], [0.01, 0.02, 0.03])
    assert dataset.scenario is None and dataset.registration is None


def test_sensors_near_a_line_are_not_turned_upside_down(result: Path, tmp_path: Path) -> None:
    """Coils in a slight hollow where the points of the model are arched: a free rotation of 180° about their line fits better."""
    times_s = np.arange(0.0, 0.1001, 0.002)
    hollow = {"T1": (0.0, 0.001, 0.0), "T2": (0.02, 0.0, 0.009), "T3": (0.04, 0.0, 0.02)}
    positions = {sensor: np.array(place) + motion(times_s, "tip") for sensor, place in hollow.items()}
    mapping = {"tip": "T1", "front": "T2", "dorsum": "T3"}
    lines = ["time_s," + ",".join(f"{sensor}_{axis}_mm" for sensor in hollow for axis in ("front", "left", "up"))]
    for k, time_s in enumerate(times_s):
        row = [value for place in positions.values() for value in 1e3 * place[k] * [-1.0, -1.0, 1.0]]
        lines.append(",".join(f"{value:.9g}" for value in (time_s, *row)))
    (tmp_path / "named.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    free, _ = compare_recording(result, write_csv(tmp_path / "xyz.csv", times_s, positions), mapping)
    assert free.registration.rotation_deg > 150.0
    named, _ = compare_recording(result, tmp_path / "named.csv", mapping)
    assert named.registration.rotation[1] == [0.0, 1.0, 0.0] and named.registration.rotation_deg < 20.0
    assert named.registration.what.startswith("rotation about the lateral axis and translation")
    assert any("a free rotation would contradict the directions" in sentence for sentence in named.warnings)
    coils = read_coils(
        write_csv(tmp_path / "turned.csv", times_s, {k: v * [-1.0, -1.0, 1.0] for k, v in positions.items()}),
        axes="front,left,up",
    )
    assert compare_recording(result, coils, mapping)[0].rms_mm == pytest.approx(named.rms_mm)
    for words in ("front,left", "front,back,up", "x,y,z"):
        with pytest.raises(InputError, match=f"`axes` {words}: give the directions of x, y and z, such as"):
            read_coils(tmp_path / "turned.csv", axes=words)
    with pytest.raises(InputError, match="`axes` is for recordings with x, y and z; omit it"):
        read_coils(tmp_path / "named.csv", axes="front,left,up")
    planar, _ = compare_recording(result, write_csv(tmp_path / "xz.csv", times_s, positions, axes="xz"), mapping)
    assert planar.registration.rotation[2][2] > 0.9


@pytest.mark.parametrize("axes", ["front,right,up", "back,right,down"])
def test_a_turned_recording_is_not_compared(axes: str, result: Path, tmp_path: Path) -> None:
    """The limit of new dataset holds here, also for two coordinates that point down."""
    times_s, positions = places()
    named = read_coils(write_csv(tmp_path / "a.csv", times_s, positions), axes=axes)
    with pytest.raises(InputError, match=r"the recording (is mirrored|fits the model only if it is turned)"):
        compare_recording(result, named, MAPPING)
    arch = {"T1": [0.0, 0.0, 0.0], "T2": [0.02, 0.0, 0.02], "T3": [0.04, 0.0, 0.02]}
    down = {name: np.array(arch[name]) * [1.0, 0.0, -1.0] + 0.01 + 0.0 * positions[name] for name in arch}
    with pytest.raises(InputError, match=r"turned by .* axis"):
        compare_recording(
            result, write_csv(tmp_path / "b.csv", times_s, down, axes="xz"), {"tip": "T1", "front": "T2", "dorsum": "T3"}
        )


def test_a_planar_recording_may_point_forward(result: Path, tmp_path: Path) -> None:
    """x grows to the front instead of the back: the recording is turned about the vertical axis, not upside down."""
    times_s, positions = places()
    forward = {name: place * [-1.0, 1.0, 1.0] for name, place in positions.items() if name != "T4"}
    mapping = {point: sensor for point, sensor in MAPPING.items() if sensor != "T4"}
    comparison, _ = compare_recording(result, write_csv(tmp_path / "a.csv", times_s, forward, axes="xz"), mapping)
    assert comparison.rms_mm < 1e-6
    np.testing.assert_allclose(comparison.registration.rotation, np.diag([-1.0, -1.0, 1.0]), atol=1e-9)


def test_doubtful_intervals_are_named(result: Path, tmp_path: Path) -> None:
    """No rest in the reference interval, and no movement in the compared one."""
    times_s, positions = places()
    coils = read_coils(write_csv(tmp_path / "a.csv", times_s, positions))
    moving, _ = compare_recording(result, coils, MAPPING, reference_s=(0.03, 0.06))
    assert any(sentence.startswith("the sensors move by 3.") and "`reference_s`" in sentence for sentence in moving.warnings)
    still = replace(coils, positions={name: np.repeat(place[:1], len(times_s), axis=0) for name, place in positions.items()})
    resting, _ = compare_recording(result, still, MAPPING)
    assert [sentence for sentence in resting.warnings if "in the compared interval the sensors vary by 0.00 mm rms" in sentence]
    assert compare_recording(result, coils, MAPPING)[0].warnings == []


def test_a_palate_trace_is_drawn(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_csv(Path("coils.csv"), *places())
    Path("palate.csv").write_text("x_mm,z_mm\n0,25\n20,30\n40,\n30,29\n", encoding="utf-8")
    trace, axes = read_trace(Path("palate.csv"))
    assert axes == "cartesian" and trace.tolist() == [[0.0, 0.0, 0.025], [0.02, 0.0, 0.03], [0.03, 0.0, 0.029]]
    words = ["compare", str(result), "coils.csv", "--map", "tip=T1", "--map", "front=T2", "--map", "side=T4"]
    assert command([*words, "--palate", "palate.csv", "--picture", "paths.svg"]) == 0
    assert "recorded palate" in Path("paths.svg").read_text(encoding="utf-8")
    assert command([*words, "--palate", "palate.csv"]) == 2
    assert "--palate needs a picture to draw the trace in; add --picture" in capsys.readouterr().err
    Path("palate.csv").write_text("front_mm,up_mm\n0,25\n20,30\n30,29\n", encoding="utf-8")
    assert command([*words, "--palate", "palate.csv", "--picture", "other.svg"]) == 2
    assert "the trace has directions and the recording x, y, z; use one frame." in capsys.readouterr().err
    assert command([*words, "--palate", "coils.csv", "--picture", "other.svg"]) == 2
    assert "a trace has one sensor, and this table has T1, T2, T3, T4" in capsys.readouterr().err
    assert command(["compare", str(result), "palate.csv", "--map", "tip=T1"]) == 2
    assert "A trace of the palate is drawn by `compare --palate`." in " ".join(capsys.readouterr().err.split())


MEASURED = SHARED_DATA / "measured"
MANDARIN = "tongue-ema-mandarin/utterance-{}.csv"
RECORDINGS = {
    **{MANDARIN.format(n): {"tip": "TT", "blade": "TBL", "front": "TM", "dorsum": "TB"} for n in ("041", "043", "049", "137")},
    "tongue-ema-palate-sound/sentence.csv": {"blade": "TT", "front": "TB", "dorsum": "TD"},
}


@pytest.fixture(scope="module")
def vowel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result on the coarse tongue, shorter than the bundled scenario."""
    folder = tmp_path_factory.mktemp("vowel")
    settings = ["--set", "model.resolution=coarse", "--set", "analysis.duration_ms=100"]
    assert command(["run", "vowel-i", *settings, "--out", str(folder)]) == 0
    return folder / "vowel-i.vtkhdf"


@pytest.mark.parametrize("file", RECORDINGS)
@needs(MEASURED / "tongue-ema-palate-sound")
@needs(MEASURED / "tongue-ema-mandarin")
def test_real_recordings_are_compared_and_drawn(
    file: str, vowel: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Up remains up, and paths and palate are drawn; the sizes are those of a tongue."""
    words = [f"--map={point}={sensor}" for point, sensor in RECORDINGS[file].items()]
    if "palate-sound" in file:
        words += ["--palate", str(MEASURED / "tongue-ema-palate-sound/palate-trace.csv"), "--reference-s", "0:0.1"]
    picture = tmp_path / "paths.png"
    words += ["--offset-s", "fit", "--picture", str(picture), "--json"]
    assert command(["compare", str(vowel), str(MEASURED / file), *words]) == 0
    answer = check_answer("compare", capsys.readouterr().out)
    assert answer["rms_mm"] < 6.0 and answer["centred_rms_mm"] < 2.0 and answer["rows"] >= 5
    assert answer["registration"]["rotation"][2][2] > 0.9
    assert all((point["right"] is None) == ("mandarin" in file) for point in answer["points"].values())
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("file", "mapping", "planar"),
    [
        ("tongue-ema-haskins/f01-b01-s01-r01-n.csv", ["tip=TT", "front=TB", "back=TR"], False),
        ("tongue-ema-mandarin/utterance-041.csv", ["tip=TT", "blade=TBL", "front=TM", "dorsum=TB"], True),
        ("tongue-ema-palate-sound/sentence.csv", ["tip=TT", "front=TB", "dorsum=TD"], False),
    ],
    ids=["haskins", "mandarin", "palate-sound"],
)
@needs(MEASURED / "tongue-ema-haskins")
def test_real_recordings_become_datasets(
    file: str, mapping: list[str], planar: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three laboratories: x, y, z; two directions; three directions."""
    monkeypatch.chdir(tmp_path)
    words = [word for pair in mapping for word in ("--map", pair)]
    options = ["--test", "trajectory", "--scenario", "vowel-i", "--interval-s", "1.2:1.4", "--out", "speaker"]
    assert command(["new", "dataset", str(MEASURED / file), *words, *options]) == 0
    (curve,) = read_dataset("speaker").curves
    moved_mm = 1e3 * np.ptp(curve.sensors["TT"], axis=0)
    assert 0.19 <= curve.time_s[-1] <= 0.2 and 0.1 < moved_mm[[0, 2]].max() < 30.0
    assert (moved_mm[1] == 0.0) == planar


def test_recordings_of_markers_become_a_dataset_that_close_loop_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Markers with positions; a missing value stays an empty cell, and rows at rest are kept."""
    shipped_folder = ROOT / "scenarios" / "datasets" / "simulated-beam"
    lines = (shipped_folder / "load0.csv").read_text(encoding="utf-8").splitlines()
    lines[60] = ",".join([lines[60].split(",")[0], "", "", "", *lines[60].split(",")[4:]])
    (tmp_path / "load0.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    stated = read_dataset(shipped_folder).sensors
    markers = [f"--map={','.join(f'{1e3 * x:.9g}' for x in one.at_m)}={name}" for name, one in stated.items()]
    fixed = [f"--fixed={name}" for name, one in stated.items() if one.fixed]
    words = ["new", "dataset", str(tmp_path / "load0.csv"), "--test", "trajectory", "--out", str(tmp_path / "beam")]
    words += ["--scenario", str(shipped_folder / "scenario.toml"), *markers, *fixed]
    assert command(words) == 0
    dataset = read_dataset(tmp_path / "beam")
    assert {name: one.fixed for name, one in dataset.sensors.items()} == {name: one.fixed for name, one in stated.items()}
    for name, one in dataset.sensors.items():
        assert np.allclose(one.at_m, stated[name].at_m)
    (curve,), original = dataset.curves, read_dataset(shipped_folder).curves[0]
    assert curve.start_s is None
    assert len(curve.time_s) == len(original.time_s)
    assert np.isnan(curve.sensors["m0"][59]).all()
    assert np.allclose(curve.sensors["m1"], original.sensors["m1"])
    assert command(["check", str(tmp_path / "beam")]) == 0
    for wrong, sentence in (
        ("--map=tip=m9", "give a position for each"),
        ("--map=1,2=m9", "a position is X,Y,Z in mm"),
        ("--fixed=m9", "this marker has no position"),
    ):
        capsys.readouterr()
        assert command([*words, wrong, "--out", str(tmp_path / "none")]) == 2
        assert sentence in " ".join(capsys.readouterr().err.split())
