"""Recordings in C3D files: positions, unit, rate and missing values as they were written; damage in one sentence."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import c3d
import numpy as np
import pytest
from answers import check_answer
from command import command

from explicitfe.inverse.measured.coils import read_coils
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import extras

RATE_HZ, FRAMES = 250.0, 51
NAMES = ("TT", "TB", "TD", "UI")


def places_mm() -> np.ndarray:
    """Positions (frames, sensors, 3) mm: four sensors that do not lie in one plane, and a smooth movement."""
    now_s = np.arange(FRAMES) / RATE_HZ
    start = np.array([[58.0, 0.0, 97.0], [78.0, 2.0, 111.0], [93.0, -1.0, 113.0], [50.0, 0.0, 101.0]])
    return start + 4.0 * np.sin(6.0 * now_s)[:, None, None] * np.array([-1.0, 0.0, 0.3])


def write_c3d(
    path: Path,
    positions: np.ndarray,
    *,
    unit: str = "mm",
    missing: dict[int, slice] | None = None,
    scale: float = -1.0,
    names: tuple[str, ...] = NAMES,
    angles: tuple[str, ...] = (),
) -> Path:
    """Write positions (frames, sensors, 3), as integers if the scale is positive; ``missing``: sensor -> frames without value."""
    writer = c3d.Writer(point_rate=RATE_HZ, analog_rate=0.0, point_scale=scale, point_units=unit)
    writer.set_point_labels(list(names))
    if angles:
        text = "".join(name.ljust(8) for name in angles)
        writer.point_group.add_str("ANGLES", "Points that are angles.", text, 8, len(angles))
    residuals = np.zeros(positions.shape[:2])
    for sensor, rows in (missing or {}).items():
        residuals[rows, sensor] = -1.0
    for places, residual in zip(positions, residuals, strict=True):
        points = np.column_stack([places, residual, np.zeros(len(places))])
        points[residual < 0.0, :3] = 0.0
        writer.add_frames((points, np.zeros((0, 0))))
    with path.open("wb") as file, pytest.warns(UserWarning, match="No analog data"):
        writer.write(file)
    return path


def without(path: Path, parameter: str, header: slice) -> Path:
    """Set a number of the header and the parameters of this name to 0."""
    content = bytearray(path.read_bytes())
    zeros = bytes(header.stop - header.start)
    content[header] = zeros
    for match in re.finditer(parameter.encode(), bytes(content)):
        begin = match.end() + 4  # after the offset to the next parameter, the type and the number of dimensions
        content[begin : begin + len(zeros)] = zeros
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(("unit", "factor", "scale"), [("mm", 1e-3, -1.0), ("m", 1.0, -1.0), ("mm", 1e-3, 0.01)])
def test_positions_rate_and_unit(unit: str, factor: float, scale: float, tmp_path: Path) -> None:
    """Floating point numbers in mm and m, and integers of 0.01 mm."""
    positions = places_mm() * 1e-3 / factor
    coils = read_coils(write_c3d(tmp_path / "A.C3D", positions, unit=unit, scale=scale))
    assert list(coils.positions) == list(NAMES) and coils.axes == "cartesian" and not coils.planar and coils.notes == []
    np.testing.assert_allclose(coils.time_s, np.arange(FRAMES) / RATE_HZ)
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose(coils.positions[name], factor * positions[:, k], atol=1e-5 if scale > 0.0 else 1e-8)


def test_missing_values_are_nan(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", places_mm(), missing={1: slice(10, 13), 3: slice(0, FRAMES)})
    coils = read_coils(path)
    assert np.flatnonzero(np.isnan(coils.positions["TB"]).all(axis=1)).tolist() == [10, 11, 12]
    assert np.isfinite(coils.positions["TT"]).all()
    assert coils.notes == [f"{path}: markers without any value are omitted: UI."]


def test_unit_and_rate_can_be_given(tmp_path: Path) -> None:
    """They replace what the file states."""
    path = without(write_c3d(tmp_path / "a.c3d", places_mm(), unit="px"), "RATE", slice(20, 24))
    coils = read_coils(path, unit="mm", rate_hz=100.0)
    assert coils.time_s[1] == 0.01 and coils.positions["TT"][0, 0] == pytest.approx(0.058)
    assert coils.notes == [f'{path}: positions are read in mm; the unit in the file is "px".']


def test_names_are_unique_and_angles_are_no_positions(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", places_mm(), names=("TT", "TT", "", "Knee"), angles=("Knee",))
    coils = read_coils(path)
    assert list(coils.positions) == ["TT", "TT 2", "marker 3"]
    again = f"{path}: labels that occur again have a number: TT 2."
    assert coils.notes == [again, f"{path}: points that are no positions are ignored: Knee."]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"unit": "px"}, 'the unit "px" (POINT:UNITS) is no unit of length; give `unit` with the unit of the positions: mm, cm'),
        ({"unit": "  "}, "the file states no unit; give `unit` with the unit of the positions: mm, cm, m"),
        ({"missing": {k: slice(0, FRAMES) for k in range(4)}}, "no marker has a value; export the"),
    ],
)  # fmt: skip
def test_what_is_not_stated_gets_one_sentence(options: dict[str, object], sentence: str, tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", places_mm(), **options)  # type: ignore[arg-type]
    with pytest.raises(InputError) as error:
        read_coils(path)
    assert str(error.value).startswith(f"{path}: {sentence}")


def test_a_file_without_rate_gets_one_sentence(tmp_path: Path) -> None:
    path = without(write_c3d(tmp_path / "a.c3d", places_mm()), "RATE", slice(20, 24))
    with pytest.raises(InputError, match=r"a\.c3d: the C3D file does not state a sampling rate; give it with `rate_hz`"):
        read_coils(path)


def test_damaged_files_get_one_sentence(tmp_path: Path) -> None:
    whole = write_c3d(tmp_path / "a.c3d", places_mm()).read_bytes()
    no_points = without(tmp_path / "a.c3d", "USED", slice(2, 4)).read_bytes()
    for content, sentence in (
        (b"", "this is no C3D file, or it is damaged; export the recording again"),
        (b"time_s,TT_x_mm\n" * 100, "this is no C3D file, or it is damaged (C3D magic"),
        (whole[:700], "this is no C3D file, or it is damaged"),
        (whole[:-1024], f"of {FRAMES} frames; export the recording again, or as a table (.csv)."),
        (no_points, "the C3D file has no markers; export a recording with positions."),
    ):
        path = tmp_path / "b.c3d"
        path.write_bytes(content)
        with pytest.raises(InputError) as error:
            read_coils(path)
        assert str(error.value).startswith(f"{path}: ") and sentence in str(error.value)
    for path, sentence in ((tmp_path / "none.c3d", "this cannot be read"), (tmp_path, "this is a folder")):
        with pytest.raises(InputError, match=sentence):
            read_coils(path if path.suffix else path.rename(path.with_suffix(".c3d")))


def test_the_package_may_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_c3d(tmp_path / "a.c3d", places_mm())
    monkeypatch.setitem(extras.PACKAGES, "c3d", "no_such_package")
    with pytest.raises(InputError, match=r'reading a C3D file needs no_such_package.*pip install "\.\[c3d\]"'):
        read_coils(path)


def test_a_dataset_from_c3d_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Each file becomes a curve; comments state rate, sensors and rows with missing values."""
    monkeypatch.chdir(tmp_path)
    write_c3d(Path("first.c3d"), places_mm(), missing={1: slice(10, 13)})
    write_c3d(Path("second.c3d"), places_mm() + 1.0)
    words = ["--test", "trajectory", "--scenario", "vowel-i", "--map", "tip=TT", "--map", "front=TB", "--map", "dorsum=TD"]
    assert command(["new", "dataset", "first.c3d", "second.c3d", *words, "--out", "speaker", "--json"]) == 0
    answer = check_answer("new-dataset", capsys.readouterr().out)
    assert [curve["rows"] for curve in answer["curves"]] == [FRAMES - 3, FRAMES]
    text = Path("speaker/dataset.toml").read_text(encoding="utf-8")
    assert f"# Source: first.c3d, 250 Hz, {FRAMES} rows, {FRAMES} of them selected." in text
    assert "# Sensors in the source: TT, TB, TD, UI." in text
    assert "# Selected rows with missing values: TB 3. Rows without a value of a mapped sensor are omitted." in text
    assert text.count("# Selected rows with missing values: none.") == 1
    assert [curve["id"] for curve in tomllib.loads(text)["curve"]] == ["first", "second"]
    first, second = read_dataset("speaker").curves
    np.testing.assert_allclose(second.sensors["TT"], 1e-3 * (places_mm()[:, 0] + 1.0), atol=1e-8)
    assert len(first.time_s) == FRAMES - 3
    assert command(["new", "dataset", "first.c3d", "--test", "compression", "--out", "other"]) == 2
    assert "first.c3d: a .c3d file has positions of markers; add --test trajectory." in capsys.readouterr().err
