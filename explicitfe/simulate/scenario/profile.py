"""The keys that say when a muscle or a load acts, or how far a motion is."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from explicitfe.fem.inputs.sentences import explain
from explicitfe.fem.inputs.table import MOST_ROWS_OF_A_COURSE, Pair, PathRow, Table, validated
from explicitfe.fem.model.profile import Profile
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.text import text_of

PATH_COLUMNS = ("time_ms", "x_mm", "y_mm", "z_mm")


class ProfileTable(Table):
    """A table with a profile in time: at once, a ramp, or a table of times and factors."""

    profile: Literal["step", "ramp", "table"] = Field(
        default="step", description="course in time: at once, rising evenly within rise_ms, or along the pairs of table"
    )
    start_ms: float = Field(default=0.0, ge=0.0, description="time at which a step or a ramp begins [ms]")
    rise_ms: float = Field(default=0.0, ge=0.0, description="time in which a ramp rises [ms]")
    end_ms: float | None = Field(default=None, description="time at which the pull ends [ms]; none by default")
    table: list[Pair] = Field(
        default=[], max_length=MOST_ROWS_OF_A_COURSE, description="[time_ms, scale] pairs, linear in between"
    )

    @model_validator(mode="after")
    def _profile_is_whole(self) -> ProfileTable:
        if self.end_ms is not None and self.end_ms <= self.start_ms + self.rise_ms:
            raise ValueError("end_ms must come after start_ms + rise_ms")
        if (self.profile == "ramp") != (self.rise_ms > 0.0):
            raise ValueError('profile = "ramp" and rise_ms above 0 go together')
        if (self.profile == "table") != bool(self.table):
            raise ValueError('profile = "table" and a table of [time_ms, scale] pairs go together')
        if self.profile == "table" and (self.start_ms > 0.0 or self.end_ms is not None):
            raise ValueError('start_ms and end_ms do not go with profile = "table": put the times into the table')
        times = [time for time, _ in self.table]
        if times != sorted(times) or any(time < 0.0 for time in times):
            raise ValueError("the times of table must not be negative and must not decrease")
        if any(scale < 0.0 for _, scale in self.table):
            raise ValueError("the scales of table must not be negative: a muscle cannot push")
        return self


class MotionTable(Table):
    """A table with a motion that begins at rest: evenly within rise_ms, or along the pairs of table."""

    start_ms: float = Field(default=0.0, ge=0.0, description="time at which the motion begins [ms]")
    rise_ms: float = Field(default=50.0, gt=0.0, description="time that the motion takes [ms]")
    table: list[Pair] = Field(
        default=[], max_length=MOST_ROWS_OF_A_COURSE, description="[time_ms, share] pairs instead, linear in between"
    )

    @model_validator(mode="after")
    def _table_begins_at_rest(self) -> MotionTable:
        times = [time for time, _ in self.table]
        if times != sorted(set(times)) or any(time < 0.0 for time in times):
            raise ValueError("the times of table must increase and not be negative")
        if self.table and self.table[0][1] != 0.0:
            raise ValueError("table must begin with a share of 0, because the body is at rest at time 0")
        return self

    @property
    def course(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) s and shares (k,) of the motion, linear in between."""
        pairs = self.table or [(self.start_ms, 0.0), (self.start_ms + self.rise_ms, 1.0)]
        time_ms, share = np.array(pairs, dtype=float).T
        return 1e-3 * time_ms, share


class PathTable(Table):
    """A table with a path over time, inline or in a file."""

    path: list[PathRow] = Field(
        default=[],
        max_length=MOST_ROWS_OF_A_COURSE,
        description="[time_ms, x_mm, y_mm, z_mm] rows of displacements without rotation, linear in between",
    )
    path_file: str | None = Field(
        default=None, description="instead of path: CSV file with the columns time_ms and some of x_mm, y_mm, z_mm"
    )

    @model_validator(mode="after")
    def _begins_at_rest(self) -> PathTable:
        if self.path and self.path_file is not None:
            raise ValueError("give either path or path_file, not both")
        times = [row[0] for row in self.path]
        if times != sorted(set(times)):
            raise ValueError("the times of path must increase")
        if self.path and any(self.path[0]):
            raise ValueError("path must begin with [0, 0, 0, 0], because the body is at rest at time 0")
        return self

    def course(self, folder: Path) -> tuple[np.ndarray, np.ndarray] | None:
        """Times (k,) s and displacements (k, 3) m of the path; None without one. A file lies in ``folder``.

        Raises
        ------
        InputError : the file cannot be read, or is no such table.
        """
        path = self.path if self.path_file is None else _read_path(folder / self.path_file)
        rows = 1e-3 * np.array(path, dtype=float)
        return (rows[:, 0], rows[:, 1:]) if len(rows) else None


def _read_path(file: Path) -> list[PathRow]:
    table = csv.reader(text_of(file, "path_file is a CSV file").splitlines(), skipinitialspace=True)
    lines = [(table.line_num, [cell.strip() for cell in cells]) for cells in table if cells]
    names = lines[0][1] if lines else []
    if len(set(names)) < len(names) or not {"time_ms"} < set(names) <= set(PATH_COLUMNS):
        raise InputError(f"{file}: the first line must name columns: time_ms, and some of x_mm, y_mm, z_mm.")
    path = []
    for number, cells in lines[1:]:
        try:
            row = dict(zip(names, map(float, cells), strict=True))
        except ValueError:
            row = {}
        if not row or not all(map(math.isfinite, row.values())):
            raise InputError(f"{file}, line {number}: give a number for each of the columns {', '.join(names)}.")
        path.append(tuple(row.get(name, 0.0) for name in PATH_COLUMNS))
    if len(path) < 2:
        raise InputError(f"{file}: a path needs two rows at least; add them below the names of the columns.")
    try:
        return validated(PathTable, {"path": path}).path
    except ValidationError as error:
        raise InputError(f"{file}: {explain(error, {'path': path}, PathTable)}") from None


def profile_of(table: ProfileTable) -> Profile:
    """The profile that the keys of a table describe."""
    if table.profile == "table":
        time_ms, scale = np.array(table.table, dtype=float).T
        return Profile(1e-3 * time_ms, scale)
    end_s = np.inf if table.end_ms is None else 1e-3 * table.end_ms
    return Profile.step(1e-3 * table.start_ms, end_s, 1e-3 * table.rise_ms)
