"""A spectral solver for a cylinder glued between two plates of its own radius, which shares no code with the other solvers.

Axisymmetric, total Lagrangian, with large strains. The displacements are polynomials of a high degree on few elements, through
Gauss-Lobatto nodes (Patera 1984, J. Comput. Phys. 54:468-488). The elements shrink geometrically towards both rims, where the
stress is singular (hp version; Guo and Babuska 1986, Comput. Mech. 1:21-41). Degrees from four on do not lock for nearly
incompressible tissue, so no pressure is needed. The volumetric energy is K/4 (J^2 - 1 - 2 ln J).

The plates are glued, so there is no contact. All nodes of the upper one move together. Plates may also be frictionless, which
is a homogeneous state: a verification in closed form. Lengths are in mm, forces in N and stresses in MPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre
from scipy.sparse.linalg import splu
from scipy.special import erf

from explicitfe.platform.errors import RunError
from studies.blind.foreign.law import HiddenTissue

POISSON_OF_CONSTANT_VOLUME = 0.4995
DEGREE = 4  # of the polynomials of the data
LAYERS = 3  # elements towards a rim
FIRST_LAYER_SHARE, GRADING = 0.4, 0.2  # size of the first of them over the half height or the radius, ratio to the next
TOLERANCE_SHARE = 1e-8  # of the height: the change at which Newton's method stops
MOST_ITERATIONS, MOST_HALVINGS = 14, 8
LEAST_VOLUME_RATIO = 0.05
PLACES = ((0, 0), (0, 2), (2, 0), (2, 2), (1, 1))  # components of F that are not zero: r is 0, around the axis 1, z is 2
TINY_MM = 1e-9


@dataclass(frozen=True)
class GluedCylinder:
    """Radius and height of the specimen [mm], and whether its faces are glued to the plates or slide."""

    radius_mm: float
    height_mm: float
    glued: bool = True


@dataclass
class History:
    """What the tissue has gone through at each point (n,).

    Attributes
    ----------
    elastic (n, 3, 3) : isochoric second Piola-Kirchhoff stress before relaxation [MPa].
    branches (t, n, 3, 3) : of each Prony term.
    energy (n,) : the largest so far [MPa].
    """

    elastic: np.ndarray
    branches: np.ndarray
    energy: np.ndarray


class GluedSolver:
    """A cylinder between plates, from rest on.

    Parameters
    ----------
    degree, layers : of the polynomials, and of elements towards a rim.

    Attributes
    ----------
    depth_mm, force_N, time_s : of the last converged instant, pressing positive.
    """

    def __init__(self, test: GluedCylinder, tissue: HiddenTissue, degree: int = DEGREE, layers: int = LAYERS) -> None:
        self.test, self.tissue, self.degree = test, tissue, degree
        r_lines, z_lines = lines(test, tissue, layers)
        self._take_elements(r_lines, z_lines)
        self._take_unknowns()
        self.depth_mm = self.force_N = self.time_s = 0.0
        self.u = np.zeros(self.count + 1)  # the last one is that of the upper plate, upwards
        zero = np.zeros((len(self.weight), 3, 3))
        self.history = History(zero, np.zeros((len(tissue.prony), *zero.shape)), np.zeros(len(self.weight)))

    # ---- elements ----

    def _take_elements(self, r_lines: np.ndarray, z_lines: np.ndarray) -> None:
        p = self.degree
        nodes = gauss_lobatto(p)
        points, weights = legendre.leggauss(p + 2)
        value, slope = lagrange(nodes, points)
        elements = [(a, b, c, d) for a, b in pairwise(r_lines) for c, d in pairwise(z_lines)]
        n_axial, columns = len(z_lines) - 1, p * (len(z_lines) - 1) + 1
        N = np.einsum("qi,sj->qsij", value, value).reshape(len(points) ** 2, -1)
        self.B = np.zeros((len(elements), len(N), 5, 2 * N.shape[1]))
        self.nodes = np.zeros((len(elements), N.shape[1]), dtype=np.int64)
        weight, r_at, z_at = [], [], []
        for k, (a, b, c, d) in enumerate(elements):
            hr, hz = 0.5 * (b - a), 0.5 * (d - c)
            r = np.repeat(a + hr * (points + 1.0), len(points))
            z = np.tile(c + hz * (points + 1.0), len(points))
            dr = np.einsum("qi,sj->qsij", slope, value).reshape(N.shape) / hr
            dz = np.einsum("qi,sj->qsij", value, slope).reshape(N.shape) / hz
            B = self.B[k]
            B[:, 0, 0::2], B[:, 1, 0::2], B[:, 4, 0::2] = dr, dz, N / r[:, None]
            B[:, 2, 1::2], B[:, 3, 1::2] = dr, dz
            weight.append(2.0 * np.pi * r * np.outer(weights, weights).ravel() * hr * hz)
            r_at.append(r)
            z_at.append(z)
            first_r, first_z = p * (k // n_axial), p * (k % n_axial)
            self.nodes[k] = ((first_r + np.arange(p + 1))[:, None] * columns + first_z + np.arange(p + 1)).ravel()
        self.weight = np.concatenate(weight)
        factor = self.tissue.moduli_factor(np.concatenate(r_at), np.concatenate(z_at), self.test.height_mm)
        self.moduli = [1e-6 * c * factor for c in (self.tissue.C10_Pa, self.tissue.C20_Pa, self.tissue.C30_Pa)]
        nu = min(self.tissue.poisson, POISSON_OF_CONSTANT_VOLUME)
        self.bulk = 4.0 * self.moduli[0] * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
        self.r, self.z = (
            np.append(np.concatenate([a + 0.5 * (b - a) * (nodes[:-1] + 1.0) for a, b in pairwise(places)]), places[-1])
            for places in (r_lines, z_lines)
        )

    def _take_unknowns(self) -> None:
        """Number the free displacements; those of the upper plate are one."""
        r, z = (axis.ravel() for axis in np.meshgrid(self.r, self.z, indexing="ij"))
        top, base = z > self.test.height_mm - TINY_MM, z < TINY_MM
        inside = ~top & ~base
        number = np.full(2 * len(r), -1)
        free = np.stack([(inside | (not self.test.glued)) & (r > TINY_MM), inside], axis=1).ravel()
        self.count = int(free.sum())
        number[free] = np.arange(self.count)
        number[1::2][top] = self.count
        dofs = np.stack([2 * self.nodes, 2 * self.nodes + 1], axis=2).reshape(len(self.nodes), -1)
        self.dofs = number[dofs]
        self._rows = np.repeat(self.dofs, self.dofs.shape[1], axis=1).ravel()
        self._columns = np.tile(self.dofs, (1, self.dofs.shape[1])).ravel()
        self._used = (self._rows >= 0) & (self._columns >= 0)

    # ---- tissue ----

    def _stress(self, F: np.ndarray, increment_s: float) -> tuple[np.ndarray, np.ndarray, History]:
        """First Piola-Kirchhoff stress (n, 5), its derivative by F (n, 5, 5), and the history after an increment."""
        C = np.einsum("nki,nkj->nij", F, F)
        J = np.linalg.det(F)
        if not (J > LEAST_VOLUME_RATIO).all():
            raise FloatingPointError
        inverse, one = np.linalg.inv(C), np.eye(3)
        scale, I1 = J ** (-2.0 / 3.0), np.trace(C, axis1=1, axis2=2)
        x = np.maximum(scale * I1 - 3.0, 0.0)
        C10, C20, C30 = self.moduli
        first, second = C10 + (2.0 * C20 + 3.0 * C30 * x) * x, 2.0 * C20 + 6.0 * C30 * x
        D = scale[:, None, None] * (one - (I1 / 3.0)[:, None, None] * inverse)  # derivative of x by C
        L = 0.5 * (np.einsum("nik,njl->nijkl", inverse, inverse) + np.einsum("nil,njk->nijkl", inverse, inverse))
        dD = -_dyad(D, inverse) / 3.0 - (scale / 3.0)[:, None, None, None, None] * _dyad(inverse, one[None])
        dD = dD + (scale * I1 / 3.0)[:, None, None, None, None] * L
        S = 2.0 * first[:, None, None] * D
        CC = 4.0 * second[:, None, None, None, None] * _dyad(D, D) + 4.0 * first[:, None, None, None, None] * dD
        S, CC, history = self._past(S, CC, (C10 + (C20 + C30 * x) * x) * x, increment_s)
        J2 = (self.bulk * J**2)[:, None, None, None, None]
        p = (0.5 * self.bulk * (J**2 - 1.0))[:, None, None]
        S = S + p * inverse
        CC = CC + J2 * _dyad(inverse, inverse) - 2.0 * p[..., None, None] * L
        moved = np.einsum("nim,nmjlo,nko->nijkl", F, CC, F, optimize=True)  # places: i, J, k, L
        moved = moved + np.einsum("ik,njl->nijkl", one, S)
        P = F @ S
        rows = [place[0] for place in PLACES], [place[1] for place in PLACES]
        A = moved[:, rows[0], rows[1]][:, :, rows[0], rows[1]]
        return P[:, rows[0], rows[1]], A, history

    def _past(self, S: np.ndarray, CC: np.ndarray, W: np.ndarray, increment_s: float) -> tuple[np.ndarray, np.ndarray, History]:
        """Isochoric stress and derivative after softening (Ogden and Roxburgh 1999), then relaxation (Simo 1987)."""
        old, tissue = self.history, self.tissue
        largest = old.energy
        if tissue.softening is not None:
            inverse_r, m_Pa, beta = tissue.softening
            largest = np.maximum(old.energy, W)
            width = 1e-6 * m_Pa + beta * largest
            y = (largest - W) / width
            slope = np.where(old.energy > W, inverse_r * 2.0 / np.sqrt(np.pi) * np.exp(-(y**2)) / width, 0.0)
            eta = 1.0 - inverse_r * erf(y)
            CC = eta[:, None, None, None, None] * CC + slope[:, None, None, None, None] * _dyad(S, S)
            S = eta[:, None, None] * S
        if not tissue.prony:
            return S, CC, History(old.elastic, old.branches, largest)
        share, past, branches = 1.0, np.zeros_like(S), []
        for (g, tau), branch in zip(tissue.prony, old.branches, strict=True):
            y = increment_s / tau
            mean = -np.expm1(-y) / y if y > 0.0 else 1.0
            branches.append(np.exp(-y) * branch + g * mean * (S - old.elastic))
            past = past + np.exp(-y) * branch - g * mean * old.elastic
            share += g * (mean - 1.0)
        return share * S + past, share * CC, History(S, np.array(branches), largest)

    # ---- equilibrium ----

    def _system(self, u: np.ndarray, increment_s: float) -> tuple[np.ndarray, sp.csc_matrix, History]:
        """Internal forces (count + 1,) and stiffness."""
        e, q = self.B.shape[:2]
        full = np.append(u, 0.0)[self.dofs]  # -1 is held
        F = np.zeros((e * q, 3, 3))
        F[:] = np.eye(3)
        gradient = np.einsum("eqia,ea->eqi", self.B, full).reshape(-1, 5)
        for k, (i, j) in enumerate(PLACES):
            F[:, i, j] += gradient[:, k]
        P, A, history = self._stress(F, increment_s)
        flat = self.B.reshape(e, q * 5, -1)
        R = np.einsum("ena,en->ea", flat, (self.weight[:, None] * P).reshape(e, -1))
        AB = (self.weight[:, None, None] * A).reshape(e, q, 5, 5) @ self.B
        K = np.swapaxes(flat, 1, 2) @ AB.reshape(e, q * 5, -1)
        used = self.dofs >= 0
        force = np.bincount(self.dofs[used], R[used], self.count + 1)
        size = self.count + 1
        matrix = sp.csc_matrix((K.ravel()[self._used], (self._rows[self._used], self._columns[self._used])), shape=(size, size))
        return force, matrix, history

    def _solve(self, time_s: float, by_depth: bool, target: float, compliance_mm_N: float) -> None:
        """Move to the equilibrium at an instant.

        Raises
        ------
        FloatingPointError : Newton's method does not converge.
        """
        u, n = self.u.copy(), self.count
        place, give = (1.0, compliance_mm_N) if by_depth else (0.0, 1.0)
        for iteration in range(MOST_ITERATIONS):
            force, K, history = self._system(u, time_s - self.time_s)
            lu = splu(K[:n, :n], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.01)
            to_plate = K[:n, n].toarray()[:, 0]
            x = lu.solve(np.stack([-force[:n], -to_plate], axis=1))
            reaction = force[n] + to_plate @ x[:, 0]
            stiffness = K[n, n] + to_plate @ x[:, 1]
            step = -(target + place * u[n] + give * reaction) / (place + give * stiffness)
            change = np.append(x[:, 0] + step * x[:, 1], step)
            largest = float(np.abs(change).max())
            if not np.isfinite(largest) or largest > self.test.height_mm:
                raise FloatingPointError
            u = u + change
            if largest < TOLERANCE_SHARE * self.test.height_mm and iteration > 0:
                self.u, self.time_s, self.history = u, time_s, history
                self.depth_mm, self.force_N = -float(u[n]), -float(reaction + stiffness * step)
                return
        raise FloatingPointError

    def advance(self, time_s: float, *, by_depth: bool, target: float, compliance_mm_N: float = 0.0) -> tuple[float, float]:
        """Continue to an instant: depth of the upper plate [mm] and its force [N].

        Parameters
        ----------
        target : depth plus what the rig gives way by [mm], or force [N].

        Raises
        ------
        RunError : no equilibrium was reached.
        """
        begin, now = self.time_s, self.depth_mm + compliance_mm_N * self.force_N if by_depth else self.force_N
        done, share = 0.0, 1.0
        while done < 1.0:
            at = min(done + share, 1.0)
            try:
                self._solve(begin + at * (time_s - begin), by_depth, now + at * (target - now), compliance_mm_N)
            except FloatingPointError:
                share *= 0.5
                if share < 0.5**MOST_HALVINGS:
                    raise RunError(f"glued cylinder: no equilibrium after {begin:g} s at {self.depth_mm:.3g} mm.") from None
                continue
            done = at
        return self.depth_mm, self.force_N


def _dyad(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a_ij b_kl."""
    return a[:, :, :, None, None] * b[:, None, None, :, :]


# ---- lines and polynomials ----


def lines(test: GluedCylinder, tissue: HiddenTissue, layers: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of the lines between elements along r and z [mm]; one lies where a layer ends."""
    R, H = test.radius_mm, test.height_mm
    sizes = FIRST_LAYER_SHARE * GRADING ** np.arange(layers)
    r = np.concatenate([[0.0], R - min(R, 0.5 * H) * sizes, [R]])
    z = [0.0, *(0.5 * H * sizes[::-1]), 0.5 * H, *(H - 0.5 * H * sizes), H]
    if tissue.layer is not None:
        end = H - tissue.layer[0]
        near = int(np.argmin([abs(end - line) for line in z[1:-1]])) + 1
        if abs(z[near] - end) < 0.1 * (H - end):
            z[near] = end
        else:
            z = sorted([*z, end])
    return r, np.array(z)


def gauss_lobatto(degree: int) -> np.ndarray:
    """Gauss-Lobatto nodes on [-1, 1]."""
    roots = legendre.Legendre.basis(degree).deriv().roots()
    return np.concatenate([[-1.0], np.sort(roots.real), [1.0]])


def lagrange(nodes: Sequence[float] | np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives (q, k) at points of the polynomials that are 1 at one node and 0 at the others."""
    nodes = np.asarray(nodes)
    legendre_at_nodes = legendre.legvander(nodes, len(nodes) - 1)
    coefficients = np.linalg.inv(legendre_at_nodes)
    value = legendre.legvander(points, len(nodes) - 1) @ coefficients
    slopes = [legendre.legval(points, legendre.legder(np.eye(len(nodes))[k])) for k in range(len(nodes))]
    return value, np.stack(slopes, axis=1) @ coefficients
