"""Answers as JSON text for programs."""

from __future__ import annotations

import json
import math


def json_text(value: object) -> str:
    """One JSON value; JSON has no NaN and no infinity, so those become null."""
    return json.dumps(_finite(value), indent=2, allow_nan=False)


def _finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
