"""Datasets that the tests of the identification make, small enough to be quick."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from explicitfe.inverse.identify.forward import FIRST_Q, ToolResponse
from explicitfe.inverse.predict.setup import Setup

COARSE = 0.6  # refinement
TRUTH = (190.0, 87.0)
LOADS_N = np.array([0.1, 0.3, 0.5, 0.7])
DEEPEST_M = 6.5e-3


def setup(refinement: float = COARSE, symmetry: str = "sector", **tool) -> Setup:
    """The paper's test, on a coarse mesh."""
    body = {"symmetry": symmetry, "radius_mm": 35.0, "height_mm": 20.0, "base": "bonded", "refinement": refinement}
    return Setup(
        body, {"shape": "flat-cylinder", "radius_mm": 14.0, "edge_radius_mm": 2.0, "friction": 0.0} | tool, 0.499, 1040.0
    )


@cache
def response() -> ToolResponse:
    """Of the paper's test, near the paper's constants."""
    tool_response = ToolResponse(setup(), DEEPEST_M)
    tool_response.add([*FIRST_Q, 0.2])
    return tool_response


HEAD = """format = "explicitfe-dataset/1"
name = "made"
title = "Made by the simulator"
test = "{test}"

[specimen]
{specimen}

{tool}
[noise]
{noise}
"""
CYLINDER = 'shape = "cylinder"\nradius_mm = 35.0\nheight_mm = 20.0\nbase = "bonded"'
TOOL = '[tool]\nshape = "flat-cylinder"\nradius_mm = 14.0\nedge_radius_mm = 2.0\ncontrol = "{control}"\nfriction = 0.0\n'


def write(
    folder: Path,
    curves: dict[str, tuple[np.ndarray, np.ndarray]],
    *,
    control: str = "force",
    noise: str = "force_sd_N = 0.002\ndisplacement_sd_mm = 0.010",
    more: dict[str, str] | None = None,
) -> Path:
    """A dataset of indentations: id -> displacements [m], forces [N]; ``more`` are further lines of a curve."""
    folder.mkdir()
    text = HEAD.format(test="indentation", specimen=CYLINDER, tool=TOOL.format(control=control), noise=noise)
    for name, (depths_m, forces_N) in curves.items():
        text += f'\n[[curve]]\nid = "{name}"\nfile = "{name}.csv"\n{(more or {}).get(name, "")}\n'
        rows = "".join(f"{k},{1e3 * d:.9g},{f:.9g}\n" for k, (d, f) in enumerate(zip(depths_m, forces_N, strict=True)))
        (folder / f"{name}.csv").write_text(f"time_s,displacement_mm,force_N\n{rows}", encoding="utf-8")
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder


def write_homogeneous(folder: Path, test: str, columns: str, x: np.ndarray, y: np.ndarray, noise: str = "") -> Path:
    """A dataset of one homogeneous curve."""
    folder.mkdir()
    text = HEAD.format(test=test, specimen='shape = "point"', tool="", noise=noise)
    (folder / "dataset.toml").write_text(text + '\n[[curve]]\nid = "one"\nfile = "one.csv"\n', encoding="utf-8")
    rows = "".join(f"{k},{a:.9g},{b:.9g}\n" for k, (a, b) in enumerate(zip(x, y, strict=True)))
    (folder / "one.csv").write_text(f"time_s,{columns}\n{rows}", encoding="utf-8")
    return folder
