"""Threads that share a step: the answer of one thread, to rounding, and no thread left waiting.

Two sums are taken in another order: the forces on nodes that two parts touch, and the ledger.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from support import ELEMENTS, YEOH, block_mesh

from explicitfe.fem.effects.material.discovered_law import DiscoveredLaw
from explicitfe.fem.effects.material.nonlinear_relaxation import NonlinearRelaxation
from explicitfe.fem.effects.material.payne import Payne
from explicitfe.fem.effects.material.permanent_set import PermanentSet
from explicitfe.fem.effects.material.power_law import PowerLaw
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.effects.specimen.inclusion import InclusionBelowTool
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import Model, PrescribedMotion
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.fem.solve.parts import parts_of, usual_threads
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled import threads
from explicitfe.platform.compiled.arrays import SMALLEST_J
from explicitfe.platform.compiled.jit import kernel
from explicitfe.platform.compiled.simd import ROW
from explicitfe.platform.compiled.threads import wait
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy.specimen import specimen_model

STEPS = 60
ROUNDING = 1e-12  # of the largest displacement: STEPS sums of a few 1e-16 each, grown by a stable system at most STEPS-fold


@kernel
def meet(gate):
    """Wait for a second thread."""
    wait(gate, 2)


def moving(element: str, count: int, *, effects=(), speed: float = 0.1, cells=(6, 7, 8)) -> Simulation:
    """A block held at its bottom, set in motion at random."""
    mesh = block_mesh(cells)
    held = np.zeros((mesh.node_count, 3), dtype=bool)
    held[mesh.points[:, 2] < 1e-9] = True
    model = Model(mesh, YEOH, held, alpha_per_s=40.0, element=element, effects=effects)
    velocity = speed * np.random.default_rng(3).standard_normal((mesh.node_count, 3))
    return Simulation(model, velocity=velocity, threads=count)


def run(simulation: Simulation, dt: float) -> None:
    """In chunks of several lengths."""
    simulation.start(dt)
    for steps in (1, 7, STEPS - 8):
        assert simulation.advance(steps, dt)


@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("element", ELEMENTS)
def test_several_threads_give_the_answer_of_one(element, count):
    alone, shared = moving(element, 1), moving(element, count)
    assert len(alone.parts) == 1 and len(shared.parts) > 1
    dt = STEP_SHARE_OF_LIMIT * alone.stable_limit(40)
    for simulation in (alone, shared):
        run(simulation, dt)
    size = np.abs(alone.displacement).max()
    assert size > 1e-4 and np.abs(shared.displacement - alone.displacement).max() < ROUNDING * size
    one, other = alone.snapshot(), shared.snapshot()
    np.testing.assert_allclose(other.velocity, one.velocity, atol=ROUNDING * np.abs(one.velocity).max())
    np.testing.assert_allclose(other.energies, one.energies, atol=ROUNDING * one.energies.max())
    assert shared.steps == alone.steps == STEPS and other.smallest_J == pytest.approx(one.smallest_J, rel=1e-12)
    force = np.abs(alone.state.force).max()
    np.testing.assert_allclose(shared.state.force, alone.state.force, atol=1e3 * ROUNDING * force)


def test_what_the_material_remembers_is_shared_too():
    effects = (Viscoelastic(g=[0.4], tau_s=[0.01]),)
    alone, shared = moving("hex8", 1, effects=effects), moving("hex8", 3, effects=effects)
    assert len(shared.parts) > 1
    dt = STEP_SHARE_OF_LIMIT * alone.stable_limit(40)
    for simulation in (alone, shared):
        run(simulation, dt)
    scale = np.abs(alone.blocks.old).max(axis=(0, 2), keepdims=True)
    assert np.abs((shared.blocks.old - alone.blocks.old) / np.maximum(scale, 1e-300)).max() < 1e-9
    assert np.abs(shared.displacement - alone.displacement).max() < ROUNDING * np.abs(alone.displacement).max()


def test_the_same_threads_give_the_same_bits():
    """No sum depends on who comes first."""
    answers = []
    for _ in range(3):
        simulation = moving("hex8", 4)
        run(simulation, 2e-5)
        assert len(simulation.parts) > 1
        answers.append((simulation.displacement, simulation.ledger.copy()))
    for displacement, ledger in answers[1:]:
        assert np.array_equal(displacement, answers[0][0]) and np.array_equal(ledger, answers[0][1])


def test_a_restart_goes_on_bit_for_bit():
    """What is computed anew at the restart is summed in the order of the run."""
    through, first, second = (moving("hex8", 3) for _ in range(3))
    assert len(through.parts) > 1
    dt = STEP_SHARE_OF_LIMIT * through.stable_limit(40)
    for simulation in (through, first):
        simulation.start(dt)
        simulation.advance(30, dt)
    second.restore(first.restart_state())
    for simulation in (through, second):
        simulation.advance(30, dt)
    assert np.array_equal(second.displacement, through.displacement)
    assert np.array_equal(second.state.force, through.state.force)


def test_all_end_with_the_step_in_which_an_element_turns_inside_out():
    alone, shared = moving("hex8", 1, speed=30.0), moving("hex8", 3, speed=30.0)
    assert len(shared.parts) > 1
    dt = STEP_SHARE_OF_LIMIT * alone.stable_limit(40)
    for simulation in (alone, shared):
        simulation.start(dt)
        assert not simulation.advance(400, dt)
    assert 0 < shared.steps == alone.steps < 400
    assert not shared.ledger[SMALLEST_J] > 0.0


def test_parts_cover_everything_once():
    simulation = moving("hex8", 4)
    parts = simulation.parts
    assert len(parts) > 1
    assert sum(part.own for part in parts) == len(simulation.state.u)
    assert sum(len(part.blocks.nodes) for part in parts) == len(simulation.blocks.nodes)
    for part in parts:
        assert part.first % 2 == 0 and part.blocks.nodes.max() // ROW < len(part.u) == len(part.force)
        assert len(part.lower) <= part.own


def test_as_many_parts_as_share_nodes_with_the_next_one_only():
    """128 elements in a hundred parts would be one or two each, which share nodes with parts further on."""
    simulation = moving("hex8", 1, cells=(8, 8, 2))
    assert len(parts_of(simulation.state, simulation.blocks, 100)) < 6


def test_bodies_that_share_no_node():
    """Separate elements, and a node between them that belongs to none."""
    cells = [block_mesh((1, 1, 1), distort=0.2, seed=k) for k in range(40)]
    points = np.concatenate([*(cell.points + [0.02 * k, 0.0, 0.0] for k, cell in enumerate(cells)), [[-1.0, 0.0, 0.0]]])
    hexes = np.concatenate([cell.hexes + 8 * k for k, cell in enumerate(cells)])
    velocity = 0.1 * np.random.default_rng(2).standard_normal(points.shape)
    velocity[-1] = 0.0
    displacements = []
    for count in (1, 3):
        model = Model(HexMesh(points, hexes, {}), YEOH, np.zeros(points.shape, dtype=bool))
        simulation = Simulation(model, velocity=velocity, threads=count)
        simulation.start(1e-5)
        assert simulation.advance(50, 1e-5)
        assert len(simulation.parts) == count
        displacements.append(simulation.displacement)
    alone, shared = displacements
    assert np.abs(shared - alone).max() < ROUNDING * np.abs(alone).max()


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("tool", [{"shape": "flat-cylinder", "radius_mm": 8.0, "friction": 0.3}, {"shape": "platen"}])
def test_a_relaxation_by_several_threads(tool, count, record_property):
    """The equilibrium of one thread, as near as the tolerance lets both be to the true one; the same bits when repeated.

    The residual is below 1e-6 of the load. What a force residual r moves is r times the compliance: as a share of the
    displacement, 1e-6, and more for modes softer than that of the tool, up to some ten times.
    """
    # 672 elements: three parts of blocks of 8, which share nodes with the next part only
    specimen = SpecimenTable(symmetry="quarter", radius_mm=20.0, height_mm=10.0, edge_size_mm=1.5)
    answers = []
    for threads_asked in (1, count, count):
        body = Relaxation(specimen_model(specimen, ToolTable(**tool)), 1e-6, threads=threads_asked)
        assert len(body.parts) == threads_asked
        curve = [body.press(force) for force in (0.1, 0.3, 0.2)]
        assert all(isinstance(point, Equilibrium) for point in curve), curve
        answers.append((np.array([point.displacement_m for point in curve]), body.displacement))
    (alone, u), (shared, w), (again, _) = answers
    worst = max(np.abs(shared / alone - 1.0).max(), np.abs(w - u).max() / np.abs(u).max())
    record_property("off by", worst)
    assert worst < 1e-5
    assert np.array_equal(shared, again)


@pytest.mark.parametrize(
    "effects",
    [
        (Viscoelastic(g=(0.4,), tau_s=(1.0,)), NonlinearRelaxation(exponent=-0.7)),
        (PowerLaw(exponent=0.2, tau_s=1.0),),
        (DiscoveredLaw(tau_s=(0.0, 1.0), c10_Pa=(0.0, 40.0), c01_Pa=(20.0, 20.0)),),
        (
            PermanentSet(modulus_Pa=100.0),
            Payne(modulus_Pa=100.0, yield_shear=0.05),
            InclusionBelowTool(ratio=3.0, radius_mm=5.0, depth_mm=4.0),
        ),
    ],
    ids=lambda effects: type(effects[-1]).__name__,
)
def test_a_tissue_that_remembers_relaxes_in_several_threads(effects):
    """Two equilibria one after the other, each to a residual of 1e-6, as above, and what is remembered then."""
    specimen = SpecimenTable(symmetry="quarter", radius_mm=20.0, height_mm=10.0, edge_size_mm=2.0)
    ends, kept = [], []
    for count in (1, 2):
        body = Relaxation(specimen_model(specimen, ToolTable(shape="platen"), effects), 1e-6, threads=count)
        assert len(body.parts) == count
        curve = [body.press(force, at_s=at_s) for force, at_s in ((0.3, 1.0), (0.3, 3.0), (0.1, 4.0))]
        assert all(isinstance(state, Equilibrium) for state in curve), curve
        ends.append([state.displacement_m for state in curve])
        kept.append(body.blocks.old.copy())
    assert ends[1] == pytest.approx(ends[0], rel=1e-5)
    scale = np.abs(kept[0]).max(axis=(0, 2), keepdims=True)
    assert np.abs((kept[1] - kept[0]) / np.maximum(scale, 1e-300)).max() < 1e-4


def test_a_sector_has_one_thread():
    specimen = SpecimenTable(symmetry="sector", radius_mm=20.0, height_mm=10.0, edge_size_mm=2.5)
    body = Relaxation(specimen_model(specimen, ToolTable(shape="flat-cylinder", radius_mm=8.0)), threads=4)
    assert len(body.parts) == 1


def test_small_meshes_have_one_thread(monkeypatch):
    monkeypatch.setenv("EXPLICITFE_CORES", "8")
    assert usual_threads(1280) == 1
    assert usual_threads(1280, each=500) == 2
    assert usual_threads(1_000_000) == 8


def test_the_number_of_cores_can_be_stated(monkeypatch):
    """By EXPLICITFE_CORES, or by EXPLICITFE_THREADS as it was called; what is no number counts as not stated."""
    for name in ("EXPLICITFE_CORES", "EXPLICITFE_THREADS"):
        monkeypatch.delenv(name, raising=False)
    own = threads.cores()
    assert own >= 1
    monkeypatch.setenv("EXPLICITFE_THREADS", "3")
    assert threads.cores() == 3
    monkeypatch.setenv("EXPLICITFE_CORES", "5")
    assert threads.cores() == 5
    monkeypatch.setenv("EXPLICITFE_CORES", "")
    assert threads.cores() == 3
    for nonsense in ("0", "many", "-1", "2.5"):
        monkeypatch.setenv("EXPLICITFE_CORES", nonsense)
        with pytest.raises(InputError, match="EXPLICITFE_CORES is"):
            threads.cores()


def test_a_body_has_no_more_threads_than_cores_unless_told_so(monkeypatch):
    monkeypatch.setenv("EXPLICITFE_CORES", "1")
    mesh = block_mesh((16, 16, 16))
    model = Model(mesh, YEOH, np.zeros((mesh.node_count, 3), dtype=bool))
    assert len(Simulation(model).parts) == 1
    assert len(Simulation(model, threads=2).parts) == 2
    monkeypatch.setenv("EXPLICITFE_CORES", "2")
    assert len(Simulation(model).parts) == 2


def test_a_thread_that_cannot_be_started_leaves_none_waiting(monkeypatch):
    simulation = moving("hex8", 3, cells=(6, 7, 30))
    assert len(simulation.parts) == 3
    simulation.start(1e-5)
    real = threads._pool(2)

    class Broken:
        started = 0

        def submit(self, *call):
            self.started += 1
            if self.started == 2:
                raise RuntimeError("can't start new thread")
            return real.submit(*call)

    monkeypatch.setattr(threads, "_pool", lambda count: Broken())
    begin = time.perf_counter()
    with pytest.raises(RuntimeError, match="new thread"):
        simulation.advance(10, 1e-5)
    assert time.perf_counter() - begin < 60.0


def test_a_thread_that_fails_leaves_none_waiting():
    gate = threads.gate()

    def fails():
        raise OSError("disk full")

    begin = time.perf_counter()
    with pytest.raises(OSError, match="disk full"):
        threads.together([lambda: meet(gate), fails], gate)
    assert time.perf_counter() - begin < 60.0


def test_prescribed_motion_has_one_thread():
    mesh = block_mesh((4, 4, 4))
    top = np.flatnonzero(mesh.points[:, 2] > mesh.points[:, 2].max() - 1e-9)
    motion = PrescribedMotion(top, lambda t: np.zeros((len(t), len(top), 3)))
    model = Model(mesh, YEOH, np.zeros((mesh.node_count, 3), dtype=bool), motion=motion)
    assert len(Simulation(model, threads=4).parts) == 1
