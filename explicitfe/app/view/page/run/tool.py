"""The tool of an indentation as a surface that a page shows above the specimen."""

from __future__ import annotations

import numpy as np

from explicitfe.app.view.indentation import tool_outline
from explicitfe.app.view.page.run.packed import Packed
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result

FACETS_AROUND = 48
# The tool is shown up to this share of the specimen's height above it.
SHOWN_ABOVE_SHARE = 0.35


def tool_of(packed: Packed, result: Result, steps: np.ndarray) -> dict[str, object] | None:
    """Add the tool of an indentation, turned around the axis, and its height in each frame; None for a run in time."""
    if kind_of(result.model) != "relaxation" or "indentation" not in result.history_names:
        return None
    points = 1e3 * result.mesh.points
    height, radius = float(points[:, 2].max()), float(np.abs(points[:, :2]).max())
    profile = tool_outline(result.model["tool"], 0.0, SHOWN_ABOVE_SHARE * height, 1.1 * radius)
    angles = np.linspace(0.0, 2.0 * np.pi, FACETS_AROUND, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = np.concatenate(
        [np.repeat(profile[:, None, :1], FACETS_AROUND, 1) * around, np.repeat(profile[:, None, 1:], FACETS_AROUND, 1)], -1
    )
    number = np.arange(len(profile) * FACETS_AROUND).reshape(len(profile), FACETS_AROUND)
    lower, upper = number[:-1], number[1:]
    after, above = np.roll(lower, -1, axis=1), np.roll(upper, -1, axis=1)
    quads = np.stack([lower, after, above, upper], axis=-1).reshape(-1, 4)
    packed.add("tool_points", rings.reshape(-1, 3), "<f4")
    packed.add("tool_triangles", quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), "<u4")
    lowest = height - 1e3 * result.history("indentation")[steps] - float(result.summary.get("touch_mm") or 0.0)
    packed.add("tool_heights", lowest, "<f4")
    outline = np.concatenate([profile[::-1] * [-1.0, 1.0], profile])
    return {"outline": np.round(outline, 3).tolist()}
