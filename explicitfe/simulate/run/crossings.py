"""How deep a body goes into the surfaces around it: those that push it, and those that the model knows but the scenario omits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.bones.surface import TriangleSurface, depth_inside
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.fem.model.model import Bone
from explicitfe.platform.compiled.arrays import BONE_DEPTH

# The rounding of the tables of the bones. The contact pressures of speech, up to 3 kPa, give a penetration of 0.15 mm.
CROSSING_WARNING_M = 5e-4


@dataclass(frozen=True)
class Crossing:
    """The deepest point of a body in a surface, beyond its depth there at rest.

    Attributes
    ----------
    place_m : (3,) m; None where it is not known any more, of a run that was resumed.
    """

    depth_m: float = 0.0
    time_s: float = 0.0
    place_m: np.ndarray | None = None


@dataclass
class Crossings:
    """The deepest crossings of a run.

    Attributes
    ----------
    mesh : of the body.
    bones : the surfaces in contact, of which every sample counts.
    omitted : name -> surface that the scenario omits; the last state alone counts, because its distance is searched for.
    deepest : bone -> its crossing.
    """

    mesh: HexMesh
    bones: tuple[Bone, ...]
    omitted: Mapping[str, TriangleSurface]
    deepest: dict[str, Crossing] = field(default_factory=dict)

    def add(self, times_s: np.ndarray, displacement: np.ndarray, contact: np.ndarray, pressure: np.ndarray) -> None:
        """Look at samples: displacements (k, n, 3) m, sums of contact (k, bones, ...) and pressures (k, bones, n) Pa."""
        for number, bone in enumerate(self.bones):
            depth = contact[:, number, BONE_DEPTH]
            k = int(np.argmax(depth))
            if depth[k] > self.deepest.get(bone.name, Crossing()).depth_m:
                node = int(np.argmax(pressure[k, number]))
                place = self.mesh.points[node] + displacement[k, node]
                self.deepest[bone.name] = Crossing(float(depth[k]), float(times_s[k]), place)

    def restore(self, rows: Mapping[str, np.ndarray]) -> None:
        """Take over what the history of an interrupted run says."""
        for bone in self.bones:
            depth = rows[f"contact_{bone.name}_depth"]
            if len(depth) and depth.max() > 0.0:
                self.deepest[bone.name] = Crossing(float(depth.max()), float(rows["time"][np.argmax(depth)]))

    def warnings(self, displacement: np.ndarray, time_s: float) -> list[str]:
        """Sentences on surfaces that the body has crossed, with its last displacement (n, 3) m."""
        sentences = []
        for name, one in self.deepest.items():
            if one.depth_m > CROSSING_WARNING_M:
                sentences.append(
                    f'the body goes {1e3 * one.depth_m:.1f} mm deep into "{name}"{_near(one)} at {1e3 * one.time_s:.0f} ms: the '
                    "forces are too large for the contact springs; reduce them or gravity_m_s2, and check their units."
                )
        nodes = np.flatnonzero(surface_areas(self.mesh) > 0.0)
        for name, surface in self.omitted.items():
            depths = depth_inside(surface, self.mesh.points[nodes] + displacement[nodes])
            crossed = np.flatnonzero(depths > 0.0)
            if not len(crossed):
                continue
            beyond = depths[crossed] - depth_inside(surface, self.mesh.points[nodes[crossed]])
            deepest = int(np.argmax(beyond))
            if beyond[deepest] > CROSSING_WARNING_M:
                node = nodes[crossed[deepest]]
                one = Crossing(float(beyond[deepest]), time_s, self.mesh.points[node] + displacement[node])
                sentences.append(
                    f'the body goes {1e3 * one.depth_m:.1f} mm through "{name}"{_near(one)} at the end, which the scenario '
                    f'omits; add [[bone]] name = "{name}".'
                )
        return sentences


def _near(one: Crossing) -> str:
    return "" if one.place_m is None else " near (" + ", ".join(f"{1e3 * x:.0f}" for x in one.place_m) + ") mm"
