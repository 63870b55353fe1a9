"""The same step, written in C++, in NVIDIA Warp (on the CPU), in Taichi and in JAX, against ours, side by side in one run.

    python studies/benchmarks/peers.py [--sizes 1000 30000] [--without jax] [--json FILE] [--out DIR]

What is not installed is left out, with a line that says so: a C++ compiler (CXX, clang++ or g++), Warp, Taichi, JAX.

The problem is that of ``explicitfe bench``: a block of distorted 4 mm hexes, Yeoh tissue at Poisson's ratio 0.499, damping
40 1/s, random velocities, float64; hex8 and hex8-stiffness. All programs read the same numbers of each element, in the same
order. First the same answer: after 20 steps the displacements must agree to rounding. Then nanoseconds per element and step,
best of five rounds; in each round the programs take turns (ours, C++, Warp, Taichi, JAX, ours again), so a ratio is of one run.
Ours and C++ also keep the energy ledger and the smallest J, which must agree too; the others do not. External forces there are
none.

C++ (peer_cpp.cpp) is written by hand for these two elements, this law and one thread, with vectors as wide as ours: what the
machine gives to who writes for it alone. It does not look for corners that may be folding, as ours does in hex8.

One thread: the process is pinned to one core. Ours has one thread. Warp runs a kernel on the CPU as one loop over its threads.
Taichi gets one thread, and a kernel that is written out, operation by operation, from the leaves that JAX traces. JAX gets pools
of one thread. Times are of the CPU, not of the clock on the wall: equal on a quiet machine, and on a busy one what others take
does not count (that they crowd the caches does). Two threads of ours go by the clock on the wall.

The bound is the larger of two times: the arrays that a step must move, each once, at the bandwidth of a triad whose arrays
take as much room; and the operations that it must do (one each for + - * /, equal subexpressions once) at the peak of fused
multiply-adds, which counts two. Real code has other than paired operations and slower divisions: nobody reaches all of it.
"""

import argparse
import importlib.util
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from importlib.metadata import version
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any, ClassVar, Self

import numpy as np
import peer_cpp
from numba.core.dispatcher import Dispatcher

from explicitfe.app.tools.speed import TIMED_ELEMENTS as TREATMENTS
from explicitfe.app.tools.speed import TIMED_SIZES, problem
from explicitfe.fem.elements import hex8
from explicitfe.fem.forces import internal
from explicitfe.fem.materials import kinematics, law_of
from explicitfe.fem.solve.kernels import ELEMENTS
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled import simd
from explicitfe.platform.compiled.arrays import DAMPING_LOSS, SMALLEST_J
from explicitfe.platform.compiled.jit import kernel
from explicitfe.platform.compiled.simd import WIDTH, load, splat, store, sum_lanes

YEOH = law_of("yeoh")
PEERS = ("c++", "warp", "taichi", "jax")
PACKAGES = {"warp": "warp-lang", "taichi": "taichi", "jax": "jax"}
SAME_STEPS = 20
SAME = 1e-10  # of the largest displacement, and of the ledger
ROUNDS = 5
ROUND_S = 0.15  # about how long each program runs in a round
# No fusion of operations: with it XLA computes the element anew for each of its 24 corner forces, and compiles for minutes.
# This flag comes first: nothing is read after one that does not begin with dashes.
XLA_FLAGS = "--xla_disable_hlo_passes=fusion --xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


# ---- the law and the element once more as plain Python: JAX traces it, and operations are counted on it ----


def plain(function: Any, replaced: dict[str, Any]) -> FunctionType:
    """A leaf, and all leaves that it calls, as plain Python; ``replaced`` gives other values to some globals."""
    function = getattr(function, "py_func", function)
    names = dict(function.__globals__)
    for name in function.__code__.co_names:
        if name in replaced:
            names[name] = replaced[name]
        elif isinstance(names.get(name), Dispatcher):
            names[name] = plain(names[name], replaced)
        elif isinstance(names.get(name), ModuleType):  # a leaf called as module.leaf
            leaves = {key: leaf for key, leaf in vars(names[name]).items() if key in function.__code__.co_names}
            leaves |= {key: plain(leaf, replaced) for key, leaf in leaves.items() if isinstance(leaf, Dispatcher)}
            names[name] = SimpleNamespace(**leaves)
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)


def newton(guess: Callable) -> FunctionType:
    """value^(-1/3) by the Newton steps of compiled/simd.py, from a guess by ``guess``."""
    return plain(simd._inverse_cube_root(simd.vector), {"_cbrt_guess": guess})


def element_forces(treatment: ModuleType, cube_root: Callable) -> Callable:
    """Minus the corner forces (3 x 8) from corner displacements (3 x 8), as ``forces/internal.py`` composes them of leaves."""

    def part(leaf: Any) -> FunctionType:
        return plain(leaf, {"inverse_cube_root": cube_root})

    to_modes, deformation, minus_forces = part(hex8.to_modes), part(internal.kinematics), part(hex8.minus_corner_forces)
    cofactor, determinant = part(kinematics.cofactor), part(kinematics.determinant)
    stress, slope = part(YEOH.stress), part(YEOH.delta_slope)
    added, held = part(treatment.invariant), part(treatment.force)

    def forces(corners: Sequence, g: Sequence, c: Sequence, h: Sequence) -> tuple:
        F, qx, qy, qz = deformation(tuple(to_modes(values) for values in corners), g)
        cof = cofactor(F)
        J = determinant(F, cof)
        delta = added(F, qx, qy, qz, h)
        P = stress(F, cof, J, delta, c)
        v = g[hex8.VOLUME]
        *r, Q = held(F, qx, qy, qz, h, v * slope(F, cof, J, delta, c))
        S = tuple(v * p + q for p, q in zip(P, Q, strict=True))
        return tuple(minus_forces(S[3 * i], S[3 * i + 1], S[3 * i + 2], r[i], g) for i in range(3))

    return forces


def update(keep: float, gain: float, dt_s: float, inverse_mass: Any, u: Any, v: Any, force: Any) -> tuple[Any, Any]:
    """Displacement and velocity of the next instant, as in ``loop.advance``."""
    v = keep * v + gain * inverse_mass * force
    return u + dt_s * v, v


class Counted:
    """A number that remembers the operations which made it, so that + - * / can be counted, equal expressions once."""

    known: ClassVar[dict[tuple, Self]] = {}

    def __init__(self, sign: str = "", *made_of: Any) -> None:
        self.sign, self.made_of = sign, made_of

    @classmethod
    def of(cls, sign: str, *made_of: Any) -> Self:
        """The number with this operation and operands. ``known`` keeps the operands alive, so that no id is used twice."""
        parts = [value if isinstance(value, float) else id(value) for value in made_of]
        key = (sign, *(sorted(parts) if sign in ("+", "*") else parts))
        return cls.known.setdefault(key, cls(sign, *made_of))

    @classmethod
    def lines(cls, results: Sequence[Self], names: dict[Self, str]) -> list[str]:
        """Statements of Python that compute the results, one an operation, and give each its name in ``names``."""
        waiting, lines = list(reversed(results)), []
        while waiting:
            number = waiting[-1]
            missing = [part for part in number.made_of if isinstance(part, Counted) and part not in names]
            if missing:
                waiting += missing
                continue
            waiting.pop()
            if number in names:
                continue
            a, *b = (names[part] if isinstance(part, Counted) else repr(part) for part in number.made_of)
            names[number] = f"t{len(names)}"
            value = f"{a} {number.sign} {b[0]}" if b else f"{ {'sign': '-', 'guess': 'guess'}[number.sign] }({a})"
            lines.append(f"{names[number]} = {value}")
        return lines

    @classmethod
    def flops(cls, results: Iterable[Self]) -> int:
        """Operations that the results need. A change of sign is free, as it becomes part of the next sum."""
        waiting, seen = list(results), {}
        while waiting:
            number = waiting.pop()
            if isinstance(number, Counted) and id(number) not in seen:
                seen[id(number)] = number
                waiting += number.made_of
        return sum(number.sign in ("+", "-", "*", "/") for number in seen.values())

    def __add__(self, other: Any) -> Self:
        return Counted.of("+", self, other)

    def __sub__(self, other: Any) -> Self:
        return Counted.of("-", self, other)

    def __rsub__(self, other: Any) -> Self:
        return Counted.of("-", other, self)

    def __mul__(self, other: Any) -> Self:
        return Counted.of("*", self, other)

    def __truediv__(self, other: Any) -> Self:
        return Counted.of("/", self, other)

    def __rtruediv__(self, other: Any) -> Self:
        return Counted.of("/", other, self)

    def __neg__(self) -> Self:
        return Counted.of("sign", self)

    __radd__, __rmul__ = __add__, __mul__


def flops(simulation: Simulation) -> float:
    """Operations an element and step: forces, their sums at the nodes, and the update of the nodes' share."""
    treatment = ELEMENTS[simulation.model.element][1]

    def numbers(count: int) -> list[Counted]:
        return [Counted() for _ in range(count)]

    root = newton(lambda value: Counted.of("guess", value))  # from the bits, by integers
    corners = [numbers(8) for _ in range(3)]
    constants = [numbers(count) for count in (hex8.GEOMETRY, YEOH.count, internal.hourglass_constants(treatment))]
    rows = element_forces(treatment, root)(corners, *constants)
    element = Counted.flops([Counted() + value for row in rows for value in row])
    node = Counted.flops([value for _ in range(3) for value in update(*numbers(7))])
    return element + node * simulation.model.mesh.node_count / simulation.model.mesh.element_count


def bytes_moved(simulation: Simulation) -> float:
    """Bytes an element and step: element arrays, reference positions and masses read once; u, v and force read and written."""
    read = read_arrays(simulation)
    return (sum(a.nbytes for a in read) + 2 * sum(a.nbytes for a in simulation.state)) / simulation.model.mesh.element_count


def read_arrays(simulation: Simulation) -> list[np.ndarray]:
    """What a step without external forces reads only: positions, where the geometry of elements is derived from them."""
    blocks = simulation.blocks
    derived = [] if blocks.geometry.size else [blocks.position]
    reach = blocks.barrier[:, :1]  # what every block is tested by; the other numbers are read where a corner may be folding
    return [blocks.nodes, blocks.geometry, blocks.constants, blocks.hourglass, reach, simulation.nodes.update, *derived]


def working_set_bytes(simulation: Simulation) -> int:
    """Bytes of all arrays of a step."""
    return sum(a.nbytes for a in (*read_arrays(simulation), *simulation.state))


# ---- the programs: each starts from the same State, after the half-step start ----


class Ours:
    """The compiled loop of the package."""

    def __init__(self, simulation: Simulation, dt_s: float) -> None:
        self.simulation, self.dt_s = simulation, dt_s
        self.begin = [array.copy() for array in simulation.state]
        self.reset()

    def reset(self) -> None:
        for array, begin in zip(self.simulation.state, self.begin, strict=True):
            array[:] = begin
        self.loss_J = float(self.simulation.ledger[DAMPING_LOSS])
        self.simulation._ledgers[:, SMALLEST_J] = np.inf

    def run(self, steps: int) -> None:
        self.simulation.advance(steps, self.dt_s)

    def displacement(self) -> np.ndarray:
        return self.simulation.state.u[:, :3]

    def ledger(self) -> tuple[float, float]:
        """Loss to damping since the start [J], and the smallest J."""
        return float(self.simulation.ledger[DAMPING_LOSS]) - self.loss_J, float(self.simulation.ledger[SMALLEST_J])


def coefficients(simulation: Simulation, dt_s: float) -> tuple[float, float, float]:
    """What an update needs: keep, gain [s], dt [s]."""
    half = 0.5 * simulation.model.alpha_per_s * dt_s
    return (1.0 - half) / (1.0 + half), dt_s / (1.0 + half), dt_s


def element_numbers(simulation: Simulation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Geometry, constants of the law and those of the hourglass treatment of each element, (m, k)."""
    corners = simulation.points[simulation.hexes]
    geometry = hex8.geometry(corners)
    return geometry, simulation.constants, ELEMENTS[simulation.model.element][1].constants(corners, geometry)


class InJax:
    """Arrays over all elements, one a number of the element; all steps in one compiled loop."""

    def __init__(self, simulation: Simulation, dt_s: float) -> None:
        os.environ["XLA_FLAGS"] = XLA_FLAGS
        os.environ.setdefault("JAX_PLATFORMS", "cpu")
        import jax
        import jax.numpy as jnp

        jax.config.update("jax_enable_x64", True)
        self._constant = (
            [jnp.asarray(np.ascontiguousarray(values.T)) for values in element_numbers(simulation)],
            jnp.asarray(np.ascontiguousarray(simulation.hexes.T).astype(np.int32)),
            jnp.asarray(simulation.nodes.inverse_mass[:, 0]),
        )
        self._start = tuple(jnp.asarray(np.ascontiguousarray(array[:, :3].T)) for array in simulation.state)

        def guess(value):
            high = jax.lax.bitcast_convert_type(value, jnp.int64) >> 32
            return jax.lax.bitcast_convert_type((0x553EF000 - high // 3) << 32, jnp.float64)

        factors = coefficients(simulation, dt_s)
        forces = element_forces(ELEMENTS[simulation.model.element][1], newton(guess))

        @jax.jit
        def advance(state, steps, constant):
            (g, c, h), nodes, inverse_mass = constant

            def step(_, state):
                u, v = update(*factors, inverse_mass, *state)
                corners = [[component[nodes[a]] for a in range(8)] for component in u]
                rows = [jnp.zeros_like(inverse_mass).at[nodes].add(jnp.stack(values)) for values in forces(corners, g, c, h)]
                return u, v, jnp.stack(rows)

            return jax.lax.fori_loop(0, steps, step, state)

        self._advance = advance
        self.reset()

    def reset(self) -> None:
        self._state = self._start

    def run(self, steps: int) -> None:
        self._state = self._advance(self._state, steps, self._constant)
        self._state[0].block_until_ready()

    def displacement(self) -> np.ndarray:
        return np.asarray(self._state[0]).T


TAICHI_SOURCE = """
import taichi as ti

@ti.func
def guess(value):
    high = ti.bit_cast(value, ti.i64) >> 32
    return ti.bit_cast((ti.cast(0x553EF000, ti.i64) - high // 3) << 32, ti.f64)

@ti.kernel
def step(keep: ti.f64, gain: ti.f64, dt: ti.f64, inverse_mass: ti.types.ndarray(), u: ti.types.ndarray(), v: ti.types.ndarray(),
         force: ti.types.ndarray(), nodes: ti.types.ndarray(), numbers: ti.types.ndarray()):
    for n in range(u.shape[0]):
        for k in range(3):
            new = keep * v[n, k] + gain * inverse_mass[n] * force[n, k]
            v[n, k] = new
            u[n, k] += dt * new
            force[n, k] = 0.0
    for e in range(nodes.shape[0]):
        {element}
"""


class InTaichi:
    """One kernel a step: a loop over the nodes and one over the elements, whose operations are written out."""

    def __init__(self, simulation: Simulation, dt_s: float) -> None:
        import taichi as ti

        ti.init(arch=ti.cpu, default_fp=ti.f64, cpu_max_num_threads=1, log_level=ti.ERROR)
        tables = element_numbers(simulation)
        treatment = ELEMENTS[simulation.model.element][1]
        corners = [[Counted() for _ in range(8)] for _ in range(3)]
        constants = [[Counted() for _ in range(table.shape[1])] for table in tables]
        names = {corners[k][a]: f"u[nodes[e, {a}], {k}]" for k in range(3) for a in range(8)}
        names |= {number: f"numbers[e, {k}]" for k, number in enumerate(number for some in constants for number in some)}
        read = [f"x{k} = {text}" for k, text in enumerate(names.values())]
        names = {number: f"x{k}" for k, number in enumerate(names)}
        rows = element_forces(treatment, newton(lambda value: Counted.of("guess", value)))(corners, *constants)
        computed = Counted.lines([value for row in rows for value in row], names)
        added = [f"ti.atomic_add(force[nodes[e, {a}], {k}], {names[rows[k][a]]})" for k in range(3) for a in range(8)]
        source = TAICHI_SOURCE.format(element="\n        ".join([*read, *computed, *added]))
        with tempfile.TemporaryDirectory() as folder:  # Taichi reads the source of its kernels from a file
            path = Path(folder) / "taichi_step.py"
            path.write_text(source)
            spec = importlib.util.spec_from_file_location("taichi_step", path)
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            self._start = [np.ascontiguousarray(rows[:, :3]) for rows in simulation.state]
            self._state = [ti.ndarray(ti.f64, rows.shape) for rows in self._start]
            given = [np.ascontiguousarray(simulation.nodes.inverse_mass[:, 0])]
            after = [simulation.hexes.astype(np.int32), np.concatenate(tables, axis=1)]
            before, others = ([self._array(ti, values) for values in some] for some in (given, after))
            factors = coefficients(simulation, dt_s)
            self._step = lambda: module.step(*factors, *before, *self._state, *others)
            self._wait = ti.sync
            self.reset()
            self._step()
        self.reset()

    @staticmethod
    def _array(ti: ModuleType, values: np.ndarray) -> Any:
        array = ti.ndarray(ti.i32 if values.dtype == np.int32 else ti.f64, values.shape)
        array.from_numpy(values)
        return array

    def reset(self) -> None:
        for rows, start in zip(self._state, self._start, strict=True):
            rows.from_numpy(start)

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self._step()
        self._wait()

    def displacement(self) -> np.ndarray:
        return self._state[0].to_numpy()


class InWarp:
    """One kernel with a thread for each element, one with a thread for each node; a step is a recorded graph where Warp can."""

    def __init__(self, simulation: Simulation, dt_s: float) -> None:
        import warp as wp

        wp.config.log_level = wp.LOG_ERROR
        wp.config.enable_backward = False
        wp.init()
        count = simulation.model.mesh.element_count
        g, law, hourglass = element_numbers(simulation)
        array = lambda values, dtype: wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")  # noqa: E731
        self._start = [array(rows[:, :3], wp.vec3d) for rows in simulation.state]
        self._state = [wp.clone(rows) for rows in self._start]
        u, v, force = self._state
        elements = [
            array(simulation.hexes.astype(np.int32), wp.int32),
            array(g[:, :18].reshape(-1, 6, 3), wp.vec3d),
            array(g[:, 18 : hex8.VOLUME].reshape(-1, 4, 3), wp.vec3d),
            array(g[:, hex8.VOLUME], wp.float64),
            array(law[:, [0, 1, 3]], wp.vec3d),  # C10, C20 and K: C30 is zero
            array(hourglass, wp.float64),
        ]
        update_nodes, add_forces = warp_kernels(wp, simulation.model.element)
        factors = [wp.float64(value) for value in coefficients(simulation, dt_s)]
        mass = array(simulation.nodes.inverse_mass[:, 0], wp.float64)
        self._wp = wp

        def step() -> None:
            wp.launch(update_nodes, dim=len(u), inputs=[*factors, mass, u, v, force], device="cpu")
            wp.launch(add_forces, dim=count, inputs=[*elements, u, force], device="cpu")

        step()  # compiles
        self._step = step
        try:
            with wp.ScopedCapture(device="cpu") as capture:
                step()
            graph = capture.graph
            self._step = lambda: wp.capture_launch(graph)
        except RuntimeError:
            print("This Warp records no graphs on the CPU: its kernels are launched one by one.", file=sys.stderr)
        self.reset()

    def reset(self) -> None:
        for rows, start in zip(self._state, self._start, strict=True):
            self._wp.copy(rows, start)

    def run(self, steps: int) -> None:
        for _ in range(steps):
            self._step()

    def displacement(self) -> np.ndarray:
        return self._state[0].numpy()


def warp_kernels(wp: ModuleType, element: str) -> tuple[Any, Any]:
    """The update of a node and the forces of an element: the law and the element once more, in columns of F.

    Warp reads the annotations: this file does without their postponed evaluation, which would look for them in vain.
    """
    vec3, f64 = wp.vec3d, wp.float64
    modes_array, numbers_array, nodes_array = wp.array2d(dtype=vec3), wp.array2d(dtype=f64), wp.array2d(dtype=wp.int32)
    scalars, vectors = wp.array(dtype=f64), wp.array(dtype=vec3)

    @wp.func
    def plain_invariant(F0: vec3, F1: vec3, F2: vec3, q0: vec3, q1: vec3, q2: vec3, q3: vec3, h: numbers_array, e: int):
        return h[e, 0] * (wp.dot(q0, q0) + wp.dot(q1, q1) + wp.dot(q2, q2) + wp.dot(q3, q3))

    @wp.func
    def plain_force(F0: vec3, F1: vec3, F2: vec3, q0: vec3, q1: vec3, q2: vec3, q3: vec3, h: numbers_array, e: int, weight: f64):
        k = f64(2.0) * h[e, 0] * weight
        none = vec3(f64(0.0), f64(0.0), f64(0.0))
        return k * q0, k * q1, k * q2, k * q3, none, none, none

    @wp.func
    def carried(F0: vec3, F1: vec3, F2: vec3, h: numbers_array, e: int, i: int):
        return h[e, 3 * i] * F0 + h[e, 3 * i + 1] * F1 + h[e, 3 * i + 2] * F2

    @wp.func
    def strain_invariant(F0: vec3, F1: vec3, F2: vec3, q0: vec3, q1: vec3, q2: vec3, q3: vec3, h: numbers_array, e: int):
        a1, a2, a3 = carried(F0, F1, F2, h, e, 0), carried(F0, F1, F2, h, e, 1), carried(F0, F1, F2, h, e, 2)
        w1, w2, w3 = f64(1.0) / wp.dot(a1, a1), f64(1.0) / wp.dot(a2, a2), f64(1.0) / wp.dot(a3, a3)
        A1, B1 = w2 * wp.dot(q2, a2), w3 * wp.dot(q1, a3)
        A2, B2 = w1 * wp.dot(q2, a1), w3 * wp.dot(q0, a3)
        A3, B3 = w1 * wp.dot(q1, a1), w2 * wp.dot(q0, a2)
        t1, t2, t3 = wp.dot(q0, a1), wp.dot(q1, a2), wp.dot(q2, a3)
        f1, f2, f3 = w1 * wp.dot(q3, a1), w2 * wp.dot(q3, a2), w3 * wp.dot(q3, a3)
        bent = A1 * A1 + B1 * B1 + A1 * B1 + A2 * A2 + B2 * B2 + A2 * B2 + A3 * A3 + B3 * B3 + A3 * B3
        twisted = (t1 + t2) * (t1 + t2) * w1 * w2 + (t1 + t3) * (t1 + t3) * w1 * w3 + (t2 + t3) * (t2 + t3) * w2 * w3
        return (f64(2.0) * bent + f64(0.5) * (twisted + f1 * f1 + f2 * f2 + f3 * f3)) / f64(96.0)

    @wp.func
    def strain_force(F0: vec3, F1: vec3, F2: vec3, q0: vec3, q1: vec3, q2: vec3, q3: vec3, h: numbers_array, e: int, weight: f64):
        a1, a2, a3 = carried(F0, F1, F2, h, e, 0), carried(F0, F1, F2, h, e, 1), carried(F0, F1, F2, h, e, 2)
        w1, w2, w3 = f64(1.0) / wp.dot(a1, a1), f64(1.0) / wp.dot(a2, a2), f64(1.0) / wp.dot(a3, a3)
        A1, B1 = w2 * wp.dot(q2, a2), w3 * wp.dot(q1, a3)
        A2, B2 = w1 * wp.dot(q2, a1), w3 * wp.dot(q0, a3)
        A3, B3 = w1 * wp.dot(q1, a1), w2 * wp.dot(q0, a2)
        t1, t2, t3 = wp.dot(q0, a1), wp.dot(q1, a2), wp.dot(q2, a3)
        s12, s13, s23 = t1 + t2, t1 + t3, t2 + t3
        f1, f2, f3 = w1 * wp.dot(q3, a1), w2 * wp.dot(q3, a2), w3 * wp.dot(q3, a3)
        m = weight / f64(96.0)
        x1, y1 = m * (f64(4.0) * A1 + f64(2.0) * B1), m * (f64(4.0) * B1 + f64(2.0) * A1)
        x2, y2 = m * (f64(4.0) * A2 + f64(2.0) * B2), m * (f64(4.0) * B2 + f64(2.0) * A2)
        x3, y3 = m * (f64(4.0) * A3 + f64(2.0) * B3), m * (f64(4.0) * B3 + f64(2.0) * A3)
        u12, u13, u23 = m * w1 * w2 * s12, m * w1 * w3 * s13, m * w2 * w3 * s23
        l1 = -w1 * (f64(2.0) * (x3 * A3 + x2 * A2 + m * f1 * f1) + u12 * s12 + u13 * s13)
        l2 = -w2 * (f64(2.0) * (y3 * B3 + x1 * A1 + m * f2 * f2) + u12 * s12 + u23 * s23)
        l3 = -w3 * (f64(2.0) * (y2 * B2 + y1 * B1 + m * f3 * f3) + u13 * s13 + u23 * s23)
        r0 = (u12 + u13) * a1 + y3 * w2 * a2 + y2 * w3 * a3
        r1 = x3 * w1 * a1 + (u12 + u23) * a2 + y1 * w3 * a3
        r2 = x2 * w1 * a1 + x1 * w2 * a2 + (u13 + u23) * a3
        r3 = m * w1 * f1 * a1 + m * w2 * f2 * a2 + m * w3 * f3 * a3
        b1 = (u12 + u13) * q0 + x3 * w1 * q1 + x2 * w1 * q2 + m * w1 * f1 * q3 + l1 * a1
        b2 = y3 * w2 * q0 + (u12 + u23) * q1 + x1 * w2 * q2 + m * w2 * f2 * q3 + l2 * a2
        b3 = y2 * w3 * q0 + y1 * w3 * q1 + (u13 + u23) * q2 + m * w3 * f3 * q3 + l3 * a3
        Q0 = h[e, 0] * b1 + h[e, 3] * b2 + h[e, 6] * b3
        Q1 = h[e, 1] * b1 + h[e, 4] * b2 + h[e, 7] * b3
        Q2 = h[e, 2] * b1 + h[e, 5] * b2 + h[e, 8] * b3
        return r0, r1, r2, r3, Q0, Q1, Q2

    assumed = element == "hex8"
    hourglass_invariant = strain_invariant if assumed else plain_invariant
    hourglass_force = strain_force if assumed else plain_force

    @wp.kernel(enable_backward=False, module="unique")
    def update_nodes(keep: f64, gain: f64, dt: f64, inverse_mass: scalars, u: vectors, v: vectors, force: vectors):
        n = wp.tid()
        new = keep * v[n] + gain * inverse_mass[n] * force[n]
        v[n] = new
        u[n] = u[n] + dt * new
        force[n] = vec3(f64(0.0), f64(0.0), f64(0.0))

    @wp.kernel(enable_backward=False, module="unique")
    def add_forces(
        nodes: nodes_array,
        b: modes_array,
        hX: modes_array,
        volume: scalars,
        law: vectors,
        h: numbers_array,
        u: vectors,
        force: vectors,
    ):
        e = wp.tid()
        u0, u1, u2, u3 = u[nodes[e, 0]], u[nodes[e, 1]], u[nodes[e, 2]], u[nodes[e, 3]]
        u4, u5, u6, u7 = u[nodes[e, 4]], u[nodes[e, 5]], u[nodes[e, 6]], u[nodes[e, 7]]
        s01, d01, s32, d32 = u1 + u0, u1 - u0, u2 + u3, u2 - u3
        s45, d45, s76, d76 = u5 + u4, u5 - u4, u6 + u7, u6 - u7
        s_low, e_low, d_low, de_low = s32 + s01, s32 - s01, d32 + d01, d32 - d01
        s_top, e_top, d_top, de_top = s76 + s45, s76 - s45, d76 + d45, d76 - d45
        m0, m1, m2, m3 = d_top + d_low, e_top + e_low, s_top - s_low, e_top - e_low
        m4, m5, m6 = d_top - d_low, de_top + de_low, de_top - de_low
        b0, b1, b2, b3, b4, b5 = b[e, 0], b[e, 1], b[e, 2], b[e, 3], b[e, 4], b[e, 5]
        h0, h1, h2, h3 = hX[e, 0], hX[e, 1], hX[e, 2], hX[e, 3]

        G0 = b0[0] * m0 + b1[0] * m1 + b2[0] * m2 + b3[0] * m3 + b4[0] * m4 + b5[0] * m5
        G1 = b0[1] * m0 + b1[1] * m1 + b2[1] * m2 + b3[1] * m3 + b4[1] * m4 + b5[1] * m5
        G2 = b0[2] * m0 + b1[2] * m1 + b2[2] * m2 + b3[2] * m3 + b4[2] * m4 + b5[2] * m5
        q0 = m3 - h0[0] * G0 - h0[1] * G1 - h0[2] * G2
        q1 = m4 - h1[0] * G0 - h1[1] * G1 - h1[2] * G2
        q2 = m5 - h2[0] * G0 - h2[1] * G1 - h2[2] * G2
        q3 = m6 - h3[0] * G0 - h3[1] * G1 - h3[2] * G2
        F0 = G0 + vec3(f64(1.0), f64(0.0), f64(0.0))
        F1 = G1 + vec3(f64(0.0), f64(1.0), f64(0.0))
        F2 = G2 + vec3(f64(0.0), f64(0.0), f64(1.0))

        C0, C1, C2 = wp.cross(F1, F2), wp.cross(F2, F0), wp.cross(F0, F1)  # columns of the cofactor
        J = wp.dot(F0, C0)
        root = f64(1.0) / wp.cbrt(J)
        square = root * root
        c = law[e]
        I1 = square * (wp.dot(F0, F0) + wp.dot(F1, F1) + wp.dot(F2, F2))
        delta = hourglass_invariant(F0, F1, F2, q0, q1, q2, q3, h, e)
        slope = c[0] + f64(2.0) * c[1] * (I1 + delta - f64(3.0))
        v = volume[e]
        on_F = v * f64(2.0) * slope * square
        on_C = v * (f64(0.5) * c[2] * (J - f64(1.0) / J) - f64(2.0) / f64(3.0) * slope * I1 / J)
        r0, r1, r2, r3, Q0, Q1, Q2 = hourglass_force(F0, F1, F2, q0, q1, q2, q3, h, e, v * slope)

        S0 = on_F * F0 + on_C * C0 + Q0 - (h0[0] * r0 + h1[0] * r1 + h2[0] * r2 + h3[0] * r3)
        S1 = on_F * F1 + on_C * C1 + Q1 - (h0[1] * r0 + h1[1] * r1 + h2[1] * r2 + h3[1] * r3)
        S2 = on_F * F2 + on_C * C2 + Q2 - (h0[2] * r0 + h1[2] * r1 + h2[2] * r2 + h3[2] * r3)
        xi = b0[0] * S0 + b0[1] * S1 + b0[2] * S2
        eta = b1[0] * S0 + b1[1] * S1 + b1[2] * S2
        zeta = b2[0] * S0 + b2[1] * S1 + b2[2] * S2
        ez = b3[0] * S0 + b3[1] * S1 + b3[2] * S2 + r0
        zx = b4[0] * S0 + b4[1] * S1 + b4[2] * S2 + r1
        xe = b5[0] * S0 + b5[1] * S1 + b5[2] * S2 + r2
        xez = r3

        xi_low, xi_top, eta_low, eta_top = xi - zx, xi + zx, eta - ez, eta + ez
        p_low, m_low, p_top, m_top = xi_low + eta_low, xi_low - eta_low, xi_top + eta_top, xi_top - eta_top
        a_low, b_low = xe - xez - zeta, xe - xez + zeta
        a_top, b_top = xe + xez + zeta, xe + xez - zeta
        wp.atomic_add(force, nodes[e, 0], p_low - a_low)
        wp.atomic_add(force, nodes[e, 1], b_low - m_low)
        wp.atomic_add(force, nodes[e, 2], -a_low - p_low)
        wp.atomic_add(force, nodes[e, 3], m_low + b_low)
        wp.atomic_add(force, nodes[e, 4], p_top - a_top)
        wp.atomic_add(force, nodes[e, 5], b_top - m_top)
        wp.atomic_add(force, nodes[e, 6], -a_top - p_top)
        wp.atomic_add(force, nodes[e, 7], m_top + b_top)

    return update_nodes, add_forces


PROGRAMS: dict[str, Callable] = {"explicitfe": Ours, "c++": peer_cpp.InCpp, "warp": InWarp, "taichi": InTaichi, "jax": InJax}


# ---- what the machine can do ----


@kernel
def triad(a, b, c, passes):
    """a <- a + b c. The array that is written has been read before, so that the write fetches no further line of the cache."""
    for _ in range(passes):
        for at in range(0, a.size, WIDTH):
            store(a, at, load(a, at) + load(b, at) * load(c, at))


@kernel
def multiply_adds(x, y, count):
    """Ten chains of fused multiply-adds: more than the four steps of latency times two units, fewer than 16 registers."""
    vx, vy = splat(x), splat(y)
    a0, a1, a2, a3, a4 = splat(0.0), splat(0.1), splat(0.2), splat(0.3), splat(0.4)
    a5, a6, a7, a8, a9 = splat(0.5), splat(0.6), splat(0.7), splat(0.8), splat(0.9)
    for _ in range(count):
        a0, a1, a2, a3, a4 = a0 * vx + vy, a1 * vx + vy, a2 * vx + vy, a3 * vx + vy, a4 * vx + vy
        a5, a6, a7, a8, a9 = a5 * vx + vy, a6 * vx + vy, a7 * vx + vy, a8 * vx + vy, a9 * vx + vy
    return sum_lanes(a0 + a1 + a2 + a3 + a4 + a5 + a6 + a7 + a8 + a9)


def seconds(work: Callable[[], Any], clock: Callable[[], float] = time.process_time) -> float:
    begin = clock()
    work()
    return clock() - begin


def bandwidth_GB_s(room_bytes: float) -> float:
    """Bytes per time that a triad reads and writes; its three arrays have this size together."""
    entries = max(int(room_bytes / 24) // WIDTH, 1) * WIDTH
    a, b, c = np.zeros(entries), np.ones(entries), np.full(entries, 1e-3)
    triad(a, b, c, 1)
    passes = max(2, int(0.05 / (32e-10 * entries)))
    return 1e-9 * 32 * entries * passes / min(seconds(lambda: triad(a, b, c, passes)) for _ in range(ROUNDS))


def peak_Gflop_s() -> float:
    """Operations per time of one core at its best: fused multiply-adds, two each."""
    multiply_adds(0.5, 0.5, 1)
    count = 3_000_000
    return 1e-9 * 2 * 10 * WIDTH * count / min(seconds(lambda: multiply_adds(0.5, 0.5, count)) for _ in range(ROUNDS))


def cache_bytes() -> int:
    """The largest cache of the first core; 64 MB where the system does not tell."""
    sizes = [path.read_text().strip() for path in Path("/sys/devices/system/cpu/cpu0/cache").glob("index*/size")]
    return max([int(size[:-1]) * {"K": 2**10, "M": 2**20}[size[-1]] for size in sizes if size[-1] in "KM"] or [64 * 10**6])


def machine() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def cores() -> set[int]:
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def pin(to: Iterable[int]) -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, to)


# ---- the comparison ----


def simulation_of(size: int, element: str, threads: int) -> tuple[Simulation, float]:
    """The block at the start, and its step [s]."""
    simulation = problem(size, element, threads)
    simulation.compile()
    dt_s = STEP_SHARE_OF_LIMIT * simulation.stable_limit(20)
    simulation.start(dt_s)
    return simulation, dt_s


def differences(programs: dict[str, Any]) -> dict[str, float]:
    """Largest difference of displacement from ours after SAME_STEPS steps, relative to the largest displacement.

    Where a program keeps a ledger, that of the ledger counts too.
    """
    for program in programs.values():
        program.reset()
        program.run(SAME_STEPS)
    ours = programs["explicitfe"].displacement()
    shares = {
        name: float(np.abs(program.displacement() - ours).max() / np.abs(ours).max())
        for name, program in programs.items()
        if name != "explicitfe"
    }
    for name in shares:
        if hasattr(programs[name], "ledger"):
            entries = np.array([programs[name].ledger(), programs["explicitfe"].ledger()])
            shares[name] = max(shares[name], float(np.abs(entries[0] / entries[1] - 1.0).max()))
    for name, difference in shares.items():
        print(f"  {name} differs by {difference:.1e} after {SAME_STEPS} steps", file=sys.stderr, flush=True)
        if not difference < SAME:
            raise SystemExit(f"{name} does not compute the same: after {SAME_STEPS} steps it differs by {difference:.1e}.")
    return shares


def best_s(turns: Sequence[tuple[str, Any]], clock: Callable[[], float]) -> dict[str, float]:
    """Seconds a step of each program, best of ROUNDS rounds in which they take turns."""
    steps = {}
    for name, program in turns:
        program.reset()
        program.run(1)
        steps[name] = max(3, int(ROUND_S / max(seconds(lambda program=program: program.run(2), clock) / 2, 1e-7)))
    best = dict.fromkeys(steps, np.inf)
    for _ in range(ROUNDS):
        for name, program in turns:
            program.reset()
            program.run(1)
            taken = seconds(lambda program=program, name=name: program.run(steps[name]), clock)
            best[name] = min(best[name], taken / steps[name])
    return best


def compare(size: int, element: str, peers: Sequence[str], peak: float) -> dict[str, Any]:
    """Figures of one element at one size."""
    simulation, dt_s = simulation_of(size, element, 1)
    programs = {}
    for name in ("explicitfe", *peers):
        print(f"{element}, {size} elements: {name} is compiled ...", file=sys.stderr, flush=True)
        begin = time.process_time()
        programs[name] = PROGRAMS[name](simulation, dt_s)
        programs[name].run(1)
        programs[name].reset()  # the next one begins with the same state
        print(f"  ready after {time.process_time() - begin:.1f} s of CPU time", file=sys.stderr, flush=True)
    different = differences(programs)
    turns = [*programs.items(), ("again", programs["explicitfe"])]
    ns = {name: 1e9 * value / size for name, value in best_s(turns, time.process_time).items()}
    again = ns.pop("again")
    first, ns["explicitfe"] = ns["explicitfe"], min(ns["explicitfe"], again)
    print(f"  ns: {', '.join(f'{name} {value:.1f}' for name, value in ns.items())}", file=sys.stderr, flush=True)
    moved, work, speed = bytes_moved(simulation), flops(simulation), bandwidth_GB_s(working_set_bytes(simulation))
    bound = max(moved / speed, work / peak)
    return {
        "element": element,
        "elements": size,
        "ns": ns,
        "ns_first_and_again": [first, again],
        "ratio": {name: ns[name] / ns["explicitfe"] for name in peers},
        "geometry_in_cpp": programs["c++"].geometry if "c++" in programs else None,
        "difference": different,
        "bytes": moved,
        "flops": work,
        "bandwidth_GB_s": speed,
        "memory_ns": moved / speed,
        "arithmetic_ns": work / peak,
        "bound_ns": bound,
        "share_of_bound": bound / ns["explicitfe"],
    }


def two_threads(size: int, element: str) -> dict[str, float]:
    """Nanoseconds of wall time of our program with one thread and with two, in turns."""
    programs = [(str(threads), Ours(*simulation_of(size, element, threads))) for threads in (1, 2)]
    ns = {name: 1e9 * value / size for name, value in best_s(programs, time.perf_counter).items()}
    return {"one_ns": ns["1"], "two_ns": ns["2"], "faster": ns["1"] / ns["2"]}


# ---- what is shown ----


def table(figures: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Head and rows, in words."""
    peers = figures["peers"]
    head = ["element", "elements", "explicitfe [ns]"]
    head += [f"{name} [ns]" for name in peers] + [f"{name} / explicitfe" for name in peers]
    head += [f"{name}: difference" for name in peers] + ["bytes", "flops", "GB/s", "bound [ns]", "bound / measured"]
    threads = any("threads" in row for row in figures["rows"])
    head += ["2 threads, wall [ns]", "times faster"] if threads else []
    rows = []
    for row in figures["rows"]:
        cells = [row["element"], f"{row['elements']}", f"{row['ns']['explicitfe']:.1f}"]
        cells += [f"{row['ns'][name]:.1f}" for name in peers] + [f"{row['ratio'][name]:.2f}" for name in peers]
        cells += [f"{row['difference'][name]:.0e}" for name in peers]
        limit = "memory" if row["memory_ns"] > row["arithmetic_ns"] else "arithmetic"
        cells += [f"{row['bytes']:.0f}", f"{row['flops']:.0f}", f"{row['bandwidth_GB_s']:.1f}"]
        cells += [f"{row['bound_ns']:.1f} ({limit})", f"{row['share_of_bound']:.2f}"]
        if threads:
            cells += [f"{row['threads']['two_ns']:.1f}", f"{row['threads']['faster']:.2f}"]
        rows.append(cells)
    return head, rows


def machine_in_words(figures: dict[str, Any]) -> str:
    """The machine in one paragraph."""
    versions = ", ".join(f"{name} {number}" for name, number in figures["versions"].items())
    return (
        f"{figures['machine']}, {figures['lanes']} lanes of float64, {figures['cores']} cores, of which one is used; {versions}; "
        f"{figures['date']}. Bandwidth beyond the caches {figures['memory_GB_s']:.1f} GB/s, peak {figures['peak_Gflop_s']:.1f} "
        "Gflop/s, one thread. Nanoseconds of CPU time per element and step."
    )


def write(figures: dict[str, Any], folder: Path) -> None:
    """``peers.md`` and ``peers.png``."""
    folder.mkdir(parents=True, exist_ok=True)
    head, rows = table(figures)
    lines = ["# The same step in " + ", ".join(["explicitfe", *figures["peers"]]), "", machine_in_words(figures), ""]
    lines += ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]
    lines += ["", "GB/s: of a triad that takes as much room as the arrays of a step.", "", "![Times](peers.png)", ""]
    (folder / "peers.md").write_text("\n".join(lines))
    draw(figures, folder / "peers.png")


def draw(figures: dict[str, Any], path: Path) -> None:
    """Bars of nanoseconds by size and program, a panel an element; a line across ours at the bound."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names = ["explicitfe", *figures["peers"]]
    colours = {"explicitfe": "#1b6ca8", "c++": "#8a5aa8", "warp": "#7aa95c", "taichi": "#c94f4f", "jax": "#d98032"}
    fig, panels = plt.subplots(1, len(TREATMENTS), figsize=(11, 4.6), sharey=True, layout="constrained")
    width = 0.8 / len(names)
    top = max(value for row in figures["rows"] for value in row["ns"].values())
    low = min(row["bound_ns"] for row in figures["rows"])
    for panel, element in zip(panels, TREATMENTS, strict=True):
        rows = [row for row in figures["rows"] if row["element"] == element]
        for k, name in enumerate(names):
            at = np.arange(len(rows)) + (k - 0.5 * (len(names) - 1)) * width
            values = [row["ns"][name] for row in rows]
            panel.bar(at, values, 0.92 * width, color=colours[name], label=name)
            for x, value in zip(at, values, strict=True):
                panel.annotate(f"{value:.0f}", (x, value), (0, 3), textcoords="offset points", ha="center", fontsize=9)
            if name == "explicitfe":
                bounds = [row["bound_ns"] for row in rows]
                panel.hlines(bounds, at - 0.46 * width, at + 0.46 * width, "k", lw=2, label="bound of this machine")
        panel.set_yscale("log")
        panel.set_ylim(0.5 * low, 2.0 * top)
        panel.set_xticks(range(len(rows)), [f"{row['elements']:,}".replace(",", " ") for row in rows])
        panel.set_xlabel("elements")
        panel.set_title(element)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("ns per element and step, one thread")
    fig.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(names) + 1, frameon=False)
    fig.suptitle(f"The same step, float64, {figures['machine']}", fontsize=11)
    fig.savefig(path, dpi=150)
    plt.close(fig)


def show(figures: dict[str, Any]) -> None:
    """The figures on stdout, a block an element and size: too many columns for a terminal."""
    print(machine_in_words(figures))
    head, rows = table(figures)
    for cells in rows:
        print(f"\n{cells[0]}, {cells[1]} elements")
        for name, cell in zip(head[2:], cells[2:], strict=True):
            print(f"  {name:24} {cell:>20}")


def missing(peer: str) -> str:
    """What a program lacks on this machine, in words; nothing if it can run."""
    if peer in PACKAGES:
        return "" if importlib.util.find_spec(peer) else f'{PACKAGES[peer]} is not installed; pip install ".[peers]"'
    names = " or ".join(peer_cpp.COMPILERS)
    return "" if peer_cpp.compiler() else f"there is no C++ compiler; install {names}, or name one in CXX"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        epilog="example: python studies/benchmarks/peers.py --sizes 1000 30000 --out outputs/peers",
    )
    parser.add_argument(
        "--sizes", type=int, nargs="+", choices=TIMED_SIZES, default=list(TIMED_SIZES), help="elements (default: all)"
    )
    parser.add_argument("--without", action="append", choices=PEERS, default=[], help="go on without it; may be repeated")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to this file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="also write peers.md and peers.png to this folder")
    arguments = parser.parse_args()
    peers = []
    for name in PEERS:
        lacks = "" if name in arguments.without else missing(name)
        if lacks:
            print(f"{name} is left out: {lacks}.", file=sys.stderr)
        elif name not in arguments.without:
            peers.append(name)

    # numba has counted the cores by now; XLA counts them when it is imported, and finds one
    everywhere = cores()
    pin([max(everywhere)] if everywhere else [])
    peak = peak_Gflop_s()
    figures: dict[str, Any] = {
        "machine": machine(),
        "lanes": WIDTH,
        "cores": os.cpu_count(),
        "date": date.today().isoformat(),
        "versions": {
            "python": platform.python_version(),
            "numba": version("numba"),
            **{name: version(PACKAGES[name]) if name in PACKAGES else peer_cpp.version() for name in peers},
        },
        "peers": peers,
        "peak_Gflop_s": peak,
        "memory_GB_s": bandwidth_GB_s(4 * cache_bytes()),
        "rows": [compare(size, element, peers, peak) for element in TREATMENTS for size in arguments.sizes],
    }
    pin(everywhere)
    if len(everywhere) > 1:
        for row in figures["rows"]:
            row["threads"] = two_threads(row["elements"], row["element"])

    show(figures)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    if arguments.out:
        write(figures, arguments.out)


if __name__ == "__main__":
    main()
