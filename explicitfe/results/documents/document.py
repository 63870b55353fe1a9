"""A JSON document as a type: attributes for code, and the keys of the file for whoever reads it as a mapping."""

from __future__ import annotations

import json
from collections.abc import KeysView
from typing import Annotated

from pydantic import BaseModel, JsonValue, WithJsonSchema

Computed = Annotated[float, WithJsonSchema({"type": ["number", "null"]})]
"""A number that may come out not finite; JSON has no such numbers, and null stands for them."""


class Document(BaseModel):
    """What a command answers and writes; ``answer.verdict`` and ``answer["verdict"]`` are the same.

    Only keys that were set are written.
    """

    @property
    def document(self) -> dict[str, JsonValue]:
        """The document as JSON has it: dictionaries, lists, numbers and texts."""
        return self.model_dump(exclude_unset=True)

    @property
    def text(self) -> str:
        """The text of the file."""
        return json.dumps(self.document, indent=1, allow_nan=False) + "\n"

    def __getitem__(self, key: str) -> JsonValue:
        return self.document[key]

    def __contains__(self, key: object) -> bool:
        return key in self.model_fields_set

    def get(self, key: str, default: JsonValue = None) -> JsonValue:
        """The value of a key, or the default where it was not set."""
        return self.document.get(key, default)

    def keys(self) -> KeysView[str]:
        """The keys that were set."""
        return self.document.keys()
