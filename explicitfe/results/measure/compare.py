"""Compare two results: scenarios, fields at material points, named points, histories and measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from pydantic import JsonValue

from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.mesh.muscle_lines import points_of_mesh
from explicitfe.platform.errors import InputError, Progress, silent
from explicitfe.platform.host.nested import leaves
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result, open_result
from explicitfe.results.files.differing_keys import differing_keys
from explicitfe.results.measure.comparison import (
    ComparedField,
    ComparedHistory,
    ComparedPoint,
    ComparedPoints,
    ComparedResult,
    ComparedTimes,
    Comparison,
    DifferingKey,
    DifferingMeasure,
)
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.motion import place_of, unsigned_zero
from explicitfe.results.measure.sections import X, Y, Z

# Times that differ by less than this share of the longer run are equal.
SAME_TIME_SHARE = 1e-9
# If fewer of the nodes lie in the other mesh, the two are not the same body at rest.
SMALLEST_COMMON_SHARE = 0.5
NOT_COMPARED_PROVENANCE = ("started_utc",)
NOT_COMPARED_MEASURES = ("result", "title", "status", "time_ms")


def compare(path_a: Path | str, path_b: Path | str, tolerance: float | None = None, progress: Progress = silent) -> Comparison:
    """Compare two results; differences are the second minus the first.

    Results on different meshes are compared at material points: the second is interpolated at the nodes and the element centres
    of the first. They are compared at the stored times of the first; the second is interpolated linearly in time.

    Parameters
    ----------
    tolerance : largest difference of displacements, relative to the largest displacement, for which ``within_tolerance`` is true.
    progress : called with the name of the stage and the fraction done.

    Raises
    ------
    InputError : a file cannot be read, the two are of different kinds or bodies, or have no stored time in common.
    """
    if tolerance is not None and not 0.0 <= tolerance < np.inf:
        raise InputError(f"`tolerance` {tolerance:g}: give a fraction of the largest displacement, 0 or more, such as 0.01.")
    with open_result(path_a) as a, open_result(path_b) as b:
        if kind_of(a.model) != kind_of(b.model):
            raise InputError(f"{a.path} and {b.path}: one is a transient run, one an indentation; compare two of a kind.")
        steps = _instants(a.times, b.times)
        if not len(steps.rows):
            raise InputError(f"{a.path} and {b.path}: no stored time of the first lies between stored times of the second.")
        pairing = _pairing(a, b)
        fields = _fields(a, b, steps, pairing, progress)
        rows = _instants(a.history("time"), b.history("time"))
        history = [_history(a, b, name, rows) for name in _common_columns(a, b)]
        same_names = a.fields.keys() == b.fields.keys() and a.history_names.keys() == b.history_names.keys()
        same_times = all(map(np.array_equal, (a.times, a.history("time")), (b.times, b.history("time"))))
        largest = [part.largest for part in fields] + [part.largest for part in history]
        displacement = next(part for part in fields if part.name == "displacement")
        return Comparison(
            a=describe_result(a),
            b=describe_result(b),
            identical=pairing.bitwise and same_names and same_times and not any(largest),
            tolerance=tolerance,
            within_tolerance=None if tolerance is None else (displacement.share or 0.0) <= tolerance,
            differing_keys=_keys(differing_keys([a.model.get("scenario", {}), b.model.get("scenario", {})])),
            differing_provenance=_keys(differing_keys([_provenance(a), _provenance(b)])),
            times=ComparedTimes(
                compared=len(steps.rows),
                interpolated=int(np.count_nonzero(steps.share)),
                first_ms=1e3 * float(a.times[steps.rows[0]]),
                last_ms=1e3 * float(a.times[steps.rows[-1]]),
                left_out=len(a.times) - len(steps.rows),
            ),
            points=ComparedPoints(
                same_mesh=pairing.same_mesh,
                nodes=len(pairing.nodes),
                elements=len(pairing.elements),
                left_out=a.mesh.node_count - len(pairing.nodes),
            ),
            fields=fields,
            named_points=_named_points(a, b, steps),
            history=history,
            measures=_measures(a, b, steps),
        )


# ---- pairs of points and times ----


@dataclass(frozen=True)
class Pairing:
    """Compared nodes and elements of the first result, and the interpolation of the second there.

    Attributes
    ----------
    same_mesh : whether the second is read at its nodes, without interpolation.
    bitwise : whether the two meshes are bitwise identical.
    nodes, elements : (k,), (l,) of the first.
    of_nodes, of_elements : values of the nodes, or elements, of the second -> those at the nodes, elements of the first.
    """

    same_mesh: bool
    bitwise: bool
    nodes: np.ndarray
    elements: np.ndarray
    of_nodes: Callable[[np.ndarray], np.ndarray]
    of_elements: Callable[[np.ndarray], np.ndarray]


def _pairing(a: Result, b: Result) -> Pairing:
    mesh_a, mesh_b = a.mesh, b.mesh
    nodes, elements = np.arange(mesh_a.node_count), np.arange(mesh_a.element_count)
    if np.array_equal(mesh_a.hexes, mesh_b.hexes) and mesh_a.points.shape == mesh_b.points.shape:
        extent = np.ptp(mesh_a.points, axis=0).max()
        if np.abs(mesh_a.points - mesh_b.points).max() <= SAME_TIME_SHARE * extent:
            return Pairing(True, np.array_equal(mesh_a.points, mesh_b.points), nodes, elements, np.asarray, np.asarray)
    at_nodes, inside = points_of_mesh(mesh_b, mesh_a.points)
    if inside.mean() < SMALLEST_COMMON_SHARE:
        raise InputError(
            f"{a.path} and {b.path} are not of the same body: {100.0 * (1.0 - inside.mean()):.0f} % of the nodes of the first "
            "lie outside the mesh of the second at rest; compare results of the same model."
        )
    at_centres, within = points_of_mesh(mesh_b, _centres(mesh_a))
    kept = MaterialPoints(at_nodes.element[inside], at_nodes.natural[inside], at_nodes.position[inside])
    return Pairing(
        same_mesh=False,
        bitwise=False,
        nodes=nodes[inside],
        elements=elements[within],
        of_nodes=lambda values: mesh_b.at(kept, values),
        of_elements=lambda values: values[at_centres.element[within]],
    )


def _centres(mesh: HexMesh) -> np.ndarray:
    return mesh.points[mesh.hexes].mean(axis=1)


class Instants(NamedTuple):
    """Compared times of the first result, and the rows of the second to interpolate between.

    Attributes
    ----------
    rows : (t,) rows of the first.
    before, share : (t,) row of the second before the time, and weight of the next row; 0 if the times are equal.
    """

    rows: np.ndarray
    before: np.ndarray
    share: np.ndarray

    def at(self, number: int, row: Callable[[int], np.ndarray]) -> np.ndarray:
        """Interpolate the second linearly to one of these times; ``row`` returns its values in a row."""
        before, share = int(self.before[number]), self.share[number]
        return row(before) if share == 0.0 else (1.0 - share) * row(before) + share * row(before + 1)


def _instants(times_a: np.ndarray, times_b: np.ndarray) -> Instants:
    """Times of the first that are within those of the second."""
    if not len(times_a) or not len(times_b):
        return Instants(np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
    rounding = SAME_TIME_SHARE * max(np.abs(times_a).max(), np.abs(times_b).max())
    rows = np.flatnonzero((times_a >= times_b[0] - rounding) & (times_a <= times_b[-1] + rounding))
    before = np.clip(np.searchsorted(times_b, times_a[rows] + rounding, side="right") - 1, 0, len(times_b) - 1)
    after = np.minimum(before + 1, len(times_b) - 1)
    gone = times_a[rows] - times_b[before]
    share = np.where(gone > rounding, gone / np.maximum(times_b[after] - times_b[before], rounding), 0.0)
    return Instants(rows, before, np.where(after > before, share, 0.0))


# ---- differences ----


@dataclass
class Apart:
    """The largest difference of a quantity so far, its sum of squares, and the largest magnitude."""

    largest: float = 0.0
    magnitude: float = 0.0
    squares: float = 0.0
    count: int = 0
    at: tuple[int, int] | None = field(default=None)  # number of the time, and of the point, of the largest

    def add(self, number: int, a: np.ndarray, b: np.ndarray) -> None:
        """Values (k,) or (k, components) of both at one time. Where both are not finite in the same manner they are the same."""
        with np.errstate(invalid="ignore"):
            difference = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(b - a))
        difference[np.isnan(difference)] = np.inf
        apart = _lengths(difference)
        if not len(apart):
            return
        point = int(apart.argmax())
        if apart[point] > self.largest:
            self.largest, self.at = float(apart[point]), (number, point)
        for values in (a, b):
            lengths = _lengths(values)
            self.magnitude = max(self.magnitude, float(np.max(lengths[np.isfinite(lengths)], initial=0.0)))
        self.squares += float(np.sum(apart * apart))
        self.count += len(apart)

    @property
    def rms(self) -> float:
        return float(np.sqrt(self.squares / self.count)) if self.count else 0.0

    @property
    def share(self) -> float | None:
        if self.largest == 0.0:
            return 0.0 if self.magnitude > 0.0 else None
        return self.largest / self.magnitude if self.magnitude > 0.0 else float("inf")


def _lengths(values: np.ndarray) -> np.ndarray:
    return np.abs(values) if values.ndim == 1 else np.linalg.norm(values, axis=1)


def _fields(a: Result, b: Result, steps: Instants, pairing: Pairing, progress: Progress) -> list[ComparedField]:
    """Compare the fields that both have, with the same number of components."""
    common = [name for name in a.fields if name in b.fields and a.fields[name].kind == b.fields[name].kind]
    common = [name for name in common if a.fields[name].quantity.components == b.fields[name].quantity.components]
    parts = []
    for number, name in enumerate(common):
        kind, quantity = a.fields[name]
        chosen, paired = (pairing.nodes, pairing.of_nodes) if kind == "point" else (pairing.elements, pairing.of_elements)
        apart = Apart()
        for row, step in enumerate(steps.rows):
            progress("compare", (number + row / len(steps.rows)) / len(common))
            apart.add(row, a.field(name, int(step))[chosen], paired(steps.at(row, partial(b.field, name))))
        places = a.mesh.points if kind == "point" else _centres(a.mesh)
        parts.append(
            ComparedField(
                name=name,
                kind=kind,
                unit=quantity.unit,
                largest=apart.largest,
                rms=apart.rms,
                share=apart.share,
                at_ms=None if apart.at is None else 1e3 * float(a.times[steps.rows[apart.at[0]]]),
                place=None if apart.at is None else place_of(places[chosen[apart.at[1]]]),
            )
        )
    progress("compare", 1.0)
    return parts


def _named_points(a: Result, b: Result, steps: Instants) -> dict[str, ComparedPoint]:
    """Compare the points that both recorded, or all named points if none were recorded."""
    names = [name for name in a.model.get("probes", a.mesh.named_points) if name in b.model.get("probes", b.mesh.named_points)]
    parts = {}
    for name in names:
        apart, end = _apart(path_of_point(a, name), path_of_point(b, name), steps)
        end *= 1e3
        parts[name] = ComparedPoint(
            largest_mm=1e3 * apart.largest,
            share=apart.share,
            at_ms=None if apart.at is None else 1e3 * float(a.times[steps.rows[apart.at[0]]]),
            forward_mm=unsigned_zero(-end[X]),
            up_mm=unsigned_zero(end[Z]),
            right_mm=unsigned_zero(end[Y]),
        )
    return parts


def _apart(course_a: np.ndarray, course_b: np.ndarray, rows: Instants) -> tuple[Apart, np.ndarray]:
    """Difference of two histories (rows,) or (rows, components), and the last difference."""
    apart, last = Apart(), np.zeros(course_a.shape[1:])
    for number, row in enumerate(rows.rows):
        one, other = course_a[row], rows.at(number, course_b.__getitem__)
        apart.add(number, np.atleast_2d(one), np.atleast_2d(other))
        last = other - one
    return apart, last


def path_of_point(result: Result, name: str) -> np.ndarray:
    """Return the displacement of a named point at each stored time, (t, 3) m."""
    column = f"probe_{name}_displacement"
    if column in result.history_names and np.array_equal(result.history("time"), result.times):
        return result.history(column)
    return result.probe(name)


def _common_columns(a: Result, b: Result) -> list[str]:
    """Columns of the history that both have, with the same number of components, except time."""
    both = [name for name in a.history_names if name in b.history_names and name != "time"]
    return [name for name in both if a.history_names[name].components == b.history_names[name].components]


def _history(a: Result, b: Result, name: str, rows: Instants) -> ComparedHistory:
    apart, _ = _apart(a.history(name), b.history(name), rows)
    return ComparedHistory(
        name=name,
        unit=a.history_names[name].unit,
        largest=apart.largest,
        share=apart.share,
        at_ms=None if apart.at is None else 1e3 * float(a.history("time")[rows.rows[apart.at[0]]]),
    )


def _measures(a: Result, b: Result, steps: Instants) -> list[DifferingMeasure]:
    """Measures that differ at the last common time with finite displacements."""
    if kind_of(a.model) != "transient":
        return []
    for number in reversed(range(len(steps.rows))):
        step_a = int(steps.rows[number])
        step_b = int(steps.before[number] + (steps.share[number] > 0.5))  # the nearer one: a measure is that of a stored sample
        if np.isfinite(a.displacement(step_a)).all() and np.isfinite(b.displacement(step_b)).all():
            one, other = _measured(a, step_a), _measured(b, step_b)
            names = [name for name in dict.fromkeys((*one, *other)) if one.get(name) != other.get(name)]
            return [DifferingMeasure(measure=name, a=one.get(name), b=other.get(name)) for name in names]
    return []


def _measured(result: Result, step: int) -> dict[str, JsonValue]:
    """Single values of the measures at a step, by their keys."""
    document = measures_of(result, step).document
    return dict(leaves({key: value for key, value in document.items() if key not in NOT_COMPARED_MEASURES}))


def _keys(differing: dict[str, list[Any]]) -> list[DifferingKey]:
    return [DifferingKey(key=key, a=values[0], b=values[1]) for key, values in differing.items()]


def _provenance(result: Result) -> dict[str, JsonValue]:
    values = cast("dict[str, JsonValue]", result.provenance)
    return {key: value for key, value in values.items() if key not in NOT_COMPARED_PROVENANCE}


def describe_result(result: Result) -> ComparedResult:
    """Describe a result: file, title, status and size."""
    return ComparedResult(
        result=str(result.path),
        title=str(result.model.get("scenario", {}).get("title", "")),
        status=result.status,
        nodes=result.mesh.node_count,
        elements=result.mesh.element_count,
        samples=len(result.times),
    )
