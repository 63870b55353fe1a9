"""Arrays for stability checks, and memory for samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from explicitfe.fem.elements import hex8
from explicitfe.fem.model.holders import Holder
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.look import FEWEST_STEPS_BETWEEN_SCANS, STEPS_THAT_CALL_FOR_ALL_TURNS
from explicitfe.fem.solve.stable_step import own_frequencies
from explicitfe.platform.compiled.arrays import (
    BONE_FORCE,
    BONE_SUMS,
    CEILING,
    ENERGIES,
    INTERVAL,
    LEDGER,
    LIMIT,
    LOWEST_LIMIT,
    SINCE,
    SPENT,
    WAIT,
    WATCH,
    Blocks,
    Detached,
    Holders,
    Looker,
    Looks,
    Nodes,
    Part,
    Samples,
    State,
    in_blocks,
    zeros,
)
from explicitfe.platform.compiled.simd import ROW, WIDTH
from explicitfe.platform.errors import InputError, nearest, shortened

TURNS_LATER = 12  # at most of the iteration that finds the limit, from what it came to last
SHAPE_NUMBERS = 7  # of each element: six of M, and its share of a node's mass


@dataclass(frozen=True)
class Snapshot:
    """What a sample shows, in the user's numbering.

    Attributes
    ----------
    model : what was simulated.
    time_s : s.
    displacement, velocity : (n, 3) m, m/s.
    J, hourglass_energy : (m,), (m,) J.
    stress : (m, 6) Pa. Mean Cauchy stress of each element, xx, yy, zz, xy, yz, xz; empty unless the simulation was asked for it.
    energies : (ENERGIES,) J: internal, hourglass, kinetic, external work, lost to damping, lost in the material, stored in
        contact, stored in ties, lost in contact, stored in the barrier against folding.
    smallest_J : the smallest J of any element in any step so far.
    contact_pressure : (bones, n) Pa. With which each bone presses on each node.
    contact : (bones, BONE_SUMS). Force of each bone on the body [N], area in contact [m^2], deepest node in it [m].
    reactions : name -> (3,) N. Force on the body of each set of held or prescribed nodes, support and bone; see ``holders_of``.
        A bone that ties the body and touches it has the sum of both.
    applied_force : (3,) N. Sum of all loads on the body: forces, weight, pull of strings, drag.
    surface_pressure : (n,) Pa. With which surfaces press on each other; empty where their contact is not modelled.
    """

    model: Model = field(repr=False)
    time_s: float
    displacement: np.ndarray
    velocity: np.ndarray
    J: np.ndarray
    hourglass_energy: np.ndarray
    stress: np.ndarray
    energies: np.ndarray
    smallest_J: float
    contact_pressure: np.ndarray
    contact: np.ndarray
    reactions: dict[str, np.ndarray]
    applied_force: np.ndarray
    surface_pressure: np.ndarray

    def probe(self, name: str) -> np.ndarray:
        """Displacement of a named point of the model, (3,) m.

        Raises
        ------
        InputError : the model has no such point.
        """
        if name not in self.model.probes:
            raise InputError(f'the model has no named point "{shortened(name)}"; {nearest(name, self.model.probes)}')
        return self.model.mesh.at(self.model.probes[name], self.displacement)[0]


class Recording:
    """Room for samples, and those that have been taken.

    Parameters
    ----------
    model : what is simulated.
    arrays : for ``room`` samples.
    holders : of the model.

    Attributes
    ----------
    count : samples taken.
    time_s, dt_s : (room,) s. When each was taken, and the step that led there.
    steps : (room,) steps done then.
    """

    def __init__(self, model: Model, arrays: Samples, holders: Sequence[Holder]) -> None:
        self.model = model
        self.holders = holders
        self.arrays = arrays
        self.room = len(arrays.displacement)
        self.clear()

    def clear(self) -> None:
        """Forget what was taken."""
        self.count = 0
        self.time_s, self.dt_s = np.empty(self.room), np.empty(self.room)
        self.steps = np.empty(self.room, dtype=np.int64)

    @property
    def energies(self) -> np.ndarray:
        """(count, ENERGIES) J. Of the samples taken."""
        return self.arrays.energies[: self.count]

    def at(self, instants: np.ndarray) -> Samples:
        """The arrays for the next samples, to be taken at instants (k,) counted from the present one."""
        some = slice(self.count, self.count + len(instants))
        a = self.arrays
        a.taken[0] = 0
        return a._replace(
            instant=instants,
            displacement=a.displacement[some],
            velocity=a.velocity[some],
            J=a.J[some],
            hourglass=a.hourglass[some],
            stress=a.stress[some],
            energies=a.energies[some],
            smallest_J=a.smallest_J[some],
            pressure=a.pressure[some],
            contact=a.contact[some],
            reaction=a.reaction[some],
            pressed=a.pressed[some],
            pairs=a.pairs[some],
        )

    def add(self, time_s: np.ndarray, dt_s: np.ndarray, steps: np.ndarray) -> None:
        """Note when the samples were taken that were asked for last: as many of them as were taken."""
        taken = int(self.arrays.taken[0])
        some = slice(self.count, self.count + taken)
        self.time_s[some], self.dt_s[some], self.steps[some] = time_s[:taken], dt_s[:taken], steps[:taken]
        self.count += taken

    def __getitem__(self, number: int) -> Snapshot:
        """A copy of a sample."""
        a = self.arrays
        reactions = dict(zip([holder.name for holder in self.holders], a.reaction[number].copy(), strict=False))
        for bone, sums in zip(self.model.bones, a.contact[number], strict=True):
            reactions[bone.name] = reactions.get(bone.name, 0.0) + sums[BONE_FORCE : BONE_FORCE + 3]
        return Snapshot(
            model=self.model,
            time_s=float(self.time_s[number]),
            displacement=a.displacement[number].copy(),
            velocity=a.velocity[number].copy(),
            J=a.J[number].copy(),
            hourglass_energy=a.hourglass[number].copy(),
            stress=a.stress[number].copy(),
            energies=a.energies[number].copy(),
            smallest_J=float(a.smallest_J[number]),
            contact_pressure=a.pressure[number].copy(),
            contact=a.contact[number].copy(),
            reactions=reactions,
            applied_force=a.reaction[number, -1].copy(),
            surface_pressure=a.pressed[number].copy(),
        )


def samples_of(
    room: int,
    nodes: np.ndarray,
    elements: np.ndarray,
    touching: np.ndarray,
    bodies: int,
    model: Model,
    state: State,
    holders: Sequence[Holder],
    detached: Detached,
) -> Samples:
    """Arrays for so many samples: rows of the nodes, lanes of the elements, nodes of the contact points, bodies in contact."""
    sets = [nodes[holder.nodes] for holder in holders if len(holder.nodes)]
    n, m, bones = len(nodes), len(elements), len(model.bones)
    return Samples(
        instant=np.zeros(0, dtype=np.int64),
        taken=np.zeros(1, dtype=np.int64),
        node=nodes,
        element=elements,
        touching=touching,
        holders=Holders(
            start=np.cumsum([0, *map(len, sets)]).astype(np.int64), node=np.concatenate([*sets, np.zeros(0, dtype=np.int64)])
        ),
        displacement=np.zeros((room, n, 3)),
        velocity=np.zeros((room, n, 3)),
        J=np.zeros((room, m)),
        hourglass=np.zeros((room, m)),
        detached=detached,
        stress=np.zeros((room, len(detached.corner), 6)),
        energies=np.zeros((room, ENERGIES)),
        smallest_J=np.zeros(room),
        pressure=np.zeros((room, bones, n)),
        contact=np.zeros((room, bones, BONE_SUMS)),
        reaction=np.zeros((room, len(holders) + 1, 3)),
        pressed=np.zeros((room, 0 if model.surfaces is None else n)),
        pairs=np.zeros((room, bodies, bodies)),
        rows=zeros((2, *state.u.shape)),
        point_pressure=np.zeros((bones, len(touching))),
        lanes=zeros((3, -(-m // WIDTH), WIDTH)),
        ledger=np.zeros(LEDGER),
    )


def looks_of(nodes: Nodes, parts: int) -> Looks:
    """Arrays for looks at the highest frequency of a mesh that so many threads share."""
    root = zeros(nodes.inverse_mass.shape)
    root[:] = np.sqrt(nodes.inverse_mass)
    # Fixed seeds: a run repeated is the same run.
    noise, vector = (_random_direction(root, seed) for seed in (20051, 20052))
    base, shifted, response = (zeros(root.shape) for _ in range(3))
    return Looks(
        root=root,
        noise=noise,
        vector=vector,
        base=base,
        shifted=shifted,
        response=response,
        bound=zeros((len(root), 3)),
        basis=zeros((TURNS_LATER + 1, *root.shape)),
        sums=zeros((parts, 8)),
        spent=np.zeros(SPENT, dtype=np.int64),
    )


def lookers_of(parts: Sequence[Part], whole: Blocks, state: State, looks: Looks) -> list[Looker]:
    """What each part looks with; its elements have no shape yet."""
    ends = np.cumsum([len(part.blocks.nodes) for part in parts])
    memories = np.split(whole.new, ends[:-1])
    forces = [zeros((len(part.u), ROW)) for part in parts]
    lookers = []
    for k, (part, memory) in enumerate(zip(parts, memories, strict=True)):
        rows = slice(part.first, part.first + len(part.u))
        blocks = part.blocks._replace(new=memory, effects=part.blocks.effects.copy(), length=np.zeros_like(part.blocks.length))
        before = forces[k - 1][part.first - parts[k - 1].first :] if k else looks.base[:0]
        shapes = zeros((len(part.blocks.nodes), SHAPE_NUMBERS, WIDTH))
        watch = np.zeros(WATCH)
        watch[[SINCE, WAIT, INTERVAL]] = STEPS_THAT_CALL_FOR_ALL_TURNS, FEWEST_STEPS_BETWEEN_SCANS, FEWEST_STEPS_BETWEEN_SCANS
        watch[[LIMIT, LOWEST_LIMIT, CEILING]] = np.inf
        others = shapes, state.v[rows], looks.shifted[rows], forces[k], before
        lookers.append(Looker(blocks, *others, np.zeros((4, TURNS_LATER)), watch))
    return lookers


def shape_numbers(
    minus_force: Callable[[np.ndarray, np.ndarray, Blocks], object], blocks: Blocks, corners: np.ndarray, density: np.ndarray
) -> np.ndarray:
    """``Looker.shapes`` of all elements, (B, 7, W).

    Parameters
    ----------
    minus_force, blocks : as for ``own_frequencies``, at rest.
    corners : (m, 8, 3) m. Reference positions.
    density : (m,) kg/m^3.
    """
    gradients, volumes = hex8.mean_gradients(corners)
    share = volumes * density / 8.0
    squares = own_frequencies(minus_force, blocks, gradients, share, np.cbrt(volumes)) ** 2
    M = gradients.transpose(0, 2, 1) @ gradients
    M *= (squares / np.trace(M, axis1=1, axis2=2))[:, None, None]
    numbers = np.stack([M[:, 0, 0], M[:, 1, 1], M[:, 2, 2], M[:, 0, 1], M[:, 0, 2], M[:, 1, 2], share], axis=1)
    lanes = in_blocks(numbers)
    idle = lanes.shape[0] * WIDTH - len(numbers)
    if idle:
        lanes[-1, :, WIDTH - idle :] = 0.0
    return lanes


def _random_direction(root: np.ndarray, seed: int) -> np.ndarray:
    """A unit vector at random in the components that can move."""
    vector = zeros(root.shape)
    vector[:] = np.random.default_rng(seed).standard_normal(root.shape) * (root > 0.0)
    # einsum, not BLAS, which would wake all cores for it, and wait for those that are busy
    vector /= max(np.sqrt(np.einsum("ij,ij->", vector, vector)), 1e-300)
    return vector
