"""Measured curves: what is right is read into SI, and all that is wrong gives one sentence with the file, the line or key."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outside_data import SHARED_DATA, needs

from explicitfe.inverse.measured.curve import Curve, Dataset, same_measurement, sd_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError

MEASURED = SHARED_DATA / "measured"

Tables = dict[str, Any]
Files = dict[str, str]
Case = tuple[Tables, Files]

INDENTATION: Tables = {
    "format": "explicitfe-dataset/1",
    "name": "soft-block",
    "title": "A soft block",
    "test": "indentation",
    "source": "made for a test",
    "license": "CC0",
    "notes": "",
    "specimen": {"shape": "cylinder", "radius_mm": 35.0, "height_mm": 20, "base": "bonded", "assumed": ["radius_mm"]},
    "tool": {"shape": "flat-cylinder", "radius_mm": 14.0, "edge_radius_mm": 1.0, "control": "force", "friction": 0.3},
    "noise": {"force_sd_N": 0.001, "displacement_sd_mm": 0.0, "repeat_sd_fraction": 0.03},
    "curve": [
        {"id": "one", "file": "one.csv", "group": "A", "conditions": {"rate_mm_per_s": 0.5, "digitisation": 1}},
        {"id": "two", "file": "two.csv", "specimen": {"height_mm": 21.0}, "conditions": {"rate_mm_per_s": 5, "repeat": 1}},
    ],
}
INDENTATION_CSV = "time_s,displacement_mm,force_N\n0,0,0\n1,0.5,0.04\n2,1,0.1\n4,0.5,0.03\n"
STRESS_CSV = "time_s,stretch,nominal_stress_Pa\n0,1,0\n1,0.9,-100\n2,0.8,-300\n"
SHEAR_CSV = "time_s,shear_strain,shear_stress_Pa\n0,0,0\n1,0.1,50\n2,-0.2,-100\n"
SENSOR_CSV = "time_s,TT_x_mm,TT_y_mm,TT_z_mm,TB_x_mm,TB_y_mm,TB_z_mm\n0,1,2,3,4,5,6\n1,1,2,4,4,5,7\n2,1,2,5,4,5,8\n"


def indentation() -> Case:
    return deepcopy(INDENTATION), {"one.csv": INDENTATION_CSV, "two.csv": INDENTATION_CSV}


def homogeneous(test: str, text: str, **noise: float) -> Case:
    tables = deepcopy(INDENTATION) | {"test": test, "specimen": {"shape": "point"}, "noise": noise}
    del tables["tool"], tables["curve"][1]["specimen"]
    return tables, {"one.csv": text, "two.csv": text}


def compression() -> Case:
    return homogeneous("compression", STRESS_CSV, stress_sd_Pa=1.0, stretch_sd=0.001)


def shear() -> Case:
    return homogeneous("shear", SHEAR_CSV, stress_sd_Pa=1.0, stretch_sd=0.002)


def trajectory() -> Case:
    tables, files = homogeneous("trajectory", SENSOR_CSV, displacement_sd_mm=0.01)
    del tables["specimen"]
    tables["scenario"] = "vowel.toml"
    tables["sensor"] = [{"name": "TT", "model_point": "tip"}]
    tables["registration"] = {"rotation": "fit", "translation": [1, 0, 0], "scale": 1.1}
    return tables, files | {"vowel.toml": ""}


ALL = [indentation, compression, shear, trajectory]


def toml(tables: Tables) -> str:
    """TOML of a dataset: plain keys, then tables, then arrays of tables."""
    lines = [f"{key} = {_value(value)}" for key, value in tables.items() if not _is_table(value)]
    for name, value in tables.items():
        for entry in [value] if isinstance(value, dict) else value if _is_table(value) else []:
            lines += ["", f"[{name}]" if isinstance(value, dict) else f"[[{name}]]"]
            lines += [f"{key} = {_value(inner)}" for key, inner in entry.items()]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and all(isinstance(e, dict) for e in value))


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_value(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value).replace("NaN", "nan").replace("Infinity", "inf")


def write(folder: Path, case: Case) -> Path:
    tables, files = case
    (folder / "dataset.toml").write_text(toml(tables), encoding="utf-8")
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def put(*path: str | int, value: Any = None) -> Callable[[Tables, Files], None]:
    """Sets a key of the tables, or takes it out."""

    def change(tables: Any, files: Files) -> None:
        at = tables
        for key in path[:-1]:
            at = at.setdefault(key, {}) if isinstance(at, dict) else at[key]
        if value is None:
            del at[path[-1]]
        else:
            at[path[-1]] = value

    return change


def csv(old: str, new: str) -> Callable[[Tables, Files], None]:
    """Replaces text of the first curve's file."""

    def change(tables: Tables, files: Files) -> None:
        assert old in files["one.csv"]
        files["one.csv"] = files["one.csv"].replace(old, new)

    return change


def rows(*scales: float) -> Callable[[Tables, Files], None]:
    """Multiplies the columns after time of the first curve."""

    def change(tables: Tables, files: Files) -> None:
        head, *lines = files["one.csv"].splitlines()
        cells = [[float(cell) for cell in line.split(",")] for line in lines]
        scaled = [[row[0], *(scale * cell for scale, cell in zip(scales, row[1:], strict=True))] for row in cells]
        files["one.csv"] = "\n".join([head, *(",".join(map(repr, row)) for row in scaled)])

    return change


def both(*changes: Callable[[Tables, Files], None]) -> Callable[[Tables, Files], None]:
    def change(tables: Tables, files: Files) -> None:
        for one in changes:
            one(tables, files)

    return change


def file(name: str, text: str | None) -> Callable[[Tables, Files], None]:
    def change(tables: Tables, files: Files) -> None:
        files[name] = text
        if text is None:
            del files[name]

    return change


SPLIT = both(put("curve", 0, "split", value="fit"), put("curve", 1, "split", value="holdout"))
TWINS = both(
    put("curve", 1, "specimen"),
    put("curve", 1, "conditions", value={"rate_mm_per_s": 0.51, "digitisation": 2, "source_file": "b"}),
)
T, ONE = "dataset.toml", "one.csv"

BAD = [
    # keys
    ("unknown key", indentation, put("licence", value="x"), [T, "line 8", "licence", 'did you mean "license"?']),
    ("unknown key of specimen", indentation, put("specimen", "radius", value=1.0),
     [T, "line ", '"radius" in [specimen]', 'did you mean "radius_mm"?']),
    ("unknown key of tool", indentation, put("tool", "edge_mm", value=1.0), [T, "[tool]", '"edge_radius_mm"?']),
    ("unknown key of noise", indentation, put("noise", "force_sd", value=1.0), [T, "[noise]", '"force_sd_N"?']),
    ("unknown key of a curve", indentation, put("curve", 1, "groups", value="B"), [T, "line 39", "[curve 2]", '"group"?']),
    ("unknown key that a curve overrides", indentation, put("curve", 1, "specimen", value={"hight_mm": 2.0}),
     [T, "line 37", 'curve "two"', "hight_mm", '"height_mm"?']),
    ("unknown key of a sensor", trajectory, put("sensor", 0, "point", value="tip"), [T, "[sensor.TT]", '"model_point"?']),
    ("unknown key of registration", trajectory, put("registration", "shift", value=[0, 0, 0]), [T, "registration", "shift"]),
    ("other format", indentation, put("format", value="explicitfe-dataset/2"), [T, "line 1", "explicitfe-dataset/1"]),
    ("no format", indentation, put("format"), [T, '"format" is missing']),
    ("name with blanks", indentation, put("name", value="Soft block"), [T, "line 2", "name = 'Soft block'"]),
    ("no test", indentation, put("test"), [T, '"test" is missing']),
    ("other test", indentation, put("test", value="torsion"), [T, "line 4", "torsion", "'indentation'"]),
    ("no curve", indentation, put("curve", value=[]), [T, "curve"]),
    ("curve without file", indentation, put("curve", 1, "file"), [T, "[curve 2]", '"file" is missing']),
    ("curve without id", indentation, put("curve", 0, "id"), [T, "line 28", "[curve 1]", '"id" is missing']),
    ("file in another folder", indentation, put("curve", 0, "file", value="../one.csv"),
     [T, "line ", "../one.csv", "plain name"]),
    ("id of two lines", indentation, put("curve", 0, "id", value="a\nb"), [T, "line 29", "curve 1.id", "plain name"]),
    ("file that is no CSV", indentation, put("curve", 0, "file", value="one.txt"), [T, "one.txt", ".csv"]),
    ("split of another name", indentation, put("curve", 0, "split", value="train"), [T, "curve 1.split", "'fit' or 'holdout'"]),
    ("number as text", indentation, put("specimen", "radius_mm", value="35"), [T, "specimen.radius_mm", "valid number"]),
    ("number without bound", indentation, put("specimen", "radius_mm", value=10**400), [T, "specimen.radius_mm"]),
    ("not a number in a table", indentation, put("tool", "radius_mm", value=float("nan")), [T, "tool.radius_mm"]),
    ("condition that is a table", indentation, put("curve", 0, "conditions", value={"a": {"b": 1}}),
     [T, "conditions", "a must be"]),
    ("condition not finite", indentation, put("curve", 0, "conditions", "x", value=float("inf")), [T, "conditions", "x must be"]),
    ("condition without bound", indentation, put("curve", 0, "conditions", "x", value=[10**400]), [T, "conditions", "64 bits"]),
    ("rate in words", indentation, put("curve", 0, "conditions", "rate_mm_per_s", value="slow"), [T, "rate_mm_per_s = 'slow'"]),
    ("defect without words", indentation, put("curve", 0, "conditions", "defect", value=True), [T, "conditions", "defect"]),
    # shapes
    ("no specimen", indentation, both(put("specimen"), put("curve", 1, "specimen")), [T, "line 4", "[specimen] is missing"]),
    ("specimen without shape", indentation, put("specimen", "shape"), [T, '"shape" is missing in [specimen]']),
    ("cylinder without radius", indentation, put("specimen", value={"shape": "cylinder", "height_mm": 9.0}),
     [T, "specimen", "needs radius_mm"]),
    ("cylinder without height", compression, put("specimen", value={"shape": "cylinder", "radius_mm": 9.0}),
     [T, "line ", "specimen", "needs height_mm"]),
    ("block without size", compression, put("specimen", "shape", value="block"), [T, "specimen", "needs size_mm"]),
    ("block of two sizes", compression, put("specimen", value={"shape": "block", "size_mm": [9, 9]}),
     [T, "size_mm", "[x, y, z]"]),
    ("block with a radius", compression, put("specimen", value={"shape": "block", "size_mm": [9, 9, 9], "radius_mm": 9}),
     [T, "specimen", "no radius_mm"]),
    ("point with a height", compression, put("specimen", "height_mm", value=9.0), [T, "specimen", "no height_mm"]),
    ("point with a layer", compression, put("specimen", "layer_mm", value=1.0), [T, "specimen", "layer"]),
    ("point with a tool", indentation, both(put("specimen", value={"shape": "point"}), put("curve", 1, "specimen")),
     [T, "line 10", "[tool]", "dimensions"]),
    ("sphere without radius", indentation, put("tool", value={"shape": "sphere", "control": "force"}),
     [T, "tool", "needs radius_mm"]),
    ("disc without radius", indentation, put("tool", value={"shape": "bonded-disc", "control": "force"}), [T, "needs radius_mm"]),
    ("platen with a radius", indentation, put("tool", value={"shape": "platen", "control": "force", "radius_mm": 50.0}),
     [T, "line ", "tool", "platen", "no radius_mm"]),
    ("sphere with an edge", indentation, put("tool", "shape", value="sphere"), [T, "tool", "sphere", "no edge_radius_mm"]),
    ("edge rounder than the tool", indentation, put("tool", "edge_radius_mm", value=15.0),
     [T, "edge_radius_mm = 15", "radius_mm = 14"]),
    ("no control", indentation, put("tool", "control"), [T, '"control" is missing in [tool]']),
    ("friction in words", indentation, put("tool", "friction", value="high"),
     [T, "line 21", "tool.friction", "'high'", '"stick"']),
    ("negative friction", indentation, put("tool", "friction", value=-0.1), [T, "tool.friction", "-0.1"]),
    ("friction is no truth", indentation, put("tool", "friction", value=True), [T, "tool.friction", "True"]),
    ("layer thicker than all", indentation, put("specimen", "layer_mm", value=20.0), [T, "specimen", "layer_mm = 20", "20 mm"]),
    ("stiffness of no layer", indentation, put("specimen", "layer_stiffness_ratio", value=3.0),
     [T, "needs the thickness layer_mm"]),
    ("assumed of nothing", indentation, put("specimen", "assumed", value=["radius"]),
     [T, '"radius"', 'did you mean "radius_mm"?']),
    ("assumed but not given", indentation, put("specimen", "assumed", value=["density_kg_m3"]),
     [T, "density_kg_m3", "not in this table"]),
    ("assumed of the tool", indentation, put("tool", "assumed", value=["height_mm"]), [T, "tool", "height_mm"]),
    ("negative noise", indentation, put("noise", "force_sd_N", value=-0.1), [T, "line ", "noise.force_sd_N = -0.1"]),
    ("scatter in percent", indentation, put("noise", "repeat_sd_fraction", value=3), [T, "noise.repeat_sd_fraction = 3"]),
    ("noise of another test", indentation, put("noise", "stress_sd_Pa", value=1.0), [T, "line ", "stress_sd_Pa", "force_sd_N"]),
    ("noise above the values", indentation, put("noise", "force_sd_N", value=1.0), [T, "force_sd_N = 1", "one.csv", "0.1"]),
    ("stretch noise in percent", compression, put("noise", "stretch_sd", value=0.5), [T, "stretch_sd = 0.5", "0.2"]),
    ("noise of one curve", indentation, put("curve", 1, "noise", value={"force_sd_N": 2.0}), [T, "line 39", "two.csv"]),
    # tests
    ("indentation without tool", indentation, put("tool"), [T, "line 4", "needs a [tool]"]),
    ("shear with a tool", shear, put("tool", value=INDENTATION["tool"]), [T, "shear", "[tool]"]),
    ("tool of one curve only", compression, put("curve", 0, "tool", value=INDENTATION["tool"]), [T, "line ", "others none"]),
    ("trajectory with specimen", trajectory, put("specimen", value={"shape": "point"}), [T, "line ", "trajectory", "[specimen]"]),
    ("trajectory with tool", trajectory, put("tool", value=INDENTATION["tool"]), [T, "line ", "trajectory", "[tool]"]),
    ("trajectory with a specimen of one curve", trajectory, put("curve", 1, "specimen", value={"shape": "point"}),
     [T, "line ", "trajectory", "[specimen]"]),
    ("sensors without scenario", trajectory, put("scenario"), [T, "line ", "[sensor]", "scenario"]),
    ("registration without scenario", trajectory, both(put("scenario"), put("sensor")), [T, "[registration]", "scenario"]),
    ("scenario that is missing", trajectory, file("vowel.toml", None), [T, "line ", "vowel.toml", "missing"]),
    ("scenario of another test", indentation, put("scenario", value="a.toml"), [T, "scenario", "trajectory"]),
    ("two sensors of a name", trajectory, put("sensor", value=[{"name": "TT", "model_point": p} for p in "ab"]),
     [T, "two sensors", "TT"]),
    ("no rotation", trajectory, put("registration", "rotation", value=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
     [T, "line ", "registration.rotation", "rotation matrix"]),
    ("rotation of words", trajectory, put("registration", "rotation", value=["a"]), [T, "registration.rotation"]),
    ("translation of two", trajectory, put("registration", "translation", value=[0, 0]),
     [T, "registration.translation", "[x, y, z]"]),
    ("scale of nothing", trajectory, put("registration", "scale", value=0), [T, "registration.scale", "above 0"]),
    # files
    ("two curves of an id", indentation, put("curve", 1, "id", value="one"), [T, "line 35", 'id "one"', "1 and 2"]),
    ("two curves of a file", indentation, put("curve", 1, "file", value="one.csv"), [T, "line 36", 'file "one.csv"', "1 and 2"]),
    ("file that is missing", indentation, file("two.csv", None), [T, "line 36", "two.csv", "missing"]),
    ("file of another name", indentation, put("curve", 1, "file", value="twos.csv"), [T, "twos.csv", 'did you mean "two.csv"?']),
    ("file that is not listed", indentation, file("three.csv", ""), ["three.csv", "remove the file"]),
    # columns
    ("missing column", indentation, csv(",force_N", ""),
     [ONE, "line 1", '"force_N" is missing', "time_s,displacement_mm,force_N"]),
    ("misspelt column", indentation, csv("force_N", "force_n"), [ONE, "line 1", '"force_n"', 'did you mean "force_N"?']),
    ("column in metres", indentation, csv("displacement_mm", "displacement_m"),
     [ONE, "line 1", 'did you mean "displacement_mm"?']),
    ("extra column", indentation, csv("force_N", "force_N,temperature_C"), [ONE, "line 1", "temperature_C"]),
    ("column twice", indentation, csv("displacement_mm", "force_N"), [ONE, "line 1", '"force_N"', "twice"]),
    ("no header", indentation, csv("time_s,displacement_mm,force_N\n", ""), [ONE, "line 1", 'unknown column "0"']),
    ("semicolons", indentation, csv("time_s,displacement_mm,force_N", "time_s;displacement_mm;force_N"),
     [ONE, "line 1", "commas"]),
    ("columns of another test", compression, csv(STRESS_CSV, INDENTATION_CSV),
     [ONE, "line 1", "displacement_mm", "without a [tool]"]),
    ("no sensor", trajectory, both(put("scenario"), put("sensor"), put("registration"), file(ONE, "time_s\n0\n1\n2\n")),
     [ONE, "line 1", "no sensor"]),
    ("sensor of two columns", trajectory, csv("TB_z_mm", "TB_zz_mm"), [ONE, "line 1", "TB_zz_mm", "TB_z_mm"]),
    ("sensor that has no columns", trajectory, put("sensor", 0, "name", value="TR"), [ONE, "line 1", '"TR_x_mm" is missing']),
    # rows
    ("empty file", indentation, file(ONE, "\n\n"), [ONE, "empty"]),
    ("header only", indentation, file(ONE, "time_s,displacement_mm,force_N\n"), [ONE, "line 1", "0 rows", "at least 3"]),
    ("two rows", indentation, file(ONE, "time_s,displacement_mm,force_N\n0,0,0\n1,1,1\n\n"),
     [ONE, "line 3", "2 rows", "at least 3"]),
    ("time from 1", indentation, csv("\n0,0,0", "\n0.5,0,0"), [ONE, "line 2", "time_s starts at 0.5"]),
    ("time from below", indentation, csv("\n0,0,0", "\n-1,0,0"), [ONE, "line 2", "time_s starts at -1"]),
    ("time backwards", indentation, csv("\n4,", "\n1.5,"), [ONE, "line 5", "time_s = 1.5", "backwards"]),
    ("time twice", indentation, csv("\n2,", "\n\n1,"), [ONE, "line 5", "time_s = 1 ", "twice"]),
    ("NaN", indentation, csv("0.04", "nan"), [ONE, "line 3", 'force_N = "nan"']),
    ("infinite", indentation, csv("0.04", "-inf"), [ONE, "line 3", 'force_N = "-inf"']),
    ("too large", indentation, csv("0.04", "1e999"), [ONE, "line 3", 'force_N = "1e999"']),
    ("words", indentation, csv("\n4,0.5", "\n\n4,half"), [ONE, "line 6", 'displacement_mm = "half"']),
    ("underscores", indentation, csv("0.04", "0_4"), [ONE, "line 3", 'force_N = "0_4"']),
    ("comment", indentation, csv("0.04\n", "0.04\n# pause\n"), [ONE, "line 4", "1 cells"]),
    ("empty cell", indentation, csv("0.5,0.04", ",0.04"), [ONE, "line 3", 'displacement_mm = ""']),
    ("short row", indentation, csv("1,0.5,0.04", "1,0.5"), [ONE, "line 3", "2 cells, but 3 columns"]),
    ("long row", indentation, csv("4,0.5,0.03", "4,0.5,0.03,"), [ONE, "line 5", "4 cells, but 3 columns"]),
    ("all rows long", indentation, csv("\n", ",\n"), [ONE, "line 1", 'unknown column ""']),
    ("decimal commas", indentation, file(ONE, "time_s,displacement_mm,force_N\n0,0,0,0,0\n1,0,0,5,1\n2,0,1,0,2\n"),
     [ONE, "line 2", "5 cells"]),
    ("a column that is a book", indentation, csv("force_N", "x" * 9000), [ONE, "line 1", "(9000 characters)", "valid are"]),
    ("a cell that is a book", indentation, csv("0.04", "x" * 9000), [ONE, "line 3", "(9000 characters)"]),
    ("too many rows", indentation,
     file(ONE, "time_s,displacement_mm,force_N\n" + "".join(f"{t},1,1\n" for t in range(10_001))),
     [ONE, "10001 rows", "keep one row in 2"]),
    ("too many bytes", indentation, file(ONE, " " * (16 * 2**20 + 1)), [ONE, "16 MiB"]),
    ("an id that no file can have", indentation, put("curve", 0, "id", value="x" * 300), [T, "line ", "curve 1.id", "100"]),
    # units
    ("radius in m", indentation, put("specimen", "radius_mm", value=0.035), [T, "line ", "specimen.radius_mm", "0.035", "in mm"]),
    ("radius in micrometres", indentation, put("specimen", "radius_mm", value=35000),
     [T, "specimen.radius_mm", "35000", "in mm"]),
    ("height in m, one curve", indentation, put("curve", 1, "specimen", "height_mm", value=0.02),
     [T, "line 37", 'curve "two"', "height_mm"]),
    ("tool in m", indentation, put("tool", "radius_mm", value=0.014), [T, "line ", "tool.radius_mm", "0.014"]),
    ("size in m", compression, put("specimen", value={"shape": "block", "size_mm": [0.03, 0.03, 0.02]}), [T, "specimen.size_mm"]),
    ("layer in m", indentation, put("specimen", "layer_mm", value=0.001), [T, "specimen.layer_mm", "0.001"]),
    ("density in g/cm3", indentation, put("specimen", "density_kg_m3", value=1.04), [T, "specimen.density_kg_m3", "kg/m3"]),
    ("density in g/m3", indentation, put("specimen", "density_kg_m3", value=1.04e6), [T, "specimen.density_kg_m3", "kg/m3"]),
    ("displacement in m", indentation, rows(1e-3, 1), [ONE, "line 4", "displacement_mm is 0.001", "in mm"]),
    ("displacement in micrometres", indentation, rows(1e3, 1), [ONE, "line 4", "displacement_mm = 1000", "deeper", "20 mm"]),
    ("pull in micrometres", indentation, rows(-1e3, 1), [ONE, "line 4", "displacement_mm = -1000", "10 times its height"]),
    ("no displacement", indentation, rows(0, 1), [ONE, "displacement_mm is 0"]),
    ("force in micronewtons", indentation, rows(1, 1e6), [ONE, "line 4", "force_N", "too large"]),
    ("force in MN", indentation, rows(1, 1e-6), [ONE, "line 4", "force_N", "too small"]),
    ("force in kN", indentation, rows(4, 1e-3), [ONE, "line 4", "force_N", "too small"]),
    ("strain for stretch", compression, csv("0,1,0", "0,0,0"), [ONE, "line 2", "stretch = 0", "1 at rest"]),
    ("stretch in percent", compression, rows(100, 1), [ONE, "line 2", "stretch = 100", "percent"]),
    ("shear in percent", shear, rows(100, 1), [ONE, "line 4", "shear_strain = -20", "percent"]),
    ("stress in kPa", compression, rows(1, 1e-3), [ONE, "line 4", "nominal_stress_Pa", "stiffness", "too small", "Pa"]),
    ("stress in MPa", compression, rows(1, 1e-6), [ONE, "line 4", "nominal_stress_Pa is 0.0003", "too small"]),
    ("stress in micropascal", compression, rows(1, 1e9), [ONE, "line 4", "nominal_stress_Pa", "too large"]),
    ("shear stress in MPa", shear, rows(1, 1e-6), [ONE, "line 4", "shear_stress_Pa", "too small"]),
    ("coordinates in m", trajectory, rows(*[1e-3] * 6), [ONE, "line 4", "coordinate", "0.008", "mm"]),
    ("coordinates in micrometres", trajectory, rows(*[1e3] * 6), [ONE, "line 4", "coordinate", "mm"]),
    # splits
    ("held out alone", indentation, both(SPLIT, put("curve", 1, "constants", value="B")), [T, '"two"', '"B"']),
    ("all held out", indentation, both(SPLIT, put("curve", 0, "split", value="holdout")), [T, '"one"', '"all"']),
    ("one measurement on two sides", indentation, both(SPLIT, TWINS), [T, '"one" and "two"', "digitisations"]),
]  # fmt: skip


@pytest.mark.parametrize(("case", "change", "words"), [row[1:] for row in BAD], ids=[row[0] for row in BAD])
def test_bad(case: Callable[[], Case], change: Callable[[Tables, Files], None], words: list[str], tmp_path: Path) -> None:
    tables, files = case()
    change(tables, files)
    refused(write(tmp_path, (tables, files)), words)


def test_files_that_are_none(tmp_path: Path) -> None:
    """What never ends, or waits for somebody, is not opened."""
    folder = write(tmp_path, indentation())
    (folder / ONE).unlink()
    (folder / ONE).symlink_to("/dev/zero")
    refused(folder, [ONE, "missing"])
    (folder / ONE).unlink()
    os.mkfifo(folder / ONE)
    refused(folder, [ONE, "missing"])
    (folder / T).unlink()
    os.mkfifo(folder / T)
    refused(folder, [T, "a pipe"])
    refused(Path("/dev/zero"), ["/dev/zero", "a device"])
    refused(tmp_path / ("x" * 300), ["too long"])


def refused(path: Path, words: list[str]) -> None:
    """Reading ends with one sentence that holds the words."""
    with pytest.raises(InputError) as caught:
        read_dataset(path)
    sentence = str(caught.value)
    assert "\n" not in sentence and sentence.endswith((".", "?")), sentence
    for word in words:
        assert word in sentence, f"{word!r} not in: {sentence}"


@pytest.mark.parametrize("case", ALL)
def test_good(case: Callable[[], Case], tmp_path: Path) -> None:
    """The cases that the bad ones are made from are good, by the folder and by the file."""
    folder = write(tmp_path, case())
    assert [curve.id for curve in read_dataset(folder).curves] == ["one", "two"]
    assert read_dataset(str(folder / "dataset.toml")).path == folder / "dataset.toml"


def test_si_and_overrides(tmp_path: Path) -> None:
    one, two = read_dataset(write(tmp_path, indentation())).curves
    np.testing.assert_allclose(one.displacement_m, [0.0, 5e-4, 1e-3, 5e-4], rtol=1e-15)
    assert one.force_N.tolist() == [0.0, 0.04, 0.1, 0.03] and one.time_s.tolist() == [0.0, 1.0, 2.0, 4.0]
    assert (one.kind, one.imposed, one.predicted) == ("force-displacement", "force_N", "displacement_m")
    assert (one.specimen.height_mm, two.specimen.height_mm, two.specimen.radius_mm) == (20.0, 21.0, 35.0)
    assert two.specimen.assumed == ("radius_mm",) and two.specimen.density_kg_m3 == 1040.0
    assert (one.group, two.group, one.constants, one.split, one.defect) == ("A", "two", "all", None, None)
    assert (one.noise.displacement_sd_mm, one.noise.stress_sd_Pa, one.tool.friction) == (0.0, None, 0.3)


def test_homogeneous_and_shear(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    curve = read_dataset(write(tmp_path / "a", compression())).curves[0]
    assert (curve.tool, curve.imposed, curve.predicted) == (None, "stretch", "nominal_stress_Pa")
    assert curve.columns["stretch"].tolist() == [1.0, 0.9, 0.8]
    assert curve.columns["nominal_stress_Pa"].tolist() == [0.0, -100.0, -300.0]
    (tmp_path / "b").mkdir()
    curve = read_dataset(write(tmp_path / "b", shear())).curves[0]
    assert sd_of(curve, "shear_strain") == 0.002 and sd_of(curve, "shear_stress_Pa") == 1.0
    assert curve.columns["shear_strain"].tolist() == [0.0, 0.1, -0.2]
    assert curve.columns["shear_stress_Pa"].tolist() == [0.0, 50.0, -100.0]


def test_trajectory(tmp_path: Path) -> None:
    data = read_dataset(write(tmp_path, trajectory()))
    assert {name: sensor.point for name, sensor in data.sensors.items()} == {
        "TT": "tip"
    } and data.scenario == tmp_path / "vowel.toml"
    assert (data.registration.rotation, data.registration.translation, data.registration.scale) == ("fit", (1.0, 0.0, 0.0), 1.1)
    np.testing.assert_allclose(data.curves[0].sensors["TB"][2], [4e-3, 5e-3, 8e-3], rtol=1e-15)
    assert list(data.curves[0].sensors) == ["TT", "TB"] and not data.curves[0].columns


def test_registration_by_numbers(tmp_path: Path) -> None:
    tables, files = trajectory()
    turned = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    tables["registration"] = {"rotation": turned, "scale": "fit", "translation": "fit"}
    registration = read_dataset(write(tmp_path, (tables, files))).registration
    assert np.array_equal(registration.rotation, turned) and (registration.scale, registration.translation) == ("fit", "fit")


def _as(text: str, encoding: str = "utf-8") -> bytes:
    return text.encode(encoding)


SPELLINGS = {
    "windows line ends": _as(INDENTATION_CSV.replace("\n", "\r\n")),
    "old line ends": _as(INDENTATION_CSV.replace("\n", "\r")),
    "byte-order mark": _as(INDENTATION_CSV, "utf-8-sig"),
    "trailing blank lines": _as(INDENTATION_CSV + "\n \n\n"),
    "no last line end": _as(INDENTATION_CSV.rstrip()),
    "blanks after commas": _as(INDENTATION_CSV.replace(",", ", ")),
    "quoted header": _as(INDENTATION_CSV.replace("force_N", '"force_N"')),
    "other order": b"force_N,time_s,displacement_mm\n0,0,0\n0.04,1,0.5\n0.1,2,1\n0.03,4,0.5\n",
    "exponents and signs": b"time_s,displacement_mm,force_N\n0e0,+0,-0.\n1,.5,4e-2\n2,1E0,1.0e-01\n4,0.5,3E-2\n",
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spellings_that_are_read(spelling: str, tmp_path: Path) -> None:
    folder = write(tmp_path, indentation())
    (folder / ONE).write_bytes(SPELLINGS[spelling])
    curve, other = read_dataset(folder).curves
    assert np.array_equal(curve.force_N, other.force_N) and np.array_equal(curve.displacement_m, other.displacement_m)
    text = (folder / T).read_bytes()
    (folder / T).write_bytes(b"\xef\xbb\xbf" + text.replace(b"\n", b"\r\n"))
    assert len(read_dataset(folder).curves) == 2


@pytest.mark.parametrize("name", [T, ONE])
def test_text_that_is_not_utf8(name: str, tmp_path: Path) -> None:
    folder = write(tmp_path, indentation())
    text = (folder / name).read_text()
    (folder / name).write_bytes(text.encode() + "µ".encode("latin-1"))
    refused(folder, [name, f"line {text.count(chr(10)) + 1}", "not UTF-8"])
    (folder / name).write_bytes(text.encode("utf-16"))
    refused(folder, [name, "line 1", "not UTF-8"])


def test_no_dataset_there(tmp_path: Path) -> None:
    refused(tmp_path, [T, "cannot be read", "CSV"])
    refused(tmp_path / "none", ["none", "cannot be read"])
    write(tmp_path, indentation())
    (tmp_path / T).write_text("name = \n")
    refused(tmp_path, [T, "not valid TOML", "line 1"])


SMALL_BUT_RIGHT = [
    ("soft, 0.1 N at 1 mm", put("curve", 0, "split", value="fit"), lambda d, f: None),
    ("a fine tip in a high block", put("tool", value={"shape": "sphere", "radius_mm": 1.0, "control": "displacement"}),
     rows(0.02, 1e-4)),
    ("one percent of the height", put("tool", value={"shape": "platen", "control": "displacement"}), rows(0.2, 1)),
    ("a pull", put("tool", value={"shape": "bonded-disc", "radius_mm": 10.0, "control": "displacement"}), rows(-5, -1)),
    ("almost through", put("curve", 0, "id", value="one.a"), rows(19.9, 100)),
]  # fmt: skip


@pytest.mark.parametrize(("change", "scale"), [row[1:] for row in SMALL_BUT_RIGHT], ids=[row[0] for row in SMALL_BUT_RIGHT])
def test_no_false_alarm(change: Callable[..., None], scale: Callable[..., None], tmp_path: Path) -> None:
    tables, files = indentation()
    tables["noise"] = {}
    change(tables, files)
    scale(tables, files)
    files["two.csv"] = files["one.csv"]
    assert len(read_dataset(write(tmp_path, (tables, files))).curves) == 2


def test_stretch_held_at_rest_is_no_fault(tmp_path: Path) -> None:
    tables, files = compression()
    files["one.csv"] = "time_s,stretch,nominal_stress_Pa\n0,1,0\n1,1,50\n2,1,100\n"
    assert len(read_dataset(write(tmp_path, (tables, files))).curves) == 2


def test_another_shape_brings_its_own_dimensions(tmp_path: Path) -> None:
    tables, files = indentation()
    tables["curve"][1]["specimen"] = {"shape": "block", "size_mm": [50, 40, 30]}
    tables["curve"][1]["tool"] = {"shape": "platen", "friction": "stick"}
    one, two = read_dataset(write(tmp_path, (tables, files))).curves
    assert (two.specimen.radius_mm, two.specimen.assumed, two.specimen.thickness_mm) == (None, (), 30.0)
    assert (two.specimen.face_mm2, two.tool.radius_mm, two.tool.control, two.tool.friction) == (2000.0, None, "force", "stick")
    assert one.specimen.radius_mm == 35.0


def test_same_measurement(tmp_path: Path) -> None:
    tables, files = indentation()
    TWINS(tables, files)
    one, two = read_dataset(write(tmp_path, (tables, files))).curves
    assert same_measurement(one, two)
    for conditions in ({"rate_mm_per_s": 1.0, "digitisation": 2}, {"rate_mm_per_s": 0.5}, {"digitisation": 2}):
        tables["curve"][1]["conditions"] = conditions
        one, two = read_dataset(write(tmp_path, (tables, files))).curves
        assert same_measurement(one, two) == (conditions == {"rate_mm_per_s": 0.5})
    tables["curve"][1] |= {"group": "B", "conditions": {"rate_mm_per_s": 0.5, "digitisation": 2}}
    assert not same_measurement(*read_dataset(write(tmp_path, (tables, files))).curves)


def test_regrouping(tmp_path: Path) -> None:
    tables, files = indentation()
    data = read_dataset(write(tmp_path, (tables, files)))
    assert list(data.regrouped("group").constants_groups()) == ["A", "two"]
    assert list(data.regrouped("rate_mm_per_s").constants_groups()) == ["0.5", "5"]
    assert list(data.constants_groups()) == ["all"], "the dataset itself stays as it is"
    with pytest.raises(InputError, match=r'dataset\.toml: .*"repeat".*curve "one".*valid are: group, rate_mm_per_s\.'):
        data.regrouped("repeat")
    with pytest.raises(InputError, match=r'"groups".*did you mean "group"'):
        data.regrouped("groups")
    SPLIT(tables, files)
    with pytest.raises(InputError, match='"two" is held out'):
        read_dataset(write(tmp_path, (tables, files))).regrouped("group")


# Fuzzing ---------------------------------------------------------------------------------------------------------------------

ODD = [-1, 0, 1e-3, 1e6, 1e300, 10**30, float("nan"), float("inf"), "", "x", "stick", "fit", True, [], [1, 2, 3],
       ["radius_mm"], {}, {"shape": "block"}, [[1]], [{}], "point", "platen", "../a", "é"]  # fmt: skip
CELLS = ["", "nan", "-inf", "x", "1e400", "-1", "0", "1e9", "1e-9", '"', "0x10", "1_0", "\x00", "é", "1,2", "1\n", "#", "١"]


@pytest.mark.parametrize("case", ALL)
def test_fuzz(case: Callable[[], Case], tmp_path: Path) -> None:
    """Whatever key or cell is dropped or altered, reading works or ends with an InputError of one sentence."""
    rng = np.random.default_rng(7)
    refusals = 0
    for _ in range(250):
        tables, files = case()
        for _ in range(rng.integers(1, 3)):
            if rng.random() < 0.6:
                _alter_key(tables, rng)
            else:
                files[ONE] = _alter_cell(files[ONE], rng)
        folder = write(tmp_path, (tables, files))
        if rng.random() < 0.2:
            _alter_bytes(folder / (T if rng.random() < 0.5 else ONE), rng)
        try:
            data = read_dataset(folder)
        except InputError as error:
            refusals += 1
            assert re.search(r"dataset\.toml|one\.csv|two\.csv", str(error)) and "\n" not in str(error), str(error)
        else:
            assert all(np.isfinite(array).all() for curve in data.curves for array in [curve.time_s, *curve.columns.values()])
            assert not any(np.isinf(array).any() for curve in data.curves for array in curve.sensors.values())
    assert 100 < refusals < 250


def _alter_key(tables: Tables, rng: np.random.Generator) -> None:
    places: list[tuple[Any, Any]] = []

    def walk(at: Any) -> None:
        for key in list(at) if isinstance(at, dict) else range(len(at)):
            places.append((at, key))
            if isinstance(at[key], dict | list):
                walk(at[key])

    walk(tables)
    at, key = places[rng.integers(len(places))]
    draw = rng.random()
    if draw < 0.3:
        del at[key]
    elif draw < 0.5 and isinstance(at, dict):
        at[f"{key}s"] = at.pop(key)
    else:
        at[key] = deepcopy(ODD[rng.integers(len(ODD))])


def _alter_cell(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    row = rng.integers(len(lines))
    cells = lines[row].split(",")
    column = rng.integers(len(cells))
    if rng.random() < 0.3:
        del cells[column]
    else:
        cells[column] = CELLS[rng.integers(len(CELLS))]
    lines[row] = ",".join(cells)
    if rng.random() < 0.2:
        del lines[rng.integers(len(lines))]
    return "\n".join(lines)


def _alter_bytes(path: Path, rng: np.random.Generator) -> None:
    raw = bytearray(path.read_bytes())
    for _ in range(3):
        raw[rng.integers(len(raw))] = rng.integers(256)
    path.write_bytes(bytes(raw))


# Real measurements -----------------------------------------------------------------------------------------------------------

real = needs(MEASURED)


def of(data: Dataset, name: str) -> Curve:
    return next(curve for curve in data.curves if curve.id == name)


@real
def test_ecoflex() -> None:
    data = read_dataset(MEASURED / "ecoflex-compression-a")
    assert len(data.curves) == 20 and {len(group) for group in data.constants_groups().values()} == {4}
    curve = of(data, "ef50-0t-b5")
    assert len(curve.time_s) == 1202 and curve.time_s[-1] == 120.021
    assert curve.force_N[0] == 0.01153 and curve.force_N[-1] == 1192.11304
    assert curve.displacement_m[-1] == pytest.approx(0.02000002, rel=1e-12)
    assert (curve.specimen.face_mm2, curve.noise.force_sd_N) == (pytest.approx(1963.495, rel=1e-6), 0.02)


@real
def test_muscle_by_direction() -> None:
    data = read_dataset(MEASURED / "muscle-compression")
    assert len(data.curves) == 12 and list(data.constants_groups()) == ["all"]
    curve = of(data, "fibre-max-0.3-rate-0.05")
    assert (curve.columns["stretch"][0], curve.columns["nominal_stress_Pa"][0]) == (1.0, 0.0)
    last = (curve.time_s[-1], curve.columns["stretch"][-1], curve.columns["nominal_stress_Pa"][-1])
    assert last == (301.608232, 0.7, -896.212625)
    by_direction = data.regrouped("direction").constants_groups()
    assert {name: len(curves) for name, curves in by_direction.items()} == {"cross-fibre": 6, "fibre": 6}
    assert data.regrouped("group").constants_groups().keys() == by_direction.keys()
    twice = {frozenset((a.id, b.id)) for a in data.curves for b in data.curves if same_measurement(a, b)}
    digitised = [f"{direction}-max-0.3-rate-0.01" for direction in ("fibre", "cross-fibre")]
    assert twice == {frozenset((name, f"{name}-digit2")) for name in digitised}


@real
def test_silicone() -> None:
    data = read_dataset(MEASURED / "silicone-indentation")
    assert len(data.curves) == 21
    assert {name: len(curves) for name, curves in data.constants_groups().items()} == {"P002": 18, "P011": 3}
    assert [curve.id for curve in data.curves if curve.defect] == ["p002-cycle-7"]
    curve = of(data, "p002-laser-2")
    assert (curve.specimen.height_mm, curve.time_s[-1]) == (30.967, 40.2)
    assert (curve.force_N[0], curve.force_N[-1]) == (0.00667376816, 0.36518359)
    assert curve.displacement_m[-1] == pytest.approx(5.00000054e-3, rel=1e-12)


@real
def test_tongue_sensors() -> None:
    data = read_dataset(MEASURED / "tongue-ema-haskins")
    assert len(data.curves) == 2 and data.scenario is None
    sensors = of(data, "f01-b01-s01-r01-n").sensors
    assert list(sensors) == ["TR", "TB", "TT", "UL", "LL", "ML", "JAW", "JAWL"]
    assert sensors["TR"].shape == (262, 3) and sensors["TR"][0, 0] == pytest.approx(-45.724556e-3, rel=1e-12)
    assert sensors["JAWL"][-1, 2] == pytest.approx(-19.2018414e-3, rel=1e-12)


def test_reading_is_fast(tmp_path: Path) -> None:
    """20 curves of 1 200 rows take far less than half a second; the best of three, for the machine may be busy."""
    tables, _ = indentation()
    times = np.arange(1200.0)
    text = "time_s,displacement_mm,force_N\n" + "".join(f"{t},{0.01 * t + 1e-7:.9g},{0.001 * t:.9g}\n" for t in times)
    tables["curve"] = [{"id": f"c{k}", "file": f"c{k}.csv"} for k in range(20)]
    folder = write(tmp_path, (tables, {f"c{k}.csv": text for k in range(20)}))
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        read_dataset(folder)
        taken.append(time.perf_counter() - start)
    assert min(taken) < 0.5
