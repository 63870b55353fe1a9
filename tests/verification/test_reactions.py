"""Reaction forces of held and prescribed nodes, supports and bones: balances of forces and momentum, and a closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import command
from support import YEOH, block_mesh, floor_below, model_of

import explicitfe
from explicitfe.fem.bones.motion import RigidMotion
from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.surface_points import points_on_set
from explicitfe.fem.model.attached import AttachedMass, FollowerLoad, HangingWeight
from explicitfe.fem.model.gravity import gravity_load
from explicitfe.fem.model.model import Attachment, Model, NodalLoad, PrescribedMotion
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.results.measure.reactions import force_curve

BLOCK = block_mesh((4, 3, 3), seed=5)
X0, X1, Z1 = (BLOCK.node_sets[name] for name in ("x0", "x1", "z1"))
TIP = np.array([int(np.argmax(BLOCK.points.sum(axis=1)))])
PULL = NodalLoad("pull", X1, np.tile([0.002, 0.001, -0.003], (len(X1), 1)), Profile(np.array([0.0, 0.01]), np.array([0.0, 1.0])))
WEIGHT = gravity_load(BLOCK, YEOH, (0.0, 0.0, -9.81))
FOLLOWER = FollowerLoad("turns", TIP, np.array([[0.0, 0.01, 0.0]]))
MASS = AttachedMass("mass", TIP, np.array([2e-3]))
HANGS = HangingWeight("hangs", TIP, np.ones(1), 1e-3, np.array([0.0, 0.0, -9.81]))
MOVES = PrescribedMotion(X1, lambda t: np.sin(200.0 * t)[:, None, None] * np.broadcast_to([1e-3, 0.0, 2e-3], (len(X1), 3)))
LIFT = RigidMotion(np.zeros(3), np.array([0.0, 0.1, 0.05]), np.array([0.0, 1e-3, 2e-3]), np.array([0.0, 0.02]), np.arange(2.0))
TIES = (
    Attachment("x0", *points_on_set(BLOCK, "x0"), 1e7, bone_stiffness_N_m=300.0),
    Attachment("z0", *points_on_set(BLOCK, "z0"), 1e6, motion=LIFT, normal_stiffness_Pa_m=5e7),
)
CASES: dict[str, Model] = {
    "held": model_of(BLOCK, held=("x0",), loads=(PULL, WEIGHT), followers=(FOLLOWER,), alpha_per_s=40.0, fixed=("x0",)),
    "two sets": model_of(BLOCK, held=("x0", "z1"), loads=(PULL,), fixed=("x0", "z1")),
    "rollers": replace(model_of(BLOCK, loads=(PULL,)), held=BLOCK.held("x0", along="x") | BLOCK.held("y0", along="y")),
    "mass": model_of(BLOCK, held=("x0",), loads=(PULL,), masses=(MASS,), alpha_per_s=40.0),
    "string": model_of(BLOCK, held=("x0",), weights=(HANGS,), loads=(WEIGHT,)),
    "prescribed": model_of(BLOCK, held=("x0",), motion=MOVES, loads=(WEIGHT,), alpha_per_s=30.0, fixed=("x0", "x1")),
    "ties": model_of(BLOCK, loads=(WEIGHT,), attachments=TIES, alpha_per_s=20.0),
    "bone": model_of(BLOCK, loads=(WEIGHT,), bones=(floor_below(BLOCK, 1e-5, friction=0.3),), alpha_per_s=20.0),
}


@pytest.mark.parametrize("name", CASES)
def test_momentum_changes_by_loads_and_reactions(name: str) -> None:
    """Loads and reactions add up to dP/dt + alpha P at every step, to the rounding of the internal forces.

    With an attached mass the damping of the tissue is one of the loads.
    """
    simulation = Simulation(CASES[name])
    dt = 0.5 * simulation.stable_limit(40)
    simulation.start(dt)
    mass, alpha = simulation.nodes.mass[:, :3], simulation.alpha_per_s
    largest = 0.0
    for _ in range(300):
        snapshot, before = simulation.snapshot(), simulation.state.v[:, :3].copy()
        total = snapshot.applied_force + sum(snapshot.reactions.values())
        assert simulation.advance(1, dt)
        after = simulation.state.v[:, :3]
        wanted = np.sum(mass * ((after - before) / dt + 0.5 * alpha * (after + before)), axis=0)
        scale = np.abs(simulation.internal_force(snapshot.displacement)).sum() + np.abs(snapshot.applied_force).max()
        np.testing.assert_allclose(total, wanted, rtol=0.0, atol=1e-11 * scale)
        largest = max(largest, *(np.abs(force).max() for force in snapshot.reactions.values()))
    assert largest > 1e-5


def test_names_and_nodes() -> None:
    """A node in two sets is in the first of them; nodes of no set are "held" or "prescribed"; a free body has none."""
    names = {name: [holder.name for holder in Simulation(model).holders] for name, model in CASES.items() if name != "rollers"}
    assert names == {
        "held": ["x0"],
        "two sets": ["x0", "z1"],
        "mass": ["held"],
        "string": ["held"],
        "prescribed": ["x0", "x1"],
        "ties": ["x0", "z0"],
        "bone": [],
    }
    first, second = Simulation(CASES["two sets"]).holders
    assert set(first.nodes) == set(X0) and set(second.nodes) == set(Z1) - set(X0)


def test_in_equilibrium_reactions_are_the_loads() -> None:
    """A clamped block at rest: the clamp carries the loads, to 1e-9 of them."""
    stiff = NeoHooke(law="neo-hooke", C10_Pa=20e3, poisson=0.3)
    model = model_of(BLOCK, stiff, held=("x0",), loads=(WEIGHT, PULL), alpha_per_s=250.0, fixed=("x0",))
    run = Transient(Simulation(model), 0.5)
    assert run.advance_to(0.5) is None
    snapshot = run.simulation.snapshot()
    load = WEIGHT.force_N.sum(axis=0) + PULL.force_N.sum(axis=0)
    np.testing.assert_allclose(snapshot.applied_force, load, rtol=1e-12)
    np.testing.assert_allclose(snapshot.reactions["x0"], -load, rtol=0.0, atol=1e-9 * np.abs(load).max())


SUPPORTS = """
title = "Pulled bar"
[model]
box_mm = [40.0, 10.0, 10.0]
cells = [8, 2, 2]
fixed = []
material = { law = "neo-hooke", C10_Pa = 5000.0, poisson = 0.499 }
damping = { alpha_per_s = 100.0 }
[[support]]
name = "x0"
normal_kPa_per_mm = 1000.0
tangential_kPa_per_mm = 0.001
[[support]]
name = "x1"
normal_kPa_per_mm = 1000.0
tangential_kPa_per_mm = 0.001
shift_mm = [8.0, 0.0, 0.0]
rise_ms = 400.0
[analysis]
duration_ms = 600.0
[record]
every_ms = 20.0
"""


def test_the_force_of_a_tensile_test(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A bar between sliding grips: F = A 2 C10 (l - 1 / l^2) over the whole curve, in the file, the measures and the picture."""
    scenario = tmp_path / "bar.toml"
    scenario.write_text(SUPPORTS)
    path = Path(explicitfe.run(scenario, out=tmp_path)["result"])
    with explicitfe.open_result(path) as result:
        assert result.reaction_names == ["x0", "x1"]
        curve = force_curve(result, "x1")
        assert (curve.moved, curve.own) == ("x1", True)
        pulled = (curve.displacement_m > 2e-3) & (np.abs(curve.displacement_m - 8e-3) > 1e-9)
        stretch = 1.0 + np.array([np.ptp(result.displacement(k)[:, 0]) for k in range(len(result.times))]) / 0.04
        closed = 1e-4 * 1e4 * (stretch - stretch**-2)
        # The grip also pulls against the damping, alpha m v / 3 of a bar that is stretched evenly; the bar swings at first.
        drag = 100.0 * 1040.0 * 4e-6 * 0.02 / 3.0 * (curve.displacement_m < 8e-3)
        np.testing.assert_allclose((curve.force_N - drag)[pulled], closed[pulled], rtol=0.0, atol=2e-3 * closed[-1])
        np.testing.assert_allclose(curve.force_N[-1], closed[-1], rtol=1e-3)
        other = force_curve(result, "x0")
        assert (other.moved, other.own) == ("x1", False)
        np.testing.assert_allclose(other.force_N[-1], curve.force_N[-1], rtol=1e-4)
        np.testing.assert_allclose(result.reaction("x1"), result.history("reaction_x1_force"))
        with pytest.raises(explicitfe.InputError, match='no reaction force "clamp"'):
            result.reaction("clamp")
    measured = explicitfe.measure(path)["reactions"]["x1"]
    np.testing.assert_allclose(measured["force_N"][0], curve.force_N[-1])
    np.testing.assert_allclose(measured["displacement_mm"], [8.0, 0.0, 0.0], atol=1e-9)
    assert command(["plot", str(path), "--only", "reaction:x1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "bar-reaction-x1.png").stat().st_size > 10_000
    assert command(["plot", str(path), "--only", "reaction:clamp"]) == 2
    assert 'no picture "reaction:clamp"' in capsys.readouterr().err
    assert explicitfe.plot(path, "reaction:x0").axes[0].get_xlabel() == "displacement of x1 (mm)"
    assert command(["report", str(path)]) == 0
    assert "Reaction forces" in (tmp_path / "bar-report.html").read_text()
