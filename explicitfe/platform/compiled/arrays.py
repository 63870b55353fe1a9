"""Arrays that cross into compiled kernels: one named tuple a family, every field with its meaning, unit and shape.

n nodes, m elements, B = ceil(m / W) blocks of W = ``simd.WIDTH`` elements. Node arrays have N > n rows of 4 numbers
[x, y, z, 0]: four, so that a corner is one vector load; eight rows more, so that the empty lanes of the last block have an
element to compute, whose nodes have no mass and never move; an even number, so that whole vectors sweep over them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from explicitfe.platform.compiled.attached_arrays import Drag, PressedFaces, TurningLoads, Weights
from explicitfe.platform.compiled.contact_arrays import Bones, Surfaces
from explicitfe.platform.compiled.simd import ROW, WIDTH

# Entries of ``Blocks.corner``: the smallest volume ratio of a corner, relative to that at which the barrier begins, and the
# largest stiffness of the barrier over mass [1/s^2]; and what they are where it acts nowhere.
CORNER, STIFFEST, FALL = 0, 1, 2
NO_CORNER = (1.0, 0.0, 0.0)
BARRIER_WORK = 96  # vectors that the barrier works with


class State(NamedTuple):
    """What the loop advances from instant to instant."""

    u: np.ndarray  # displacement at t_n [m], (N, 4)
    v: np.ndarray  # velocity of the half step before, v_(n-1/2) [m/s], (N, 4)
    force: np.ndarray  # minus the internal force at u [N], (N, 4)


class Blocks(NamedTuple):
    """Elements in blocks of W: lane after lane, so that W elements are computed at once."""

    nodes: np.ndarray  # where the row of each node begins: ROW times its number, uint32, (B, 8, W)
    geometry: np.ndarray  # b [1/m], hX [m], volume [m^3] as in elements/hex8.py, (B, GEOMETRY, W); (B, 0, W) where it is derived
    constants: np.ndarray  # constants of the material law, (B, number of the law, W), or (1, ...) where they are the same in all
    hourglass: np.ndarray  # constants of the hourglass treatment, unless derived, or numbers of the Gauss points, (B, number, W)
    effects: np.ndarray  # numbers of the material's effects for the present time increment, (B, number, W)
    old: np.ndarray  # what the material remembers of the last accepted instant, (B, number, W)
    new: np.ndarray  # the same for the state that is evaluated; the array ``old`` itself where every state is accepted
    barrier: np.ndarray  # numbers of elements/barrier.py, (B, NUMBERS, W); (B, 0, W) without one
    muscle: np.ndarray  # which muscles pull in each block, int64, -1 after the last, (B, K, W)
    contraction: np.ndarray  # of each of them sigma [Pa] and a0 (3), (B, 4 K, W)
    activation: np.ndarray  # of the M muscles now, and 1 where the stress falls off in a shortened fibre, (M, 2)
    length: np.ndarray  # volume integral of sigma times that of phi over lambda, of the state evaluated last [J], (M, W)
    last_length: np.ndarray  # the same, summed, of the last accepted instant [J], (M,)
    suspect: np.ndarray  # blocks in which a corner may be folding: work array, int64, (B,)
    work: np.ndarray  # work array of the barrier for one block, (BARRIER_WORK, W)
    corner: np.ndarray  # CORNER and STIFFEST of the state evaluated last, and FALL of the corner over the last step, (3,)
    position: np.ndarray  # node rows: reference positions [m], (N, 4), of an element at rest on the idle rows

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> Blocks:
        """The same with all arrays of blocks changed: of some blocks or lanes only; sums begin anew."""
        alike = ("constants",) if len(self.constants) < len(self.nodes) else ()
        names = [name for name in self._fields[: self._fields.index("activation")] if name not in alike]
        changed = {name: change(getattr(self, name)) for name in names}
        count = len(changed["nodes"])
        sums = {"length": np.zeros_like(self.length), "last_length": np.zeros_like(self.last_length)}
        work = {"suspect": zeros((count,), np.int64), "work": zeros(self.work.shape), "corner": np.array(NO_CORNER)}
        return self._replace(**changed, **sums, **work)

    def between(self, first: int, last: int) -> Blocks:
        """The blocks from ``first`` to the one before ``last``."""
        return self.each(lambda array: array[first:last])


class Part(NamedTuple):
    """What one thread computes: a run of blocks, and the node rows from their lowest one to that of the next part.

    Rows further up, which the next part's elements have in common with these, get forces in both parts; the next part adds them.
    """

    number: int
    parts: int  # how many there are
    gate: np.ndarray  # where the threads meet, see compiled/threads.py
    first: int  # its first node row
    own: int  # how many rows it updates
    u: np.ndarray  # displacements of its rows and of those further up that its elements touch [m], a view
    force: np.ndarray  # minus the internal force of its elements at those rows [N]
    lower: np.ndarray  # the same of the part before, from this part's first row on; none in the first part
    blocks: Blocks  # with node numbers counted from ``first``
    loaded: np.ndarray  # whether external forces may act on each run of SWEEP_ROWS of its own rows, uint8, (runs,)


class Looks(NamedTuple):
    """What finds the highest frequency of the whole mesh; see solve/look.py. The first six are node rows, (N, 4)."""

    root: np.ndarray  # square root of the inverse mass [kg^-1/2]
    noise: np.ndarray  # a unit vector at random
    vector: np.ndarray  # the vibration of the highest frequency, as it was found last, times the root of the mass: a unit vector
    base: np.ndarray  # minus the internal force of the present state, with what bones do [N]
    shifted: np.ndarray  # a displacement near the present one [m], and
    response: np.ndarray  # minus the internal force there [N]: work arrays
    bound: np.ndarray  # bound of the square of the highest frequency at each node now, one step on, and the one that calls for a
    # look [1/s^2], (N, 3)
    basis: np.ndarray  # Lanczos vectors, (turns + 1, N, 4)
    sums: np.ndarray  # what each part adds to a sum over all rows, on a line of the cache of its own, (parts, 8)
    spent: np.ndarray  # ticks of the processor spent in all, in looks, and in samples, int64, (SPENT,)


class Looker(NamedTuple):
    """What the thread of a part looks with."""

    blocks: Blocks  # those of the part, to evaluate a state without accepting it, and without letting time pass
    shapes: np.ndarray  # six numbers M of each element and the mass [kg] that it gives to each node, (B, 7, W): its own highest
    # frequency has the square tr(cof F M cof F^T) [1/s^2]; M: 11, 22, 33, 12, 13, 23
    velocity: np.ndarray  # the rows of the state's velocity that the part's elements touch [m/s], a view
    shifted: np.ndarray  # the same rows of ``Looks.shifted`` [m], a view
    force: np.ndarray  # minus the internal force of its elements at those rows [N]
    lower: np.ndarray  # the same of the part before, from this part's first row on; none in the first part
    tridiagonal: np.ndarray  # diagonal, what stands beside it, and two work arrays, (4, turns)
    watch: np.ndarray  # (WATCH,): what the last look told, and when the next one is; the same in all parts


class Holders(NamedTuple):
    """Sets of held or prescribed nodes whose reaction forces are summed (compressed rows)."""

    start: np.ndarray  # first entry of each set and the end, int64, (sets + 1,)
    node: np.ndarray  # row of each entry, int64, (entries,)


class Detached(NamedTuple):
    """Elements with nodes of their own, in computing order: corner a of element e has row 8 e + a; empty where none are."""

    blocks: Blocks
    corner: np.ndarray  # row of each corner in the body, int64, (m, 8)
    u: np.ndarray  # displacements of the corners: work array [m], (N, 4)
    force: np.ndarray  # minus the internal forces on them: work array [N], (N, 4)
    volume: np.ndarray  # at rest [m^3], (m,)


class Samples(NamedTuple):
    """States of the body at some instants, in the user's numbering, and what it takes to gather them; k samples."""

    instant: np.ndarray  # of each sample, rising, int64, (k,)
    taken: np.ndarray  # how many of them have been taken, int64, (1,)
    node: np.ndarray  # row of each node, int64, (n,)
    element: np.ndarray  # lane of each element, int64, (m,)
    touching: np.ndarray  # each node of the contact faces, int64, (k,)
    holders: Holders
    detached: Detached
    displacement: np.ndarray  # [m], (k, n, 3)
    velocity: np.ndarray  # [m/s], (k, n, 3)
    J: np.ndarray  # (k, m)
    hourglass: np.ndarray  # hourglass energy [J], (k, m)
    stress: np.ndarray  # Cauchy stress xx, yy, zz, xy, yz, xz [Pa], (k, m, 6); (k, 0, 6) where it is not asked for
    energies: np.ndarray  # [J], (k, ENERGIES)
    smallest_J: np.ndarray  # of any element in any step so far, (k,)
    pressure: np.ndarray  # of each bone on each node [Pa], (k, bones, n)
    contact: np.ndarray  # what each bone does, (k, bones, BONE_SUMS)
    reaction: np.ndarray  # force of each holder on the body, and the sum of all loads on it [N], (k, sets + ties + 1, 3)
    pressed: np.ndarray  # pressure of surfaces on each other at each node [Pa], (k, n); (k, 0) without such contact
    pairs: np.ndarray  # deepest point of each pair of bodies since the sample before [m], (k, bodies, bodies)
    rows: np.ndarray  # velocity, and all forces but the external ones, of the present state: work arrays, (2, N, 4)
    point_pressure: np.ndarray  # on each node of the contact faces [Pa]: work array, (bones, k)
    lanes: np.ndarray  # J, strain energy and hourglass energy of each lane: work arrays, (3, B, W)
    ledger: np.ndarray  # that of all parts: work array, (LEDGER,)


class Nodes(NamedTuple):
    """Lumped masses; a component that is held has a mass and no inverse mass, so it never gets a velocity."""

    mass: np.ndarray  # [kg], (N, 4)
    inverse_mass: np.ndarray  # [1/kg], 0 where the component is held, (N, 4)
    update: np.ndarray  # what a step reads of both: the inverse masses, and the mass in the fourth column, (N, 4)


def nodes_of(mass: np.ndarray, inverse_mass: np.ndarray) -> Nodes:
    """Nodes with masses (N, 4) kg and their inverse (N, 4) 1/kg."""
    update = zeros(mass.shape)
    update[:, :3], update[:, 3] = inverse_mass[:, :3], mass[:, 0]
    return Nodes(mass, inverse_mass, update)


class DeadLoads(NamedTuple):
    """Nodal forces of fixed direction, in groups that share a time profile (compressed rows)."""

    start: np.ndarray  # first entry of each group and the end, int64, (groups + 1,)
    node: np.ndarray  # node of each entry, int64, (entries,)
    force: np.ndarray  # force at activation 1 [N], (entries, 3)
    profile: np.ndarray  # row of the activation table, int64, (groups,)


class FollowerFibres(NamedTuple):
    """Tense polylines of material points that turn with the deformation (compressed rows)."""

    start: np.ndarray  # first vertex of each fibre and the end, int64, (fibres + 1,)
    nodes: np.ndarray  # nodes that carry each vertex, int64, (vertices, 8)
    weights: np.ndarray  # shape functions of each vertex, (vertices, 8); all 0 for a point fixed in space
    position: np.ndarray  # reference position of each vertex [m], (vertices, 3)
    tension: np.ndarray  # tension of the segment that starts at each vertex, at activation 1 [N], (vertices,)
    profile: np.ndarray  # row of the activation table, int64, (fibres,)


class Motion(NamedTuple):
    """Nodes that follow a prescribed course; all three components."""

    node: np.ndarray  # int64, (k,)
    target: np.ndarray  # displacement at the instants t_n, t_(n+1), ... [m], (instants, k, 3)


class Turned(NamedTuple):
    """Rotational symmetry about the z axis: nodes whose displacement is that of a partner, turned."""

    node: np.ndarray  # int64, (k,)
    partner: np.ndarray  # int64, (k,)
    rotation: np.ndarray  # [cosine, sine] of the angle from partner to node, (2,)


class Contact(NamedTuple):
    """Points of the surface that a rigid tool of revolution about the z axis may touch."""

    node: np.ndarray  # nodes of the face that each point lies in, uint32, (k, 4)
    weight: np.ndarray  # their shape functions there, (k, 4)
    position: np.ndarray  # reference position [m], (k, 3)
    spring: np.ndarray  # contact stiffness of the area that the point stands for [N/m], (k,)
    area: np.ndarray  # that can stick to the tool [m^2], (k,)
    grip: np.ndarray  # tangential stiffness while it sticks [N/m], (k,)
    anchor: np.ndarray  # displacement relative to the tool at which friction has no force [m], (k, 3)
    shape: np.ndarray  # what the tool looks like, (SHAPE,)
    moved: np.ndarray  # displacement of each point as last looked at [m], (k, 3)


class Springs(NamedTuple):
    """Nodes that are held elastically where they are."""

    node: np.ndarray  # int64, (k,)
    stiffness: np.ndarray  # [N/m] along x, y, z, (k, 3)


class Ties(NamedTuple):
    """Patches of the surface that springs tie to bones, as a matrix between nodes (compressed rows), bone after bone."""

    node: np.ndarray  # row of each tied node, int64, (k,)
    bone: np.ndarray  # that ties it, int64, (k,)
    position: np.ndarray  # its reference position [m], (k, 3)
    start: np.ndarray  # first entry of each row of the matrix, and the end, int64, (k + 1,)
    column: np.ndarray  # tied node of each entry, a number among the k, int64, (entries,)
    stiffness: np.ndarray  # integral of stiffness times both shape functions over the patch [N/m], (entries,)
    row_sum: np.ndarray  # sum of the entries of each row [N/m], (k,)
    total: np.ndarray  # sum of the stiffness of each bone's entries [N/m], (bones,)
    normal: np.ndarray  # unit normal of each patch, (bones, 3)
    excess: np.ndarray  # stiffness along the normal over that along the patch, less 1, (bones,)
    bone_stiffness: np.ndarray  # of the springs that hold the bone itself [N/m], inf where it is fixed, (bones,)
    shift: np.ndarray  # how far each bone has given way: work array [m], (bones, 3)
    moved: np.ndarray  # displacement of each tied node relative to its bone: work array [m], (k, 3)
    moves: np.ndarray  # 1 where a bone moves by a given course, int64, (bones,)


class Actions(NamedTuple):
    """What acts on a body during a step, with its values at the instants t_0, t_1, ... of a course.

    A new force is a field here, and a line in ``forces/external.py`` that adds it.
    """

    dead: DeadLoads
    fibres: FollowerFibres
    turning: TurningLoads
    pressed: PressedFaces
    weights: Weights
    drag: Drag
    activation: np.ndarray  # scale of each load, (profiles, instants)
    muscles: np.ndarray  # activation of the muscles that pull by a stress along their fibres, (instants, M)
    bones: Bones
    bone_placement: np.ndarray  # (instants, bones, PLACEMENT)
    ties: Ties
    tie_placement: np.ndarray  # that of the bones that hold the ties, (instants, bones, PLACEMENT)
    surfaces: Surfaces
    motion: Motion
    planned: np.ndarray  # work array: next velocities of the nodes with prescribed motion [m/s], (k, 3)


class BoneRecord(NamedTuple):
    """What bones do at an instant; empty arrays where nobody asks."""

    sums: np.ndarray  # (bones, BONE_SUMS)
    pressure: np.ndarray  # on each node of the contact faces [Pa], (bones, k)


class Addresses(NamedTuple):
    """Where the machine code of functions begins that a course calls."""

    internal_force: int
    internal_energy: int
    gather: int
    scan: int
    highest_frequency: int


class Shared(NamedTuple):
    """What the parts of a body share."""

    blocks: Blocks  # of all elements
    nodes: Nodes
    external: np.ndarray  # work array for the external forces [N], (N, 4)
    alpha: float  # mass-proportional damping [1/s]
    unrecorded: BoneRecord  # empty
    addresses: Addresses


class Recurrence(NamedTuple):
    """How a velocity follows from the last one, v+ = keep v- + gain f / m, and the times for which both count in the work."""

    keep: float
    gain: float  # [s]
    ahead: float  # time of the velocity after the instant [s]
    behind: float  # time of the velocity before it [s]


class Span(NamedTuple):
    """Steps of a course, and how it looks at the stable step meanwhile."""

    dt_before: float  # step that led to the first instant [s]; it differs from dt where the step has just been changed
    dt: float  # [s]
    steps: int
    looking: int  # NO_LOOKS, AUTOMATIC_STEP, ... of solve/course.py
    turns: int  # most turns of a look
    length: float  # over which a look differences forces [m]
    contact_frequency: float  # of the contact stiffness that the limit leaves room for [1/s]


class Surface(NamedTuple):
    """What acts at the surface of a body that relaxes under a tool; each may be empty."""

    turned: Turned
    springs: Springs
    contact: Contact
    tool: np.ndarray  # its state, (TOOL,)


class Goal(NamedTuple):
    """When a relaxation has arrived."""

    tolerance: float  # unbalanced forces as a share of those of the tool and the loads
    least_load: float  # what the residual is compared to at least [N], where a load has all but gone
    least_work: float  # and the kinetic energy [J]


# Entries of the placement of a bone at an instant: rotation R by rows, shift s, spin [rad/s], speed of the origin [m/s]; a point
# X of the bone at rest is at R X + s.
ROTATION, SHIFT, SPIN, SPEED, PLACEMENT = 0, 9, 12, 15, 18

# Entries of what each bone does to the body at an instant: force on it [N], area in contact [m^2], deepest point [m].
BONE_FORCE, BONE_AREA, BONE_DEPTH, BONE_SUMS = 0, 3, 4, 5

# Entries of a tool's shape. It is a disc with a rounded edge; above the edge it has a vertical wall, or goes on as a ball.
# It may be tilted about the y axis [rad], and pull at what is near: a stress [Pa] that falls to nothing within a reach [m].
FLAT_RADIUS, EDGE_RADIUS, WALL, LOWEST, TIED, FRICTION, TILT, ADHESION, REACH, SHAPE = range(10)

# Entries of the tool's state: its way down [m], the force on it [N], and whether that force (1) or the way (0) is given; in
# the latter case the way that it goes to [m], how far in one iteration [m], and what the rig gives way by [m/N].
DEPTH, LOAD, FREE, GOAL, PACE, COMPLIANCE, DRIVE, TOOL = range(8)

# Entries of what a relaxation tells of itself.
RESIDUAL, KINETIC_RATIO, REST_J, STIFFNESS, POWER, MOMENT, LOADS, WORK, MONITOR = range(9)

# Entries of what each part adds to the sums of a relaxation, and its smallest J; a line of the cache more keeps parts apart.
SUM_J, PRESSED, UNBALANCED, PUSHED, DEAD_WORK, SUM_POWER, MOVED_POWER, MOVED_MOMENT = range(8)
SUMS = 16

# Entries of the ledger, float64: sums of work, then the smallest J and ``Blocks.corner`` so far.
EXTERNAL_WORK, DAMPING_LOSS, CONTACT_LOSS, SMALLEST_J, SMALLEST_CORNER, LEDGER = range(6)

# Entries of what looks tell: the stable limit of the step at the last one [s], steps since, steps to the next scan of the nodes,
# and between the last two; the smallest limit [s] within the steps that a period counts, and these; how stiff over mass the
# barrier against folding may become before the next look [1/s^2].
LIMIT, SINCE, WAIT, INTERVAL, LOWEST_LIMIT, PERIOD, CEILING, WATCH = range(8)

# Entries of the time that is spent in the course of a run.
IN_ALL, IN_LOOKS, IN_SAMPLES, SPENT = range(4)

# Entries of the energies that a snapshot gives [J].
INTERNAL, HOURGLASS, KINETIC, EXTERNAL, DAMPED, LOST, IN_CONTACT, IN_TIES, RUBBED, BARRIER, ENERGIES = range(11)


CACHE_LINE_BYTES = 64  # bytes of a line of the cache


def zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> np.ndarray:
    """An array of zeros that starts where a line of the cache starts: no vector of a kernel then lies across two of them."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.zeros(size + CACHE_LINE_BYTES, dtype=np.uint8)
    start = -memory.ctypes.data % CACHE_LINE_BYTES
    return memory[start : start + size].view(dtype).reshape(shape)


SWEEP_ROWS = 16  # node rows that are updated with external forces or without: eight lines of the cache
IDLE_ROWS = 8  # node rows after the last node: the corners of what the empty lanes of the last block compute


def node_rows(values: np.ndarray) -> np.ndarray:
    """(n, 3) values as (N, 4) node rows, zero in the padding; N is an even number, and at least IDLE_ROWS more than n."""
    count = len(values)
    rows = zeros((count + IDLE_ROWS + count % 2, ROW))
    rows[:count, :3] = values
    return rows


def in_blocks(values: np.ndarray) -> np.ndarray:
    """(m, k) element values as (B, k, W) blocks; lanes past the last element repeat it, so that they compute nothing odd."""
    count, width = values.shape
    full, left = divmod(count, WIDTH)
    blocks = zeros((full + (left > 0), width, WIDTH), values.dtype)
    blocks[:full] = values[: full * WIDTH].reshape(full, WIDTH, width).transpose(0, 2, 1)
    if left:
        blocks[full, :, :left] = values[full * WIDTH :].T
        blocks[full, :, left:] = values[-1, :, None]
    return blocks


def row_places(hexes: np.ndarray, node_count: int) -> np.ndarray:
    """Where the rows of the nodes (m, 8) of hexes begin, (B, 8, W) uint32; of so many nodes, with the idle rows after them.

    Lanes past the last element have the idle rows, which never move, so that their forces are zero.
    """
    idle = np.broadcast_to(node_count + np.arange(IDLE_ROWS), (-len(hexes) % WIDTH, IDLE_ROWS))
    return in_blocks((ROW * np.concatenate([hexes, idle])).astype(np.uint32))


def position_rows(points: np.ndarray, last_element: np.ndarray) -> np.ndarray:
    """Node rows of reference positions (n, 3) m; the idle rows have those of the corners (8, 3) of the last element."""
    rows = node_rows(points)
    rows[len(points) : len(points) + IDLE_ROWS, :3] = last_element
    return rows


def no_muscles(blocks: int) -> dict[str, np.ndarray]:
    """The arrays of ``Blocks`` for so many blocks in which no muscle pulls."""
    return {
        "muscle": zeros((blocks, 0, WIDTH), np.int64),
        "contraction": zeros((blocks, 0, WIDTH)),
        "activation": zeros((0, 2)),
        "length": zeros((0, WIDTH)),
        "last_length": zeros((0,)),
    }


def without_barrier(blocks: int) -> dict[str, np.ndarray]:
    """The arrays of ``Blocks`` for so many blocks of elements that no barrier keeps from folding."""
    return {
        "barrier": zeros((blocks, 0, WIDTH)),
        "suspect": zeros((blocks,), np.int64),
        "work": zeros((BARRIER_WORK, WIDTH)),
        "corner": np.array(NO_CORNER),
    }
