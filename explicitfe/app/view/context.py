"""What is drawn around a built-in tongue without touching it: lips, hyoid bone, epiglottis and larynx.

The shapes are data of a model, ``models/tongue/context.toml``; a result names its model and stores nothing of them.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from explicitfe.app.view.context_shapes import Mouth, Opening, lip, read_context, still_part, triangles_between_rings
from explicitfe.app.view.mouth import is_mouth
from explicitfe.app.view.palette import BONE, CARTILAGE, LIP
from explicitfe.platform.host.shipped import folder_of
from explicitfe.results.files import Result
from explicitfe.results.measure.airway import airway_table
from explicitfe.results.measure.formants import lips_at
from explicitfe.results.measure.sections import X, Z, midsagittal

PART_COLOURS = {"upper-lip": LIP, "lower-lip": LIP, "hyoid-bone": BONE, "epiglottis": CARTILAGE, "larynx": CARTILAGE}
HYOID = "hyoid"  # what carries epiglottis and larynx; no bone of a result, but a set of nodes of the tongue
ROOT_M = 0.006  # the part of the outline of the tongue less than this before its rearmost point


class ContextPart(NamedTuple):
    """A closed surface at a sample: ``points`` (k, 3) m, ``triangles`` (m, 3), and its colour."""

    points: np.ndarray
    triangles: np.ndarray
    colour: str


def context_of(result: Result, step: int) -> dict[str, ContextPart]:
    """The parts around a built-in tongue at a sample, by name; a lip only where the bone is that it moves with."""
    path, parts = _file_of(result), {}
    if path is None:
        return {}
    mouth, tables = read_context(path)
    for name, table in tables.items():
        bone = table.moves_with
        if table.profile_mm and bone not in result.bones:
            continue
        rings = lip(mouth, table.profile_mm, _opening(result, step, mouth)) if table.profile_mm else still_part(path, name)
        points, triangles = 1e-3 * rings.reshape(-1, 3), triangles_between_rings(*rings.shape[:2], is_ring=table.wall_mm > 0.0)
        rotation, shift = (np.eye(3), _hyoid_shift(result, step)) if bone == HYOID else result.placement(bone, step)
        if table.follows_root_mm is not None:
            shift = _shifts_with_root(result, step, points, shift, table.follows_root_mm)
        points = points @ rotation.T + shift
        a, b, c = np.moveaxis(points[triangles], 1, 0)
        is_outwards = np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0
        parts[name] = ContextPart(points, triangles if is_outwards else triangles[:, ::-1], PART_COLOURS[name])
    return parts


def _file_of(result: Result) -> Path | None:
    """The file of the model of a result, or of the one that it is based on; None for another body or an unknown model."""
    name = result.model.get("scenario", {}).get("model", {}).get("name")
    geometries = {path.parent.name: path for path in folder_of("models").glob("*/geometry.toml")} if is_mouth(result) else {}
    while name in geometries:
        path = geometries[name].with_name("context.toml")
        if path.is_file():
            return path
        name = tomllib.loads(geometries[name].read_text(encoding="utf-8")).get("based_on")
    return None


def _opening(result: Result, step: int, mouth: Mouth) -> Opening:
    """The opening of the lips with which the airway ends at a sample."""
    area, length = lips_at(result, float(result.times[step]), airway_table(result))
    rotation, shift = result.placement("jaw", step)
    at_jaw = 1e-3 * np.array([mouth.incisor_mm, 0.0, mouth.middle_mm])
    return Opening(area, length, sunk=-1e3 * float((rotation @ at_jaw + shift - at_jaw)[Z]))


def _hyoid_shift(result: Result, step: int) -> np.ndarray:
    """How far the hyoid bone has moved (3,) m, where springs hold it: the mean of the nodes that are attached to it."""
    if not result.model["scenario"].get("hyoid") or HYOID not in result.mesh.node_sets:
        return np.zeros(3)
    shift: np.ndarray = result.displacement(step)[result.mesh.node_sets[HYOID]].mean(axis=0)
    return shift


def _shifts_with_root(
    result: Result, step: int, points: np.ndarray, shift: np.ndarray, heights_mm: tuple[float, float]
) -> np.ndarray:
    """Shifts (k, 3) m of points: that of the hyoid bone up to a height, that of the root of the tongue there above another."""
    cut = midsagittal(result.mesh)
    outline, moved = cut.at(result.mesh.points), cut.at(result.displacement(step))
    root = np.flatnonzero(outline[:, X] > outline[:, X].max() - ROOT_M)
    root = root[np.argsort(outline[root, Z])]
    at_height = np.column_stack([np.interp(points[:, Z], outline[root, Z], component[root]) for component in moved.T])
    return shift + np.interp(1e3 * points[:, [Z]], heights_mm, [0.0, 1.0]) * (at_height - shift)
