"""Surgery on a model: resection, grafts, and scars next to them.

Call::

    surgery = surgery_of(scenario, mesh, material)   # None where the scenario has no such table
    stress = surgery.left_of_stress(stress)          # what is left of a muscle, in the numbering of the intact mesh
    pull = surgery.left_of_lines(pull, fibres)
    model = operated(model, surgery)                 # in the numbering of what is left

An element belongs to a region if its centre lies in it, so the cut runs along faces of elements. First the resections take
elements out, then grafts put tissue without muscle where the body was, also where it was just taken out; then scars stiffen what
is left of the old tissue beside both.

A muscle as stress keeps the field of the intact muscle in the elements that are still muscle, with the same stress: a fibre that
was cut draws together what is left of it on either side of the cut, as tissue that contracts does, and its force is not shared
out anew. A muscle as forces along lines has no such parts: a line that is cut anywhere pulls no more, and the others pull as
before.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
import scipy

from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh, MaterialPoints, inner_faces, shape_functions, shape_gradients
from explicitfe.fem.mesh.muscle_lines import Fibre, locate_in_mesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.triangles import triangle_distance
from explicitfe.fem.model.model import Attachment, FibrePull, FibreStress, Inclusion, Model
from explicitfe.platform.errors import InputError
from explicitfe.results.documents.run_summary import SurgeryReport
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.surgery import RegionTable, ScarTable
from explicitfe.simulate.scenario.transient import TransientScenario

# A corner counts for a point of an element if its shape function is above this: else the point lies on a face or edge without it.
_SHARE_OF_A_CORNER = 1e-9

# An element is sampled at so many points a scar's thickness along its longest edge, within these bounds.
_SAMPLES_PER_THICKNESS = 2.0
_FEWEST_AND_MOST_SAMPLES = (4, 12)

# A line is looked at so many times a mean edge of the elements.
_LOOKS_PER_ELEMENT = 4.0

# Areas, and numbers of samples, that differ by less are the same.
_CUT_TOLERANCE = 1e-9

# The nearest triangles of a wound are looked for among so many whose centres are nearest.
_NEAREST_TRIANGLES_TRIED = 16


@dataclass(frozen=True)
class Surgery:
    """What is done to the elements of an intact mesh.

    Attributes
    ----------
    mesh : the intact mesh.
    kept : (m,) bool. Elements of the body afterwards, with its grafts.
    grafted : (m,) bool. Elements of grafts.
    scarred : (m,) the share of each element's volume that is a scar.
    stiffness : (m,) what a scar or a graft's ratio multiplies the moduli by.
    inclusions : the grafts with constants of their own.
    """

    mesh: HexMesh
    kept: np.ndarray
    grafted: np.ndarray
    scarred: np.ndarray
    stiffness: np.ndarray
    inclusions: tuple[Inclusion, ...]

    @property
    def muscular(self) -> np.ndarray:
        """(m,) bool. Elements where muscles are as they were."""
        return self.kept & ~self.grafted

    def left_of_stress(self, stress: FibreStress) -> FibreStress:
        """The stress of a muscle in the elements where it is left, as it was there."""
        left = self.muscular[stress.elements]
        return replace(stress, elements=stress.elements[left], direction=stress.direction[left], stress_Pa=stress.stress_Pa[left])

    def left_of_part(self, part: Inclusion) -> Inclusion:
        """The elements of another material, without those removed or replaced."""
        return replace(part, elements=part.elements[self.muscular[part.elements]])

    def left_of_lines(self, pull: FibrePull, fibres: Sequence[Fibre] | None = None) -> FibrePull:
        """The lines that run through muscle all along, as they were; where they join points of ``fibres``, these have to."""
        whole = [
            self.moved(line, self.muscular)[1].all() and (fibres is None or self.in_muscle(fibres[number].points).all())
            for number, line in enumerate(pull.points)
        ]
        return replace(pull, points=tuple(compress(pull.points, whole)), tension_N=tuple(compress(pull.tension_N, whole)))

    def in_muscle(self, line: MaterialPoints) -> np.ndarray:
        """Which segments (k - 1,) of a line run through muscle all along, looked at several times in each element they cross.

        Those that begin or end in space do.
        """
        inside = line.element >= 0
        tissue = np.flatnonzero(inside[:-1] & inside[1:])
        start, step = line.position[:-1][tissue], np.diff(line.position, axis=0)[tissue]
        size = np.cbrt(volumes(self.mesh.points, self.mesh.hexes).mean())
        counts = np.ceil(_LOOKS_PER_ELEMENT * np.linalg.norm(step, axis=1) / size).astype(int)
        segment = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[segment]
        places = start[segment] + share[:, None] * step[segment]
        outside = ~self.muscular[locate_in_mesh(self.mesh, places, tolerance=np.inf).element]
        whole = np.ones(len(line) - 1, dtype=bool)
        whole[tissue[segment[outside]]] = False
        return whole

    def moved(self, points: MaterialPoints, among: np.ndarray) -> tuple[MaterialPoints, np.ndarray]:
        """Material points in the elements ``among`` (m,) alone, and which of them, (k,) bool, lie in these.

        A point on a face, an edge or a corner of another element lies in its neighbour too. Points fixed in space stay.
        """
        element, natural = points.element.copy(), points.natural.copy()
        inside = (element < 0) | among[element]
        for k in np.flatnonzero(~inside):
            weights = shape_functions(natural[k])
            at = weights > _SHARE_OF_A_CORNER
            nodes = self.mesh.hexes[element[k]][at]
            neighbours = np.flatnonzero(among & (np.isin(self.mesh.hexes, nodes).sum(axis=1) == len(nodes)))
            if len(neighbours):
                element[k] = neighbours[0]
                corner = [int(np.flatnonzero(self.mesh.hexes[neighbours[0]] == node)[0]) for node in nodes]
                natural[k] = weights[at] @ CORNERS[corner]
                inside[k] = True
        return MaterialPoints(element, natural, points.position), inside


def surgery_of(
    scenario: TransientScenario, mesh: HexMesh, material: Law, element_sets: Mapping[str, np.ndarray]
) -> Surgery | None:
    """What the tables ``[[resection]]``, ``[[graft]]`` and ``[scar]`` do; None where there is none of them.

    Raises
    ------
    InputError : a region without an element, nothing or several pieces left, a graft of another law, a scar that is too thin.
    """
    if not scenario.resection and not scenario.graft:
        return None
    count = mesh.element_count
    kept, grafted = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    stiffness = np.ones(count)
    for number, resection in enumerate(scenario.resection, 1):
        kept[_region(resection, f"resection {number}", mesh, element_sets)] = False
    tissue = np.zeros(count, dtype=np.int64)  # number of the graft that an element belongs to; the last one has it
    for number, graft in enumerate(scenario.graft, 1):
        tissue[_region(graft, f"graft {number}", mesh, element_sets)] = number
    grafted = tissue > 0
    kept |= grafted
    inclusions = []
    for number, graft in enumerate(scenario.graft, 1):
        own = np.flatnonzero(tissue == number)
        if graft.stiffness_ratio is not None:
            stiffness[own] = graft.stiffness_ratio
            continue
        assert graft.material is not None  # the schema has checked that one of the two is given
        law = catalogue.material(graft.material)
        if law.law != material.law:
            raise InputError(
                f'graft {number}: its material has the law "{law.law}", that of the model "{material.law}"; use constants '
                "of the same law, or stiffness_ratio."
            )
        inclusions.append(Inclusion(own, law))

    pairs, nodes = inner_faces(mesh.hexes)
    _check_whole(mesh, kept, pairs)
    native = kept & ~grafted
    scarred = np.zeros(count)
    if scenario.scar is not None:
        wound = nodes[native[pairs[:, 0]] != native[pairs[:, 1]]]
        scarred = _scar_shares(mesh, native, wound, scenario.scar)
        stiffness *= 1.0 + (scenario.scar.stiffness_ratio - 1.0) * scarred
    return Surgery(mesh, kept, grafted, scarred, stiffness, tuple(inclusions))


def _region(table: RegionTable, what: str, mesh: HexMesh, element_sets: Mapping[str, np.ndarray]) -> np.ndarray:
    """The elements (m,) bool of a region."""
    centre = 1e3 * mesh.points[mesh.hexes].mean(axis=1)
    inside = np.ones(mesh.element_count, dtype=bool)
    if table.box_mm is not None:
        low, high = np.array(table.box_mm)
        inside &= ((centre >= low) & (centre <= high)).all(axis=1)
    if table.sphere is not None:
        inside &= np.linalg.norm(centre - table.sphere.centre_mm, axis=1) <= table.sphere.radius_mm
    if table.plane is not None:
        inside &= (centre - table.plane.point_mm) @ np.array(table.plane.normal) > 0.0
    if table.set is not None and table.set in element_sets:
        inside &= np.isin(np.arange(mesh.element_count), element_sets[table.set])
    elif table.set is not None:
        inside &= np.isin(mesh.hexes, mesh.nodes_of(table.set)).all(axis=1)
    if not inside.any():
        low, high = centre.min(axis=0), centre.max(axis=0)
        raise InputError(
            f"{what} selects no element: no element centre is in the region; the centres lie between {_in_mm(low)} and "
            f"{_in_mm(high)} mm."
        )
    return inside


def _check_whole(mesh: HexMesh, kept: np.ndarray, pairs: np.ndarray) -> None:
    """Refuse a body that is gone, or has come apart."""
    if not kept.any():
        raise InputError("the resections remove every element of the mesh; make their regions smaller.")
    count, label = _pieces(kept, pairs)
    if count > _pieces(np.ones_like(kept), pairs)[0]:
        sizes = np.bincount(label)
        smallest = np.flatnonzero(kept)[label == sizes.argmin()]
        centre = 1e3 * mesh.points[mesh.hexes[smallest]].mean(axis=(0, 1))
        raise InputError(
            f"the resections leave {count} pieces that share no face; remove the smaller one too "
            f"({sizes.min()} of {kept.sum()} elements, around {_in_mm(centre)} mm), or cut elsewhere."
        )


def _pieces(kept: np.ndarray, pairs: np.ndarray) -> tuple[int, np.ndarray]:
    """How many pieces faces join the kept elements into, and the piece (k,) of each of them."""
    number = np.cumsum(kept) - 1
    joined = number[pairs[kept[pairs].all(axis=1)]]
    size = int(kept.sum())
    graph = scipy.sparse.coo_array((np.ones(len(joined), dtype=bool), (joined[:, 0], joined[:, 1])), shape=(size, size))
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return int(count), label


def _in_mm(place: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.1f}" for value in place) + ")"


def _scar_shares(mesh: HexMesh, native: np.ndarray, wound: np.ndarray, scar: ScarTable) -> np.ndarray:
    """The share (m,) of the volume of each element of the old tissue that lies within a scar's thickness of the wound.

    Parameters
    ----------
    native : (m,) bool. Elements of the old tissue.
    wound : (f, 4) nodes of the faces at which it ends.
    """
    thickness = 1e-3 * scar.thickness_mm
    shares = np.zeros(mesh.element_count)
    if len(wound):
        x = mesh.points[wound]
        middle = np.broadcast_to(x.mean(axis=1, keepdims=True), x.shape)
        triangles = np.stack([x, np.roll(x, -1, axis=1), middle], axis=2).reshape(-1, 3, 3)
        tree, tried = scipy.spatial.cKDTree(triangles.mean(axis=1)), min(_NEAREST_TRIANGLES_TRIED, len(triangles))
        reach = thickness + np.linalg.norm(np.ptp(triangles, axis=1), axis=1).max()
        corners = mesh.points[mesh.hexes]
        size = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
        near = np.flatnonzero(native & (tree.query(corners.mean(axis=1))[0] <= reach + size))
        longest = np.ptp(corners[near], axis=1).max(initial=0.0)
        count = int(np.clip(np.ceil(_SAMPLES_PER_THICKNESS * longest / thickness - _CUT_TOLERANCE), *_FEWEST_AND_MOST_SAMPLES))
        at = (2.0 * np.arange(count) + 1.0) / count - 1.0
        natural = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3)
        for element in near:
            places = shape_functions(natural) @ corners[element]
            volume = np.linalg.det(np.einsum("ai,qaj->qij", corners[element], shape_gradients(natural)))
            nearest = tree.query(places, k=tried)[1].reshape(len(places), tried)
            distance = np.min([triangle_distance(places, triangles[column]) for column in nearest.T], axis=0)
            shares[element] = volume @ (distance <= thickness) / volume.sum()
    if not shares.any():
        raise InputError(
            f"scar: no tissue lies within {scar.thickness_mm:g} mm of a cut or a graft, judged by the element centres of "
            "this mesh; increase thickness_mm, or remove the table."
        )
    return shares


def operated(intact: Model, surgery: Surgery) -> Model:
    """The model after surgery, of a model whose muscles are already those that are left.

    Nodes of no element go, and with them what acts on them; named points and patches of bone that lose their elements go too.
    """
    mesh, kept = intact.mesh, surgery.kept
    element_number = np.cumsum(kept) - 1
    node_kept = np.zeros(mesh.node_count, dtype=bool)
    node_kept[mesh.hexes[kept]] = True
    node_number = np.cumsum(node_kept) - 1

    def points_left(points: MaterialPoints, among: np.ndarray = kept) -> tuple[MaterialPoints, np.ndarray]:
        points, left = surgery.moved(points, among)
        element = np.where(points.element[left] < 0, -1, element_number[points.element[left]])
        return MaterialPoints(element, points.natural[left], points.position[left]), left

    def named(points: dict[str, MaterialPoints]) -> dict[str, MaterialPoints]:
        moved = {name: points_left(point) for name, point in points.items()}
        return {name: point for name, (point, left) in moved.items() if left.all()}

    def pieces(line: MaterialPoints) -> Iterator[MaterialPoints]:
        """What is left of a fibre: runs of its points that muscle joins."""
        points, left = points_left(line, surgery.muscular)
        run = np.cumsum(~np.append(True, surgery.in_muscle(line)))[left]
        for number in np.unique(run):
            of_run = run == number
            if of_run.sum() > 1:
                yield MaterialPoints(points.element[of_run], points.natural[of_run], points.position[of_run])

    def attachment(tie: Attachment) -> Attachment:
        points, left = points_left(tie.points)
        return replace(tie, points=points, areas_m2=tie.areas_m2[left])

    sets = {name: node_number[nodes[node_kept[nodes]]] for name, nodes in mesh.node_sets.items()}
    before = np.ones(mesh.element_count) if intact.stiffness is None else np.where(surgery.grafted, 1.0, intact.stiffness)
    stiffness = (before * surgery.stiffness)[kept]
    ties = [attachment(tie) for tie in intact.attachments]
    return replace(
        intact,
        mesh=HexMesh(mesh.points[node_kept], node_number[mesh.hexes[kept]], sets, named(mesh.named_points)),
        held=intact.held[node_kept],
        loads=tuple(replace(load, nodes=node_number[load.nodes]) for load in intact.loads if len(load.nodes)),
        pulls=tuple(
            replace(pull, points=tuple(points_left(line, surgery.muscular)[0] for line in pull.points))
            for pull in intact.pulls
            if pull.points
        ),
        stresses=tuple(
            replace(stress, elements=element_number[stress.elements]) for stress in intact.stresses if len(stress.elements)
        ),
        attachments=tuple(tie for tie in ties if len(tie.areas_m2)),
        stiffness=stiffness if (stiffness != 1.0).any() else None,
        inclusions=tuple(
            replace(part, elements=element_number[part.elements])
            for part in (*map(surgery.left_of_part, intact.inclusions), *surgery.inclusions)
            if len(part.elements)
        ),
        probes=named(intact.probes),
        fibres=tuple(tuple(piece for line in lines for piece in pieces(line)) for lines in intact.fibres),
    )


def surgery_report(
    surgery: Surgery, intact: Model, after: Model, muscles: Sequence[tuple[FibreStress | FibrePull, FibreStress | FibrePull]]
) -> SurgeryReport:
    """What surgery took, in numbers and sentences.

    Parameters
    ----------
    intact, after : the model before and after it.
    muscles : each as it was and as it is left, in the numbering of the intact mesh.
    """
    mesh = intact.mesh
    volume = volumes(mesh.points, mesh.hexes)
    had: defaultdict[str, float] = defaultdict(float)
    left: defaultdict[str, float] = defaultdict(float)
    notes = []
    for before, now in muscles:
        had[before.name] += _work(before, volume)
        left[before.name] += _work(now, volume)
        if isinstance(before, FibrePull) and isinstance(now, FibrePull) and len(now.points) < len(before.points):
            lines = len(before.points)
            notes.append(
                f"{lines - len(now.points)} of the {lines} lines along which {before.name} pulls run through removed or replaced "
                "tissue; they are cut and do not pull."
            )
    gone = [name for name in intact.probes if name not in after.probes]
    if gone:
        notes.append(f"the removed tissue contained the point{'s' * (len(gone) > 1)} {', '.join(gone)}, not recorded.")
    areas = {tie.name: 1e6 * tie.areas_m2.sum() for tie in after.attachments}
    for tie in intact.attachments:
        area = 1e6 * tie.areas_m2.sum()
        if areas.get(tie.name, 0.0) < area * (1.0 - _CUT_TOLERANCE):
            notes.append(f"{areas.get(tie.name, 0.0):.0f} of {area:.0f} mm2 of the attachment {tie.name} remain.")
    return {
        "removed_elements": int((~surgery.kept).sum()),
        "removed_mm3": float(1e9 * volume[~surgery.kept].sum()),
        "graft_elements": int(surgery.grafted.sum()),
        "graft_mm3": float(1e9 * volume[surgery.grafted].sum()),
        "scar_mm3": float(1e9 * (volume @ surgery.scarred)),
        "muscle_loss_percent": {name: 100.0 * (1.0 - left[name] / work) for name, work in had.items() if work > 0.0},
        "notes": notes,
    }


def _work(muscle: FibreStress | FibrePull, volume: np.ndarray) -> float:
    """Work [N m] of a muscle in a uniform contraction, over the shortening: stress times volume, or tension times length."""
    if isinstance(muscle, FibreStress):
        return float(muscle.stress_Pa @ volume[muscle.elements])
    return sum(
        float(tension @ np.linalg.norm(np.diff(line.position, axis=0), axis=1))
        for line, tension in zip(muscle.points, muscle.tension_N, strict=True)
    )
