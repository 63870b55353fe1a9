"""Contact with bones: areas, pressures and forces, of each bone and of nine cells across and along it."""

from __future__ import annotations

from typing import get_args

import numpy as np

from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.results.files import Recorded
from explicitfe.results.measure.document import BoneContact, ContactPart, Depth, Side
from explicitfe.results.measure.motion import unsigned_zero
from explicitfe.results.measure.sections import X, Y, Z, middle

# The midline is free where no node within this distance of the midsagittal plane touches.
MIDLINE_BAND_M = 3e-3
SIDES: tuple[Side, ...] = get_args(Side)
DEPTHS: tuple[Depth, ...] = get_args(Depth)


def contacts(result: Recorded, step: int) -> dict[str, BoneContact]:
    """Contact with each bone whose pressure is stored, by the name of the bone."""
    stored = [name for name in result.bones if f"contact_pressure_{name}" in result.fields]
    if not stored:
        return {}
    areas = surface_areas(result.mesh)
    return {name: _contact(result, step, name, areas) for name in stored}


def _contact(result: Recorded, step: int, bone: str, areas: np.ndarray) -> BoneContact:
    pressure = np.maximum(result.field(f"contact_pressure_{bone}", step), 0.0)
    touched = pressure > 0.0
    # Cells belong to the bone and move with it.
    rotation, shift = result.placement(bone, step)
    position = (result.mesh.points + result.displacement(step) - shift) @ rotation
    corners = result.bones[bone].points
    low, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    third = np.clip((3.0 * (position - low) / extent).astype(np.int64), 0, 2)
    off_plane = np.abs(position[:, Y] - middle(result.mesh))
    whole = _part(areas, pressure, touched)
    force = _force_on_body(result, step, bone)
    return BoneContact(
        **whole.model_dump(),
        resultant_N=None if force is None else float(np.linalg.norm(force)),
        peak_kPa=1e-3 * float(pressure.max()),
        midline_free=not np.any(touched & (off_plane < MIDLINE_BAND_M)),
        forward_N=None if force is None else unsigned_zero(-force[X]),
        up_N=None if force is None else unsigned_zero(force[Z]),
        right_N=None if force is None else unsigned_zero(force[Y]),
        cells={
            side: {
                depth: _part(areas, pressure, touched & (third[:, Y] == across) & (third[:, X] == along))
                for along, depth in enumerate(DEPTHS)
            }
            for across, side in enumerate(SIDES)
        },
    )


def _part(areas: np.ndarray, pressure: np.ndarray, touched: np.ndarray) -> ContactPart:
    area, force = float(areas[touched].sum()), float((areas * pressure)[touched].sum())
    return ContactPart(area_mm2=1e6 * area, force_N=force, mean_kPa=1e-3 * force / area if area > 0.0 else 0.0)


def _force_on_body(result: Recorded, step: int, bone: str) -> np.ndarray | None:
    """Resultant force of a bone on the body at a step (3,) N; None where the run did not store it."""
    name = f"contact_{bone}_force"
    if name not in result.history_names:
        return None
    row = int(np.argmin(np.abs(result.history("time") - result.times[step])))
    return result.history(name)[row]
