"""Nodes that follow a prescribed course: they are where they shall be, and the work that it takes is in the balance.

The support pushes a driven node with R = M dv/dt + alpha M v + f_int. Summed as the trapezoidal rule does, (u_(n+1) - u_n) times
the mean of the R of both ends, its work closes the ledger exactly, but for the error of that rule on the internal energy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support import ELEMENTS, YEOH, balance, block_mesh, model_of, sampled_run

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import Model, PrescribedMotion
from explicitfe.fem.solve.ledger import Ledger
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import DAMPED, EXTERNAL, HOURGLASS, INTERNAL, KINETIC

EDGE = 0.01  # m
EVERY_ELEMENT = pytest.mark.parametrize("element", ELEMENTS)
# With no free node there is no vibration, so the direction to look for the highest one in is 0 / 0; nobody asks for it here.
ALL_DRIVEN = pytest.mark.filterwarnings("ignore:invalid value encountered in divide:RuntimeWarning")


def moved(mesh: HexMesh, nodes: np.ndarray, course: Callable[[np.ndarray], np.ndarray], **more) -> Model:
    """A model whose ``nodes`` all have the displacement course(t), (t, 3) or (t, k, 3) m."""

    def displacement(times: np.ndarray) -> np.ndarray:
        u = course(times)
        return np.broadcast_to(u if u.ndim == 3 else u[:, None, :], (len(times), len(nodes), 3))

    return model_of(mesh, motion=PrescribedMotion(nodes, displacement), **more)


@EVERY_ELEMENT
@ALL_DRIVEN
@pytest.mark.parametrize("alpha", [0.0, 40.0])
def test_rigid_acceleration_takes_the_kinetic_energy(element, alpha, record_property):
    """A whole body moved by a t^2 / 2: work = kinetic energy gained + lost to damping, and both in closed form, to rounding.

    v_(n+1/2) = a (t_n + dt/2), so T_n = v_- M v_+ / 2 = M a^2 (t_n^2 - dt^2 / 4) / 2 from the first step on. The loss is
    alpha M dt times the sum of (v_- + v_+)^2 / 4: a^2 t_k^2 at each instant before t_n, a^2 dt^2 / 16 at the first, where
    v_- = 0, and half of a^2 (t_n - dt / 2) t_n at the last. The internal force is rounding, eps K h u; its work eps K h u^2
    against M a u is 2e-16 x 2e5 x 0.01 x 0.5 / (1e-3 x 100) = 1e-12 at the very most; sums of 500 steps have 500 eps = 1e-13.
    1e-10.
    """
    mesh = block_mesh((2, 2, 1), EDGE, seed=61)
    a = np.array([60.0, -50.0, 70.0])
    model = moved(mesh, np.arange(mesh.node_count), lambda t: 0.5 * np.square(t)[:, None] * a, alpha_per_s=alpha, element=element)
    simulation = Simulation(model)
    dt = 2e-4
    times, energies = sampled_run(simulation, dt, 500, 10)
    mass = simulation.nodal_mass.sum()
    largest = energies[-1, EXTERNAL]
    kinetic = 0.5 * mass * (a @ a) * (times[1:] ** 2 - 0.25 * dt**2)
    assert np.abs(energies[1:, KINETIC] - kinetic).max() < 1e-10 * largest
    assert np.abs(balance(energies)).max() < 1e-10 * largest
    before = np.cumsum((np.arange(501) * dt) ** 2) - (np.arange(501) * dt) ** 2
    t = times[1:]
    lost = alpha * mass * (a @ a) * dt * ((0.25 * dt) ** 2 + before[10::10] + 0.5 * (t**2 - 0.5 * t * dt))
    off = np.abs(energies[1:, DAMPED] - lost).max() / largest
    record_property("off by", off)
    assert off < 1e-10
    np.testing.assert_allclose(simulation.displacement, np.tile(0.5 * times[-1] ** 2 * a, (mesh.node_count, 1)), rtol=1e-15)


@EVERY_ELEMENT
@ALL_DRIVEN
def test_work_of_a_stretch_is_the_strain_energy(element, record_property):
    """One distorted element driven through x = diag(s, s^-1/2, s^-1/2) X from s = 1 to 1.5: work = V W, from the law by hand.

    J = 1 and W = C10 (I1 - 3) + C20 (I1 - 3)^2 with I1 = s^2 + 2 / s. The course rests at both ends, so no kinetic energy is
    left. The trapezoidal rule over 2000 steps is off by (ds)^2 / 12 of W'''s size, ds = 4e-4: 1e-8; the course between two
    instants is straight, not isochoric, but only its ends matter. 1e-6.
    """
    mesh = block_mesh((1, 1, 1), EDGE, seed=62)
    duration, dt = 0.2, 1e-4

    def course(t: np.ndarray) -> np.ndarray:
        s = 1.0 + 0.5 * np.sin(0.5 * np.pi * np.clip(t / duration, 0.0, 1.0)) ** 2
        return mesh.points * (np.stack([s, s**-0.5, s**-0.5], axis=1)[:, None, :] - 1.0)

    simulation = Simulation(moved(mesh, np.arange(8), course, element=element))
    _, energies = sampled_run(simulation, dt, 2010, 10)
    C10, C20 = YEOH.C10_Pa, YEOH.C20_Pa
    invariant = 1.5**2 + 2.0 / 1.5 - 3.0
    wanted = simulation.volumes[0] * (C10 * invariant + C20 * invariant**2)
    record_property("off by", energies[-1, EXTERNAL] / wanted - 1.0)
    assert energies[-1, EXTERNAL] == pytest.approx(wanted, rel=1e-6)
    assert energies[-1, INTERNAL] == pytest.approx(wanted, rel=1e-10)
    assert energies[:, KINETIC].max() > 1e-6 * wanted  # it did move


def pulled(element: str) -> tuple[Model, np.ndarray]:
    """A damped block, held at x = 0, whose other end goes out by 30 % of its length, to the side, and back, in 0.4 s."""
    mesh = block_mesh((3, 2, 2), EDGE, seed=63)
    nodes = mesh.node_sets["x1"]
    return moved(mesh, nodes, out_and_back, held=("x0",), alpha_per_s=40.0, element=element), nodes


AMPLITUDE = np.array([0.009, 0.004, -0.003])  # m
DURATION = 0.4  # s, some 8 times what a shear wave takes along the block


def out_and_back(t: np.ndarray) -> np.ndarray:
    """A sin^2(pi t / T), then rest, (t, 3) m."""
    return np.sin(np.pi * np.clip(t / DURATION, 0.0, 1.0))[:, None] ** 2 * AMPLITUDE


@EVERY_ELEMENT
def test_stretch_and_return_balances(element, record_property):
    """With the automatic step the balance error of a driven, damped stretch and return stays below 1e-4, and nothing is small.

    The end moves 1e-2 m in 0.2 s, some 500 steps: strains of 6e-4 a step and 30 % in all. The trapezoidal rule is off by
    (omega dt)^2 / 12 of what is not linear in the slow motion, 1e-5, and by less in what it stirs up.
    """
    model, nodes = pulled(element)
    simulation = Simulation(model)
    transient, ledger = Transient(simulation, 1.2 * DURATION), Ledger()
    ledger.add(simulation.snapshot())
    for time_s in np.linspace(0.0, 1.2 * DURATION, 61)[1:]:
        assert transient.advance_to(time_s) is None
        wanted = np.tile(out_and_back(np.array([simulation.time_s])), (len(nodes), 1))
        np.testing.assert_array_equal(simulation.displacement[nodes], wanted)
        ledger.add(simulation.snapshot())
    energies = np.array(ledger.energies)
    record_property("balance", ledger.balance_error)
    assert ledger.balance_error < 1e-4
    peak = energies[:, EXTERNAL].max()
    assert energies[:, INTERNAL].max() > 0.5 * peak  # stretched,
    assert energies[-1, EXTERNAL] < 0.7 * peak  # and most of it given back
    assert energies[-1, DAMPED] > 0.02 * peak
    assert (energies[:, HOURGLASS].max() > 0.0) == (element != "hex8-full")


@EVERY_ELEMENT
def test_work_is_that_of_the_reaction(element, record_property):
    """The ledger's work against the integral of R . du with R = M a + alpha M v + f_int, a and v of the course by hand.

    A second statement of the work, from the outside: accelerations and velocities of differences are those
    of the course to (2 pi dt / T)^2 / 6 = 2e-6; the start is off by half a step, M a dt v = 1e-6 of the kinetic energy. 1e-4 of
    the largest work.
    """
    model, nodes = pulled(element)
    simulation = Simulation(model)
    dt = DURATION / 2000
    assert dt < simulation.stable_limit(40)
    mass = simulation.nodal_mass[nodes][:, None]
    simulation.start(dt)
    before_u = before_R = np.zeros((len(nodes), 3))
    before_R = mass * AMPLITUDE * 2.0 * (np.pi / DURATION) ** 2
    work = largest = worst = 0.0
    for _ in range(2000):
        assert simulation.advance(1, dt)
        phase = 2.0 * np.pi * simulation.time_s / DURATION
        v = AMPLITUDE * np.pi / DURATION * np.sin(phase)
        a = AMPLITUDE * 2.0 * (np.pi / DURATION) ** 2 * np.cos(phase)
        u = simulation.displacement
        R = mass * (a + 40.0 * v) + simulation.internal_force(u)[nodes]
        work += 0.5 * np.sum((R + before_R) * (u[nodes] - before_u))
        before_u, before_R = u[nodes], R
        largest = max(largest, work)
        worst = max(worst, abs(simulation.snapshot().energies[EXTERNAL] - work))
    record_property("off by", worst / largest)
    assert worst < 1e-4 * largest


@EVERY_ELEMENT
def test_restart_and_chunks_are_bitwise(element):
    """A driven run stopped and restored in a new simulation, or advanced step by step, is the same bit for bit."""
    model, _ = pulled(element)
    dt = 0.5 * Simulation(model).stable_limit(40)
    whole, parts = Simulation(model), Simulation(model)
    for simulation in (whole, parts):
        simulation.start(dt)
    for steps, share in ((300, 1.0), (240, 0.7)):
        whole.advance(steps, share * dt)
    for _ in range(300):
        parts.advance(1, dt)
    kept = parts.restart_state()
    restored = Simulation(model)
    restored.restore(kept)
    restored.advance(15, 0.7 * dt)
    again = Simulation(model)
    again.restore(restored.restart_state())
    again.advance(225, 0.7 * dt)
    for name, values in whole.restart_state().items():
        np.testing.assert_array_equal(again.restart_state()[name], values, err_msg=name)
    one, two = whole.snapshot(), again.snapshot()
    assert (one.energies == two.energies).all()
    assert (one.velocity == two.velocity).all()
    assert np.abs(one.displacement).max() > 0.1 * EDGE
