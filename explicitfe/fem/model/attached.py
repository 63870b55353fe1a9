"""What is fixed to a body or acts on it from outside: masses, follower forces, pressure, hanging weights, and the air."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from explicitfe.fem.inputs.argument import finite_number, number_like, vector
from explicitfe.fem.inputs.bounds import bounds_of
from explicitfe.fem.inputs.limits import NotNegative, Positive
from explicitfe.fem.mesh.checked_arrays import index_array, number_array
from explicitfe.fem.mesh.hexmesh import FACES, HexMesh, free_faces
from explicitfe.fem.model.profile import Profile
from explicitfe.platform.errors import InputError, shortened

SHARE_ROUNDING = 1e-9


@dataclass(frozen=True)
class AttachedMass:
    """Masses that are rigidly fixed to nodes and move with them; mass-proportional damping of the tissue does not act on them.

    Parameters
    ----------
    name : for messages.
    nodes : (k,) node numbers. Masses on a node that occurs several times add up.
    mass_kg : (k,) kg. Gravity acts on them where :func:`gravity_load` is given them.

    Raises
    ------
    InputError : an array of another shape or type, or a mass that is negative or out of range.
    """

    name: str
    nodes: np.ndarray
    mass_kg: np.ndarray

    def __post_init__(self) -> None:
        nodes, mass_kg = _per_node("AttachedMass", "mass_kg", self.nodes, self.mass_kg)
        if mass_kg.min(initial=0.0) < 0.0:
            raise InputError(f"AttachedMass: mass_kg = {mass_kg.min():g} is not possible; a mass must be 0 or more.")
        number_like("AttachedMass: mass_kg", float(mass_kg.max(initial=0.0)), NotNegative, "mass_g", 1e3)
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "mass_kg", mass_kg)


@dataclass(frozen=True)
class NodalForces:
    """Forces on nodes with a profile in time.

    Parameters
    ----------
    name : for messages.
    nodes : (k,) node numbers. Forces on a node that occurs several times add up.
    force_N : (k, 3) forces in the reference state at profile value 1, N.
    profile : activation profile; constant if left out.

    Raises
    ------
    InputError : an array of another shape or type, or a number out of range.
    """

    name: str
    nodes: np.ndarray
    force_N: np.ndarray
    profile: Profile = field(default_factory=Profile.constant)

    def __post_init__(self) -> None:
        kind = type(self).__name__
        nodes, force_N = _per_node(kind, "force_N", self.nodes, self.force_N, ("k", 3), bounds_of("force_N").largest)
        if not isinstance(self.profile, Profile):
            raise InputError(f"{kind}: profile must be a Profile, not {shortened(repr(self.profile))}.")
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "force_N", force_N)


class FollowerLoad(NodalForces):
    """Forces on nodes that turn with the axes of an element at each node (forces/turning.py); see :class:`NodalForces`."""


@dataclass(frozen=True)
class FacePressure:
    """A pressure on faces of the surface that follows them (forces/pressure.py).

    Parameters
    ----------
    name : for messages.
    faces : (k, 4) nodes of each face, counter-clockwise seen from outside; see :meth:`on`.
    pressure_Pa : pressure at profile value 1, positive into the body, Pa.
    profile : activation profile; constant if left out.

    Raises
    ------
    InputError : an array of another shape or type, or a number out of range.
    """

    name: str
    faces: np.ndarray
    pressure_Pa: float
    profile: Profile = field(default_factory=Profile.constant)

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", index_array("FacePressure: faces", self.faces, None, "node", columns=4))
        finite_number("FacePressure: pressure_Pa", self.pressure_Pa)

    @property
    def nodes(self) -> np.ndarray:
        """All corners, (4 k,)."""
        return np.asarray(self.faces.ravel())

    @classmethod
    def on(cls, mesh: HexMesh, nodes: np.ndarray, pressure_Pa: float, profile: Profile | None = None, name: str = "") -> Self:
        """A pressure on all free faces of a mesh whose four corners are among ``nodes`` (k,).

        Raises
        ------
        InputError : there are no such faces.
        """
        element, face = free_faces(mesh.hexes)
        faces = mesh.hexes[element[:, None], FACES[face]]
        faces = faces[np.isin(faces, nodes).all(axis=1)]
        if not len(faces):
            raise InputError(f"pressure {name}: the nodes contain no complete face of the surface; name another node set.")
        return cls(name, faces, pressure_Pa, Profile.constant() if profile is None else profile)


@dataclass(frozen=True)
class HangingWeight:
    """A weight on an inextensible string, fixed to nodes; it moves along gravity only.

    Parameters
    ----------
    name : for messages.
    nodes, share : (k,) node numbers, and the shares of the string's pull that they get; the shares add up to 1.
    mass_kg : kg.
    gravity_m_s2 : (3,) acceleration of gravity, m/s^2; not zero.
    slack_m : distance that the weight falls before it pulls on a body at rest, m.
    profile : of the weight, such as a step where it is let go later than the body.

    Raises
    ------
    InputError : an array of another shape or type, shares that do not add up to 1, a number out of range, or no gravity.
    """

    name: str
    nodes: np.ndarray
    share: np.ndarray
    mass_kg: float
    gravity_m_s2: np.ndarray
    slack_m: float = 0.0
    profile: Profile = field(default_factory=Profile.constant)

    def __post_init__(self) -> None:
        nodes, share = _per_node("HangingWeight", "share", self.nodes, self.share)
        gravity = vector("HangingWeight: gravity_m_s2", self.gravity_m_s2, bounds_of("acceleration_m_s2").largest)
        if not any(gravity):
            raise InputError("HangingWeight: gravity_m_s2 is zero, so strings have no direction; give the acceleration.")
        if share.min(initial=0.0) < 0.0 or abs(share.sum() - 1.0) > SHARE_ROUNDING:
            raise InputError(f"HangingWeight: share must be 0 or more and add up to 1, not to {share.sum():g}.")
        number_like("HangingWeight: mass_kg", self.mass_kg, Positive, "mass_g", 1e3)
        number_like("HangingWeight: slack_m", self.slack_m, NotNegative, "slack_mm", 1e3)
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "share", share)
        object.__setattr__(self, "gravity_m_s2", np.array(gravity, dtype=float))


@dataclass(frozen=True)
class AirDrag:
    """Drag of the air on the whole free surface (forces/drag.py).

    Parameters
    ----------
    linear_Pa_s_m : pressure over velocity on the projected area, Pa s/m.
    quadratic_kg_m3 : pressure over squared velocity, kg/m^3: density of the air times half the drag coefficient.

    Raises
    ------
    InputError : a number that is negative or out of range.
    """

    linear_Pa_s_m: float = 0.0
    quadratic_kg_m3: float = 0.0

    def __post_init__(self) -> None:
        for name in ("linear_Pa_s_m", "quadratic_kg_m3"):
            number_like(f"AirDrag: {name}", getattr(self, name), NotNegative, name)


def _per_node(
    kind: str, name: str, nodes: np.ndarray, values: np.ndarray, shape: tuple[int | str, ...] = ("k",), largest: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Node numbers and one number, or one row, for each."""
    nodes = index_array(f"{kind}: nodes", nodes, None, "node")
    numbers = number_array(f"{kind}: {name}", values, shape, largest=largest)
    if len(numbers) != len(nodes):
        raise InputError(f"{kind}: {name} has {len(numbers)} entries and nodes {len(nodes)}; give one for each.")
    return nodes, numbers
