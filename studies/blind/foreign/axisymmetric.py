"""An implicit solver for a rigid tool on a round specimen, which shares no code with the simulator.

Axisymmetric, with large strains: biquadratic displacements and a discontinuous linear pressure (Q2/P-1; Sussman and Bathe, 1987,
Comput. Struct. 26:357-409) on a mesh of scikit-fem that is fine under the edge of the tool. The energy of a volume is
K/2 (J - 1)^2, another law than the simulator's. Points of the surface that are inside the tool are pushed out by a stiff penalty.
Newton's method has the exact derivative, and a step that does not converge is halved.

Lengths are in mm, forces in N and stresses in MPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from explicitfe.platform.errors import InputError, RunError
from studies.blind.foreign.contact import RigidTool, SurfaceLine, push
from studies.blind.foreign.law import AT_REST, HiddenTissue, Material, Memory, StateLostError, Stress

PENALTY_OVER_MODULUS = 1000.0  # of contact [1/mm]: a pressure of the shear modulus is borne at a depth of 1 um
BULK_OVER_SHEAR = 2.0e5  # of a tissue that keeps its volume; Poisson's ratio is 0.4999975
EQUILIBRIUM_ITERATIONS = 25
TOLERANCE_SHARE = 1e-7  # of the tool's way, or of this share of the height: the change at which Newton's method stops
SMALLEST_WAY_SHARE = 0.05
LARGEST_STEP_SHARE = 0.25  # of the height: a step of Newton's method is cut to it
INCREMENT_HALVINGS = 7  # of an increment that does not converge
INCREMENT_GROWTH = 1.5  # after one that does
VOLUME_ORDER, EDGE_ORDER = 5, 15  # of the polynomials that the quadratures integrate exactly
NODES_OF_AN_ELEMENT = 9


@dataclass(frozen=True)
class RoundSpecimen:
    """A cylinder on a base."""

    radius_mm: float
    height_mm: float


@dataclass(frozen=True)
class Drive:
    """What the machine imposes at the end of an increment.

    Attributes
    ----------
    by_depth : the place of the machine, or else the force of the tool.
    target : depth of the tool plus what the rig gives way by [mm], or force [N].
    compliance_mm_N : of the rig.
    """

    by_depth: bool
    target: float
    compliance_mm_N: float = 0.0


@dataclass(frozen=True, eq=False)
class ConvergedState:
    """A converged instant.

    Attributes
    ----------
    u : displacements, r and z of each node in turn [mm].
    p (e, 3) : pressures [MPa].
    tool_mm : the tool's way down from the height at rest.
    slip (f, q) : of the contact, its elastic part [mm].
    slope : derivative of ``u`` by the tool's way: where the tool is lifted, points would leave it at once without this guess.
    """

    u: np.ndarray
    p: np.ndarray
    time_s: float
    tool_mm: float
    force_N: float
    memory: Memory
    slip: np.ndarray
    slope: np.ndarray | None = None


class Press:
    """A tool on a specimen, from rest on.

    Parameters
    ----------
    fineness : 1 is for data; smaller is coarser.

    Raises
    ------
    InputError : scikit-fem is not installed.
    """

    def __init__(self, specimen: RoundSpecimen, tool: RigidTool, tissue: HiddenTissue, fineness: float = 1.0) -> None:
        try:
            from skfem import Basis, ElementQuad2, FacetBasis, MeshQuad
        except ImportError:
            raise InputError(
                "scikit-fem is missing, which computes the foreign tests under a tool; install it with: pip install scikit-fem"
            ) from None
        self.specimen, self.tool, self.tissue = specimen, tool, tissue
        r_lines, z_lines = mesh_lines(specimen, tool, fineness)
        if tissue.layer is not None:  # a line of the mesh lies where the moduli jump
            z_lines[1 + np.argmin(np.abs(z_lines[1:-1] - (specimen.height_mm - tissue.layer[0])))] = (
                specimen.height_mm - tissue.layer[0]
            )
        mesh = MeshQuad.init_tensor(r_lines, z_lines)
        inside = Basis(mesh, ElementQuad2(), intorder=VOLUME_ORDER)
        height = specimen.height_mm
        top = mesh.facets_satisfying(lambda x: np.isclose(x[1], height))
        base = mesh.facets_satisfying(lambda x: np.isclose(x[1], 0.0))
        self.top, self.base = (
            _line(FacetBasis(mesh, ElementQuad2(), facets=facets, intorder=EDGE_ORDER)) for facets in (top, base)
        )
        self._take_elements(inside)
        self._take_freedoms(*inside.doflocs)
        G = 2e-6 * tissue.C10_Pa
        self.bulk = BULK_OVER_SHEAR * G
        if tissue.poisson < 0.5:
            self.bulk = min(self.bulk, 2.0 * G * (1.0 + tissue.poisson) / (3.0 * (1.0 - 2.0 * tissue.poisson)))
        self.penalty = PENALTY_OVER_MODULUS * G
        zero = np.zeros(self.size)
        pressures = np.zeros((len(self.dofs), 3))
        slip = np.zeros(self.top.weight.shape)
        self.state = ConvergedState(zero, pressures, 0.0, 0.0, 0.0, self.material.at_rest, slip)
        self.touch_mm = 0.0  # the tool's way from the height at rest to the surface
        if tissue.gravity_m_s2 > 0.0:
            self.state = self._solve(0.0, None)
            self.touch_mm = self._touch()

    # ---- mesh ----

    def _take_elements(self, basis: Any) -> None:
        at = np.asarray(basis.global_coordinates())
        self.weight = 2.0 * np.pi * at[0] * basis.dx
        self.size = 2 * basis.N
        e, q = self.weight.shape
        # Derivatives of the components of F by the displacements of an element: nine nodes, r and z in turn.
        self.B = np.zeros((e, q, 5, 2 * NODES_OF_AN_ELEMENT))
        self.value = np.zeros((e, q, NODES_OF_AN_ELEMENT))
        for k in range(NODES_OF_AN_ELEMENT):
            shape = basis.basis[k][0]
            dr, dz = shape.grad
            self.value[:, :, k] = np.asarray(shape)
            self.B[:, :, 0, 2 * k], self.B[:, :, 1, 2 * k], self.B[:, :, 4, 2 * k] = dr, dz, self.value[:, :, k] / at[0]
            self.B[:, :, 2, 2 * k + 1], self.B[:, :, 3, 2 * k + 1] = dr, dz
        self.dofs = _dofs(basis)
        middle, spread = at.mean(axis=2, keepdims=True), np.ptp(at, axis=2)[:, :, None]
        self.Np = np.stack([np.ones((e, q)), *((at - middle) / spread)], axis=-1)
        self.mass = np.einsum("eqi,eqj,eq->eij", self.Np, self.Np, self.weight)
        self.mass_inverse = np.linalg.inv(self.mass)
        self.material = Material(self.tissue, at[0], at[1], self.specimen.height_mm)

    def _take_freedoms(self, r: np.ndarray, z: np.ndarray) -> None:
        slides = self.tissue.base_compliance_mm_kPa > 0.0
        held = np.zeros((len(r), 2), dtype=bool)
        held[np.isclose(r, 0.0), 0] = True
        held[np.isclose(z, 0.0), 1] = True
        if not slides:
            held[np.isclose(z, 0.0), 0] = True
        self.free = np.flatnonzero(~held.ravel())
        number = np.full(self.size, -1)
        number[self.free] = np.arange(len(self.free))
        blocks = [self.dofs, self.top.dofs, self.base.dofs][: 3 if slides else 2]
        rows = np.concatenate([np.repeat(number[dofs], dofs.shape[1], axis=1).ravel() for dofs in blocks])
        columns = np.concatenate([np.tile(number[dofs], (1, dofs.shape[1])).ravel() for dofs in blocks])
        self._kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        count = len(self.free)
        places, self._place = np.unique(columns[self._kept].astype(np.int64) * count + rows[self._kept], return_inverse=True)
        starts = np.searchsorted(places, np.arange(count + 1, dtype=np.int64) * count)
        self._pattern = (places % count).astype(np.int32), starts.astype(np.int32)

    def _matrix(self, blocks: Sequence[np.ndarray]) -> sp.csc_matrix:
        data = np.concatenate([block.reshape(-1) for block in blocks])[self._kept]
        values = np.bincount(self._place, data, len(self._pattern[0]))
        return sp.csc_matrix((values, *self._pattern), shape=(len(self.free),) * 2)

    def _touch(self) -> float:
        """The tool's way to the surface."""
        x = self.top.position(self.state.u)
        low, high = -self.specimen.height_mm, self.specimen.height_mm
        for _ in range(60):
            middle = 0.5 * (low + high)
            apart = self.tool.surface(x, self.specimen.height_mm - middle).distance.min() > 0.0
            low, high = (middle, high) if apart else (low, middle)
        return 0.5 * (low + high)

    # ---- equilibrium ----

    def _tissue_forces(self, answer: Stress, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Forces (e, 18) and stiffness (e, 18, 18) without the pressures, what these do to the forces, and to the volume."""
        w = self.weight
        R = np.einsum("eq,eqi,eqia->ea", w, answer.P, self.B, optimize=True)
        if self.tissue.gravity_m_s2 > 0.0:
            weight = 1e-9 * self.tissue.density_kg_m3 * self.tissue.gravity_m_s2  # N/mm^3
            R[:, 1::2] += weight * np.einsum("eq,eqk->ek", w, self.value)
        e, q = w.shape
        flat = self.B.reshape(e, q * 5, -1)
        K = np.swapaxes(flat, 1, 2) @ (w[..., None, None] * (answer.A @ self.B)).reshape(e, q * 5, -1)
        coupling = np.einsum("eq,eqi,eqia,eqj->eaj", w, answer.cofactor, self.B, self.Np, optimize=True)
        volume = np.einsum("eq,eqj,eq->ej", w, self.Np, answer.J - 1.0)
        return R, K, coupling, volume - np.einsum("eij,ej->ei", self.mass, p) / self.bulk

    def _solve(self, time_s: float, drive: Drive | None) -> ConvergedState:
        """The equilibrium at an instant, with or without a tool.

        Raises
        ------
        StateLostError : Newton's method does not converge.
        """
        old = self.state
        u, p, tool, force = old.u.copy(), old.p.copy(), old.tool_mm, old.force_N
        if drive is not None and drive.by_depth:
            tool = drive.target - drive.compliance_mm_N * force
            if old.slope is not None:
                u = u + (tool - old.tool_mm) * old.slope
        tolerance = TOLERANCE_SHARE * max(SMALLEST_WAY_SHARE * self.specimen.height_mm, abs(tool))
        slip, before = old.slip, self.top.position(old.u)
        inverse = self.bulk * self.mass_inverse
        for iteration in range(EQUILIBRIUM_ITERATIONS):
            F = np.einsum("eqia,ea->eqi", self.B, u[self.dofs]) + AT_REST
            answer = self.material.stress(F, np.einsum("eqi,ei->eq", self.Np, p), old.memory, time_s - old.time_s)
            R, K, coupling, volume = self._tissue_forces(answer, p)
            K = K + coupling @ inverse @ np.swapaxes(coupling, 1, 2)
            R = R + np.einsum("eai,eij,ej->ea", coupling, inverse, volume)
            total = np.bincount(self.dofs.ravel(), R.ravel(), self.size)
            contact = None
            if drive is not None:
                x = self.top.position(u)
                moved = x - before - np.array([0.0, old.tool_mm - tool])
                contact = push(self.tool, self.top, x, self.specimen.height_mm - tool, self.penalty, moved, old.slip)
                total -= self.top.lump(contact.forces, self.size)
                force, slip = contact.total_N, contact.slip
            blocks = [K, np.zeros((len(self.top.dofs), *K.shape[1:])) if contact is None else contact.stiffness]
            if self.tissue.base_compliance_mm_kPa > 0.0:
                across = self.base.vector[:, :, 0]
                spring = np.einsum("fq,fqa,fqb->fab", self.base.weight, across, across)
                spring *= 1e-3 / self.tissue.base_compliance_mm_kPa  # N/mm^3
                total += self.base.lump(np.einsum("fab,fb->fa", spring, u[self.base.dofs]), self.size)
                blocks.append(spring)
            lu = splu(self._matrix(blocks), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.01)
            step = np.zeros(self.size)
            step[self.free] = lu.solve(-total[self.free])
            tool_step = 0.0
            by_tool = np.zeros(self.size)
            if drive is not None and contact is not None:
                # The tool is one more unknown, and what the machine imposes one more equation.
                by_tool[self.free] = lu.solve(self.top.lump(contact.by_tool, self.size)[self.free])
                by_u = self.top.lump(contact.by_u, self.size)
                place, give = (1.0, drive.compliance_mm_N) if drive.by_depth else (0.0, 1.0)
                missing = drive.target - place * tool - give * (force + by_u @ step)
                tool_step = float(missing / (place + give * (contact.total_by_tool + by_u @ by_tool)))
                step = step + tool_step * by_tool
            largest = float(np.abs(step).max())
            if not np.isfinite(largest):
                raise StateLostError
            share = min(1.0, LARGEST_STEP_SHARE * self.specimen.height_mm / max(largest, tolerance))
            p = p + share * np.einsum("eij,ej->ei", inverse, volume + np.einsum("eaj,ea->ej", coupling, step[self.dofs]))
            u, tool = u + share * step, tool + share * tool_step
            if max(largest, abs(tool_step)) <= tolerance and iteration > 0:
                return ConvergedState(u, p, time_s, tool, force, answer.memory, slip, by_tool)
        raise StateLostError

    def advance(self, time_s: float, drive: Drive) -> tuple[float, float]:
        """Go on to an instant: the depth of the tool below its first touch [mm], and its force [N].

        Raises
        ------
        RunError : no equilibrium was reached.
        """
        start = self.state
        now = start.tool_mm - self.touch_mm + drive.compliance_mm_N * start.force_N if drive.by_depth else start.force_N
        done, share = 0.0, 1.0
        while done < 1.0:
            part = min(share, 1.0 - done)
            at = done + part
            target = now + at * (drive.target - now) + (self.touch_mm if drive.by_depth else 0.0)
            try:
                self.state = self._solve(start.time_s + at * (time_s - start.time_s), replace(drive, target=target))
            except StateLostError:
                share = 0.5 * part
                if share < 0.5**INCREMENT_HALVINGS:
                    raise RunError(f"no equilibrium after {start.time_s:g} s at a depth of {start.tool_mm:.3g} mm.") from None
                continue
            done, share = at, min(1.0, INCREMENT_GROWTH * part)
        return self.state.tool_mm - self.touch_mm, self.state.force_N


def _dofs(basis: Any) -> np.ndarray:
    """Places of the displacements of each element or edge (k, 18)."""
    return (2 * basis.element_dofs.T[:, :, None] + np.arange(2)).reshape(-1, 2 * NODES_OF_AN_ELEMENT)


def _line(basis: Any) -> SurfaceLine:
    at = np.asarray(basis.global_coordinates())
    vector = np.zeros((*basis.dx.shape, 2, 2 * NODES_OF_AN_ELEMENT))
    for k in range(NODES_OF_AN_ELEMENT):
        vector[:, :, 0, 2 * k] = vector[:, :, 1, 2 * k + 1] = np.asarray(basis.basis[k][0])
    return SurfaceLine(2.0 * np.pi * at[0] * basis.dx, vector, _dofs(basis), np.moveaxis(at, 0, -1))


# ---- the lines of the mesh ----

SPHERE_REACH_SHARE = 0.9  # of the sphere's radius, or the specimen's: even elements, as the edge of contact wanders
ELEMENTS_UNDER_A_SPHERE = 24
EDGE_ELEMENTS_PER_ROUNDING = 3.2  # of a flat tool
EDGE_REACH_ROUNDINGS = 3.0  # to both sides of the edge, where elements are even
LARGEST_ELEMENT_SHARE = 1.0 / 5.0  # of a length


def mesh_lines(specimen: RoundSpecimen, tool: RigidTool, fineness: float) -> tuple[np.ndarray, np.ndarray]:
    """The lines of the mesh over the radius and the height [mm], close to each other where the edge of contact will be."""
    R, H, a = specimen.radius_mm, specimen.height_mm, tool.radius_mm
    growth = 1.0 + 0.3 / fineness
    most = LARGEST_ELEMENT_SHARE / fineness
    if tool.shape == "sphere":
        reach = SPHERE_REACH_SHARE * min(a, R)
        even = np.linspace(0.0, reach, max(round(ELEMENTS_UNDER_A_SPHERE * fineness), 4) + 1)
        outer = reach + growing(R - reach, even[1], growth, most * R)
        return np.concatenate([even, outer[1:]]), H - growing(H, even[1], growth, most * H)[::-1]
    smallest = tool.rounding_mm / (EDGE_ELEMENTS_PER_ROUNDING * fineness)
    reach = min(EDGE_REACH_ROUNDINGS * tool.rounding_mm, 0.25 * a, 0.5 * (R - a))
    inner = (a - reach) - growing(a - reach, smallest, growth, most * a)[::-1]
    even = np.linspace(a - reach, a + reach, max(round(2.0 * reach / smallest), 4) + 1)
    outer = (a + reach) + growing(R - a - reach, smallest, growth, most * R)
    return np.concatenate([inner, even[1:], outer[1:]]), H - growing(H, smallest, growth, most * H)[::-1]


def growing(length: float, first: float, growth: float, most: float) -> np.ndarray:
    """Places from 0 to a length: the first interval about as given, each longer by the growth, none much above the most."""
    steps = [first]
    while sum(steps) < length:
        steps.append(min(steps[-1] * growth, most))
    places = np.concatenate([[0.0], np.cumsum(steps)])
    return places * (length / places[-1])
