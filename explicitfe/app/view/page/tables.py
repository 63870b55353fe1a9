"""Tables and bars of the page, as data: the template makes HTML of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from explicitfe.app.view.page.words import DASH, finite


@dataclass(frozen=True)
class Bars:
    """Bars of the error, "b" before and "a" after, with their widths, and a line where the floor is, % of the whole width."""

    bars: list[tuple[str, str]]
    floor_percent: str | None


@dataclass(frozen=True)
class TableColumn:
    """A column of a table; its kind is the class of its cells: "" text, "n" number, "why" explanation, "bar" bars."""

    head: str
    kind: str


@dataclass(frozen=True)
class TableRow:
    """A row of a table; a chosen one is printed bold."""

    cells: list[str | Bars]
    chosen: bool = False


@dataclass(frozen=True)
class PageTable:
    """A table of the page."""

    columns: list[TableColumn]
    rows: list[TableRow]


def table(
    head: Sequence[str], rows: Iterable[Sequence[str | Bars | None]], kinds: str, chosen: Sequence[bool] = ()
) -> PageTable | None:
    """A table without its empty columns; None where there is no row.

    Parameters
    ----------
    kinds : a letter a column: t text, n number, w explanation, b bars.
    chosen : for each row whether it is chosen; none is if left out.
    """
    rows = list(rows)
    if not rows:
        return None
    kept = [k for k in range(len(head)) if any(row[k] not in (None, "", DASH) for row in rows)]
    classes = {"t": "", "n": "n", "w": "why", "b": "bar"}
    marks = [*chosen, *[False] * (len(rows) - len(chosen))]
    return PageTable(
        [TableColumn(head[k], classes[kinds[k]]) for k in kept],
        [TableRow([row[k] or "" for k in kept], mark) for row, mark in zip(rows, marks, strict=True)],
    )


def bars(errors: Sequence[float | None], floor: float | None, largest: float) -> Bars | None:
    """Bars of errors before and after; the largest of all has the whole width. None where there is no error."""
    if not largest > 0.0:
        return None
    shown = [(stage, f"{100.0 * error / largest:.1f}") for stage, error in zip("ba", errors, strict=False) if finite(error)]
    return Bars(shown, f"{100.0 * floor / largest:.1f}" if finite(floor) else None)
