"""Tables of keys from JSON schemas: one section per table of the file, one row per key."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from explicitfe.fem.inputs.bounds import BOUNDS, bounds_of

Schema = Mapping[str, Any]
_NUMBERS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "`true` or `false`", "null": "`null`"}


class KeyTables:
    """Markdown tables of a JSON schema.

    Parameters
    ----------
    schema : JSON schema of an object, with its ``$defs``.
    toml : whether it describes a TOML file, with tables such as ``[model]`` and ``[[muscle]]``.
    """

    def __init__(self, schema: Schema, toml: bool) -> None:
        self.definitions: Schema = schema.get("$defs", {})
        self.schema = schema
        self.toml = toml

    def markdown(self, title: str = "Top level", level: int = 2) -> str:
        """Sections of all tables, in the order in which they appear."""
        waiting: list[tuple[str, str, Schema]] = [(title, "", self._resolved(self.schema))]
        shown: set[str] = set()
        sections = []
        while waiting:
            heading, path, table = waiting.pop(0)
            body = json.dumps(table, sort_keys=True)
            if body in shown:
                continue
            shown.add(body)
            rows, inner = self._rows(path, table)
            waiting[:0] = inner
            words = table.get("description", "").partition("\n\n")[0].replace("\n", " ")
            lines = [f"{'#' * level} {heading}", "", _plain(words), ""] if words else [f"{'#' * level} {heading}", ""]
            if rows:
                lines += ["| key | values | default | meaning |", "|---|---|---|---|", *rows, ""]
            sections.append("\n".join(lines))
        return "\n".join(sections)

    def _rows(self, path: str, table: Schema) -> tuple[list[str], list[tuple[str, str, Schema]]]:
        rows, inner = [], []
        required = set(table.get("required", ()))
        for key, value in table.get("properties", {}).items():
            place = f"{path}.{key}" if path else key
            for kind, is_list in self._tables_of(value):
                name = kind.get("properties", {}).get("law", {}).get("const")
                head = f"[[{place}]]" if is_list else f"[{place}]"
                heading = f"`{head if self.toml else place}`" + (f", law `{name}`" if name else "")
                inner.append((heading, place, kind))
            default = "required" if key in required else _default(value)
            words = value.get("description") or self._resolved(value).get("description", "").partition("\n\n")[0]
            rows.append(f"| `{key}` | {self._values(value, key)} | {default} | {_plain(_without_bounds(words))} |")
        return rows, inner

    def _resolved(self, value: Schema) -> Schema:
        return self.definitions[value["$ref"].rpartition("/")[2]] if "$ref" in value else value

    def _alternatives(self, value: Schema) -> Iterator[Schema]:
        for choice in value.get("anyOf", value.get("oneOf", [value])):
            resolved = self._resolved(choice)
            if resolved is not value and ("anyOf" in resolved or "oneOf" in resolved):
                yield from self._alternatives(resolved)
            else:
                yield resolved

    def _tables_of(self, value: Schema) -> Iterator[tuple[Schema, bool]]:
        """Tables that a key can hold, and whether it holds a list of them."""
        for choice in self._alternatives(self._resolved(value)):
            if choice.get("properties"):
                yield choice, False
            elif choice.get("type") == "array" and isinstance(choice.get("items"), dict):
                yield from ((entry, True) for entry in self._alternatives(choice["items"]) if entry.get("properties"))
            elif isinstance(choice.get("additionalProperties"), dict):
                yield from self._tables_of(choice["additionalProperties"])

    def _values(self, value: Schema, key: str) -> str:
        words = [self._value(choice, key) for choice in self._alternatives(self._resolved(value)) if choice.get("type") != "null"]
        return " or ".join(dict.fromkeys(words))

    def _value(self, value: Schema, key: str) -> str:
        if "const" in value:
            return f"`{json.dumps(value['const'], ensure_ascii=False)}`"
        if "enum" in value:
            return ", ".join(f"`{json.dumps(entry, ensure_ascii=False)}`" for entry in value["enum"])
        if value.get("properties"):
            return "a table, see below"
        if value.get("type") == "array":
            if "prefixItems" in value:
                return f"[{', '.join(self._values(entry, key) for entry in value['prefixItems'])}]"
            return f"list of: {self._values(value.get('items', {}), key)}"
        if value.get("type") == "object":
            entries = value.get("additionalProperties")
            return f"a table by name of: {self._values(entries, key)}" if isinstance(entries, dict) else "a table"
        kinds = value.get("type", "")
        words = " or ".join(_NUMBERS.get(kind, "any") for kind in (kinds if isinstance(kinds, list) else [kinds]))
        for limit, sign in (
            ("exclusiveMinimum", "above"),
            ("minimum", "from"),
            ("maximum", "up to"),
            ("exclusiveMaximum", "below"),
        ):
            if limit in value and abs(value[limit]) < bounds_of(key).largest:
                words += f" {sign} {value[limit]:g}"
        return words


def _default(value: Schema) -> str:
    default = value.get("default")
    if default in (None, "", [], {}) or isinstance(default, dict):
        return ""
    return f"`{json.dumps(default, ensure_ascii=False)}`"


def _without_bounds(words: str) -> str:
    """A description without the bounds that are common to all keys of its unit."""
    for bounds in BOUNDS.values():
        words = words.replace(f" ({bounds.reason})", "").replace(bounds.reason, "")
    return words


def _plain(words: str) -> str:
    """Text of a docstring for a table cell."""
    return " ".join(words.split()).replace("``", "`").replace("|", "\\|")
