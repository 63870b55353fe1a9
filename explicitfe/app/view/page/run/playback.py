"""Data of the animation of a page: surface, displacements, bones, named points and fields, as one compact binary block.

Displacements are whole numbers of a step of 5 µm or of 1/32000 of the largest one, each stored as its change since the frame
before, and the whole is deflated: a second of a tongue is some hundred kilobytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from typing_extensions import TypedDict

from explicitfe.app.view.context import context_of
from explicitfe.app.view.mouth import Teeth, drawn_bones, is_mouth, teeth_of
from explicitfe.app.view.page.run.packed import Packed
from explicitfe.app.view.page.run.speech import fibre_points, pack_contact, pack_leak, pack_muscles
from explicitfe.app.view.page.run.tool import tool_of
from explicitfe.app.view.smooth import SmoothSurface
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.results.documents.run_summary import kind_of
from explicitfe.results.files import Result, StoredBone
from explicitfe.results.measure.sections import PlaneCut, Y, cut_surface, middle, section

# A page plays at most so many frames of a run, and fewer of a large mesh, so that all results together have this size unpacked.
MOST_FRAMES = 240
FEWEST_FRAMES = 12
UNPACKED_BYTES = 12_000_000
# Displacements are rounded to this: less than a pixel.
ROUNDING_MM = 0.005
CONTEXT_ROUNDING_MM = 0.02
LARGEST_STORED_NUMBER = 32000
# A field is told apart in so many steps between its smallest and its largest value.
FIELD_STEPS = 255
BYTES_OF_A_NODE = 6
# So much is shown around the outline: bones go on beyond the picture.
AROUND_OUTLINE_SHARE = 0.12
# Around a tongue bones are shown up to this distance, so that the air from the larynx to the lips is seen.
BONES_AROUND_OUTLINE_MM = 18.0


class PackedBone(TypedDict):
    """A bone in the header of the data: whether it moves, and the loops of its midsagittal section at rest, x and z in mm."""

    name: str
    moves: bool
    outlines: list[list[list[float]]]


def playback(result: Result, last: int, share: float = 1.0) -> str:
    """The data of the animation of a result up to a sample.

    Parameters
    ----------
    last : the last step, whose displacements are finite.
    share : of the size that a page may have, where it shows several results.
    """
    mesh, packed, is_loaded = result.mesh, Packed(), kind_of(result.model) == "relaxation"
    plane_m = _plane(result)
    nodes, faces = _surface(mesh, plane_m)
    fields = _scalar_fields(result)
    steps = _steps(last, _bytes_per_frame(result, len(nodes)), share)
    moved = 1e3 * np.stack([result.displacement(step)[nodes] for step in steps])
    rounding_mm = max(ROUNDING_MM, float(np.abs(moved).max(initial=0.0)) / LARGEST_STORED_NUMBER)
    whole = np.round(moved / rounding_mm).astype(np.int32)
    changes = np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))
    packed.add("times", np.arange(len(steps)) if is_loaded else 1e3 * result.times[steps], "<f4")
    packed.add("points", 1e3 * mesh.points[nodes], "<f4")
    quads, part = np.concatenate([*faces.values()]), np.repeat(np.arange(len(faces)), [len(each) for each in faces.values()])
    names = list(faces)
    smooth = SmoothSurface.of(
        mesh.points[nodes], quads, (part == names.index("cut")).astype(int), levels=1, round_edges=is_mouth(result)
    )
    # Coordinate by coordinate, each over all nodes: neighbours are alike, which packs well. What wraps around here does so there.
    packed.add("moved", changes.transpose(0, 2, 1), "<i2")
    for number, name in enumerate(names):
        packed.add(f"faces_{name}", _triangles(smooth.quads[part[smooth.face] == number]), "<u4")
    on_skin = np.isin(smooth.lines, smooth.quads[smooth.group == 0]).all(axis=1)
    packed.add("edges", smooth.lines[on_skin], "<u4")
    for number, matrix in enumerate(smooth.steps):
        for key, values, kind in (
            ("begin", matrix.indptr, "<u4"),
            ("column", matrix.indices, "<u4"),
            ("weight", matrix.data, "<f4"),
        ):
            packed.add(f"smooth_{key}_{number}", values, kind)
    named = [_pack_field(packed, result, name, steps, nodes) for name in fields]
    cut = section(mesh, Y, plane_m)
    if len(cut.ends):
        packed.add("cut_ends", np.searchsorted(nodes, cut.ends), "<u4")
        packed.add("cut_share", cut.share, "<f4")
    bones = [_pack_bone(packed, result, name, bone, steps, plane_m) for name, bone in drawn_bones(result).items()]
    header: dict[str, object] = {
        "moments": _loads(result, steps) if is_loaded else None,
        "indentation": (1e3 * result.history("indentation")[steps]).tolist() if is_loaded else None,
        "outline_box": _outline_box(cut, mesh, moved, nodes, bones if is_mouth(result) else []),
        "plane_mm": 1e3 * plane_m,
        "electrodes": pack_contact(packed, result, steps) if is_mouth(result) else None,
        "leak": pack_leak(packed, result, steps),
        "muscles": pack_muscles(packed, result, steps, rounding_mm),
        "rounding_mm": rounding_mm,
        # A tissue surface is smooth; a specimen has edges, which are seen only where faces stay flat.
        "smooth": not is_loaded,
        "loops": [loop.tolist() for loop in cut.loops],
        "fields": [entry for entry in named if entry is not None],
        "bones": bones,
        "teeth": [_pack_teeth(packed, name, teeth) for name, teeth in teeth_of(result).items()],
        "context": _pack_context(packed, result, steps),
        "smooth_steps": len(smooth.steps),
        "round": is_mouth(result),
        "points": [_pack_point(packed, result, name, steps) for name in result.mesh.named_points],
        "tool": tool_of(packed, result, steps),
    }
    return packed.text(header)


def frame_count(result: Result, last: int, share: float = 1.0) -> int:
    """Number of frames of a result in :func:`playback`."""
    return len(_steps(last, _bytes_per_frame(result, len(_surface(result.mesh, _plane(result))[0])), share))


def _bytes_per_frame(result: Result, node_count: int) -> int:
    """Size of a frame with so many nodes of the surface, unpacked."""
    fibres = fibre_points(result)
    carried = 0 if fibres is None else len(fibres[1].reference)
    return node_count * (BYTES_OF_A_NODE + len(_scalar_fields(result))) + carried * BYTES_OF_A_NODE


def _steps(last: int, bytes_per_frame: int, share: float) -> np.ndarray:
    """The stored steps that are played, evenly over all up to the last, both ends among them."""
    most = int(np.clip(share * UNPACKED_BYTES / bytes_per_frame, FEWEST_FRAMES, MOST_FRAMES))
    return np.unique(np.round(np.linspace(0, last, min(most, last + 1))).astype(int))


def _plane(result: Result) -> float:
    """The y (m) of the plane that cuts the body: the midsagittal one, or that through the axis of the tool."""
    return 0.0 if kind_of(result.model) == "relaxation" else middle(result.mesh)


def _surface(mesh: HexMesh, plane_m: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Nodes of the surface and of the cut, and its faces by those nodes' places.

    The faces are those of the speaker's left and right, and "cut": those inside the body that elements of the right share with
    elements of the left.
    """
    right = mesh.points[mesh.hexes, Y].mean(axis=1) >= plane_m
    element, face = free_faces(mesh.hexes)
    outside = mesh.hexes[element[:, None], FACES[face]]
    parts = {"left": outside[~right[element]], "right": outside[right[element]], "cut": np.zeros((0, 4), dtype=np.int64)}
    if right.any() and not right.all():
        own = mesh.hexes[right]
        element_of_half, face_of_half = free_faces(own)
        half = own[element_of_half[:, None], FACES[face_of_half]]
        known = {tuple(corners) for corners in np.sort(parts["right"], axis=1).tolist()}
        inside = np.array([tuple(corners) not in known for corners in np.sort(half, axis=1).tolist()], dtype=bool)
        parts["cut"] = half[inside]
    nodes = np.unique(np.concatenate([quads.ravel() for quads in parts.values()]))
    return nodes, {name: np.searchsorted(nodes, quads) for name, quads in parts.items()}


def _triangles(quads: np.ndarray) -> np.ndarray:
    """Two triangles a quad, without those that have no area as an edge is collapsed."""
    pairs = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    distinct = (pairs[:, 0] != pairs[:, 1]) & (pairs[:, 1] != pairs[:, 2]) & (pairs[:, 2] != pairs[:, 0])
    triangles: np.ndarray = pairs[distinct]
    return triangles


def _scalar_fields(result: Result) -> list[str]:
    """Fields that a surface can be coloured by; the speed stands for the velocity."""
    return [name for name, info in result.fields.items() if info.quantity.components == 1 or name == "velocity"]


def _pack_field(packed: Packed, result: Result, name: str, steps: np.ndarray, nodes: np.ndarray) -> dict[str, object] | None:
    """Add a field at the nodes; None for a constant field."""
    kind, quantity = result.fields[name]
    values = np.stack([_at_nodes(result, name, kind, step, nodes) for step in steps])
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    if not high > low:
        return None
    scaled = np.nan_to_num(np.round((values - low) / (high - low) * FIELD_STEPS)).astype(np.uint8)
    packed.add(f"field_{name}", np.diff(scaled, axis=0, prepend=np.zeros_like(scaled[:1])), "<u1")
    label = "speed" if name == "velocity" else name.replace("_", " ")
    label = {"J": "volume ratio J"}.get(name, label)
    factor, unit = {"m/s": (1e3, "mm/s")}.get(quantity.unit, (1.0, quantity.unit))
    return {"name": name, "label": label, "unit": "" if unit == "1" else unit, "low": factor * low, "high": factor * high}


def _at_nodes(result: Result, name: str, kind: str, step: int, nodes: np.ndarray) -> np.ndarray:
    """A scalar at the nodes; of elements, the mean over those at a node."""
    values = result.field(name, int(step))
    if kind == "point":
        at: np.ndarray = values[nodes] if values.ndim == 1 else np.linalg.norm(values[nodes], axis=1)
        return at
    mesh = result.mesh
    corners = mesh.hexes.ravel()
    mean: np.ndarray = np.bincount(corners, np.repeat(values, 8), mesh.node_count)[nodes]
    return mean / np.bincount(corners, minlength=mesh.node_count)[nodes]


def _loads(result: Result, steps: np.ndarray) -> list[str]:
    """Force and displacement of a tool in each frame, in words."""
    force, depth = result.history("force")[steps], 1e3 * result.history("indentation")[steps]
    return [f"{f:.3g} N at {u:.3g} mm" for f, u in zip(force, depth, strict=True)]


def _outline_box(
    cut: PlaneCut, mesh: HexMesh, moved_mm: np.ndarray, nodes: np.ndarray, bones: Sequence[PackedBone]
) -> list[float] | None:
    """Where the outline is in all frames, with ``bones`` around it: lowest and highest x, and lowest and highest z, mm."""
    if not len(cut.ends):
        return None
    at_rest, on_surface = 1e3 * cut.at(mesh.points), np.searchsorted(nodes, np.unique(cut.ends))
    swept = moved_mm[:, on_surface]
    around = np.array([point for bone in bones for loop in bone["outlines"] for point in loop]).reshape(-1, 2)
    box = []
    for number, axis in enumerate((0, 2)):
        low = at_rest[:, axis].min() + min(0.0, swept[..., axis].min())
        high = at_rest[:, axis].max() + max(0.0, swept[..., axis].max())
        room = AROUND_OUTLINE_SHARE * (high - low)
        if len(around):
            low = min(low, max(around[:, number].min(), low - BONES_AROUND_OUTLINE_MM))
            high = max(high, min(around[:, number].max(), high + BONES_AROUND_OUTLINE_MM))
            room = 0.0
        box += [round(float(low - room), 2), round(float(high + room), 2)]
    return box


def _pack_bone(packed: Packed, result: Result, name: str, bone: StoredBone, steps: np.ndarray, plane_m: float) -> PackedBone:
    """Add a bone: its surface at rest, where it is in each frame if it moves, and its midsagittal section at rest."""
    packed.add(f"bone_{name}_points", 1e3 * bone.points, "<f4")
    packed.add(f"bone_{name}_triangles", bone.triangles, "<u4")
    moves = f"bone_{name}_placement" in result.history_names
    if moves:
        placements = [np.append(rotation, 1e3 * shift) for rotation, shift in (result.placement(name, int(s)) for s in steps)]
        packed.add(f"bone_{name}_placement", np.array(placements), "<f4")
    cut = cut_surface(bone.triangles, bone.points[:, Y] - plane_m)
    return {"name": name, "moves": moves, "outlines": list(_outlines(cut, 1e3 * bone.points))}


def _pack_teeth(packed: Packed, bone: str, teeth: Teeth) -> str:
    """Add the teeth of a bone, which move with it."""
    packed.add(f"teeth_{bone}_points", 1e3 * teeth.points, "<f4")
    packed.add(f"teeth_{bone}_triangles", teeth.triangles, "<u4")
    return bone


def _pack_context(packed: Packed, result: Result, steps: np.ndarray) -> list[dict[str, object]]:
    """Add what is drawn around a tongue: surfaces in the first frame, and the changes from frame to frame of those that move."""
    frames, parts = [context_of(result, int(step)) for step in steps], []
    for name, part in frames[0].items():
        packed.add(f"context_{name}_points", 1e3 * part.points, "<f4")
        packed.add(f"context_{name}_triangles", part.triangles, "<u4")
        moved = 1e3 * np.stack([frame[name].points - part.points for frame in frames])
        whole = np.round(moved / CONTEXT_ROUNDING_MM).astype(np.int32)
        if whole.any():
            changes = np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))
            packed.add(f"context_{name}_moved", changes.transpose(0, 2, 1), "<i2")
        parts.append({"name": name, "colour": part.colour, "moves": bool(whole.any()), "rounding_mm": CONTEXT_ROUNDING_MM})
    return parts


def _outlines(cut: PlaneCut, points: np.ndarray) -> Iterator[list[list[float]]]:
    """The loops of a cut as points back and up."""
    at = cut.at(points)
    for loop in cut.loops:
        yield np.round(at[loop][:, [0, 2]], 2).tolist()


def _pack_point(packed: Packed, result: Result, name: str, steps: np.ndarray) -> dict[str, object]:
    """Add where a named point is in each frame."""
    point = result.mesh.named_points[name]
    packed.add(f"point_{name}", 1e3 * (point.position[0] + result.probe(name)[steps]), "<f4")
    in_plane = abs(float(point.position[0, Y]) - middle(result.mesh)) < 1e-3 * float(np.ptp(result.mesh.points[:, Y]))
    return {"name": name, "in_plane": bool(in_plane)}
