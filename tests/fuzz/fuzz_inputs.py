"""Eight kinds of input, each from small valid ones that are spoilt: files of a folder, and the command that reads them."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import meshio
from command import command
from fuzz_changes import ABSURD_NUMBERS, ABSURD_STRINGS, changed_bytes, changed_columns, changed_tables, toml, value_of
from hypothesis import strategies as st
from support import block_mesh


@dataclass(frozen=True)
class FuzzInput:
    """Files of a folder (name -> bytes), and the arguments of the command that is called in it; it writes into ``out`` alone."""

    kind: str
    files: dict[str, bytes]
    arguments: tuple[str, ...]


# ---- scenarios ----

TONGUE = {
    "title": "a",
    "model": {"name": "tongue", "cells": [8, 4, 4]},
    "muscle": [{"name": "GGp", "force_N": 1.0, "profile": "ramp", "rise_ms": 0.5}, {"name": "SL", "force_N": 0.5}],
    "analysis": {"type": "transient", "duration_ms": 1.0},
    "record": {"every_ms": 0.5},
}
# Only what needs no other machine code: that would be compiled for a minute.
MORE_OF_A_TONGUE = {
    "model.damping": {"alpha_per_s": 40.0},
    "model.gravity_m_s2": [0.0, 0.0, -9.81],
    "model.material": {"C10_Pa": 1037.0, "C20_Pa": 486.0},
    "model.fixed": ["jaw"],
    "model.attachment": "area",
    "model.resolution": "coarse",
    "muscle": [{"name": "HG", "force_N": 1.0, "profile": "table", "table": [[0.0, 0.0], [1.0, 1.0]], "side": "left"}],
    "bone": [{"name": "palate"}],
    "jaw": {"opening_deg": 2.0},
    "hyoid": {"stiffness_N_per_mm": 1.0},
    "resection": [{"box_mm": [[0, 0, 0], [10, 10, 10]]}],
    "scar": {"thickness_mm": 2.0, "stiffness_ratio": 3.0},
    "lips": {"area_mm2": 80.0, "length_mm": 10.0},
    "analysis.step_us": 10.0,
    "analysis.threads": 1,
    "record.fields": ["displacement"],
    "record.probes": ["tip"],
    "question": "?",
}
BLOCK_UNDER_A_BALL = {
    "title": "b",
    "model": {"name": "specimen", "symmetry": "sector", "radius_mm": 20.0, "height_mm": 10.0, "refinement": 0.4},
    "tool": {"shape": "sphere", "radius_mm": 4.0},
    "analysis": {"type": "relaxation", "displacements_mm": [0.5, 1.0]},
}
MORE_OF_A_BLOCK = {
    "model.material": {"C10_Pa": 2000.0, "C20_Pa": 0.0, "poisson": 0.45, "density_kg_m3": 1070.0},
    "model.layer_mm": 1.0,
    "model.layer_stiffness_ratio": 3.0,
    "model.base": "sliding",
    "model.edge_size_mm": 2.0,
    "model.gravity_m_s2": [0.0, 0.0, -9.81],
    "tool.shape": "flat-cylinder",
    "tool.edge_radius_mm": 1.0,
    "analysis.forces_N": [0.01, 0.02],
    "analysis.times_s": [1.0, 2.0],
    "analysis.tolerance": 1e-3,
}
LOOKS = [
    ("check", "run.toml"),
    ("check", "run.toml", "--json"),
    ("run", "run.toml", "--out", "out"),
    ("run", "run.toml", "--out", "out", "--json"),
]
runs_or_checks = st.sampled_from([*LOOKS, *LOOKS[2:]])


@st.composite
def scenarios(draw: st.DrawFn) -> FuzzInput:
    tables, more = draw(
        st.sampled_from([(TONGUE, MORE_OF_A_TONGUE), (TONGUE, MORE_OF_A_TONGUE), (BLOCK_UNDER_A_BALL, MORE_OF_A_BLOCK)])
    )
    raw = toml(draw(changed_tables(tables, more))).encode()
    if draw(st.integers(0, 3)) == 0:
        raw = draw(changed_bytes(raw))
    return FuzzInput("scenarios", {"run.toml": raw}, draw(runs_or_checks))


# ---- --set ----

KEYS = [
    "model.cells", "model.material.C10_Pa", "model.damping.alpha_per_s", "model.gravity_m_s2", "model",
    "muscle.GGp.force_N", "muscle.0", "muscle.+", "muscle.SL.rise_ms", "muscle.-1", "muscle", "analysis.duration_ms",
    "analysis.step_us", "analysis.threads", "analysis.type", "record.every_ms", "record.fields", "record.probes",
    "title", "question", "bone.+", "effects", "a.b.c", "", ".", "model..cells", "model.cells.0", "title.x",
    "muscle.GGp.table", "x" * 5000, ".".join("a" * 2000),
]  # fmt: skip


POSSIBLE = [
    "model.cells=[8, 4, 4]", "muscle.GGp.force_N=0.5", "muscle.SL.force_N=2", "analysis.duration_ms=0.5", "record.every_ms=0.25",
    'muscle.+={name="HG", force_N=1}', "model.damping.alpha_per_s=40", "title=mine", 'record.probes=["tip"]',
]  # fmt: skip


@st.composite
def settings_of_a_scenario(draw: st.DrawFn) -> FuzzInput:
    arguments = list(draw(runs_or_checks))
    for _ in range(draw(st.integers(1, 3))):
        if draw(st.booleans()):
            arguments += ["--set", draw(st.sampled_from(POSSIBLE))]
            continue
        value = draw(
            st.sampled_from([value_of(v) for v in ABSURD_NUMBERS])
            | st.sampled_from([s.replace("\0", "") for s in ABSURD_STRINGS])
            | st.sampled_from(['{name="GGp"}', '[{name="GGp", force_N=1}]', "[1,", "[" * 5000, "1979-05-27", '"', "'", "1 # no"])
            | st.floats().map(repr)
            | st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20)
        )
        arguments += [
            "--set",
            draw(st.sampled_from(["{}={}", "{} = {}", "{}{}", "={}{}"])).format(draw(st.sampled_from(KEYS)), value),
        ]
    return FuzzInput("settings", {"run.toml": toml(TONGUE).encode()}, tuple(arguments))


# ---- meshes of one's own ----

OWN = {
    "title": "own",
    "model": {"file": "block.toml"},
    "muscle": [{"name": "TOP", "force_N": 1e-3}],
    "analysis": {"duration_ms": 1.0},
}
BLOCK: dict[str, Any] = {
    "mesh": "block.vtk",
    "length_unit": "m",
    "fixed": ["base"],
    "node_sets": {"base": [0, 1, 2, 3, 4, 5]},
    "named_points": {"corner": 0, "tip": 26},
    "muscle": [{"name": "TOP", "max_force_N": 1.0, "fibre": [{"side": "left", "nodes": [0, 9, 18]}]}],
}
MORE_OF_A_MESH = {
    "length_unit": "mm",
    "first_number": 1,
    "node_sets": {"base": {"point_data": "wall", "value": 1.0}},
    "named_points": {"a/b": 1},
    "muscle": [{"name": "TOP", "fibre": [{"side": "left", "points": [[0, 0, 0], [0, 0, 0.01]], "anchor": [0, 0, -1]}]}],
    "title": "x",
}
MESH_FORMATS = {"vtk": {"binary": False}, "vtu": {"binary": False}, "msh": {"file_format": "gmsh22", "binary": False}, "inp": {}}


@cache
def mesh_text(ending: str) -> bytes:
    """A block of eight hexes in a format of meshio's."""
    mesh = block_mesh((2, 2, 2), 0.005, distort=0.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"block.{ending}"
        meshio.write(path, meshio.Mesh(mesh.points, [("hexahedron", mesh.hexes)]), **MESH_FORMATS[ending])
        return path.read_bytes()


@st.composite
def own_meshes(draw: st.DrawFn) -> FuzzInput:
    ending = draw(st.sampled_from(sorted(MESH_FORMATS)))
    raw, scenario = mesh_text(ending), OWN
    tables = BLOCK | {"mesh": f"block.{ending}"}
    which = draw(st.integers(0, 3))
    if which < 2:
        raw = draw(changed_bytes(raw))
    elif which == 2:
        tables = draw(changed_tables(tables, MORE_OF_A_MESH))
    else:
        scenario = draw(changed_tables(scenario, {"model.fixed": [], "model.cells": [8, 4, 4], "record.probes": ["tip"]}))
    files = {"run.toml": toml(scenario).encode(), "block.toml": toml(tables).encode(), f"block.{ending}": raw}
    return FuzzInput("own meshes", files, draw(runs_or_checks))


# ---- datasets ----

COMPRESSION: dict[str, Any] = {
    "format": "explicitfe-dataset/1",
    "name": "made",
    "title": "Made",
    "test": "compression",
    "specimen": {"shape": "point"},
    "noise": {"stress_sd_Pa": 1.0},
    "curve": [{"id": "one", "file": "one.csv"}, {"id": "two", "file": "two.csv", "conditions": {"rate_per_s": 0.1, "repeat": 2}}],
}
BETWEEN_PLATENS = COMPRESSION | {
    "specimen": {"shape": "cylinder", "radius_mm": 10.0, "height_mm": 20.0, "base": "frictionless"},
    "tool": {"shape": "platen", "control": "displacement", "friction": 0.0},
    "noise": {"force_sd_N": 0.01},
}
SHEAR = COMPRESSION | {"test": "shear"}
TIMES = (0.0, 1.0, 2.0, 3.0, 4.0)
ROWS = {
    "stretch,nominal_stress_Pa": [(1.0, 0.0), (0.95, -60.0), (0.9, -130.0), (0.85, -210.0), (0.8, -310.0)],
    "displacement_mm,force_N": [(0.0, 0.0), (1.0, 0.02), (2.0, 0.04), (3.0, 0.07), (4.0, 0.1)],
    "shear_strain,shear_stress_Pa": [(0.0, 0.0), (0.1, 40.0), (0.2, 80.0), (0.3, 125.0), (0.4, 175.0)],
}
MORE_OF_A_DATASET = {
    "specimen.density_kg_m3": 1000.0,
    "specimen.assumed": ["shape"],
    "tool": {"shape": "sphere", "radius_mm": 5.0, "control": "force"},
    "noise": {"stress_sd_Pa": 0.0, "stretch_sd": 0.0, "repeat_sd_fraction": 0.1},
    "scenario": "x.toml",
    "sensor": [{"name": "TT", "model_point": "tip"}],
    "test": "tension",
    "curve": [],
    "source": "x",
}
TISSUE = {"format": "explicitfe-model/1", "poisson": 0.499, "constants": {"C10_Pa": 200.0, "C20_Pa": 90.0}}
SAMPLES = [
    (COMPRESSION, "stretch,nominal_stress_Pa"),
    (SHEAR, "shear_strain,shear_stress_Pa"),
    (BETWEEN_PLATENS, "displacement_mm,force_N"),
]
PREDICT = ("predict", ".", "--model", "model.toml", "--out", "out")


def columns(header: str) -> list[list[str]]:
    """Rows of cells of a curve, the header first."""
    return [
        ["time_s", *header.split(",")],
        *([f"{t:g}", f"{x:g}", f"{y:g}"] for t, (x, y) in zip(TIMES, ROWS[header], strict=True)),
    ]


def dataset_files(tables: dict[str, Any], header: str) -> dict[str, bytes]:
    """The files of a dataset of two equal curves."""
    text = "\n".join(",".join(row) for row in columns(header)).encode() + b"\n"
    return {"dataset.toml": toml(tables).encode(), "one.csv": text, "two.csv": text}


@st.composite
def datasets(draw: st.DrawFn) -> FuzzInput:
    tables, header = draw(st.sampled_from(SAMPLES))
    files = dataset_files(tables, header) | {"model.toml": toml(TISSUE).encode()}
    which = draw(st.integers(0, 3))
    if which == 0:
        files["dataset.toml"] = toml(draw(changed_tables(tables, MORE_OF_A_DATASET))).encode()
    elif which == 1:
        files["dataset.toml"] = draw(changed_bytes(files["dataset.toml"]))
    elif which == 2:
        files["one.csv"] = draw(changed_columns(columns(header)))
    else:
        files["one.csv"] = draw(changed_bytes(files["one.csv"]))
    # What fits constants takes seconds where the dataset is sound.
    others = [("identify", "."), ("close-loop", ".", "--out", "out", "--max-effects", "0"), ("identify", ".", "--out", "out")]
    return FuzzInput("datasets", files, draw(st.sampled_from([PREDICT] * 20 + [(*PREDICT, "--json")] * 6 + others)))


# ---- model files ----

MORE_OF_A_TISSUE = {
    "effects": {"viscoelastic": {"g": [0.3], "tau_s": [1.0]}},
    "effects.force-offset": {"offset_N": 0.01},
    "effects.compressible": {"poisson": 0.45},
    "effects.friction": {"coefficient": 0.1},
    "constants_by": "group",
    "constants": {"all": {"C10_Pa": 200.0}},
    "specimen": {"density_kg_m3": 900.0},
    "tool": {"friction": 0.5},
    "numerics": {"refinement": 2.0, "density": 0.5, "tolerance": 1e-3},
    "title": "x",
}


@st.composite
def model_files(draw: st.DrawFn) -> FuzzInput:
    raw = toml(draw(changed_tables(TISSUE, MORE_OF_A_TISSUE))).encode()
    if draw(st.integers(0, 3)) == 0:
        raw = draw(changed_bytes(raw))
    if draw(st.booleans()):
        tables, header = draw(st.sampled_from(SAMPLES))
        return FuzzInput("model files", dataset_files(tables, header) | {"model.toml": raw}, PREDICT)
    arguments = (*draw(runs_or_checks), "--tissue", "model.toml")
    return FuzzInput("model files", {"run.toml": toml(TONGUE).encode(), "model.toml": raw}, arguments)


# ---- protocols ----

PROTOCOL: dict[str, Any] = {
    "format": "explicitfe-protocol/1",
    "title": "a",
    "test": "compression",
    "constants": {"C10_Pa": 200.0, "C20_Pa": 90.0},
    "specimen": {"shape": "point"},
    "noise": {"stress_sd_Pa": 1.0},
    "curve": [{"id": "one", "programme": [[0.0, 1.0], [1.0, 0.9], [2.0, 0.8], [10.0, 0.8]], "rows": 12}],
}
MORE_OF_A_PROTOCOL = {
    "test": "shear",
    "noise": {"stress_sd_Pa": 0.0, "repeat_sd_fraction": 0.05},
    "curve": [{"id": "one", "programme": [[0, 1], [1, 0.9], [2, 1]]}, {"id": "two", "programme": [[0, 1], [1, 0.8], [2, 1]]}],
    "tool": {"shape": "platen", "control": "displacement"},
    "specimen": {"shape": "cylinder", "radius_mm": 10.0, "height_mm": 20.0},
}


@st.composite
def protocols(draw: st.DrawFn) -> FuzzInput:
    raw = toml(draw(changed_tables(PROTOCOL, MORE_OF_A_PROTOCOL))).encode()
    if draw(st.integers(0, 3)) == 0:
        raw = draw(changed_bytes(raw))
    json = ("--json",) if draw(st.booleans()) else ()
    return FuzzInput("protocols", {"protocol.toml": raw}, ("design-test", "protocol.toml", *json))


# ---- result files ----


@cache
def result_bytes() -> bytes:
    """A finished run of a small tongue."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.toml"
        path.write_text(toml(TONGUE), encoding="utf-8")
        assert command(["run", str(path), "--out", folder, "--json"]) == 0
        return (Path(folder) / "run.vtkhdf").read_bytes()


@st.composite
def result_files(draw: st.DrawFn) -> FuzzInput:
    raw = bytearray(result_bytes())
    # Most bytes are fields; what tells where they are stands at the beginning and in blocks between them.
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.integers(0, len(raw) - 1) | st.integers(0, 4096))
        what = draw(st.sampled_from(["flip", "zeros", "cut", "ones", "append"]))
        if what == "flip":
            raw[place] ^= 1 << draw(st.integers(0, 7))
        elif what == "cut":
            del raw[place:]
            break
        elif what == "append":
            raw += draw(st.binary(max_size=16))
        else:
            raw[place : place + 64] = (b"\0" if what == "zeros" else b"\xff") * len(raw[place : place + 64])
    arguments = draw(
        st.sampled_from(
            [
                ("inspect", "a.vtkhdf"),
                ("inspect", "a.vtkhdf", "--json"),
                ("measure", "a.vtkhdf"),
                ("measure", "a.vtkhdf", "--json"),
            ]
        )
    )
    return FuzzInput("result files", {"a.vtkhdf": bytes(raw)}, arguments)


# ---- options ----

WORDS = [
    *[s.replace("\0", "") for s in ABSURD_STRINGS], "one", "two", "group", "id=one", "id=", "=one", "id=three",
    "repeat=2", "viscoelastic", "viscoelastik", "homogeneous", "indentation", "indentations", "least-squares", "paper",
    "dataset.toml", "run.toml", "model.toml", "out", "none", "one.csv", "repeat", "rate_per_s",
]  # fmt: skip
NUMBERS = [
    "-1",
    "0",
    "1",
    "-5",
    "3",
    "1e9",
    "1000000000",
    "9" * 400,
    "nan",
    "inf",
    "-inf",
    "1.5",
    "1e-300",
    "1e300",
    "0.5",
    "x",
    "",
    "2",
]
words, numbers = st.sampled_from(WORDS), st.sampled_from(NUMBERS)
OPTIONS: dict[str, tuple[tuple[str, ...], dict[str, st.SearchStrategy[str]]]] = {
    "identify": (
        (".",),
        {
            "--method": words,
            "--fit": words,
            "--constants-by": words,
            "--poisson": numbers,
            "--refinement": numbers,
            "--out": words,
        },
    ),
    "predict": ((".", "--model", "model.toml"), {"--curve": words, "--refinement": numbers, "--out": words, "--model": words}),
    "close-loop": (
        (".", "--max-effects", "0", "--effects", "force-offset"),
        {
            "--holdout": words,
            "--constants-by": words,
            "--effects": words,
            "--max-effects": st.sampled_from(["-5", "-1", "x", "", "nan"]),
            "--out": words,
        },
    ),
    "design-test": ((), {"": words}),
    "run": (
        ("run.toml",),
        {"--tissue": words, "--tissue-group": words, "--out": words, "--set": words, "--overwrite": st.just("")},
    ),
    "check": (("run.toml",), {"--tissue": words, "--tissue-group": words, "--set": words}),
    "inspect": ((), {"": words}),
    "measure": ((), {"": words, "--at-ms": numbers}),
    "list": ((), {"": words}),
    "bench": (("--elements", "7"), {"--elements": st.sampled_from(["-1", "0", "x", "9" * 400])}),
}


@st.composite
def options(draw: st.DrawFn) -> FuzzInput:
    name = draw(st.sampled_from(sorted(OPTIONS)))
    usual, possible = OPTIONS[name]
    arguments = [*name.split(), *usual]
    for _ in range(draw(st.integers(1, 2))):
        option = draw(st.sampled_from(sorted(possible)))
        value = draw(possible[option])
        if option == "--out":
            value = f"out/{value}"  # Wherever the user says, it is written: say no more than a name in the folder.
        arguments += [option, value] if option and option != "--overwrite" else [option or value]
    files = dataset_files(COMPRESSION, "stretch,nominal_stress_Pa") | {
        "model.toml": toml(TISSUE).encode(),
        "run.toml": toml(TONGUE).encode(),
    }
    return FuzzInput("options", files, tuple(arguments))


KINDS = {
    "scenarios": scenarios(),
    "settings": settings_of_a_scenario(),
    "own meshes": own_meshes(),
    "datasets": datasets(),
    "model files": model_files(),
    "protocols": protocols(),
    "options": options(),
    "result files": result_files(),
}
