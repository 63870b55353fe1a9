"""Terminal output of ``explicitfe compare`` for two results."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from pydantic import JsonValue
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from explicitfe.app.view.page.tables import table
from explicitfe.app.view.terminal.files import file_lines
from explicitfe.app.view.terminal.rows import moved, pairs, spaced, terminal_table, text_of
from explicitfe.results.files.differing_keys import table_in_words
from explicitfe.results.measure.comparison import ComparedField, ComparedHistory, Comparison, DifferingKey

# Measures that are in other tables, or only in --json.
NOT_SHOWN_MEASURES = (
    "points.",
    "palatogram.",
    "constriction.sections.",
    "contact.",
    "airway.",
    "body.self_penetration.",
)
MOST_ROWS_OF_A_TABLE = 40
# Smaller differences are not shown: the two halves of a symmetric body differ by as much.
SMALLEST_SHOWN = 1e-6
# End of a key -> its unit.
UNITS_OF_ENDINGS = {
    "_mm2": "mm²",
    "_mm_s": "mm/s",
    "_mm": "mm",
    "_ms": "ms",
    "_kPa": "kPa",
    "_N": "N",
    "_percent": "%",
    "_hz": "Hz",
}
# Unit of a stored field -> what it is shown in, and so many of these it is.
SHOWN_IN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "J": ("mJ", 1e3), "Pa": ("kPa", 1e-3), "1": ("", 1.0)}
CURVE_COLUMN = "indentation"  # of the history that every indentation has
MILLISECONDS_PER_SECOND = 1000.0


def comparison_tables(comparison: Comparison) -> Group:
    """All differences, from the most to the least general."""
    head = pairs("difference b − a")
    for name, of in (("a", comparison.a), ("b", comparison.b)):
        head.add_row(name, escape(f"{of.title}\n{of.elements} hexahedra, {of.samples} samples, {of.status}".strip()))
    head.add_row("difference", difference_in_words(comparison))
    files = file_lines([("a", comparison.a.result), ("b", comparison.b.result)])
    if comparison.identical:
        return Group(head, files)
    times, points = comparison.times, comparison.points
    between = f"; b is interpolated at {times.interpolated} of them" if times.interpolated else ""
    outside = f"; {times.left_out} of a are outside the time of b" if times.left_out else ""
    head.add_row("times", f"{times.compared} from {_time(times.first_ms)} to {_time(times.last_ms)}{between}{outside}")
    how = "nodes, same mesh" if points.same_mesh else "nodes of a, interpolated in b at the same material points"
    left_out = f"; {points.left_out} outside b are omitted" if points.left_out else ""
    head.add_row("points", f"{points.nodes} {how}{left_out}")
    tables: list[RenderableType] = [head]
    for title, keys in (
        ("scenarios differ in", comparison.differing_keys),
        ("runs differ in", comparison.differing_provenance),
    ):
        if keys:
            tables.append(_keys(title, keys))
    tables.append(_differences("fields: largest difference over space and time", "field", comparison.fields))
    if comparison.named_points:
        tables.append(_points(comparison))
    if any(part.name == CURVE_COLUMN for part in comparison.history):
        tables.append(_differences("loads: largest difference", "column", comparison.history))
    measures = list(_measures(comparison))
    if measures:
        tables.append(_side_by_side(f"measures at {_time(times.last_ms)}", "measure", measures))
    return Group(*tables, files)


def difference_in_words(comparison: Comparison) -> str:
    """The difference in one sentence."""
    if comparison.identical:
        return "none: bitwise identical"
    displacement = next(part for part in comparison.fields if part.name == "displacement")
    if displacement.largest == 0.0:
        words = "displacements are identical"
    else:
        largest = f"{_length(1e3 * displacement.largest)} ({_percent(displacement.share)} of the largest displacement)"
        words = f"displacements differ by up to {largest}"
        words += f", at {_time(displacement.at_ms)}" if displacement.at_ms is not None else ""
    if comparison.tolerance is None:
        return words
    within = "within" if comparison.within_tolerance else "more than"
    return f"{words}; {within} the tolerance of {_percent(comparison.tolerance)}"


def _keys(title: str, keys: Sequence[DifferingKey]) -> Table:
    return _side_by_side(title, "key", [(key.key, _value(key.a), _value(key.b)) for key in keys])


def _side_by_side(title: str, first: str, rows: Sequence[tuple[str, str, str]]) -> Table:
    left_out = len(rows) - MOST_ROWS_OF_A_TABLE
    shown = table((first, "a", "b"), rows[:MOST_ROWS_OF_A_TABLE], "ttt")
    return terminal_table(title, shown, f"and {left_out} more: add --json" if left_out > 0 else "")


def _differences(title: str, first: str, parts: Sequence[ComparedField | ComparedHistory]) -> Table:
    rows = []
    for part in parts:
        unit, scale = SHOWN_IN.get(part.unit, (part.unit, 1.0))
        rows.append((spaced(part.name), f"{scale * part.largest:.3g} {unit}", _percent(part.share), _time(part.at_ms)))
    return terminal_table(title, table((first, "largest", "relative", "at"), rows, "tnnn"))


def _points(comparison: Comparison) -> Table:
    rows = [
        (name, moved(at.forward_mm, at.up_mm, at.right_mm), _length(at.largest_mm), _percent(at.share), _time(at.at_ms))
        for name, at in comparison.named_points.items()
    ]
    title = f"points: b − a at {_time(comparison.times.last_ms)}, and the largest distance at any time"
    return terminal_table(title, table(("point", "at the end", "largest", "share", "at"), rows, "ttnnn"))


def _measures(comparison: Comparison) -> Iterator[tuple[str, str, str]]:
    for row in comparison.measures:
        same = _value(row.a) == _value(row.b) or all(isinstance(v, float) and abs(v) < SMALLEST_SHOWN for v in (row.a, row.b))
        if same or row.measure.startswith(NOT_SHOWN_MEASURES):
            continue
        ending = next((ending for ending in UNITS_OF_ENDINGS if row.measure.endswith(ending)), "")
        name = row.measure.removesuffix(ending).replace(".", " ").replace("_", " ")
        yield f"{name}, {UNITS_OF_ENDINGS[ending]}" if ending else name, _value(row.a), _value(row.b)


def _value(value: JsonValue) -> str:
    if value is None:
        return "absent"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return table_in_words(value) if isinstance(value, dict) else text_of(value)


def _percent(share: float | None) -> str:
    if share is None:
        return "both are 0"
    return "not finite" if not math.isfinite(share) else f"{100.0 * share:.3g} %"


def _time(time_ms: float | None) -> str:
    if time_ms is None:
        return ""
    if abs(time_ms) >= MILLISECONDS_PER_SECOND:
        return f"{time_ms / MILLISECONDS_PER_SECOND:.4g} s"
    return f"{time_ms:.4g} ms"


def _length(length_mm: float) -> str:
    return f"{length_mm:.3g} mm"
