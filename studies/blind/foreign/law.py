"""The tissue of the implicit solver: Yeoh's law with relaxation and softening, as stress and its derivative by F.

F of an axisymmetric state has five components: rr, rz, zr, zz and, around the axis, tt. Stresses are in MPa, lengths in mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import erf

SMALLEST_VOLUME_RATIO = 0.05  # A trial state that is squeezed further is given up.
AT_REST = np.array([1.0, 0.0, 0.0, 1.0, 1.0])  # F


class StateLostError(Exception):
    """Newton's method does not converge from here; a smaller step may help."""


@dataclass(frozen=True)
class HiddenTissue:
    """A Yeoh tissue with what may be hidden in it.

    Attributes
    ----------
    C10_Pa, C20_Pa, C30_Pa : of a sudden load.
    poisson : at small strains; 0.5 keeps the volume.
    prony : (share of the sudden stress, relaxation time [s]) of each term (Simo, 1987).
    softening : 1/r, m [Pa] and beta of Ogden and Roxburgh (1999).
    layer : thickness of a surface layer [mm], and its moduli over those below.
    gradient : change of the moduli with depth: the factor is 1 + gradient (1 - 2 z / height).
    factor : more of the moduli, by the place at rest r, z and the height [mm].
    density_kg_m3, gravity_m_s2 : of its weight.
    base_compliance_mm_kPa : sideways give of the base; 0 is bonded.
    """

    C10_Pa: float
    C20_Pa: float = 0.0
    C30_Pa: float = 0.0
    poisson: float = 0.5
    prony: tuple[tuple[float, float], ...] = ()
    softening: tuple[float, float, float] | None = None
    layer: tuple[float, float] | None = None
    gradient: float = 0.0
    factor: Callable[[np.ndarray, np.ndarray, float], np.ndarray] | None = None
    density_kg_m3: float = 1000.0
    gravity_m_s2: float = 0.0
    base_compliance_mm_kPa: float = 0.0

    def moduli_factor(self, r: np.ndarray, z: np.ndarray, height_mm: float) -> np.ndarray:
        """The factor of the moduli at places at rest."""
        factor = 1.0 + self.gradient * (1.0 - 2.0 * z / height_mm)
        if self.layer is not None:
            factor = factor * np.where(z > height_mm - self.layer[0], self.layer[1], 1.0)
        return factor if self.factor is None else factor * self.factor(r, z, height_mm)


@dataclass(frozen=True, eq=False)
class Memory:
    """What the tissue remembers at each point (e, q).

    Attributes
    ----------
    elastic (e, q, 4) : second Piola-Kirchhoff stress of the law: rr, rz, zz, tt.
    branches (e, q, 4) : of each term of the relaxation.
    energy (e, q) : the largest so far.
    """

    elastic: np.ndarray
    branches: tuple[np.ndarray, ...]
    energy: np.ndarray


class Stress(NamedTuple):
    """The answer to F: first Piola-Kirchhoff stress (e, q, 5), its derivative (e, q, 5, 5), J, the derivative of J, memory."""

    P: np.ndarray
    A: np.ndarray
    J: np.ndarray
    cofactor: np.ndarray
    memory: Memory


class Material:
    """A tissue at the points of a mesh.

    Parameters
    ----------
    r, z (e, q) : where they are at rest [mm], in a specimen of a height.
    """

    def __init__(self, tissue: HiddenTissue, r: np.ndarray, z: np.ndarray, height_mm: float) -> None:
        self.tissue = tissue
        factor = tissue.moduli_factor(r, z, height_mm)
        self.moduli = [1e-6 * constant * factor for constant in (tissue.C10_Pa, tissue.C20_Pa, tissue.C30_Pa)]
        zero = np.zeros((*r.shape, 4))
        self.at_rest = Memory(zero, tuple(zero for _ in tissue.prony), np.zeros(r.shape))

    def stress(self, F: np.ndarray, pressure: np.ndarray, old: Memory, increment_s: float) -> Stress:
        """The stress at F (e, q, 5) with a pressure (e, q) that keeps the volume.

        Raises
        ------
        StateLostError : a point is squeezed to nothing.
        """
        rr, rz, zr, zz, tt = np.moveaxis(F, -1, 0)
        flat = rr * zz - rz * zr
        J = flat * tt
        if not (J > SMALLEST_VOLUME_RATIO).all():
            raise StateLostError
        cof = np.stack([zz * tt, -zr * tt, -rz * tt, rr * tt, flat], axis=-1)
        dcof = np.zeros((*J.shape, 5, 5))
        for i, j, value in ((0, 3, tt), (1, 2, -tt), (0, 4, zz), (1, 4, -zr), (2, 4, -rz), (3, 4, rr)):
            dcof[..., i, j] = dcof[..., j, i] = value
        I1 = (F**2).sum(axis=-1)
        scale = J ** (-2.0 / 3.0)
        x = np.maximum(scale * I1 - 3.0, 0.0)
        # a and da are the first and the second derivative of the isochoric I1 by F.
        a = scale[..., None] * (2.0 * F - (2.0 / 3.0) * (I1 / J)[..., None] * cof)
        cross = cof[..., :, None] * F[..., None, :]
        da = 2.0 * np.eye(5) - (2.0 / 3.0) * (I1 / J)[..., None, None] * dcof
        da = da - (4.0 / 3.0) / J[..., None, None] * (cross + np.swapaxes(cross, -1, -2))
        da = da + (10.0 / 9.0) * (I1 / J**2)[..., None, None] * cof[..., :, None] * cof[..., None, :]
        da = scale[..., None, None] * da
        C10, C20, C30 = self.moduli
        first = C10 + (2.0 * C20 + 3.0 * C30 * x) * x
        second = 2.0 * C20 + 6.0 * C30 * x
        P = first[..., None] * a
        A = second[..., None, None] * a[..., :, None] * a[..., None, :] + first[..., None, None] * da
        memory = old
        if self.tissue.softening is not None:
            P, A, largest = self._soften(P, A, (C10 + (C20 + C30 * x) * x) * x, old)
            memory = replace(memory, energy=largest)
        if self.tissue.prony:
            P, A, elastic, branches = self._relax(F, P, A, old, increment_s)
            memory = replace(memory, elastic=elastic, branches=branches)
        return Stress(P + pressure[..., None] * cof, A + pressure[..., None, None] * dcof, J, cof, memory)

    def _soften(self, P: np.ndarray, A: np.ndarray, energy: np.ndarray, old: Memory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stress and derivative below the largest past energy, and that energy now."""
        assert self.tissue.softening is not None
        inverse_r, m_Pa, beta = self.tissue.softening
        largest = np.maximum(old.energy, energy)
        width = 1e-6 * m_Pa + beta * largest
        y = (largest - energy) / width
        eta = 1.0 - inverse_r * erf(y)
        slope = np.where(energy < old.energy, inverse_r * 2.0 / np.sqrt(np.pi) * np.exp(-(y**2)) / width, 0.0)
        A = eta[..., None, None] * A + slope[..., None, None] * P[..., :, None] * P[..., None, :]
        return eta[..., None] * P, A, largest

    def _relax(
        self, F: np.ndarray, P: np.ndarray, A: np.ndarray, old: Memory, increment_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
        """What is left of stress and derivative; exact where the law's stress changes linearly over the increment."""
        rr, rz, zr, zz, tt = np.moveaxis(F, -1, 0)
        flat = rr * zz - rz * zr
        S = np.stack(  # F^-1 P
            [
                (zz * P[..., 0] - rz * P[..., 2]) / flat,
                (zz * P[..., 1] - rz * P[..., 3]) / flat,
                (-zr * P[..., 1] + rr * P[..., 3]) / flat,
                P[..., 4] / tt,
            ],
            axis=-1,
        )
        share, past, branches = 1.0 - sum(g for g, _ in self.tissue.prony), np.zeros_like(S), []
        for (g, tau), branch in zip(self.tissue.prony, old.branches, strict=True):
            y = increment_s / tau
            left, mean = np.exp(-y), (-np.expm1(-y) / y if y > 0.0 else 1.0)
            share += g * mean
            past = past + left * branch - g * mean * old.elastic
            branches.append(left * branch + g * mean * (S - old.elastic))
        H = np.zeros((*S.shape[:-1], 5, 5))
        H[..., 0, 0] = H[..., 2, 2] = past[..., 0]
        H[..., 1, 1] = H[..., 3, 3] = past[..., 2]
        H[..., 0, 1] = H[..., 1, 0] = H[..., 2, 3] = H[..., 3, 2] = past[..., 1]
        H[..., 4, 4] = past[..., 3]
        return share * P + np.einsum("eqij,eqj->eqi", H, F), share * A + H, S, tuple(branches)
