"""Indentations as a user and a program meet them: command, JSON, result, bad input, loads that are not reached."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from answers import check_answer
from command import command
from support import ROOT

import explicitfe
from explicitfe.fem.solve.load_outcome import Stuck
from explicitfe.simulate.run.prepare import prepare

REAR = ROOT / "scenarios" / "indentation-rear.toml"
BALL = ROOT / "scenarios" / "indentation-ball.toml"
QUICK = ["--set", "model.symmetry=sector", "--set", "model.edge_size_mm=1.2", "--set", "analysis.forces_N=[0.1, 0.2, 0.3]"]
QUICK_SETTINGS = QUICK[1::2]

SETTINGS = [
    ("model.radius_mm=0", ["model.radius_mm", "greater than 0"]),
    ("model.symetry=half", ["symetry", "[model]", 'did you mean "symmetry"?']),
    ("model.symmetry=eighth", ["model.symmetry", "'eighth'", "'sector'"]),
    ("model.size_mm=[10, 10, 10]", ["a sector is for a cylinder"]),
    ("model.size_mm=[10, 10]", ["model.size_mm", "three lengths"]),
    ("model.layer_mm=20", ["layer_mm", "less than the height"]),
    ("model.base=loose", ["model.base", "'bonded' or 'sliding'"]),
    ("model.bonded_radius_mm=-1", ["model.bonded_radius_mm", "greater than 0"]),
    ("model.gravity_m_s2=[1, 0, 0]", ["gravity_m_s2", "x or y", "sector"]),
    ("model.material=steel", ["steel", "gerard-2005"]),
    ("model.material.poisson=0.5", ["model.material.poisson", "less than 0.5"]),
    ("model.refinement=0", ["model.refinement", "0.01"]),
    ("model.refinement=10000", ["model.refinement", "100"]),
    ("model.edge_size_mm=0.00001", ["model.edge_size_mm", "1 micrometre"]),
    ("model.resolution=fine", ["resolution", "[model]", "refinement"]),
    ("model.name=tongue", ["model.name", "'specimen'"]),
    ("tool.shape=cube", ["tool.shape", "'flat-cylinder'"]),
    ("tool.shape=platen", ["tool", "radius_mm", "platen"]),
    ("tool.shape=sphere", ["tool", "edge_radius_mm", "flat-cylinder"]),
    ("tool.radius=3", ["radius", "[tool]", 'did you mean "radius_mm"?']),
    ("tool.edge_radius_mm=20", ["edge_radius_mm", "above radius_mm"]),
    ("tool.friction=-1", ["tool.friction", "0 to 1"]),
    ("tool.friction=rough", ["tool.friction", '"stick"']),
    ("analysis.forces_N=[]", ["at least one load"]),
    ("analysis.forces_N=[-1]", ["analysis.forces_N 1", "-1"]),
    ("analysis.times_s=[1]", ["times_s has 1 entries"]),
    ("analysis.times_s=[1, 1, 2]", ["times_s must rise"]),
    ("analysis.tolerance=1", ["analysis.tolerance", "less than or equal to 0.01"]),
    ("analysis.type=transient", ["analysis.type", "'relaxation'"]),
    ("muscle.GGp.force_N=1", ["muscle"]),
    ('record.fields=["velocity"]', ["record.fields", "strain_energy_density"]),
]


@pytest.mark.parametrize(("setting", "words"), SETTINGS, ids=[setting for setting, _ in SETTINGS])
def test_bad_settings(setting: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["run", str(REAR), "--out", str(tmp_path / "out"), *QUICK, "--set", setting]) == 2
    shown = capsys.readouterr()
    (line,) = [line for line in shown.err.splitlines() if line.startswith("error:")]
    assert not shown.out and ("indentation-rear.toml" in line or "--set" in line)
    for word in words:
        assert word in line, line
    assert not list(tmp_path.rglob("*.vtkhdf")), "a refused run must leave no file"


def test_forces_and_displacements_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "both.toml"
    scenario.write_text(REAR.read_text().replace("forces_N =", "displacements_mm = [1.0]\nforces_N ="))
    assert command(["run", str(scenario)]) == 2
    assert "either forces_N or displacements_mm" in capsys.readouterr().err


def test_summary_and_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One JSON object; the curve is that of the whole tool, in the summary, the history and the file as others read it."""
    assert command(["run", str(REAR), "--out", str(tmp_path), "--json", *QUICK]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["status"] == "finished" and summary["message"] == ""
    assert ["too few to check the energy balance" in note for note in summary["warnings"]] == [True]  # the work, from three loads
    assert [point["force_N"] for point in summary["curve"]] == pytest.approx([0.1, 0.2, 0.3], rel=1e-3)
    ways = [point["displacement_mm"] for point in summary["curve"]]
    # An independent solver has 1.086, 2.074, 2.966 mm; elements of 1.2 mm at an edge of 1 mm are coarse: 3 %.
    assert ways == pytest.approx([1.0858, 2.0737, 2.9664], rel=0.03)
    assert summary["penetration_ratio"] <= 1e-3 and summary["reaction_error"] < 1e-3 and summary["energy_balance_error"] < 1e-2
    assert len(summary["loads"]) == 3 and all(load["residual"] <= 1e-4 for load in summary["loads"])
    with explicitfe.open_result(summary["result"]) as result:
        assert list(result.times) == [0.0, 1.0, 2.0, 3.0]
        assert 1e3 * result.history("indentation")[1:] == pytest.approx(ways, abs=1e-12)
        deepest = result.probe("top-centre")[3, 2]
        assert -1e3 * deepest == pytest.approx(ways[-1], rel=2e-3)
        assert result.field("strain_energy_density", 3).min() > 0.0
        # what the elements store adds up to what the history says
        stored = result.history("internal_energy")[3] + result.history("hourglass_energy")[3]
        shown = result.mesh_at(3)
        assert shown.n_cells == summary["hexes"]
        assert stored == pytest.approx(0.5e-3 * 0.3 * ways[-1], rel=0.1)
    with h5py.File(summary["result"]) as file:
        assert file["explicitfe/status/state"][()] == b"finished"


def test_same_run_twice_is_the_same(tmp_path: Path) -> None:
    first = explicitfe.run(REAR, tmp_path / "a", settings=QUICK_SETTINGS)
    again = explicitfe.run(REAR, tmp_path / "b", settings=QUICK_SETTINGS)
    assert first["curve"] == again["curve"] and first["iterations"] == again["iterations"]


def test_displacements_and_times(tmp_path: Path) -> None:
    """Loading, holding and unloading by displacement: the elastic force depends on the way alone."""
    settings = ["model.edge_size_mm=0.8", "analysis.displacements_mm=[1, 2, 2, 1]", "analysis.times_s=[1, 2, 12, 12.5]"]
    summary = explicitfe.run(BALL, tmp_path, settings=[*settings[:2], settings[2]])
    force = [point["force_N"] for point in summary["curve"]]
    assert [point["displacement_mm"] for point in summary["curve"]] == pytest.approx([1, 2, 2, 1], abs=1e-12)
    assert force[2] == force[1] and force[3] == pytest.approx(force[0], rel=1e-3)
    with explicitfe.open_result(summary["result"]) as result:
        assert list(result.times) == [0.0, 1.0, 2.0, 12.0, 12.5]


def test_unreachable_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """100 N on 20 mm of tongue: a status, a sentence, exit code 3, and everything that converged is kept."""
    arguments = [*QUICK[:-1], "analysis.forces_N=[0.1, 0.2, 100]"]
    assert command(["run", str(REAR), "--out", str(tmp_path), "--json", *arguments]) == 3
    shown = capsys.readouterr()
    summary = check_answer("run", shown.out)
    assert summary["status"] in ("inverted", "not-converged")
    assert summary["failure"]["kind"] == "simulation" and summary["failure"]["exit_code"] == 3
    for word in ("100 N was not reached", "mm", "The last converged load is", "edge_size_mm"):
        assert word in summary["message"] and word in shown.err.replace("\n", " ")
    assert [point["force_N"] for point in summary["curve"]] == pytest.approx([0.1, 0.2], rel=1e-3)
    with explicitfe.open_result(summary["result"]) as result:
        assert result.status == summary["status"] and len(result.times) == 3
        assert np.isfinite(result.displacement(2)).all()


def test_after_a_load_that_was_not_reached_one_can_go_on() -> None:
    body = prepare(REAR, QUICK_SETTINGS).body
    body.compile()
    body.settle()
    body.press(0.2)
    before = body.displacement.copy()
    stuck = body.press(1000.0)
    assert isinstance(stuck, Stuck) and 0.2 <= stuck.reached < 1000.0
    if stuck.reached == 0.2:
        assert np.array_equal(body.displacement, before)
    again = body.press(0.2)
    assert not isinstance(again, Stuck) and np.abs(body.displacement - before).max() < 1e-3 * np.abs(before).max()


def test_check_predicts(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["check", str(REAR), "--json", *QUICK]) == 0
    check = json.loads(capsys.readouterr().out)
    assert check["loads"] == 3 and check["predicted_iterations"] == 9000 and check["hexes"] > 50
    assert check["folded"] == {"elements": 0, "undecided": 0}
    assert command(["check", str(REAR), *QUICK]) == 0
    assert "iterations" in capsys.readouterr().out


def test_inspect_and_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["run", str(REAR), "--out", str(tmp_path), "--plots", *QUICK]) == 0
    assert {path.name for path in tmp_path.glob("*.png")} == {"indentation-rear-curve.png", "indentation-rear-section.png"}
    capsys.readouterr()
    assert command(["inspect", str(tmp_path / "indentation-rear.vtkhdf")]) == 0
    shown = capsys.readouterr().out
    assert "0.3 N at" in shown and "flat-cylinder" in shown
