"""Contact with bones: momentum, energy, Hertz, bones that move, friction, threads, restart, symmetry, and the stable step.

The ledger takes the trapezoid of all forces over each step. Contact bends at first touch: a point that comes with speed v within
a step dt changes the balance by up to k A (v dt)^2 / 8 when it comes, and by as much when it leaves.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from contact_bodies import half_space, plate, rigid_ball, round_body, shift, stations
from scipy.integrate import solve_ivp
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from support import ROOT, YEOH, block_mesh, model_of

from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.forces.bone import CONTACT_STIFFNESS_PA_M, STIFFENING_DEPTH_M
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.surface_points import points_on_set
from explicitfe.fem.model.gravity import gravity_load
from explicitfe.fem.model.model import Attachment, FibreStress, Model, PrescribedMotion
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.ledger import Ledger, balance
from explicitfe.fem.solve.observe import Snapshot
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import BONE_AREA, BONE_DEPTH, EXTERNAL, HOURGLASS, IN_CONTACT, INTERNAL, KINETIC, RUBBED
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.bones import BoneTable
from explicitfe.simulate.scenario.transient import AnalysisTable, Damping, ModelTable, MuscleTable, TransientScenario

G_M_S2 = 9.81
STIFF = Yeoh(C10_Pa=2e4, C20_Pa=0.0, poisson=0.3)  # next to soft tissue all but rigid


def every_step(simulation: Simulation, dt: float, until_s: float) -> list[Snapshot]:
    simulation.start(dt)
    snapshots = [simulation.snapshot()]
    for _ in range(int(np.ceil(until_s / dt))):
        assert simulation.advance(1, dt), f"an element turned inside out at {simulation.time_s} s"
        snapshots.append(simulation.snapshot())
    return snapshots


def balance_error(snapshots: list[Snapshot]) -> float:
    """Largest change of what is stored and lost, less the work done [J]."""
    return float(np.ptp([balance(s.energies) for s in snapshots]))


def bend_error(snapshots: list[Snapshot], speed: float, dt: float) -> float:
    """Bound of the balance error [J] of points that touch at up to that speed and leave again, each once.

    With the stiffness k (1 + 2 p / p0) of the deepest of them.
    """
    area = max(s.contact[:, BONE_AREA].sum() for s in snapshots)
    stiffer = 1.0 + 2.0 * max(s.contact[:, BONE_DEPTH].max() for s in snapshots) / STIFFENING_DEPTH_M
    return CONTACT_STIFFNESS_PA_M * stiffer * area * (speed * dt) ** 2 / 4.0


# ---- a ball thrown at a plate ----

SPEED = 0.2  # m/s; shear waves in the tissue run at 0.6 m/s


def thrown(tilt: np.ndarray, share: float, **of_bone: float) -> tuple[list[Snapshot], Simulation, float]:
    """Every step of 60 ms, a share of the limit each: a ball of tissue that starts 1 mm from a plate and flies straight at it."""
    mesh = round_body(6, 0.01)
    turned = mesh.points @ Rotation.from_rotvec([0.3, 0.2, 0.1]).as_matrix().T
    points = (turned + [0.0, 0.0, 1e-3 - turned[:, 2].min()]) @ tilt.T
    model = model_of(HexMesh(points, mesh.hexes), YEOH, bones=(replace(plate(rotation=tilt), **of_bone),))
    simulation = Simulation(model, velocity=np.tile(tilt @ [0.0, 0.0, -SPEED], (len(points), 1)))
    dt = share * simulation.stable_limit(40)
    return every_step(simulation, dt, 0.06), simulation, dt


@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0, 0.0), (20.0, 35.0, 10.0)], ids=["level", "tilted"])
def test_a_thrown_ball(tilt_deg, record_property):
    """Momentum to rounding, energy to the bends; it comes back slower than it came, by what the dampers have lost.

    M (v+ - v-) = dt f holds in each step, so the trapezoid of the recorded force is the change of momentum but for the rounding
    of some hundred sums, 1e-12. Nothing is lost in the tissue, and no work is done: kinetic, strain and contact energy and the
    contact's loss add up to the same to ``bend_error``, 0.2 to 0.3 % of the impact energy here, which falls as dt^2.
    """
    tilt = Rotation.from_euler("xyz", tilt_deg, degrees=True).as_matrix()
    errors = []
    for share in (0.8, 0.4):
        snapshots, simulation, dt = thrown(tilt, share)
        energies = np.array([s.energies for s in snapshots])
        force = np.array([s.contact[0, :3] for s in snapshots])
        momentum = np.array([simulation.nodal_mass @ s.velocity for s in snapshots])
        came, left = np.linalg.norm(momentum[[0, -1]], axis=1)
        change = momentum[-1] - momentum[0]
        assert np.abs(np.trapezoid(force, dx=dt, axis=0) - change).max() < 1e-12 * came
        push = force @ tilt[:, 2]
        assert (
            not force[[0, -1]].any() and push.min() >= -1e-6 * push.max()
        )  # it never pulls; the grid tilts the plate by a millionth

        errors.append(balance_error(snapshots))
        assert errors[-1] < bend_error(snapshots, SPEED, dt)
        loss = energies[:, RUBBED]
        assert (np.diff(loss) >= 0.0).all() and loss[-1] > 0.03 * energies[0, KINETIC]
        assert energies[:, IN_CONTACT].max() > 0.0 == energies[-1, IN_CONTACT] and not energies[:, EXTERNAL].any()
        assert 0.5 * came < left < came
        assert (momentum[-1] @ tilt)[2] > 0.9 * left
    record_property("lost / impact energy", loss[-1] / energies[0, KINETIC])
    record_property("balance errors / impact energy", [error / energies[0, KINETIC] for error in errors])
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("damping", [0.0, 0.1, 0.5])
def test_an_impact_loses_what_its_dampers_lose(damping, record_property):
    """Without damping nothing is lost: the ball keeps its energy, in motion and in vibrations, to the bends."""
    snapshots, _, dt = thrown(np.eye(3), 0.4, damping=damping)
    begun, ended = (s.energies for s in (snapshots[0], snapshots[-1]))
    kept = ended[[KINETIC, INTERNAL, HOURGLASS]].sum()
    assert abs(kept + ended[RUBBED] - begun[KINETIC]) < bend_error(snapshots, SPEED, dt) < 0.01 * begun[KINETIC]
    assert ended[IN_CONTACT] == 0.0 and (ended[RUBBED] == 0.0 if damping == 0.0 else ended[RUBBED] > 0.01 * begun[KINETIC])
    record_property("lost / impact energy", ended[RUBBED] / begun[KINETIC])


def test_a_history_of_samples_tells_the_impulse():
    """Every fifth step: the trapezoid of a pulse of 20 ms sampled at 0.6 ms is good to (0.6 / 20)^2 / 12 of its bends; 1 %."""
    snapshots, simulation, dt = thrown(np.eye(3), 0.8)
    kept = snapshots[::5]
    force = np.array([s.contact[0, 2] for s in kept])
    change = simulation.nodal_mass @ (kept[-1].velocity - kept[0].velocity)[:, 2]
    assert np.trapezoid(force, dx=5 * dt) == pytest.approx(change, rel=1e-2)


def test_a_soft_body_of_large_elements_touches_without_harm():
    """k A / m is more than a hundred times the square of its highest frequency: the step has to leave room before it touches."""
    soft = Yeoh(C10_Pa=50.0, C20_Pa=0.0, poisson=0.3)
    mesh = round_body(6, 0.01)
    model = model_of(replace(mesh, points=mesh.points + [0.0, 0.0, 0.011]), soft, bones=(plate(),))
    simulation = Simulation(model, velocity=np.tile([0.0, 0.0, -0.1], (mesh.node_count, 1)))
    free = Simulation(replace(model, bones=()))
    assert free.stable_limit(40) > 8.0 * simulation.stable_limit(40)
    transient, ledger = Transient(simulation, 0.1), Ledger()
    snapshots = list(transient.samples(1e-3))
    for snapshot in snapshots:
        ledger.add(snapshot)
    # the bends: dt is 2 / (k A / m)^(1/2) here, so that k A (v dt)^2 / 4 is twice the energy with which the point came
    assert ledger.balance_error < 0.02
    assert max(s.contact[0, BONE_DEPTH] for s in snapshots) < 3e-4


def test_contact_that_stiffens_between_two_checks_shortens_the_step():
    """A tongue of poisson 0.3 is so soft that contact, once it is a little deep, exceeds the limit of the last check.

    It inverted after 23 ms where a check counted k A / m and saw nothing until the next one. A restart in between changes no bit.
    """
    tissue = "model.material={C10_Pa=1037.0, C20_Pa=486.0, poisson=0.3}"

    def run() -> Transient:
        body = prepare(ROOT / "scenarios" / "gga-alone.toml", [tissue, "analysis.threads=1"]).body
        return Transient(body, 0.04)

    through, first, second = run(), run(), run()
    ledger = Ledger()
    for snapshot in through.samples(1e-3):
        ledger.add(snapshot)
    assert ledger.balance_error < 1e-4 and snapshot.J.min() > 0.9
    assert first.advance_to(0.022) is None
    second.restore(first.restart_state())
    assert second.advance_to(0.04) is None
    assert np.array_equal(second.simulation.displacement, snapshot.displacement)


# ---- Hertz ----


def test_hertz(record_property):
    """A ball of radius R pressed slowly into a half space: F = 4/3 E* R^(1/2) d^(3/2) (Hertz 1882) to 1.5 %.

    A quarter of a block reaches 8 a from the centre, a = (R d)^(1/2), and its far faces follow the half space under a point load
    (Boussinesq 1885; Johnson 1985, eq. 3.18), Hertz's own field there but for a share of (a / r)^2 = 1.6 % of what is 10 % of d.
    Left are: the parabola for the ball and small strains, of order (a / R)^2 = 0.3 %; the compliance of the contact, which takes
    (3 / 2 pi) E* / (k a) of the force by the first variation of the energy, 0.5 to 0.8 %; and, seen by varying them, the mesh
    (the ratio is up to 1.021 with six elements on a radius, 1.012 with eight and with ten) and only three periods of the
    block's lowest vibration to press it (0.5 %).
    """
    a, R, nu = 1e-3, 0.02, 0.3
    deepest = a * a / R
    material = Yeoh(C10_Pa=38.3, C20_Pa=0.0, poisson=nu)
    G = material.shear_modulus_Pa
    E = 2.0 * G * (1.0 + nu)
    plane = E / (1.0 - nu * nu)

    x = stations(a / 8.0, 1.25 * a, 8.0 * a, 1.4)
    mesh, outer, far_field = half_space(x, material)
    held = np.zeros(mesh.points.shape, dtype=bool)
    held[:, :2] = mesh.points[:, :2] == 0.0

    def hertz(d: np.ndarray) -> np.ndarray:
        return 4.0 / 3.0 * plane * np.sqrt(R) * d**1.5

    period = 4.0 * x[-1] / np.sqrt(G / material.density_kg_m3)
    duration = 3.0 * period
    far = PrescribedMotion(outer, lambda t: hertz(deepest * np.clip(t / duration, 0.0, 1.0))[:, None, None] * far_field)
    region = a * np.array([[-0.25, -0.25, -0.5], [1.5, 1.5, 0.5]])
    press = shift((0.0, 0.0, -deepest), (0.0, duration), (0.0, 1.0))
    ball = rigid_ball(R, (0.0, 0.0, R), spacing_m=a / 16.0, region=region, motion=press)
    model = Model(mesh, material, held, alpha_per_s=2.0 * np.pi / period, motion=far, bones=(ball,))
    ratios = []
    for snapshot in Transient(Simulation(model), duration).samples(duration / 12.0):
        d = deepest * snapshot.time_s / duration
        if d > 0.45 * deepest:
            ratios.append(-4.0 * snapshot.contact[0, 2] / hertz(d))
            assert snapshot.contact[0, BONE_DEPTH] < 0.02 * d
    record_property("force / Hertz", [float(r) for r in ratios])
    record_property("of which compliance", -1.5 / np.pi * plane / (CONTACT_STIFFNESS_PA_M * a))
    assert len(ratios) == 7
    np.testing.assert_allclose(ratios, 1.0, atol=0.015)


# ---- bones that move ----


def resting_block(mesh: HexMesh, motion: RigidMotion | None = None, *, friction: float = 0.0, tilt_rad: float = 0.0) -> Model:
    """A stiff block on a plate; its weight, which comes within 30 ms, leans by a tilt towards x."""
    down = G_M_S2 * np.array([np.sin(tilt_rad), 0.0, -np.cos(tilt_rad)])
    weight = replace(gravity_load(mesh, STIFF, down), profile=Profile.step(0.0, np.inf, 0.03))
    return model_of(mesh, STIFF, loads=(weight,), bones=(plate(motion=motion, friction=friction),))


def block_on_plate(start_m: float = -0.01) -> HexMesh:
    mesh = block_mesh((4, 4, 2), 0.005, distort=0.0)
    return replace(mesh, points=mesh.points + [start_m, -0.01, 0.0])


def test_a_plate_that_lifts_a_block(record_property):
    """External work is that of the weight and that of the plate, the integral of force times speed; the balance closes.

    The work is summed as the trapezoid of what is sampled here at every step: 1e-9 for the rounding of a thousand sums. The
    block meets the plate with up to the speed of the plate, several times as it jumps: ten times the bends of one touch.
    """
    up, times = 4e-3, (0.05, 0.13)
    model = resting_block(block_on_plate(), shift((0.0, 0.0, up), times, (0.0, 1.0)))
    simulation = Simulation(model)
    speed = up / (times[1] - times[0])
    dt = times[0] / np.ceil(times[0] / (0.8 * simulation.stable_limit(40)))  # so that the edges are on step boundaries
    snapshots = every_step(simulation, dt, 0.2)
    weight = model.loads[0].force_N
    instants = np.array([s.time_s for s in snapshots])
    scale = model.loads[0].profile.at(instants, tolerance_s=1e-9)
    height = np.array([(weight * s.displacement).sum() for s in snapshots])
    gravity = np.concatenate([[0.0], np.cumsum(0.5 * (scale[1:] + scale[:-1]) * np.diff(height))])
    force = np.array([s.contact[0, 2] for s in snapshots])
    moving = 0.5 * (np.sign(instants - times[0] + 1e-9) + np.sign(times[1] - instants + 1e-9))
    at_edge = np.minimum(np.abs(instants - times[0]), np.abs(instants - times[1])) < 1e-9
    power = force * speed * np.where(at_edge, 0.5, moving)
    lifted = np.concatenate([[0.0], np.cumsum(0.5 * dt * (power[1:] + power[:-1]))])
    external = np.array([s.energies[EXTERNAL] for s in snapshots])
    work = lifted[-1]
    assert work > 0.5 * G_M_S2 * simulation.nodal_mass.sum() * up
    record_property("off by", np.abs(external - gravity - lifted).max() / work)
    record_property("balance error", balance_error(snapshots) / work)
    assert np.abs(external - gravity - lifted).max() < 1e-9 * work
    assert balance_error(snapshots) < 10.0 * bend_error(snapshots, speed, dt)
    assert snapshots[-1].displacement[:, 2].mean() == pytest.approx(up, abs=0.1 * up)


def test_a_plate_that_turns_under_a_block():
    """The speed of a bone that turns differs from point to point: the balance closes to the bends, with friction too.

    The far edge of the block is met at 30 mm x 15 deg / 50 ms; it jumps and lands: ten times the bends of one touch.
    """
    turn = RigidMotion(
        np.zeros(3), np.radians([4.0, -15.0, 0.0]), np.array([0.0, 0.0, 2e-3]), np.array([0.04, 0.09]), np.array([0.0, 1.0])
    )
    model = resting_block(block_on_plate(), turn, friction=0.4)
    simulation = Simulation(model)
    dt = 0.04 / np.ceil(0.04 / (0.8 * simulation.stable_limit(40)))
    snapshots = every_step(simulation, dt, 0.12)
    assert (simulation.nodal_mass @ snapshots[-1].displacement[:, 2]) / simulation.nodal_mass.sum() > 1.5e-3
    assert balance_error(snapshots) < 10.0 * bend_error(snapshots, 0.03 * np.radians(15.0) / 0.05, dt)


# ---- friction ----


def slide(friction: float, tilt_rad: float, until_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Times, speed of the centre of mass along the plate, force of the plate (k, 3), at every half millisecond; the mass."""
    simulation = Simulation(resting_block(block_on_plate(-0.02), friction=friction, tilt_rad=tilt_rad))
    snapshots = list(Transient(simulation, until_s).samples(5e-4))
    mass = simulation.nodal_mass
    speed = np.array([mass @ s.velocity[:, 0] for s in snapshots]) / mass.sum()
    force = np.array([s.contact[0, :3] for s in snapshots])
    return np.array([s.time_s for s in snapshots]), speed, force, float(mass.sum())


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_block_slides_down(friction, record_property):
    """dv/dt = g (sin - mu cos), to 2 % of the speed at the end.

    Block and plate give way by g rho h / G and g rho h / k, microns; a speed of vibration of those over a period of a
    millisecond is 1 % of the speed at the end, and friction follows the normal force as it swings.
    """
    tilt = np.radians(20.0)
    times, speed, force, mass = slide(friction, tilt, 0.1)

    def acceleration(t, v):
        return [G_M_S2 * min(t / 0.03, 1.0) * (np.sin(tilt) - friction * np.cos(tilt))]

    expected = solve_ivp(acceleration, (0.0, times[-1]), [0.0], t_eval=times, rtol=1e-8, atol=1e-10).y[0]
    record_property("off by", np.abs(speed - expected).max() / expected[-1])
    assert expected[-1] > 0.02
    np.testing.assert_allclose(speed, expected, atol=0.02 * expected[-1])
    assert force[times > 0.05, 2].mean() == pytest.approx(G_M_S2 * mass * np.cos(tilt), rel=0.01)


@pytest.mark.parametrize("share", [0.3, 0.95, 1.05, 1.1])
def test_a_block_sticks_up_to_the_friction_angle(share, record_property):
    """Below the angle it stays, on tangential springs; above it slides, by g (sin - mu cos), to 0.5 % of g.

    Within 2 % of the angle it slips at its edges, and rocks.
    """
    tilt = np.radians(20.0)
    times, speed, *_ = slide(np.tan(tilt) / share, tilt, 0.1)
    late = times > 0.06
    slope = np.polyfit(times[late], speed[late], 1)[0]
    record_property("acceleration", slope)
    assert slope == pytest.approx(G_M_S2 * np.sin(tilt) * max(0.0, 1.0 - 1.0 / share), abs=5e-3 * G_M_S2)
    if share < 1.0:
        assert abs(speed[late]).max() < 5e-4


# ---- threads, and runs that go on ----


@cache
def busy() -> Model:
    """A block that is tied at its top and at one side to bones that give way and move, pulls, and lies on a plate that turns."""
    mesh = block_mesh((6, 7, 8), 0.005, seed=5)
    mesh = replace(mesh, points=mesh.points - [0.015, 0.0175, mesh.points[:, 2].min() + 2e-4])
    times, course = np.array([0.0, 0.02]), np.array([0.0, 1.0])
    turn = RigidMotion(np.zeros(3), np.radians([0.0, 5.0, 3.0]), np.array([0.0, 0.0, 5e-4]), times, course)
    ties = (
        Attachment("hyoid", *points_on_set(mesh, "z1"), stiffness_Pa_m=1e7, bone_stiffness_N_m=50.0),
        Attachment("jaw", *points_on_set(mesh, "x0"), stiffness_Pa_m=1e7, motion=turn),
    )
    rng = np.random.default_rng(4)
    stresses = []
    for k in range(3):
        elements = np.sort(rng.choice(mesh.element_count, mesh.element_count // 2, replace=False))
        direction = rng.standard_normal((len(elements), 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        ramp = Profile.step(0.002 * k, np.inf, 0.005)
        stresses.append(FibreStress(f"m{k}", elements, direction, rng.uniform(50.0, 400.0, len(elements)), ramp, k == 1))
    return model_of(
        mesh, YEOH, alpha_per_s=20.0, bones=(plate(motion=turn, friction=0.3),), attachments=ties, stresses=tuple(stresses)
    )


def hurried(threads: int) -> Simulation:
    mesh = busy().mesh
    velocity = [0.05, 0.02, -0.1] + 0.02 * np.random.default_rng(3).standard_normal((mesh.node_count, 3))
    return Simulation(busy(), velocity=velocity, threads=threads)


STEPS = 120
ROUNDING = 1e-11  # STEPS sums of a few 1e-16, grown at most STEPS-fold by a stable system and some ten times by touch and go


@pytest.mark.parametrize("count", [2, 3])
def test_several_threads_give_the_answer_of_one(count):
    alone, shared = hurried(1), hurried(count)
    assert len(alone.parts) == 1 and len(shared.parts) == count
    dt = 0.8 * alone.stable_limit(40)
    for simulation in (alone, shared):
        simulation.start(dt)
        for steps in (1, 7, STEPS - 8):
            assert simulation.advance(steps, dt)
    one, other = alone.snapshot(), shared.snapshot()
    assert one.contact[0, BONE_AREA] > 0.0 and one.energies[RUBBED] > 0.0
    for name in ("displacement", "velocity", "energies", "contact", "contact_pressure"):
        expected = getattr(one, name)
        np.testing.assert_allclose(getattr(other, name), expected, rtol=0.0, atol=ROUNDING * np.abs(expected).max(), err_msg=name)


@pytest.mark.parametrize("count", [1, 3])
def test_a_run_that_was_cut_goes_on_bit_for_bit(count):
    """Through Transient, whose step follows the limit; with several threads the sum of the muscles' work is regrouped: 1e-12."""
    end = 0.02
    through, first = Transient(hurried(count), end), Transient(hurried(count), end)
    for transient in (through, first):
        assert transient.advance_to(0.4 * end) is None
    kept = first.restart_state()
    assert first.simulation.snapshot().contact[0, BONE_AREA] > 0.0
    second = Transient(hurried(count), end)
    second.restore(kept)
    for transient in (through, second):
        assert transient.advance_to(end) is None
    assert second.simulation.steps == through.simulation.steps > 70
    one, other = through.simulation.snapshot(), second.simulation.snapshot()
    for name in ("displacement", "velocity", "contact", "contact_pressure"):
        assert np.array_equal(getattr(other, name), getattr(one, name)), name
    if count == 1:
        assert np.array_equal(other.energies, one.energies)
    np.testing.assert_allclose(other.energies, one.energies, rtol=0.0, atol=1e-12 * one.energies.max())


# ---- the tongue between palate and jaw ----


@cache
def vowel_i(resolution: str) -> Model:
    """[i] of the cadaver tissue by stress along fibres, between palate and jaw, tied to jaw and hyoid by area."""
    scenario = TransientScenario(
        title="[i]",
        model=ModelTable(
            name="tongue",
            resolution=resolution,
            material="gerard-2005",
            attachment="area",
            damping=Damping(alpha_per_s=40.0, beta_s=0.03),
        ),
        muscle=[MuscleTable(name=name, force_N=force, distribution="stress") for name, force in (("GGp", 2.0), ("GGa", 0.2))],
        bone=[BoneTable(name="palate"), BoneTable(name="jaw")],
        analysis=AnalysisTable(duration_ms=200.0),
    )
    return assemble(scenario, Path())[0]


def test_the_tongue_goes_no_deeper_into_bone_than_the_tissue_gives(record_property):
    """0.3 mm beyond its depth at rest at most, at any sample of 200 ms, and it rests on both; energies balance to 1e-3."""
    transient, ledger = Transient(Simulation(vowel_i("coarse")), 0.2), Ledger()
    depth = np.zeros(2)
    for snapshot in transient.samples(5e-4):
        ledger.add(snapshot)
        depth = np.maximum(depth, snapshot.contact[:, BONE_DEPTH])
    record_property("deepest in palate, jaw / mm", (1e3 * depth).tolist())
    record_property("balance error", ledger.balance_error)
    assert (snapshot.contact[:, BONE_AREA] > 0.0).all()
    assert depth.max() < 3e-4
    assert ledger.balance_error < 1e-3


def test_bones_leave_the_stable_step_as_it_is(record_property):
    """The limit with bones and without, of the same states at rest and in contact: 2 %.

    The points that bones add to have k A / m of up to 12 % of the square of the highest frequency; but the mode of that frequency
    lives elsewhere, or in few of them.
    """
    model = vowel_i("medium")
    simulation = Simulation(model)
    bare = Simulation(replace(model, bones=()))
    shares, areas = [], []
    for snapshot in Transient(simulation, 0.1).samples(0.01):
        state = simulation.restart_state()
        bare.restore(state | {"highest_mode": bare.restart_state()["highest_mode"]})
        shares.append(simulation.stable_limit(40) / bare.stable_limit(40))
        areas.append(snapshot.contact[:, BONE_AREA].sum())
    record_property("limits with bones / without", [float(s) for s in shares])
    assert areas[-1] > 0.0
    assert shares[0] == pytest.approx(1.0, abs=1e-4)
    np.testing.assert_allclose(shares, 1.0, atol=0.02)


def test_a_symmetric_tongue_between_bones_stays_symmetric(record_property):
    """u(x, -y, z) = (u_x, -u_y, u_z)(x, y, z) over 50 ms to 1e-9 of the largest displacement.

    The sides differ by rounding, some 1e-16 a step over 500 steps, which touch and go multiplies: by ten, it is seen.
    """
    model = vowel_i("coarse")
    points, mirror = model.mesh.points, np.array([1.0, -1.0, 1.0])
    distance, partner = cKDTree(points).query(points * mirror)
    assert distance.max() == 0.0
    simulation = Simulation(model)
    transient = Transient(simulation, 0.05)
    worst = 0.0
    for snapshot in transient.samples(5e-3):
        u, pressure = snapshot.displacement, snapshot.contact_pressure
        worst = max(worst, np.abs(u[partner] - u * mirror).max())
    record_property("deviation / mm", 1e3 * worst)
    assert snapshot.contact[:, BONE_AREA].max() > 0.0
    assert worst < 1e-9 * np.abs(u).max()
    np.testing.assert_allclose(pressure[:, partner], pressure, atol=1e-6 * pressure.max())


# ---- equilibria ----


@pytest.mark.parametrize("kept, name", [("bones", "bones"), ("attachments", "attachments"), ("stresses", "stresses")])
def test_a_relaxation_knows_none_of_it(kept, name):
    parts = {"bones": (), "attachments": (), "stresses": ()} | {kept: getattr(busy(), kept)}
    with pytest.raises(InputError, match=rf"^Relaxation: a model with {name} is not supported; .*\.$"):
        Relaxation(replace(busy(), **parts))
