"""A model with its state of motion: the compiled kernels and the arrays that they work on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from explicitfe.fem.inputs.argument import count_like, finite_number
from explicitfe.fem.inputs.limits import ThreadCount
from explicitfe.fem.model.holders import holders_of
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.body import Body
from explicitfe.fem.solve.bones import bones_of, look_up_if_changed, restore_bones, state_of_bones, ties_of
from explicitfe.fem.solve.course import LIMIT_ALONE, NO_LOOKS
from explicitfe.fem.solve.detached import detach
from explicitfe.fem.solve.loads import Loads
from explicitfe.fem.solve.look import FIRST_TOUCHES
from explicitfe.fem.solve.observe import TURNS_LATER, Recording, Snapshot, lookers_of, looks_of, samples_of, shape_numbers
from explicitfe.fem.solve.parts import for_threads, parts_of, usual_threads
from explicitfe.fem.solve.stable_step import fastest_element
from explicitfe.fem.solve.surfaces import bodies_in_contact, highest_contact, restore_contact, state_of_contact, surfaces_of
from explicitfe.platform.compiled.arrays import (
    CORNER,
    DAMPING_LOSS,
    EXTERNAL_WORK,
    IN_ALL,
    IN_LOOKS,
    IN_SAMPLES,
    LEDGER,
    LIMIT,
    SMALLEST_CORNER,
    SMALLEST_J,
    Addresses,
    Blocks,
    BoneRecord,
    Looker,
    Looks,
    Samples,
    Shared,
    Span,
    zeros,
)
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.compiled.threads import together
from explicitfe.platform.errors import InputError

_UNRECORDED = BoneRecord(np.zeros((0, 0)), np.zeros((0, 0)))
_NOTHING = np.zeros(0, dtype=np.int64)  # no instants: asks for no samples
NO_ADDRESSES = Addresses(0, 0, 0, 0, 0)
SHORTEST_INCREMENT_S = 1e-12  # that the instants of a state before the first step are apart
LONG_HOLD_S = 1e9  # after which a material that is held is relaxed
MANY_ELEMENTS = 32768  # more are not all looked at to name the one that limits the step


class Simulation(Body):
    """A model with its state of motion, to be advanced by :class:`Transient`.

    Time integration: explicit central differences with a lumped mass matrix (Hughes 2000, chapter 9).

    Parameters
    ----------
    model : what is computed.
    displacement, velocity : (n, 3) values at time 0, m and m/s; zero if left out.
    threads : 1 to 256; chosen by the size of the mesh if left out. A model with prescribed motion or hanging weights uses one.

    stress : whether samples have the stress of the elements.

    Attributes
    ----------
    time_s : present time, s.
    steps : number of steps so far.
    holders : what holds the body, whose forces are in ``Snapshot.reactions``.
    dt_s : last time step, s.

    Raises
    ------
    InputError : a parameter of another type, shape or range, or an inverted element at rest.
    """

    can_be_restored = True  # whether ``restart_state`` has all that changes in a run

    def __init__(
        self,
        model: Model,
        *,
        displacement: np.ndarray | None = None,
        velocity: np.ndarray | None = None,
        threads: int | None = None,
        stress: bool = False,
    ) -> None:
        if threads is not None:
            threads = count_like("Simulation: threads", threads, ThreadCount, "threads")
        super().__init__(model, displacement=displacement, velocity=velocity)
        self.loads = Loads(model, self._place)
        self.holders = holders_of(model)
        # Beside attached masses the damping of the tissue is a force on its own mass; see ``Loads``.
        self.alpha_per_s = 0.0 if model.masses else float(model.alpha_per_s)
        self.ties = ties_of(model.attachments, model.mesh, self._place)
        self.surfaces = surfaces_of(model, self._place, self.nodal_mass)
        pressed = highest_contact(self.surfaces, self.state.v, self.nodes.inverse_mass)
        self.bodies_in_contact = bodies_in_contact(model.mesh, self.surfaces)
        self._external = zeros(self.state.u.shape)
        self._planned = np.zeros((0 if model.motion is None else len(model.motion.nodes), 3))
        self.time_s = 0.0
        self.dt_s = 0.0  # the step that led to time_s
        self.steps = 0
        self.course_s = 0.0  # spent inside the compiled course: steps, looks and samples
        # Instants are counted from where dt last changed, so that a run does not depend on how it is cut into chunks.
        self._origin_s, self._index = 0.0, 0
        # Every instant of a transient run is accepted: the material's memory is overwritten in place.
        running = self.blocks._replace(new=self.blocks.old)
        share = 1 if model.motion or model.weights else threads or usual_threads(len(self.hexes))
        loaded = np.concatenate([self.loads.rows, self.ties.node, self.surfaces.node])
        self.parts = parts_of(self.state, running, share, loaded)
        self.bones = bones_of(model.bones, model.mesh, self._place, self.blocks.position, self.nodes, self.parts)
        # that contact leaves room for between two stability checks [1/s]
        self._contact_frequency = float(np.sqrt(max(FIRST_TOUCHES * self.bones.mobility.max(initial=0.0), pressed)))
        self._ledgers = np.zeros((len(self.parts), LEDGER))
        self._looks = looks_of(self.nodes, len(self.parts))
        self.lookers = lookers_of(self.parts, self.blocks, self.state, self._looks)
        self._difference_m = 1e-6 * float(np.cbrt(self.volumes.min()))  # over which a force is differenced
        still = np.concatenate([looker.blocks.effects for looker in self.lookers])
        self._detached = detach(self.blocks, still, self.hexes if stress else self.hexes[:0], self.points, self.volumes)
        self._now = self.recording(1)
        self._activate()
        if displacement is not None and any(effect.remembers for effect in model.effects):
            self._remember_as_held()

    # ---- the stable step ----

    def stable_limit(self, turns: int) -> float:
        """Estimate the largest stable step of the present state by a Lanczos iteration.

        A point that touches a bone before the next stability check adds at most 2 k A / m to the square of the highest frequency.
        The limit is reduced if the ratio of step and limit does not cover that. It is NaN if it cannot be determined.

        Parameters
        ----------
        turns : number of Lanczos iterations.
        """
        if not self.kernels.is_ready:  # all pieces at once
            self.compile()
        self._evaluate([looker.blocks for looker in self.lookers])
        looks = self._looks._replace(basis=zeros((turns + 1, *self.state.u.shape)))
        lookers = [
            looker._replace(tridiagonal=np.zeros((4, turns)), watch=np.zeros_like(looker.watch)) for looker in self.lookers
        ]
        times = np.array([self.time_s, self.time_s])
        checked = self.bones.checked.copy()
        self._course(times, 0, self.dt_s, LIMIT_ALONE, self._now.at(_NOTHING), (looks, lookers, turns))
        self.bones.checked[:] = checked
        return float(lookers[0].watch[LIMIT])

    def see_elements(self) -> None:
        """Compute how the highest frequency of each element depends on its shape, for the stability checks."""
        shapes = shape_numbers(self.kernels.forces, self.blocks, self.points[self.hexes], self.density)
        first = 0
        for looker in self.lookers:
            looker.shapes[:] = shapes[first : first + len(looker.shapes)]
            first += len(looker.shapes)

    def stable_bound(self) -> tuple[float, int]:
        """A lower bound of the stable step [s], and the element that determines it: the one with the highest frequency.

        If an element is inverted, the bound is NaN and the element is that one.
        """
        return self._fastest(np.arange(len(self.hexes)), self.blocks)

    def limiting_element(self) -> int:
        """Number of the element with the highest frequency by itself, which determines the time step.

        In a large mesh only the elements are compared where the fastest vibration of the mesh is strongest.
        """
        if len(self.hexes) <= MANY_ELEMENTS:
            return self.stable_bound()[1]
        strength = np.sum(self._looks.vector**2, axis=1)[self.hexes].sum(axis=1)
        strength = np.pad(strength, (0, len(self.blocks.nodes) * WIDTH - len(strength))).reshape(-1, WIDTH)
        places = np.argsort(-strength.max(axis=1), kind="stable")[: MANY_ELEMENTS // WIDTH]
        lanes = np.sort((places[:, None] * WIDTH + np.arange(WIDTH)).ravel())
        lanes = lanes[lanes < len(self.hexes)]
        return self._fastest(lanes, self.blocks.each(lambda array: array[np.sort(places)]))[1]

    def _fastest(self, elements: np.ndarray, blocks: Blocks) -> tuple[float, int]:
        """``stable_bound`` for some elements, in computing order, and their blocks."""
        volumes = self.volumes[elements]
        frequency, element = fastest_element(
            self.kernels.forces,
            blocks,
            self.state.u[self.hexes[elements], :3],
            volumes * self.density[elements] / 8.0,
            np.cbrt(volumes),
        )
        return 2.0 / frequency, int(self.element_order[elements[element]])

    # ---- loads ----

    def external_force(self) -> np.ndarray:
        """External force on each node at the present time, (n, 3), N."""
        self.snapshot()
        return self._external[self._place, :3]

    # ---- running ----

    def compile(self, progress: Callable[[float], None] = lambda share: None) -> float:
        """Load the compiled kernels, or compile them and tell ``progress`` the share that is done; return the seconds it took."""
        begin = time.perf_counter()
        progress(0.0)
        self.advance(0, 0.0)
        progress(0.8)
        self.kernels.forces(self.state.u, np.zeros_like(self.state.u), self.lookers[0].blocks)
        self.course_s = 0.0
        self._looks.spent[:] = 0
        progress(1.0)
        return time.perf_counter() - begin

    def start(self, dt_s: float) -> None:
        """Half-step start: v_(-1/2) = v_0 - dt/2 a_0, so that the first step leads to v_0 + dt/2 a_0.

        ``dt_s``: the first time step, s.
        """
        finite_number("start: dt_s", dt_s, 0.0)
        v = self.state.v
        smallest = self._evaluate([part.blocks for part in self.parts])
        nearest = min(part.blocks.corner[CORNER] for part in self.parts)
        for part in self.parts:  # the work of the muscles counts from here
            part.blocks.last_length[:] = part.blocks.length.sum(axis=1)
        self.dt_s = dt_s
        self.snapshot()  # fills the forces at time 0
        resting = self._now.arrays.rows[1]
        acceleration = self.nodes.inverse_mass * (resting + self._external) - self.alpha_per_s * v
        acceleration[self.nodes.inverse_mass == 0.0] = 0.0
        # The trapezoidal sums begin at t_0: take off the half of a step that would lead to it.
        before = v - 0.5 * dt_s * acceleration
        self.loads.start(dt_s)
        self._ledgers[:] = 0.0
        self._ledgers[:, SMALLEST_J], self._ledgers[:, SMALLEST_CORNER] = smallest, nearest
        self._ledgers[0, EXTERNAL_WORK] = -0.5 * dt_s * np.sum(self._external * before)
        self._ledgers[0, DAMPING_LOSS] = -0.5 * dt_s * self.alpha_per_s * np.sum(self.nodes.mass * v * before)
        v[:] = before

    def advance(self, steps: int, dt_s: float) -> bool:
        """Advance by a number of equal steps.

        Parameters
        ----------
        steps : number of steps.
        dt_s : time step, s; below :meth:`stable_limit`.

        Returns
        -------
        False if an element has inverted; the loop then ended there.
        """
        if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0:
            raise InputError(f"advance: steps must be a whole number, 0 or more, not {steps!r}.")
        self.go(steps, finite_number("advance: dt_s", dt_s, 0.0))
        return self.sound

    def go(
        self,
        steps: int,
        dt_s: float,
        *,
        end_s: float | None = None,
        looking: int = NO_LOOKS,
        recording: Recording | None = None,
        instants: np.ndarray = _NOTHING,
    ) -> int:
        """Advance by equal steps, with stability checks and samples; :class:`Transient` uses it.

        The loop ends early if an element inverts, or if a stability check requires another step.

        Parameters
        ----------
        steps : largest number of steps.
        dt_s : time step, s.
        end_s : the exact time after all steps, s, without rounding error.
        looking : NO_LOOKS, AUTOMATIC_STEP or FIXED_STEP of ``course.py``.
        recording : receives samples after ``instants`` steps, (k,), increasing.

        Returns
        -------
        Number of steps done.
        """
        if dt_s != self.dt_s:
            self._origin_s, self._index = self.time_s, 0
        self.set_increment(dt_s)
        times = self._origin_s + dt_s * np.arange(self._index, self._index + steps + 2)
        times[0] = self.time_s
        if end_s is not None:
            times[steps] = end_s
        begin = time.perf_counter()
        done = self._course(times, steps, float(dt_s), looking, (recording or self._now).at(instants))
        self.course_s += time.perf_counter() - begin
        if recording is not None:
            recording.add(times[instants], np.where(instants > 0, dt_s, self.dt_s), self.steps + instants)
        self.steps, self._index = self.steps + done, self._index + done
        self.time_s, self.dt_s = float(times[done]), float(dt_s)
        return done

    def snapshot(self) -> Snapshot:
        """Energies and fields at the present time: a sample, as :meth:`Transient.samples` yields it."""
        self._now.clear()
        times = np.array([self.time_s, self.time_s + self.dt_s])
        self._course(times, 0, self.dt_s, NO_LOOKS, self._now.at(np.zeros(1, dtype=np.int64)))
        self._now.add(times[:1], np.array([self.dt_s]), np.array([self.steps]))
        return self._now[0]

    def recording(self, room: int) -> Recording:
        """Memory for ``room`` samples of this body."""
        lane = np.argsort(self.element_order)
        others = len(self.surfaces.pairs), self.model, self.state, self.holders, self._detached
        return Recording(self.model, samples_of(room, self._place, lane, self.bones.user, *others), self.holders)

    @property
    def loop_s(self) -> float:
        """Wall time of the steps [s]."""
        return self.course_s - self.look_s - self.sample_s

    @property
    def look_s(self) -> float:
        """Wall time of the stability checks [s]."""
        return self.course_s * self._looks.spent[IN_LOOKS] / max(self._looks.spent[IN_ALL], 1)

    @property
    def sample_s(self) -> float:
        """Wall time of the samples [s]."""
        return self.course_s * self._looks.spent[IN_SAMPLES] / max(self._looks.spent[IN_ALL], 1)

    @property
    def ledger(self) -> np.ndarray:
        """(LEDGER,) Work so far [J], summed over all threads, and the smallest J and corner of any element in any step."""
        total = self._ledgers.sum(axis=0)
        total[SMALLEST_J:] = self._ledgers[:, SMALLEST_J:].min(axis=0)  # NaN if one is
        return total

    @property
    def sound(self) -> bool:
        """Whether no element has inverted, neither as a whole nor at a guarded corner."""
        return bool((self.ledger[SMALLEST_J:] > 0.0).all())

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Copies of the complete state, in computing order."""
        return {
            "u": self.state.u.copy(),
            "v": self.state.v.copy(),
            "highest_mode": self._looks.vector.copy(),
            "allowed_bound": self._looks.bound[:, 2].copy(),
            "watch": self.lookers[0].watch.copy(),
            "ledgers": self._ledgers.copy(),
            "memory": self.blocks.old.copy(),
            "lengths": np.array([part.blocks.last_length for part in self.parts]),
            "times": np.array([self.time_s, self.dt_s, self._origin_s]),
            "steps": np.array([self.steps, self._index], dtype=np.int64),
            "weights": self.loads.weights.state.copy(),
            "surfaces": state_of_contact(self.surfaces),
            **state_of_bones(self.bones),
        }

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Continue from a restart state of the same model, bitwise identically to an uninterrupted run.

        With another number of threads the runs are identical up to rounding.
        """
        state = for_threads(state, len(self.parts))
        self.state.u[:] = state["u"]
        self.state.v[:] = state["v"]
        self._looks.vector[:] = state["highest_mode"]
        self._looks.bound[:, 2] = state["allowed_bound"]
        self.watch(state["watch"])
        self._ledgers[:] = state["ledgers"]
        self.blocks.old[:] = state["memory"]
        self.loads.weights.state[:] = state.get("weights", self.loads.weights.state)  # older files have none
        restore_bones(self.bones, state)
        restore_contact(self.surfaces, state.get("surfaces", state_of_contact(self.surfaces)))
        self.time_s, self.dt_s, self._origin_s = (float(x) for x in state["times"])
        self.steps, self._index = (int(x) for x in state["steps"])
        self._activate()
        self._evaluate([looker.blocks for looker in self.lookers])
        for part, length in zip(self.parts, state["lengths"], strict=True):
            part.blocks.last_length[:] = length

    def watch(self, watch: np.ndarray) -> None:
        """Set the result of the last stability check and the time of the next one for all threads, (WATCH,)."""
        for looker in self.lookers:
            looker.watch[:] = watch

    # ---- inside ----

    def _remember_as_held(self) -> None:
        """Let the material remember its initial state as if it had been held for a long time: all relaxation is over."""
        self.set_increment(LONG_HOLD_S)
        self._evaluate([part.blocks for part in self.parts])
        self.set_increment(0.0)

    def _activate(self) -> None:
        """Give the muscles that pull by a stress their activation of the present time."""
        self.blocks.activation[:, 0] = self.loads.muscles(np.array([self.time_s]), max(self.dt_s, SHORTEST_INCREMENT_S))[0]

    def _evaluate(self, blocks: Sequence[Blocks]) -> float:
        """Minus the internal force of the present state, summed in the order of ``advance``; the smallest J."""
        u, force = self.state.u, self.state.force
        if len(self.parts) == 1:
            return self.kernels.forces(u, force, blocks[0])
        tasks = [
            lambda part=part, some=some: self.kernels.forces(part.u, part.force, some)
            for part, some in zip(self.parts, blocks, strict=True)
        ]
        smallest = together(tasks, self.parts[0].gate)
        for part in self.parts:
            part.force[: len(part.lower)] += part.lower
            force[part.first : part.first + part.own] = part.force[: part.own]
        return float(np.min(smallest))

    def _for_all_parts(self, addresses: Addresses = NO_ADDRESSES) -> tuple[object, ...]:
        """What the parts share; a run that is differentiated has more to share."""
        return Shared(self.blocks, self.nodes, self._external, float(self.alpha_per_s), _UNRECORDED, addresses)

    def _course(
        self,
        times: np.ndarray,
        steps: int,
        dt_s: float,
        looking: int,
        samples: Samples,
        looking_with: tuple[Looks, Sequence[Looker], int] | None = None,
    ) -> int:
        """Let each part have its thread; give the number of steps done. ``times`` are those of all instants, and one more."""
        looks, lookers, turns = looking_with or (self._looks, self.lookers, TURNS_LATER)
        actions = self.loads.actions(times, max(dt_s, SHORTEST_INCREMENT_S), self.bones, self.ties, self.surfaces, self._planned)
        lengths = (self._difference_m, self._contact_frequency)
        span = Span(float(self.dt_s), float(dt_s), int(steps), int(looking), int(turns), *lengths)
        shared = self._for_all_parts()
        first = (self.state, self.parts[0], looks, lookers[0], shared, actions, samples, 0, span, self._ledgers)
        others = (self._for_all_parts(self.kernels.addresses(first)), actions, samples, 0, span, self._ledgers)
        gate = self.parts[0].gate
        gate[:] = 0
        look_up_if_changed(self.bones, self.state.u)
        tasks = [
            lambda part=part, looker=looker: self.kernels.course(self.state, part, looks, looker, *others)
            for part, looker in zip(self.parts, lookers, strict=True)
        ]
        done = int(together(tasks, gate)[0])
        self.bones.seen[:] = self.state.u
        return done
