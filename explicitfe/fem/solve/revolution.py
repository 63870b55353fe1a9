"""A specimen of revolution under a rigid tool, solved by Newton's method: smooth answers for the comparison of hypotheses.

The relaxation of hexahedra serves every body. A body of revolution needs no more than its section, on which quadratic elements
and a factorized stiffness give answers that are smooth in load, time and constants. The tool is met by stiff springs at Gauss
points of the surface, and what they give way by is taken off its depth.

Tissues that differ by little (variants) are followed at the same time. Each has its own state and memory, but is solved with the
factors of the first one, so that it costs a fraction of a run: the differences are the derivatives that a fit needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.forces import response
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import quad9
from explicitfe.fem.solve.load_outcome import Stuck
from explicitfe.fem.solve.section import RevolvedSection, lines
from explicitfe.fem.solve.section_newton import LEAST_WAY_SHARE, SectionNewton
from explicitfe.fem.solve.section_tissue import SectionTissue, incompressible, is_isochoric, tissue_in_section
from explicitfe.fem.solve.tool_surface import touch
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import stopping

# A variant with contact that is stiffer by this share shows what the springs give way by.
STIFFER_SHARE, LEAST_GIVING, MOST_GIVING = 0.01, 0.5, 4.0
# Forces below this share of the largest one do not show it; a change by this share of the tool's way matters.
LEAST_WEIGHED_SHARE, GIVING_TOLERANCE = 0.01, 1e-5
# The next step of a load is longer by this ratio after few iterations, and shorter after many.
EASY_ITERATIONS, HARD_ITERATIONS, STRIDE_GROWTH = 4, 6, 1.5
# A part of the body may snap where a load is shortened to this share of it; so often it is shortened again.
SMALLEST_SHARE, MOST_CREEPS = 1.0 / 64.0, 3
# A variant has so many steps; none must be larger than the last by this ratio, until they are this share of the tool's way.
VARIANT_ITERATIONS, VARIANT_RATIO, VARIANT_TOLERANCE_SHARE = 12, 3.0, 5e-8
# A tool that presses with nothing still touches: with this share of the largest force so far. It begins this share of the height
# deep.
TOUCHING_SHARE, FIRST_DEPTH_SHARE = 1e-6, 1e-4
# The start of a load is extrapolated by no more than so many of the last increment.
LONGEST_SECTION_EXTRAPOLATION = 2.0


class ToolState(NamedTuple):
    """An equilibrium.

    Attributes
    ----------
    force_N, displacement_m : of the tool; the displacement counts from first touch.
    iterations : number of Newton steps that it took.
    variants : force and displacement of each variant; None where it was lost.
    """

    force_N: float
    displacement_m: float
    iterations: int
    variants: tuple[tuple[float, float] | None, ...] = ()


def can_solve(specimen: SpecimenTable, effects: Sequence[Effect]) -> bool:
    """Whether a test is one of a body of revolution."""
    return specimen.size_mm is None and all(effect.in_revolution for effect in effects)


class Revolution:
    """A body of revolution under a tool, with the interface of :class:`explicitfe.fem.solve.equilibrium.Relaxation`.

    Parameters
    ----------
    specimen, tool : tables of the test; the material is ``law``.
    law : elastic law.
    effects : of the material, the specimen, the tool and the rig.
    fineness : divides the element sizes.
    keeps_volume : the volume of the tissue does not change, whatever the law's Poisson's ratio, unless an effect changes it.
    variants : laws with effects that differ by little from the first ones, in numbers only.

    Raises
    ------
    InputError : a block, or an effect that is none of a body of revolution.
    """

    def __init__(
        self,
        specimen: SpecimenTable,
        tool: ToolTable,
        law: Yeoh,
        effects: Sequence[Effect] = (),
        fineness: float = 1.0,
        keeps_volume: bool = True,
        variants: Sequence[tuple[Yeoh, Sequence[Effect]]] = (),
    ) -> None:
        if not can_solve(specimen, effects):
            raise InputError("Revolution: this test is none of a body of revolution; use a Relaxation.")
        prepared, prepared_tool = specimen, tool
        for effect in effects:
            prepared, prepared_tool = effect.prepare(prepared, prepared_tool)
        bonded = specimen.base == "bonded"
        gives_way = bonded and sum(effect.base_compliance_m_Pa for effect in effects) > 0.0
        self.section = section = RevolvedSection(
            prepared, prepared_tool, *lines(prepared, prepared_tool, fineness), base_gives_way=gives_way
        )
        self._may_keep, self.keeps_volume = keeps_volume, keeps_volume and is_isochoric(effects)
        if self.keeps_volume:
            law = incompressible(law)
            variants = [(incompressible(other), own) for other, own in variants]
        every = [(law, effects), *variants] if section.tied else [(law, effects), *variants, (law, effects)]
        tissues = [tissue_in_section(section, prepared.layer_mm, specimen, tool, *one) for one in every]
        self.main, *self.variants = tissues
        layout = response.layout_of(self.main.materials)
        for (_, own), one in zip(every[1:], self.variants, strict=True):
            one.lost = not self._is_alike(one, layout, own)
        self._probe = None if section.tied else self.variants[-1]
        if self._probe is not None:
            self._probe.profile[4] *= 1.0 + STIFFER_SHARE
        self._largest_weighed = law.shear_modulus_Pa * section.height**2
        ours = law
        for effect in effects:
            ours = effect.in_law(ours)
        self.newton = SectionNewton(section, self.main, law.law, law.shear_modulus_Pa, float(ours.constants()[-1]))
        self.time_s = self._largest = 0.0
        self._known_kink = bool(self.main.materials)
        self._has_memory = self._known_kink or any(one.profile[6] > 0.0 for one in tissues)
        self._by_force, self._stride, self._increment = False, np.inf, np.nan
        self._followed = self.main.u, self.main.depth, self.main.pressures  # where the variants were brought to last
        # Coordinate, displacements, depth and pressures of the last equilibria.
        self._known: list[tuple[float, np.ndarray, float, np.ndarray]] = []

    def _is_alike(self, one: SectionTissue, layout: response.Layout, effects: Sequence[Effect]) -> bool:
        """Whether a variant has the unknowns and the kernels of the first tissue, and comes to first touch alike."""
        main = self.main
        same = response.layout_of(one.materials) == layout and (one.rig.preload_N > 0.0) == (main.rig.preload_N > 0.0)
        springs, weight = len(one.springs) == len(main.springs), one.dead.any() == main.dead.any()
        return bool(same and springs and weight and (not self._may_keep or is_isochoric(effects) == self.keeps_volume))

    @property
    def iterations(self) -> int:
        """Number of Newton steps so far."""
        return self.newton.iterations

    # ---- what a load does ----

    def compile(self) -> None:
        """Compile the kernels, or load them from the cache."""
        self.newton.evaluate(self.main, with_stiffness=True)
        self.newton.evaluate(self.main)

    def settle(self) -> ToolState | Stuck:
        """Find the equilibrium under the weight; afterwards the tool just touches the body, or bears the preload."""
        self._set_increment(0.0)
        every = [self.main, *self.variants]
        if self.main.dead.any():
            for one in every:
                one.depth = 0.0 if self.section.tied else -self.section.height
            self._followed = self.main.u, self.main.depth, self.main.pressures
            if not self.newton.reach((1.0, 0.0), self.main.depth):
                return self._stuck(0.0, 0.0)
            self._follow((1.0, 0.0), [one.depth for one in self.variants])
            self._accept(0.0)
            for one in every:
                one.depth = one.touch = 0.0 if self.section.tied else self._first_touch(one)
                one.anchors[:, 2] = one.touch
        self._known = [(0.0, self.main.u.copy(), self.main.touch, self.main.pressures.copy())]
        self._followed = self.main.u, self.main.depth, self.main.pressures
        if self.main.rig.preload_N > 0.0:
            goals = [one.rig.preload_N for one in self.variants]
            reached = self._approach(self.main.rig.preload_N, True, 0.0, goals)
            if isinstance(reached, Stuck):
                return reached
            for one in every:
                one.touch += one.displacement
        return self._state(0)

    def press(self, force_N: float, *, at_s: float | None = None) -> ToolState | Stuck:
        """Find the equilibrium under a force of the tool [N], from the last one; see ``Relaxation.press``."""
        self._largest = max(self._largest, abs(force_N))
        goal = force_N if self.section.tied else max(force_N, TOUCHING_SHARE * self._largest)
        reached = self._approach(goal, True, self.time_s if at_s is None else at_s, [goal] * len(self.variants))
        if isinstance(reached, Stuck) or goal == force_N:
            return reached
        return reached._replace(force_N=force_N)

    def move(self, displacement_m: float, *, at_s: float | None = None) -> ToolState | Stuck:
        """Find the equilibrium at a displacement of the machine [m] since first touch; see ``Relaxation.move``."""
        goals = [displacement_m + one.touch for one in self.variants]
        return self._approach(displacement_m + self.main.touch, False, self.time_s if at_s is None else at_s, goals)

    @property
    def displacement(self) -> np.ndarray:
        """Displacements r, z (n, 2) of the nodes [m]."""
        return self.main.u.reshape(-1, 2)

    @property
    def gradients(self) -> np.ndarray:
        """Displacement gradients (p, 9) of the material at the Gauss points in the last equilibrium, axes r, around, z."""
        self.newton.evaluate(self.main)
        values = np.zeros((len(self.newton.work.gradients), 9))
        values[:, [quad9.RR, quad9.RZ, quad9.ZR, quad9.ZZ, quad9.AROUND]] = (
            self.newton.work.volumes[:, 1:2] * self.newton.work.gradients
        )
        return values - np.eye(3).ravel()

    def _state(self, iterations: int) -> ToolState:
        shown = self.variants if self._probe is None else self.variants[:-1]
        variants = tuple(None if one.lost else (one.force, one.displacement) for one in shown)
        return ToolState(self.main.force, self.main.displacement, iterations, variants)

    # ---- the way to a load ----

    def _approach(self, goal: float, by_force: bool, at_s: float, goals: Sequence[float]) -> ToolState | Stuck:
        """Apply an increment of load and time in adaptive substeps."""
        main, before = self.main, self.iterations

        def coordinate(one: SectionTissue) -> float:
            return one.force if by_force else one.displacement + one.touch

        begin, begins, since = coordinate(main), [coordinate(one) for one in self.variants], self.time_s
        if by_force != self._by_force:
            self._by_force, self._stride = by_force, np.inf
            self._known = [(begin, *self._known[-1][1:])]
        if by_force and not self.section.tied and main.force <= 0.0 and main.depth <= main.touch:
            main.depth += FIRST_DEPTH_SHARE * self.section.height
        weights = (0.0, 1.0) if by_force else (1.0, main.rig.compliance_m_N)
        distance = abs(goal - begin)
        done, extrapolated, creeps = 0.0, True, 0  # times that the present step has been shortened where a part of the body snaps
        while done < 1.0:
            stopping.check()
            share = 1.0 if distance == 0.0 or creeps else min(1.0, done + self._stride / distance)
            if creeps:
                share = done + (1.0 - done) * 0.5 ** (creeps - 1)
            elif share < 1.0:  # the remaining steps are alike
                share = done + (1.0 - done) / np.ceil((1.0 - done) / (share - done))
            now = goal if share == 1.0 else begin + share * (goal - begin)
            self._set_increment((share - done) * (at_s - since))
            start = main.u, main.depth, main.pressures, self.iterations
            extrapolated = extrapolated and not creeps and self._extrapolate(now)
            if (
                self.newton.creep(weights, now)
                if creeps
                else self.newton.reach(weights, now, nudged=self._known_kink and not extrapolated)
            ):
                turns, step = self.iterations - start[3], (share - done) * distance
                own_goals = [a + share * (b - a) for a, b in zip(begins, goals, strict=True)]
                # Without a memory of the way, variants are needed at the end of the load only.
                follows = share == 1.0 or self._has_memory
                if follows:
                    self._follow(weights, own_goals)
                # What the springs give way by belongs to the depth of the machine: solve again with a better estimate.
                if follows and self._weigh_springs() and not by_force and self.newton.reach(weights, now):
                    self._follow(weights, own_goals, again=True)
                self._accept(now, followed=follows)
                if step > 0.0 and turns <= EASY_ITERATIONS and not creeps:
                    self._stride = max(self._stride if np.isfinite(self._stride) else step, STRIDE_GROWTH * step)
                elif step > 0.0 and turns > HARD_ITERATIONS:
                    self._stride = step / STRIDE_GROWTH
                done, extrapolated, creeps = share, True, 0
                continue
            main.u, main.depth, main.pressures, _ = start
            self.newton.forget_factors()
            if extrapolated:
                extrapolated = False  # begin at the last equilibrium instead
            elif creeps or share - done <= SMALLEST_SHARE or distance == 0.0:
                if creeps == MOST_CREEPS:
                    return self._stuck(goal, begin + done * (goal - begin))
                creeps += 1
            else:
                self._stride = 0.5 * (share - done) * distance
        self.time_s = at_s
        return self._state(self.iterations - before)

    def _extrapolate(self, goal: float) -> bool:
        """Begin on a parabola through the last equilibria, where they lead on to the goal."""
        last = self._known[-3:]
        at = [known[0] for known in last]
        if len(last) < 2 or len(set(at)) < len(at) or abs(goal - at[-1]) > LONGEST_SECTION_EXTRAPOLATION * abs(at[-1] - at[-2]):
            return False
        if (goal - at[-1]) * (at[-1] - at[-2]) <= 0.0:
            return False
        weights = [float(np.prod([(goal - q) / (p - q) for q in at if q != p])) for p in at]
        self.main.u = np.sum([w * known[1] for w, known in zip(weights, last, strict=True)], axis=0)
        self.main.depth = float(sum(w * known[2] for w, known in zip(weights, last, strict=True)))
        self.main.pressures = np.sum([w * known[3] for w, known in zip(weights, last, strict=True)], axis=0)
        return True

    # ---- Newton's method ----

    def _weigh_springs(self) -> bool:
        """Find what the springs give way by: it is inverse to their stiffness, at the same force (Richardson).

        Returns
        -------
        Whether it has changed so much that the depth of the machine is another.
        """
        probe, main = self._probe, self.main
        if probe is None or probe.lost or main.force <= LEAST_WEIGHED_SHARE * self._largest_weighed:
            return False
        self._largest_weighed = max(self._largest_weighed, main.force)
        giving = (main.depth - probe.depth) * (1.0 + STIFFER_SHARE) / STIFFER_SHARE
        before = main.compression
        ratio = min(max(giving * self.newton.giving / before, LEAST_GIVING), MOST_GIVING)
        for one in (main, *self.variants):
            one.compression *= ratio / self.newton.giving
        self.newton.giving = ratio
        return abs(main.compression - before) > GIVING_TOLERANCE * abs(main.depth - main.touch)

    def _follow(self, weights: tuple[float, float], goals: Sequence[float], *, again: bool = False) -> None:
        """Bring the variants to their goals, with the factors of the first tissue; again from where they are."""
        main, fresh = self.main, False  # whether the factors are those of the equilibrium itself
        u, depth, pressures = (main.u, main.depth, main.pressures) if again else self._followed
        self._followed = main.u, main.depth, main.pressures
        if self._probe is not None and self._probe.lost:  # it begins anew as the first tissue
            probe = self._probe
            probe.lost, probe.u, probe.depth, probe.pressures, probe.touch = False, u, depth, pressures, main.touch
            probe.blocks.old[:], probe.anchors[:] = main.blocks.old, main.anchors
        for one, goal in zip(self.variants, goals, strict=True):
            begin = one.u + (main.u - u), one.depth + (main.depth - depth), one.pressures + (main.pressures - pressures)
            own = (weights[0], one.rig.compliance_m_N if weights[0] else weights[1])
            if one is self._probe:
                own, goal = (0.0, 1.0), main.force
            if one.lost or self._converge(one, begin, own, goal):
                continue
            if not fresh:
                fresh = self._factorize(main)
                if fresh and self._converge(one, begin, own, goal):
                    continue
            # It touches the tool elsewhere than the first tissue: Newton's method with derivatives of its own.
            one.lost = not self._converge(one, begin, own, goal, alone=True)
            fresh = self._factorize(main)

    def _factorize(self, one: SectionTissue) -> bool:
        """Take the derivatives at a state; False where that is impossible."""
        return self.newton.evaluate(one, with_stiffness=True) is not None and self.newton.factorize()

    def _converge(
        self,
        one: SectionTissue,
        begin: tuple[np.ndarray, float, np.ndarray],
        weights: tuple[float, float],
        goal: float,
        *,
        alone: bool = False,
    ) -> bool:
        """Iterate from a state; False if the iteration diverges.

        Parameters
        ----------
        alone : with derivatives at each step, and not with the present factors.
        """
        last = np.inf
        one.u, one.depth, one.pressures = begin
        least = VARIANT_TOLERANCE_SHARE * max(abs(self.main.depth - self.main.touch), LEAST_WAY_SHARE * self.section.height)
        for _ in range(VARIANT_ITERATIONS):
            if alone and not self._factorize(one):
                return False
            rows = self.newton.evaluate(one)
            if rows is None:
                return False
            step, size = self.newton.step_of(one, rows, weights, goal)
            if size <= least:
                return True
            if size > VARIANT_RATIO * last:
                return False
            self.newton.move_by(one, (one.u, one.depth, one.pressures), 1.0, step)
            last = size
        return False

    def _accept(self, coordinate: float, *, followed: bool = True) -> None:
        """Keep the equilibrium: the memory of the material, and where friction has slipped to."""
        for one in [*(self.variants if followed else []), self.main]:
            if one.lost:
                continue
            surface = one.section.surface
            if one.profile[6] > 0.0:
                touch(
                    one.u,
                    one.depth,
                    one.profile,
                    surface,
                    one.anchors,
                    self.newton.contact,
                    self.newton.contact_stiffness,
                    self.newton.tractions,
                )
            if one.materials:
                one.blocks.old[:] = one.blocks.new
            moved = np.einsum("ka,kai->ki", surface.shape, one.u.reshape(-1, 2)[surface.nodes])
            one.anchors[:, :2] = surface.places + moved
            one.anchors[:, 2], one.anchors[:, 3] = one.depth, self.newton.tractions[:, 0]
        main = self.main
        self._known = [*self._known[-2:], (coordinate, main.u.copy(), main.depth, main.pressures.copy())]

    def _set_increment(self, increment_s: float) -> None:
        if self.main.materials and increment_s != self._increment:
            for one in (self.main, *self.variants):
                values = [value for effect in one.materials for value in effect.values(increment_s)]
                one.blocks.effects[:] = np.array(values)[None, :, None] if values else 0.0
            self.newton.forget_factors()
        self._increment = increment_s

    def _first_touch(self, one: SectionTissue) -> float:
        """Depth of the tool at which it touches the sagged surface."""
        surface = one.section.surface
        moved = surface.places + np.einsum("ka,kai->ki", surface.shape, one.u.reshape(-1, 2)[surface.nodes])
        height, flat, edge, platen = one.profile[:4]
        out = np.zeros(len(moved)) if platen else np.maximum(moved[:, 0] - flat, 0.0)
        under = out <= edge
        rise = edge - np.sqrt(np.maximum(edge**2 - out**2, 0.0))
        return float(np.min((height + rise - moved[:, 1])[under]))

    def _stuck(self, goal: float, reached: float) -> Stuck:
        return Stuck("not-converged", goal, reached, np.nan, self.main.force, np.zeros(3))
