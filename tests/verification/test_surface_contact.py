"""Contact between deformable surfaces: momentum, energy, closed forms, friction, self-contact, and bodies that overlap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from surface_bodies import moved, push_N

from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.joined import join
from explicitfe.fem.mesh.self_contact import self_penetration
from explicitfe.fem.model.gravity import gravity_load
from explicitfe.fem.model.model import Model, NodalLoad, PrescribedMotion
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.model.surface_contact import SurfaceContact
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import BARRIER, EXTERNAL, HOURGLASS, IN_CONTACT, INTERNAL, KINETIC, RUBBED
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.simulate.anatomy.loads import node_shares
from explicitfe.simulate.run.run import run

SOFT = NeoHooke(C10_Pa=2000.0, poisson=0.45)
EDGE_M = 0.02


def two_blocks(gap_m: float = 3e-4, cells: tuple[int, int] = (4, 3)) -> HexMesh:
    """Two cubes with non-matching meshes, the upper one shifted sideways by a few millimetres."""
    lower, upper = (box((n, n, n), 3 * (EDGE_M,)) for n in cells)
    return join({"lower": lower, "upper": moved(upper, (3e-3, 2e-3, EDGE_M + gap_m))})


def free(mesh: HexMesh) -> np.ndarray:
    return np.zeros((mesh.node_count, 3), dtype=bool)


@pytest.mark.parametrize(("along_m_s", "share"), [(0.0, 1e-4), (0.05, 1e-3)])
def test_a_collision_keeps_momentum_and_energy(along_m_s: float, share: float) -> None:
    """Momentum to rounding, angular momentum and energy without dampers too, and the same with two threads.

    A point that slides over an edge of the other body while it is pressed takes the energy of its spring along, or brings it.
    """
    mesh = two_blocks()
    upper = mesh.node_sets["upper"]
    velocity = np.zeros((mesh.node_count, 3))
    velocity[upper] = [along_m_s, 0.0, -0.2]
    ends = []
    for threads in (1, 2):
        contact = SurfaceContact(damping=0.0)
        body = Simulation(Model(mesh, SOFT, free(mesh), surfaces=contact), velocity=velocity, threads=threads)
        transient = Transient(body, 0.03, 2e-5)
        before = body.snapshot()
        mass = body.nodal_mass[:, None]
        touched = 0
        for time_s in np.arange(0.001, 0.0301, 0.001):
            assert transient.advance_to(time_s) is None or time_s > 0.0299
            now = body.snapshot()
            touched += int(body.surfaces.touches[0] > 0)
            momentum = (mass * now.velocity).sum(axis=0)
            assert np.abs(momentum - (mass * velocity).sum(axis=0)).max() < 1e-13 * np.abs(mass * velocity).sum()
            spin = np.cross(mesh.points + now.displacement, mass * now.velocity).sum(axis=0)
            at_first = np.cross(mesh.points, mass * velocity).sum(axis=0)
            assert np.abs(spin - at_first).max() < 1e-12 * np.abs(at_first).max()
            e = now.energies
            stored = e[[INTERNAL, HOURGLASS, KINETIC, IN_CONTACT, BARRIER]].sum()
            assert abs(stored - before.energies[KINETIC]) < share * before.energies[KINETIC]
            assert abs(e[EXTERNAL]) < share * before.energies[KINETIC]  # nothing pulls from outside
        assert touched > 3
        assert now.velocity[upper, 2].mean() > -0.1 and int(body.surfaces.touches[0]) == 0  # they have parted
        ends.append(now.displacement)
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


def test_dampers_and_friction_lose_what_is_missing() -> None:
    """Momentum and angular momentum are kept to rounding with friction too: the face gets the moment of the depth."""
    mesh = two_blocks()
    velocity = np.zeros((mesh.node_count, 3))
    velocity[mesh.node_sets["upper"]] = [0.1, 0.0, -0.2]
    lost = []
    for friction in (0.0, 0.5):
        body = Simulation(Model(mesh, SOFT, free(mesh), surfaces=SurfaceContact(friction=friction)), velocity=velocity)
        transient = Transient(body, 0.03, 2e-5)
        begin = body.snapshot().energies[KINETIC]
        transient.advance_to(0.03)
        now, mass = body.snapshot(), body.nodal_mass[:, None]
        spin = np.cross(mesh.points + now.displacement, mass * now.velocity).sum(axis=0)
        at_first = np.cross(mesh.points, mass * velocity).sum(axis=0)
        assert np.abs(spin - at_first).max() < 1e-12 * np.abs(at_first).max()
        e = now.energies
        assert abs(e[[INTERNAL, HOURGLASS, KINETIC, IN_CONTACT, BARRIER, RUBBED]].sum() - begin) < 2e-3 * begin
        assert abs(e[EXTERNAL]) < 2e-3 * begin
        lost.append(e[RUBBED])
    assert 0.0 < lost[0] < lost[1]


def test_a_mirrored_press_with_friction_is_mirrored() -> None:
    """A block is pressed 1 mm down and pulled 2 mm along x, so that it sticks and slides: it stays symmetric across y = 0.

    The friction of all points around a node brakes it at once; with that of each point alone a surface that sticks chatters, and
    rounding grows to 0.01 mm.
    """
    lower = moved(box((8, 8, 4), (0.02, 0.02, 0.01)), (-0.01, -0.01, 0.0))
    upper = moved(box((4, 4, 4), (0.01, 0.01, 0.01)), (-0.005, -0.005, 0.01001))
    mesh = join({"lower": lower, "upper": upper})
    top = mesh.node_sets["upper.z1"]

    def motion(times_s: np.ndarray) -> np.ndarray:
        share = np.clip(times_s / 0.05, 0.0, 1.0)
        return np.array([2e-3, 0.0, -1e-3]) * (share**2 * (3.0 - 2.0 * share))[:, None, None] * np.ones((1, len(top), 1))

    model = Model(
        mesh,
        SOFT,
        mesh.held("lower.z0"),
        60.0,
        motion=PrescribedMotion(top, motion),
        surfaces=SurfaceContact(friction=0.3),
    )
    body = Simulation(model)
    Transient(body, 0.05).advance_to(0.05)
    u = body.snapshot().displacement
    which = np.isin(np.arange(mesh.node_count), mesh.node_sets["upper"])[:, None]
    distance, mirror = cKDTree(np.hstack([mesh.points, which])).query(np.hstack([mesh.points * [1.0, -1.0, 1.0], which]))
    assert distance.max() < 1e-9
    assert np.abs(u - u[mirror] * [1.0, -1.0, 1.0]).max() < 1e-12


def test_two_blocks_pressed_together_have_the_pressure_of_the_closed_form() -> None:
    """A patch test: two blocks of one cross-section, meshes that do not match, free to widen on rollers.

    Under a uniform pressure the stress is uniform, and each block becomes as short as one alone; the resultant is exact. Points
    against faces pass a uniform pressure on in lumps, which the faces spread over their corners: that is the error of the method.
    """
    pressure_Pa = 300.0
    lower, upper = box((4, 4, 4), 3 * (EDGE_M,)), box((5, 5, 5), 3 * (EDGE_M,))
    mesh = join({"lower": lower, "upper": moved(upper, (0.0, 0.0, EDGE_M + 1e-6))})
    held = mesh.held("lower.z0", along="z")
    for name in ("lower", "upper"):
        held |= mesh.held(f"{name}.x0", along="x") | mesh.held(f"{name}.y0", along="y")
    top = mesh.node_sets["upper.z1"]
    force = np.zeros((len(top), 3))
    force[:, 2] = -pressure_Pa * EDGE_M**2 * node_shares(mesh, top)
    model = Model(mesh, SOFT, held, alpha_per_s=200.0, loads=(NodalLoad("press", top, force),), surfaces=SurfaceContact())
    body = Simulation(model)
    Transient(body, 0.25, None).advance_to(0.25)
    now = body.snapshot()
    assert now.energies[KINETIC] < 1e-6 * now.energies[INTERNAL]
    contact, count = body.surfaces, int(body.surfaces.touches[0])
    assert np.isclose(push_N(body) @ np.abs(contact.out[:count, 2]), pressure_Pa * EDGE_M**2, rtol=1e-6)
    # Each side carries half of it: the pressure at each point, of which the penalty sees the depth.
    stiffness, doubled_m = contact.stiffness.min(), contact.growth.min()
    depth = contact.out[:count, 3]
    assert np.abs(stiffness * depth * (1.0 + depth / doubled_m) / pressure_Pa - 1.0).max() < 0.25
    for face in ("lower.z1", "upper.z0"):  # nodes inside of the interface: the error of the patch test
        nodes = mesh.node_sets[face]
        away = np.abs(mesh.points[nodes, :2] - 0.5 * EDGE_M).max(axis=1)
        inner = now.surface_pressure[nodes[away < 0.49 * EDGE_M]]
        assert len(inner) and np.abs(inner / pressure_Pa - 1.0).max() < 0.01
    alone = Model(
        upper,
        SOFT,
        upper.held("z0", along="z") | upper.held("x0", along="x") | upper.held("y0", along="y"),
        alpha_per_s=200.0,
        loads=(NodalLoad("press", upper.node_sets["z1"], force),),
    )
    one = Simulation(alone)
    Transient(one, 0.25, None).advance_to(0.25)
    shortened = one.snapshot().displacement[upper.node_sets["z1"], 2].mean()
    both = now.displacement[top, 2].mean()
    overlap_m = 0.5 * doubled_m * (np.sqrt(1.0 + 4.0 * pressure_Pa / (stiffness * doubled_m)) - 1.0)
    assert np.isclose(both, 2.0 * shortened - 1e-6 - overlap_m, rtol=1e-3)
    assert np.ptp(now.displacement[mesh.node_sets["lower.z1"], 2]) < 0.005 * abs(shortened)  # the interface stays flat


def test_a_block_slides_on_another() -> None:
    """Without friction it keeps its speed; with it, it slows down by mu g (Coulomb)."""
    lower = box((8, 3, 2), (0.08, 0.03, 0.02))
    upper = moved(box((2, 2, 2), 3 * (EDGE_M,)), (0.005, 0.005, 0.02 + 1e-6))
    mesh = join({"lower": lower, "upper": upper})
    stiff = NeoHooke(C10_Pa=100000.0, poisson=0.45)
    block = mesh.node_sets["upper"]
    for friction in (0.0, 0.3):
        model = Model(
            mesh,
            stiff,
            mesh.held("lower.z0"),
            loads=(gravity_load(mesh, stiff, (0.0, 0.0, -9.81)),),
            surfaces=SurfaceContact(friction=friction),
        )
        velocity = np.zeros((mesh.node_count, 3))
        velocity[block, 0] = 0.4
        body = Simulation(model, velocity=velocity)
        transient = Transient(body, 0.1, None)
        mass = body.nodal_mass[block]
        speeds = []
        for time_s in (0.03, 0.1):
            transient.advance_to(time_s)
            speeds.append(float(mass @ body.snapshot().velocity[block, 0] / mass.sum()))
        slowing = (speeds[0] - speeds[1]) / 0.07
        assert np.isclose(slowing, friction * 9.81, rtol=0.03, atol=0.05)


def test_a_strip_that_is_bent_onto_itself_stays_outside_of_itself() -> None:
    """A hairpin whose legs are pressed together within 0.2 s."""
    mesh = box((24, 2, 2), (0.12, 0.01, 0.005))
    x, y, z = mesh.points.T
    angle = np.clip((x - 0.04) / 0.04, 0.0, 1.0) * np.pi
    radius = 0.04 / np.pi
    r = radius - (z - 0.0025)
    bend = np.column_stack([0.04 + r * np.sin(angle), y, radius - r * np.cos(angle)])
    flat = x < 0.04
    back = x > 0.08
    bend[flat] = np.column_stack([x, y, z - 0.0025])[flat]
    bend[back] = np.column_stack([0.12 - x, y, 2.0 * radius - (z - 0.0025)])[back]
    hairpin = HexMesh(bend, mesh.hexes, {"end": mesh.node_sets["x0"]})
    held = hairpin.held("end")
    upper = np.flatnonzero(back & np.isclose(z, 0.0))
    force = np.zeros((len(upper), 3))
    force[:, 2] = -0.03 / len(upper)
    ramp = Profile.step(0.0, np.inf, 0.2)
    deepest = []
    for surfaces in (None, SurfaceContact()):
        model = Model(hairpin, SOFT, held, alpha_per_s=60.0, loads=(NodalLoad("close", upper, force, ramp),), surfaces=surfaces)
        body = Simulation(model)
        transient = Transient(body, 0.4, None)
        depths = []
        for time_s in np.arange(0.02, 0.401, 0.02):
            transient.advance_to(time_s)
            depths.append(self_penetration(hairpin, body.snapshot().displacement).deepest_m)
        deepest.append(max(depths))
    assert deepest[0] > 1e-3  # without contact the legs pass through each other
    assert deepest[1] < 3e-4


PRESS = """
title = "Press and let go"
[model]
box_mm = [20.0, 20.0, 10.0]
cells = [{twice}, {twice}, {cells}]
fixed = ["z0"]
material = {{ law = "neo-hooke", C10_Pa = 50000.0, poisson = 0.45 }}
damping = {{ alpha_per_s = 60.0 }}
[[body]]
name = "top"
box_mm = [10.0, 10.0, 10.0]
cells = [{cells}, {cells}, {cells}]
shift_mm = [5.0, 5.0, 10.2]
fixed = []
[[support]]
name = "top.z1"
normal_kPa_per_mm = 2000.0
tangential_kPa_per_mm = 2000.0
shift_mm = [0.0, 0.0, -2.0]
table = [[0.0, 0.0], [40.0, 1.0], [80.0, 0.0]]
[analysis]
duration_ms = 100.0
[record]
every_ms = 2.0
"""
PRESSED_MM = 0.06  # 3 % of the way that the upper block is pressed


def test_a_block_is_pressed_into_another_one(tmp_path: Path) -> None:
    """The overlap is a small part of the way on any mesh, and becomes smaller on finer ones; the history has it."""
    overlaps = []
    for cells in (2, 4):
        scenario = tmp_path / f"press-{cells}.toml"
        scenario.write_text(PRESS.format(cells=cells, twice=2 * cells))
        summary = run(scenario, tmp_path)
        assert summary["status"] == "finished" and summary["energy_balance_error"] < 1e-3
        with open_result(Path(summary["result"])) as result:
            overlaps.append(1e3 * result.history("contact_body_top_depth").max())
            assert result.history("contact_body_body_depth").max() == 0.0
            assert result.probe("z1")[:, 2].min() == pytest.approx(-6.9e-4, rel=0.05)
    assert 0.0 < overlaps[1] < overlaps[0] < PRESSED_MM


def test_a_run_ends_where_a_body_goes_through_another(tmp_path: Path) -> None:
    """With contact that is hardly stiff the block goes half an edge deep; an overlap before is a warning."""
    scenario = tmp_path / "press.toml"
    scenario.write_text(PRESS.format(cells=4, twice=8) + "[contact]\nstiffness_kPa_per_mm = 0.05\n")
    summary = run(scenario, tmp_path)
    assert summary["status"] == "crossed" and '"body" and "top" in each other' in summary["message"]
    weak = run(scenario, tmp_path, settings=["contact.stiffness_kPa_per_mm=5.0"], overwrite=True)
    assert weak["status"] == "finished" and any('"body" and "top" in each other' in text for text in weak["warnings"])


@pytest.mark.parametrize(("E_Pa", "speed_m_s"), [(7.5e3, 2.0), (1e5, 10.0), (5.8e6, 30.0)])
@pytest.mark.parametrize("cells", [(2, 2), (4, 3)])
def test_fast_bodies_do_not_pass_each_other(E_Pa: float, speed_m_s: float, cells: tuple[int, int]) -> None:
    """Up to half of the speed of sound: the cubes part, with all momentum and, without a damper, all energy."""
    law = NeoHooke(C10_Pa=E_Pa / 5.8, poisson=0.45)
    mesh = two_blocks(2e-4, cells)
    upper, lower = mesh.node_sets["upper"], mesh.node_sets["lower"]
    velocity = np.zeros((mesh.node_count, 3))
    velocity[upper, 2] = -speed_m_s
    body = Simulation(Model(mesh, law, free(mesh), surfaces=SurfaceContact(damping=0.0)), velocity=velocity)
    duration_s = 2e-4 / speed_m_s + 8.0 * EDGE_M / np.sqrt(3.8 * E_Pa / law.density_kg_m3)
    assert Transient(body, duration_s).advance_to(duration_s) is None
    now, mass = body.snapshot(), body.nodal_mass[:, None]
    place = mesh.points + now.displacement
    assert place[upper, 2].mean() - place[lower, 2].mean() > EDGE_M
    assert now.velocity[upper, 2].mean() > now.velocity[lower, 2].mean()
    assert np.abs((mass * (now.velocity - velocity)).sum(axis=0)).max() < 1e-12 * np.abs(mass * velocity).sum()
    spin = [np.cross(x, mass * v).sum(axis=0) for x, v in ((mesh.points, velocity), (place, now.velocity))]
    assert np.abs(spin[1] - spin[0]).max() < 1e-9 * np.abs(mass * velocity).sum() * EDGE_M
    begun = 0.5 * (mass * velocity**2).sum()
    stored = now.energies[[INTERNAL, HOURGLASS, KINETIC, IN_CONTACT, BARRIER]].sum()
    assert stored == pytest.approx(begun, rel=2e-3)


@pytest.mark.parametrize("thickness_m", [0.5e-3, 1e-3])
def test_a_thin_plate_is_hit_and_not_passed(thickness_m: float) -> None:
    """A cube at 5 m/s on a plate of one element, thinner than 0.3 of its edges: it stays on its side of the plate."""
    plate, cube = box((12, 12, 1), (0.03, 0.03, thickness_m)), box((4, 4, 4), 3 * (0.008,))
    mesh = join({"plate": plate, "cube": moved(cube, (0.0113, 0.0107, thickness_m + 3e-4))})
    sides = [mesh.held(f"plate.{side}") for side in ("x0", "x1", "y0", "y1")]
    velocity = np.zeros((mesh.node_count, 3))
    velocity[mesh.node_sets["cube"], 2] = -5.0
    law = NeoHooke(C10_Pa=1e5 / 5.8, poisson=0.45)
    body = Simulation(Model(mesh, law, np.logical_or.reduce(sides), surfaces=SurfaceContact()), velocity=velocity)
    transient = Transient(body, 4e-3)
    deepest_m = 0.0
    for time_s in np.linspace(1e-4, 4e-3, 40):
        assert transient.advance_to(time_s) is None or time_s > 3.9e-3
        deepest_m = max(deepest_m, body.surfaces.out[: body.surfaces.touches[0], 3].max(initial=0.0))
    assert 0.0 < deepest_m < 0.1 * 2.5e-3
    place = mesh.points + body.snapshot().displacement
    middle = mesh.node_sets["plate"][np.abs(mesh.points[mesh.node_sets["plate"], :2] - 0.015).max(axis=1) < 3e-3]
    assert place[middle, 2].max() < place[mesh.node_sets["cube.z0"], 2].max() + deepest_m
    assert place[middle, 2].max() < -1e-3


def test_bodies_that_overlap_at_rest_are_refused() -> None:
    mesh = two_blocks(gap_m=-5e-4)
    with pytest.raises(
        InputError, match=r'two bodies overlap \("lower" and "upper"\) at rest: .* 0\.5 mm deep .*move them apart'
    ):
        Simulation(Model(mesh, SOFT, free(mesh), surfaces=SurfaceContact()))
    with pytest.raises(InputError, match="friction"):
        SurfaceContact(friction=-1.0)
