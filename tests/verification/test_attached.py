"""Masses, follower forces, hanging weights, drag, foundations, the release: closed forms, and the energy balance of each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.surface_points import points_on_set, projected_areas, surface_within
from explicitfe.fem.model.attached import AirDrag, AttachedMass, FollowerLoad, HangingWeight
from explicitfe.fem.model.gravity import gravity_load, nodal_mass
from explicitfe.fem.model.model import Attachment, Model, NodalLoad
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.held import held_shape
from explicitfe.fem.solve.observe import Snapshot
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import BARRIER, DAMPED, EXTERNAL, HOURGLASS, IN_TIES, INTERNAL, KINETIC, LOST
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.simulate.anatomy.loads import node_shares
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.run.notes import BALANCE_WARNING_SHARE
from explicitfe.simulate.run.run import run
from explicitfe.simulate.scenario.read import read_transient

# A stiff block: under these forces its deformation is below 1e-4 of its rigid displacement.
STIFF = NeoHooke(C10_Pa=1e6, poisson=0.45)
BLOCK = box((2, 2, 2), (0.02, 0.02, 0.02))
NODAL = nodal_mass(BLOCK, STIFF)
MASS_KG = float(NODAL.sum())
EVERY, EQUAL = np.arange(BLOCK.node_count), NODAL / MASS_KG
FREE = np.zeros((BLOCK.node_count, 3), dtype=bool)
DOWN = np.array([0.0, 0.0, -9.81])
# A cantilever that is slender enough for beam theory, fixed at x = 0.
SOFT = NeoHooke(C10_Pa=5e4, poisson=0.49)
L, H, E = 0.1, 0.01, 6.0 * SOFT.C10_Pa
BEAM = box((16, 2, 2), (L, H, H))
TIP = BEAM.node_sets["x1"]
SHARE = node_shares(BEAM, TIP)
HELD, LOOSE = BEAM.held("x0"), np.zeros((BEAM.node_count, 3), dtype=bool)
BENDING = 3.0 * E * H**4 / 12.0 / L**3  # stiffness of the tip [N/m]
MOST_IMBALANCE = 1e-3


def tip_load(force_N: float) -> NodalLoad:
    return NodalLoad("F", TIP, SHARE[:, None] * np.array([[0.0, 0.0, force_N]]))


def samples(model: Model, duration_s: float, every_s: float) -> Iterator[Snapshot]:
    """Samples of a run whose energy balance is checked at the end."""
    largest, imbalance = 0.0, 0.0
    for sample in Transient(Simulation(model, threads=1), duration_s).samples(every_s):
        e = sample.energies
        stored = e[INTERNAL] + e[HOURGLASS] + e[BARRIER] + e[KINETIC] + e[DAMPED] + e[LOST] + e[IN_TIES]
        largest = max(largest, e[INTERNAL] + e[KINETIC], abs(e[EXTERNAL]))
        imbalance = max(imbalance, abs(stored - e[EXTERNAL]))
        yield sample
    assert imbalance < MOST_IMBALANCE * largest


def drift(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) and displacement (k, 3) m of the centre of mass of the block."""
    rows = [(s.time_s, EQUAL @ s.displacement) for s in samples(model, 0.02, 0.005)]
    return np.array([t for t, _ in rows]), np.array([u for _, u in rows])


def test_an_attached_mass_is_accelerated_too() -> None:
    """A force F on a block with a mass m: x = F t^2 / 2 (M + m); under gravity all fall alike."""
    heavy = AttachedMass("m", EVERY, 0.02 * EQUAL)
    force = NodalLoad("F", EVERY, EQUAL[:, None] * np.array([[0.1, 0.0, 0.0]]))
    times, u = drift(Model(BLOCK, STIFF, FREE, loads=(force,), masses=(heavy,)))
    assert np.abs(u[:, 0] - 0.05 * times**2 / (MASS_KG + 0.02)).max() < 1e-6 * u[-1, 0]
    fall = gravity_load(BLOCK, STIFF, tuple(DOWN), masses=(heavy,))
    times, u = drift(Model(BLOCK, STIFF, FREE, loads=(fall,), masses=(heavy,)))
    assert np.abs(u[:, 2] + 0.5 * 9.81 * times**2).max() < 1e-6 * abs(u[-1, 2])


def test_damping_of_the_tissue_spares_attached_masses() -> None:
    """A block of mass M with a mass m, damped by alpha: v = v0 exp(-alpha M t / (M + m))."""
    start = np.tile([0.5, 0.0, 0.0], (BLOCK.node_count, 1))
    heavy = AttachedMass("m", EVERY, MASS_KG * EQUAL)
    simulation = Simulation(Model(BLOCK, STIFF, FREE, alpha_per_s=30.0, masses=(heavy,)), velocity=start, threads=1)
    for sample in Transient(simulation, 0.1).samples(0.025):
        assert abs(EQUAL @ sample.velocity[:, 0] - 0.5 * np.exp(-15.0 * sample.time_s)) < 1e-3


@pytest.mark.parametrize("mass_kg", [0.0, 0.01])
def test_a_mass_at_the_tip_slows_the_swing(mass_kg: float) -> None:
    """omega^2 = 3 E I / (L^3 (m + 33 M / 140)) (Rayleigh), within 5 %, by which mesh and fixed section stiffen it."""
    masses = (AttachedMass("m", TIP, mass_kg * SHARE),) if mass_kg else ()
    model = Model(BEAM, SOFT, HELD, loads=(tip_load(-0.002),), masses=masses, barrier=False)
    half_s = np.pi / np.sqrt(BENDING / (mass_kg + 33.0 / 140.0 * SOFT.density_kg_m3 * L * H * H))
    rows = [(s.displacement[TIP, 2].mean(), s.time_s) for s in samples(model, 1.4 * half_s, 0.01 * half_s)]
    assert abs(min(rows)[1] / half_s - 1.0) < 0.05


def test_drag_slows_a_block_down() -> None:
    """Linear: v = v0 exp(-c A t / M). Quadratic: v = v0 / (1 + v0 q A t / M). The silhouette A is 4 cm^2."""
    assert np.allclose(projected_areas(BLOCK).sum(axis=0), 4e-4)
    v0, c, q = 0.5, 40.0, 60.0
    for air, quadratic in ((AirDrag(linear_Pa_s_m=c), False), (AirDrag(quadratic_kg_m3=q), True)):
        start = np.tile([v0, 0.0, 0.0], (BLOCK.node_count, 1))
        simulation = Simulation(Model(BLOCK, STIFF, FREE, air=air), velocity=start, threads=1)
        for sample in Transient(simulation, 0.2).samples(0.05):
            t = sample.time_s
            expected = v0 / (1.0 + v0 * q * 4e-4 * t / MASS_KG) if quadratic else v0 * np.exp(-c * 4e-4 * t / MASS_KG)
            assert abs(EQUAL @ sample.velocity[:, 0] - expected) < 2e-3 * v0


def test_a_follower_force_turns_with_the_body() -> None:
    """A couple of follower forces on a free block keeps its moment M: the angle is M t^2 / 2 I, far beyond small angles."""
    right, left = BLOCK.node_sets["x1"], BLOCK.node_sets["x0"]
    X = BLOCK.points - BLOCK.points.mean(axis=0)
    inertia, force, turned = float(NODAL @ (X[:, 0] ** 2 + X[:, 2] ** 2)), 0.02, 0.0
    pulls = tuple(
        FollowerLoad(name, nodes, NODAL[nodes, None] / NODAL[nodes].sum() * np.array([[0.0, 0.0, sign * force]]))
        for name, nodes, sign in (("right", right, 1.0), ("left", left, -1.0))
    )
    for sample in samples(Model(BLOCK, STIFF, FREE, followers=pulls), 0.12, 0.03):
        x = X + sample.displacement
        assert np.abs(NODAL @ sample.velocity).max() < 1e-9  # no resultant
        across = x[right].mean(axis=0) - x[left].mean(axis=0)
        angle = float(np.arctan2(across[2], across[0]))
        turned = 0.5 * 2.0 * force * 0.01 / inertia * sample.time_s**2
        assert abs(np.remainder(angle - turned + np.pi, 2.0 * np.pi) - np.pi) < 5e-3
    assert turned > np.pi


def test_a_weight_falls_until_its_string_is_taut() -> None:
    """Free fall for sqrt(2 slack / g); afterwards block and weight share the momentum m g t."""
    mass, slack = 0.02, 0.002
    weight = HangingWeight("w", EVERY, EQUAL, mass, DOWN, slack)
    caught = np.sqrt(2.0 * slack / 9.81)
    simulation = Simulation(Model(BLOCK, STIFF, FREE, weights=(weight,)), threads=1)
    for sample in Transient(simulation, 0.05).samples(0.002):
        v = float(-(EQUAL @ sample.velocity[:, 2]))
        if sample.time_s < caught - 5e-4:
            assert abs(v) < 1e-12
        elif sample.time_s > caught + 0.01:
            momentum = MASS_KG * v + mass * simulation.loads.weights.state[0, 1]
            assert abs(momentum - mass * 9.81 * sample.time_s) < 5e-3 * momentum


def test_a_weight_moves_once_in_the_step_that_ends_a_run() -> None:
    """It falls freely, v = g t up to rounding, while an element inverts. Its pull needs all forces, so there is one thread."""
    mesh = box((4, 4, 4), (0.04, 0.04, 0.04))
    velocity = np.zeros_like(mesh.points)
    velocity[0] = 1000.0
    weight = HangingWeight("w", np.array([mesh.node_count - 1]), np.ones(1), 1e-3, DOWN, 1.0)
    model = Model(mesh, STIFF, np.zeros((mesh.node_count, 3), dtype=bool), barrier=False, weights=(weight,))
    simulation = Simulation(model, velocity=velocity, threads=2)
    assert Transient(simulation, 0.1).advance_to(0.1) is not None and len(simulation.parts) == 1
    expected = np.linalg.norm(DOWN) * (simulation.time_s - 0.5 * simulation.dt_s)
    assert simulation.loads.weights.state[0, 1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("sag_m", [2.5e-5, 2.5e-4, 5e-3])
def test_the_period_of_a_hanging_mass_is_that_of_an_attached_one(sag_m: float) -> None:
    """A bar of stiffness k = E A / L, with poisson 0, holds m: it swings with 2 pi sqrt(m / k) about its sag m g / k.

    Strains of up to 20 % soften the law in both. The bar has 1/800 of the mass of the weight.
    """
    mass_kg, across_m, along_m = 0.01, 0.01, 0.05
    stiffness = mass_kg * 9.81 / sag_m
    law = NeoHooke(C10_Pa=0.25 * stiffness * along_m / across_m**2, poisson=0.0, density_kg_m3=2.5)
    bar = box((10, 2, 2), (along_m, across_m, across_m))
    end, share = bar.node_sets["x1"], node_shares(bar, bar.node_sets["x1"])
    gravity = np.array([9.81, 0.0, 0.0])
    hanging = {"weights": (HangingWeight("w", end, share, mass_kg, gravity),)}
    masses = AttachedMass("m", end, share * mass_kg)
    attached = {"masses": (masses,), "loads": (NodalLoad("g", end, share[:, None] * mass_kg * gravity),)}
    period_s = 2.0 * np.pi * np.sqrt(mass_kg / stiffness)
    paths = []
    for extra in (hanging, attached):
        run = samples(Model(bar, law, bar.held("x0"), barrier=False, **extra), 2.0 * period_s, 0.05 * period_s)  # type: ignore[arg-type]
        paths.append([share @ sample.displacement[end, 0] for sample in run])
    assert np.abs(np.subtract(*paths)).max() < 0.01 * np.max(paths)
    assert sag_m > 1e-3 or np.max(paths) == pytest.approx(2.0 * sag_m, rel=0.01)


def test_a_weight_on_a_string_is_its_weight_at_rest() -> None:
    ends = []
    for extra in ({"weights": (HangingWeight("w", TIP, SHARE, 2e-4, DOWN),)}, {"loads": (tip_load(-2e-4 * 9.81),)}):
        model = Model(BEAM, SOFT, HELD, alpha_per_s=60.0, barrier=False, **extra)  # type: ignore[arg-type]
        *_, last = samples(model, 0.6, 0.1)
        ends.append(last.displacement[TIP, 2].mean())
    assert abs(ends[0] / ends[1] - 1.0) < 2e-3


@pytest.mark.parametrize(("normal", "tangential"), [(2e7, 2e7), (2e7, 1e9), (1e9, 2e7)])
def test_a_foundation_shifts_and_turns(normal: float, tangential: float) -> None:
    """Under a tip force F the tip moves by F / k_t A + F L^2 / k_n I more than on a fixed end.

    A fixed end stops the contraction of the section and a foundation does so in part, which is 5 % of the beam's own sag.
    """
    F = 0.002
    points, areas = points_on_set(BEAM, "x0")
    clamp = Attachment("clamp", points, areas, tangential, normal_stiffness_Pa_m=normal)
    ends = []
    for held, ties in ((LOOSE, (clamp,)), (HELD, ())):
        model = Model(BEAM, SOFT, held, loads=(tip_load(-F),), alpha_per_s=25.0, barrier=False, attachments=ties)
        *_, last = samples(model, 0.8, 0.2)
        ends.append(-last.displacement[TIP, 2].mean())
    expected = F / (tangential * H**2) + F * L**2 / (normal * H**4 / 12.0)
    assert abs(ends[0] - ends[1] - expected) < 0.03 * expected + 0.05 * ends[1]


def test_a_held_shape_is_an_equilibrium_until_the_release() -> None:
    """The end face is held 1 mm to the side without turning: 12 E I u / L^3. Nothing moves before the release.

    Both ends stop the contraction of their section, and each makes the beam 4 % stiffer.
    """
    shift = np.array([0.0, 1e-3, 0.0])
    model = Model(BEAM, SOFT, HELD, loads=(gravity_load(BEAM, SOFT, (0.0, 0.0, -0.5)),), barrier=False)
    displacement, force = held_shape(model, TIP, shift)
    assert np.abs(displacement[TIP] - shift).max() < 1e-12
    assert abs(force[:, 1].sum() / (4.0 * BENDING * 1e-3) - 1.0) < 0.1
    holding = NodalLoad("release", TIP, force, Profile(np.array([0.02, 0.03]), np.array([1.0, 0.0])))
    held = Model(BEAM, SOFT, HELD, loads=(*model.loads, holding), barrier=False)
    simulation = Simulation(held, displacement=displacement, threads=1)
    moved = [np.abs(s.displacement - displacement).max() for s in Transient(simulation, 0.1).samples(0.01)]
    assert max(moved[:3]) < 0.01 * 1e-3 and max(moved[4:]) > 0.5e-3


def test_a_release_keeps_the_jumps_of_a_load() -> None:
    """A load that starts at 10 ms under a release from 5 to 25 ms: 0 before, then the ramp, whose value at 10 ms is 1 / 4."""
    load = Profile.step(0.01).times_ramp(0.005, 0.02)
    times = np.array([0.0, 0.0099, 0.0101, 0.02, 0.03])
    assert np.allclose(load.at(times, tolerance_s=0.0), [0.0, 0.0, 0.255, 0.75, 1.0])
    at_once = Profile.constant().times_ramp(0.005, 0.0)
    assert np.allclose(at_once.at(np.array([0.004, 0.006]), tolerance_s=0.0), [0.0, 1.0])


SCENARIO = """title = "beam"
[model]
box_mm = [100.0, 10.0, 10.0]
cells = [10, 2, 2]
material = {{ law = "neo-hooke", C10_Pa = 50000.0, poisson = 0.49 }}
gravity_m_s2 = [0.0, 0.0, -2.0]
damping = {{ alpha_per_s = 20.0 }}
{tables}
[analysis]
duration_ms = 60.0
[record]
every_ms = 10.0
fields = ["displacement"]
"""
LOADED = """[[load]]
nodes = ["x1", "z1"]
force_N = [0.0, 0.0, -0.002]
follows = true
start_ms = 10.0
[[load]]
at_mm = [50.0, 5.0, 10.0]
mass_g = 1.0
[[load]]
nodes = ["x1"]
mass_g = 0.5
string_slack_mm = 0.1
[[support]]
name = "x0"
normal_kPa_per_mm = 500.0
tangential_kPa_per_mm = 300.0
[release]
over_ms = 5.0
[air]
linear_Pa_s_m = 1.0
drag_coefficient = 1.5
"""


def write(folder: Path, tables: str) -> Path:
    path = folder / "beam.toml"
    path.write_text(SCENARIO.format(tables=tables), encoding="utf-8")
    return path


def test_a_scenario_has_all_of_them(tmp_path: Path) -> None:
    path = write(tmp_path, LOADED)
    model = assemble(read_transient(path), tmp_path).model
    assert [load.name for load in model.followers] == ["load.1"] and len(model.followers[0].nodes) == 3
    assert abs(sum(m.mass_kg.sum() for m in model.masses) - 1e-3) < 1e-15
    assert model.weights[0].slack_m == 1e-4 and model.air is not None and model.air.quadratic_kg_m3 == pytest.approx(0.9)
    assert not model.held.any() and model.attachments[0].normal_stiffness_Pa_m == 5e8
    summary = run(path, tmp_path)
    assert summary["status"] == "finished" and summary["energy_balance_error"] < MOST_IMBALANCE  # type: ignore[typeddict-item]


@pytest.mark.parametrize("at_ms", [20.0, 20.0033, 33.3333])
def test_a_release_begins_at_its_time(at_ms: float, tmp_path: Path) -> None:
    """A free body falls by g t^2 / 2 from the release on, to less than a fiftieth of a step of 38 microseconds."""
    path = write(tmp_path, f"[release]\nat_ms = {at_ms}")
    summary = run(path, tmp_path, settings=["model.fixed=[]", "model.damping.alpha_per_s=0.0"])
    with open_result(summary["result"]) as result:
        fallen = np.array([-result.displacement(k)[:, 2].mean() for k in range(len(result.times))])
        since_s = np.array(result.times) - 1e-3 * at_ms
    assert np.all(fallen[since_s < 0.0] == 0.0)
    later = since_s > 0.01
    assert np.abs(np.sqrt(fallen[later]) - since_s[later]).max() < 8e-7
    assert [warning.split(",")[0] for warning in summary["warnings"]] == ["nothing holds the body"]  # forces are not too large


def test_a_short_release_is_no_reason_to_doubt_the_time_step(tmp_path: Path) -> None:
    """The error of the energy balance is large relative to the energies where the release begins, not to those of the run."""
    path = write(tmp_path, "[release]\nover_ms = 0.5")
    summary = run(path, tmp_path, settings=["record.every_ms=0.5"])
    assert summary["energy_balance_error"] > BALANCE_WARNING_SHARE  # type: ignore[typeddict-item]
    assert not any("energy balance" in warning for warning in summary["warnings"])


def test_the_weight_of_a_body_in_a_wrong_unit_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, "")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("100.0, 10.0, 10.0", "5000.0, 5000.0, 5000.0"), encoding="utf-8")
    with pytest.raises(
        InputError, match=r"the mesh is 5000 mm long, and the weight at one of its nodes is \d+ N.*the unit of length"
    ):
        assemble(read_transient(path), tmp_path)


def test_a_load_is_spread_over_a_disc(tmp_path: Path) -> None:
    """Of a disc on a face: its area on any mesh, its centre, and the second moment R^2 / 4 of an even load."""
    place, radius = np.array([0.02, 0.01, 0.03]), 0.006
    for cells in ((3, 2, 2), (7, 5, 4), (12, 12, 12)):
        points, areas = surface_within(box(cells, (0.04, 0.03, 0.03)), place, radius)
        away = points.position - place
        assert np.isclose(areas.sum(), np.pi * radius**2, rtol=0.04)
        assert np.allclose(areas @ away / areas.sum(), 0.0, atol=0.02 * radius)
        assert np.allclose(areas @ away[:, :2] ** 2 / areas.sum(), 0.25 * radius**2, rtol=0.08)
    path = write(tmp_path, "[[load]]\nat_mm = [50.0, 5.0, 10.0]\nradius_mm = 4.0\nforce_N = [0.0, 0.0, -0.01]")
    model = assemble(read_transient(path), tmp_path).model
    load = model.loads[0]
    assert isinstance(load, NodalLoad) and np.allclose(load.force_N.sum(axis=0), [0.0, 0.0, -0.01], rtol=1e-12)
    mirrored = {
        tuple(np.round(1e6 * x).astype(int)): f for x, f in zip(model.mesh.points[load.nodes], load.force_N[:, 2], strict=True)
    }
    for (x, y, z), force in mirrored.items():
        assert np.isclose(force, mirrored[x, 10000 - y, z], rtol=1e-9)


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        ('[[load]]\nnodes = ["x1", "x0"]\nforce_N = [0.0, 0.0, 1.0]', "no node is in all of x1, x0"),
        ('[[load]]\nnodes = ["tip"]\nforce_N = [0.0, 0.0, 1.0]', "tip"),
        ("[[load]]\nat_mm = [50.0, 5.0, 20.0]\nmass_g = 1.0", "10 mm outside"),
        ('[[load]]\nnodes = ["x1"]\nradius_mm = 3.0\nmass_g = 1.0', "radius_mm goes with at_mm"),
        ("[[load]]\nat_mm = [25.0, 5.0, 5.0]\nradius_mm = 1.0\nmass_g = 1.0", "no part of the surface lies within 1 mm"),
        ('[[load]]\nnodes = ["x1"]', "give force_N, pressure_kPa, body_force_N_m3 or mass_g"),
        ('[[load]]\nnodes = ["x1"]\nmass_g = 1.0\nstart_ms = 5.0', "there from the start"),
        ('[[load]]\nnodes = ["x1"]\nmass_g = 1.0\nstring_slack_mm = 0.0\n[release]\nhold = ["x1"]', "mass on a string"),
        ("[release]\nshift_mm = [0.0, 1.0, 0.0]", "shift_mm needs hold"),
        ('[[support]]\nname = "x0"\nnormal_kPa_per_mm = 0.0\ntangential_kPa_per_mm = 1.0', "normal_kPa_per_mm"),
    ],
)
def test_what_cannot_be_loaded_is_refused(tables: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=sentence) as refused:
        assemble(read_transient(write(tmp_path, tables)), tmp_path)
    assert "\n" not in str(refused.value)
