"""How deep a body goes into the surfaces around it: those that push it, and those that the model knows but the scenario omits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.bones.surface import TriangleSurface, depth_inside
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.fem.model.model import Bone
from explicitfe.platform.compiled.arrays import BONE_DEPTH, Samples
from explicitfe.simulate.run.quantities import pairs_of

# The rounding of the tables of the bones. The contact pressures of speech, up to 4 kPa, give a penetration of 0.05 mm.
# Faces under an edge of bone go deeper than nodes.
CROSSING_WARNING_M, NODE_WARNING_M = 5e-4, 3e-4
# Points of a face whose depth behind a drawn surface is looked at, along each edge; and the deepest of them in the rounded one
# that are measured: an edge of bone lies nowhere by more than 0.6 mm above its rounding.
LOOKED_AT_ALONG_EDGE, MEASURED_POINTS, MOST_ROUNDED_M = 5, 16, 6e-4
# Depth of a body in another one, in mean edges of the finer surface, from which a run warns, and from which it is broken off.
DEPTH_WARNING_EDGES, DEPTH_LIMIT_EDGES = 0.1, 0.5


@dataclass(frozen=True)
class Crossing:
    """The deepest point of a body in a surface, beyond its depth there at rest.

    Attributes
    ----------
    place_m : (3,) m; None where it is not known.
    displacement : (n, 3) m. Of the nodes then; None where it is not known any more, of a run that was resumed.
    """

    depth_m: float = 0.0
    time_s: float = 0.0
    place_m: np.ndarray | None = None
    displacement: np.ndarray | None = None


def behind_surface(
    mesh: HexMesh, bone: Bone, displacement: np.ndarray, time_s: float, along_edge: int = LOOKED_AT_ALONG_EDGE
) -> Crossing:
    """The deepest of the nodes and points of faces behind the surface of a bone as it is drawn.

    Parameters
    ----------
    displacement : (n, 3) m. Of the nodes at the time.
    along_edge : points along each edge of a face; 2 for nodes alone.
    """
    element, face = free_faces(mesh.hexes)
    quads = mesh.hexes[element[:, None], FACES[face]]
    steps = np.linspace(0.0, 1.0, along_edge)
    r, s = (at.ravel() for at in np.meshgrid(steps, steps, indexing="ij"))
    share = np.array([(1.0 - r) * (1.0 - s), r * (1.0 - s), r * s, (1.0 - r) * s])
    present = mesh.points + displacement
    at_rest, now = (np.einsum("ap,fak->fpk", share, points[quads]).reshape(-1, 3) for points in (mesh.points, present))

    def local(points: np.ndarray, at_s: float) -> np.ndarray:
        if bone.motion is None:
            return points
        rotation, shift = bone.motion.placement(np.array([at_s]))
        return np.asarray((points - shift[0]) @ rotation[0])

    places = local(now, time_s), local(at_rest, 0.0)
    rounded = [np.maximum(MOST_ROUNDED_M - bone.field.at(points)[0], 0.0) for points in places]
    beyond = rounded[0] - rounded[1]
    deepest = np.argsort(-beyond)[:MEASURED_POINTS]
    deepest = deepest[beyond[deepest] > 0.0]
    if not len(deepest):
        return Crossing()
    depths = depth_inside(bone.surface, places[0][deepest]) - depth_inside(bone.surface, places[1][deepest])
    k = int(np.argmax(depths))
    return Crossing(max(float(depths[k]), 0.0), time_s, now[deepest[k]])


@dataclass
class Crossings:
    """The deepest crossings of a run.

    Attributes
    ----------
    mesh : of the body.
    bones : the surfaces in contact, of which every sample counts.
    omitted : name -> surface that the scenario omits; the last state alone counts, because its distance is searched for.
    bodies : name of each body in contact -> mean edge of its surface, m.
    deepest : bone, or names of two bodies -> its crossing.
    """

    mesh: HexMesh
    bones: tuple[Bone, ...]
    omitted: Mapping[str, TriangleSurface]
    bodies: Mapping[str, float]
    deepest: dict[str, Crossing] = field(default_factory=dict)

    def _add_pairs(self, times_s: np.ndarray, depth: np.ndarray) -> str:
        for a, b, name, edge_m in self._pairs():
            k = int(np.argmax(depth[:, a, b]))
            if depth[k, a, b] > self.deepest.get(name, Crossing()).depth_m:
                self.deepest[name] = Crossing(float(depth[k, a, b]), float(times_s[k]))
            if depth[k, a, b] > DEPTH_LIMIT_EDGES * edge_m:
                return (
                    f"at {1e3 * times_s[k]:.3f} ms the surface of {name} is {1e3 * depth[k, a, b]:.2g} mm deep, more than half "
                    f"of an edge ({1e3 * edge_m:.2g} mm): the forces or speeds are too large for the tissue; reduce them and "
                    "check their units."
                )
        return ""

    def add(self, times_s: np.ndarray, samples: Samples, count: int) -> str:
        """Add the first samples; give a sentence if a body has gone through another one or through itself, else "".

        Parameters
        ----------
        times_s : (count,) s.
        """
        for number, bone in enumerate(self.bones):
            depth = samples.contact[:count, number, BONE_DEPTH]
            k = int(np.argmax(depth))
            if depth[k] > self.deepest.get(bone.name, Crossing()).depth_m:
                self.deepest[bone.name] = Crossing(float(depth[k]), float(times_s[k]), None, samples.displacement[k].copy())
        return self._add_pairs(times_s, samples.pairs[:count])

    def restore(self, rows: Mapping[str, np.ndarray]) -> None:
        """Take over what the history of an interrupted run says."""
        for bone in self.bones:
            depth = rows[f"contact_{bone.name}_depth"]
            if len(depth) and depth.max() > 0.0:
                self.deepest[bone.name] = Crossing(float(depth.max()), float(rows["time"][np.argmax(depth)]))
        for (_, _, name, _), (_, _, column) in zip(self._pairs(), pairs_of([*self.bodies]), strict=True):
            depth = rows.get(column, np.zeros(0))
            if len(depth):
                self.deepest[name] = Crossing(float(depth.max()), float(rows["time"][np.argmax(depth)]))

    def _pairs(self) -> Iterator[tuple[int, int, str, float]]:
        """Numbers of each pair of bodies, the pair in words, and the mean edge of the finer one, m."""
        names, edges_m = [*self.bodies], [*self.bodies.values()]
        for a, b, _ in pairs_of(names):
            words = f'"{names[a]}" in itself' if a == b else f'"{names[a]}" and "{names[b]}" in each other'
            yield a, b, words, min(edges_m[a], edges_m[b])

    def warnings(self, displacement: np.ndarray, time_s: float) -> list[str]:
        """Sentences on surfaces that the body has crossed, with its last displacement (n, 3) m."""
        sentences = []
        for _, _, name, edge_m in self._pairs():
            one = self.deepest.get(name, Crossing())
            if one.depth_m > DEPTH_WARNING_EDGES * edge_m:
                sentences.append(
                    f"the surface of {name} is up to {1e3 * one.depth_m:.2g} mm deep, at {1e3 * one.time_s:.0f} ms: more than a "
                    f"tenth of an edge ({1e3 * edge_m:.2g} mm); refine the mesh, raise contact.stiffness_kPa_per_mm, or reduce "
                    "the forces."
                )
        for bone in self.bones:
            one = of_nodes = self.deepest.get(bone.name, Crossing())
            if (u := one.displacement) is not None:  # contact is with a surface whose edges are rounded
                of_nodes = behind_surface(self.mesh, bone, u, one.time_s, 2)
                one = behind_surface(self.mesh, bone, u, one.time_s)
            if one.depth_m > CROSSING_WARNING_M or of_nodes.depth_m > NODE_WARNING_M:
                one = max(one, of_nodes, key=lambda crossing: crossing.depth_m)
                sentences.append(
                    f'the body goes {1e3 * one.depth_m:.1f} mm deep into "{bone.name}"{_near(one)} at {1e3 * one.time_s:.0f} ms: '
                    "the forces are too large for the contact springs, or the mesh is too coarse for an edge of the bone; reduce "
                    "the forces or gravity_m_s2 and check their units, or refine the mesh."
                )
        moved = np.linalg.norm(displacement, axis=1) > CROSSING_WARNING_M  # no other node can be so much deeper than at rest
        nodes = np.flatnonzero((surface_areas(self.mesh) > 0.0) & moved)
        for name, surface in self.omitted.items():
            depths = depth_inside(surface, self.mesh.points[nodes] + displacement[nodes])
            crossed = np.flatnonzero(depths > CROSSING_WARNING_M)
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
