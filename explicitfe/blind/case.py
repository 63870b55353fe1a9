"""A case of a blind study: what it is to be, what is written down for the tool, and what is sealed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.blind.identifiable import Separation
from explicitfe.blind.noise import Noise

KINDS = ("control", "single", "double", "outside")
# sd of a row, of the largest value of the dataset; simulated data are themselves no better than their mesh
LEVELS = {"homogeneous": (0.003, 0.01, 0.03), "indentation": (0.01, 0.02, 0.05)}
UNSTATED = 0.25  # share of the cases whose noise is not stated


@dataclass(frozen=True)
class Wanted:
    """What a case is to be: kind, which control, effects or outsider, and its noise level."""

    kind: str
    what: tuple[str, ...]
    level: float


@dataclass(frozen=True)
class Told:
    """Whether the dataset states its noise, and the scatter between its tests."""

    noise: bool
    repeats: bool = False

    def table(self, noise: Noise, key: str, exact: str | None, factor: float = 1.0) -> dict[str, float]:
        """The dataset's [noise]: ``key`` is that of what is predicted, ``exact`` that of what is imposed."""
        found = {}
        if self.noise:
            found[key] = float(f"{factor * noise.sd:.6g}")
            if exact is not None:
                found[exact] = 0.0
        if self.repeats:
            found["repeat_sd_fraction"] = noise.scale_sd
        return found


@dataclass(frozen=True, eq=False)
class Measured:
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
    conditions: dict[str, Any]
    own: dict[str, dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Case:
    """A case as it is written down.

    Attributes
    ----------
    title, test, specimen, tool, noise : of the dataset, as it states them; lengths may be wrong.
    columns : beside the time.
    truth : for the sealed file.
    """

    title: str
    test: str
    columns: tuple[str, str]
    specimen: dict[str, Any]
    tool: dict[str, Any] | None
    noise: dict[str, float]
    curves: list[Measured]
    truth: dict[str, Any] = field(default_factory=dict)


def sealed(
    wanted: Wanted,
    effects: Mapping[str, Mapping[str, Any]],
    constants: tuple[float, float],
    noise: Noise,
    told: Told,
    apart: Separation | None,
) -> dict[str, Any]:
    """The truth that cases of all families have in common."""
    outside = wanted.kind == "outside"
    return {
        "kind": wanted.kind,
        "sub": wanted.what[0] if wanted.kind in ("control", "outside") else None,
        "effects": {} if outside else dict(effects),
        "outside": dict(effects) if outside else {},
        "C10_Pa": constants[0],
        "C20_Pa": constants[1],
        "noise": {
            "level": noise.level,
            "sd": noise.sd,
            "rho": noise.rho,
            "scale_sd": noise.scale_sd,
            "offset_sd": noise.offset_sd,
            "stated": told.noise,
            "repeats_stated": told.repeats,
        },
        "identifiable": None if apart is None else apart.identifiable,
        "separation": None if apart is None else {"baseline": apart.baseline, "rivals": apart.rivals, "nearest": apart.nearest},
    }


# ---- on disk ----


def write(case: Case, folder: Path, name: str) -> None:
    """The dataset of a case, without its truth."""
    lines = [
        'format = "explicitfe-dataset/1"',
        f"name = {_value(name)}",
        f"title = {_value(case.title)}",
        f"test = {_value(case.test)}",
    ]
    for head, table in (("specimen", case.specimen), ("tool", case.tool), ("noise", case.noise)):
        if table:
            lines += ["", f"[{head}]", *(f"{key} = {_value(value)}" for key, value in table.items())]
    folder.mkdir()
    for curve in case.curves:
        lines += ["", "[[curve]]", f"id = {_value(curve.id)}", f"file = {_value(f'{curve.id}.csv')}"]
        lines += [f"{key} = {_value(value)}" for key, value in (("group", curve.group), ("split", curve.split)) if value]
        lines += [f"{key} = {_value(value)}" for key, value in (*curve.own.items(), ("conditions", curve.conditions)) if value]
        text = "\n".join(f"{t:.9g},{x:.9g},{y:.9g}" for t, x, y in curve.rows)
        (folder / f"{curve.id}.csv").write_text(f"time_s,{','.join(case.columns)}\n{text}\n", encoding="utf-8")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _value(value: Any) -> str:
    """As TOML writes it."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_value(inner)}' for key, inner in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
