"""A result as a table, a row for each sample: what sensors on the body would have measured, or the curve of an indentation."""

from __future__ import annotations

import csv
import io

import numpy as np

from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files.layout import Quantity
from explicitfe.results.files.recorded import Recorded

X, Y, Z = 0, 1, 2  # backwards, to the speaker's right, up
CURVE = ("force", "indentation")  # the columns of an indentation that everybody asks for stand first
MM_PER_M = 1e3  # of a unit: m -> mm
SIGNIFICANT_DIGITS = 9
# SI unit -> the end of a column's name, and so many of these it is.
ENDINGS = {
    "m": ("_mm", MM_PER_M),
    "m/s": ("_mm_s", MM_PER_M),
    "m^2": ("_mm2", MM_PER_M**2),
    "1": ("", 1.0),
    "s": ("_ms", MM_PER_M),
}


def table_of(result: Recorded, *, positions: bool = False, history: bool = False) -> dict[str, np.ndarray]:
    """Columns (rows,) by name; the name says the unit.

    Parameters
    ----------
    positions : of the points in the frame of the model, instead of displacements from rest.
    history : the other columns of the history too; of an indentation they are always there.
    """
    columns = {"time_ms": MM_PER_M * result.history("time")}
    if kind_of(result.model) != "transient":
        names = sorted(set(result.history_names) - {"time"}, key=lambda name: (name not in CURVE, name))
        return columns | _history(result, names)
    for name in result.model.get("probes", result.mesh.named_points):
        columns |= _point(result, name, positions)
    if history:
        others = (name for name in result.history_names if name != "time" and not name.startswith("probe_"))
        columns |= _history(result, list(others))
    return columns


def csv_bytes(columns: dict[str, np.ndarray]) -> bytes:
    """A table as CSV, UTF-8: a head, then a row for each sample."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow(f"{value:.{SIGNIFICANT_DIGITS}g}" for value in row)
    return text.getvalue().encode()


def parquet_bytes(columns: dict[str, np.ndarray]) -> bytes:
    """A table as Parquet."""
    import pyarrow
    import pyarrow.parquet

    file = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(columns), file)
    return file.getvalue()


def _point(result: Recorded, name: str, positions: bool) -> dict[str, np.ndarray]:
    """How a named point has moved, forward, up and to the right, and its velocity."""
    times = result.history("time")
    if f"probe_{name}_displacement" in result.history_names:
        path = result.history(f"probe_{name}_displacement")
    else:
        times, path = result.times, result.probe(name)
    if f"probe_{name}_velocity" in result.history_names:
        velocity = result.history(f"probe_{name}_velocity")
    else:
        velocity = np.gradient(path, times, axis=0) if len(times) > 1 else np.zeros_like(path)
    if positions:
        path = path + result.mesh.named_points[name].position[0]
    return {
        **{f"{name}_{direction}_mm": MM_PER_M * values for direction, values in _directions(path).items()},
        **{f"{name}_velocity_{direction}_mm_s": MM_PER_M * values for direction, values in _directions(velocity).items()},
        f"{name}_speed_mm_s": MM_PER_M * np.linalg.norm(velocity, axis=1),
    }


def _directions(vectors: np.ndarray) -> dict[str, np.ndarray]:
    return {"forward": 0.0 - vectors[:, X], "up": vectors[:, Z], "right": vectors[:, Y]}


def _history(result: Recorded, names: list[str]) -> dict[str, np.ndarray]:
    """Columns of the history; those of vectors along x, y and z."""
    columns = {}
    for name in names:
        values, quantity = result.history(name), result.history_names[name]
        ending, scale = _ending(quantity)
        if values.ndim == 1:
            columns[f"{name}{ending}"] = scale * values
            continue
        parts = "xyz" if quantity.components == len("xyz") else [str(number) for number in range(quantity.components)]
        columns |= {f"{name}_{part}{ending}": scale * values[:, number] for number, part in enumerate(parts)}
    return columns


def _ending(quantity: Quantity) -> tuple[str, float]:
    return ENDINGS.get(quantity.unit, (f"_{quantity.unit.replace('/', '_')}", 1.0))
