"""Right recordings in unusual forms: read right, or refused with the true cause; nothing is lost without a sentence."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import recordings as files
from command import command
from recordings import NAMES, RATE_HZ, movement, table
from scipy.io import savemat

from explicitfe.inverse.measured.coils import Coils, read_coils
from explicitfe.inverse.measured.registration import check_directions, procrustes
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError

LOST = slice(20, 30)  # rows without the first coil
Maker = Callable[[np.ndarray, np.ndarray], str | bytes]


@dataclass(frozen=True)
class Form:
    """A file: its name, how it is written, options, sentences that are needed, and what is not as in the others."""

    file: str
    write: Maker
    options: dict[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    lost_as: float = np.nan
    called: str = "{name}"
    places: Callable[[np.ndarray], np.ndarray] = lambda places: places


def form(file: str, writer: Callable[..., str | bytes], *, options: dict[str, object] | None = None, notes: tuple[str, ...] = (),
         lost_as: float = np.nan, called: str = "{name}", places=lambda places: places, **changes) -> Form:  # fmt: skip
    return Form(file, lambda t, p: writer(t, p, **changes), options or {}, notes, lost_as, called, places)


def with_extra_columns(times_s: np.ndarray, places: np.ndarray) -> str:
    """A status of words and the force of a plate."""
    lines = table(times_s, places).splitlines()
    return "\n".join([lines[0] + ",status,FP1_x (N)", *(line + ",no event,1.5" for line in lines[1:])]) + "\n"


def tongue(places: np.ndarray) -> np.ndarray:
    """A picture: 1000 pixels of 0.2 mm high, and no lateral coordinate."""
    return places * [1.0, 0.0, 1.0] - [0.0, 0.0, 200.0]


def midsagittal(places: np.ndarray) -> np.ndarray:
    return places * [1.0, 0.0, 1.0]


ZERO, STATUS, PX = ("is at (0, 0, 0) in 10 rows",), ('by the column "Sensor 1 Status"',), {"unit": "0.2 mm", "rate_hz": RATE_HZ}
FORMS = {
    "trc": form("a.trc", files.trc),
    "trc in metres without the blank line": form("a.trc", files.trc, unit="m", blank=False),
    "trc with zeros": form("a.trc", files.trc, lost_as=0.0, notes=ZERO),
    "trc with another suffix": form("a.txt", files.trc),
    "trc saved by a spreadsheet": form("a.csv", lambda t, p: files.trc(t, p, comma=True).replace("\t", ";")),
    "sto": form("a.sto", files.sto, lost_as=0.0, notes=ZERO),
    "sto of vectors": form("a.sto", files.sto, lost_as=0.0, notes=ZERO, vectors=True),
    "sto with nan": form("a.mot", lambda t, p: files.sto(t, p).replace("\t\t\t", "\tNaN\tNaN\tNaN")),
    "motive": form("a.csv", files.motive),
    "motive with a rigid body": form("a.csv", files.motive, body=True, start=500, notes=("ignored: Head Rotation X",)),
    "motive in millimetres": form("a.csv", files.motive, unit="Millimeters"),
    "qualisys": form("a.tsv", files.qtm, leading=1),
    "qualisys with zeros, no labels": form("a.tsv", files.qtm, leading=0, labels=False, lost_as=0.0, notes=ZERO),
    "qualisys with NULL": form("a.tsv", files.qtm, lost="NULL"),
    "qualisys, no frame, empty": form("a.tsv", files.qtm, leading=0),
    "qualisys with an event of two words": form("a.tsv", files.qtm, event="Release 2"),
    "qualisys with an event, no labels": form("a.tsv", files.qtm, event="Release 2", leading=0, lost_as=0.0, notes=ZERO),
    "sto of vectors in millimetres": form("a.sto", files.sto, lost_as=0.0, vectors=True, unit="mm"),
    "motive of an old version": form(
        "a.csv", lambda t, p: files.motive(t, p).replace("\n,Type,", "\n,,").replace("\n,Name,", "\n,,").replace("\n,ID,", "\n,,")
    ),
    "sleap": form("a.csv", files.sleap, options=PX, places=tongue, notes=("y of a picture points down; its sign is reversed",)),
    "the unit of the time below its name": form(
        "a.csv", lambda t, p: table(t, p, two_lines=True, time="s").replace(",", "Time,", 1), options={"unit": "mm"}
    ),
    "wave": form("a.tsv", files.wave, called="Sensor {number}"),
    "wave with values where it is lost": form("a.tsv", files.wave, called="Sensor {number}", values=True, notes=STATUS),
    "wave of an old program": form("a.tsv", files.wave, called="Sensor {number}", ok="55", bad="119"),
    "deeplabcut": form("a.csv", files.deeplabcut, options=PX, places=tongue, notes=("10 rows, by the column",)),
    "deeplabcut of animals": form("a.csv", files.deeplabcut, people=True, options=PX, places=tongue),
    "AG501": form("a.pos", files.pos, lost_as=0.0, called="channel {number}", notes=ZERO),
    "AG501, version 3, 24 channels": form("a.pos", files.pos, version=3, channels=24, called="channel {number}", lost_as=0.0),
    "AG500": form("a.pos", files.pos, header=False, channels=12, called="channel {number}", notes=("AG500, 12 channels at 200",)),
    "AG501 with another suffix": form("a.dat", files.pos, called="channel {number}"),
    "semicolons and decimal commas": form("a.csv", table, separator=";", comma=True),
    "tabs and decimal commas": form("a.txt", table, separator="\t", comma=True),
    "blanks": form("a.txt", table, separator=" ", lost="NaN"),
    "UTF-16": form("a.txt", lambda t, p: table(t, p, separator="\t").encode("utf-16")),
    "two lines": form("a.csv", table, two_lines=True, options={"unit": "mm"}),
    "two lines and units": form("a.csv", table, two_lines=True, time="Time", units=("s", "mm")),
    "units in brackets below": form("a.csv", table, names="{name} {axis}", time="Time", units=("[s]", "[mm]")),
    "axis in brackets": form("a.csv", table, names="{name} ({axis})", options={"unit": "mm"}),
    "axis glued to the sensor": form("a.csv", table, names="{name}{axis} [mm]"),
    "axis first": form("a.csv", table, names="{axis}_{name}_mm"),
    "centimetres": form("a.csv", table, names="{name}.{axis} (cm)", factor=0.1),
    "order of axes": form("a.csv", table, axes="zxy"),
    "without lateral axis": form("a.csv", table, axes="xz", places=midsagittal),
    "lines above": form("a.csv", table, above=["Recording of a tongue", "", "Rate;200;Hz"]),
    "no times": form("a.csv", table, time=None, options={"rate_hz": RATE_HZ}),
    "lines end with separators": form("a.csv", lambda t, p: table(t, p).replace("\n", ",,\n")),
    "a status of words and forces": form("a.csv", with_extra_columns, notes=("ignored: status, FP1_x.",)),
    "minus one metre is lost": form("a.csv", table, lost_as=-1000.0, notes=("one number",)),
    "-16512 is lost": form("a.csv", table, lost_as=-16512.0, notes=("one number in all coordinates (-16512 mm) in 10 rows",)),
    "far from the origin": form("a.csv", table, places=lambda places: places + [3000.0, -1500.0, 900.0]),
}  # fmt: skip


def read(form: Form, folder: Path, lost: bool = True) -> tuple[Coils, np.ndarray]:
    """What is read of a form, and its positions (k, sensors, 3) mm in the order of the coils."""
    times_s, places = movement()
    if form.places not in (tongue, midsagittal):
        places = form.places(places)
    if lost:
        places[LOST, 0] = form.lost_as
    content = form.write(times_s, places)
    path = folder / form.file
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    coils = read_coils(path, **form.options)  # type: ignore[arg-type]
    names = [form.called.format(name=name, number=k + 1) for k, name in enumerate(NAMES)]
    return coils, 1e3 * np.stack([coils.sensor(name) for name in names], axis=1)


@pytest.mark.parametrize("name", FORMS)
def test_a_right_file_in_an_unusual_form_is_read_right(name: str, tmp_path: Path) -> None:
    form = FORMS[name]
    coils, seen = read(form, tmp_path)
    times_s, right = movement()
    right = form.places(right)
    right[LOST, 0] = np.nan
    np.testing.assert_allclose(coils.time_s - coils.time_s[0], times_s, atol=1e-6)
    np.testing.assert_allclose(seen[:, :, [0, 2]], right[:, :, [0, 2]], atol=6e-3)  # rounded to 0.01 mm in metres
    if not coils.planar:
        np.testing.assert_allclose(seen[:, :, 1], right[:, :, 1], atol=6e-3)
    for sentence in form.notes:
        assert any(sentence in note for note in coils.notes), coils.notes


@pytest.mark.parametrize(("columns", "planar"), [(6, False), (3, False), (2, True)])
def test_channels_of_mview(columns: int, planar: bool, tmp_path: Path) -> None:
    times_s, places = movement()
    shown = places[:, :, [0, 2, 1]] if planar else places
    coils = read_coils(files.mview(tmp_path / "a.mat", shown, columns=columns))
    assert coils.planar == planar and "channels that are no positions are ignored: AUDIO." in coils.notes[0]
    np.testing.assert_allclose(coils.time_s, times_s)
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose(coils.positions[name][:, [0, 2]], 1e-3 * places[:, k][:, [0, 2]])


def table_with(line: int, text: str) -> Callable[[np.ndarray, np.ndarray], str]:
    """A table with a line in place of another."""

    def write(times_s: np.ndarray, places: np.ndarray) -> str:
        lines = table(times_s, places).splitlines()
        return "\n".join([*lines[:line], text.format(line=lines[line]), *lines[line + 1 :]]) + "\n"

    return write


def matrices(times_s: np.ndarray, places: np.ndarray) -> bytes:
    savemat(file := io.BytesIO(), {"TT": places[:, 0]})
    return file.getvalue()


REFUSED = {
    "trc that ends early": (form("a.trc", files.trc, count=100), "ends after 57 of 100 rows (NumFrames)"),
    "qualisys that ends early": (form("a.tsv", files.qtm, count=60), "ends after 57 of 60 rows (NO_OF_FRAMES)"),
    "joint angles": (
        form("a.mot", lambda t, p: "Coordinates\nnRows=3\nendheader\ntime\tknee\thip\n" + "0\t1\t2\n" * 3),
        "body kinematics analysis. Columns: time, knee, hip.",
    ),
    "rotations in radians": (
        form("a.mot", lambda t, p: "Coordinates\ninDegrees=no\nendheader\ntime\tjaw_rx\tjaw_ry\tjaw_rz\n" + "0\t1\t2\t3\n" * 3),
        "rotations are no positions: give positions (.trc)",
    ),
    "6D": (form("a.tsv", files.qtm, data="6D"), "positions and rotations of rigid bodies (6D); export the markers (3D)"),
    "two tracks": (form("a.csv", files.sleap, options=PX, tracks=2), 'of the column "track" (track_0, track_1)'),
    "two tracks without names": (
        form("a.csv", lambda t, p: files.sleap(t, p, tracks=2).replace("track", "kind"), options=PX),
        "the number of the frame repeats or goes back in 57 rows",
    ),
    "two trials": (
        form("a.csv", lambda t, p: table(t, p) + "".join(table(t, p).partition("\n")[2:])),
        "the time goes back from 0.28 s to 0 s; put tests that have their own time into files of their own",
    ),
    "plain matrices": (form("a.mat", matrices), "no variable is a structure array of mview, with NAME, SRATE"),
    "pixels": (form("a.csv", files.deeplabcut), 'the unit "px" is no unit of length; give `unit`'),
    "no rate": (form("a.csv", files.deeplabcut, options={"unit": "0.2mm"}), "give the sampling rate with `rate_hz`"),
    "a word in a row": (form("a.csv", table_with(9, "0.04,OVER,2,3,1,2,3,1,2,3,1,2,3")), 'line 10: "OVER" in the column "TT_x"'),
    "a repeated header": (form("a.csv", table_with(9, "time_s,TT_x_mm")), 'line 10: "time_s,TT_x_mm" is no row of the table'),
    "a short row": (form("a.csv", table_with(9, "0.04,1,2,3")), "line 10: 4 cells, and other rows have 13"),
    "displacements": (form("a.csv", table, places=lambda p: p - p[0]), "all sensors are at (0, 0, 0) in the first row"),
    "damaged pos": (form("a.pos", lambda t, p: files.pos(t, p)[:-7]), "no whole number of frames of 16 channels"),
    "amplitudes": (form("a.pos", files.pos, more="Calf_Channel_0=1\n"), "amplitudes of the coils"),
    "matlab 7.3": (form("a.mat", lambda t, p: b"\x89HDF\r\n\x1a\n"), "save it in MATLAB with save(..., '-v7')"),
    "no matlab": (form("a.mat", table), "this is no MATLAB file, or it is damaged"),
    "pos without header": (form("a.pos", lambda t, p: table(t, p).encode()[:1680]), "the values are no positions in mm"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_others_are_refused_with_the_cause(name: str, tmp_path: Path) -> None:
    form, sentence = REFUSED[name]
    with pytest.raises(InputError) as error:
        read(form, tmp_path, lost=False)
    assert str(error.value).startswith(str(tmp_path / form.file)) and sentence in str(error.value)
    assert "\n" not in str(error.value)


def swap(places: np.ndarray) -> None:
    places[20:40, [0, 1]] = places[20:40, [1, 0]]


def leap(places: np.ndarray) -> None:
    places[30:, 1] += 15.0


def freeze(places: np.ndarray) -> None:
    places[20:45, 2] = places[20, 2]


@pytest.mark.parametrize(
    ("spoil", "sentences"),
    [
        (lambda places: None, []),
        (swap, ["TT and TB appear to be interchanged from 0.1 to 0.2 s"]),
        (leap, ["TB jumps by 25.8 mm within 5 ms (5.2 m/s) at 0.15 s; above 1 m/s it is no movement of a tongue"]),
        (freeze, ["TD keeps exactly the same position in 25 rows from 0.1 s on while other sensors move"]),
    ],
)
def test_markers_that_are_not_what_they_seem_are_named(
    spoil: Callable[[np.ndarray], None], sentences: list[str], tmp_path: Path
) -> None:
    """By each command that uses them, which is what ``select`` is for."""
    times_s, places = movement()
    spoil(places)
    path = tmp_path / "a.csv"
    path.write_text(table(times_s, places), encoding="utf-8")
    notes = read_coils(path).select(NAMES).notes
    assert len(notes) == len(sentences) and all(
        note.startswith(f"{path}: {text}") for note, text in zip(notes, sentences, strict=True)
    )


AXES_OF_THE_SPEAKER = {
    "back,right,up": "", "front,right,up": "turned by 180°, mainly about the vertical axis",
    "back,right,down": "turned by", "front,left,up": "turned by 180°, mainly about",
    "up,right,back": "turned by", "back,up,right": "turned by",
}  # fmt: skip


@pytest.mark.parametrize("axes", AXES_OF_THE_SPEAKER)
def test_a_turned_or_mirrored_recording_is_refused(axes: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times_s, places = movement()
    (tmp_path / "a.csv").write_text(table(times_s, places), encoding="utf-8")
    points = [f"--map={point}={sensor}" for point, sensor in zip(("tip", "front", "dorsum", "back"), NAMES, strict=True)]
    words = [str(tmp_path / "a.csv"), "--test", "trajectory", "--scenario", "vowel-i", *points, "--axes", axes]
    refused = AXES_OF_THE_SPEAKER[axes]
    assert command(["new", "dataset", *words, "--out", str(tmp_path / "b")]) == (2 if refused else 0)
    assert refused in capsys.readouterr().err


def test_a_mirror_image_out_of_one_plane_is_refused() -> None:
    """The signs of one axis are reversed: no rotation brings it back."""
    model = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.03]])
    for seen, refused in ((model, False), (model * [1.0, -1.0, 1.0], True)):
        fitted = procrustes(RegistrationTable(rotation="fit", translation="fit"), model, seen)
        if not refused:
            check_directions(Path("a.csv"), fitted, model, seen, seen, "cartesian", False)
            continue
        with pytest.raises(InputError, match=r"a\.csv: the recording is mirrored: its mirror image fits the model within"):
            check_directions(Path("a.csv"), fitted, model, seen, seen, "cartesian", False)
