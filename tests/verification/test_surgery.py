"""Surgery: what is cut is gone, what is put in has its own stiffness, and the laws of mechanics hold for what is left."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from support import ROOT, true_limit

from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.model.fibre_stress import fibre_stress
from explicitfe.fem.model.model import Model
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.body import Body
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.errors import InputError
from explicitfe.results.files import open_result
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.steps import last_step
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.tongue import Assembly, assemble
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.read import read_scenario

pytestmark = pytest.mark.slow

VOWEL = ROOT / "scenarios" / "vowel-i.toml"
COARSE = ["model.resolution=coarse", "bone=[]"]
EDGE_M = 0.005
CELLS = (8, 2, 2)
SOFT = {"law": "neo-hooke", "C10_Pa": 500.0, "poisson": 0.0}  # E = 2 G = 4 C10 = 2 kPa
FIRM = {**SOFT, "C10_Pa": 1500.0, "density_kg_m3": 1200.0}


def bar_mesh(planes: slice = slice(None)) -> HexMesh:
    """The planes of nodes ``planes`` of a bar of 40 x 10 x 10 mm, distorted inside; its first and last one are sets."""
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    shift = np.random.default_rng(5).uniform(-0.2 * EDGE_M, 0.2 * EDGE_M, mesh.points.shape)
    number = np.arange(mesh.node_count).reshape([n + 1 for n in CELLS])
    points = (mesh.points + shift)[number[planes].ravel()]
    few = box((len(number[planes]) - 1, *CELLS[1:]), (1.0, 1.0, 1.0))
    last = len(points) - number[0].size
    return HexMesh(points, few.hexes, {"x0": np.arange(number[0].size), "x1": np.arange(last, len(points))})


def own(folder: Path, mesh: HexMesh, tables: str = "", fixed: str = "x0", **scenario: object) -> Assembly:
    """A scenario on a mesh of one's own."""
    folder.mkdir(parents=True, exist_ok=True)
    meshio.write(folder / "bar.vtu", meshio.Mesh(mesh.points, [("hexahedron", mesh.hexes)]))
    sets = "".join(f"{name} = {nodes.tolist()}\n" for name, nodes in mesh.node_sets.items())
    text = f'mesh = "bar.vtu"\nlength_unit = "m"\nfixed = ["{fixed}"]\n[node_sets]\n{sets}{tables}'
    (folder / "bar.toml").write_text(text)
    data = {
        "title": "bar",
        "model": {"file": "bar.toml", "material": SOFT, "gravity_m_s2": [0.0, 0.0, -9.81]},
        "analysis": {"duration_ms": 1.0},
    } | scenario
    path = folder / "scenario.json"
    path.write_text(json.dumps(data))
    return assemble(read_scenario(path)[0], folder)


def moved(model: Model, steps: int = 200) -> np.ndarray:
    """Displacement (n, 3) m after so many steps of 50 microseconds."""
    simulation = Simulation(model)
    simulation.start(5e-5)
    assert simulation.advance(steps, 5e-5)
    return simulation.displacement


# ---- what is cut is gone ----


@pytest.mark.parametrize(("box_mm", "planes", "fixed"), [
    ([[28, -5, -5], [99, 99, 99]], slice(0, 7), "x0"),
    ([[-5, -5, -5], [12, 99, 99]], slice(2, 9), "x1"),
])  # fmt: skip
def test_a_beam_that_was_cut_moves_as_a_short_one(box_mm, planes, fixed, tmp_path):
    """The same elements in the same order: to the last bit."""
    cut = own(tmp_path / "cut", bar_mesh(), fixed=fixed, resection=[{"box_mm": box_mm}]).model
    short = own(tmp_path / "short", bar_mesh(planes), fixed=fixed).model
    assert np.array_equal(cut.mesh.points, short.mesh.points) and np.array_equal(cut.mesh.hexes, short.mesh.hexes)
    assert np.array_equal(cut.mesh.node_sets[fixed], short.mesh.node_sets[fixed])
    displacement = moved(cut)
    assert np.abs(displacement).max() > 1e-4
    assert np.array_equal(displacement, moved(short))


@pytest.mark.parametrize("region", [
    {"sphere": {"centre_mm": [40.0, 5.0, 5.0], "radius_mm": 8.5}},
    {"plane": {"point_mm": [30.0, 0.0, 0.0], "normal": [2.0, 0.0, 0.0]}},
    {"set": "end"},
    {"box_mm": [[-9, -9, -9], [99, 99, 99]], "plane": {"point_mm": [30, 0, 0], "normal": [1, 0, 0]}},
])  # fmt: skip
def test_regions(region, tmp_path):
    """The last two of eight planes of elements, by every kind of region: their centres lie up to 8.3 mm from the end's middle."""
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    mesh = replace(mesh, node_sets=mesh.node_sets | {"end": np.flatnonzero(mesh.points[:, 0] > 0.029)})
    report = own(tmp_path, mesh, resection=[region]).surgery
    assert report["removed_elements"] == 8
    assert report["removed_mm3"] == pytest.approx(8 * 125.0, rel=1e-9)


def test_muscles_lose_the_share_of_the_elements_that_went():
    """Sum of sigma V, from the fields of the intact tongue; a graft has no muscle either."""
    low, high = np.array([-99.0, 8.0, 0.0]), np.array([90.0, 99.0, 200.0])
    settings = [*COARSE, f"resection=[{{box_mm=[{low.tolist()}, {high.tolist()}]}}]"]
    settings.append("graft=[{box_mm=[[90.0, 8.0, 90.0], [110.0, 99.0, 200.0]], stiffness_ratio=2.0}]")
    model, anatomy, report, _ = assemble(read_scenario(VOWEL, settings)[0], VOWEL.parent)
    mesh = anatomy.mesh
    centre, volume = 1e3 * mesh.points[mesh.hexes].mean(axis=1), volumes(mesh.points, mesh.hexes)
    resected = ((centre > low) & (centre < high)).all(axis=1)
    grafted = ((centre > [90.0, 8.0, 90.0]) & (centre < [110.0, 99.0, 200.0])).all(axis=1)
    for name, force_N in (("GGp", 1.33), ("GGh", 0.67), ("GGa", 0.2)):
        stress = fibre_stress(mesh, anatomy.muscles[name], force_N, "both", Profile.constant())
        work = stress.stress_Pa * volume[stress.elements]
        lost = (resected | grafted)[stress.elements]
        assert 0.0 < work[lost].sum() < 0.5 * work.sum()
        assert report["muscle_loss_percent"][name] == pytest.approx(100.0 * work[lost].sum() / work.sum(), rel=1e-9)
        left = next(part for part in model.stresses if part.name == name)
        assert np.array_equal(left.stress_Pa, stress.stress_Pa[~lost])
        assert np.array_equal(left.direction, stress.direction[~lost])
        moved_by = model.mesh.points[model.mesh.hexes[left.elements]] - mesh.points[mesh.hexes[stress.elements[~lost]]]
        assert not moved_by.any()
    assert report["removed_elements"] == resected.sum() and report["graft_elements"] == grafted.sum()
    for lines, name in zip(model.fibres, ("GGp", "GGh", "GGa"), strict=True):
        assert 0 < sum(map(len, lines)) <= sum(len(fibre.points) for fibre in anatomy.muscles[name].fibres)
        for line in lines:
            assert model.mesh.at(line, model.mesh.points) == pytest.approx(line.position, abs=1e-9)


MUSCLE = """
[[muscle]]
name = "LINE"
[[muscle.fibre]]
side = "left"
points = [[0.001, 0.002, 0.002], [0.039, 0.002, 0.002]]
[[muscle.fibre]]
side = "right"
points = [[0.001, 0.008, 0.008], [0.015, 0.008, 0.008]]
[[muscle]]
name = "STAY"
[[muscle.fibre]]
side = "left"
anchor = [0.06, 0.002, 0.002]
points = [[0.0275, 0.002, 0.002], [0.022, 0.002, 0.002]]
[[muscle.fibre]]
side = "right"
anchor = [0.06, 0.008, 0.008]
points = [[0.012, 0.008, 0.008], [0.007, 0.008, 0.008]]
"""


@pytest.mark.parametrize("direction", ["reference", "following"])
def test_a_line_that_is_cut_pulls_no_more(direction, tmp_path):
    """The left fibre runs through the gap, its ends do not; the right one keeps its half of the force."""
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    pull = [{"name": "LINE", "force_N": 2.0, "direction": direction}]
    still = {"file": "bar.toml", "material": SOFT}
    gap = [{"box_mm": [[20, -1, -1], [25, 5, 99]]}]
    cut = own(tmp_path / "a", mesh, MUSCLE, model=still, muscle=pull, resection=gap)
    right = own(tmp_path / "b", mesh, MUSCLE, model=still, muscle=[{**pull[0], "force_N": 1.0, "side": "right"}])
    if direction == "reference":
        total = [np.zeros((part.model.mesh.node_count, 3)) for part in (cut, right)]
        for part, force in zip((cut, right), total, strict=True):
            for load in part.model.loads:
                force[load.nodes] += load.force_N
        places = [{tuple(at): f for at, f in zip(p.model.mesh.points, f, strict=True) if f.any()} for p, f in
                  zip((cut, right), total, strict=True)]  # fmt: skip
        assert places[0].keys() == places[1].keys()
        assert max(np.abs(places[0][at] - places[1][at]).max() for at in places[0]) < 1e-12
    else:
        (load,) = cut.model.pulls
        assert len(load.points) == 1 and load.tension_N[0] == pytest.approx([1.0])
        assert cut.model.mesh.at(load.points[0], cut.model.mesh.points) == pytest.approx(load.points[0].position, abs=1e-12)
    assert cut.surgery["muscle_loss_percent"]["LINE"] == pytest.approx(100.0 * 38.0 / (38.0 + 14.0), rel=1e-9)
    assert any("1 of the 2 lines along which LINE pulls" in note for note in cut.surgery["notes"])


def test_a_line_from_outside_goes_with_its_insertion(tmp_path):
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    pull = [{"name": "STAY", "force_N": 2.0, "distribution": "stress"}]
    whole = own(tmp_path / "a", mesh, MUSCLE, muscle=pull).model
    cut = own(tmp_path / "b", mesh, MUSCLE, muscle=pull, resection=[{"box_mm": [[20, -1, -1], [41, 11, 11]]}])
    assert len(whole.pulls[0].points) == 2 * 16  # each anchor pulls at 16 points around the entry of its fibre
    assert len(cut.model.pulls[0].points) == 16
    for line in cut.model.pulls[0].points:
        assert line.position[0] == pytest.approx([0.06, 0.008, 0.008])
    line = MUSCLE.replace("[0.039, 0.002, 0.002]", "[0.018, 0.002, 0.002], [0.028, 0.002, 0.002], [0.039, 0.002, 0.002]")
    gap = own(
        tmp_path / "c", mesh, line, muscle=[{**pull[0], "name": "LINE"}], resection=[{"box_mm": [[20, -1, -1], [25, 5, 5]]}]
    )
    pieces = [1e3 * fibre.position[:, 0] for fibre in gap.model.fibres[0]]
    assert np.allclose(np.concatenate(pieces), [1.0, 18.0, 28.0, 39.0, 1.0, 15.0]) and list(map(len, pieces)) == [2, 2, 2]
    (fibre,) = cut.model.fibres[0]
    assert np.array_equal(fibre.position, whole.fibres[0][1].position)
    assert any("16 of the 32 lines along which STAY pulls" in note for note in cut.surgery["notes"])


def test_points_and_ties_go_with_their_tissue():
    """The right half of the tongue alone: points of the midline stay, half of the ties go; without the tip it has no name."""
    settings = [*COARSE, "resection=[{plane={point_mm=[0, 0, 0], normal=[0, -1, 0]}}]"]
    half, anatomy, report, _ = assemble(read_scenario(VOWEL, settings)[0], VOWEL.parent)
    for name, point in anatomy.mesh.named_points.items():
        assert half.mesh.at(half.probes[name], half.mesh.points) == pytest.approx(point.position, abs=1e-12)
    whole = assemble(read_scenario(VOWEL, COARSE)[0], VOWEL.parent).model
    for before, after in zip(whole.attachments, half.attachments, strict=True):
        assert after.areas_m2.sum() == pytest.approx(0.5 * before.areas_m2.sum(), rel=1e-12)
    assert sum(" of the attachment " in note for note in report["notes"]) == 2

    settings = [*COARSE, "resection=[{plane={point_mm=[64, 0, 0], normal=[-1, 0, 0]}}]"]
    model, _, report, _ = assemble(read_scenario(VOWEL, settings)[0], VOWEL.parent)
    assert "tip" not in model.probes and "tip" not in model.mesh.named_points and "dorsum" in model.probes
    assert any("tip" in note for note in report["notes"])


# ---- what is put in ----


@pytest.mark.parametrize("tissue", [{"stiffness_ratio": 1.0}, {"material": SOFT}])
def test_a_graft_of_the_same_tissue_changes_nothing(tissue, tmp_path):
    """A graft brings resected elements back; without muscle in the body it is the body."""
    region = {"box_mm": [[8, -9, -9], [22, 4, 99]]}
    intact = own(tmp_path / "a", bar_mesh()).model
    filled = own(tmp_path / "b", bar_mesh(), resection=[region], graft=[region | tissue])
    assert filled.surgery["removed_elements"] == 0 and filled.surgery["graft_elements"] > 0
    assert np.array_equal(moved(filled.model), moved(intact))


@pytest.mark.parametrize("tissue", [{"stiffness_ratio": 3.0}, {"material": FIRM}])
def test_bars_of_two_tissues(tissue, tmp_path):
    """Poisson's ratio is 0, so bars in a row or side by side are in states of uniform stress each.

    A strain of 1e-6 keeps the second order below 1e-6; rounding of forces eps K A / (E A strain) is 2e-10.
    """
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    x, E, area = mesh.points[:, 0], 4.0 * SOFT["C10_Pa"], (2 * EDGE_M) ** 2
    end, tolerance = mesh.node_sets["x1"], 1e-5

    side = own(tmp_path / "side", mesh, graft=[{"box_mm": [[-9, -9, -9], [99, 5, 99]], **tissue}]).model
    along = np.zeros_like(mesh.points)
    along[:, 0] = 1e-6 * x
    force = -Simulation(side).internal_force(along)
    assert abs(force[end, 0].sum()) == pytest.approx(1e-6 * area * 0.5 * (E + 3.0 * E), rel=tolerance)

    row = own(tmp_path / "row", mesh, graft=[{"box_mm": [[20, -9, -9], [99, 99, 99]], **tissue}]).model
    stress = 1e-6 * E
    along[:, 0] = stress / E * np.minimum(x, 0.02) + stress / (3.0 * E) * np.maximum(x - 0.02, 0.0)
    force = Simulation(row).internal_force(along)[:, 0]
    assert abs(force[end].sum()) == pytest.approx(stress * area, rel=tolerance)
    inner = (x > 1e-6) & (x < 0.04 - 1e-6)
    assert np.abs(force[inner]).max() < tolerance * stress * area


def test_mass_and_step_are_those_of_the_tissues(tmp_path):
    """The limit of the step from the dense matrix; a graft of another density weighs what it weighs."""
    region = {"box_mm": [[20, -9, -9], [99, 99, 99]]}
    model = own(tmp_path / "a", bar_mesh(), graft=[region | {"material": {**FIRM, "poisson": 0.4}}]).model
    volume = volumes(model.mesh.points, model.mesh.hexes)
    firm = 1e3 * model.mesh.points[model.mesh.hexes].mean(axis=1)[:, 0] > 20.0
    mass = 1040.0 * volume[~firm].sum() + 1200.0 * volume[firm].sum()
    simulation = Simulation(model)
    assert simulation.nodal_mass.sum() == pytest.approx(mass, rel=1e-12)
    (weight,) = model.loads
    assert weight.force_N.sum(axis=0) == pytest.approx([0.0, 0.0, -9.81 * mass], rel=1e-12)
    limit = true_limit(simulation, np.zeros_like(model.mesh.points))
    assert simulation.stable_limit(60) == pytest.approx(limit, rel=0.01)
    assert simulation.stable_bound()[0] <= limit


def test_damping_follows_the_stiffness_of_a_graft(tmp_path):
    """Three times the constants of the tissue, or a ratio of 3: with beta both are three times as viscous."""
    region = {"box_mm": [[15, -9, -9], [99, 99, 99]]}
    tissue = {**SOFT, "poisson": 0.45}
    damped = {"file": "bar.toml", "material": tissue, "damping": {"beta_s": 0.01, "tau_ms": 5.0}}
    constants = {}
    for name, graft in (("ratio", {"stiffness_ratio": 3.0}), ("constants", {"material": {**tissue, "C10_Pa": 1500.0}})):
        model = own(tmp_path / name, bar_mesh(), model=damped, graft=[region | graft]).model
        body = Body(model)
        constants[name] = body.constants[np.argsort(body.element_order)]
        grafted = 1e3 * model.mesh.points[model.mesh.hexes].mean(axis=1)[:, 0] > 15.0
    assert constants["ratio"] == pytest.approx(constants["constants"], rel=1e-12)
    C10 = np.where(grafted, 1500.0, 500.0)
    # G' = (1 + beta / tau) G, and the bulk modulus stays
    bulk = 2.0 * (2.0 * C10) * (1.0 + 0.45) / (3.0 * (1.0 - 2.0 * 0.45))
    assert constants["ratio"] == pytest.approx(np.column_stack([(1.0 + 0.01 / 0.005) * C10, bulk]), rel=1e-12)


def test_activation_does_not_stiffen_a_graft():
    settings = [*COARSE, "model.activation_stiffening=true"]
    settings.append("graft=[{sphere={centre_mm=[90, 0, 105], radius_mm=12}, stiffness_ratio=2.5}]")
    model, _, report, _ = assemble(read_scenario(VOWEL, settings)[0], VOWEL.parent)
    centre = 1e3 * model.mesh.points[model.mesh.hexes].mean(axis=1)
    inside = np.linalg.norm(centre - [90, 0, 105], axis=1) < 12.0
    assert inside.sum() == report["graft_elements"] > 0
    assert (model.stiffness[inside] == 2.5).all() and (model.stiffness[~inside] > 1.0).any()


def test_scars_have_their_thickness(tmp_path):
    """Beside a flat cut through cubes of 5 mm: half of each within 2.5 mm, and of two layers within 7.5 mm; none in the graft."""
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    end = {"box_mm": [[25, -9, -9], [99, 99, 99]]}
    for thickness_mm, shares in ((2.5, [0.0, 0.5]), (7.5, [0.5, 1.0])):
        scar = {"thickness_mm": thickness_mm, "stiffness_ratio": 3.0}
        for name, surgery in (("cut", {"resection": [end]}), ("graft", {"graft": [end | {"stiffness_ratio": 1.0}]})):
            model, _, report, _ = own(tmp_path / f"{name}-{thickness_mm}", mesh, scar=scar, **surgery)
            layer = np.round(1e3 * model.mesh.points[model.mesh.hexes].mean(axis=1)[:, 0] / 5.0 - 0.5).astype(int)
            factor = np.array([model.stiffness[layer == k].mean() for k in range(layer.max() + 1)])
            wanted = 1.0 + 2.0 * np.array([0.0, 0.0, 0.0, *shares, 0.0, 0.0, 0.0])
            assert factor == pytest.approx(wanted[: len(factor)], rel=1e-9)
            assert report["scar_mm3"] == pytest.approx(100.0 * thickness_mm, rel=1e-9)


# ---- the laws of mechanics ----

TIP = "resection=[{plane={point_mm=[64, 0, 0], normal=[-1, 0, 0]}}]"
SIDE = "{box_mm=[[-99, 8, 88], [100, 99, 200]]"


def test_a_symmetric_resection_stays_symmetric_and_keeps_its_energy(tmp_path):
    settings = ["model.resolution=coarse", "analysis.duration_ms=40", "record.every_ms=20", TIP]
    settings.append("scar={thickness_mm=3, stiffness_ratio=3}")
    prepared = prepare(VOWEL, settings)
    summary = prepared.run(tmp_path / "tip.vtkhdf", overwrite=False, progress=lambda what, share: None)
    assert summary["status"] == "finished" and summary["energy_balance_error"] < 1e-4
    assert summary["largest_displacement_mm"] > 1.0
    with open_result(tmp_path / "tip.vtkhdf") as result:
        body = measures_of(result, last_step(result)).body
        assert result.model["scenario"]["resection"][0]["plane"]["point_mm"] == [64.0, 0.0, 0.0]
        assert result.model["surgery"]["removed_elements"] == prepared.surgery["removed_elements"] > 0
    assert body.left_right_mm is not None and body.left_right_mm < 1e-6
    assert any("tip" in warning for warning in summary["warnings"])


def test_a_lateral_flap_keeps_its_energy(tmp_path):
    """With muscles that end at the cut, a stiffer flap, a scar and bones; and the stored scenario runs again to the same bits."""
    settings = ["model.resolution=coarse", "analysis.duration_ms=20", "record.every_ms=10", f"resection=[{SIDE}}}]"]
    settings += [f"graft=[{SIDE}, stiffness_ratio=3.0}}]", "scar={thickness_mm=2, stiffness_ratio=3}"]
    summary = prepare(VOWEL, settings).run(tmp_path / "a.vtkhdf", overwrite=False, progress=lambda what, share: None)
    assert summary["status"] == "finished" and summary["energy_balance_error"] < 1e-4
    with open_result(tmp_path / "a.vtkhdf") as result:
        displacement = result.displacement(last_step(result))
        assert measures_of(result, last_step(result)).points["dorsum"].right_mm != 0.0
        (tmp_path / "again.json").write_text(json.dumps(result.model["scenario"]))
    prepare(tmp_path / "again.json").run(tmp_path / "b.vtkhdf", overwrite=False, progress=lambda what, share: None)
    with open_result(tmp_path / "b.vtkhdf") as result:
        assert np.array_equal(result.displacement(last_step(result)), displacement)


def test_a_free_body_keeps_its_momentum():
    """Muscles that were cut pull on nothing outside: momentum and spin stay 0, beside those of the parts that move."""
    settings = [*COARSE, "model.attachment=nodes", "model.fixed=[]", "model.damping={}"]
    settings += [f"resection=[{SIDE}}}]", "graft=[{sphere={centre_mm=[90, -10, 105], radius_mm=9}, stiffness_ratio=4.0}]"]
    model = assemble(read_scenario(VOWEL.with_name("gga-alone.toml"), settings)[0], VOWEL.parent).model
    simulation = Simulation(model)
    simulation.start(2e-5)
    assert simulation.advance(500, 2e-5)
    snapshot = simulation.snapshot()
    momentum = simulation.nodal_mass[:, None] * snapshot.velocity
    places = model.mesh.points + snapshot.displacement
    moving = np.abs(momentum).sum()
    assert moving > 1e-4
    assert np.abs(momentum.sum(axis=0)).max() < 1e-11 * moving
    # velocities are half a step beside positions, which leaves dt times force times length: but forces balance
    spin = np.cross(places - places.mean(axis=0), momentum)
    assert np.abs(spin.sum(axis=0)).max() < 1e-6 * np.abs(spin).sum()


# ---- what cannot be ----

REFUSED = [
    ({"resection": [{"box_mm": [[90, 0, 0], [99, 9, 9]]}]}, ["resection 1 selects no element", "between"]),
    ({"graft": [{"set": "x0", "stiffness_ratio": 2}]}, ["graft 1 selects no element"]),
    ({"resection": [{"set": "x2"}]}, ["x2", 'did you mean "x']),
    ({"resection": [{"box_mm": [[-9, -9, -9], [99, 99, 99]]}]}, ["every element"]),
    ({"resection": [{"box_mm": [[15, -9, -9], [25, 99, 99]]}]}, ["2 pieces", "12 of 24 elements"]),
    ({"graft": [{"set": "x0", "material": {"C10_Pa": 1.0, "C20_Pa": 0.0}}]}, ["no element"]),
    ({"graft": [{"box_mm": [[15, -9, -9], [99, 99, 99]], "material": {"C10_Pa": 1.0, "C20_Pa": 0.0}}]},
     ["graft 1", '"yeoh"', '"neo-hooke"', "stiffness_ratio"]),
    ({"resection": [{}]}, ["resection 1", "give a region"]),
    ({"resection": [{"box_mm": [[1, 0, 0], [1, 2, 2]]}]}, ["resection 1", "below the second"]),
    ({"resection": [{"sphere": {"centre_mm": [0, 0, 0], "radius_mm": 0}}]}, ["radius_mm", "greater than 0"]),
    ({"resection": [{"plane": {"point_mm": [0, 0, 0], "normal": [0, 0, 0]}}]}, ["normal", "length above 0"]),
    ({"resection": [{"boxmm": [[0, 0, 0], [1, 1, 1]]}]}, ["boxmm", 'did you mean "box_mm"?']),
    ({"graft": [{"set": "x0"}]}, ["graft 1", "either material or stiffness_ratio"]),
    ({"scar": {"thickness_mm": 1, "stiffness_ratio": 2}}, ["[scar] needs a [[resection]] or a [[graft]]"]),
    ({"graft": [{"box_mm": [[-9, -9, -9], [99, 99, 99]], "stiffness_ratio": 2}],
      "scar": {"thickness_mm": 1, "stiffness_ratio": 2}}, ["scar", "thickness_mm"]),
]  # fmt: skip


@pytest.mark.parametrize(("tables", "words"), REFUSED)
def test_what_cannot_be_is_refused(tables, words, tmp_path):
    with pytest.raises(InputError) as refused:
        own(tmp_path, box(CELLS, EDGE_M * np.array(CELLS)), **tables)
    for word in words:
        assert word in str(refused.value)


def test_parts_of_a_mesh_that_was_in_parts_may_stay(tmp_path):
    """Two bars side by side, one of which is shortened."""
    mesh = box(CELLS, EDGE_M * np.array(CELLS))
    two = HexMesh(
        np.concatenate([mesh.points, mesh.points + [0.0, 0.1, 0.0]]),
        np.concatenate([mesh.hexes, mesh.hexes + mesh.node_count]),
        mesh.node_sets,
    )
    assert own(tmp_path, two, resection=[{"box_mm": [[30, 90, -9], [99, 200, 99]]}]).surgery["removed_elements"] == 8


def test_the_catalogue_is_left_alone():
    """Surgery makes a new mesh; the one of the catalogue stays whole."""
    before = catalogue.built_in("tongue", "coarse").mesh.element_count
    assemble(read_scenario(VOWEL, [*COARSE, TIP])[0], VOWEL.parent)
    assert catalogue.built_in("tongue", "coarse").mesh.element_count == before
