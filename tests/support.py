"""What several tests need: distorted blocks, the tongue, deformed states, dense matrices, orders of accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.bones.distance import DistanceField
from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials import Law
from explicitfe.fem.materials.mooney_rivlin import MooneyRivlin
from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import Bone, Model
from explicitfe.fem.solve.kernels import ELEMENTS as ELEMENT_TABLE
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled.arrays import BARRIER, DAMPED, EXTERNAL, HOURGLASS, INTERNAL, KINETIC
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.anatomy import Anatomy
from explicitfe.simulate.anatomy.specimen import specimen_model

ROOT = Path(__file__).resolve().parents[1]

# Constants of Gerard et al. (2005), and the neo-Hooke and Mooney-Rivlin laws with the same initial moduli.
YEOH = Yeoh(C10_Pa=191.5, C20_Pa=90.6)
NEO_HOOKE = NeoHooke(law="neo-hooke", C10_Pa=191.5)
MOONEY_RIVLIN = MooneyRivlin(law="mooney-rivlin", C10_Pa=121.5, C01_Pa=70.0)
LAWS: dict[str, Law] = {"yeoh": YEOH, "neo-hooke": NEO_HOOKE, "mooney-rivlin": MOONEY_RIVLIN}
ELEMENTS = list(ELEMENT_TABLE)
ONE_POINT = ["hex8", "hex8-stiffness"]  # those with hourglass modes, whose treatment is TREATMENTS[name]
# Laws and elements of runs in time: each once. A run knows both by their forces alone, which test_invariants.py checks for every
# pair, and a further pair would cost a compilation of its steps.
IN_RUNS = [*(("yeoh", element) for element in ELEMENTS), *((law, "hex8") for law in LAWS if law != "yeoh")]
TREATMENTS = {name: module for name, (_, module) in ELEMENT_TABLE.items()}


class Unguarded(Simulation):
    """A simulation whose elements may fold: no barrier keeps them from it."""

    guarded = False


# ---- bodies ----


def block_mesh(cells: Sequence[int], size: Sequence[float] | float = 0.01, distort: float = 0.15, seed: int = 0) -> HexMesh:
    """A structured block with every node, inside and on the surface, moved at random.

    Parameters
    ----------
    cells : elements along x, y, z.
    size : edge of an undistorted element [m], one for all directions or one each.
    distort : each coordinate of each node moves by up to this share of the edge.

    Node sets ``x0``, ``x1``, ``y0``, ... are the six faces.
    """
    edge = np.broadcast_to(np.asarray(size, dtype=float), 3)
    mesh = box(cells, edge * np.asarray(cells))
    shift = np.random.default_rng(seed).uniform(-distort, distort, mesh.points.shape)
    return replace(mesh, points=mesh.points + shift * edge)


@cache
def tongue() -> Anatomy:
    """The built-in tongue, coarse."""
    return catalogue.built_in("tongue", "coarse")


@cache
def mesh_of(shape: str) -> HexMesh:
    """The two bodies on which invariants are tested: "block" (4 x 3 x 3, distorted by 15 %) and "tongue" (coarse)."""
    return block_mesh((4, 3, 3), seed=20051) if shape == "block" else tongue().mesh


def model_of(mesh: HexMesh, material: Law = YEOH, held: Sequence[str] = (), **more) -> Model:
    """A model with whole node sets held; none: a free body."""
    fixed = np.zeros((mesh.node_count, 3), dtype=bool)
    for name in held:
        fixed[mesh.node_sets[name]] = True
    return Model(mesh=mesh, material=material, held=fixed, **more)


def floor_below(mesh: HexMesh, gap_m: float = 1e-3, **more) -> Bone:
    """A bone with a level upper side that lies ``gap_m`` below the lowest point of a mesh."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    margin, spacing = high - low, 0.1 * float((high - low).min())
    counts = np.ceil(3.0 * margin / spacing).astype(int) + 1
    heights = low[2] - margin[2] + spacing * np.arange(counts[2]) - (low[2] - gap_m)
    field = DistanceField(low - margin, spacing, np.broadcast_to(heights, counts).copy())
    return Bone("floor", field, TriangleSurface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)), **more)


def small_indentation(*, element: str = "hex8", friction: float | str = 0.0, **specimen) -> Model:
    """A cylinder of 8 x 5 mm under a flat cylinder of radius 3 mm, a few elements across; keys of a specimen's table."""
    table = {"radius_mm": 8.0, "height_mm": 5.0, "edge_size_mm": 0.8, "material": YEOH, "element": element, **specimen}
    return specimen_model(SpecimenTable(**table), ToolTable(shape="flat-cylinder", radius_mm=3.0, friction=friction))


def mean_edge(simulation: Simulation) -> float:
    """Cube root of the mean element volume [m]."""
    return float(np.cbrt(simulation.volumes.mean()))


def wave_modulus(material: Law) -> float:
    """K + 4 G / 3 [Pa]: the stiffness of a plane compression wave."""
    return material.constants()[-1] + 4.0 / 3.0 * material.shear_modulus_Pa


def force_scale(simulation: Simulation) -> float:
    """(K + 4 G / 3) h^2 [N]: the nodal force that a strain of one gives."""
    return wave_modulus(simulation.model.material) * mean_edge(simulation) ** 2


# ---- deformed states ----


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation matrix, uniform over all rotations."""
    return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()


def random_gradient(rng: np.random.Generator, size: float) -> np.ndarray:
    """F = 1 + random entries of up to ``size``, with det F > 0."""
    while True:
        F = np.eye(3) + rng.uniform(-size, size, (3, 3))
        if np.linalg.det(F) > 0.2:
            return F


def deformed(
    mesh: HexMesh, rng: np.random.Generator, gradient: float = 0.15, noise: float = 0.05, *, isochoric: bool = False
) -> np.ndarray:
    """A displacement (n, 3) m: a random affine field turned at random, plus ``noise`` of the shortest edge at each node.

    ``isochoric``: the affine field keeps the volume; a nearly incompressible body can start to move from there.
    """
    edges = mesh.points[mesh.hexes] - mesh.points[mesh.hexes[:, [1, 2, 3, 0, 5, 6, 7, 4]]]
    shortest = np.linalg.norm(edges, axis=2).min()
    F = random_rotation(rng) @ random_gradient(rng, gradient)
    if isochoric:
        F /= np.cbrt(np.linalg.det(F))
    return mesh.points @ (F - np.eye(3)).T + rng.uniform(-noise, noise, mesh.points.shape) * shortest


def elastic_energies(simulation: Simulation, displacement: np.ndarray) -> tuple[float, float]:
    """Strain energy, and what hourglass control and the barrier against folding add [J]; the simulation's state moves there."""
    simulation.state.u[: len(displacement), :3] = displacement[simulation.node_order]
    energies = simulation.snapshot().energies
    return float(energies[INTERNAL]), float(energies[HOURGLASS] + energies[BARRIER])


# ---- matrices of small bodies ----


def stiffness_matrix(simulation: Simulation, displacement: np.ndarray) -> np.ndarray:
    """Tangent stiffness (3 n, 3 n) N/m at a displacement, by central differences of ``internal_force``.

    Over a step of d = 1e-6 edges the truncation error is d^2 = 1e-12 and the rounding error eps / d = 2e-10, relative.
    """
    step = 1e-6 * mean_edge(simulation)
    columns = []
    for entry in range(displacement.size):
        shifted = displacement.copy()
        shifted.flat[entry] += step
        plus = simulation.internal_force(shifted)
        shifted.flat[entry] -= 2.0 * step
        columns.append((plus - simulation.internal_force(shifted)).ravel() / (2.0 * step))
    return np.array(columns).T


def vibration_modes(simulation: Simulation, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular frequencies [1/s], increasing, and modes (k, n, 3) with unit largest entry, at a displacement.

    K x = omega^2 M x with the lumped mass, held components left out; dense.
    """
    free = ~simulation.model.held.ravel()
    root = np.sqrt(np.repeat(simulation.nodal_mass, 3)[free])
    K = stiffness_matrix(simulation, displacement)[np.ix_(free, free)]
    squares, vectors = np.linalg.eigh(0.5 * (K + K.T) / root[:, None] / root)
    modes = np.zeros((len(squares), free.size))
    modes[:, free] = (vectors / root[:, None]).T
    modes /= np.abs(modes).max(axis=1, keepdims=True)
    return np.sqrt(np.maximum(squares, 0.0)), modes.reshape(len(squares), -1, 3)


def true_limit(simulation: Simulation, displacement: np.ndarray) -> float:
    """The largest stable step [s] of central differences, 2 / omega_max, from the dense matrix."""
    return float(2.0 / vibration_modes(simulation, displacement)[0][-1])


# ---- runs ----


def balance(energies: np.ndarray) -> np.ndarray:
    """What is stored and lost, less what came in [J], of energies (..., ENERGIES): constant in an exact world."""
    e = np.asarray(energies)
    return e[..., INTERNAL] + e[..., HOURGLASS] + e[..., KINETIC] + e[..., DAMPED] - e[..., EXTERNAL]


def sampled_run(simulation: Simulation, dt: float, steps: int, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Start with ``dt``, advance ``steps`` steps, and give times (k,) s and energies (k, ENERGIES) J of every so many."""
    simulation.start(dt)
    times, energies = [simulation.time_s], [simulation.snapshot().energies]
    for _ in range(steps // every):
        assert simulation.advance(every, dt), f"an element turned inside out at {simulation.time_s} s"
        times.append(simulation.time_s)
        energies.append(simulation.snapshot().energies)
    return np.array(times), np.array(energies)


def assert_order(errors: Sequence[float], steps: Sequence[float], order: float, tolerance: float) -> np.ndarray:
    """Errors shrink as ``steps`` to the power ``order``, within ``tolerance`` between each two; give the orders measured.

    order = log(e_i / e_(i+1)) / log(h_i / h_(i+1)).
    """
    e, h = np.asarray(errors, dtype=float), np.asarray(steps, dtype=float)
    measured = np.log(e[:-1] / e[1:]) / np.log(h[:-1] / h[1:])
    assert np.abs(measured - order).max() <= tolerance, f"orders {measured}, wanted {order} +- {tolerance}; errors {e}"
    return measured


def result_writer(
    path, *, scenario_text="", model=None, provenance=None, restart=None, expected_samples=64, overwrite=False, **declared
):
    """A result file to fill; ``declared`` is what it will hold, see ``Declaration``."""
    from explicitfe.results.files import ResultWriter
    from explicitfe.results.files.layout import Declaration, Origin

    origin = Origin(scenario_text, model or {}, provenance or {})
    options = {"restart": restart, "expected_samples": expected_samples, "overwrite": overwrite}
    return ResultWriter(
        path, Declaration(**{name: value for name, value in declared.items() if value is not None}), origin, **options
    )
