"""Ties of patches of the surface to bones: an energy, rigid motion, statics in closed form, and the work of bones that move.

The energy of a patch is the integral of k |u - u_bone|^2 / 2 over it, plus K |h|^2 / 2 of a bone that gives way by h, where h is
what makes the sum smallest. It is stated here anew, with the surface's own points and areas.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import YEOH, block_mesh, deformed, model_of

from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.surface_points import points_on_set, surface_areas
from explicitfe.fem.model.model import Attachment, Model, NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.ledger import balance
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import EXTERNAL, IN_TIES, INTERNAL, KINETIC
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.transient import AnalysisTable, ModelTable, TransientScenario

STIFFNESS = 1e7  # Pa/m
BLOCK = block_mesh((3, 3, 2), seed=21)
TURN = RigidMotion(
    centre_m=np.array([-0.05, 0.0, 0.02]),
    turn_rad=np.radians([5.0, -20.0, 10.0]),
    shift_m=np.array([-2e-3, 1e-3, -3e-3]),
    time_s=np.array([0.0, 0.02, 0.05]),
    course=np.array([0.0, 0.3, 1.0]),
)


def tied(mesh: HexMesh, name: str, **more) -> Attachment:
    points, areas = points_on_set(mesh, name)
    return Attachment(name, points, areas, STIFFNESS, **more)


TWO = (tied(BLOCK, "z0", motion=TURN), tied(BLOCK, "x1", bone_stiffness_N_m=300.0))
THREE = (*TWO, tied(BLOCK, "y1", bone_stiffness_N_m=800.0, motion=TURN))


def energy_of(mesh: HexMesh, attachment: Attachment, displacement: np.ndarray, time_s: float) -> float:
    """Energy [J] of a tie and of the spring of its bone, as the integral over the surface."""
    moved, X = mesh.at(attachment.points, displacement), attachment.points.position
    if attachment.motion is not None:
        rotation, shift = attachment.motion.placement(np.array([time_s]))
        moved = moved - (X @ rotation[0].T + shift[0] - X)
    share = attachment.stiffness_Pa_m * attachment.areas_m2
    given_way = share @ moved / (attachment.bone_stiffness_N_m + share.sum())
    bone = 0.0 if np.isinf(attachment.bone_stiffness_N_m) else attachment.bone_stiffness_N_m
    return float(0.5 * share @ np.sum((moved - given_way) ** 2, axis=1) + 0.5 * bone * given_way @ given_way)


def at(displacement: np.ndarray, time_s: float, attachments: tuple[Attachment, ...] = THREE) -> Simulation:
    """A block of the tissue, free but for its ties, in a state."""
    simulation = Simulation(model_of(BLOCK, YEOH, attachments=attachments), displacement=displacement)
    simulation.time_s = time_s
    return simulation


def test_the_energy_is_the_integral_over_the_patches():
    """In any state, at any time: 1e-12, rounding of a hundred terms."""
    rng = np.random.default_rng(5)
    for time_s in (0.0, 0.013, 0.05):
        u = deformed(BLOCK, rng, 0.3, 0.1)
        wanted = sum(energy_of(BLOCK, attachment, u, time_s) for attachment in THREE)
        assert at(u, time_s).snapshot().energies[IN_TIES] == pytest.approx(wanted, rel=1e-12)


def test_the_force_is_its_derivative(record_property):
    """By central differences of the energy as written above: it is of second degree, so they are exact but for rounding.

    Over d = 1e-4 edges an energy of 10 times force times edge is rounded by eps / d = 2e-11; 1e-9.
    """
    u, step = deformed(BLOCK, np.random.default_rng(6), 0.3, 0.1), 1e-6
    force, wanted = at(u, 0.013).external_force(), np.empty_like(u)
    for entry in range(u.size):
        moved = np.repeat(u[None], 2, axis=0)
        moved[0].flat[entry] += step
        moved[1].flat[entry] -= step
        up, down = (sum(energy_of(BLOCK, attachment, state, 0.013) for attachment in THREE) for state in moved)
        wanted.flat[entry] = -(up - down) / (2.0 * step)
    record_property("off by", np.abs(force - wanted).max() / np.abs(wanted).max())
    np.testing.assert_allclose(force, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("time_s", [0.0, 0.02, 0.037, 1.0])
def test_a_body_that_moves_with_its_bone_feels_nothing(time_s):
    """u = R X + s - X gives no energy and no force, to eps times k A times the way: 1e-12 of it."""
    rotation, shift = TURN.placement(np.array([time_s]))
    u = BLOCK.points @ rotation[0].T + shift[0] - BLOCK.points
    whole = tuple(tied(BLOCK, name, motion=TURN) for name in ("z0", "x1", "y1", "y0"))
    simulation = at(u, time_s, whole)
    area = sum(attachment.areas_m2.sum() for attachment in whole)
    assert np.abs(simulation.external_force()).max() < 1e-12 * STIFFNESS * area * 0.05
    assert simulation.snapshot().energies[IN_TIES] < 1e-24 * STIFFNESS * area * 0.05**2


def test_a_patch_pulls_with_its_area_whatever_the_mesh():
    """Shifted by d, a flat patch of 30 x 30 mm pulls back with k A d, through its centre, in 1, 9 or 25 faces of any shape."""
    d = np.array([1e-4, -2e-4, 3e-4])
    for cells in (1, 3, 5):
        mesh = block_mesh((cells, cells, 2), 0.03 / cells, distort=0.0)
        rng = np.random.default_rng(cells)
        bottom, inside = mesh.node_sets["z0"], np.zeros(mesh.node_count, dtype=bool)
        middle = np.all((mesh.points[bottom, :2] > 1e-6) & (mesh.points[bottom, :2] < 0.03 - 1e-6), axis=1)
        inside[bottom[middle]] = True
        points = mesh.points + np.where(inside[:, None], rng.uniform(-0.2, 0.2, mesh.points.shape) * 0.03 / cells, 0.0) * [
            1,
            1,
            0,
        ]
        mesh = replace(mesh, points=points)
        simulation = Simulation(
            model_of(mesh, YEOH, attachments=(tied(mesh, "z0"),)), displacement=np.tile(d, (mesh.node_count, 1))
        )
        force = simulation.external_force()
        np.testing.assert_allclose(force.sum(axis=0), -STIFFNESS * 0.03**2 * d, rtol=1e-12)
        arm = points - [0.015, 0.015, 0.0]
        np.testing.assert_allclose(np.cross(arm, force).sum(axis=0), 0.0, atol=1e-12 * STIFFNESS * 0.03**3 * 3e-4)


@pytest.mark.parametrize("resolution", ["coarse", "medium"])
def test_ties_leave_the_stable_step_of_the_tongue_as_it_is(resolution):
    """What is tied by area instead of held at its nodes vibrates freely, but not faster than the fastest elements: 1e-3."""
    limits = []
    for attachment in ("nodes", "area"):
        table = ModelTable(name="tongue", resolution=resolution, attachment=attachment)
        scenario = TransientScenario(title="tongue", model=table, analysis=AnalysisTable(duration_ms=1.0))
        limits.append(Simulation(assemble(scenario, Path())[0]).stable_limit(40))
    assert limits[1] == pytest.approx(limits[0], rel=1e-3)


# ---- statics ----


@pytest.mark.parametrize("bone_stiffness", [np.inf, 120.0])
def test_springs_in_series(bone_stiffness, record_property):
    """Under a dead load F the patch moves by F / (k A) and F / K of its bone, on average, whatever the tissue does.

    Balance of forces on the body says so exactly. The run is damped until what is left of the load is 1e-9 of it: it swings out
    like e^(-alpha t / 2), to e^-24 in 0.8 s for alpha = 60 1/s.
    """
    stiff = Yeoh(C10_Pa=2e3, C20_Pa=0.0, poisson=0.45)
    holder = tied(BLOCK, "x0", bone_stiffness_N_m=bone_stiffness)
    force = np.array([0.02, -0.01, 0.015])
    end = BLOCK.node_sets["x1"]
    load = NodalLoad("end", end, np.tile(force / len(end), (len(end), 1)), Profile.constant())
    simulation = Simulation(model_of(BLOCK, stiff, loads=(load,), attachments=(holder,), alpha_per_s=60.0))
    assert Transient(simulation, 0.8).advance_to(0.8) is None
    snapshot = simulation.snapshot()
    area = holder.areas_m2.sum()
    mean = holder.areas_m2 @ BLOCK.at(holder.points, snapshot.displacement) / area
    wanted = force / (STIFFNESS * area) + force / bone_stiffness
    record_property("off by", np.abs(mean / wanted - 1.0).max())
    np.testing.assert_allclose(mean, wanted, rtol=1e-8)
    np.testing.assert_allclose(simulation.ties.shift[0], force / bone_stiffness, rtol=1e-8, atol=1e-20)
    assert np.abs(snapshot.displacement).max() > 10.0 * np.abs(force / (STIFFNESS * area)).max()


# ---- runs ----


def test_the_work_of_bones_that_move(record_property):
    """External work is the sum of tie forces times the way of the bone at each node, at every step, to rounding.

    The ties are of second degree in u - u_bone, so that the trapezoid of both is exact, also where a bone gives way: 1e-11 of it
    for some 300 steps of sums. And the balance closes to the square of the step: 2e-4 of the work at 0.8 of the limit.
    """
    model = model_of(BLOCK, YEOH, attachments=THREE, alpha_per_s=20.0)
    simulation = Simulation(model)
    dt = 0.05 / np.ceil(0.05 / (0.8 * simulation.stable_limit(40)))
    simulation.start(dt)
    work, sums, energies = 0.0, [0.0], [simulation.snapshot().energies]
    while simulation.time_s < 0.08:
        tie = [simulation.time_s]
        forces = _forces_of_ties(simulation)
        assert simulation.advance(1, dt)
        tie.append(simulation.time_s)
        for attachment, first, then in zip(THREE, forces, _forces_of_ties(simulation), strict=True):
            if attachment.motion is not None:
                rotation, shift = attachment.motion.placement(np.array(tie))
                way = BLOCK.points @ (rotation[1] - rotation[0]).T + shift[1] - shift[0]
                work += 0.5 * np.sum((first + then) * way)
        sums.append(work)
        energies.append(simulation.snapshot().energies)
    external = np.array(energies)[:, EXTERNAL]
    record_property("off by", np.abs(external - sums).max() / np.abs(external).max())
    error = np.ptp([balance(e) for e in energies]) / np.abs(external).max()
    record_property("balance error", error)
    assert external[-1] > 1e-4
    np.testing.assert_allclose(external, sums, rtol=0.0, atol=1e-11 * np.abs(external).max())
    assert error < 2e-4


def _forces_of_ties(simulation: Simulation) -> list[np.ndarray]:
    """Forces (n, 3) N of each attachment alone in the present state."""
    return [at(simulation.displacement, simulation.time_s, (attachment,)).external_force() for attachment in THREE]


def test_a_jaw_that_opens_carries_what_is_tied_to_it(record_property):
    """All of the surface is tied to a bone that turns by 23 degrees: at the end the body has turned, and nothing strains it.

    What it still swings falls like e^(-alpha t / 2), to e^-20 in 0.4 s; energies are squares of that.
    """
    mesh = replace(BLOCK, node_sets={"surface": np.flatnonzero(surface_areas(BLOCK) > 0.0)})
    model = Model(mesh, YEOH, np.zeros(mesh.points.shape, dtype=bool), 100.0, attachments=(tied(mesh, "surface", motion=TURN),))
    simulation = Simulation(model)
    snapshots = list(Transient(simulation, 0.45).samples(0.005))
    energies = np.array([s.energies for s in snapshots])
    rotation, shift = TURN.placement(np.array([1.0]))
    wanted = mesh.points @ rotation[0].T + shift[0] - mesh.points
    record_property("off by", np.abs(snapshots[-1].displacement - wanted).max() / np.abs(wanted).max())
    record_property("largest strain energy / kinetic", energies[:, INTERNAL].max() / energies[:, KINETIC].max())
    np.testing.assert_allclose(snapshots[-1].displacement, wanted, rtol=0.0, atol=1e-7 * np.abs(wanted).max())
    assert energies[-1, INTERNAL] < 1e-10 * energies[:, INTERNAL].max()
    # while it turns, what is inside lags behind: less than the whole body's motion by far
    assert energies[:, INTERNAL].max() < 0.05 * energies[:, KINETIC].max()
