"""The frozen model that a run computes: mesh, material, what is held, what pulls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from explicitfe.bones.distance import DistanceField
from explicitfe.bones.motion import RigidMotion
from explicitfe.bones.surface import TriangleSurface
from explicitfe.compiled.arrays import Springs
from explicitfe.effects.effect import MaterialEffect
from explicitfe.materials import Law
from explicitfe.mesh.hexmesh import HexMesh, MaterialPoints
from explicitfe.model.profile import Profile


@dataclass(frozen=True)
class NodalLoad:
    """Forces of fixed direction on nodes.

    Attributes
    ----------
    name : what a user calls it.
    nodes : (k,) node numbers.
    force_N : (k, 3) N at profile value 1.
    profile : its course in time.
    of_muscle : a muscle pulls, so that the muscle's own dynamics shape the course.
    """

    name: str
    nodes: np.ndarray
    force_N: np.ndarray
    profile: Profile
    of_muscle: bool = False


@dataclass(frozen=True)
class FibrePull:
    """Tense fibres whose direction follows the deformation.

    Attributes
    ----------
    name : the muscle.
    points : one MaterialPoints per fibre, the vertices of its polyline.
    tension_N : one (k - 1,) array per fibre, the tension of each segment at profile value 1.
    profile : its course in time.
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
    elements : (k,) the elements that it acts in, each once.
    direction : (k, 3) a0 of each, unit vectors in the reference state.
    stress_Pa : (k,) sigma of each at profile value 1.
    profile : its course in time.
    force_length : whether the stress falls off in a shortened fibre, phi = 1 - ((lambda - 1) / 0.5)^2 below 1; else phi = 1.
    of_muscle : the muscle's own dynamics shape the course.
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

    Attributes
    ----------
    elements : (k,) element numbers.
    material : its constants, of the same law as those of the model.
    """

    elements: np.ndarray
    material: Law


@dataclass(frozen=True)
class Bone:
    """A rigid surface that the body can rest on.

    Attributes
    ----------
    name : what a user calls it.
    field : signed distance of the surface at rest.
    surface : its triangles at rest, for pictures and measures.
    motion : how it moves; not at all if left out.
    friction : Coulomb's coefficient.
    """

    name: str
    field: DistanceField
    surface: TriangleSurface
    motion: RigidMotion | None = None
    friction: float = 0.0


@dataclass(frozen=True)
class Attachment:
    """A patch of the surface that springs tie to a bone, in proportion to its area: so it does not depend on the mesh.

    Attributes
    ----------
    name : the bone.
    points : (k) material points on the surface.
    areas_m2 : (k,) that each stands for.
    stiffness_Pa_m : of the tie, a force per area and per length [Pa/m].
    bone_stiffness_N_m : of the springs that hold the bone itself, which then moves without turning; inf: it is fixed.
    motion : how the bone moves.
    """

    name: str
    points: MaterialPoints
    areas_m2: np.ndarray
    stiffness_Pa_m: float
    bone_stiffness_N_m: float = np.inf
    motion: RigidMotion | None = None


@dataclass(frozen=True)
class PrescribedMotion:
    """Nodes that follow a given course in all three components.

    Attributes
    ----------
    nodes : (k,) node numbers.
    displacement : function of times (t,) s that gives displacements (t, k, 3) m; zero at time 0.
    """

    nodes: np.ndarray
    displacement: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Tool:
    """A rigid tool of revolution about the z axis that comes down on the body.

    Attributes
    ----------
    flat_radius_m : radius of its flat face; 0 for a ball, inf for a platen.
    edge_radius_m : radius of the rounding that begins there.
    wall : whether a vertical wall stands above the rounding; without, the rounding goes on as a ball.
    height_m : z of its lowest point at displacement 0.
    friction : Coulomb's coefficient.
    nodes, weights : (k, 4), (k, 4). Points of the surface that it may touch: the nodes of the face that each lies in, and their
        shape functions there.
    areas_m2 : (k,) that each point stands for.
    facing_m2 : (k,) the same areas where the surface faces the tool and can stick to it, else 0.
    face_size_m : size of the faces at its edge, where it presses hardest.
    tied : whether the points are bonded to it.
    tilt_rad : how far it leans about the y axis.
    adhesion_Pa, reach_m : the stress with which it holds what touches it, falling to nothing within the reach.
    compliance_m_N : how far the rig gives way under a force of 1 N.
    preload_N : the force at which displacements begin to count.
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
    """A sector of a body of revolution about the z axis: nodes on its far side move as their partners on the near one, turned.

    Attributes
    ----------
    nodes, partners : (k,) node numbers.
    angle_rad : of the sector.
    """

    nodes: np.ndarray
    partners: np.ndarray
    angle_rad: float


@dataclass(frozen=True)
class Model:
    """Physics of one run.

    Attributes
    ----------
    mesh : reference mesh [m].
    material : constants of the material law.
    held : (n, 3) bool. Components of nodes that do not move.
    alpha_per_s : mass-proportional damping.
    element : "hex8", "hex8-stiffness" or "hex8-full".
    loads, pulls : what acts on it.
    stresses : muscles as stress along their fibres.
    bones : rigid surfaces that it may touch.
    attachments : patches of its surface that bones hold.
    motion : nodes that are moved.
    effects : of the material, beside its law.
    stiffness : (m,) factor of the material's moduli in each element; 1 if left out.
    inclusions : elements of other tissues, each in one of them at most.
    tool : what presses on it.
    support : springs that hold nodes, in the mesh's numbering.
    sector : its rotational symmetry, where it is a sector.
    copies : how many times the body stands for the whole one.
    probes : name -> one point of the mesh, whose motion is recorded at every sample.
    fibres : of each muscle of the scenario the lines that its fibres run along, for pictures.
    barrier : whether a barrier keeps the corners of elements from folding in a run in time; elements/barrier.py.
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

    def in_elements(self, of: Callable[[Law], float | tuple[float, ...]]) -> np.ndarray:
        """What ``of`` says of the tissue in each element, (m,) or (m, k); ``stiffness`` is not in it."""
        values = np.tile(np.array(of(self.material), dtype=float), (self.mesh.element_count, 1))
        for part in self.inclusions:
            values[part.elements] = of(part.material)
        return values if isinstance(of(self.material), tuple) else values[:, 0]
