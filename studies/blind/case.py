"""A case of a blind study: what is asked for, and the dataset that is written for the tool."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from studies.blind.grid import Conditions
from studies.blind.noise import Noise
from studies.blind.truth import NoiseTruth, Truth

Value = str | float | list[str]  # of a key in a dataset
Table = dict[str, Value]

KINDS = ("control", "single", "double", "outside")
# Standard deviation of a row, as a share of the dataset's largest value. Simulated data are noisier, as they are no better than
# their mesh.
LEVELS = {"homogeneous": (0.003, 0.01, 0.03), "indentation": (0.01, 0.02, 0.05), "foreign": (0.003, 0.01, 0.03)}
UNSTATED_NOISE_SHARE = 0.25  # in this share of the cases the dataset does not state its noise


@dataclass(frozen=True)
class CaseRequest:
    """What a case is to be.

    Attributes
    ----------
    kind : control | single | double | outside.
    subjects : the control, the hidden effects, or the law that is not in the library.
    level : of the noise.
    """

    kind: str
    subjects: tuple[str, ...]
    level: float


@dataclass(frozen=True)
class NoiseStatement:
    """Whether the dataset states its noise, and the scatter between its tests."""

    noise: bool
    repeats: bool = False

    def table(self, noise: Noise, key: str, exact: str | None, factor: float = 1.0) -> dict[str, float]:
        """The table [noise] of the dataset.

        Parameters
        ----------
        key : the key for the noise of the predicted column.
        exact : the key for the noise of the imposed column, which has none.
        factor : from the unit of the noise to that of the key.
        """
        entries = {}
        if self.noise:
            entries[key] = float(f"{factor * noise.sd:.6g}")
            if exact is not None:
                entries[exact] = 0.0
        if self.repeats:
            entries["repeat_sd_fraction"] = noise.scale_sd
        return entries

    def truth(self, noise: Noise) -> NoiseTruth:
        """The noise as the sealed file has it."""
        return {
            "level": noise.level,
            "sd": noise.sd,
            "rho": noise.rho,
            "scale_sd": noise.scale_sd,
            "offset_sd": noise.offset_sd,
            "stated": self.noise,
            "repeats_stated": self.repeats,
        }


@dataclass(frozen=True, eq=False)
class CaseCurve:
    """One curve of the dataset.

    Attributes
    ----------
    rows (k, 3) : time and the two columns.
    own : keys that differ from the dataset's: table -> key -> value.
    """

    id: str
    rows: np.ndarray
    group: str | None
    split: str | None
    conditions: Conditions
    own: dict[str, Table]


@dataclass(frozen=True, eq=False)
class Case:
    """A case as it is written down.

    Attributes
    ----------
    title, test, specimen, tool, noise : of the dataset, as it states them; lengths may be wrong.
    columns : their names, beside the time.
    truth : for the sealed file.
    """

    title: str
    test: str
    columns: tuple[str, str]
    specimen: Table
    tool: Table | None
    noise: dict[str, float]
    curves: list[CaseCurve]
    truth: Truth


# ---- on disk ----


def write(case: Case, folder: Path, name: str) -> None:
    """Write the dataset of a case into a folder, without its truth."""
    lines = [
        'format = "explicitfe-dataset/1"',
        f"name = {_value(name)}",
        f"title = {_value(case.title)}",
        f"test = {_value(case.test)}",
    ]
    for head, table in (("specimen", case.specimen), ("tool", case.tool), ("noise", case.noise)):
        if table:
            lines += ["", f"[{head}]", *(f"{key} = {_value(value)}" for key, value in table.items())]
    folder.mkdir(exist_ok=True)
    for curve in case.curves:
        lines += ["", "[[curve]]", f"id = {_value(curve.id)}", f"file = {_value(f'{curve.id}.csv')}"]
        lines += [f"{key} = {_value(value)}" for key, value in (("group", curve.group), ("split", curve.split)) if value]
        lines += [f"{key} = {_value(table)}" for key, table in curve.own.items() if table]
        if curve.conditions:
            lines += [f"conditions = {_value(curve.conditions)}"]
        text = "\n".join(f"{t:.9g},{x:.9g},{y:.9g}" for t, x, y in curve.rows)
        (folder / f"{curve.id}.csv").write_text(f"time_s,{','.join(case.columns)}\n{text}\n", encoding="utf-8")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _value(value: Value | Table | Conditions) -> str:
    """The value as TOML writes it."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_value(inner)}' for key, inner in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
