"""Equilibrium by dynamic relaxation: a body under a rigid tool, from one load to the next.

The masses are fictitious, so that one iteration is a step of 1 at a fraction of the stable limit everywhere (Underwood 1983;
Joldes, Wittek & Miller 2011). They are found anew for every load: compressed elements stiffen. A load that cannot be reached in
one go is approached in halves; what a history needs is committed at equilibrium only, since the iterates overshoot.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from explicitfe.compiled.arrays import (
    DEPTH,
    DRIVE,
    FREE,
    KINETIC_RATIO,
    LOAD,
    LOADS,
    MOMENT,
    MONITOR,
    POWER,
    RESIDUAL,
    REST_J,
    STIFFNESS,
    SUMS,
    WORK,
    Springs,
    zeros,
)
from explicitfe.compiled.threads import together
from explicitfe.errors import InputError
from explicitfe.host import stopping
from explicitfe.mesh.validity import certify
from explicitfe.model.model import Model
from explicitfe.solve.body import Body
from explicitfe.solve.contact_points import PENETRATION_SHARE, ToolContact
from explicitfe.solve.fictitious_masses import fictitious_masses
from explicitfe.solve.load_outcome import Equilibrium, Stuck
from explicitfe.solve.parts import parts_of, usual_threads
from explicitfe.solve.relax_step import LARGEST_STIFFNESS_ESTIMATE
from explicitfe.solve.sector import SectorTie

RESIDUAL_TOLERANCE = 1e-4  # unbalanced forces, relative to those of tool and loads, at which a load has converged by default
ITERATIONS_PER_LOOK = 400  # between two looks from outside the compiled loop
# Measured: threads stay together for so many iterations that waking them costs nothing.
ELEMENTS_PER_RELAXING_THREAD = 500
# A load is approached in halves when the residual has not fallen by a tenth in so many iterations, and given up after so many
# halvings: what converges does so in a fraction of the first, and a 256th of an increment is no increment any more.
ITERATIONS_WITHOUT_PROGRESS = 8000
SHARE_OF_RESIDUAL_THAT_IS_PROGRESS = 0.9
MOST_HALVINGS = 8
KNOWN_STATIONS = 4  # equilibria that are kept: a parabola needs three
LONGEST_EXTRAPOLATION = 1.5  # in increments: a load further away than so many times the last increment begins without a guess
# A load that has all but gone is no measure of a residual: it is compared to this share of the largest load and work so far.
LEAST_SHARE_OF_LARGEST_LOAD = 0.01


class _Station(NamedTuple):
    """An equilibrium that was passed."""

    coordinate: float  # force [N] or displacement [m], whichever is imposed
    u: np.ndarray  # displacement rows [m], (N, 4)
    depth_m: float  # of the tool


class Relaxation(Body):
    """A body with a tool, at rest, ready to be loaded.

    Parameters
    ----------
    model : the physics; ``model.tool`` may be None.
    tolerance : relative residual at which a load has converged.
    threads : that share an iteration; as many as it pays for a mesh of this size, if left out. One for a sector.
    """

    # At the edge of a bonded disc the stress has no bound and elements fold; kept from that they are 2 % too stiff
    # (docs/studies/elements.md).
    guarded = False

    def __init__(self, model: Model, tolerance: float = RESIDUAL_TOLERANCE, threads: int | None = None) -> None:
        for name in ("stresses", "bones", "attachments"):
            if getattr(model, name):
                raise InputError(
                    f"a relaxation knows no {name} of a model; take a Simulation, which runs in time, or leave them out."
                )
        super().__init__(model)
        self.tolerance = tolerance
        self.iterations = 0
        self.friction_loss_J = 0.0
        self.touch_m = 0.0
        self.time_s = 0.0
        self._tie = SectorTie(self.model.sector, self._place)
        self._free = ~self.model.held[self.node_order] & ~self._tie.on_far_side[:, None]
        self.contact = ToolContact(self.model, self._place, self.points, self.kernels)
        self._by_force = False
        support = self.model.support
        self.springs = Springs(
            np.zeros(0, dtype=np.int64) if support is None else self._place[support.node],
            np.zeros((0, 3)) if support is None else np.array(support.stiffness, dtype=float),
        )
        self._external = self._dead_forces()
        self._inner = zeros(self.state.u.shape)
        count = 1 if len(self._tie.turned.node) else threads or usual_threads(len(self.hexes), ELEMENTS_PER_RELAXING_THREAD)
        self.parts = parts_of(self.state, self.blocks, count)
        self._sums = zeros((len(self.parts), SUMS))
        self._monitor = np.zeros(MONITOR)
        self._monitor[REST_J] = 1.0
        self._largest_load = self._largest_work = self._deepest = 0.0
        self._known: list[_Station] = []
        self._commit(0.0)

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Copies of all that the loads to come depend on, in computing order: to be taken between two loads."""
        stations = np.zeros((KNOWN_STATIONS, *self.state.u.shape))
        places = np.full((KNOWN_STATIONS, 2), np.nan)
        for number, known in enumerate(self._known):
            stations[number], places[number] = known.u, (known.coordinate, known.depth_m)
        points = self.contact.points
        return {
            "stations": stations,
            "station_places": places,
            "memory": self.blocks.old.copy(),
            "tool": self.contact.tool.copy(),
            "springs": np.stack([points.spring, points.grip]),
            "anchors": points.anchor.copy(),
            "monitor": self._monitor.copy(),
            "times": np.array([self.time_s, self.touch_m, self._drive, self._deepest]),
            "largest": np.array([self._largest_load, self._largest_work, self.friction_loss_J]),
            "counters": np.array([self.iterations, self._by_force], dtype=np.int64),
        }

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go on from a restart state of the same model; the loads to come are bit for bit those of the run that was not stopped.

        With another number of threads they are the same up to rounding.
        """
        places = state["station_places"]
        passed = range(int(np.count_nonzero(~np.isnan(places[:, 0]))))
        self._known = [_Station(float(places[k, 0]), state["stations"][k].copy(), float(places[k, 1])) for k in passed]
        self.state.u[:] = self._known[-1].u
        self.blocks.old[:] = state["memory"]
        points = self.contact.points
        self.contact.tool[:] = state["tool"]
        points.spring[:], points.grip[:] = state["springs"]
        points.anchor[:] = state["anchors"]
        self._monitor[:] = state["monitor"]
        self.time_s, self.touch_m, self._drive, self._deepest = (float(x) for x in state["times"])
        self._largest_load, self._largest_work, self.friction_loss_J = (float(x) for x in state["largest"])
        self.iterations, self._by_force = int(state["counters"][0]), bool(state["counters"][1])
        self.set_increment(0.0)

    # ---- what a load does ----

    def settle(self, progress: Callable[[float], None] = lambda share: None) -> Equilibrium | Stuck:
        """Equilibrium under the dead loads alone, the tool out of reach or, where it is tied, without a load; it then touches."""
        if not (self._external.any() or self.contact.tilted):
            return self._touched(0.0)
        self.contact.retreat()
        # Without a load the body is at rest as it is: a residual of zero over a load of zero would be rounding.
        if self._external.any() and (failure := self._attempt(progress, slowly=True)) is not None:
            return self._stuck(failure, 0.0, 0.0)
        if not self.contact.tied:
            self.contact.descend_to_first_touch(self.state.u)
        return self._touched(self.contact.depth_m)

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
        self.contact.touch(self.state.u)
        self.contact.force(self.state.u)
        self._energies()
        progress(1.0)
        return time.perf_counter() - begin

    def equilibrium(self, iterations: int) -> Equilibrium:
        """The present state in numbers."""
        copies = self.model.copies
        gap, push, _ = self.contact.touch(self.state.u)
        internal, hourglass, lost, _ = self._energies()
        pressed = push > 0.0
        place = self.contact.places(self.state.u)
        return Equilibrium(
            force_N=copies * self.contact.force(self.state.u),
            displacement_m=self.contact.driven_m(self.state.u) - self.touch_m,
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
            folded=certify(self.model.mesh.points + self.displacement, self.model.mesh.hexes).folded_count,
        )

    def contact_pressure(self) -> tuple[np.ndarray, np.ndarray]:
        """Present places (k, 3) m of the contact points, and the pressure of the tool there (k,) Pa."""
        if self.model.tool is None:
            raise ValueError("the model has no tool")
        return self.contact.places(self.state.u), self.contact.touch(self.state.u).push / self.model.tool.areas_m2

    def element_fields(self) -> dict[str, np.ndarray]:
        """J, strain energy density [Pa] with that of hourglass control, and hourglass energy [J] of each element, (m,)."""
        self._energies()
        volume = np.empty(len(self.volumes))
        volume[self.element_order] = self.volumes
        hourglass = self._in_elements(self._element_hourglass)
        density = (self._in_elements(self._element_energy) + hourglass) / volume
        return {"J": self._in_elements(self._element_J), "strain_energy_density": density, "hourglass_energy": hourglass}

    # ---- approaching a load ----

    def _touched(self, depth_m: float) -> Equilibrium | Stuck:
        """Count displacements from here on."""
        self.touch_m = depth_m
        self.contact.tool[[DEPTH, DRIVE]] = depth_m
        self._known.clear()
        self._commit(0.0)
        preload = 0.0 if self.model.tool is None else self.model.tool.preload_N
        if preload > 0.0:
            preloaded = self.press(preload)
            if isinstance(preloaded, Stuck):
                return preloaded
            self.touch_m, self._by_force = self._drive, False
            self._known = [self._known[-1]._replace(coordinate=0.0)]
        return self.equilibrium(0)

    def _approach(self, goal: float, by_force: bool, at_s: float, progress: Callable[[float], None]) -> Equilibrium | Stuck:
        if at_s < self.time_s:
            raise ValueError(f"time runs backwards, from {self.time_s:g} s to {at_s:g} s")
        self.contact.tool[FREE] = float(by_force)
        if by_force != self._by_force:
            self._known = [self._known[-1]._replace(coordinate=self._coordinate(by_force))]
            self._by_force = by_force
        begin, since = self._known[-1].coordinate, self.time_s
        before = self.iterations
        done, shares = 0.0, [1.0]  # of the increment; load and time go together
        while shares:
            share = shares[-1]
            now = begin + share * (goal - begin) if share < 1.0 else goal
            self.set_increment((share - done) * (at_s - since))
            self._start(now)
            try:
                failure = self._attempt(progress)
            except BaseException:  # stopped: the load that was under way is given up
                self._restore()
                self.set_increment(0.0)
                raise
            deepest_m = max(self._deepest, abs(self.contact.depth_m - self.touch_m))
            if failure is None and self.contact.stiffen(self.state.u, deepest_m):
                continue
            if failure is None:
                done = shares.pop()
                self.time_s = since + done * (at_s - since) if done < 1.0 else at_s
                self._commit(now)
                continue
            stuck = self._stuck(failure, now, self._known[-1].coordinate)
            self._restore()
            if share - done <= 0.5**MOST_HALVINGS:
                self.set_increment(0.0)
                return stuck
            shares.append(0.5 * (done + share))
        return self.equilibrium(self.iterations - before)

    def _start(self, goal: float) -> None:
        """The tool's goal, and where the body may be then: a parabola through the last equilibria."""
        if self._by_force:
            self.contact.tool[LOAD] = goal / self.model.copies
        u, depth_m = self._known[-1].u, self._known[-1].depth_m
        last = self._known[-3:]
        at = [known.coordinate for known in last]
        if len(last) > 1 and len(set(at)) == len(at) and abs(goal - at[-1]) <= LONGEST_EXTRAPOLATION * abs(at[-1] - at[-2]):
            weights = [float(np.prod([(goal - q) / (p - q) for q in at if q != p])) for p in at]
            u = sum((w * known.u for w, known in zip(weights, last, strict=True)), start=np.zeros_like(u))
            depth_m = sum(w * known.depth_m for w, known in zip(weights, last, strict=True))
        self.state.u[:] = u
        self.contact.tool[DEPTH] = depth_m
        if not self._by_force:
            allowed_m = PENETRATION_SHARE * max(self._deepest, abs(goal))
            self.contact.aim(self.state.u, goal + self.touch_m, self._drive, allowed_m)
        self._stop()

    def _attempt(self, progress: Callable[[float], None], *, slowly: bool = False) -> str | None:
        """Relax from the present state; what went wrong, if anything did.

        ``slowly``: as long as it goes on at all. A load of the tool is approached in halves instead, from a nearer start.
        """
        for extrapolated in (True, False):
            failure = self._settle_down(progress, slowly)
            if failure is None and not self.contact.presses(self.state.u):
                return "not-converged"
            if failure != "inverted":
                return failure
            if extrapolated:
                self._restore()  # too far, maybe: begin where the last load ended
        return failure

    def _settle_down(self, progress: Callable[[float], None], slowly: bool) -> str | None:
        first = best = np.inf
        idle = 0  # iterations without progress
        heavy = False
        while idle < ITERATIONS_WITHOUT_PROGRESS:
            stopping.check()
            if not heavy:
                if not self._find_masses():
                    return "inverted"
                heavy = True
            done = self._relax(ITERATIONS_PER_LOOK)
            self.iterations += done
            idle += done
            residual = self._monitor[RESIDUAL]
            if not self._monitor[REST_J] > 0.0 or not np.isfinite(residual):
                return "inverted"
            if self._monitor[STIFFNESS] > LARGEST_STIFFNESS_ESTIMATE:
                heavy = False  # the tissue has stiffened on its way: new masses, a new start from here
                self._stop()
                continue
            if done < ITERATIONS_PER_LOOK:
                return None
            first = residual if first == np.inf else first
            if residual < SHARE_OF_RESIDUAL_THAT_IS_PROGRESS * best:
                idle, best = 0, residual
            elif not slowly:  # it has to fall by that share from one look to the next
                best = min(best, residual)
            progress(float(np.clip(np.log(first / best) / np.log(max(first / self.tolerance, 1.0 + 1e-9)), 0.0, 1.0)))
        return "not-converged"

    def _stop(self) -> None:
        self.state.v[:] = 0.0
        self._monitor[[POWER, MOMENT, STIFFNESS]] = 0.0

    def _relax(self, iterations: int) -> int:
        others = (
            self.nodes,
            self._tie.turned,
            self.springs,
            self.contact.points,
            self.contact.tool,
            self._sums,
            float(self.tolerance),
            LEAST_SHARE_OF_LARGEST_LOAD * self._largest_load,
            LEAST_SHARE_OF_LARGEST_LOAD * self._largest_work,
            int(iterations),
            self._monitor,
        )
        gate = self.parts[0].gate
        gate[:] = 0
        tasks = [
            lambda part=part: self.kernels.relax(self.state, self._external, self._inner, part, *others) for part in self.parts
        ]
        return together(tasks, gate)[0]

    def _commit(self, coordinate: float) -> None:
        """What the history keeps of an equilibrium: the state, and where friction has slipped to."""
        self.friction_loss_J += self.contact.settle_friction(self.state.u)
        self._known = [*self._known[-(KNOWN_STATIONS - 1) :], _Station(coordinate, self.state.u.copy(), self.contact.depth_m)]
        self._drive = self.contact.driven_m(self.state.u)
        self._deepest = max(self._deepest, abs(self.contact.depth_m - self.touch_m))
        self._largest_load = max(self._largest_load, float(self._monitor[LOADS]))
        self._largest_work = max(self._largest_work, float(self._monitor[WORK]))
        if self.model.effects:
            self.kernels.forces(self.state.u, self._inner, self.blocks)
            self.blocks.old[:] = self.blocks.new
            self.set_increment(0.0)  # what is looked at from here on is this instant

    def _restore(self) -> None:
        """Back to the last equilibrium."""
        self.state.u[:] = self._known[-1].u
        self._stop()
        self.contact.return_to(self._known[-1].depth_m, self._drive)

    def _coordinate(self, by_force: bool) -> float:
        """Force [N] or displacement [m] of the last equilibrium."""
        return self.equilibrium(0).force_N if by_force else self._drive - self.touch_m

    # ---- inside ----

    def _find_masses(self) -> bool:
        """Fictitious masses for the present state; False where an element is inside out there."""
        self.kernels.forces(self.state.u, self.state.force, self.blocks)
        nodes = fictitious_masses(self, self._tie, self._free, self.contact, self.springs)
        if nodes is None:
            return False
        self.nodes = nodes
        return True

    def _dead_forces(self) -> np.ndarray:
        """Dead loads on the node rows; those on the sector's far side act on its near one."""
        forces = np.zeros((self.model.mesh.node_count, 3))
        for load in self.model.loads:
            np.add.at(forces, load.nodes, load.force_N)
        rows = self._rows(forces)
        self._tie.gather_on_near_side(rows)
        return rows

    def _energies(self) -> tuple[float, float, float, float]:
        return self.kernels.elastic_energy(
            self.state.u, self.blocks, self._element_J, self._element_energy, self._element_hourglass
        )

    def _reaction(self) -> float:
        """Force of what holds the body along +z [N], less the weight that rests on it."""
        force = np.zeros_like(self.state.u)
        self.kernels.forces(self.state.u, force, self.blocks)
        held = self.model.held[self.node_order][:, 2]  # of the sector both sides: a turn leaves z as it is
        return float(self._external[:, 2].sum() - (force + self._external)[: len(held), 2][held].sum())

    def _stuck(self, failure: str, goal: float, reached: float) -> Stuck:
        force_N = self.model.copies * self.contact.force(self.state.u)
        return Stuck(failure, goal, reached, float(self._monitor[RESIDUAL]), force_N, self._worst(failure))

    def _worst(self, failure: str) -> np.ndarray:
        """Where the broken element, or the largest unbalanced force is, in the reference shape (3,) m."""
        if failure == "inverted":
            return self.model.mesh.points[self.model.mesh.hexes[self.broken_element()]].mean(axis=0)
        unbalanced = np.where(self.nodes.inverse_mass > 0.0, self.state.force + self._external, 0.0)
        return self.points[int(np.argmax(np.linalg.norm(unbalanced[: len(self.points)], axis=1)))]
