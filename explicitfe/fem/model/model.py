"""The frozen model that a run computes: mesh, material, boundary conditions, loads, effects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from explicitfe.fem.bones.distance import DistanceField, bone_field
from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.effects.effect import MaterialEffect
from explicitfe.fem.inputs.argument import checked_fields, choice_like, finite_number, number_like
from explicitfe.fem.inputs.bounds import bounds_of
from explicitfe.fem.inputs.limits import ElementName, NotNegative
from explicitfe.fem.materials import Law
from explicitfe.fem.mesh.checked_arrays import check_range, index_array, mask_array, number_array
from explicitfe.fem.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.fem.model.attached import AirDrag, AttachedMass, FacePressure, FollowerLoad, HangingWeight, NodalForces
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.model.surface_contact import SurfaceContact
from explicitfe.platform.compiled.arrays import Springs
from explicitfe.platform.errors import InputError, shortened

PartT = TypeVar("PartT")


@dataclass(frozen=True)
class NodalLoad(NodalForces):
    """Forces of fixed direction on nodes.

    Parameters
    ----------
    name, nodes, force_N, profile : see :class:`NodalForces`.
    of_muscle : whether a muscle causes the load, so that effects of muscles, such as an activation lag, act on its profile.
    """

    of_muscle: bool = False


@dataclass(frozen=True)
class FibrePull:
    """Fibres under tension whose direction follows the deformation.

    Attributes
    ----------
    name : of the muscle.
    points : the vertices of the polyline of each fibre.
    tension_N : for each fibre (k - 1,), the tension of its segments at profile value 1, N.
    profile : activation profile.
    """

    name: str
    points: tuple[MaterialPoints, ...]
    tension_N: tuple[np.ndarray, ...]
    profile: Profile


@dataclass(frozen=True)
class FibreStress:
    """Active stress of a muscle along its fibres, P += a sigma phi(lambda) / lambda (F a0) x a0 with lambda = |F a0|.

    For a constant activation a it derives from an energy, a sigma times the integral of phi.

    Attributes
    ----------
    name : the muscle.
    elements : (k,) elements in which it acts, each once.
    direction : (k, 3) a0 of each element, unit vectors in the reference state.
    stress_Pa : (k,) sigma of each element at profile value 1, Pa.
    profile : activation profile.
    force_length : whether the stress decreases in a shortened fibre, phi = 1 - ((lambda - 1) / 0.5)^2 below 1; else phi = 1.
    of_muscle : whether effects of muscles, such as an activation lag, act on the profile.
    """

    name: str
    elements: np.ndarray
    direction: np.ndarray
    stress_Pa: np.ndarray
    profile: Profile
    force_length: bool = False
    of_muscle: bool = True


@dataclass(frozen=True)
class Inclusion:
    """Elements of another tissue, such as a graft.

    Parameters
    ----------
    elements : (k,) element numbers, each once.
    material : constants of the tissue, of the same law as the material of the model.

    Raises
    ------
    InputError : an array of another shape or type, a negative or repeated number, or no material.
    """

    elements: np.ndarray
    material: Law

    def __post_init__(self) -> None:
        object.__setattr__(self, "elements", index_array("Inclusion: elements", self.elements, None, "element", unique=True))
        _check_material("Inclusion: material", self.material)


@dataclass(frozen=True)
class Bone:
    """A rigid surface that the body may touch.

    Attributes
    ----------
    name : of the bone, for messages and results.
    field : signed distance to the surface at rest.
    surface : its triangles at rest, for pictures and measures.
    motion : rigid motion over time; fixed if left out.
    friction : coefficient of Coulomb friction.
    smooth : whether the distance is a quadratic spline, rounded over a cell of its grid, so that the force has no jumps.
    damping : damping ratio of a node of the body on the contact spring; 0 conserves the energy of an impact.
    """

    name: str
    field: DistanceField
    surface: TriangleSurface
    motion: RigidMotion | None = None
    friction: float = 0.0
    smooth: bool = False
    damping: float = 0.5

    def __post_init__(self) -> None:
        for key in ("friction", "damping"):
            number_like(f"Bone {self.name}: {key}", getattr(self, key), NotNegative, key)

    @classmethod
    def of_surface(
        cls, name: str, points_m: np.ndarray, triangles: np.ndarray, mesh: HexMesh, *, friction: float = 0.0, damping: float = 0.5
    ) -> Bone:
        """A fixed bone from a closed surface, near a body.

        Parameters
        ----------
        points_m : (n, 3) m.
        triangles : (m, 3) corners of each triangle, counter-clockwise seen from outside.
        mesh : the body that may touch it; the signed distance is computed around it.
        friction, damping : as of the bone.

        Raises
        ------
        InputError : the surface is not closed, inside out, cuts itself, or is in another unit of length; or a wrong argument.
        """
        if not isinstance(mesh, HexMesh):
            raise InputError(f"Bone {name}: mesh must be a HexMesh, not {shortened(repr(mesh))}.")
        points = number_array(f"Bone {name}: points_m", points_m, ("n", 3))
        surface = TriangleSurface(points, index_array(f"Bone {name}: triangles", triangles, len(points), "node", columns=3))
        return cls(name, bone_field(surface, f'bone "{name}"', mesh.points), surface, friction=friction, damping=damping)


@dataclass(frozen=True)
class Attachment:
    """A patch of the surface that springs attach to a bone, in proportion to its area and so independently of the mesh.

    Attributes
    ----------
    name : of the bone.
    points : (k) material points on the surface.
    areas_m2 : (k,) their tributary areas, m^2.
    stiffness_Pa_m : of the springs, force per area and length, Pa/m.
    normal_stiffness_Pa_m : along the normal of the patch, Pa/m; the same as along the patch if left out. A bone that springs
        support needs equal ones.
    bone_stiffness_N_m : of the springs that support the bone, which then moves without rotation, N/m; inf: the bone is fixed.
    motion : rigid motion of the bone over time.
    """

    name: str
    points: MaterialPoints
    areas_m2: np.ndarray
    stiffness_Pa_m: float
    bone_stiffness_N_m: float = np.inf
    motion: RigidMotion | None = None
    normal_stiffness_Pa_m: float | None = None


@dataclass(frozen=True)
class PrescribedMotion:
    """Nodes with a prescribed displacement in all three components.

    Attributes
    ----------
    nodes : (k,) node numbers.
    displacement : function of times (t,), s, that returns displacements (t, k, 3), m; zero at time 0.
    edges_s : (j,) times at which the velocity jumps, s; they are put on step boundaries.
    """

    nodes: np.ndarray
    displacement: Callable[[np.ndarray], np.ndarray]
    edges_s: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Tool:
    """A rigid tool of revolution about the z axis that moves down onto the body.

    Attributes
    ----------
    flat_radius_m : radius of its flat face; 0 for a ball, inf for a platen.
    edge_radius_m : radius of the rounding at the edge of the face.
    wall : whether the tool has a vertical wall above the rounding; otherwise the rounding continues as a sphere.
    height_m : z of its lowest point at displacement 0.
    friction : coefficient of Coulomb friction.
    nodes, weights : (k, 4), (k, 4). Contact points of the surface: nodes of the face of each point, and their shape functions.
    areas_m2 : (k,) tributary areas of the points.
    facing_m2 : (k,) the same areas where the surface faces the tool and can adhere to it, else 0.
    face_size_m : size of the faces at the edge of the tool, where the pressure is highest.
    tied : whether the points are bonded to the tool.
    tilt_rad : rotation about the y axis.
    adhesion_Pa, reach_m : adhesive stress at contact, and the distance over which it decreases to zero.
    compliance_m_N : compliance of the test rig.
    preload_N : force at which the displacement is set to zero.
    """

    flat_radius_m: float
    edge_radius_m: float
    wall: bool
    height_m: float
    friction: float
    nodes: np.ndarray
    weights: np.ndarray
    areas_m2: np.ndarray
    facing_m2: np.ndarray
    face_size_m: float
    tied: bool = False
    tilt_rad: float = 0.0
    adhesion_Pa: float = 0.0
    reach_m: float = 0.0
    compliance_m_N: float = 0.0
    preload_N: float = 0.0


@dataclass(frozen=True)
class RotationalSymmetry:
    """A sector of a body of revolution about the z axis: nodes of the far side move like their partners, rotated.

    Attributes
    ----------
    nodes, partners : (k,) node numbers.
    angle_rad : angle of the sector.
    """

    nodes: np.ndarray
    partners: np.ndarray
    angle_rad: float


@dataclass(frozen=True)
class Model:
    """What is computed: a mesh with its material, boundary conditions, loads and effects.

    A model is checked when it is created and never changes afterwards; ``dataclasses.replace`` makes a variant.

    Parameters
    ----------
    mesh : reference mesh.
    material : constants of the material law, such as ``Yeoh(C10_Pa=1037.0, C20_Pa=486.0)``.
    held : (n, 3) bool, the components of nodes that do not move; see :meth:`HexMesh.held`.
    alpha_per_s : mass-proportional (Rayleigh) damping, 1/s.
    loads : forces of fixed direction on nodes.
    pulls : muscles as tensions along fibres, whose direction follows the deformation.
    probes : name -> one point of the mesh, whose motion is recorded at every sample.
    element : "hex8", "hex8-stiffness" or "hex8-full".
    motion : nodes with a prescribed displacement.
    stiffness : (m,) factor of the moduli of each element; 1 if left out.
    effects : effects of the material in addition to its law, such as relaxation.
    tool : rigid tool that presses on the body.
    support : springs between nodes and their reference positions.
    sector : rotational symmetry, where the mesh is a sector of a body of revolution.
    copies : how many times the mesh makes up the whole body.
    stresses : muscles as active stress along their fibres.
    bones : rigid surfaces that the body may touch.
    attachments : patches of the surface that springs tie to bones.
    barrier : whether an energy barrier keeps the corners of elements from inverting in a run in time (elements/barrier.py).
    inclusions : elements of other tissues, each in one inclusion at most.
    fibres : for each muscle the lines of its fibres, for pictures.
    masses : masses that are fixed to nodes, in addition to that of the tissue.
    followers : forces on nodes that turn with the body.
    weights : weights that hang from the body on strings.
    air : drag of the air on the free surface; none if left out.
    surfaces : contact of free surfaces with each other in a run in time; they pass through each other if left out.
    pressures : pressures on faces that follow them.
    fixed : node sets that name the reaction forces of held and prescribed nodes; others are "held" and "prescribed".

    Raises
    ------
    InputError : a value outside the limits of the same key of a scenario, an array of another shape or type, or a node or element
        that is not in the mesh.
    """

    mesh: HexMesh
    material: Law
    held: np.ndarray
    alpha_per_s: float = 0.0
    loads: tuple[NodalLoad, ...] = ()
    pulls: tuple[FibrePull, ...] = ()
    probes: dict[str, MaterialPoints] = field(default_factory=dict)
    element: str = "hex8"
    motion: PrescribedMotion | None = None
    stiffness: np.ndarray | None = None
    effects: tuple[MaterialEffect, ...] = ()
    tool: Tool | None = None
    support: Springs | None = None
    sector: RotationalSymmetry | None = None
    copies: float = 1.0
    stresses: tuple[FibreStress, ...] = ()
    bones: tuple[Bone, ...] = ()
    attachments: tuple[Attachment, ...] = ()
    barrier: bool = True
    inclusions: tuple[Inclusion, ...] = ()
    fibres: tuple[tuple[MaterialPoints, ...], ...] = ()
    masses: tuple[AttachedMass, ...] = ()
    followers: tuple[FollowerLoad, ...] = ()
    weights: tuple[HangingWeight, ...] = ()
    air: AirDrag | None = None
    surfaces: SurfaceContact | None = None
    pressures: tuple[FacePressure, ...] = ()
    fixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.mesh, HexMesh):
            raise InputError(f"Model: mesh must be a HexMesh, not {shortened(repr(self.mesh))}.")
        if not self.mesh.element_count:
            raise InputError("Model: mesh has no elements.")
        _check_material("Model: material", self.material)
        hint = 'use mesh.held("NAME") for the nodes of a set'
        object.__setattr__(self, "held", mask_array("Model: held", self.held, (self.mesh.node_count, 3), hint))
        number_like("Model: alpha_per_s", self.alpha_per_s, NotNegative, "alpha_per_s")
        choice_like("Model: element", self.element, ElementName)
        if finite_number("Model: copies", self.copies) <= 0.0:
            raise InputError(f"Model: copies = {self.copies:g} is not possible: it must be above 0.")
        if self.stiffness is not None:
            self._check_stiffness(bounds_of("stiffness").smallest)
        for name, annotation in get_type_hints(Model).items():
            kind, *others = get_args(annotation) or (object,)
            value = getattr(self, name)
            if not isinstance(kind, type) or kind in (object, str, np.ndarray):
                continue
            if get_origin(annotation) is tuple:
                object.__setattr__(self, name, _tuple_of(f"Model: {name}", value, kind))
            elif others == [type(None)] and not isinstance(value, kind | None):
                raise InputError(f"Model: {name} must be a {kind.__name__}, not {shortened(repr(value))}.")
        self._check_nodes_and_elements()
        self._check_inclusions()
        self.mesh.held(*self.fixed)  # refuses unknown names

    def _check_stiffness(self, smallest: float) -> None:
        stiffness = number_array("Model: stiffness", self.stiffness, (self.mesh.element_count,))
        if stiffness.min() < smallest:
            worst = stiffness.argmin()
            raise InputError(f"Model: stiffness of element {worst} is {stiffness[worst]:g}; it must be {smallest:g} or more.")
        object.__setattr__(self, "stiffness", stiffness)

    def _check_nodes_and_elements(self) -> None:
        """Refuse loads, muscles and probes on nodes or elements that the mesh does not have."""
        nodes, elements = self.mesh.node_count, self.mesh.element_count
        for name in ("loads", "masses", "followers", "weights", "pressures"):
            for number, part in enumerate(getattr(self, name)):
                check_range(f"Model: {name}[{number}]", part.nodes, nodes, "node")
        if self.motion is not None:
            check_range("Model: motion", index_array("Model: motion", self.motion.nodes, nodes, "node"), nodes, "node")
        for number, stress in enumerate(self.stresses):
            check_range(f"Model: stresses[{number}]", stress.elements, elements, "element")
        for number, pull in enumerate(self.pulls):
            for points in pull.points:
                check_range(f"Model: pulls[{number}]", points.element, elements, "element", smallest=-1)
        for number, tie in enumerate(self.attachments):
            check_range(f"Model: attachments[{number}]", tie.points.element, elements, "element")
        if not isinstance(self.probes, Mapping) or not all(isinstance(one, MaterialPoints) for one in self.probes.values()):
            raise InputError("Model: probes must be a dictionary from names to points, such as mesh.named_points.")
        for name, point in self.probes.items():
            check_range(f'Model: probes["{name}"]', point.element, elements, "element")

    def _check_inclusions(self) -> None:
        taken = np.zeros(self.mesh.element_count, dtype=bool)
        for number, part in enumerate(self.inclusions):
            name = f"Model: inclusions[{number}]"
            check_range(name, part.elements, self.mesh.element_count, "element")
            if taken[part.elements].any():
                element = part.elements[taken[part.elements]][0]
                raise InputError(f"{name}: element {element} is in another inclusion too; give each element once.")
            taken[part.elements] = True
            own, law = part.material.law, self.material.law
            if own != law:
                raise InputError(f"{name}: its law is {own} and that of the model {law}; use the same law for both.")

    def in_elements(self, of: Callable[[Law], float | tuple[float, ...]]) -> np.ndarray:
        """A property of the material in each element, without ``stiffness``.

        Parameters
        ----------
        of : function of the constants of a tissue, such as ``lambda tissue: tissue.density_kg_m3``.

        Returns
        -------
        (m,), or (m, k) where ``of`` returns a tuple.
        """
        values = np.tile(np.array(of(self.material), dtype=float), (self.mesh.element_count, 1))
        for part in self.inclusions:
            values[part.elements] = of(part.material)
        return values if isinstance(of(self.material), tuple) else values[:, 0]


def _check_material(name: str, material: object) -> None:
    if not isinstance(material, Law):
        raise InputError(f"{name} must hold the constants of a law, such as Yeoh(...), not {shortened(repr(material))}.")
    checked_fields(name, material)


def _tuple_of(name: str, values: object, kind: type[PartT]) -> tuple[PartT, ...]:
    if isinstance(values, (kind, str)) or not isinstance(values, Iterable):
        raise InputError(f"{name} must be a list or a tuple of {kind.__name__}, not {shortened(repr(values))}.")
    parts = tuple(values)
    for number, part in enumerate(parts):
        if not isinstance(part, kind):
            raise InputError(f"{name}[{number}] must be a {kind.__name__}, not {shortened(repr(part))}.")
    return parts
