"""Static solutions and vibration modes of structured blocks, with matrices from finite differences of the internal force; and
the beams, panels and blocks that tests and studies/benchmarks/elements.py share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded, solve_banded
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import LinearOperator, eigsh
from support import YEOH, block_mesh, mean_edge

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.validity import certify
from explicitfe.fem.model.model import Model, NodalLoad, PrescribedMotion
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.ledger import Ledger
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import BARRIER, HOURGLASS, INTERNAL

CLOSED = 1e-9  # an equilibrium: residual relative to the load
MOST_ITERATIONS = 25
SHORTEST_STEP = 2.0**-10  # of the load: then the search for an equilibrium gives up


class Statics:
    """Sparse statics of a simulation on a block of ``support.block_mesh``.

    Parameters
    ----------
    simulation : its model says which components are held.
    cells : elements along x, y, z. Nodes three apart in each direction share no element: 27 colours, of which all nodes of one
        colour are moved at once.
    """

    def __init__(self, simulation: Simulation, cells: Sequence[int]) -> None:
        self.simulation = simulation
        self.held = simulation.model.held.ravel()
        self.free = np.flatnonzero(~self.held)
        hexes = simulation.model.mesh.hexes
        count = simulation.model.mesh.node_count
        grid = np.indices(np.asarray(cells) + 1).reshape(3, -1).T
        colour = grid % 3 @ np.array([9, 3, 1])
        pairs = np.unique((hexes[:, :, None] * count + hexes[:, None, :]).ravel())
        self._row, self._column = np.divmod(pairs, count)
        self._by_colour = [np.flatnonzero(colour[self._column] == c) for c in np.unique(colour)]
        self._moved = [np.flatnonzero(colour == c) for c in np.unique(colour)]
        self._shape = (3 * count, 3 * count)

    def tangent(self, displacement: np.ndarray) -> csr_array:
        """Tangent stiffness (3 n, 3 n) N/m at a displacement (n, 3), by central differences.

        Over a step of d = 1e-6 edges the truncation error is d^2 = 1e-12 and the rounding error eps / d = 2e-10, relative.
        """
        step = 1e-6 * mean_edge(self.simulation)
        rows, columns, values = [], [], []
        for pairs, moved in zip(self._by_colour, self._moved, strict=True):
            for k in range(3):
                shift = np.zeros_like(displacement)
                shift[moved, k] = step
                f = self.simulation.internal_force(displacement + shift)
                f -= self.simulation.internal_force(displacement - shift)
                rows.append((3 * self._row[pairs][:, None] + np.arange(3)).ravel())
                columns.append(np.repeat(3 * self._column[pairs] + k, 3))
                values.append(f[self._row[pairs]].ravel() / (2.0 * step))
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        K = coo_array(entries, shape=self._shape).tocsr()
        return 0.5 * (K + K.T)

    def linear(self, force: np.ndarray, given: np.ndarray | None = None) -> np.ndarray:
        """Displacement (n, 3) m of the linearised body under forces (n, 3) N; ``given`` (n, 3) m is read where held."""
        u = np.zeros(force.size)
        if given is not None:
            u[self.held] = given.ravel()[self.held]
        K = self.tangent(np.zeros_like(force))
        u[self.free] = _solve(K[self.free][:, self.free], (force.ravel() - K @ u)[self.free])
        return u.reshape(-1, 3)

    def equilibrium(
        self, force: np.ndarray, steps: int, course: Callable[[float], np.ndarray] | None = None
    ) -> tuple[np.ndarray, list[float]]:
        """Displacement (n, 3) m at equilibrium with dead forces (n, 3) N, by Newton's method over ``steps`` increments.

        ``course`` gives displacements (n, 3) m at a share of the load between 0 and 1, read where held. An increment that does
        not close is halved. Also given: the relative residuals of the last increment, |f_ext - f_int| over the free components
        by the norm of all internal forces.
        """
        u = np.zeros(force.size)
        done, share = 0.0, 1.0 / steps
        change = None  # of the free components in the last increment, per share
        while done < 1.0:
            share = min(share, 1.0 - done)
            trial, residuals = self._increment(u, force, done + share, share, course, change)
            if residuals[-1] <= CLOSED:
                change = (trial - u) / share
                u, done = trial, done + share
                share = min(1.5 * share, 1.0 / steps)
            else:
                share *= 0.5
                if share < SHORTEST_STEP:
                    raise RuntimeError(f"no equilibrium at {done + share:.4f} of the load: residuals {residuals}")
        return u.reshape(-1, 3), residuals

    def _increment(self, start, force, level, share, course, change):
        u = start.copy()
        if change is not None:
            u[self.free] += share * change[self.free]
        if course is not None:
            u[self.held] = course(level).ravel()[self.held]
        if change is None and course is not None:  # carry the free components along with the held ones
            K = self.tangent(start.reshape(-1, 3))
            u[self.free] -= _solve(K[self.free][:, self.free], (K @ (u - start))[self.free])
        unbalanced, scale = self._residual(u, force, level)
        residuals = [np.linalg.norm(unbalanced) / scale]
        while residuals[-1] > CLOSED and len(residuals) <= MOST_ITERATIONS:
            K = self.tangent(u.reshape(-1, 3))
            if not np.isfinite(K.data).all():
                return u, [*residuals, np.inf]
            step = _solve(K[self.free][:, self.free], unbalanced)
            # Line search on the work of the residual along the step; the whole step where it does not grow.
            length, work = 1.0, abs(step @ unbalanced)
            while True:
                trial = u.copy()
                trial[self.free] += length * step
                unbalanced, scale = self._residual(trial, force, level)
                if np.isfinite(unbalanced).all() and abs(step @ unbalanced) <= 0.9 * work:
                    break
                length *= 0.5
                if length < 1.0 / 64.0:
                    return u, [*residuals, np.inf]
            u = trial
            residuals.append(np.linalg.norm(unbalanced) / scale)
        return u, residuals

    def _residual(self, u, force, level):
        internal = self.simulation.internal_force(u.reshape(-1, 3)).ravel()
        return (level * force.ravel() - internal)[self.free], np.linalg.norm(internal) + 1e-300

    def modes(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The lowest angular frequencies [1/s], increasing, and modes (k, n, 3), normalised by the lumped mass, at rest."""
        K = self.tangent(np.zeros((self._shape[0] // 3, 3)))[self.free][:, self.free]
        root = np.sqrt(np.repeat(self.simulation.nodal_mass, 3)[self.free])
        scaled = (K / root[:, None] / root).tocsr()
        # Below all eigenvalues, rigid motions included, and near the lowest: a thousandth of the mean.
        shift = 1e-3 * scaled.diagonal().mean()
        factor = _cholesky(scaled + shift * _identity(len(root)))
        inverse = LinearOperator(scaled.shape, lambda x: cho_solve_banded((factor, False), x), dtype=float)
        start = np.random.default_rng(0).standard_normal(len(root))
        squares, vectors = eigsh(scaled, count, sigma=-shift, which="LM", OPinv=inverse, v0=start)
        order = np.argsort(squares)
        shapes = np.zeros((count, self.held.size))
        shapes[:, self.free] = (vectors / root[:, None]).T[order]
        return np.sqrt(np.maximum(squares[order], 0.0)), shapes.reshape(count, -1, 3)


def _identity(n: int) -> csr_array:
    return csr_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n))


def _banded(K: csr_array, both_sides: bool) -> tuple[np.ndarray, int]:
    """LAPACK's band form, and the number of bands above the diagonal."""
    K = K.tocoo()
    width = int(np.abs(K.row - K.col).max(initial=0))
    keep = slice(None) if both_sides else K.row <= K.col
    ab = np.zeros(((2 if both_sides else 1) * width + 1, K.shape[0]))
    ab[width + K.row[keep] - K.col[keep], K.col[keep]] = K.data[keep]
    return ab, width


def _cholesky(K: csr_array) -> np.ndarray:
    return cholesky_banded(_banded(K, both_sides=False)[0], overwrite_ab=True, check_finite=False)


def _solve(K: csr_array, right: np.ndarray) -> np.ndarray:
    """K^-1 right: in the block's own numbering K is a narrow band."""
    try:
        return cho_solve_banded((_cholesky(K), False), right)
    except LinAlgError:
        ab, width = _banded(K, both_sides=True)
        return solve_banded((width, width), ab, right, overwrite_ab=True)


def face_weights(points: np.ndarray, nodes: np.ndarray, along: Sequence[int]) -> np.ndarray:
    """Shares (k,) of the nodes of a rectangular face with a regular grid in a uniform traction: trapezoidal, adding up to 1."""
    weights = np.ones(len(nodes))
    for k in along:
        x = points[nodes, k]
        at_edge = np.isclose(x, x.min()) | np.isclose(x, x.max())
        weights *= np.where(at_edge, 0.5, 1.0)
    return weights / weights.sum()


# ---- problems that tests and studies/benchmarks/elements.py share ----

HEIGHT_m = 0.02  # of beams
PANEL_LOAD_N = 0.008  # on the panel's end face, 4 mm wide


def beam_deflection(element: str, slenderness: float, across: int, aspect: float, poisson: float) -> float:
    """Tip deflection per load [m/N] of a square beam of Yeoh tissue, linearised: clamped at x = 0, shear load on the other end.

    ``across`` elements (even) through the thickness, their axial edge ``aspect`` of that. The half y > 0 is computed, with
    u_y = 0 on the plane of symmetry: the same as the whole.
    """
    edge = HEIGHT_m / across
    cells = (round(slenderness * across / aspect), across // 2, across)
    mesh = block_mesh(cells, (edge * aspect, edge, edge), distort=0.0)
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[mesh.node_sets["y0"], 1] = True
    held[mesh.node_sets["x0"]] = True
    material = YEOH.model_copy(update={"poisson": poisson})
    simulation = Simulation(Model(mesh, material, held, element=element))
    end = mesh.node_sets["x1"]
    weights = face_weights(mesh.points, end, (1, 2))
    force = np.zeros(mesh.points.shape)
    force[end, 2] = 0.5 * weights
    return float(weights @ Statics(simulation, cells).linear(force)[end, 2])


def first_bending(element: str, across: int) -> float:
    """Lowest bending frequency [1/s] of the 3:1 beam in cubes, at rest: the half y > 0, symmetric in y."""
    edge = HEIGHT_m / across
    cells = (3 * across, across // 2, across)
    mesh = block_mesh(cells, edge, distort=0.0)
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[mesh.node_sets["y0"], 1] = True
    held[mesh.node_sets["x0"]] = True
    return float(Statics(Simulation(Model(mesh, YEOH, held, element=element)), cells).modes(2)[0][0] / (2.0 * np.pi))


def timoshenko(slenderness: float, poisson: float) -> float:
    """Deflection per load [m/N] of the same beam: L^3 / (3 E I) + L / (k A G), k = 10 (1 + nu) / (12 + 11 nu) (Cowper 1966).

    The clamped end holds more than a beam's (no change of the section): the body is a little stiffer.
    """
    G = YEOH.shear_modulus_Pa
    length = slenderness * HEIGHT_m
    bending = length**3 / (3.0 * 2.0 * G * (1.0 + poisson) * HEIGHT_m**4 / 12.0)
    return bending + length * (12.0 + 11.0 * poisson) / (10.0 * (1.0 + poisson) * HEIGHT_m**2 * G)


def panel(element: str, n: int) -> tuple[Simulation, tuple[int, int, int], np.ndarray]:
    """A tapered panel in plane strain (Cook et al. 2002): the simulation, its cells, and the nodal forces (n, 3) N.

    48 mm long, 44 mm high at the clamped end x = 0 and 16 mm at the other, top edge rising to 60 mm; n x 1 x n elements, u_y = 0
    everywhere; PANEL_LOAD_N upwards on the end face.
    """
    cells = (n, 1, n)
    block = block_mesh(cells, (1.0 / n, 1.0, 1.0 / n), distort=0.0)
    s, y, t = block.points.T
    points = 1e-3 * np.stack([48.0 * s, 4.0 * y, 44.0 * s + t * (44.0 - 28.0 * s)], axis=1)
    mesh = HexMesh(points, block.hexes, block.node_sets)
    held = np.zeros(points.shape, dtype=bool)
    held[:, 1] = True
    held[mesh.node_sets["x0"]] = True
    end = mesh.node_sets["x1"]
    force = np.zeros(points.shape)
    force[end, 2] = PANEL_LOAD_N * face_weights(points, end, (1, 2))
    return Simulation(Model(mesh, YEOH, held, element=element)), cells, force


def panel_tip(element: str, n: int, steps: int = 8) -> tuple[float, list[float]]:
    """Rise [m] of the panel's end face (area mean) at equilibrium, and the residuals of the last increment."""
    simulation, cells, force = panel(element, n)
    u, residuals = Statics(simulation, cells).equilibrium(force, steps)
    return float(np.sum(force * u) / PANEL_LOAD_N), residuals


# ---- runs in time that tests and studies/benchmarks/elements.py share ----

MOTIONS = ("twist", "compress", "shear", "stretch")
COURSE_s = 0.4  # of a block to its extreme and back, eased in and out


@dataclass(frozen=True)
class BlockRun:
    """A block deformed to its extreme and let back.

    Attributes
    ----------
    status : what stopped it, or None.
    energy : J. Elastic energy at the extreme, hourglass energy included.
    hourglass : its share there; ``hourglass_largest`` : the largest over the run.
    folded : most elements folded at any sample; ``elements`` : of how many.
    smallest_J : smallest J of any integration point in any step.
    balance : largest energy balance error.
    end_displacement : m. Largest displacement at the end.
    """

    status: str | None
    energy: float
    hourglass: float
    hourglass_largest: float
    folded: int
    elements: int
    smallest_J: float
    balance: float
    end_displacement: float
    steps: int


def moved_block(kind: str, element: str, n: int) -> Simulation:
    """A block of 20 x 20 x 40 mm in n x n x 2 n elements whose two ends are moved as rigid plates.

    One end stands still; the other turns by 180 degrees about the axis ("twist"), comes half way ("compress"), slides by the
    height ("shear") or leaves to three times the height ("stretch") within COURSE_s / 2, goes back, and the body swings out for
    another COURSE_s; alpha = 20 1/s.
    """
    edge = 0.02 / n
    mesh = block_mesh((n, n, 2 * n), edge, distort=0.0)
    X = mesh.points
    bottom, top = mesh.node_sets["z0"], mesh.node_sets["z1"]
    height = X[:, 2].max()
    across = X[top] - X.mean(axis=0)

    def displacement(times: np.ndarray) -> np.ndarray:
        x = np.clip(times / (COURSE_s / 2.0), 0.0, 2.0)
        x = np.where(x > 1.0, 2.0 - x, x)
        a = (x * x * (3.0 - 2.0 * x))[:, None]
        moved = np.zeros((len(times), len(top), 3))
        if kind == "twist":
            c, s = np.cos(np.pi * a) - 1.0, np.sin(np.pi * a)
            moved[:, :, 0] = c * across[:, 0] - s * across[:, 1]
            moved[:, :, 1] = s * across[:, 0] + c * across[:, 1]
        else:
            axis, share = {"compress": (2, -0.5), "shear": (0, 1.0), "stretch": (2, 2.0)}[kind]
            moved[:, :, axis] = share * height * a
        return np.concatenate([np.zeros_like(moved[:, : len(bottom)]), moved], axis=1)

    motion = PrescribedMotion(np.concatenate([bottom, top]), displacement)
    held = np.zeros(X.shape, dtype=bool)
    return Simulation(Model(mesh, YEOH, held, 20.0, element=element, motion=motion))


def block_run(kind: str, element: str, n: int) -> BlockRun:
    """The course of a ``moved_block``."""
    simulation = moved_block(kind, element, n)
    mesh = simulation.model.mesh
    transient, ledger = Transient(simulation, 2.0 * COURSE_s), Ledger()
    status, folded, samples = None, 0, 160
    for k in range(samples + 1):
        status = transient.advance_to(2.0 * COURSE_s * k / samples)
        snapshot = simulation.snapshot()
        ledger.add(snapshot)
        folded = max(folded, certify(mesh.points + snapshot.displacement, mesh.hexes).folded_count)
        if k == samples // 4 or status:
            extreme = snapshot.energies
        if status:
            break
    elastic = extreme[INTERNAL] + extreme[HOURGLASS] + extreme[BARRIER]
    return BlockRun(
        status=status.message if status else None,
        energy=float(elastic),
        hourglass=float(extreme[HOURGLASS] / elastic),
        hourglass_largest=ledger.hourglass_share,
        folded=folded,
        elements=mesh.element_count,
        smallest_J=snapshot.smallest_J,
        balance=ledger.balance_error,
        end_displacement=float(np.abs(snapshot.displacement).max()),
        steps=simulation.steps,
    )


def cantilever(element: str, across: int, duration_s: float, force_N: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) s, about 1 ms apart, and the area mean of the end face's rise (k,) m of the dynamic cantilever.

    60 x 20 x 20 mm in 3 a x a x a cubes, clamped at x = 0; ``force_N`` upwards, spread evenly over the end face, from t = 0 on
    and held; no damping.
    """
    edge = 0.02 / across
    mesh = block_mesh((3 * across, across, across), edge, distort=0.0)
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[mesh.node_sets["x0"]] = True
    end = mesh.node_sets["x1"]
    weights = face_weights(mesh.points, end, (1, 2))
    load = NodalLoad("end", end, force_N * weights[:, None] * np.array([0.0, 0.0, 1.0]), Profile.constant())
    simulation = Simulation(Model(mesh, YEOH, held, element=element, loads=(load,)))
    transient = Transient(simulation, duration_s)
    times, rises = [0.0], [0.0]
    for milliseconds in range(1, round(1e3 * duration_s) + 1):
        status = transient.advance_to(1e-3 * milliseconds)
        if status:
            raise RuntimeError(status.message)
        times.append(simulation.time_s)
        rises.append(float(weights @ simulation.displacement[end, 2]))
    return np.array(times), np.array(rises)


def swing(times: np.ndarray, rises: np.ndarray) -> tuple[float, float]:
    """Frequency [1/s] and first peak [m] of a swing from rest: the time between upward, and between downward, passes of half
    the peak, averaged; NaN where it does not swing through twice."""
    peak = rises.max()
    above = rises > 0.5 * peak
    at = np.flatnonzero(above[1:] != above[:-1])
    passes = times[at] + (0.5 * peak - rises[at]) / (rises[at + 1] - rises[at]) * (times[at + 1] - times[at])
    if len(passes) < 4:
        return np.nan, float(peak)
    period = 0.5 * (passes[2] - passes[0] + passes[3] - passes[1])
    return float(1.0 / period), float(peak)
