"""Model -> compiled kernels and the arrays they work on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from types import ModuleType

import numpy as np

from explicitfe.compiled.arrays import (
    ENERGIES,
    LEDGER,
    SMALLEST_J,
    Blocks,
    DeadLoads,
    FollowerFibres,
    Motion,
    Nodes,
    Part,
    State,
    in_blocks,
    node_rows,
    zeros,
)
from explicitfe.compiled.jit import bind, kernel
from explicitfe.compiled.simd import ROW, WIDTH
from explicitfe.compiled.threads import cores, gate, together
from explicitfe.effects.effect import MaterialEffect
from explicitfe.elements import full, hex8
from explicitfe.elements import hourglass_stiffness as stiffness
from explicitfe.elements import hourglass_strain as assumed_strain
from explicitfe.errors import InputError
from explicitfe.forces import internal, internal_full, response
from explicitfe.materials import law_of
from explicitfe.mesh.hexmesh import MaterialPoints, shape_functions
from explicitfe.mesh.order import compute_order
from explicitfe.model.model import FibrePull, Model, NodalLoad
from explicitfe.model.profile import Profile
from explicitfe.solve import relax_step, step
from explicitfe.solve.stable_step import HighestFrequency, fastest_element


@dataclass(frozen=True)
class Kernels:
    """The compiled entry points for one material law."""

    forces: object
    advance: object
    snapshot: object
    largest_strain_rate: object
    relax: object
    elastic_energy: object
    press: object
    touch: object


MANY_ELEMENTS = 32768  # more are not all looked at to name the one that limits the step
# Measured: waking a thread costs some steps of a small mesh, and every sample and every look at the stable step does that.
ELEMENTS_A_THREAD = 2000

# An element: the templates of its forces, and its hourglass treatment or Gauss points. The first is the default.
ELEMENTS: dict[str, tuple[ModuleType, ModuleType]] = {
    "hex8": (internal, assumed_strain),
    "hex8-stiffness": (internal, stiffness),
    "hex8-full": (internal_full, full),
}


def kernels(law: str, element: str, effects: tuple[tuple[str, tuple[int, ...], int, int], ...] = ()) -> Kernels:
    """Kernels with the leaves of a law, an element and effects bound in (``response.bound`` says how the latter are given).

    Compiled at the first call, kept on disk for the next process.
    """
    return _kernels(law, element, effects)


@cache  # which would tell a default from the same value given
def _kernels(law: str, element: str, effects: tuple[tuple[str, tuple[int, ...], int, int], ...]) -> Kernels:
    templates, treatment = ELEMENTS[element]
    force, energy = templates.bound(law_of(law), treatment, effects)
    return Kernels(
        forces=bind(step.forces, internal_force=force),
        advance=bind(step.advance, internal_force=force),
        snapshot=bind(step.snapshot, internal_energy=energy),
        largest_strain_rate=kernel(internal.largest_strain_rate),
        relax=bind(relax_step.relax, internal_force=force),
        elastic_energy=bind(step.elastic_energy, internal_energy=energy),
        press=kernel(relax_step.press),
        touch=kernel(relax_step.touch),
    )


def layout_of(effects: Sequence[MaterialEffect]) -> tuple[tuple[str, tuple[int, ...], int, int], ...]:
    """Where the numbers and the memory of each effect begin; before them, where there are any, the work of the stress.

    Raises
    ------
    ValueError : an effect is there twice.
    """
    if len({type(effect) for effect in effects}) < len(effects):
        raise ValueError("an effect of the material can be there once only")
    layout: list[tuple[str, tuple[int, ...], int, int]] = []
    at, memory = 0, response.WORK_MEMORY
    for effect in effects:
        layout.append((type(effect).__name__, effect.shape, at, memory))
        at, memory = at + effect.numbers, memory + effect.memory
    return (("work", (), 0, 0), *layout) if layout else ()


def memory_of(effects: Sequence[MaterialEffect], count: int) -> dict[str, np.ndarray]:
    """Arrays of ``Blocks`` for the effects of so many elements: their numbers, and what they remember at rest."""
    blocks = -(-count // WIDTH)
    memory = sum(effect.memory for effect in effects) + (response.WORK_MEMORY if effects else 0)
    old, new = (zeros((blocks, max(memory, 1), WIDTH)) for _ in range(2))
    for place, value in response.AT_REST.items() if effects else ():
        old[:, place] = new[:, place] = value
    numbers = sum(effect.numbers for effect in effects)
    return {"effects": zeros((blocks, max(numbers, 1), WIDTH)), "old": old, "new": new}


def usual_threads(elements: int, each: int = ELEMENTS_A_THREAD) -> int:
    """How many threads pay for so many elements, if it takes ``each`` of them to keep one busy."""
    return max(1, min(cores(), elements // each))


def parts_of(state: State, blocks: Blocks, count: int) -> list[Part]:
    """The blocks in ``count`` runs of equal length, or in fewer where a run would share nodes with more than the next one."""
    total = len(blocks.nodes)
    meeting = gate()
    if count < 2:
        return [Part(0, 1, meeting, 0, len(state.u), state.u, state.force, state.force[:0], blocks)]
    bounds = np.linspace(0, total, min(count, total) + 1).astype(int)
    runs = [blocks.nodes[a:b] for a, b in pairwise(bounds)]
    first = [0, *(int(run.min()) // 2 * 2 for run in runs[1:])]
    begins = [*first, len(state.u)]
    # idle lanes are in the last run; a row that no element touches is of the part before it
    after = [max(int(run.max()) // 2 * 2 + 2, begin) for run, begin in zip(runs[:-1], first[1:], strict=True)] + [len(state.u)]
    owned = np.diff(begins)
    if any(owned <= 0) or any(end > begin for end, begin in zip(after, begins[2:], strict=False)):
        return parts_of(state, blocks, count - 1)
    forces = [zeros((b - a, ROW)) for a, b in zip(first, after, strict=True)]
    found = []
    for k, (a, b) in enumerate(pairwise(bounds)):
        mine = Blocks(*(array[a:b] for array in blocks))._replace(nodes=runs[k] - np.uint32(first[k]))
        lower = forces[k - 1][first[k] - first[k - 1] :] if k else state.force[:0]
        rows = slice(first[k], after[k])
        found.append(Part(k, len(runs), meeting, first[k], int(owned[k]), state.u[rows], forces[k], lower, mine))
    return found


@dataclass(frozen=True)
class Snapshot:
    """What a sample shows, in the user's numbering.

    Attributes
    ----------
    time_s : s.
    displacement, velocity : (n, 3) m, m/s.
    J, hourglass_energy : (m,), (m,) J.
    energies : (ENERGIES,) J: internal, hourglass, kinetic, external work, lost to damping, lost in the material.
    smallest_J : the smallest J of any element in any step so far.
    """

    time_s: float
    displacement: np.ndarray
    velocity: np.ndarray
    J: np.ndarray
    hourglass_energy: np.ndarray
    energies: np.ndarray
    smallest_J: float


class Body:
    """Elements, masses and kernels of a model. Arrays inside are in computing order; what comes out, in the user's numbering.

    Parameters
    ----------
    model : the physics.
    displacement, velocity : (n, 3) m, m/s to begin with; zero if left out.
    """

    def __init__(self, model: Model, *, displacement: np.ndarray | None = None, velocity: np.ndarray | None = None) -> None:
        if model.effects and model.element == "hex8-full":
            raise InputError('element = "hex8-full" knows no effects of the material; take "hex8".')
        self.model = model
        mesh = model.mesh
        self.node_order, self.element_order = compute_order(mesh.hexes, mesh.node_count)
        self._place = np.empty(mesh.node_count, dtype=np.int64)
        self._place[self.node_order] = np.arange(mesh.node_count)
        self.points = np.ascontiguousarray(mesh.points[self.node_order])
        self.hexes = self._place[mesh.hexes[self.element_order]]

        law = model.material
        count = mesh.element_count
        self.constants = np.tile(np.array(law.constants(), dtype=float), (count, 1))
        if model.stiffness is not None:
            self.constants = law.scaled(self.constants, model.stiffness[self.element_order])
        self.density = np.full(count, law.density_kg_m3)
        corners = self.points[self.hexes]
        geometry = hex8.geometry(corners)
        self.volumes = np.ascontiguousarray(geometry[:, hex8.VOLUME])
        self.blocks = Blocks(
            nodes=in_blocks(self.hexes.astype(np.uint32), idle=mesh.node_count),
            geometry=in_blocks(geometry),
            constants=in_blocks(self.constants),
            hourglass=in_blocks(ELEMENTS[model.element][1].constants(corners, geometry)),
            **memory_of(model.effects, count),
        )
        mass = hex8.lumped_mass(self.hexes, self.volumes * self.density, mesh.node_count)
        held = model.held.copy()
        if model.motion is not None:
            held[model.motion.nodes] = True
        self.nodes = self.with_masses(node_rows(np.tile(mass[:, None], 3)), held)
        self._increment_s = np.nan
        self.kernels = kernels(law.law, model.element, layout_of(model.effects))
        zero = np.zeros((mesh.node_count, 3))
        self.state = State(
            u=self._rows(zero if displacement is None else displacement),
            v=self._rows(zero if velocity is None else velocity),
            force=node_rows(zero),
        )
        self.state.v[self.nodes.inverse_mass == 0.0] = 0.0
        self.set_increment(0.0)
        self._element_J = np.ones((len(self.blocks.nodes), self.blocks.nodes.shape[2]))
        self._element_energy = np.zeros_like(self._element_J)
        self._element_hourglass = np.zeros_like(self._element_J)

    def set_increment(self, increment_s: float) -> None:
        """The time that passes between the state that the material remembers and the one that is evaluated [s]."""
        if increment_s != self._increment_s and self.model.effects:
            values = [value for effect in self.model.effects for value in effect.values(increment_s)]
            self.blocks.effects[:] = np.array(values)[None, :, None]
        self._increment_s = increment_s

    def with_masses(self, rows: np.ndarray, held: np.ndarray) -> Nodes:
        """Nodes with masses (N, 4) kg, of which (n, 3) components, in the user's numbering, are held."""
        free = node_rows(~held[self.node_order])
        return Nodes(mass=rows, inverse_mass=np.divide(free, rows, out=zeros(rows.shape), where=rows > 0.0))

    # ---- in the user's numbering ----

    @property
    def displacement(self) -> np.ndarray:
        """(n, 3) m now."""
        return self.state.u[self._place, :3]

    @property
    def nodal_mass(self) -> np.ndarray:
        """(n,) kg."""
        return self.nodes.mass[self._place, 0]

    def internal_force(self, displacement: np.ndarray) -> np.ndarray:
        """Internal force (n, 3) N at a displacement (n, 3) m, without touching the state."""
        force = np.zeros_like(self.state.u)
        self.kernels.forces(self._rows(displacement), force, self.blocks)
        return -force[self._place, :3]

    def broken_element(self) -> int:
        """The element (user's number) whose smallest J, at any integration point, is lowest or not a number."""
        u, scratch = self.state.u, np.empty_like(self.state.u)

        def smallest(first: int, lanes: slice) -> float:
            few = Blocks(*(np.ascontiguousarray(array[first : first + 1, :, lanes]) for array in self.blocks))
            full = Blocks(*(np.repeat(a, WIDTH, axis=2) if a.shape[2] == 1 else a for a in few))
            J = self.kernels.forces(u, scratch, full)
            return J if -np.inf < J else -np.inf  # a NaN counts as lowest

        block = int(np.argmin([smallest(k, slice(None)) for k in range(len(self.blocks.nodes))]))
        count = min(WIDTH, len(self.hexes) - block * WIDTH)
        lane = int(np.argmin([smallest(block, slice(k, k + 1)) for k in range(count)]))
        return int(self.element_order[block * WIDTH + lane])

    # ---- inside ----

    def _rows(self, values: np.ndarray) -> np.ndarray:
        return node_rows(np.asarray(values, dtype=float)[self.node_order])

    def _in_elements(self, lanes: np.ndarray) -> np.ndarray:
        """(B, W) lanes as (m,) values in the user's numbering."""
        values = np.empty(self.model.mesh.element_count)
        values[self.element_order] = lanes.ravel()[: len(values)]
        return values


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
        self._highest = self._highest_frequency()
        self._profiles: list[Profile] = []
        self.loads = self._dead_loads(model.loads)
        self.fibres = self._follower_fibres(model.pulls)
        self._external = zeros(self.state.u.shape)
        self._planned = np.zeros((0 if model.motion is None else len(model.motion.nodes), 3))
        self._velocity = np.zeros_like(self.state.u)
        self.ledger = np.zeros(LEDGER)
        self.time_s = 0.0
        self.dt_s = 0.0  # the step that led to time_s
        self.steps = 0
        self.loop_s = 0.0  # spent inside the compiled loop
        # Instants are counted from where dt last changed, so that a run does not depend on how it is cut into chunks.
        self._origin_s, self._index = 0.0, 0
        # Every instant of a transient run is accepted: the material's memory is overwritten in place.
        running = self.blocks._replace(new=self.blocks.old)
        self.parts = parts_of(self.state, running, 1 if model.motion else threads or usual_threads(len(self.hexes)))
        self._ledgers = np.zeros((len(self.parts), LEDGER))
        # The same to look at a state without accepting it.
        ends = np.cumsum([len(part.blocks.nodes) for part in self.parts])
        memories = np.split(self.blocks.new, ends[:-1])
        self._seen = [part.blocks._replace(new=memory) for part, memory in zip(self.parts, memories, strict=True)]

    # ---- the stable step ----

    def stable_limit(self, turns: int) -> float:
        """Largest stable step [s] of the present state, by so many turns of Lanczos; NaN if it cannot be found."""
        return 2.0 / self._highest(self.state.u, self._present_force(), turns)

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
        return self._fastest(lanes, Blocks(*(array[np.sort(places)] for array in self.blocks)))[1]

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

    @property
    def load_edges_s(self) -> np.ndarray:
        """Times at which some load jumps or bends: step boundaries."""
        return np.unique(np.concatenate([p.edges_s for p in self._profiles] or [np.zeros(0)]))

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
        self._highest_frequency()(self.state.u, self.state.force, 1)
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
        _, v, force = self.state
        self.ledger[SMALLEST_J] = self._evaluate(self.state.u, self.state.force, [part.blocks for part in self.parts])
        self.dt_s = dt_s
        self._snapshot()  # fills the external force at time 0
        acceleration = self.nodes.inverse_mass * (force + self._external) - self.model.alpha_per_s * v
        acceleration[self.nodes.inverse_mass == 0.0] = 0.0
        # The trapezoidal sums begin at t_0: take off the half of a step that would lead to it.
        before = v - 0.5 * dt_s * acceleration
        self.ledger[0] = -0.5 * dt_s * np.sum(self._external * before)
        self.ledger[1] = -0.5 * dt_s * self.model.alpha_per_s * np.sum(self.nodes.mass * v * before)
        v[:] = before

    def advance(self, steps: int, dt_s: float) -> bool:
        """Advance by ``steps`` steps of dt; False if an element has turned inside out (then the loop ended there)."""
        if dt_s != self.dt_s:
            self._origin_s, self._index = self.time_s, 0
        self.set_increment(dt_s)
        instants = self._origin_s + dt_s * np.arange(self._index, self._index + steps + 1)
        rest = (
            self.nodes,
            self.loads,
            self.fibres,
            self._activation(instants, dt_s),
            self._motion(instants),
            self._planned,
            float(self.model.alpha_per_s),
            float(self.dt_s),
            float(dt_s),
            int(steps),
        )
        begin = time.perf_counter()
        if len(self.parts) == 1:
            done = self.kernels.advance(self.state, self._external, self.parts[0], *rest, self.ledger)
        else:
            done = self._advance_together(rest)
        self.loop_s += time.perf_counter() - begin
        self.steps += done
        self._index += done
        self.time_s = float(instants[done])
        self.dt_s = float(dt_s)
        return bool(self.ledger[SMALLEST_J] > 0.0)

    def _advance_together(self, rest: tuple) -> int:
        """Let each part have its thread; give the number of steps done."""
        self._ledgers[:] = 0.0
        self._ledgers[:, SMALLEST_J] = self.ledger[SMALLEST_J]
        gate = self.parts[0].gate
        gate[:] = 0
        waiting = [
            lambda part=part, ledger=ledger: self.kernels.advance(self.state, self._external, part, *rest, ledger)
            for part, ledger in zip(self.parts, self._ledgers, strict=True)
        ]
        done = together(waiting, gate)
        self.ledger[:SMALLEST_J] += self._ledgers[:, :SMALLEST_J].sum(axis=0)
        smallest = self._ledgers[:, SMALLEST_J]
        self.ledger[SMALLEST_J] = smallest.min() if not np.isnan(smallest).any() else np.nan
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
        )

    # ---- restart ----

    def restart_state(self) -> dict[str, np.ndarray]:
        """Copies of all that the future depends on, in computing order."""
        return {
            "u": self.state.u.copy(),
            "v": self.state.v.copy(),
            "highest_mode": self._highest.vector.copy(),
            "ledger": self.ledger.copy(),
            "memory": self.blocks.old.copy(),
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
        self._present_force()

    # ---- inside ----

    def _highest_frequency(self) -> HighestFrequency:
        return HighestFrequency(
            lambda u, force: self._evaluate(u, force, self._seen),
            self.nodes.inverse_mass,
            float(np.cbrt(self.volumes.min())),
        )

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

    def _activation(self, instants: np.ndarray, dt_s: float) -> np.ndarray:
        return np.array([p.at(instants, tolerance_s=1e-6 * dt_s) for p in self._profiles]).reshape(-1, len(instants))

    def _motion(self, instants: np.ndarray) -> Motion:
        motion = self.model.motion
        if motion is None:
            return Motion(node=np.zeros(0, dtype=np.int64), target=np.zeros((len(instants), 0, 3)))
        target = np.array(motion.displacement(instants), dtype=float, order="C")  # a copy: a read-only array is another signature
        return Motion(node=self._place[motion.nodes], target=target)

    def _snapshot(self) -> np.ndarray:
        energies = np.empty(ENERGIES)
        energies[:] = self.kernels.snapshot(
            self.state,
            self._external,
            self.blocks,
            self.nodes,
            self.loads,
            self.fibres,
            self._activation(np.array([self.time_s]), max(self.dt_s, 1e-12)),
            self._motion(np.array([self.time_s, self.time_s + self.dt_s])),
            float(self.model.alpha_per_s),
            float(self.dt_s),
            self.ledger,
            self._velocity,
            self._element_J,
            self._element_energy,
            self._element_hourglass,
        )
        return energies

    def _dead_loads(self, loads: Sequence[NodalLoad]) -> DeadLoads:
        sizes = [len(load.nodes) for load in loads]
        nodes = np.concatenate([self._place[load.nodes] for load in loads] or [np.zeros(0, dtype=np.int64)])
        forces = np.concatenate([np.asarray(load.force_N, dtype=float) for load in loads] or [np.zeros((0, 3))])
        return DeadLoads(
            start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            node=nodes.astype(np.int64),
            force=np.ascontiguousarray(forces.reshape(-1, 3)),
            profile=np.array([self._row_of(load.profile) for load in loads], dtype=np.int64),
        )

    def _follower_fibres(self, pulls: Sequence[FibrePull]) -> FollowerFibres:
        chains = [
            (points, tension, self._row_of(pull.profile))
            for pull in pulls
            for points, tension in zip(pull.points, pull.tension_N, strict=True)
        ]
        sizes = [len(points) for points, _, _ in chains]
        nodes, weights = self._carriers([points for points, _, _ in chains])
        return FollowerFibres(
            start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            nodes=nodes,
            weights=weights,
            position=np.concatenate([points.position for points, _, _ in chains] or [np.zeros((0, 3))]),
            # one entry a vertex; the last vertex of a fibre starts no segment
            tension=np.concatenate([np.append(t, 0.0) for _, t, _ in chains] or [np.zeros(0)]),
            profile=np.array([p for _, _, p in chains], dtype=np.int64),
        )

    def _row_of(self, profile: Profile) -> int:
        """Row of a profile in the activation table; equal profiles share one."""
        for row, known in enumerate(self._profiles):
            same = np.array_equal(known.time_s, profile.time_s) and np.array_equal(known.scale, profile.scale)
            if same and known.lag_s == profile.lag_s:
                return row
        self._profiles.append(profile)
        return len(self._profiles) - 1

    def _carriers(self, chains: Sequence[MaterialPoints]) -> tuple[np.ndarray, np.ndarray]:
        """Nodes (k, 8) in computing order and weights (k, 8) of all points; points fixed in space hang on the idle row."""
        element = np.concatenate([points.element for points in chains] or [np.zeros(0, dtype=np.int64)])
        natural = np.concatenate([points.natural for points in chains] or [np.zeros((0, 3))])
        in_space = element < 0
        nodes = self._place[self.model.mesh.hexes[np.where(in_space, 0, element)]]
        nodes[in_space] = self.model.mesh.node_count
        weights = shape_functions(natural)
        weights[in_space] = 0.0
        return np.ascontiguousarray(nodes), np.ascontiguousarray(weights)
