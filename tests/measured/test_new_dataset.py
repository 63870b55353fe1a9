"""A dataset made from tables of testing machines: layouts, columns, units, signs, zeros; by options and by questions."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from answers import check_answer
from command import command

from explicitfe.app.cli import asking
from explicitfe.inverse.measured.columns import candidates, chosen
from explicitfe.inverse.measured.export import read_export
from explicitfe.inverse.measured.new_dataset import usual_folder
from explicitfe.inverse.measured.quantities import unit_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import shipped

GEL = ["--test", "compression", "--diameter-mm", "25", "--height-mm", "15"]
PLAIN = "Time (s),Extension (mm),Load (N)\n0,0,0\n1,0.5,0.2\n2,1,0.5\n3,1.5,0.9\n"


def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **files: str) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "names", "units", "second_row"),
    [
        (PLAIN, ["Time", "Extension", "Load"], ["s", "mm", "N"], [1.0, 0.5, 0.2]),
        (
            'Prüfung;"x"\n\n"Zeit";"Weg";"Kraft"\n"[s]";"[mm]";"[N]"\n0;0;1,5\n1;,5;1,75\n2;1;2\n',
            ["Zeit", "Weg", "Kraft"], ["s", "mm", "N"], [1, 0.5, 1.75],
        ),
        ("t x F\n0 1 2\n1 2e-1 3\n2 3 4\n", ["t", "x", "F"], ["", "", ""], [1.0, 0.2, 3.0]),
        ("0,1,2\n1,2,3\n2,3,4\n", ["column 1", "column 2", "column 3"], ["", "", ""], [1.0, 2.0, 3.0]),
        ("time_ms\tload_kN\n0\t1\n1\t2\n3\t4\n", ["time", "load"], ["ms", "kN"], [1.0, 2.0]),
        ("Zeit / s;Kraft / N;\n0;1;\n1;2,5;\n2;3;\nEnde;;\n", ["Zeit", "Kraft"], ["s", "N"], [1.0, 2.5]),
        ('a,b\n"0,5","1,5"\n"1,5","2,5"\n"2","3"\n', ["a", "b"], ["", ""], [1.5, 2.5]),
        ("a,b\r\n0,1\r\n1,\r\n2,3\r\n3,4\r\n\r\n9,9\r\n", ["a", "b"], ["", ""], [1.0, np.nan]),
    ],
)  # fmt: skip
def test_a_table_is_read_as_it_is_laid_out(
    text: str, names: list[str], units: list[str], second_row: list[float], tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    export = read_export(tmp_path / "a.csv")
    assert [column.name for column in export.columns] == names
    assert [column.unit for column in export.columns] == units
    np.testing.assert_array_equal([column.values[1] for column in export.columns], second_row)


def test_a_text_without_a_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1,2\nwords\n3,4\n", encoding="utf-8")
    with pytest.raises(InputError, match="no table of numbers found"):
        read_export(tmp_path / "a.csv")


def test_units_are_known_in_their_spellings() -> None:
    assert [unit_of("force", word) for word in ("N", "kn", "mN", "newtons", "gram", "MN", "mm")] == [
        "N", "kN", "mN", "N", "gf", None, None,
    ]  # fmt: skip
    assert unit_of("stress", "MPA") == "MPa"
    assert unit_of("displacement", "μm") == "µm"


def test_columns_are_guessed_by_name_and_then_by_unit(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "Run time (s),Position (mm),Ch 2 (N),Strain (%)\n0,0,1,2\n1,1,2,3\n2,2,3,4\n", encoding="utf-8"
    )
    export = read_export(tmp_path / "a.csv")
    names = {"time": ["Run time"], "displacement": ["Position"], "force": ["Ch 2"], "stretch": ["Strain"], "stress": []}
    for quantity, right in names.items():
        assert [column.name for column in candidates(export, quantity)] == right
    assert chosen(export, "force", "3:kN")[1] == "kN"
    assert chosen(export, "force", "ch 2")[1] == "N"
    with pytest.raises(InputError, match='there is no column "Chanel"'):
        chosen(export, "force", "Chanel")
    with pytest.raises(InputError, match='"Nm" is no known unit of the force'):
        chosen(export, "force", "Ch 2:Nm")


def test_shipped_tables_become_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    in_folder(tmp_path, monkeypatch)
    files = [name for name in shipped.exports() if name.startswith("gel-")]
    assert command(["new", "dataset", *files, *GEL, "--one-specimen", "--json"]) == 0
    answer = check_answer("new-dataset", capsys.readouterr().out)
    assert answer["columns"] == {"time_s": "Time [s]", "displacement_mm": "Crosshead [mm]", "force_N": "Load [mN]"}
    assert "the sign of the force is reversed: in a dataset, compression is positive." in answer["notes"]
    dataset = read_dataset("gel")
    assert {curve.group for curve in dataset.curves} == {"specimen"}
    fast = next(curve for curve in dataset.curves if curve.id == "gel-fast")
    assert fast.displacement_m.max() == pytest.approx(4.5e-3)
    assert fast.force_N.max() == pytest.approx(1.517, abs=1e-3)
    assert command(["check", "gel", "--json"]) == 0
    report = check_answer("check", capsys.readouterr().out)
    assert [curve["side"] for curve in report["curves"]].count("holdout") == 1
    assert "viscoelastic" in report["can_show"] and {"effect": "cycle-drift", "needs": "repeated cycles"} in report["cannot_show"]
    assert any("friction of the tool is unknown" in warning for warning in report["warnings"])
    assert command(["new", "dataset", *files, *GEL]) == 2
    assert "gel: this already exists; name another folder with --out." in capsys.readouterr().err


def test_rows_that_cannot_be_used_are_left_out_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["0,100,0", "1,100.2,0.001", "2,100.4,0.05", "2,100.5,0.06", "3,,0.1", "4,100.8,0.2", "5,101,0.3", "6,101.2,0.4"]
    in_folder(tmp_path, monkeypatch, a="Time (ms),Position (mm),Load (N)\n" + "\n".join(rows) + "\n")
    assert command(["new", "dataset", "a.csv", *GEL, "--contact-force-N", "0.04", "--out", "b", "--json"]) == 0
    notes = " ".join(json.loads(capsys.readouterr().out)["notes"])
    for words in (
        "1 rows without a number in each column are omitted, the first one in line 6",
        "1 rows whose time does not increase",
        "2 rows before contact",
        "begins at 100 mm",
    ):
        assert words in notes
    curve = read_dataset("b").curves[0]
    np.testing.assert_allclose(curve.time_s, [0.0, 0.002, 0.003, 0.004])
    # The line through the forces 0.05, 0.2, 0.3 and 0.4 N is zero 0.095 mm before the first of them.
    np.testing.assert_allclose(1e3 * curve.displacement_m, 0.0951 + np.array([0.0, 0.4, 0.6, 0.8]), atol=1e-4)
    assert curve.fit_contact


def test_many_rows_are_thinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"{k},{1e-4 * k:.4f},{1e-4 * k:.5f}" for k in range(25_000))
    in_folder(tmp_path, monkeypatch, a=f"t (s),x (mm),F (N)\n{rows}\n")
    assert command(["new", "dataset", "a.csv", *GEL, "--displacement", "x", "--out", "b"]) == 0
    assert "one row in 3 is kept" in capsys.readouterr().err
    assert len(read_dataset("b").curves[0].time_s) == 8334


@pytest.mark.parametrize(
    ("head", "test", "rows", "stretch", "stress_Pa"),
    [
        ("t (s),Strain (%),Stress (kPa)", "compression", "0,0,0\n1,10,1\n2,20,3\n", [1.0, 0.9, 0.8], [0.0, -1e3, -3e3]),
        ("t (s),Strain (%),Stress (kPa)", "tension", "0,0,0\n1,10,1\n2,20,3\n", [1.0, 1.1, 1.2], [0.0, 1e3, 3e3]),
        ("t (s),Stretch,Stress (Pa)", "compression", "0,1,0\n1,.9,-100\n2,.8,-300\n", [1.0, 0.9, 0.8], [0.0, -100.0, -300.0]),
    ],
)
def test_strain_and_stress_need_no_size(
    head: str, test: str, rows: str, stretch: list[float], stress_Pa: list[float],
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    in_folder(tmp_path, monkeypatch, a=f"{head}\n{rows}")
    unit = ["--stretch", "Stretch:1"] if "Stretch" in head else []
    assert command(["new", "dataset", "a.csv", "--test", test, *unit, "--out", "b"]) == 0, capsys.readouterr().err
    (curve,) = read_dataset("b").curves
    np.testing.assert_allclose(curve.columns["stretch"], stretch)
    np.testing.assert_allclose(curve.columns["nominal_stress_Pa"], stress_Pa)


def test_shear_and_pulling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_folder(tmp_path, monkeypatch, a="t (s),Shear strain (%),Shear stress (Pa)\n0,0,0\n1,10,50\n2,20,100\n", b=PLAIN)
    assert command(["new", "dataset", "a.csv", "--test", "shear", "--out", "sheared"]) == 0
    np.testing.assert_allclose(read_dataset("sheared").curves[0].columns["shear_strain"], [0.0, 0.1, 0.2])
    pulled = ["--test", "tension", "--size-mm", "20,20,10", "--tool", "bonded-disc", "--tool-diameter-mm", "8"]
    assert command(["new", "dataset", "b.csv", *pulled, "--out", "pulled"]) == 0
    curve = read_dataset("pulled").curves[0]
    assert curve.force_N.min() == -0.9 and curve.displacement_m.min() == -1.5e-3


def test_a_strip_between_clamps_has_stretch_and_stress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_folder(tmp_path, monkeypatch, a=PLAIN)
    sizes = ["--tool", "clamps", "--length-mm", "10", "--area-mm2", "20"]
    assert command(["new", "dataset", "a.csv", "--test", "tension", *sizes, "--out", "b"]) == 0
    (curve,) = read_dataset("b").curves
    np.testing.assert_allclose(curve.columns["stretch"], [1.0, 1.05, 1.1, 1.15])
    np.testing.assert_allclose(curve.columns["nominal_stress_Pa"], [0.0, 1e4, 2.5e4, 4.5e4])


@pytest.mark.parametrize(
    ("table", "reversed_signs"),
    [
        (PLAIN, []),
        ("Time (s),Extension (mm),Load (N)\n0,0,0\n1,-0.5,0.2\n2,-1,0.5\n3,-1.5,0.9\n", ["displacement"]),
        ("Time (s),Extension (mm),Load (N)\n0,0,0\n1,0.5,-0.2\n2,1,-0.5\n3,1.5,-0.9\n", ["force"]),
    ],
)
def test_a_reversed_sign_is_noted_only_where_it_was_reversed(
    table: str, reversed_signs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    in_folder(tmp_path, monkeypatch, a=table)
    sizes = ["--tool", "clamps", "--length-mm", "10", "--area-mm2", "20"]
    assert command(["new", "dataset", "a.csv", "--test", "tension", *sizes, "--out", "b", "--json"]) == 0
    notes = [f"the sign of the {what} is reversed: in a dataset, tension is positive." for what in reversed_signs]
    assert check_answer("new-dataset", capsys.readouterr().out)["notes"] == notes
    (curve,) = read_dataset("b").curves
    np.testing.assert_allclose(curve.columns["stretch"], [1.0, 1.05, 1.1, 1.15])
    np.testing.assert_allclose(curve.columns["nominal_stress_Pa"], [0.0, 1e4, 2.5e4, 4.5e4])


@pytest.mark.parametrize(
    ("head", "last", "line"), [('"Load (N)', '0.9"', 1), ("Load (N)", "9", 5)], ids=["in the header", "in a row"]
)
def test_a_cell_without_end_is_refused(
    head: str, last: str, line: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A cell of more than 128 KiB is beyond the limit of the csv module."""
    long = 200_000
    head, last = (head + "x" * long + '"', "0.9") if line == 1 else (head, last * long)
    in_folder(tmp_path, monkeypatch, a=f"Time (s),Extension (mm),{head}\n0,0,0\n1,0.5,0.2\n2,1,0.5\n3,1.5,{last}\n")
    assert command(["new", "dataset", "a.csv", *GEL]) == 2
    error = capsys.readouterr().err
    assert f"error: a.csv, line {line}: the line has 2000" in error and "export the table again" in error


def test_options_are_checked_before_a_table_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    in_folder(tmp_path, monkeypatch, a=PLAIN)

    def read(path: Path) -> None:
        raise AssertionError("the table was read")

    monkeypatch.setattr("explicitfe.inverse.measured.export.read_export", read)
    for options in ([], ["--test", "pull"], [*GEL, "--base", "glued"], [*GEL, "--control", "both"], [*GEL, "--rate", "-1"]):
        assert command(["new", "dataset", "a.csv", *options]) == 2
        assert "error: --" in capsys.readouterr().err


def test_a_table_that_is_too_large_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    in_folder(tmp_path, monkeypatch, a=PLAIN)
    monkeypatch.setattr("explicitfe.inverse.measured.export.LARGEST_EXPORT_BYTES", 40)
    assert command(["new", "dataset", "a.csv", *GEL]) == 2
    assert "a.csv: the file has 0 MiB, and no more than 0 MiB are read; export the table" in capsys.readouterr().err


def test_a_rate_stands_for_a_column_of_the_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_folder(tmp_path, monkeypatch, a="Travel (mm),Load (N)\n10,0\n10.5,0.2\n11,0.5\n11,0.5\n11.5,0.9\n11,0.4\n")
    assert command(["new", "dataset", "a.csv", *GEL, "--rate", "0.25", "--out", "b"]) == 0
    (curve,) = read_dataset("b").curves
    np.testing.assert_allclose(curve.time_s, [0.0, 2.0, 4.0, 6.0, 8.0])
    np.testing.assert_allclose(curve.displacement_m, [0.0, 0.5e-3, 1e-3, 1.5e-3, 1e-3], atol=1e-12)
    assert command(["new", "dataset", "a.csv", *GEL, "--rate", "0.25", "--control", "force", "--out", "c"]) == 0
    np.testing.assert_allclose(read_dataset("c").curves[0].time_s, [0.0, 0.8, 2.0, 3.6, 5.6])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings_of_other_programs_are_read(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("Weg in µm;Prüfkraft (N)\n0;0\n1;2\n2;3\n".encode(encoding))
    export = read_export(tmp_path / "a.csv")
    assert [(column.name, column.unit) for column in export.columns] == [("Weg", "µm"), ("Prüfkraft", "N")]


@pytest.mark.parametrize(
    ("text", "options", "sentence"),
    [
        (PLAIN, [], "--test is missing; give one of compression"),
        (PLAIN, ["--test", "compresion"], 'did you mean "compression"?'),
        (PLAIN, ["--test", "compression"], "(for a block: --size-mm)), --height-mm NUMBER"),
        (PLAIN, ["--test", "indentation", *GEL[2:]], "bonded-disc, here for flat-cylinder, --tool-d"),
        (PLAIN, ["--test", "indentation", *GEL[2:], "--tool", "sphere"], "a.csv: add --tool-diameter-mm NUMBER ("),
        (PLAIN, [*GEL, "--force", "Load:MN"], '"MN" is no known unit of the force'),
        (PLAIN, [*GEL, "--friction", "slippery"], '--friction "slippery" is not possible'),
        (PLAIN, ["--test", "tension"], "add --tool platen|flat-cylinder|sphere|bonded-disc|clamps, here for clamps, --length-mm"),
        (PLAIN, ["--test", "tension", "--tool", "clamps", "--length-mm", "8"], "add --area-mm2 NUMBER (cross-section"),
        (PLAIN, [*GEL, "--tool", "clamps"], "--tool clamps is not for --test compression"),
        (PLAIN.replace("Time (s)", "No"), GEL, '--time "COLUMN:s", or --rate PER_S without a time'),
        (PLAIN.replace("Time (s)", "No"), [*GEL, "--rate", "-1"], "give a number above 0"),
        (PLAIN, [*GEL, "--size-mm", "1,2,3"], "--size-mm (a block) excludes --diameter-mm"),
        (PLAIN, [*GEL, "--contact-force-N", "7"], "the force never reaches the contact force of 7 N"),
        (PLAIN.replace("(mm)", ""), GEL, 'add --displacement "Extension:mm" (its unit is not stated; units: mm, cm'),
        (PLAIN.replace("(mm)", "(m)"), GEL, "is deeper than the specimen is high"),
    ],
)  # fmt: skip
def test_a_script_is_told_what_is_missing(
    text: str,
    options: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    in_folder(tmp_path, monkeypatch, a=text)
    assert command(["new", "dataset", "a.csv", "--out", "b", *options]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert ".part" not in error and not list(tmp_path.glob("*b*"))


def test_a_missing_option_is_stated_by_the_beginning_of_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another table below the first lines is not read before all options are known."""
    rows = "".join(f"{k},{0.001 * k:.3f},{0.002 * k:.3f}\n" for k in range(2500))
    in_folder(tmp_path, monkeypatch, a=PLAIN.splitlines()[0] + "\n" + rows + 10 * "1,2,3,4\n")
    assert command(["new", "dataset", "a.csv", "--test", "compression"]) == 2
    assert "add --diameter-mm NUMBER" in capsys.readouterr().err
    assert command(["new", "dataset", "a.csv", *GEL]) == 2
    assert "a.csv, line 2502: this row has 4 cells" in capsys.readouterr().err


def answering(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr(asking, "somebody_is_there", lambda: True)
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


def test_a_person_is_asked_for_what_the_files_do_not_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "t,zz,q\n0,0,0\n1,-0.5,-200\n2,-1,-500\n3,-1.5,-900\n"
    in_folder(tmp_path, monkeypatch, gel_1=text, gel_2=text)
    # what was done, the tool; the unit of time; a column and its unit, twice; shape and sizes
    answering(monkeypatch, "i", "s", "", "2", "yards", "mm", "q", "mN", "", "25", "zero", "15", "8", "yes")
    assert command(["new", "dataset", "gel_1.csv", "gel_2.csv"]) == 0
    error = capsys.readouterr().err
    assert "please answer: mm, cm, m" in error and "please type a number above 0." in error
    dataset = read_dataset("gel")
    assert dataset.test == "indentation" and len(dataset.curves) == 2
    assert dataset.curves[0].specimen is not None and dataset.curves[0].specimen.radius_mm == 12.5
    assert dataset.curves[0].tool is not None and (dataset.curves[0].tool.shape, dataset.curves[0].tool.radius_mm) == (
        "sphere",
        4.0,
    )
    assert dataset.curves[1].force_N.max() == 0.9


def test_questions_without_answers_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    in_folder(tmp_path, monkeypatch, a=PLAIN)
    answering(monkeypatch, "compression")
    assert command(["new", "dataset", "a.csv"]) == 2
    assert "the answers ended before the last question" in capsys.readouterr().err


def test_a_folder_is_named_after_its_files() -> None:
    assert usual_folder([Path("Gel slow.csv")]) == Path("gel-slow")
    assert usual_folder([Path("gel-a.csv"), Path("gel-b.csv")]) == Path("gel")
    assert usual_folder([Path("x.csv"), Path("y.csv")]) == Path("x")
