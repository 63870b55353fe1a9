"""Never a silent NaN: whatever the state, the internal force is finite or the kernel says that an element is broken.

The loop and all that drives it look at one number, the smallest J that the force kernel gives back: a run goes on while it is
above zero. So a force that is not finite must never come with a J above zero, in any element, in any place of the mesh.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from support import ELEMENTS, block_mesh, model_of, random_gradient, random_rotation

from explicitfe.fem.mesh.hexmesh import CORNERS, HexMesh
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import INVERTED, SHORTEST_SHARE_OF_FIRST_STEP, Transient
from explicitfe.platform.compiled.arrays import SMALLEST_J, Blocks
from explicitfe.platform.compiled.simd import WIDTH

EDGE = 0.01  # m
STATES = 10_000
AMPLITUDES = (1e-12, 5.0)  # of an edge, at each corner
ODD = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e120, -1e120])  # m
EVERY_ELEMENT = pytest.mark.parametrize("element", ELEMENTS)


@cache
def separate_hexes() -> HexMesh:
    """10 000 hexes that share no node, each distorted by up to 15 % of its edge."""
    rng = np.random.default_rng(40)
    corners = EDGE * (0.5 * CORNERS + rng.uniform(-0.15, 0.15, (STATES, 8, 3)))
    return HexMesh(corners.reshape(-1, 3), np.arange(8 * STATES).reshape(STATES, 8))


@cache
def fuzz() -> tuple[np.ndarray, np.ndarray]:
    """Displacements (STATES, 8, 3) m, and which of them have entries that are no sensible number (STATES,).

    A third: random corners of every size from rounding to several edges. A third: the same about a large affine field. A third:
    the same with one to three odd entries.
    """
    rng = np.random.default_rng(41)
    corners = separate_hexes().points.reshape(STATES, 8, 3)
    size = EDGE * np.exp(rng.uniform(*np.log(AMPLITUDES), STATES))
    u = size[:, None, None] * rng.uniform(-1.0, 1.0, corners.shape)
    third = STATES // 3
    for state in range(third, 2 * third):
        F = random_rotation(rng) @ random_gradient(rng, 1.0)
        u[state] += corners[state] @ (F - np.eye(3)).T
    for state in range(2 * third, STATES):
        for _ in range(rng.integers(1, 4)):
            u[state, rng.integers(8), rng.integers(3)] = rng.choice(ODD)
    return u, np.arange(STATES) >= 2 * third


def alone(simulation: Simulation, element: int) -> Blocks:
    """Blocks of one element (computing order), which stands in every lane."""
    block, lane = divmod(element, WIDTH)
    return simulation.blocks.each(lambda values: np.repeat(values[block : block + 1, :, lane : lane + 1], WIDTH, axis=2))


@EVERY_ELEMENT
def test_force_is_finite_or_the_element_is_reported(element, record_property):
    """10 000 random states, one element at a time: force finite, or the smallest J of the kernel not above zero.

    The reference is the definition; there is no tolerance. The states are what they should be: both outcomes appear in
    numbers, elements that are turned inside out (det F < 0 in plain numpy) among them, and all sound states give a finite force.
    """
    simulation = Simulation(model_of(separate_hexes(), element=element))
    displacement, odd = fuzz()
    finite, reported = np.zeros(STATES, dtype=bool), np.zeros(STATES, dtype=bool)
    force = np.zeros_like(simulation.state.u)
    u = simulation._rows(displacement.reshape(-1, 3))
    number = simulation.element_order
    with np.errstate(all="ignore"):
        for e in range(STATES):
            smallest = simulation.kernels.forces(u, force, alone(simulation, e))
            finite[number[e]] = np.isfinite(force[simulation.hexes[e]]).all()
            reported[number[e]] = not smallest > 0.0
    silent = np.flatnonzero(~finite & ~reported)
    record_property("reported", int(reported.sum()))
    assert not len(silent), f"{len(silent)} silent, the first: {displacement[silent[0]].tolist()}"
    assert 0.1 * STATES < reported.sum() < 0.7 * STATES
    assert (finite & ~odd & ~reported).sum() > 0.3 * STATES
    gentle = ~odd & (np.abs(displacement).max(axis=(1, 2)) < 0.05 * EDGE)
    assert gentle.sum() > 0.2 * STATES
    assert (finite & ~reported)[gentle].all()
    broken = ~np.isfinite(displacement).all(axis=(1, 2))
    assert broken.sum() > 0.1 * STATES
    assert reported[broken].all()


@EVERY_ELEMENT
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_bad_node_is_seen_wherever_it_is(element, value):
    """One entry of one node, in turn each node of a block: the smallest J of the whole mesh is not above zero.

    A comparison with NaN is false, so a running minimum forgets it unless it takes care, and what comes after is sound. The 27
    elements fill whole blocks of lanes and part of one.
    """
    mesh = block_mesh((3, 3, 3), EDGE, seed=42)
    simulation = Simulation(model_of(mesh, element=element))
    force = np.zeros_like(simulation.state.u)
    assert simulation.kernels.forces(simulation.state.u, force, simulation.blocks) == pytest.approx(1.0, abs=1e-12)
    for node in range(mesh.node_count):
        u = np.zeros_like(mesh.points)
        u[node, node % 3] = value
        smallest = simulation.kernels.forces(simulation._rows(u), force, simulation.blocks)
        assert not smallest > 0.0, node


@EVERY_ELEMENT
def test_a_run_that_meets_nan_ends_with_a_sentence(element):
    """A velocity that is not a number at a node: the run ends at the first step and names an element that has that node."""
    mesh = block_mesh((3, 3, 3), EDGE, seed=43)
    for node in (0, 21, mesh.node_count - 1):
        simulation = Simulation(model_of(mesh, element=element))  # refuses such a velocity, so it is set afterwards
        simulation.state.v[simulation._place[node], 1] = np.nan
        status = Transient(simulation, 0.1).advance_to(0.1)
        assert simulation.steps == 1
        assert status is not None
        assert status.state == INVERTED
        named = int(status.message.split("element ")[1].split()[0])
        assert node in mesh.hexes[named]


@EVERY_ELEMENT
def test_a_run_that_turns_an_element_inside_out_names_it(element):
    """One corner is shot through its element: the element that is named has that corner, and its J is not above 0."""
    mesh = block_mesh((3, 3, 3), EDGE, distort=0.0)
    velocity = np.zeros_like(mesh.points)
    velocity[0] = 100.0  # m/s along the diagonal: 2 edges in 0.3 ms
    simulation = Simulation(model_of(mesh, element=element, barrier=False), velocity=velocity)
    status = Transient(simulation, 0.1).advance_to(0.1)
    assert status is not None
    assert status.state == INVERTED
    named = int(status.message.split("element ")[1].split()[0])
    assert 0 in mesh.hexes[named], status.message
    assert not float(status.message.split("J = ")[1].split(")")[0]) > 0.0, status.message


def test_a_corner_that_no_step_can_stop_names_its_element():
    """The same with the barrier: shorter steps are tried, down to a ten thousandth of the first."""
    mesh = block_mesh((3, 3, 3), EDGE, distort=0.0)
    velocity = np.zeros_like(mesh.points)
    velocity[0] = 100.0
    transient = Transient(Simulation(model_of(mesh), velocity=velocity), 0.1)
    first_s = transient.smallest_dt_s
    status = transient.advance_to(0.1)
    assert status is not None
    assert status.state == INVERTED
    assert "inverted at a corner" in status.message
    assert 0 in mesh.hexes[int(status.message.split("element ")[1].split()[0])], status.message
    assert 0.5 <= transient.smallest_dt_s / (SHORTEST_SHARE_OF_FIRST_STEP * first_s) < 2.0


def test_a_gauss_point_that_turns_inside_out_names_its_element():
    """hex8-full: one corner of element A is pushed in until a Gauss point is inverted while its mean J is 0.55; B has J = 0.4.

    The kernel reports it; the status has to name A, not B, whose mean J is the smallest.
    """
    mesh = HexMesh(EDGE * 0.5 * np.concatenate([CORNERS, CORNERS + 4.0]), np.arange(16).reshape(2, 8))
    u = np.zeros_like(mesh.points)
    u[8:, 0] = -0.6 * mesh.points[8:, 0]
    u[0] = 0.6 * EDGE
    simulation = Simulation(model_of(mesh, element="hex8-full"), displacement=u)
    transient = Transient(simulation, 0.1)
    assert not simulation.ledger[SMALLEST_J] > 0.0
    J = simulation.snapshot().J
    assert J[0] > 0.5 > J[1] > 0.3
    assert "element 0 " in transient._inverted().message
