"""Model -> compiled kernels and the arrays they work on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.compiled.arrays import (
    BONE_SUMS,
    CORNER,
    ENERGIES,
    LEDGER,
    SMALLEST_CORNER,
    SMALLEST_J,
    STIFFEST,
    Blocks,
    zeros,
)
from explicitfe.compiled.simd import WIDTH
from explicitfe.compiled.threads import together
from explicitfe.model.model import Model
from explicitfe.solve.body import Body
from explicitfe.solve.bones import bones_of, ties_of
from explicitfe.solve.loads import Loads
from explicitfe.solve.parts import parts_of, usual_threads
from explicitfe.solve.stable_step import STEP_SHARE_OF_LIMIT, HighestFrequency, fastest_element

_NOBODY = np.zeros((0, 0))  # asks for no sums over the bones
# By how much of the square of the highest frequency the barrier may stiffen before the step is looked at again: 0.9 of the limit
# is then 0.96 of the new one at most.
BARRIER_MARGIN = 0.15
MANY_ELEMENTS = 32768  # more are not all looked at to name the one that limits the step


@dataclass(frozen=True)
class Snapshot:
    """What a sample shows, in the user's numbering.

    Attributes
    ----------
    time_s : s.
    displacement, velocity : (n, 3) m, m/s.
    J, hourglass_energy : (m,), (m,) J.
    energies : (ENERGIES,) J: internal, hourglass, kinetic, external work, lost to damping, lost in the material, stored in
        contact, stored in ties, lost in contact, stored in the barrier against folding.
    smallest_J : the smallest J of any element in any step so far.
    contact_pressure : (bones, n) Pa. With which each bone presses on each node.
    contact : (bones, BONE_SUMS). Force of each bone on the body [N], area in contact [m^2], deepest node in it [m].
    """

    time_s: float
    displacement: np.ndarray
    velocity: np.ndarray
    J: np.ndarray
    hourglass_energy: np.ndarray
    energies: np.ndarray
    smallest_J: float
    contact_pressure: np.ndarray
    contact: np.ndarray


class Simulation(Body):
    """A model ready to be advanced in time.

    Parameters
    ----------
    model : the physics.
    displacement, velocity : (n, 3) m, m/s at time 0; zero if left out.
    threads : that share a step; as many as it pays for a mesh of this size, if left out. One for prescribed motion.
    """

    def __init__(
        self,
        model: Model,
        *,
        displacement: np.ndarray | None = None,
        velocity: np.ndarray | None = None,
        threads: int | None = None,
    ) -> None:
        super().__init__(model, displacement=displacement, velocity=velocity)
        self.loads = Loads(model, self._place)
        held = np.all(self.nodes.inverse_mass[self._place, :3] == 0.0, axis=1)
        self.bones = bones_of(model.bones, model.mesh, self._place, self.nodal_mass, held)
        self.ties = ties_of(model.attachments, model.mesh, self._place)
        self._pressure = np.zeros((len(model.bones), len(self.bones.node)))
        self._contact = np.zeros((len(model.bones), BONE_SUMS))
        self._resting = zeros(self.state.u.shape)
        stiffest = self.bones.spring * self.nodes.inverse_mass[self.bones.node].max(axis=1)
        self._contact_frequency = np.sqrt(stiffest.max(initial=0.0))  # of a point that rests on bone alone [1/s]
        self._highest = self._highest_frequency()
        self._external = zeros(self.state.u.shape)
        self._planned = np.zeros((0 if model.motion is None else len(model.motion.nodes), 3))
        self._velocity = np.zeros_like(self.state.u)
        self.ledger = np.zeros(LEDGER)
        self.time_s = 0.0
        self.dt_s = 0.0  # the step that led to time_s
        self.steps = 0
        # How stiff over mass the barrier against folding may become before the loop comes back for a look at the step [1/s^2].
        self.barrier_ceiling = np.inf
        self.loop_s = 0.0  # spent inside the compiled loop
        # Instants are counted from where dt last changed, so that a run does not depend on how it is cut into chunks.
        self._origin_s, self._index = 0.0, 0
        # Every instant of a transient run is accepted: the material's memory is overwritten in place.
        running = self.blocks._replace(new=self.blocks.old)
        share = 1 if model.motion else threads or usual_threads(len(self.hexes))
        loaded = np.concatenate([self.loads.dead.node, self.loads.fibres.nodes.ravel(), self.ties.node])
        self.parts = parts_of(self.state, running, share, self.bones.node, loaded)
        self._ledgers = np.zeros((len(self.parts), LEDGER))
        # The same to look at a state without accepting it.
        ends = np.cumsum([len(part.blocks.nodes) for part in self.parts])
        memories = np.split(self.blocks.new, ends[:-1])
        self._seen = [
            part.blocks._replace(new=memory, length=np.zeros_like(part.blocks.length))
            for part, memory in zip(self.parts, memories, strict=True)
        ]
        self._activate()

    # ---- the stable step ----

    def stable_limit(self, turns: int) -> float:
        """Largest stable step [s] of the present state, by so many turns of Lanczos; NaN if it cannot be found.

        A point that comes to a bone before the next look adds k A / m to the square of the highest frequency at most. Where the
        share of the limit that a step takes does not leave room for that, the limit is shorter.
        """
        self._present_force()
        stiffest = max(part.corner[STIFFEST] for part in self._seen)
        highest = self._highest(self.state.u, self._with_bones(self.state.u, self.state.force.copy()), turns)
        self.barrier_ceiling = float(stiffest + BARRIER_MARGIN * highest**2)
        touching = np.hypot(highest, self._contact_frequency)
        return min(2.0 / highest, 2.0 / touching / STEP_SHARE_OF_LIMIT)

    def stable_bound(self) -> tuple[float, int]:
        """A step [s] that the present state bears for certain, and the element (user's number) that sets it.

        It is that of the fastest element by itself. Where an element cannot be judged, because it has turned inside out, it is
        that element and NaN.
        """
        return self._fastest(np.arange(len(self.hexes)), self.blocks)

    def limiting_element(self) -> int:
        """The element (user's number) whose own highest frequency is highest now.

        In a large mesh it is sought where the fastest vibration of the whole mesh is strongest.
        """
        if len(self.hexes) <= MANY_ELEMENTS:
            return self.stable_bound()[1]
        strength = np.sum(self._highest.vector**2, axis=1)[self.hexes].sum(axis=1)
        strength = np.pad(strength, (0, len(self.blocks.nodes) * WIDTH - len(strength))).reshape(-1, WIDTH)
        places = np.argsort(-strength.max(axis=1), kind="stable")[: MANY_ELEMENTS // WIDTH]
        lanes = np.sort((places[:, None] * WIDTH + np.arange(WIDTH)).ravel())
        lanes = lanes[lanes < len(self.hexes)]
        return self._fastest(lanes, self.blocks.each(lambda array: array[np.sort(places)]))[1]

    def largest_strain_rate(self) -> float:
        """Largest norm of grad v of any element [1/s], with the velocity of the last half step."""
        return self.kernels.largest_strain_rate(self.state.v, self.blocks)

    def _fastest(self, elements: np.ndarray, blocks: Blocks) -> tuple[float, int]:
        """Of some elements, in computing order, and their blocks: see ``stable_bound``."""
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
        """External force (n, 3) N at the present time."""
        self._snapshot()
        return self._external[self._place, :3]

    # ---- running ----

    def compile(self, progress: Callable[[float], None] = lambda share: None) -> float:
        """Make the machine code ready, from the cache on disk where it is there; give the seconds it took.

        ``progress`` is called with the share that is done.
        """
        begin = time.perf_counter()
        progress(0.0)
        here = np.zeros_like(self.state.u)
        self._force_at_rest(self.state.u, here)
        self._highest_frequency()(self.state.u, here, 1)
        progress(0.5)
        self._snapshot()
        progress(0.75)
        self.largest_strain_rate()
        progress(0.85)
        self.advance(0, 0.0)
        self.loop_s = 0.0
        progress(1.0)
        return time.perf_counter() - begin

    def start(self, dt_s: float) -> None:
        """Half-step start: v_(-1/2) = v_0 - dt/2 a_0, so that the first step leads to v_0 + dt/2 a_0."""
        v = self.state.v
        self.ledger[SMALLEST_J] = self._evaluate(self.state.u, self.state.force, [part.blocks for part in self.parts])
        self.ledger[SMALLEST_CORNER] = min(part.blocks.corner[CORNER] for part in self.parts)
        for part in self.parts:  # the work of the muscles counts from here
            part.blocks.last_length[:] = part.blocks.length.sum(axis=1)
        self.dt_s = dt_s
        self._snapshot()  # fills the forces at time 0
        acceleration = self.nodes.inverse_mass * (self._resting + self._external) - self.model.alpha_per_s * v
        acceleration[self.nodes.inverse_mass == 0.0] = 0.0
        # The trapezoidal sums begin at t_0: take off the half of a step that would lead to it.
        before = v - 0.5 * dt_s * acceleration
        self.ledger[0] = -0.5 * dt_s * np.sum(self._external * before)
        self.ledger[1] = -0.5 * dt_s * self.model.alpha_per_s * np.sum(self.nodes.mass * v * before)
        v[:] = before

    def advance(self, steps: int, dt_s: float) -> bool:
        """Advance by ``steps`` steps of dt; False if an element has turned inside out or folded (then the loop ended there)."""
        if dt_s != self.dt_s:
            self._origin_s, self._index = self.time_s, 0
        self.set_increment(dt_s)
        instants = self._origin_s + dt_s * np.arange(self._index, self._index + steps + 1)
        bone_placement, tie_placement = self.loads.bones(instants)
        others = (
            self.nodes,
            self.loads.dead,
            self.loads.fibres,
            self.loads.activation(instants, dt_s),
            self.loads.muscles(instants, dt_s),
            self.bones,
            bone_placement,
            self.ties,
            tie_placement,
            self.loads.motion(instants),
            self._planned,
            _NOBODY,
            float(self.model.alpha_per_s),
            float(self.dt_s),
            float(dt_s),
            self.barrier_ceiling,
            int(steps),
        )
        begin = time.perf_counter()
        if len(self.parts) == 1:
            done = self.kernels.advance(self.state, self._external, self.parts[0], *others, self.ledger)
        else:
            done = self._advance_together(others)
        self.loop_s += time.perf_counter() - begin
        self.steps += done
        self._index += done
        self.time_s = float(instants[done])
        self.dt_s = float(dt_s)
        return bool(self.ledger[SMALLEST_J] > 0.0 and self.ledger[SMALLEST_CORNER] > 0.0)

    def _advance_together(self, others: tuple[object, ...]) -> int:
        """Let each part have its thread; give the number of steps done."""
        self._ledgers[:] = 0.0
        self._ledgers[:, SMALLEST_J:] = self.ledger[SMALLEST_J:]
        gate = self.parts[0].gate
        gate[:] = 0
        waiting = [
            lambda part=part, ledger=ledger: self.kernels.advance(self.state, self._external, part, *others, ledger)
            for part, ledger in zip(self.parts, self._ledgers, strict=True)
        ]
        done = together(waiting, gate)
        self.ledger[:SMALLEST_J] += self._ledgers[:, :SMALLEST_J].sum(axis=0)
        self.ledger[SMALLEST_J:] = self._ledgers[:, SMALLEST_J:].min(axis=0)  # not a number where one is
        return done[0]

    def snapshot(self) -> Snapshot:
        """Energies and fields at the present time."""
        energies = self._snapshot()
        return Snapshot(
            time_s=self.time_s,
            displacement=self.displacement,
            velocity=self._velocity[self._place, :3],
            J=self._in_elements(self._element_J),
            hourglass_energy=self._in_elements(self._element_hourglass),
            energies=energies,
            smallest_J=float(self.ledger[SMALLEST_J]),
            contact_pressure=self._contact_pressure(),
            contact=self._contact.copy(),
        )

    def _contact_pressure(self) -> np.ndarray:
        """(bones, n) Pa on the nodes, in the user's numbering."""
        pressure = np.zeros((len(self.model.bones), len(self.state.u)))
        pressure[:, self.bones.node] = self._pressure
        return pressure[:, self._place]

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Copies of all that the future depends on, in computing order."""
        return {
            "u": self.state.u.copy(),
            "v": self.state.v.copy(),
            "highest_mode": self._highest.vector.copy(),
            "ledger": self.ledger.copy(),
            "memory": self.blocks.old.copy(),
            "lengths": np.sum([part.blocks.last_length for part in self.parts], axis=0),
            "times": np.array([self.time_s, self.dt_s, self._origin_s]),
            "steps": np.array([self.steps, self._index], dtype=np.int64),
        }

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go on from a restart state of the same model; the run then is bit for bit the one that was not stopped."""
        self.state.u[:] = state["u"]
        self.state.v[:] = state["v"]
        self._highest.vector = state["highest_mode"].copy()
        self.ledger[:] = state["ledger"]
        self.blocks.old[:] = state["memory"]
        self.time_s, self.dt_s, self._origin_s = (float(x) for x in state["times"])
        self.steps, self._index = (int(x) for x in state["steps"])
        self._activate()
        self._present_force()
        for part in self.parts:
            part.blocks.last_length[:] = state["lengths"] if part.number == 0 else 0.0

    # ---- inside ----

    def _highest_frequency(self) -> HighestFrequency:
        return HighestFrequency(
            self._force_at_rest,
            self.nodes.inverse_mass,
            float(np.cbrt(self.volumes.min())),
        )

    def _force_at_rest(self, u: np.ndarray, force: np.ndarray) -> float:
        """Minus the internal force at u near the present state, with ties and the stiffness of contact; the smallest J."""
        smallest = self._evaluate(u, force, self._seen)
        self._with_bones(u, force)
        return smallest

    def _with_bones(self, u: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Forces on the node rows with ties and the stiffness of contact added, of bones as they are placed now."""
        if self.model.bones or self.model.attachments:
            bone_placement, tie_placement = self.loads.bones(np.array([self.time_s]))
            self.kernels.hold(u, force, self.state.u, self.bones, bone_placement, self.ties, tie_placement)
        return force

    def _activate(self) -> None:
        """Give the muscles that pull by a stress their activation of the present time."""
        self.blocks.activation[:, 0] = self.loads.muscles(np.array([self.time_s]), max(self.dt_s, 1e-12))[0]

    def _present_force(self) -> np.ndarray:
        self.set_increment(0.0)  # of this instant: a look must not let time pass
        self._evaluate(self.state.u, self.state.force, self._seen)
        return self.state.force

    def _evaluate(self, u: np.ndarray, force: np.ndarray, blocks: Sequence[Blocks]) -> float:
        """Minus the internal force at u into ``force``, summed in the order of ``advance``; the smallest J."""
        if len(self.parts) == 1:
            return self.kernels.forces(u, force, blocks[0])
        tasks = [
            lambda part=part, some=some: self.kernels.forces(u[part.first : part.first + len(part.u)], part.force, some)
            for part, some in zip(self.parts, blocks, strict=True)
        ]
        smallest = together(tasks, self.parts[0].gate)
        for part in self.parts:
            part.force[: len(part.lower)] += part.lower
            force[part.first : part.first + part.own] = part.force[: part.own]
        return float(np.min(smallest))

    def _snapshot(self) -> np.ndarray:
        energies = np.empty(ENERGIES)
        bone_placement, tie_placement = self.loads.bones(np.array([self.time_s]))
        energies[:] = self.kernels.snapshot(
            self.state,
            self._external,
            self.blocks,
            self.nodes,
            self.loads.dead,
            self.loads.fibres,
            self.loads.activation(np.array([self.time_s]), max(self.dt_s, 1e-12)),
            self.bones,
            bone_placement,
            self.ties,
            tie_placement,
            self.loads.motion(np.array([self.time_s, self.time_s + self.dt_s])),
            float(self.model.alpha_per_s),
            float(self.dt_s),
            self.ledger,
            self._velocity,
            self._resting,
            self._contact,
            self._pressure,
            self._element_J,
            self._element_energy,
            self._element_hourglass,
        )
        return energies
