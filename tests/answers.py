"""Whether an answer of a command is what its JSON schema says: nothing missing, and nothing that the schema does not name."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match
from support import ROOT

SCHEMAS = ROOT / "docs" / "json"


def check_answer(name: str, text: str) -> dict[str, Any]:
    """Validate what ``explicitfe NAME --json`` printed; give it."""
    answer: dict[str, Any] = json.loads(text)
    _validator(name, closed=False).validate(answer)
    if "failure" in answer:
        _check("failure", {"failure": answer["failure"]})
    document = {key: value for key, value in answer.items() if key != "failure"}
    if document or "failure" not in answer:
        # Schemas let a later version add keys; here a key that they do not name is a key that nobody has typed.
        _check(name, document)
    return answer


def _check(name: str, document: dict[str, Any]) -> None:
    fault = best_match(_validator(name, closed=True).iter_errors(document))
    assert fault is None, f"answer of {name}, {fault.json_path}: {fault.message[:500]}"


@cache
def _validator(name: str, closed: bool) -> Draft202012Validator:
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    if closed:
        schema.pop("properties", None) if "anyOf" in schema else None
        _close(schema)
    return Draft202012Validator(schema)


def _close(part: Any) -> None:
    if isinstance(part, dict):
        if "properties" in part and part.get("type") == "object":
            part.setdefault("additionalProperties", False)
        for inner in part.values():
            _close(inner)
    elif isinstance(part, list):
        for inner in part:
            _close(inner)
