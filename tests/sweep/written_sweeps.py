"""Folders of sweeps whose rows are written here: nothing is simulated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from support import ROOT

from explicitfe.simulate.sweep.definition import begin, define
from explicitfe.simulate.sweep.factors import factors_of
from explicitfe.simulate.sweep.journal import Journal
from explicitfe.simulate.sweep.members import Members
from explicitfe.simulate.sweep.rows import USUAL_PARTS, Row, written

SCENARIO = ROOT / "scenarios" / "vowel-i.toml"
CELLS = ("model.cells=[8,4,4]",)
FORCES = ["muscle.GGp.force_N=0:4", "muscle.GGa.force_N=0:1"]


def square(side: int) -> list[int]:
    """An outline of a few points, in hundredths of a millimetre."""
    return [0, 0, side, 0, side, side, 0, side]


def row_of(number: int, values: tuple[Any, ...]) -> Row:
    """A member whose tip rises by twice its first factor; each seventh folds."""
    row: Row = {"member": number, "name": "0" * 16}
    if number % 7 == 3:
        return row | {"status": "inverted", "message": f"at {number}.5 ms element {number} folded.", "member_s": 0.1}
    row |= {"status": "finished", "message": "", "steps": 100 + number, "min_J": 0.9, "settled": True, "warnings": number % 2}
    row |= {"points.tip.up_mm": 2.0 * float(values[0]), "points.tip.right_mm": 1e-15 * number, "constriction.width_mm": 3.0}
    return row | {"contact.palate.area_mm2": float(number), "contour": square(1000 + 10 * number), "member_s": 0.5}


def write_sweep(out: Path, members: Members, rows: Callable[[int, tuple[Any, ...]], Row] = row_of, **changes: Any) -> Path:
    """The folder of a sweep with rows of all members, or of as many as ``stored``."""
    stored = changes.pop("stored", len(members))
    scenario = changes.pop("scenario", SCENARIO)
    settings = changes.pop("settings", CELLS)
    given: dict[str, Any] = {"design": "random", "factors": factors_of(FORCES), "measures": USUAL_PARTS} | changes
    begin(out, define(scenario, settings, members, **given))
    with Journal(out / "rows" / "all.jsonl") as journal:
        journal.append([written(rows(number, members.values[number])) for number in range(stored)])
    return out


def indices(method: str, measure: str) -> dict[str, Any]:
    def one(value: float) -> list[dict[str, Any]]:
        return [
            {"factor": "muscle.GGp.force_N", "value": value, "half_width": 0.05},
            {"factor": "muscle.GGa.force_N", "value": -0.001, "half_width": 2.5},
        ]

    shares = method == "sobol"
    entry = {"measure": measure, "mean": 1.0, "spread": 1.0, "first": one(0.5) if shares else []}
    entry |= {"total": one(0.75) if shares else [], "effect": [] if shares else one(8.0)}
    return {"method": method, "members_used": 32, "members_left_out": 4, "measures": [entry]}
