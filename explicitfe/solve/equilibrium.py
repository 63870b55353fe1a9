"""Equilibrium by dynamic relaxation: a body under a rigid tool, from one load to the next.

The masses are fictitious, so that one iteration is a step of 1 at a fraction of the stable limit everywhere (Underwood 1983;
Joldes, Wittek & Miller 2011). They are found anew for every load: compressed elements stiffen. A load that cannot be reached in
one go is approached in halves; what a history needs is committed at equilibrium only, since the iterates overshoot.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from explicitfe.compiled.arrays import (
    COMPLIANCE,
    DEPTH,
    DRIVE,
    FREE,
    FRICTION,
    GOAL,
    KINETIC_RATIO,
    LOAD,
    LOADS,
    MOMENT,
    MONITOR,
    PACE,
    POWER,
    RESIDUAL,
    REST_J,
    SHAPE,
    STIFFNESS,
    SUMS,
    TIED,
    TILT,
    TOOL,
    WORK,
    Contact,
    Nodes,
    Springs,
    Turned,
    zeros,
)
from explicitfe.compiled.threads import together
from explicitfe.model.model import Model
from explicitfe.solve.body import Body
from explicitfe.solve.parts import parts_of, usual_threads
from explicitfe.solve.relax_step import RESTLESS
from explicitfe.solve.stable_step import stiffness_rows

TOLERANCE = 1e-4
SAFETY = 1.1  # on the masses: what the tissue may stiffen by on the way to the next load
CHUNK = 400  # iterations between two looks from outside
ELEMENTS_A_THREAD = 500  # measured: threads stay together for so many iterations that waking them costs nothing
PATIENCE = 8000  # iterations without progress, the residual falling by a tenth, before a load is approached in halves
PROGRESS = 0.9
HALVINGS = 8
LEAD = 200  # iterations in which a tool whose way is given gets there
REACH = 1.5  # a load is extrapolated to by so many times the last increment
# The contact springs begin at this multiple of G / face size; they are doubled while the tool sinks in by more than its share.
SPRING = 4000.0
PENETRATION = 1e-3  # of the indentation
LEAST = 0.01  # of the largest load and work so far: a load that has all but gone is no measure of a residual
GRIP = 0.1  # stiffness of sticking, relative to that of pressing


@dataclass(frozen=True)
class Equilibrium:
    """A converged load, for the whole tool and body.

    Attributes
    ----------
    force_N, displacement_m : of the tool, positive into the tissue; the displacement counts from first touch.
    iterations : that it took, of all its parts.
    residual : of the nodal forces, relative to those of tool and loads.
    kinetic_ratio : kinetic energy of the last iteration, relative to the work.
    reaction_N : of the base along +z, less the weight that it carries.
    penetration_m : deepest point of the surface inside the tool.
    contact_radius_m : largest distance from the axis at which the tool presses.
    internal_J, hourglass_J : strain energy of the law, and energy of hourglass control.
    contact_J : energy of the contact springs.
    dead_work_J : work of the dead loads so far.
    friction_loss_J : slip so far, times friction.
    material_loss_J : work of the stress so far, less what is stored.
    smallest_J : smallest volume ratio of any element.
    """

    force_N: float
    displacement_m: float
    iterations: int
    residual: float
    kinetic_ratio: float
    reaction_N: float
    penetration_m: float
    contact_radius_m: float
    internal_J: float
    hourglass_J: float
    contact_J: float
    dead_work_J: float
    friction_loss_J: float
    material_loss_J: float
    smallest_J: float


@dataclass(frozen=True)
class Stuck:
    """A load that was not reached.

    Attributes
    ----------
    reason : "inverted" or "not-converged".
    goal : the force [N] or displacement [m] aimed at last.
    reached : the last that converged.
    residual : where the attempt was given up.
    place_m : (3,) where the largest unbalanced force, or the broken element, is.
    """

    reason: str
    goal: float
    reached: float
    residual: float
    place_m: np.ndarray


class Relaxation(Body):
    """A body with a tool, at rest, ready to be loaded.

    Parameters
    ----------
    model : the physics; ``model.tool`` may be None.
    tolerance : relative residual at which a load has converged.
    threads : that share an iteration; as many as it pays for a mesh of this size, if left out. One for a sector.
    """

    def __init__(self, model: Model, tolerance: float = TOLERANCE, threads: int | None = None) -> None:
        super().__init__(model)
        self.tolerance = tolerance
        self.iterations = 0
        self.friction_loss_J = 0.0
        self.touch_m = 0.0
        self.time_s = 0.0
        self._tie()
        self._grip()
        support = self.model.support
        self.springs = Springs(
            np.zeros(0, dtype=np.int64) if support is None else self._place[support.node],
            np.zeros((0, 3)) if support is None else np.array(support.stiffness, dtype=float),
        )
        self._external = self._dead_forces()
        self._inner = zeros(self.state.u.shape)
        count = 1 if len(self.turned.node) else threads or usual_threads(len(self.hexes), ELEMENTS_A_THREAD)
        self.parts = parts_of(self.state, self.blocks, count)
        self._sums = zeros((len(self.parts), SUMS))
        self._monitor = np.zeros(MONITOR)
        self._monitor[REST_J] = 1.0
        self._largest_load = self._largest_work = self._deepest = 0.0
        self._known: list[tuple[float, np.ndarray, float]] = []
        self._commit(0.0)

    # ---- what a load does ----

    def settle(self, progress: Callable[[float], None] = lambda share: None) -> Equilibrium | Stuck:
        """Equilibrium under the dead loads alone, the tool out of reach or, where it is tied, without a load; it then touches."""
        if not self._external.any() and self.contact.shape[TILT] == 0.0:
            return self._touched(0.0)
        tied = self.contact.shape[TIED] > 0.0
        beyond = 0.0 if tied else -1.0  # m
        self.tool[[FREE, LOAD, DEPTH, DRIVE, GOAL]] = float(tied), 0.0, beyond, beyond, beyond
        failure = self._attempt(progress)
        if failure is not None:
            return Stuck(failure, 0.0, 0.0, float(self._monitor[RESIDUAL]), self._worst(failure))
        if tied:
            return self._touched(float(self.tool[DEPTH]))
        # Down by the distance to the nearest point, again and again: the tool never gets past a point.
        gap = self._touch()[0].min(initial=np.inf)
        while 1e-15 < gap < np.inf:
            self.tool[DEPTH] += gap
            gap = self._touch()[0].min()
        return self._touched(float(self.tool[DEPTH]))

    def press(
        self, force_N: float, progress: Callable[[float], None] = lambda share: None, *, at_s: float | None = None
    ) -> Equilibrium | Stuck:
        """Equilibrium under a force of the tool [N], from the last one; ``at_s``, when, for a material that remembers."""
        return self._approach(force_N, True, self.time_s if at_s is None else at_s, progress)

    def move(
        self, displacement_m: float, progress: Callable[[float], None] = lambda share: None, *, at_s: float | None = None
    ) -> Equilibrium | Stuck:
        """Equilibrium at a displacement of the tool [m] since first touch, from the last one; ``at_s`` as for a force."""
        return self._approach(displacement_m, False, self.time_s if at_s is None else at_s, progress)

    # ---- what is known ----

    def compile(self, progress: Callable[[float], None] = lambda share: None) -> float:
        """Make the machine code ready, from the cache on disk where it is there; give the seconds it took.

        ``progress`` is called with the share that is done.
        """
        begin = time.perf_counter()
        progress(0.0)
        self.kernels.forces(self.state.u, np.zeros_like(self.state.u), self.blocks)
        progress(0.4)
        self._relax(0)
        progress(0.8)
        self._touch()
        self._tool_force()
        self._energies()
        progress(1.0)
        return time.perf_counter() - begin

    def equilibrium(self, iterations: int) -> Equilibrium:
        """The present state in numbers."""
        copies = self.model.copies
        gap, push, _ = self._touch()
        internal, hourglass, lost = self._energies()
        pressed = push > 0.0
        place = self._contact_places()
        return Equilibrium(
            force_N=copies * float(self._tool_force()),
            displacement_m=self._driven() - self.touch_m,
            iterations=iterations,
            residual=float(self._monitor[RESIDUAL]),
            kinetic_ratio=float(self._monitor[KINETIC_RATIO]),
            reaction_N=copies * self._reaction(),
            penetration_m=float(max(0.0, -gap.min(initial=0.0))),
            contact_radius_m=float(np.hypot(place[pressed, 0], place[pressed, 1]).max(initial=0.0)),
            internal_J=copies * float(internal),
            hourglass_J=copies * float(hourglass),
            contact_J=copies * 0.5 * float(np.sum(push * -gap * (push > 0.0))),
            dead_work_J=copies * float(np.sum(self._external * self.state.u)),
            friction_loss_J=copies * self.friction_loss_J,
            material_loss_J=copies * float(lost),
            smallest_J=float(self._monitor[REST_J]),
        )

    def contact_pressure(self) -> tuple[np.ndarray, np.ndarray]:
        """Present places (k, 3) m of the contact points, and the pressure of the tool there (k,) Pa."""
        return self._contact_places(), self._touch()[1] / self.model.tool.areas_m2

    def element_fields(self) -> dict[str, np.ndarray]:
        """J, strain energy density [Pa] with that of hourglass control, and hourglass energy [J] of each element, (m,)."""
        self._energies()
        volume = np.empty(len(self.volumes))
        volume[self.element_order] = self.volumes
        hourglass = self._in_elements(self._element_hourglass)
        return {
            "J": self._in_elements(self._element_J),
            "strain_energy_density": (self._in_elements(self._element_energy) + hourglass) / volume,
            "hourglass_energy": hourglass,
        }

    # ---- approaching a load ----

    def _touched(self, depth: float) -> Equilibrium | Stuck:
        """Count displacements from here on."""
        self.touch_m = depth
        self.tool[[DEPTH, DRIVE]] = depth
        self._known.clear()
        self._commit(0.0)
        preload = 0.0 if self.model.tool is None else self.model.tool.preload_N
        if preload > 0.0:
            found = self.press(preload)
            if isinstance(found, Stuck):
                return found
            self.touch_m, self._by_force = self._drive, False
            self._known = [(0.0, *self._known[-1][1:])]
        return self.equilibrium(0)

    def _approach(self, goal: float, by_force: bool, at_s: float, progress: Callable[[float], None]) -> Equilibrium | Stuck:
        if at_s < self.time_s:
            raise ValueError(f"time runs backwards, from {self.time_s:g} s to {at_s:g} s")
        self.tool[FREE] = float(by_force)
        if by_force != self._by_force:
            self._known = [(self._coordinate(by_force), *self._known[-1][1:])]
            self._by_force = by_force
        begin, since = self._known[-1][0], self.time_s
        before = self.iterations
        done, shares = 0.0, [1.0]  # of the way; load and time go together
        while shares:
            share = shares[-1]
            now = begin + share * (goal - begin) if share < 1.0 else goal
            self.set_increment((share - done) * (at_s - since))
            self._start(now)
            failure = self._attempt(progress)
            if failure is None and self._stiffen():
                continue
            if failure is None:
                done = shares.pop()
                self.time_s = since + done * (at_s - since) if done < 1.0 else at_s
                self._commit(now)
                continue
            stuck = Stuck(failure, now, self._known[-1][0], float(self._monitor[RESIDUAL]), self._worst(failure))
            self._restore()
            if share - done <= 0.5**HALVINGS:
                self.set_increment(0.0)
                return stuck
            shares.append(0.5 * (done + share))
        return self.equilibrium(self.iterations - before)

    def _start(self, goal: float) -> None:
        """The tool's goal, and where the body may be then: a parabola through the last equilibria."""
        if self._by_force:
            self.tool[LOAD] = goal / self.model.copies
        u = self._known[-1][1]
        depth = self._known[-1][2]
        last = self._known[-3:]
        at = [p for p, _, _ in last]
        if len(last) > 1 and len(set(at)) == len(at) and abs(goal - at[-1]) <= REACH * abs(at[-1] - at[-2]):
            weights = [np.prod([(goal - q) / (p - q) for q in at if q != p]) for p in at]
            u = sum(w * k[1] for w, k in zip(weights, last, strict=True))
            depth = sum(w * k[2] for w, k in zip(weights, last, strict=True))
        self.state.u[:] = u
        self.tool[DEPTH] = depth
        if not self._by_force:
            self._lead(goal)
        self._stop()

    def _lead(self, goal: float) -> None:
        """Lift the tool to where the surface is hardly pressed: a sudden deep push would tear the elements there."""
        depth = self.tool[DEPTH]
        self.tool[[DEPTH, DRIVE, GOAL]] = goal + self.touch_m
        if self.contact.shape[TIED] > 0.0 or self.tool[COMPLIANCE] > 0.0:
            self.tool[DEPTH], self.tool[DRIVE] = depth, self._drive
        for _ in range(20):
            inside = -self._touch()[0].min(initial=0.0)
            if (
                self.contact.shape[TIED] > 0.0
                or self.tool[COMPLIANCE] > 0.0
                or inside <= PENETRATION * max(self._deepest, abs(goal))
            ):
                break
            self.tool[DEPTH] -= inside
            self.tool[DRIVE] = self.tool[DEPTH]
        self.tool[PACE] = max(abs(self.tool[GOAL] - self.tool[DRIVE]), 1e-15) / LEAD

    def _attempt(self, progress: Callable[[float], None]) -> str | None:
        """Relax from the present state; what went wrong, if anything did."""
        for extrapolated in (True, False):
            failure = self._settle_down(progress)
            if failure != "inverted":
                return failure
            if extrapolated:
                self._restore()  # too far, maybe: begin where the last load ended
        return failure

    def _settle_down(self, progress: Callable[[float], None]) -> str | None:
        first = best = np.inf
        idle = 0  # iterations without progress
        heavy = False
        while idle < PATIENCE:
            if not heavy:
                if not self._find_masses():
                    return "inverted"
                heavy = True
            done = self._relax(CHUNK)
            self.iterations += done
            idle += done
            residual = self._monitor[RESIDUAL]
            if not self._monitor[REST_J] > 0.0 or not np.isfinite(residual):
                return "inverted"
            if self._monitor[STIFFNESS] > RESTLESS:  # tissue has stiffened on the way: new masses, a new start from here
                heavy = False
                self._stop()
                continue
            if done < CHUNK:
                return None
            first = residual if first == np.inf else first
            idle = 0 if residual < PROGRESS * best else idle
            best = min(best, residual)
            progress(float(np.clip(np.log(first / best) / np.log(max(first / self.tolerance, 1.0 + 1e-9)), 0.0, 1.0)))
        return "not-converged"

    def _stop(self) -> None:
        self.state.v[:] = 0.0
        self._monitor[[POWER, MOMENT, STIFFNESS]] = 0.0

    def _relax(self, iterations: int) -> int:
        rest = (
            self.nodes,
            self.turned,
            self.springs,
            self.contact,
            self.tool,
            self._sums,
            float(self.tolerance),
            LEAST * self._largest_load,
            LEAST * self._largest_work,
            int(iterations),
            self._monitor,
        )
        gate = self.parts[0].gate
        gate[:] = 0
        tasks = [
            lambda part=part: self.kernels.relax(self.state, self._external, self._inner, part, *rest) for part in self.parts
        ]
        return together(tasks, gate)[0]

    def _stiffen(self) -> bool:
        """Double the contact springs where the tool has sunk in too far; whether that was needed."""
        depth = self._touch()[0].min(initial=0.0)
        if self.model.tool is None or -depth <= PENETRATION * max(self._deepest, abs(self.tool[DEPTH] - self.touch_m)):
            return False
        if self.contact.shape[TIED] > 0.0:
            return False
        self.contact.spring[:] *= 2.0
        self.contact.grip[:] *= 2.0
        return True

    def _commit(self, coordinate: float) -> None:
        """What the history keeps of an equilibrium: the state, and where friction has slipped to."""
        push, traction = self._touch()[1:]
        contact = self.contact
        place = np.einsum("kc,kci->ki", contact.weight, self.state.u[contact.node, :3])
        place[:, 2] += self.tool[DEPTH]
        if len(place) and contact.grip.any() and not contact.shape[TIED] > 0.0:
            # What sticks keeps its elastic slip; what is free begins to slip where it touches next.
            elastic = np.where(push[:, None] > 0.0, -traction / contact.grip[:, None], 0.0)
            self.friction_loss_J += float(-np.sum(traction * (place - elastic - contact.anchor)))
            contact.anchor[:] = place - elastic
        self._known = [*self._known[-3:], (coordinate, self.state.u.copy(), float(self.tool[DEPTH]))]
        self._drive = self._driven()
        self._deepest = max(self._deepest, abs(self.tool[DEPTH] - self.touch_m))
        self._largest_load = max(self._largest_load, float(self._monitor[LOADS]))
        self._largest_work = max(self._largest_work, float(self._monitor[WORK]))
        if self.model.effects:
            self.kernels.forces(self.state.u, self._inner, self.blocks)
            self.blocks.old[:] = self.blocks.new
            self.set_increment(0.0)  # what is looked at from here on is this instant

    def _restore(self) -> None:
        """Back to the last equilibrium."""
        self.state.u[:] = self._known[-1][1]
        self._stop()
        self.tool[[DEPTH, DRIVE]] = self._known[-1][2], self._drive
        self.tool[PACE] = abs(self.tool[GOAL] - self._drive) / LEAD

    def _coordinate(self, by_force: bool) -> float:
        """Force [N] or displacement [m] of the last equilibrium."""
        return self.equilibrium(0).force_N if by_force else self._drive - self.touch_m

    def _driven(self) -> float:
        """Way of the tool and of what the rig gives way by, as a machine reads it [m]."""
        return float(self.tool[DEPTH] + self.tool[COMPLIANCE] * self._tool_force())

    # ---- masses ----

    def _find_masses(self) -> bool:
        """Fictitious masses for the present state; False where an element is inside out there."""
        rotation = np.where(self._is_turned[self.hexes][..., None, None], self._rotation, np.eye(3))
        own = self._partner[self.hexes]
        slot = (own[:, :, None] == own[:, None, :]).argmax(axis=2)
        free = self._free[own]
        self.kernels.forces(self.state.u, self.state.force, self.blocks)
        rows = stiffness_rows(
            self.kernels.forces,
            self.blocks,
            self.state.u[self.hexes, :3],
            np.cbrt(self.volumes),
            free,
            slot,
            rotation,
        )
        if not np.isfinite(rows).all():
            return False
        mass = zeros(self.state.u.shape)
        for k in range(3):
            mass[: len(self.points), k] = 0.25 * SAFETY * np.bincount(own.ravel(), rows[..., k].ravel(), len(self.points))
        contact = self.contact
        # a point that slides is pushed along the surface by its friction times what pushes it across
        across = contact.spring * (1.0 + contact.shape[FRICTION])
        springs = 0.25 * SAFETY * (across + contact.grip)[:, None] * contact.weight
        mass[: len(self.points), :3] += np.bincount(contact.node.ravel(), springs.ravel(), len(self.points))[:, None]
        np.add.at(mass, (self.springs.node, slice(0, 3)), 0.25 * SAFETY * self.springs.stiffness)
        mass[: len(self.points), :3] *= self._free
        self.nodes = Nodes(mass, np.divide(1.0, mass, out=zeros(mass.shape), where=mass > 0.0))
        return True

    # ---- inside ----

    def _tie(self) -> None:
        """The sector's far side moves with the near one."""
        sector = self.model.sector
        nodes = partners = np.zeros(0, dtype=np.int64)
        angle = 0.0
        if sector is not None:
            nodes, partners, angle = self._place[sector.nodes], self._place[sector.partners], sector.angle_rad
        c, s = np.cos(angle), np.sin(angle)
        self.turned = Turned(nodes, partners, np.array([c, s]))
        self._rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self._partner = np.arange(len(self.points))
        self._partner[nodes] = partners
        self._is_turned = np.zeros(len(self.points), dtype=bool)
        self._is_turned[nodes] = True
        self._free = ~self.model.held[self.node_order] & ~self._is_turned[:, None]

    def _grip(self) -> None:
        """Contact points of the tool; none without a tool."""
        tool = self.model.tool
        self.tool = np.zeros(TOOL)
        self._by_force = False
        shape = np.zeros(SHAPE)
        nodes, weights, areas, facing = np.zeros((0, 4), dtype=np.int64), np.zeros((0, 4)), np.zeros(0), np.zeros(0)
        stiffness = 0.0
        if tool is not None:
            nodes, weights, areas, facing = self._place[tool.nodes], tool.weights, tool.areas_m2, tool.facing_m2
            stiffness = SPRING * self.model.material.shear_modulus_Pa / tool.face_size_m
            large = 1e3  # m: beyond any specimen
            shape[:] = (
                min(tool.flat_radius_m, large),
                tool.edge_radius_m,
                float(tool.wall),
                tool.height_m,
                float(tool.tied),
                tool.friction,
                tool.tilt_rad,
                tool.adhesion_Pa,
                tool.reach_m,
            )
            # of the part that is computed: it carries its share of the force
            self.tool[COMPLIANCE] = tool.compliance_m_N * self.model.copies
        grips = 1.0 if shape[TIED] else GRIP * (tool is not None and tool.friction > 0.0)
        self.contact = Contact(
            node=np.ascontiguousarray(nodes, dtype=np.uint32),
            weight=np.array(weights),
            position=np.einsum("kc,kci->ki", weights, self.points[nodes]),
            spring=stiffness * areas,
            area=np.array(facing),
            grip=grips * stiffness * areas,
            anchor=np.zeros((len(areas), 3)),
            shape=shape,
            moved=np.zeros((len(areas), 3)),
        )

    def _dead_forces(self) -> np.ndarray:
        """Dead loads on the node rows; those on the sector's far side act on its near one."""
        forces = np.zeros((self.model.mesh.node_count, 3))
        for load in self.model.loads:
            np.add.at(forces, load.nodes, load.force_N)
        rows = self._rows(forces)
        np.add.at(rows, self.turned.partner, rows[self.turned.node] @ np.pad(self._rotation, (0, 1)))
        rows[self.turned.node] = 0.0
        return rows

    def _touch(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance [m], normal force [N] and friction force [N] of each contact point."""
        count = len(self.contact.spring)
        gap, push, traction = np.zeros(count), np.zeros(count), np.zeros((count, 3))
        self.kernels.touch(self.state.u, self.contact, self.tool, gap, push, traction)
        return gap, push, traction

    def _contact_places(self) -> np.ndarray:
        contact = self.contact
        return contact.position + np.einsum("kc,kci->ki", contact.weight, self.state.u[contact.node, :3])

    def _energies(self) -> tuple[float, float]:
        return self.kernels.elastic_energy(
            self.state.u, self.blocks, self._element_J, self._element_energy, self._element_hourglass
        )

    def _tool_force(self) -> float:
        """Force of the tool along -z [N], on the part of the body that is modelled."""
        return self.kernels.press(self.state.u, np.zeros_like(self.state.u), self.contact, self.tool)

    def _reaction(self) -> float:
        """Force of what holds the body along +z [N], less the weight that rests on it."""
        force = np.zeros_like(self.state.u)
        self.kernels.forces(self.state.u, force, self.blocks)
        held = self.model.held[self.node_order][:, 2]  # of the sector both sides: a turn leaves z as it is
        weight = -self._external[:, 2].sum()
        return float(-(force + self._external)[: len(held), 2][held].sum() - weight)

    def _worst(self, failure: str) -> np.ndarray:
        """Where the broken element, or the largest unbalanced force is, in the reference shape (3,) m."""
        if failure == "inverted":
            return self.model.mesh.points[self.model.mesh.hexes[self.broken_element()]].mean(axis=0)
        unbalanced = np.where(self.nodes.inverse_mass > 0.0, self.state.force + self._external, 0.0)
        return self.points[int(np.argmax(np.linalg.norm(unbalanced[: len(self.points)], axis=1)))]
