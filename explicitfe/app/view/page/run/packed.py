"""Arrays in one block of text that a page carries."""

from __future__ import annotations

import json
import zlib
from base64 import b64encode

import numpy as np

# More compression takes ten times as long, and makes the block no smaller.
COMPRESSION_LEVEL = 6


class Packed:
    """Arrays in one block of bytes, with where each of them is."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        self.places: dict[str, list[int | str]] = {}

    def add(self, name: str, values: np.ndarray, kind: str) -> None:
        """Add an array as numbers of a kind, such as ``<f4``: its place is [kind, first byte, count]."""
        data = np.ascontiguousarray(values, dtype=kind).tobytes()
        self.places[name] = [kind, self._size, int(np.size(values))]
        data += bytes(-len(data) % 4)
        self._parts.append(data)
        self._size += len(data)

    def text(self, header: dict[str, object]) -> str:
        """Header and arrays, deflated, in base 64: its alphabet needs no escaping anywhere in a page."""
        words = json.dumps({**header, "arrays": self.places}).encode()
        words += b" " * (-len(words) % 4)
        block = np.uint32(len(words)).astype("<u4").tobytes() + words + b"".join(self._parts)
        return b64encode(zlib.compress(block, COMPRESSION_LEVEL)).decode()
