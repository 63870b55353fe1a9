"""Newton's method for a tissue in the section of a body of revolution under a tool."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import lapack

from explicitfe.fem.forces import response
from explicitfe.fem.solve import quad9
from explicitfe.fem.solve.section import RevolvedSection
from explicitfe.fem.solve.section_tissue import SectionTissue
from explicitfe.fem.solve.tool_surface import add_forces, assemble, touch

# Differences of deformation gradients.
DIFFERENCE_STEP = 1e-6
# Convergence tolerance of the Newton step, relative to the displacement of the tool. The displacement counts as at least this
# share of the height.
TOLERANCE_SHARE, LEAST_WAY_SHARE = 1e-6, 1e-2
MOST_NEWTON_ITERATIONS, MOST_CUTS = 12, 4
# A step with old derivatives is kept unless the next one would be longer by this ratio. Share of a step that leaves a kink.
WILD_RATIO, NUDGE = 2.0, 0.05
# Where a part of the body snaps: resistance over the shear modulus times the height, at least; number of steps; no step
# moves a node further than this share of the smallest element.
LEAST_RESISTANCE, MOST_CREEP_STEPS, CREEP_SHARE = 1e-5, 80, 0.2
# A factorization is used again as long as each step is smaller than the last by this ratio.
GOOD_RATIO = 0.2
# No step moves a node further than this share of the height.
LONGEST_NEWTON_STEP_SHARE = 0.1
# Derivatives are symmetric up to this share of the largest one: differences of gradients err by some 1e-6.
ASYMMETRY_SHARE = 2e-5
TINY = 1e-300

Step = tuple[np.ndarray, float, np.ndarray]  # displacements [m], depth [m], and pressures [Pa]


class SectionNewton:
    """Equations of a section, with the last factorization of their derivatives, which serves similar tissues too.

    Attributes
    ----------
    section, main : the mesh, and the tissue for which derivatives are taken.
    giving : what the springs of the contact give way by, over the simplest estimate of it.
    iterations : number of Newton steps so far.
    """

    def __init__(
        self, section: RevolvedSection, main: SectionTissue, law: str, shear_modulus_Pa: float, bulk_modulus_Pa: float
    ) -> None:
        self.section, self.main = section, main
        self.giving, self.iterations = 1.0, 0
        self._bulk, mass = bulk_modulus_Pa, section.quads.mass
        self._inverse, self._softness = bulk_modulus_Pa * section.quads.inverse, mass / bulk_modulus_Pa
        self._usual_stiffness = 2.0 * np.pi * shear_modulus_Pa * section.height
        count = len(section.quads.nodes)
        self._forces_of, self._stiffness_of = quad9.kernels(law, response.layout_of(main.materials))
        points, lanes = 9 * count, len(main.blocks.nodes)
        self.work = quad9.work_for(points, lanes)
        self.forces, self._growth = np.zeros((count, 18)), np.zeros((count, quad9.LINEAR))
        self._stiffness = np.zeros((count, 18, 18))
        self._coupling, self._spread = np.zeros((count, 18, quad9.LINEAR)), np.zeros((count, 18, quad9.LINEAR))
        surface = len(section.surface.areas)
        self.contact, self.contact_stiffness = np.zeros((surface, 7)), np.zeros((surface, 7, 7))
        self.tractions = np.zeros((surface, 2))
        self._sign = -1.0 if section.tied else 1.0  # nodes that a tool carries go up as its depth goes down
        self._factors: Any = None
        self._factors_are_old = False
        self._resistance = 0.0
        self._symmetric = False

    def forget_factors(self) -> None:
        """Take the derivatives again where they are needed next."""
        self._factors = None

    def reach(self, weights: tuple[float, float], goal: float, *, nudged: bool = False) -> bool:
        """Solve for the state where weights @ (depth, force) = goal; False where Newton's method does not converge.

        A step is shortened until the next step with the same derivatives would be smaller than it (natural monotonicity;
        Deuflhard 2004), and the derivatives are taken again unless it is smaller by far.

        Parameters
        ----------
        nudged : take the derivatives a small step away from the start, where the response of a material may have a kink.
        """
        main = self.main
        rows = self.evaluate(main, with_stiffness=self._factors is None)
        if rows is None or (self._factors is None and not self.factorize()):
            return False
        step, size = self.step_of(main, rows, weights, goal)
        if nudged and not self._factors_are_old:
            self.move_by(
                main, (main.u, main.depth, main.pressures), NUDGE * min(1.0, self.section.height / max(size, TINY)), step
            )
            rows = self.evaluate(main, with_stiffness=True)
            if rows is None or not self.factorize():
                return False
            step, size = self.step_of(main, rows, weights, goal)
        factor = 1.0
        for _ in range(MOST_NEWTON_ITERATIONS):
            self.iterations += 1
            if not np.isfinite(size):
                return False
            factor = min(1.0, 4.0 * factor, LONGEST_NEWTON_STEP_SHARE * self.section.height / max(size, TINY))
            before = main.u, main.depth, main.pressures
            for _ in range(1 if self._factors_are_old else MOST_CUTS):
                self.move_by(main, before, factor, step)
                rows = self.evaluate(main)
                if rows is not None:
                    next_step, next_size = self.step_of(main, rows, weights, goal)
                    if next_size <= (1.0 - 0.25 * factor) * size:
                        break
                factor *= 0.5
            else:
                if not self._factors_are_old:
                    main.u, main.depth, main.pressures = before
                    return False
                if rows is None or next_size > WILD_RATIO * size:
                    main.u, main.depth, main.pressures = before
                rows = None
            if rows is not None:
                if next_size <= TOLERANCE_SHARE * max(abs(main.depth - main.touch), LEAST_WAY_SHARE * self.section.height):
                    self.move_by(main, (main.u, main.depth, main.pressures), 1.0, next_step)
                    rows = self.evaluate(main)
                    if rows is not None:
                        self.step_of(main, rows, weights, goal)
                    return rows is not None
                if next_size <= GOOD_RATIO * size and factor == 1.0:
                    step, size = next_step, next_size
                    self._factors_are_old = True
                    continue
            rows = self.evaluate(main, with_stiffness=True)
            if rows is None or not self.factorize():
                return False
            step, size = self.step_of(main, rows, weights, goal)
        return False

    def creep(self, weights: tuple[float, float], goal: float) -> bool:
        """Go downhill to the next stable state where a small part of the body snaps, as tissue does that slips over an edge.

        A resistance is added to the stiffness that makes it positive definite (Levenberg 1944). False where it does not arrive.
        """
        main, resistance = self.main, 0.0
        for _ in range(MOST_CREEP_STEPS):
            rows = self.evaluate(main, with_stiffness=True)
            if rows is None or not self.factorize(resistance, definite=True):
                return False
            resistance = 0.25 * self._resistance
            step, size = self.step_of(main, rows, weights, goal)
            if not np.isfinite(size):
                return False
            if size < TOLERANCE_SHARE * LEAST_WAY_SHARE * self.section.height:
                return True
            factor = min(1.0, CREEP_SHARE * self.section.smallest / size)
            before = main.u, main.depth, main.pressures
            for _ in range(MOST_CUTS):
                self.move_by(main, before, factor, step)
                if self.evaluate(main) is not None:
                    break
                factor *= 0.25
            else:
                return False
        return False

    def step_of(self, one: SectionTissue, rows: np.ndarray, weights: tuple[float, float], goal: float) -> tuple[Any, float]:
        """Newton's step of unknowns, depth and pressures with the last factorization, and its size [m]."""
        of_depth, of_force = weights
        factors, pivots, along, row, slope = self._factors
        solved = self._solve(factors, pivots, rows[:-1])
        one.force = float(rows[-1])
        one.compression = self._compression(one)
        wrong = goal - of_depth * (one.depth - one.compression) - of_force * rows[-1] + of_force * float(row @ solved)
        stiffness = of_depth + of_force * (slope - float(row @ along))
        down = wrong / (stiffness if stiffness != 0.0 else TINY)
        step = -solved - down * along
        change = np.zeros_like(one.u)
        change[self.section.free] = step
        change[self.section.carried] = -down
        growth = self._growth + np.einsum("mak,ma->mk", self._coupling, change[self.section.element_dofs])
        pressed = np.einsum("mkl,ml->mk", self._inverse, growth)
        return (change, down, pressed), max(float(np.abs(change).max(initial=0.0)), abs(down))

    def move_by(self, one: SectionTissue, before: tuple[np.ndarray, float, np.ndarray], factor: float, step: Any) -> None:
        """Go a share of a step from a state."""
        change, down, pressed = step
        u, depth, pressures = before
        one.u, one.depth = u + factor * change, depth + factor * down
        one.pressures = pressures + factor * pressed

    def _compression(self, one: SectionTissue) -> float:
        """How much deeper the tool is than a rigid one would be [m]: the springs of the contact are in series with the body."""
        if self.section.tied or one.force <= 0.0:
            return 0.0
        return self.giving * float(one.section.surface.areas @ self.tractions[:, 1] ** 2) / (one.profile[4] * one.force)

    def evaluate(self, one: SectionTissue, *, with_stiffness: bool = False) -> np.ndarray | None:
        """Unbalanced forces (count + 1,) [N], the last one that of the tool; None where an element is inverted.

        The pressures are eliminated by the last derivatives.
        """
        section = one.section
        own = (one.u, one.pressures)
        others = (self._bulk, section.quads, one.blocks, self.work, self.forces, self._growth)
        if with_stiffness:
            fine = self._stiffness_of(*own, DIFFERENCE_STEP, *others, self._stiffness, self._coupling, self._spread)
            if fine:
                self._symmetric = self._make_symmetric()
                self._spread = self._spread @ self._inverse
                self._stiffness += self._spread @ self._coupling.transpose(0, 2, 1)
        else:
            fine = self._forces_of(*own, *others)
        if not fine:
            return None
        self._growth -= np.einsum("mkl,ml->mk", self._softness, one.pressures)
        self.forces += np.einsum("mak,mk->ma", self._spread, self._growth)
        rows = np.zeros(section.count + 1)
        surface = section.surface
        touch(one.u, one.depth, one.profile, surface, one.anchors, self.contact, self.contact_stiffness, self.tractions)
        add_forces(section.element_numbers, self.forces, rows)
        rows[-1] *= self._sign
        add_forces(section.surface_numbers, self.contact, rows)
        if len(one.springs):
            add_forces(section.base_numbers, np.einsum("kab,kb->ka", one.springs, one.u[section.base_dofs]), rows)
        rows[:-1] -= one.dead[section.free]
        return rows if np.isfinite(rows).all() else None

    def factorize(self, resistance: float = 0.0, *, definite: bool = False) -> bool:
        """Assemble and factorize the stiffness of the state evaluated last; with a resistance that makes it definite."""
        if self._symmetric and _is_near(self.contact_stiffness, self.contact_stiffness.transpose(0, 2, 1)):
            lower, column, row = self._assembled(0, self.section.band + 1)
            if definite and not self._make_definite(lower, lower, resistance):
                return False
            factors, info = lapack.dpbtrf(lower, lower=1, overwrite_ab=True)
            if info == 0:
                self._keep(factors, None, column, row)
                return True
        band, n = self.section.band, self.section.count
        matrix, column, row = self._assembled(2 * band, 3 * band + 1)
        if definite:
            lower = 0.5 * matrix[2 * band :]
            for k in range(band + 1):  # the symmetric part; column j of row k holds the entry (j + k, j)
                lower[k, : n - k] += 0.5 * matrix[2 * band - k, k:]
            if not self._make_definite(lower, matrix[2 * band :], resistance):
                return False
        factors, pivots, info = lapack.dgbtrf(matrix, band, band, overwrite_ab=True)
        if info == 0:
            self._keep(factors, pivots, column, row)
        return bool(info == 0)

    def _make_symmetric(self) -> bool:
        """Whether the derivatives of the elements are symmetric, as those of a potential are.

        The coupling is then made so exactly, because the bulk modulus would magnify what differences leave of an asymmetry.
        """
        coupling, spread, stiffness = self._coupling, self._spread, self._stiffness
        ratio = np.einsum("mak,mak->m", coupling, spread) / np.maximum(np.einsum("mak,mak->m", spread, spread), TINY)
        alike = ratio[:, None, None] * spread
        symmetric = _is_near(coupling, alike) and _is_near(stiffness, stiffness.transpose(0, 2, 1))
        if symmetric:
            self._coupling[:] = alike
        return symmetric

    def _assembled(self, diagonal: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrix (height, n) in band storage, its diagonal in one row; column and row (n + 1,) of the tool's depth."""
        section, springs = self.section, self.main.springs
        n = section.count
        matrix = np.zeros((height, n), order="F")
        rows, column, row = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
        assemble(section.element_numbers, self.forces, self._stiffness, diagonal, rows, matrix, column, row)
        column[:-1] *= self._sign
        row[:-1] *= self._sign
        assemble(section.surface_numbers, self.contact, self.contact_stiffness, diagonal, rows, matrix, column, row)
        if len(springs):
            assemble(section.base_numbers, np.zeros(springs.shape[:2]), springs, diagonal, rows, matrix, column, row)
        return matrix, column, row

    def _make_definite(self, lower: np.ndarray, changed: np.ndarray, resistance: float) -> bool:
        """Add the least resistance to the diagonal of a matrix (its first row) that makes its symmetric part definite."""
        usual = self._usual_stiffness
        while True:
            shifted = lower.copy()
            shifted[0] += resistance * usual
            if lapack.dpbtrf(shifted, lower=1, overwrite_ab=True)[1] == 0:
                break
            if resistance > 1.0:
                return False
            resistance = max(4.0 * resistance, LEAST_RESISTANCE)
        self._resistance = resistance
        changed[0] += resistance * usual
        return True

    def _keep(self, factors: np.ndarray, pivots: np.ndarray | None, column: np.ndarray, row: np.ndarray) -> None:
        """Keep a factorization, and what the depth of the tool changes; without pivots it is that of Cholesky."""
        self._factors = (factors, pivots, self._solve(factors, pivots, column[:-1]), row[:-1], float(column[-1]))
        self._factors_are_old = False

    def _solve(self, factors: np.ndarray, pivots: np.ndarray | None, right: np.ndarray) -> np.ndarray:
        if pivots is None:
            solution, _ = lapack.dpbtrs(factors, right, lower=1)
        else:
            solution, _ = lapack.dgbtrs(factors, self.section.band, self.section.band, right, pivots)
        return solution


def _is_near(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays differ by no more than differences err."""
    return float(np.abs(one - other).max(initial=0.0)) <= ASYMMETRY_SHARE * float(np.abs(one).max(initial=0.0))
