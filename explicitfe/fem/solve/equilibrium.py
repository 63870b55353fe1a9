"""Equilibrium by dynamic relaxation: a body under a rigid tool, from one load to the next.

The masses are fictitious, so that one iteration is a step of 1 at a fraction of the stable limit everywhere (Underwood 1983;
Joldes, Wittek & Miller 2011). They are recomputed for every load, as compressed elements stiffen. A load increment that does not
converge is halved. A history-dependent material is updated at equilibrium only, since the iterates overshoot.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from explicitfe.fem.inputs.argument import count_like, number_like
from explicitfe.fem.inputs.bounds import bounds_of
from explicitfe.fem.inputs.limits import RelativeResidual, ThreadCount
from explicitfe.fem.mesh.checked_arrays import LARGEST_LENGTH_M
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.contact_points import PENETRATION_SHARE
from explicitfe.fem.solve.fictitious_masses import fictitious_masses
from explicitfe.fem.solve.load_outcome import Equilibrium, Stuck
from explicitfe.fem.solve.loaded_body import ONLY_IN_TIME, LoadedBody
from explicitfe.fem.solve.parts import parts_of, usual_threads
from explicitfe.fem.solve.relax_step import LARGEST_STIFFNESS_ESTIMATE
from explicitfe.fem.solve.stagnation import Stagnation
from explicitfe.platform.compiled.arrays import (
    DEPTH,
    DRIVE,
    FREE,
    KINETIC_RATIO,
    LOAD,
    LOADS,
    MOMENT,
    POWER,
    RESIDUAL,
    REST_J,
    STIFFNESS,
    SUMS,
    WORK,
    Goal,
    Part,
    Springs,
    Surface,
    zeros,
)
from explicitfe.platform.compiled.threads import together
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import stopping

RESIDUAL_TOLERANCE = 1e-4  # unbalanced forces, relative to those of tool and loads, at which a load has converged by default
ITERATIONS_PER_LOOK = 400  # between two looks from outside the compiled loop
# Measured: threads stay together for so many iterations that waking them costs nothing.
ELEMENTS_PER_RELAXING_THREAD = 500
# A load that makes no progress is approached in halves, and given up after so many: a 256th of an increment is no increment.
MOST_HALVINGS = 8
# A load of the tool is given up after so many iterations in all its attempts. Loads of tests need 500 to 7000, ten times as many
# where the tissue is nearly incompressible, and those that cannot be reached up to 200 000 before they are given up.
MOST_ITERATIONS_OF_A_LOAD = 1_000_000
KNOWN_STATIONS = 4  # equilibria that are kept: a parabola needs three
LONGEST_EXTRAPOLATION = 1.5  # in increments: a load further away than so many times the last increment begins without a guess
# A load that has all but gone is no measure of a residual: it is compared to this share of the largest load and work so far.
LEAST_SHARE_OF_LARGEST_LOAD = 0.01


class _Station(NamedTuple):
    """An equilibrium that was passed."""

    coordinate: float  # force [N] or displacement [m], whichever is imposed
    u: np.ndarray  # displacement rows [m], (N, 4)
    depth_m: float  # of the tool


class Relaxation(LoadedBody):
    """A body in static equilibrium under dead loads and a rigid tool.

    Call :meth:`settle` for the equilibrium under dead loads alone, :meth:`press` for a force of the tool, or :meth:`move` for a
    displacement of the tool. Each starts from the last equilibrium.

    Parameters
    ----------
    model : what is computed; a model without a tool has dead loads only.
    tolerance : relative force residual at which a load has converged, 1e-9 to 1e-2.
    threads : number of threads, 1 to 256; chosen by the size of the mesh if left out. A sector uses one.

    Attributes
    ----------
    iterations : number of iterations so far.
    time_s : time of the last equilibrium, s; only a history-dependent material depends on it.

    Raises
    ------
    InputError : a parameter out of range, or a model with one of ``ONLY_IN_TIME``, which need a :class:`Simulation`.
    """

    def __init__(self, model: Model, tolerance: float = RESIDUAL_TOLERANCE, threads: int | None = None) -> None:
        for name in ONLY_IN_TIME:
            if getattr(model, name, None):
                raise InputError(f"Relaxation: a model with {name} is not supported; use a Simulation, or remove them.")
        tolerance = number_like("Relaxation: tolerance", tolerance, RelativeResidual, "tolerance")
        if threads is not None:
            threads = count_like("Relaxation: threads", threads, ThreadCount, "threads")
        super().__init__(model)
        self.tolerance = tolerance
        self.iterations = 0
        self._most_iterations = np.inf
        self._free = ~self.model.held[self.node_order] & ~self._tie.on_far_side[:, None]
        self._by_force = False
        support = self.model.support
        self.springs = Springs(
            np.zeros(0, dtype=np.int64) if support is None else self._place[support.node],
            np.zeros((0, 3)) if support is None else np.array(support.stiffness, dtype=float),
        )
        self._inner = zeros(self.state.u.shape)
        count = 1 if len(self._tie.turned.node) else threads or usual_threads(len(self.hexes), ELEMENTS_PER_RELAXING_THREAD)
        self.parts = parts_of(self.state, self.blocks, count)
        self._sums = zeros((len(self.parts), SUMS))
        self._largest_load = self._largest_work = self._deepest = 0.0
        self._height_m = float(np.ptp(self.model.mesh.points[:, 2]))
        self._known: list[_Station] = []
        self._commit(0.0)

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Copies of the complete state between two loads, in computing order."""
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
        """Continue from a restart state of the same model, bitwise identically to an uninterrupted run.

        With another number of threads the loads are identical up to rounding.

        Parameters
        ----------
        state : of :meth:`restart_state`.
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
        """Find the equilibrium under the dead loads alone; afterwards the tool just touches the body.

        Displacements of the tool count from there.

        Parameters
        ----------
        progress : called from time to time with the share that is done.

        Returns
        -------
        The equilibrium, or a :class:`Stuck` with the reason if the solver did not converge.
        """
        if not (self._external.any() or self.contact.tilted):
            return self._touched(0.0)
        self.contact.retreat()
        if (stuck := self._carry(progress)) is not None:
            return stuck
        if not self.contact.tied:
            self.contact.descend_to_first_touch(self.state.u)
        return self._touched(self.contact.depth_m)

    def press(
        self, force_N: float, progress: Callable[[float], None] = lambda share: None, *, at_s: float | None = None
    ) -> Equilibrium | Stuck:
        """Find the equilibrium under a force of the tool, from the last equilibrium.

        Parameters
        ----------
        force_N : force of the tool, N, positive into the body.
        progress : called from time to time with the share that is done.
        at_s : time of the load, s, for a history-dependent material; that of the last load if left out.

        Returns
        -------
        The equilibrium, or a :class:`Stuck` with the reason if the solver did not converge.

        Raises
        ------
        InputError : a number out of range, a time before the last load, or a model without a tool.
        """
        force_N = self._checked_load("press: force_N", force_N, bounds_of("force_N").largest)
        return self._approach(force_N, True, self._checked_time("press: at_s", at_s), progress)

    def move(
        self, displacement_m: float, progress: Callable[[float], None] = lambda share: None, *, at_s: float | None = None
    ) -> Equilibrium | Stuck:
        """Find the equilibrium at a displacement of the tool, from the last equilibrium.

        Parameters
        ----------
        displacement_m : of the tool since first touch, m, positive into the body.
        progress, at_s : as for :meth:`press`.

        Returns
        -------
        The equilibrium, or a :class:`Stuck` with the reason if the solver did not converge.

        Raises
        ------
        InputError : as for :meth:`press`.
        """
        displacement_m = self._checked_load("move: displacement_m", displacement_m, LARGEST_LENGTH_M)
        return self._approach(displacement_m, False, self._checked_time("move: at_s", at_s), progress)

    # ---- what is known ----

    def compile(self, progress: Callable[[float], None] = lambda share: None) -> float:
        """Load the compiled kernels from the cache, or compile them; return the seconds it took.

        ``progress`` is called with the share that is done.
        """
        begin = time.perf_counter()
        progress(0.0)
        part, u = self.parts[0], self.state.u
        force = np.zeros_like(u)
        fields = (self._element_J, self._element_energy, self._element_hourglass, np.zeros(4))
        self.kernels.prepare({
            "internal_force": (part.u, part.force, part.blocks),
            "relax_at": (0, *self._arguments(part, 0)),
            "internal_energy": (u, self.blocks, *fields),
        })  # fmt: skip
        progress(0.8)
        self.kernels.forces(u, force, self.blocks)
        self._relax(0)
        self.contact.touch(self.state.u)
        self.contact.force(self.state.u)
        self._energies()
        progress(1.0)
        return time.perf_counter() - begin

    # ---- approaching a load ----

    def _carry(self, progress: Callable[[float], None]) -> Stuck | None:
        """Find the equilibrium under the dead loads; increments that do not converge are halved."""
        # without a load the body is at rest as it is: a residual of zero over a load of zero would be rounding
        loads, done, shares = self._external.copy(), 0.0, [1.0] if self._external.any() else []
        try:
            while shares:
                self._external[:] = shares[-1] * loads
                failure = self._attempt(progress, slowly=shares == [1.0] and done == 0.0)
                if failure is None and (done := shares.pop()) < 1.0:
                    self._commit(0.0)
                elif failure is not None:
                    stuck = self._stuck(failure, 0.0, 0.0)
                    self._restore()
                    self.contact.retreat()
                    if shares[-1] - done <= 0.5**MOST_HALVINGS:
                        return stuck
                    shares.append(0.5 * (done + shares[-1]))
        finally:
            self._external[:] = loads
        return None

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
        self.contact.tool[FREE] = float(by_force)
        if by_force != self._by_force:
            self._known = [self._known[-1]._replace(coordinate=self._coordinate(by_force))]
            self._by_force = by_force
        begin, since = self._known[-1].coordinate, self.time_s
        before = self.iterations
        self._most_iterations = before + MOST_ITERATIONS_OF_A_LOAD
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
            if share - done <= 0.5**MOST_HALVINGS or self.iterations >= self._most_iterations:
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
            if failure is None and self.contact.depth_m - self.touch_m >= self._height_m:
                # less than nothing is between the tool and the base: forces may balance, the body cannot exist
                failure = "inverted"
            if failure != "inverted":
                return failure
            if extrapolated:
                self._restore()  # too far, maybe: begin where the last load ended
        return failure

    def _settle_down(self, progress: Callable[[float], None], slowly: bool) -> str | None:
        stagnation = Stagnation(slowly=slowly)
        heavy = False
        while not stagnation.is_stalled and self.iterations < self._most_iterations:
            stopping.check()
            if not heavy:
                if not self._find_masses():
                    return "inverted"
                heavy = True
            done = self._relax(ITERATIONS_PER_LOOK)
            self.iterations += done
            stagnation.count(done)
            residual = self._monitor[RESIDUAL]
            if not self._monitor[REST_J] > 0.0 or not np.isfinite(residual):
                return "inverted"
            if self._monitor[STIFFNESS] > LARGEST_STIFFNESS_ESTIMATE:
                heavy = False  # the tissue has stiffened on its way: new masses, a new start from here
                self._stop()
                continue
            if done < ITERATIONS_PER_LOOK:
                return None
            stagnation.check(residual, self._monitor[KINETIC_RATIO], self._monitor[STIFFNESS])
            progress(stagnation.share(self.tolerance))
        return "not-converged"

    def _stop(self) -> None:
        self.state.v[:] = 0.0
        self._monitor[[POWER, MOMENT, STIFFNESS]] = 0.0

    def _relax(self, iterations: int) -> int:
        gate = self.parts[0].gate
        gate[:] = 0
        tasks = [partial(self.kernels.relax, *self._arguments(part, iterations)) for part in self.parts]
        return together(tasks, gate)[0]

    def _arguments(self, part: Part, iterations: int) -> tuple[Any, ...]:
        """Those of ``relax_step.relax`` after the address of the internal force."""
        least = (LEAST_SHARE_OF_LARGEST_LOAD * self._largest_load, LEAST_SHARE_OF_LARGEST_LOAD * self._largest_work)
        surface = Surface(self._tie.turned, self.springs, self.contact.points, self.contact.tool)
        goal = Goal(float(self.tolerance), *least)
        arrays = (self.state, self._external, self._inner, part, self.nodes, surface, goal)
        return (*arrays, self._sums, int(iterations), self._monitor)

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
