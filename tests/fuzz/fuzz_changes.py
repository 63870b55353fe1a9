"""Strategies that spoil input: absurd values, tables that lose or gain keys, text that loses or gains bytes, ragged columns."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

Tables = dict[str, Any]
MOST_CHANGES = 3


class Literal(str):
    """A value that stands in TOML as it is: a date, a number that Python's writer would not write."""


ABSURD_NUMBERS = [
    0, 0.0, -0.0, -1, -1.0, 1, 2, 3, 1.5, 1e-308, 5e-324, 1e308, -1e308, float("inf"), float("-inf"), float("nan"),
    1e15, 1e-15, 1e9, 1e6, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.5, 0.4999999999999999, 1e-9, 1e100, 999, 100_000,
]  # fmt: skip
ABSURD_STRINGS = [
    "", " ", "nan", "1.0", "x" * 10_000, "a\0b", "\x1b[31mred\x1b[0m", "$x_{", "<script>alert(1)</script>",
    "../../etc/x", "/dev/zero", "/dev/null", ".", "..", "/", "~", "two\nlines", "\u202eleft", "𝕏", "ｆｕｌｌ", "é" * 300,
    "[", "{", "%s", "--help", "-", "a.b", "CON", "*", "all", "null", "GGp", "tip", "one",
]  # fmt: skip
ABSURD_LITERALS = [
    "1979-05-27",
    "07:32:00",
    "1979-05-27T07:32:00Z",
    "0x7fff_ffff_ffff_ffff",
    "1e400",
    "[" * 500 + "]" * 500,
    "{}",
]
ABSURD = [
    *ABSURD_NUMBERS,
    *ABSURD_STRINGS,
    *map(Literal, ABSURD_LITERALS),
    True, False, [], [[]], [{}], {}, {"a": {"b": {"c": 1}}}, [1, "a", True], [0.0] * 1000, [[0.0, 0.0], [0.0, 1.0]], ["tip"] * 3,
]  # fmt: skip
absurd_values = st.sampled_from(ABSURD) | st.floats() | st.integers() | st.text(max_size=20)
powers_of_ten = st.sampled_from([-1e3, -1.0, 0.0, 1e-300, 1e-9, 1e-6, 1e-3, 0.1, 10.0, 1e3, 1e6, 1e9, 1e300])


def toml(tables: Tables) -> str:
    """TOML of plain keys, then tables, then arrays of tables; deeper tables stand in a line."""
    lines = [f"{key_of(key)} = {value_of(value)}" for key, value in tables.items() if not _is_table(value)]
    for name, value in tables.items():
        for entry in [value] if isinstance(value, dict) else value if _is_table(value) else []:
            lines += ["", f"[{key_of(name)}]" if isinstance(value, dict) else f"[[{key_of(name)}]]"]
            lines += [f"{key_of(key)} = {value_of(inner)}" for key, inner in entry.items()]
    return "\n".join(lines) + "\n"


def value_of(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, Literal):
        return str(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key_of(key)} = {value_of(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(value_of, value)) + "]"
    if isinstance(value, str):
        return key_of(value, bare=False)
    # A whole number of 400 digits is none that Python prints without being asked.
    return repr(value)


def key_of(text: str, *, bare: bool = True) -> str:
    """A string in quotes, with the escapes of TOML; a plain key without them."""
    if bare and text and all(c.isascii() and (c.isalnum() or c in "-_") for c in text):
        return text
    escapes = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return '"' + "".join(escapes.get(c, c if c.isprintable() else f"\\U{ord(c):08X}") for c in text) + '"'


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and all(isinstance(e, dict) for e in value))


# ---- tables ----


def _places(tables: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The paths of all values."""
    entries = list(tables.items()) if isinstance(tables, dict) else list(enumerate(tables)) if isinstance(tables, list) else []
    paths = [(*path, key) for key, _ in entries]
    for key, inner in entries:
        paths += _places(inner, (*path, key))
    return paths


def _holder(tables: Any, path: tuple[str | int, ...]) -> Any:
    for key in path[:-1]:
        tables = tables[key]
    return tables


def _misspelt(draw: st.DrawFn, key: str) -> str:
    place = draw(st.integers(0, max(len(key) - 1, 0)))
    return draw(
        st.sampled_from(
            [key[:place] + key[place + 1 :], key.upper(), key + "s", key[:place] + "x" + key[place:], key.replace("_", "-"), ""]
        )
    )


@st.composite
def changed_tables(draw: st.DrawFn, tables: Tables, more: dict[str, Any] | None = None, most: int = MOST_CHANGES) -> Tables:
    """Tables with some keys dropped, renamed, doubled, given absurd values, or added out of ``more`` (path -> value)."""
    tables = copy.deepcopy(tables)
    for _ in range(draw(st.integers(0, most))):
        paths = _places(tables)
        if not paths:
            break
        path = draw(st.sampled_from(paths))
        at, key = _holder(tables, path), path[-1]
        what = draw(
            st.sampled_from(["value", "value", "scaled", "scaled", "dropped", "renamed", "twice", "swapped", "more", "more"])
        )
        if what == "more" and more:
            _put(tables, draw(st.sampled_from(sorted(more))), more)
        elif what == "scaled" and isinstance(at[key], int | float) and not isinstance(at[key], bool):
            at[key] = at[key] * draw(powers_of_ten)
        elif what == "dropped":
            del at[key]
        elif what == "renamed" and isinstance(at, dict):
            at[_misspelt(draw, str(key))] = at.pop(key)
        elif what == "twice" and isinstance(at, list):
            at.insert(int(key), copy.deepcopy(at[key]))
        elif what == "swapped":
            other = draw(st.sampled_from(paths))
            value = copy.deepcopy(_holder(tables, other)[other[-1]])
            at[key] = value
        else:
            at[key] = copy.deepcopy(draw(absurd_values))
    return tables


def _put(tables: Tables, path: str, more: dict[str, Any]) -> None:
    at: Any = tables
    *keys, last = path.split(".")
    for key in keys:
        at = at.setdefault(key, {}) if isinstance(at, dict) else None
        if not isinstance(at, dict):
            return
    at[last] = copy.deepcopy(more[path])


# ---- bytes ----


@st.composite
def changed_bytes(draw: st.DrawFn, raw: bytes, most: int = MOST_CHANGES) -> bytes:
    """Bytes flipped, taken out, put in, doubled, cut off, or in another encoding."""
    for _ in range(draw(st.integers(0, most))):
        if not raw:
            break
        place = draw(st.integers(0, len(raw) - 1))
        length = draw(st.sampled_from([1, 1, 2, 8, 64]))
        what = draw(st.sampled_from(["flip", "flip", "take", "put", "digit", "digit", "twice", "cut", "line", "encode"]))
        if what == "flip":
            raw = raw[:place] + bytes([raw[place] ^ (1 << draw(st.integers(0, 7)))]) + raw[place + 1 :]
        elif what == "take":
            raw = raw[:place] + raw[place + length :]
        elif what == "put":
            raw = (
                raw[:place]
                + draw(st.binary(min_size=1, max_size=8) | st.sampled_from([b"\0", b"\xff", b"[", b'"', b"\n"]))
                + raw[place:]
            )
        elif what == "digit":
            digits = [k for k in range(len(raw)) if chr(raw[k]).isdigit()] if len(raw) < 20_000 else []
            if digits:
                at = draw(st.sampled_from(digits))
                raw = (
                    raw[:at]
                    + draw(st.sampled_from([b"9", b"-1", b"0", b"99999999999", b"e9", b"nan", b".", b""]))
                    + raw[at + 1 :]
                )
        elif what == "twice":
            raw = raw[:place] + raw[place : place + length] * 2 + raw[place + length :]
        elif what == "cut":
            raw = raw[:place]
        elif what == "line":
            lines = raw.split(b"\n")
            number = draw(st.integers(0, len(lines) - 1))
            lines[number:number] = [lines[number]] * draw(st.integers(1, 3))
            raw = b"\n".join(lines)
        else:
            raw = draw(st.sampled_from(ENCODINGS))(raw)
    return raw


ENCODINGS: list[Callable[[bytes], bytes]] = [
    lambda raw: b"\xef\xbb\xbf" + raw,
    lambda raw: raw.decode("utf-8", "replace").encode("utf-16"),
    lambda raw: raw.decode("utf-8", "replace").encode("latin-1", "replace"),
    lambda raw: raw.replace(b"\n", b"\r\n"),
    lambda raw: raw.replace(b"\n", b"\r"),
    lambda raw: b"",
    lambda raw: b"\x89HDF\r\n\x1a\n" + raw,
    lambda raw: b"PK\x03\x04" + raw,
]

# ---- columns ----

Columns = list[list[str]]  # rows of cells, the header first
ABSURD_CELLS = [
    "",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "1e308",
    "1e-308",
    "-1",
    "0",
    "1e9",
    "0x10",
    "1_0",
    "1,5",
    "abc",
    '"1"',
    "١",
    " ",
    "1 2",
    "1e",
    "--1",
]


@st.composite
def changed_columns(draw: st.DrawFn, rows: Columns, most: int = MOST_CHANGES) -> bytes:
    """A CSV with cells, rows or columns changed, or another separator."""
    rows = [list(row) for row in rows]
    separator, point = ",", "."
    for _ in range(draw(st.integers(0, most))):
        what = draw(
            st.sampled_from(
                ["cell", "cell", "cell", "scaled", "row", "twice", "order", "column", "ragged", "header", "many", "dialect"]
            )
        )
        number = draw(st.integers(1, len(rows) - 1)) if len(rows) > 1 else 0
        column = draw(st.integers(0, max(len(rows[number]) - 1, 0)))
        if what == "cell" and rows[number]:
            rows[number][column] = draw(st.sampled_from(ABSURD_CELLS))
        elif what == "scaled":
            factor = draw(powers_of_ten)
            for row in rows[1:]:
                if column < len(row):
                    row[column] = _scaled(row[column], factor)
        elif what == "row" and len(rows) > 1:
            del rows[number]
        elif what == "twice":
            rows.insert(number, list(rows[number]))
        elif what == "order":
            rows[1:] = draw(st.permutations(rows[1:]))
        elif what == "column":
            for row in rows:
                del row[column : column + 1]
        elif what == "ragged":
            rows[number].append(draw(st.sampled_from(["", "1", "x"])))
        elif what == "header" and rows[0]:
            rows[0][min(column, len(rows[0]) - 1)] = draw(
                st.sampled_from(["time_s", "force_N", "", "stretch", "x" * 5000, "\x1b[2J", "Time_s"])
            )
        elif what == "many":
            rows[1:] = [[str(k), *row[1:]] for k, row in enumerate(rows[1:] * draw(st.sampled_from([10, 100, 5000])))]
        elif what == "dialect":
            separator, point = draw(st.sampled_from([(";", ","), ("\t", "."), (",", ","), (", ", "."), (" ", "."), ("|", ".")]))
    return "\n".join(separator.join(cell.replace(".", point) for cell in row) for row in rows).encode() + b"\n"


def _scaled(cell: str, factor: float) -> str:
    try:
        return f"{float(cell) * factor:.9g}"
    except ValueError:
        return cell
