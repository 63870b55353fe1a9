"""Measures that a user could have written, for test_own_measure.py."""

from __future__ import annotations

import numpy as np


def rise(result, step):
    """Of all nodes the highest displacement, mm, and whether any moved."""
    u = result.displacement(step)
    return {"most_mm": 1e3 * u[:, 2].max(), "moved": np.any(u != 0.0), "nodes": {"count": np.int64(len(u))}, "nothing": None}


def spoils(result, step):
    """Reckons in its own unit where it read."""
    u = result.displacement(step)
    u *= 1e3
    return {"most_mm": 1e3 * u[:, 2].max()}


def points(result, step):
    """Called as a built-in one is."""
    return {}


def in_words(result, step):
    """Gives a text."""
    return {"said": "high"}


def broken(result, step):
    """Asks for a field that there is not."""
    return {"gap_mm": result.field("gap", step).max()}
