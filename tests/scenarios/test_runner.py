"""The runner as a user and a program meet it: command, JSON, result, Python interface, restart, kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from answers import check_answer
from command import command

import explicitfe
from explicitfe.app.tools.lists import LISTS
from explicitfe.app.view.hourglass import hourglass_share
from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.hexmesh import shape_functions
from explicitfe.fem.solve.transient import Transient
from explicitfe.results.files import open_result
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.read import json_schema

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
VOWEL = ROOT / "scenarios" / "vowel-i.toml"
FORCES_ON_NODES = ROOT / "scenarios" / "vowel-i-gerard-2005.toml"
SMALL = ("model.cells=[8,4,4]", "analysis.duration_ms=10", "record.every_ms=1")
KEYS = [
    "status",
    "result",
    "simulated_s",
    "steps",
    "dt_s",
    "dt_fraction_of_limit",
    "wall_s",
    "loop_s",
    "compile_s",
    "real_time_factor",
    "energy_balance_error",
    "hourglass_share",
    "min_J",
    "folded",
    "settled",
    "probes",
]


def test_json_is_one_object_and_nothing_else(tmp_path: Path) -> None:
    """stdout holds one JSON object with the promised keys, in a process of its own; progress goes to stderr."""
    settings = [word for setting in SMALL for word in ("--set", setting)]
    done = subprocess.run(
        [sys.executable, "-m", "explicitfe", "run", str(VOWEL), "--out", str(tmp_path), "--json", *settings],
        capture_output=True, text=True, check=True, cwd=tmp_path,
    )  # fmt: skip
    summary = json.loads(done.stdout)
    assert set(KEYS) <= set(summary)
    assert summary["status"] == "finished"
    assert summary["simulated_s"] == pytest.approx(0.010, rel=1e-12)
    assert 0.0 < summary["dt_fraction_of_limit"] < 1.0
    assert summary["energy_balance_error"] < 1e-3
    assert 0.0 < summary["min_J"] <= 1.0
    assert summary["folded"] == {"elements": 0, "undecided": 0}
    tip = summary["probes"]["tip"]
    assert len(tip["displacement_mm"]) == 3 and tip["speed_mm_s"] > 0.0
    assert "running" in done.stderr
    with open_result(tmp_path / "vowel-i.vtkhdf") as result:
        mesh, last = result.mesh, result.displacement(step=-1)
        # Cells along s put the dorsum, s = 0.32, between nodes: it moves as the trilinear element does.
        for name, point in mesh.named_points.items():
            moved = (shape_functions(point.natural[0])[:, None] * last[mesh.hexes[point.element[0]]]).sum(axis=0)
            assert summary["probes"][name]["displacement_mm"] == pytest.approx(1e3 * moved, abs=1e-12)
            assert result.history(f"probe_{name}_displacement")[-1] == pytest.approx(moved, abs=1e-15)
            np.testing.assert_allclose(result.probe(name)[-1], moved, rtol=0.0, atol=1e-15)
            assert result.model["probes"][name] == {"position_mm": pytest.approx(1e3 * point.position[0], abs=1e-12)}
        assert np.abs(mesh.named_points["dorsum"].natural[0, 0]) < 0.9


def test_result_agrees_between_pyvista_and_h5py(tmp_path: Path) -> None:
    """At three times the displacement that pyvista shows is, bit for bit, the one that h5py reads."""
    summary = explicitfe.run(VOWEL, tmp_path, settings=SMALL)
    with h5py.File(summary["result"]) as file, open_result(summary["result"]) as result:
        times = file["VTKHDF/Steps/Values"][:]
        assert len(times) == 11
        nodes = file["VTKHDF/NumberOfPoints"][0]
        stored = file["VTKHDF/PointData/displacement"][:].reshape(len(times), nodes, 3)
        for step in (0, 5, 10):
            shown = np.asarray(result.mesh_at(time_s=times[step]).point_data["displacement"])
            assert np.array_equal(shown, stored[step])
        assert np.abs(stored[10]).max() > 1e-4


def test_recording_does_not_change_the_run(tmp_path: Path) -> None:
    """Samples every 0.37 ms or every 5 ms: the same steps and, bit for bit, the same end."""
    ends, steps = [], []
    for number, every in enumerate((0.37, 5.0)):
        summary = explicitfe.run(VOWEL, tmp_path / str(number), settings=[*SMALL, f"record.every_ms={every}"])
        steps.append(summary["steps"])
        with open_result(summary["result"]) as result:
            ends.append(result.displacement(step=-1))
    assert steps[0] == steps[1]
    assert np.array_equal(ends[0], ends[1])


def test_samples_carry_their_own_time(tmp_path: Path) -> None:
    """A sample is the first instant at or after the time asked for, less than a step later."""
    summary = explicitfe.run(VOWEL, tmp_path, settings=[*SMALL, "record.every_ms=2.5"])
    with open_result(summary["result"]) as result:
        late = np.asarray(result.times) - 0.0025 * np.arange(5)
        longest = result.history("dt").max()
    assert np.all(late >= -1e-12) and np.all(late <= longest)
    assert late[-1] == pytest.approx(0.0, abs=1e-15)  # the last step ends at the duration


def test_restart_is_bitwise() -> None:
    """A run that goes on from a stored state ends, bit for bit, where the one that was not stopped ends."""
    whole = Transient(prepare(VOWEL, SMALL).body, 0.010)
    assert whole.advance_to(0.004) is None
    state = {name: array.copy() for name, array in whole.restart_state().items()}
    assert whole.advance_to(0.010) is None
    resumed = Transient(prepare(VOWEL, SMALL).body, 0.010)
    resumed.restore(state)
    assert resumed.advance_to(0.010) is None
    assert np.array_equal(whole.simulation.displacement, resumed.simulation.displacement)
    assert np.array_equal(whole.simulation.ledger, resumed.simulation.ledger)
    assert whole.simulation.steps == resumed.simulation.steps


def test_killed_run_is_readable_to_its_last_sample(tmp_path: Path) -> None:
    """kill -9 in mid-run: the file opens, says that it was running, and every sample in it is whole."""
    process = subprocess.Popen(
        [sys.executable, "-m", "explicitfe", "run", str(VOWEL), "--out", str(tmp_path), "--set", "model.cells=[8,4,4]",
         "--set", "analysis.duration_ms=100000"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    running = tmp_path / "vowel-i.running.vtkhdf"
    try:
        deadline = time.monotonic() + 120.0
        while _samples(running) < 20 and time.monotonic() < deadline:
            assert process.poll() is None, "the run ended before it could be killed"
            time.sleep(0.1)
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with open_result(running) as result:
        assert result.status == "running"
        count = len(result.times)
        assert count >= 20
        assert np.all(np.diff(result.times) > 0.0)
        last = result.displacement(step=-1)
        assert np.all(np.isfinite(last)) and np.abs(last).max() > 0.0
        assert np.array_equal(np.asarray(result.mesh_at(step=count - 1).point_data["displacement"]), last)
        assert result.restart_state() is not None


def _samples(path: Path) -> int:
    """Samples in a result that is being written; 0 while it is being made."""
    try:
        with open_result(path) as result:
            return len(result.times)
    except explicitfe.InputError:
        return 0


def test_inverted_element_stops_the_run_and_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A force far too large ends with exit code 3, a sentence with element, place and time, and the samples until then."""
    settings = [word for setting in (*SMALL, "muscle.GGp.force_N=1000") for word in ("--set", setting)]
    assert command(["run", str(FORCES_ON_NODES), "--out", str(tmp_path), "--json", *settings]) == 3
    captured = capsys.readouterr()
    summary = check_answer("run", captured.out)
    assert summary["status"] in ("inverted", "diverged")
    assert "ms" in summary["message"] and summary["message"] in captured.err.replace("\n", " ")
    if summary["status"] == "inverted":
        assert "element" in summary["message"] and "mm" in summary["message"]
    with open_result(tmp_path / f"{FORCES_ON_NODES.stem}.vtkhdf") as result:
        assert result.status == summary["status"] and len(result.times) >= 1


@pytest.mark.parametrize("scenario", [VOWEL, FORCES_ON_NODES])
def test_advice_is_what_is_not_done_already(scenario: Path, tmp_path: Path) -> None:
    """Forces on nodes are to be spread as a stress; muscles that pull by a stress already do so, and no word asks them to."""
    settings = [*SMALL, "muscle.GGp.force_N=30", "analysis.duration_ms=40"]
    summary = explicitfe.run(scenario, tmp_path, settings=settings)
    words = " ".join([*summary["warnings"], summary["message"]])
    assert summary["status"] == "inverted" or "hourglass energy reaches" in words or "are folded" in words
    on_nodes = 'distribution = "stress"' not in scenario.read_text(encoding="utf-8")
    assert ('(distribution = "stress")' in words) == on_nodes


def test_settings_reach_into_arrays_by_name(tmp_path: Path) -> None:
    """--set muscle.GGp.force_N=0 with GGa 0 leaves the tongue where it is; the stored scenario says what was set."""
    settings = [*SMALL, "jaw.opening_mm=0", "muscle.GGp.force_N=0", "muscle.GGh.force_N=0", "muscle.GGa.force_N=0"]
    summary = explicitfe.run(VOWEL, tmp_path, settings=settings)
    assert summary["largest_displacement_mm"] == 0.0
    assert summary["settled"]
    with open_result(summary["result"]) as result:
        assert "# --set muscle.GGp.force_N=0" in result.scenario_text


def test_body_that_never_moved_is_at_rest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = [word for setting in (*SMALL, "muscle=[]", "jaw.opening_mm=0") for word in ("--set", setting)]
    assert command(["run", str(VOWEL), "--out", str(tmp_path), *settings]) == 0
    assert "at rest" in capsys.readouterr().out


def test_gravity_sags_by_free_fall_at_first(tmp_path: Path) -> None:
    """Without attachments and bones gravity is free fall: u = g t^2 / 2, which central differences give exactly."""
    settings = [*SMALL, "model.fixed=[]", "bone=[]", "model.gravity_m_s2=[0,0,-9.81]", "model.damping.alpha_per_s=0"]
    summary = explicitfe.run(
        VOWEL, tmp_path, settings=[*settings, "muscle.GGp.force_N=0", "muscle.GGh.force_N=0", "muscle.GGa.force_N=0"]
    )
    for probe in summary["probes"].values():
        assert probe["displacement_mm"][2] == pytest.approx(-0.5 * 9.81 * 0.010**2 * 1e3, rel=1e-9)
    assert summary["energy_balance_error"] < 1e-9
    # It is not strained: what the elastic energy has is rounding, and its shares mean nothing.
    assert (summary["hourglass_share"], summary["hourglass_share_end"]) == (0.0, 0.0)
    assert [warning.split(",")[0] for warning in summary["warnings"]] == ["nothing holds the body"]
    with open_result(summary["result"]) as result:
        assert np.all(np.isnan(hourglass_share(result)))


@pytest.mark.parametrize("path", sorted((ROOT / "scenarios").glob("*.toml")), ids=lambda path: path.stem)
def test_every_scenario_builds_and_runs_coarsely(path: Path, tmp_path: Path) -> None:
    """Each scenario that comes with the program opens with a question and runs on a coarse mesh for a few steps."""
    prepared = prepare(path)
    assert prepared.scenario.question.endswith("?")
    tongue = ["model.cells=[8,4,4]", "analysis.duration_ms=5"]
    specimen = ["model.symmetry=sector", "model.refinement=0.5"]
    indents = prepared.name == "specimen"
    summary = explicitfe.run(path, tmp_path, settings=specimen if indents else tongue)
    # On so coarse a mesh an indentation's curve is rough by half a percent where faces come into contact: so is its area.
    assert summary["status"] == "finished" and summary["energy_balance_error"] < (5e-3 if indents else 1e-3)


@pytest.mark.parametrize("what", ["models", "muscles", "scenarios", "materials", "effects"])
def test_lists(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["list", what, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)[what]
    expected = {
        "models": "tongue",
        "muscles": "GGp",
        "scenarios": "vowel-i",
        "materials": "buchaillard-2009",
        "effects": "viscoelastic",
    }[what]
    assert expected in [next(iter(row.values())) for row in rows]
    assert len(rows) >= (11 if what == "muscles" else 3)


@pytest.mark.parametrize("what", ["models", "muscles", "scenarios", "materials", "effects"])
def test_lists_never_cut_a_name(what: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal of 80 columns every name that a user has to type stands there whole."""
    monkeypatch.setenv("COLUMNS", "80")
    assert command(["list", what]) == 0
    shown = capsys.readouterr().out
    for row in LISTS[what]():
        assert next(iter(row.values())) in shown
    if what == "materials":
        assert "C10 191.5 Pa, C20 90.6 Pa" in shown


def test_list_of_materials_shows_the_constants_of_any_law(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogue, "materials", lambda: {"soft": NeoHooke(law="neo-hooke", C10_Pa=100.0)})
    assert command(["list", "materials"]) == 0
    shown = capsys.readouterr().out
    assert "C10 100 Pa, poisson 0.499" in shown and "None" not in shown


def test_check_predicts_without_running(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """check says how many steps a run will take: within 10 % of what it then takes."""
    settings = [word for setting in SMALL for word in ("--set", setting)]
    assert command(["check", str(VOWEL), "--json", *settings]) == 0
    check = json.loads(capsys.readouterr().out)
    summary = explicitfe.run(VOWEL, tmp_path, settings=SMALL)
    assert check["stable"] and check["predicted_steps"] == pytest.approx(summary["steps"], rel=0.1)
    assert check["hexes"] == 128 and check["predicted_wall_s"] > 0.0
    assert check["stable_step_bound_us"] <= check["stable_step_us"]
    assert check["folded"] == {"elements": 0, "undecided": 0}


def test_inspect_shows_what_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    summary = explicitfe.run(VOWEL, tmp_path, settings=SMALL)
    assert command(["inspect", summary["result"], "--json"]) == 0
    text = capsys.readouterr().out
    read = json.loads(text)
    assert read["status"] == "finished"
    for word in ("displacement", "hourglass_energy", "kinetic_energy", "tip", "explicitfe"):
        assert word in text
    tip_m = [1e-3 * x for x in summary["probes"]["tip"]["displacement_mm"]]
    assert read["last"]["probe_tip_displacement"] == pytest.approx(tip_m, rel=1e-12)
    monkeypatch.setenv("COLUMNS", "80")
    assert command(["inspect", summary["result"]]) == 0
    shown = capsys.readouterr().out
    assert "{" not in shown and len(shown.splitlines()) < 90
    for words in (
        "finished",
        "11 samples, 0 to 10 ms, every 1 ms",
        "displacement (m)",
        "kinetic energy",
        "GGp 1.33 N",
        "tip",
        "numba",
    ):
        assert words in shown
    assert next(line for line in shown.splitlines() if "│" in line).split()[1:4] == ["status", "│", "finished"]
    x, _, z = summary["probes"]["tip"]["displacement_mm"]
    along, above = "back" if x > 0.0 else "forward", "down" if z < 0.0 else "up"
    assert f"{along} {abs(x):.2f}, {above} {abs(z):.2f} mm" in shown


def test_check_shows_no_raw_numbers(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert command(["check", str(VOWEL), "--set", SMALL[0], "--set", 'muscle.GGa.side="left"']) == 0
    shown = capsys.readouterr().out
    assert "{" not in shown and len(shown.splitlines()) < 30
    for words in (
        "128 hexahedra",
        "GGa 0.2 N: ramp from 0 ms in 50 ms; stress, left side",
        "C10 1037 Pa",
        "beta 0.03 s",
        "palate, jaw",
        "stable",
    ):
        assert words in shown


def test_run_that_was_killed_is_inspected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No summary yet: the table does without it."""
    summary = explicitfe.run(VOWEL, tmp_path, settings=SMALL)
    with h5py.File(summary["result"], "r+") as file:
        file["explicitfe/status/state"][()] = b"running"
    assert command(["inspect", summary["result"]]) == 0
    assert "running (killed)" in capsys.readouterr().out


def test_scenario_in_the_result_can_be_run_again(tmp_path: Path) -> None:
    """The stored scenario has --set and defaults in it; as a file of its own it gives, bit for bit, the same end."""
    settings = [*SMALL, "muscle.GGp.force_N=1.5", "model.material={C10_Pa=300.0, C20_Pa=100.0}", "record.probes=[]"]
    first = explicitfe.run(VOWEL, tmp_path, settings=settings)
    with open_result(first["result"]) as result:
        model, u = result.model, result.displacement()
        assert result.contents()["model"] == model
    stored = model["scenario"]
    assert stored["muscle"][0]["force_N"] == 1.5 and stored["analysis"]["duration_ms"] == 10.0
    (tmp_path / "again.json").write_text(json.dumps(stored))
    again = explicitfe.run(tmp_path / "again.json", tmp_path)
    with open_result(again["result"]) as result:
        assert np.array_equal(result.displacement(), u)
        assert {**result.model, "scenario_file": model["scenario_file"]} == model


def test_help_carries_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ([], ["run"], ["check"], ["inspect"], ["list"], ["schema"]):
        assert command([*name, "--help"]) == 0
        assert "Example" in capsys.readouterr().out


def test_schema_in_the_repository_is_that_of_the_program() -> None:
    """Editors read scenarios/scenario.schema.json; it is what ``explicitfe schema`` prints."""
    assert json.loads((ROOT / "scenarios" / "scenario.schema.json").read_text()) == json_schema()
