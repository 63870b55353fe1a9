"""JSON schema of datasets, and of files with the same tables, for editors."""

from __future__ import annotations

import json
from typing import Any

from pydantic import BaseModel, JsonValue
from pydantic.json_schema import models_json_schema

from explicitfe.fem.inputs.bounds import with_bounds
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool

# Tables of a curve that override those of the dataset before they are validated: key -> their schema.
_MERGED: dict[str, type[BaseModel]] = {"specimen": MeasuredSpecimen, "tool": MeasuredTool, "noise": MeasuredNoise}


def schema_with_merged_tables(file: type[BaseModel]) -> dict[str, object]:
    """Return the JSON schema of a file whose [specimen], [tool] and [noise] have the keys of a dataset.

    None of their keys is required, because it may be in the table of the dataset or in that of a curve.
    """
    _, merged = models_json_schema([(table, "validation") for table in _MERGED.values()], ref_template="#/$defs/{model}")
    schema: dict[str, Any] = {**file.model_json_schema(), "$schema": "https://json-schema.org/draft/2020-12/schema"}
    definitions: dict[str, Any] = schema["$defs"]
    for owner in (schema, *definitions.values()):
        for key, table in _MERGED.items():
            stated = owner.get("properties", {}).get(key)
            if stated is not None:
                described: dict[str, JsonValue] = {"$ref": f"#/$defs/{table.__name__}"}
                owner["properties"][key] = described | {word: stated[word] for word in ("description",) if word in stated}
    for name, table in merged["$defs"].items():
        definitions[name] = {word: value for word, value in table.items() if word != "required"}
    return with_bounds(json.loads(json.dumps(schema)))
