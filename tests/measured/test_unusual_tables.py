"""Right tables in unusual forms, made by a generator: each is read right, or refused with a sentence that names the cause."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from command import command

from explicitfe.inverse.measured.export import read_export
from explicitfe.inverse.measured.read import read_dataset

# A ramp, a hold and a way back: time [s], displacement [mm], force [N].
ROWS = 60
TIME = 0.25 * np.arange(ROWS)
DISPLACEMENT = 0.08 * np.concatenate([np.arange(40), np.full(8, 39), 39 - 3 * np.arange(1, 13)])
FORCE = 0.02 * DISPLACEMENT + 0.13 * DISPLACEMENT**2
GEL = ["--test", "compression", "--diameter-mm", "25", "--height-mm", "15"]
BAR = ["--test", "tension"]
STRETCH = 1.0 + 0.3 * np.arange(ROWS)  # up to 18.7
STRESS = 1e4 * (STRETCH - STRETCH**-2)  # nominal, Pa
Lines = list[str]


def number(value: float, decimals: int = 4, decimal: str = ".", thousands: str = "") -> str:
    """A number as machines write it."""
    text = f"{value:,.{decimals}f}".replace(",", "T").replace(".", decimal)
    return text.replace("T", thousands)


def table(
    names: Sequence[str] = ("Time (s)", "Extension (mm)", "Load (N)"),
    columns: Sequence[np.ndarray] = (TIME, DISPLACEMENT, FORCE),
    separator: str = ",",
    decimals: Sequence[int] = (2, 4, 4),
    change: Callable[[Lines], Lines] = lambda lines: lines,
    **form: str,
) -> str:
    """The text of a table; ``change`` changes its lines, the first of which has the names."""
    lines = [separator.join(names)] if names else []
    for row in zip(*columns, strict=True):
        lines.append(separator.join(number(value, d, **form) for value, d in zip(row, decimals, strict=True)))
    return "\n".join(change(lines)) + "\n"


def insert(at: int, *more: str) -> Callable[[Lines], Lines]:
    return lambda lines: [*lines[:at], *more, *lines[at:]]


def each(row: Callable[[int, str], str]) -> Callable[[Lines], Lines]:
    """Change every row of numbers by its number."""
    return lambda lines: [lines[0], *(row(k, line) for k, line in enumerate(lines[1:]))]


def cell(row: int, column: int, text: str, separator: str = ",") -> Callable[[Lines], Lines]:
    def change(lines: Lines) -> Lines:
        cells = lines[row + 1].split(separator)
        cells[column] = text
        return [*lines[: row + 1], separator.join(cells), *lines[row + 2 :]]

    return change


def test_many_rows_are_read_at_once_as_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows with text, lines of text, repeated names and other numbers of cells between many rows of numbers."""
    lines = [f"{0.1 * k:.1f};{0.01 * k:.3f};{0.02 * k:.4f}".replace(".", ",") for k in range(9000)]
    for k in (0, 77, 4096, 8999):
        lines[k] = lines[k].rpartition(";")[0] + ";OVER"
    lines[300:300] = ["Segment 2", "Zeit (s);Weg (mm);Kraft (N)", "", "1;2"]
    (tmp_path / "a.csv").write_text("\n".join(["Zeit (s);Weg (mm);Kraft (N)", *lines]), encoding="utf-8")
    at_once = read_export(tmp_path / "a.csv")
    monkeypatch.setattr("explicitfe.inverse.measured.export.MOST_ROWS_AT_ONCE", 1)
    one_by_one = read_export(tmp_path / "a.csv")
    assert at_once.notes == one_by_one.notes and "4 cells have text" in at_once.notes[-1]
    np.testing.assert_array_equal(at_once.line_of, one_by_one.line_of)
    for one, other in zip(at_once.columns, one_by_one.columns, strict=True):
        assert len(one.values) == 9000
        np.testing.assert_array_equal(one.values, other.values)


HEAD = ["Machine;Universal 5", "Operator;Müller", "Diameter;25", "Preload;0,05;N", "Date;28.11.2026;12:30:05", ""]
MN = 1e3 * FORCE  # up to 1330 mN
N_MM2 = ("t [s]", "Strain [%]", "Stress [{}]")
CLOCK = [f"00:{int(t // 60):02d}:{t % 60:05.2f}" for t in TIME]
INTEGERS = {
    "names": ("t (ms)", "x (µm)", "Load (mN)"),
    "columns": (1e3 * TIME, 1e3 * DISPLACEMENT, np.round(MN)),
    "decimals": (0, 0, 0),
}


def in_unit(unit: str, factor: float) -> str:
    """Strain and stress in a unit of so many Pa."""
    columns = (TIME, 100.0 * (STRETCH - 1.0), STRESS / factor)
    return table([name.format(unit) for name in N_MM2], columns, ";", (2, 2, 10))


def measured(strain: str, stress: str, x: np.ndarray, y: np.ndarray) -> str:
    return table(("Time (s)", f"{strain} (-)", f"{stress} (kPa)"), (TIME, x, 1e-3 * y), decimals=(2, 12, 12))


READ: dict[str, str] = {
    "semicolons, decimal comma": table(separator=";", decimal=","),
    "tabs, decimal comma": table(separator="\t", decimal=","),
    "blanks, decimal comma": table(("t_s", "x_mm", "F_N"), separator="  ", decimal=","),
    "blanks, names of several words": table(("Run time (s)", "Crosshead (mm)", "Load cell (N)"), separator="   "),
    "pipes in quotes": "\n".join(
        ",".join(f'"{c}"' for c in line.split(";")) for line in table(separator=";", decimal=",").splitlines()
    ),
    "thousands by comma in quotes": table(
        ("t (s)", "x (mm)", "Load (mN)"),
        (TIME, DISPLACEMENT, MN),
        '","',
        thousands=",",
        change=lambda lines: [f'"{line}"' for line in lines],
    ),
    "thousands by point": table(("t (s)", "x (mm)", "Load (mN)"), (TIME, DISPLACEMENT, MN), ";", decimal=",", thousands="."),
    "thousands by blank": table(("t (s)", "x (mm)", "Load (mN)"), (TIME, DISPLACEMENT, MN), "\t", decimal=",", thousands=" "),
    "thousands by narrow blank": table(("t (s)", "x (mm)", "Load (mN)"), (TIME, DISPLACEMENT, MN), ";", thousands="\u202f"),
    "thousands by apostrophe": table(("t (s)", "x (mm)", "Load (mN)"), (TIME, DISPLACEMENT, MN), ";", thousands="'"),
    "whole thousands by point": table(separator=";", thousands=".", **INTEGERS),
    "whole thousands by comma": table(separator="\t", thousands=",", **INTEGERS),
    "units row with brackets": table(("Time", "Extension", "Load"), change=insert(1, "(s),(mm),(N)")),
    "units row without brackets": table(("Time", "Extension", "Load"), change=insert(1, "sec,mm,N")),
    "units row above the names": table(("Time", "Extension", "Load"), change=insert(0, "s,mm,N")),
    "units row and a blank line": table(("Time", "Extension", "Load"), separator="\t", change=insert(1, "s\tmm\tN", "")),
    "units after in": table(("Zeit in s", "Traversenweg in mm", "Standardkraft in N"), separator=";", decimal=","),
    "units after a blank": table(("Time s", "Extension mm", "Load N"), separator="\t"),
    "units after a comma": table(("Time, s", "Extension, mm", "Load, N"), separator="\t"),
    "units in braces": table(("Time {sec}", "Extension {mm}", "Load {N}")),
    "names with line breaks": table(('"Time\n(s)"', '"Extension\n(mm)"', '"Load\n(N)"')),
    "names behind a comment sign": table(("# Time (s)", "Extension (mm)", "Load (N)"), separator="\t"),
    "names of blanks behind a comment sign": table(("# t_s", "x_mm", "F_N"), separator=" "),
    "head of other widths": table(separator=";", decimal=",", change=insert(0, *HEAD)),
    "names repeated": table(change=lambda lines: [*lines[:21], *lines[:1], *lines[21:41], *lines[:1], *lines[41:]]),
    "names and units repeated": table(
        ("Time", "Extension", "Load"), change=lambda lines: [lines[0], "s,mm,N", *lines[1:31], lines[0], "s,mm,N", *lines[31:]]
    ),
    "lines of text between cycles": table(
        change=lambda lines: [
            lines[0],
            "Segment 1: ramp",
            *lines[1:41],
            "",
            "Segment 2: hold",
            "",
            *lines[41:49],
            "Segment 3,,",
            *lines[49:],
        ]
    ),
    "cycle near the begin": table(change=insert(4, "cycle 2")),
    "blank lines between all rows": table(change=lambda lines: [line for one in lines for line in (one, "")]),
    "a column of text": table(
        ("Time (s)", "Extension (mm)", "Load (N)", "Step"),
        change=each(lambda k, line: f"{line},{'ramp' if k < 40 else 'hold or back'}"),
    ),
    "text in front": table(("Step", "Time (s)", "Extension (mm)", "Load (N)"), change=each(lambda k, line: f"ramp up,{line}")),
    "text behind some rows": table(change=each(lambda k, line: f"{line},pause here" if k in (9, 40) else line)),
    "means below": table(
        separator=";", decimal=",", change=lambda lines: [*lines, "", "Mean;1,5;0,3", "SD;0,1;0,02", "Max;3,1;1,3"]
    ),
    "a column that is empty": table(
        ("Time (s)", "", "Extension (mm)", "Load (N)"), change=each(lambda k, line: line.replace(",", ",,", 1))
    ),
    "times of day": table(change=each(lambda k, line: ",".join([CLOCK[k], *line.split(",")[1:]]))),
    "typographic minus": table(columns=(TIME, -DISPLACEMENT, -FORCE), change=each(lambda k, line: line.replace("-", "\u2212"))),
    "exponents of Fortran": table(
        change=each(lambda k, line: ",".join(f"{float(c):.9E}".replace("E", "D") for c in line.split(",")))
    ),
    "exponents with decimal comma": table(
        separator=";",
        change=lambda lines: [
            lines[0].replace(",", ";"),
            *(";".join(f"{float(c):.9e}".replace(".", ",") for c in line.split(";")) for line in lines[1:]),
        ],
    ),
    "kgf": table(
        ("Time (min)", "Stroke (cm)", "Load (kgf)"), (TIME / 60.0, 0.1 * DISPLACEMENT, FORCE / 9.80665), decimals=(9, 9, 9)
    ),
    "small units": table(
        ("Time (µs)", "Position (nm)", "Kraft (uN)"), (1e6 * TIME, 1e6 * DISPLACEMENT, 1e6 * FORCE), "\t", (0, 1, 1)
    ),
    "nN": table(("Time (sec)", "Indentation (um)", "Force (nN)"), (TIME, 1e3 * DISPLACEMENT, 1e9 * FORCE), decimals=(2, 5, 1)),
    "other columns of the same unit": table(
        ("Time at load (s)", "Time (s)", "Extension (mm)", "Load (N)"),
        (0 * TIME, TIME, DISPLACEMENT, FORCE),
        decimals=(0, 2, 4, 4),
    ),
    "order of columns": table(("Load (N)", "Extension (mm)", "Time (s)"), (FORCE, DISPLACEMENT, TIME), decimals=(4, 4, 2)),
    "cells aligned by blanks": table(separator=" ,   "),
    "separator at the end of rows": table(change=lambda lines: [f"{line}," for line in lines]),
    "times of day without a unit": table(
        ("Time", "Extension (mm)", "Load (N)"), change=each(lambda k, line: ",".join([CLOCK[k], *line.split(",")[1:]]))
    ),
    "results with names of their own above": table(
        ("Time", "Extension", "Load"),
        change=lambda lines: [
            "Largest load (N),At (mm),Modulus (kPa)",
            "1.33,3.12,2.1",
            "",
            lines[0],
            "(s),(mm),(N)",
            *lines[1:],
        ],
    ),
    "empty columns behind": table(change=lambda lines: [f"{line},,," for line in lines]),
    "old Macintosh lines": table().replace("\n", "\r"),
    "cN": table(("Time (s)", "Travel (cm)", "Force (cN)"), (TIME, 0.1 * DISPLACEMENT, 100.0 * FORCE), decimals=(2, 5, 4)),
    "daN": table(("Time (s)", "Course (cm)", "Effort (daN)"), (TIME, 0.1 * DISPLACEMENT, 0.1 * FORCE), decimals=(2, 5, 6)),
    "inches by their mark": table(
        ("Time (s)", 'Deflection (")', "Load (lb)"), (TIME, DISPLACEMENT / 25.4, FORCE / 4.4482216), ";", (2, 7, 7)
    ),
    "names and units behind keys of a comment": table(
        ("# columns: seriesTime separation vDeflection",),
        (TIME, 1e-3 * DISPLACEMENT, FORCE),
        " ",
        (2, 8, 4),
        change=lambda lines: ["# index: 0", "# xPosition: 1.2E-6", lines[0], "# units: s m N", *lines[1:]],
    ),
    "a time that begins again beside one that does not": table(
        ("Scan time (s)", "Elapsed time (s)", "Disp (mm)", "Load (N)"),
        (TIME % 5.0, TIME, DISPLACEMENT, FORCE),
        decimals=(2, 2, 4, 4),
    ),
}


@pytest.mark.parametrize("form", READ)
def test_a_tool_curve_is_read_right(form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(READ[form], encoding="utf-8", newline="")
    assert command(["new", "dataset", "a.csv", *GEL, "--out", "b"]) == 0
    (curve,) = read_dataset("b").curves
    np.testing.assert_allclose(curve.time_s, TIME, atol=1e-6)
    np.testing.assert_allclose(1e3 * curve.displacement_m, DISPLACEMENT, atol=1e-4)
    np.testing.assert_allclose(curve.force_N, FORCE, atol=6e-4)


HOMOGENEOUS: dict[str, str] = {
    "percent and a stretch of 18.7": in_unit("kPa", 1e3),
    **{
        f"stress in {unit}": in_unit(unit, factor)
        for unit, factor in {
            "N/mm²": 1e6,
            "N/mm^2": 1e6,
            "N mm-2": 1e6,
            "N·mm⁻²": 1e6,
            "N/mm2": 1e6,
            "kgf/cm²": 98066.5,
            "kg/cm2": 98066.5,
            "bar": 1e5,
            "mbar": 1e2,
            "MPA": 1e6,
            "N/m²": 1.0,
            "kN/m2": 1e3,
            "mmHg": 133.322387415,
            "psi": 6894.757293168,
            "GPa": 1e9,
            "ksi": 6894757.293168,
        }.items()
    },
    "true strain and stress": measured("True strain", "True stress", np.log(STRETCH), STRESS * STRETCH),
    "Cauchy and Hencky": measured("Hencky strain", "Cauchy stress", np.log(STRETCH), STRESS * STRETCH),
    "log in brackets": table(
        ("Time (s)", "Strain (log)", "Stress (true) (kPa)"),
        (TIME, np.log(STRETCH), 1e-3 * STRESS * STRETCH),
        decimals=(2, 12, 12),
        change=lambda lines: [lines[0].replace("(log)", "(log) [1]"), *lines[1:]],
    ),
    "wahre Spannung": measured("Techn. Dehnung", "wahre Spannung", STRETCH - 1.0, STRESS * STRETCH),
    "Green and second Piola": measured("Green strain", "2nd Piola-Kirchhoff stress", 0.5 * (STRETCH**2 - 1.0), STRESS / STRETCH),
    "both strains": table(
        ("Time (s)", "True strain (%)", "Engineering strain (%)", "Stress (Pa)"),
        (TIME, 100.0 * np.log(STRETCH), 100.0 * (STRETCH - 1.0), STRESS),
        decimals=(2, 6, 6, 6),
    ),
}


@pytest.mark.parametrize("form", HOMOGENEOUS)
def test_strain_and_stress_are_read_right(form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(HOMOGENEOUS[form], encoding="utf-8")
    assert command(["new", "dataset", "a.csv", *BAR, "--out", "b"]) == 0
    (curve,) = read_dataset("b").curves
    np.testing.assert_allclose(curve.columns["stretch"], STRETCH, rtol=1e-5)
    np.testing.assert_allclose(curve.columns["nominal_stress_Pa"], STRESS, rtol=1e-5, atol=0.5)


NOTED: dict[str, tuple[str, int, str]] = {
    "OVER": (table(change=cell(30, 2, "OVER")), ROWS - 1, 'text instead of a number, the first one in line 32: "OVER"'),
    "stars in a hold": (table(change=cell(44, 1, "*****")), ROWS - 1, 'the first one in line 46: "*****"'),
    "an empty cell": (
        table(separator=";", change=cell(20, 2, "", ";")),
        ROWS - 1,
        "without a number in each column are omitted, the first one in line 22",
    ),
    "names repeated": (
        table(change=lambda lines: [*lines[:21], *lines[:1], *lines[21:]]),
        ROWS,
        "the names are repeated, first in line 22",
    ),
    "text between": (
        table(change=insert(30, "hold begins")),
        ROWS,
        "1 lines of text between or below the rows are skipped, the first one in line 31",
    ),
    "out of range to the end": (
        table(change=each(lambda k, line: line if k < 40 else f"{line.rpartition(',')[0]},OVERLOAD")),
        40,
        '20 cells have text instead of a number, the first one in line 42: "OVERLOAD"',
    ),
    "means below": (
        table(change=lambda lines: [*lines, "Mean,1.5,0.3"]),
        ROWS,
        "1 lines of text between or below the rows are skipped, the first one in line 62",
    ),
    "a slow channel": (
        table(change=each(lambda k, line: line if k % 4 == 0 else f"{line.rpartition(',')[0]},")),
        ROWS // 4,
        "45 rows without a number in each column are omitted, the first one in line 3",
    ),
    "the force of the first row is out of range": (
        table(change=cell(0, 2, "OVER")),
        ROWS - 1,
        "1 rows without a number in each column are omitted, the first one in line 2",
    ),
    "the last row is cut": (
        table(
            columns=[np.linspace(c[0], c[39], 100) for c in (TIME, DISPLACEMENT, FORCE)],
            change=lambda lines: [*lines, "15.00,0.2"],
        ),
        100,
        "1 row of numbers outside the table omitted, the first one in line 102: it has 2 cells",
    ),
    **{
        f"{mark} for a missing force": (
            table(change=lambda lines, mark=mark: cell(30, 2, mark)(cell(10, 2, mark)(lines))),
            ROWS - 2,
            f'{float(mark):g} in the column "Load" is far outside all other values and is taken as missing in 2 rows',
        )
        for mark in ("-9999", "-16512", "1e30", "32768", "-5000")
    },
    "a measured and a set displacement": (
        table(("Zeit (s)", "Weg Soll (mm)", "Weg Ist (mm)", "Kraft (N)"), (TIME, 1.05 * DISPLACEMENT, DISPLACEMENT, FORCE), ";",
              (2, 4, 4, 4)),
        ROWS,
        '"Weg Ist" is taken as the displacement, not the set value "Weg Soll"',
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", NOTED)
def test_a_lost_row_is_noted(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, rows, note = NOTED[form]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    assert command(["new", "dataset", "a.csv", *GEL, "--out", "b", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["curves"][0]["rows"] == rows
    assert note in " ".join(answer["notes"])


def beside(*names: str, of: Sequence[float] = (1.0, 1.4)) -> str:
    """Specimens beside each other."""
    columns = [column for factor in of for column in (DISPLACEMENT, factor * FORCE)]
    return table(("Time (s)", *names), (TIME, *columns), decimals=(2, *[4] * len(columns)))


TWO_UNITS = table(("Time (s)", "Extension (mm)", "Load (kN)"), change=insert(1, "s,mm,N"))
BELOW = [f"{name},{line}" for name in "AB" for line in table(columns=(DISPLACEMENT, FORCE), decimals=(4, 4)).splitlines()[1:]]
OTHER = ["Time (s),Extension (mm),Temperature (C)", *(f"{k},1.5,20.0" for k in range(ROWS // 2))]
REFUSED: dict[str, tuple[str, list[str], str]] = {
    "thousands without quotes": (
        table(("t (s)", "x (mm)", "Load (mN)"), (TIME, DISPLACEMENT, MN), thousands=","),
        GEL,
        "line 36: this row has 4 cells and is not part of the table of 3 columns",
    ),
    "thousands or decimals": (
        table(columns=(1.0 + TIME, 1.0 + DISPLACEMENT, 1.0 + FORCE), separator=";", decimals=(3, 3, 3), decimal=","),
        GEL,
        'line 2: "1,000" may have a decimal comma or a thousands separator',
    ),
    "thousands in some rows": (
        table(
            ("t (s)", "x (mm)", "Load (mN)"),
            (TIME, DISPLACEMENT, MN),
            "\t",
            thousands=",",
            change=lambda lines: [*lines[:-20], *(line.replace(",", "") for line in lines[-20:])],
        ),
        GEL,
        'has no thousands separator, but other numbers of the column "Load" have',
    ),
    "two decimal marks": (
        table(separator=";", change=lambda lines: [*lines[:30], *(line.replace(".", ",") for line in lines[30:])]),
        GEL,
        '"0.00" in line 2 and "7,25" in line 31 have different decimal marks',
    ),
    "commas for both": (
        table(("Time (s)", "Load (N)"), (TIME, FORCE), decimals=(2, 4), decimal=","),
        GEL,
        "line 1: there are 2 names, but 4 cells in a row; commas are both",
    ),
    "another table below": (
        table(change=lambda lines: [*lines, *OTHER]),
        GEL,
        "line 63: this row belongs to another table, which begins in line 62",
    ),
    "another table above": (
        table(change=lambda lines: [*OTHER, "", *lines]),
        GEL,
        "line 2: this row belongs to another table, which begins in line 1",
    ),
    "columns end early": (
        table(change=lambda lines: [*lines[:40], *(line.rpartition(",")[0] for line in lines[40:])]),
        GEL,
        "line 41: this row has 2 cells",
    ),
    "cycles with their own time": (
        table(change=lambda lines: [*lines, *lines[1:]]),
        GEL,
        "line 62: the time goes back from 14.75 s to 0 s",
    ),
    "cycles with names and their own time": (
        table(change=lambda lines: [*lines, *lines]),
        GEL,
        "line 63: the time goes back from 14.75 s to 0 s",
    ),
    "an unknown unit": (
        table(("Time (s)", "Extension (mm)", "Load (V)")),
        GEL,
        'add --force "Load:UNIT" ("V" is no known unit: convert the column to one of those that are; units: N, mN',
    ),
    "no units": (
        table(("Time", "Extension", "Load")),
        GEL,
        'add --time "Time:s", or --rate PER_S without a time column, (its unit is not stated',
    ),
    "no units, several options": (
        table(("Time", "Extension", "Load")),
        GEL[:2],
        '--force "Load:N" (its unit is not stated; units: N, mN, µN, nN, kN, gf, kgf, cN, daN, lbf, ozf, dyn), --diameter-mm',
    ),
    "no time": (
        table(("Extension (mm)", "Load (N)"), (DISPLACEMENT, FORCE), decimals=(4, 4)),
        GEL[:2],
        'add --time "COLUMN:s", or --rate PER_S',
    ),
    "numbers with units": (table(change=each(lambda k, line: f"{line} N")), GEL, '"Load" has text, such as "0.0000 N"'),
    "only text": ("Time;Load\nnone;some\n", GEL, "no table of numbers found"),
    "two units of the force": (TWO_UNITS, GEL, "its name and the row of units state different ones, kN or N"),
    "two load cells": (
        table(
            ("Time (s)", "Disp (mm)", "Load 1kN (N)", "Load 10N (N)"), (TIME, DISPLACEMENT, 1.02 * FORCE, FORCE), decimals=[4] * 4
        ),
        GEL,
        'add --force COLUMN (2 columns may be it: 3 "Load 1kN", 4 "Load 10N"; give the name or the number of one)',
    ),
    "specimens beside each other": (
        beside(*["Extension (mm)", "Load (N)"] * 2),
        GEL,
        '--force COLUMN (2 columns may be it: 3 "L',
    ),
    "named specimens beside each other": (
        beside("x 1 (mm)", "Load 1 (N)", "x 2 (mm)", "Load 2 (N)"),
        GEL,
        '3 "Load 1", 5 "Load 2"',
    ),
    "a displacement and a corrected one": (
        table(
            ("Time (s)", "u (mm)", "Position (mm)", "Load (N)"), (TIME, 1.1 * DISPLACEMENT, DISPLACEMENT, FORCE), decimals=[4] * 4
        ),
        GEL,
        '--displacement COLUMN (2 columns may be it: 2 "u", 3 "Position"',
    ),
    "specimens below each other, no time": (
        "\n".join(["Specimen,Disp (mm),Force (N)", *BELOW]),
        [*GEL, "--rate", "0.25"],
        'the rows belong to 2 different values of the column "Specimen" (A, B)',
    ),
    "a workbook": ("PK\x03\x04 [Content_Types].xml", GEL, "this is a workbook, as of Excel: save its sheet as CSV"),
    "a page": ("<html><table><tr><td>1.0</td></tr></table></html>", GEL, "this is a page of HTML or XML"),
    "UTF-16 without a mark": (table(separator="\t").encode("utf-16-le").decode("latin-1"), GEL, "this is UTF-16 without"),
    "units in all cells": ("t,u\n" + "0.25 s,0.5 mm\n" * ROWS, GEL, "units stand behind the numbers"),
    "rows for columns": (
        "\n".join(f"{name},{','.join(map(str, v))}" for name, v in (("Time (s)", TIME), ("Disp (mm)", TIME), ("Load (N)", TIME))),
        GEL,
        "each quantity stands in a row; transpose the table",
    ),
    "true shear": (
        table(("Time (s)", "True shear strain (-)", "Shear stress (kPa)"), (TIME, 0.01 * DISPLACEMENT, FORCE)),
        ["--test", "shear"],
        '"True shear strain" is no measure of simple shear',
    ),
    "a stretch above 50": (
        table(("Time (s)", "Stretch (-)", "Stress (kPa)"), (TIME, 1.0 + 5.0 * np.arange(ROWS), FORCE)),
        BAR,
        "stretches above 50 are not supported; omit these rows",
    ),
    "percent taken as fractions": (
        table(("Time (s)", "Stretch (-)", "Stress (kPa)"), (TIME, 100.0 + DISPLACEMENT, FORCE)),
        BAR,
        "stretch = 100 is not possible; give current length over length at rest",
    ),
}


@pytest.mark.parametrize("form", REFUSED)
def test_a_table_that_cannot_be_read_is_refused_with_the_cause(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, options, sentence = REFUSED[form]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    assert command(["new", "dataset", "a.csv", *options, "--out", "b"]) == 2
    error = capsys.readouterr().err
    assert sentence in error and "Traceback" not in error
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(
    ("unit", "mm_per_unit", "sentence"), [("nm", 1e-6, ""), ("mm", 1.0, "a.csv, converted to a.csv (not written), line")]
)
def test_a_small_dent_of_a_sphere_is_read_unless_it_is_in_metres(
    unit: str,
    mm_per_unit: float,
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """2 micrometres by Hertz with a stiffness of 10 kPa; and 2 mm of the same, given as 0.002."""
    monkeypatch.chdir(tmp_path)
    depth_m = np.linspace(0.0, 2e-3 if sentence else 2e-6, ROWS)
    force = 4.0 / 3.0 * 1e4 / 0.75 * np.sqrt(5e-4) * depth_m**1.5
    shown = depth_m if sentence else 1e3 * depth_m / mm_per_unit
    names = ("Time (s)", f"Depth ({unit})", "Load (N)")
    (tmp_path / "a.csv").write_text(table(names, (TIME, shown, force), decimals=(2, 7, 12)), encoding="utf-8")
    sphere = ["--test", "indentation", "--tool", "sphere", "--tool-diameter-mm", "1", "--size-mm", "10,10,5"]
    assert command(["new", "dataset", "a.csv", *sphere, "--out", "b"]) == (2 if sentence else 0)
    assert sentence in capsys.readouterr().err
