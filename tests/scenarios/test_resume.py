"""A run that was stopped goes on, and ends as if nothing had been: bit for bit with as many threads, to rounding with others."""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista
from command import command
from kills import numbers
from support import ROOT

import explicitfe
from explicitfe.fem.mesh.box import box
from explicitfe.platform.errors import Progress
from explicitfe.platform.host import stopping
from explicitfe.platform.host.result_files import final_path, running_path
from explicitfe.results.files import open_result

TONGUE = ROOT / "scenarios/vowel-i.toml"
REAR = ROOT / "scenarios/indentation-rear.toml"
RUNS = {
    "in time": (TONGUE, ("model.cells=[8, 4, 4]", "analysis.duration_ms=30", "record.every_ms=1", "analysis.threads=1")),
    "equilibria": (REAR, ("model.refinement=0.4", "analysis.threads=1")),
}
MORE_ROUNDING = 100.0  # of what follows from small differences of displacements: velocities, and forces of stiff contact springs
NAMED = pytest.mark.parametrize(("scenario", "settings"), RUNS.values(), ids=RUNS)


@pytest.fixture(autouse=True)
def often_back_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short run returns from compiled code many times: it can be stopped on its way."""
    monkeypatch.setattr("explicitfe.fem.solve.transient.SECONDS_BETWEEN_RETURNS", 0.0)


def interrupting(share: float, number: signal.Signals = signal.SIGINT) -> Progress:
    """Progress that sends this process a signal, once, when a share of the run is done."""
    sent: list[bool] = []

    def progress(stage: str, done: float) -> None:
        if stage in ("run", "load-step") and done >= share and not sent:
            sent.append(True)
            signal.raise_signal(number)

    return progress


def interrupted(scenario: Path, out: Path, settings: Sequence[str], share: float = 0.3) -> dict:
    """A run that was stopped after a share of it."""
    summary = explicitfe.run(scenario, out, settings=settings, progress=interrupting(share))
    assert summary["status"] == "interrupted", summary
    return summary


def compare(path: str | Path, wanted: str | Path, *, rounding: float = 0.0) -> None:
    """See that two results hold the same numbers, to a share of the largest of each kind."""
    with open_result(path) as one, open_result(wanted) as other:
        assert one.status == other.status == "finished"
        theirs = dict(numbers(other))
        for name, values in numbers(one):
            # the balance is a difference of energies, relative to these, and muscles apply forces of 1 N that add up to none
            largest = 1.0 if name in ("history balance_error", "history applied_force") else np.abs(theirs[name]).max(initial=0.0)
            share = rounding * (1.0 if "displacement" in name or name == "times" else MORE_ROUNDING)
            np.testing.assert_allclose(values, theirs.pop(name), rtol=0.0, atol=share * largest, err_msg=name)
        assert not theirs
        for key in ("steps", "iterations", "curve", "loads", "energy_balance_error", "probes", "warnings", "dt_s"):
            if key in one.summary and not rounding:
                assert one.summary[key] == other.summary[key], key


@NAMED
def test_a_stopped_run_goes_on_bit_by_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path, settings: tuple[str, ...]
) -> None:
    """Stopped twice on its way; what is stored in between is whole, says so, and names the command that goes on."""
    whole = explicitfe.run(scenario, tmp_path / "whole", settings=settings)
    first = interrupted(scenario, tmp_path / "parts", settings)
    with open_result(first["result"]) as result:
        samples = len(result.times)
        assert result.status == "interrupted" and samples > 1
        assert f"explicitfe resume {first['result']}" in result.message
        restart = result.contents()["restart"]
    assert restart is not None and restart["samples"] == samples and restart["command"] == f"explicitfe resume {first['result']}"
    assert abs(datetime.now(UTC) - datetime.fromisoformat(restart["stored_utc"] or "")) < timedelta(minutes=10)
    capsys.readouterr()
    assert command(["inspect", first["result"]]) == 0
    assert f"after {samples} samples" in capsys.readouterr().out
    second = explicitfe.resume(first["result"], progress=interrupting(0.6))
    assert second["status"] == "interrupted"
    with open_result(second["result"]) as result:
        assert len(result.times) > samples
    last = explicitfe.resume(second["result"])
    assert last["result"] == str(final_path(Path(first["result"])))
    assert [path.name for path in (tmp_path / "parts").iterdir()] == [Path(whole["result"]).name]
    compare(last["result"], whole["result"])


def test_a_run_goes_on_with_other_threads(tmp_path: Path) -> None:
    """The sums of two threads round otherwise: 1e-12 of the largest number of each kind."""
    scenario, settings = RUNS["in time"]
    settings = tuple(setting for setting in settings if "threads" not in setting)
    whole = explicitfe.run(scenario, tmp_path / "whole", settings=[*settings, "analysis.threads=2"])
    first = interrupted(scenario, tmp_path / "parts", [*settings, "analysis.threads=2"])
    path = Path(first["result"])
    explicitfe.resume(path, threads=1, progress=interrupting(0.6))
    explicitfe.resume(path, threads=2)
    compare(final_path(path), whole["result"], rounding=1e-12)


@NAMED
def test_run_with_resume_does_what_is_left_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario: Path, settings: tuple[str, ...]
) -> None:
    """Nothing begun: all of it; stopped: the rest; finished: nothing; begun with other values: a sentence with the first key."""
    words = [word for setting in settings for word in ("--set", setting)]
    arguments = ["run", str(scenario), "--out", str(tmp_path / "parts"), "--json", "--resume", *words]
    whole = explicitfe.run(scenario, tmp_path / "whole", settings=settings)
    interrupted(scenario, tmp_path / "parts", settings)
    for _ in range(2):
        capsys.readouterr()
        assert command(arguments) == 0
        summary = json.loads(capsys.readouterr().out)
        compare(summary["result"], whole["result"])
    before = Path(summary["result"]).read_bytes()
    assert command([*arguments, "--set", "model.element=hex8-stiffness"]) == 2
    assert "the scenario has changed: model.element was hex8 and is now hex8-stiffness." in capsys.readouterr().err
    assert Path(summary["result"]).read_bytes() == before
    shutil.rmtree(tmp_path / "parts")
    assert command(arguments) == 0
    compare(json.loads(capsys.readouterr().out)["result"], whole["result"])


def test_a_finished_result_is_not_replaced_by_a_part(tmp_path: Path) -> None:
    """With --overwrite too, a run that is stopped leaves what was finished in its place, and goes on beside it."""
    scenario, settings = RUNS["in time"]
    whole = explicitfe.run(scenario, tmp_path, settings=settings)
    before = Path(whole["result"]).read_bytes()
    part = explicitfe.run(scenario, tmp_path, settings=settings, overwrite=True, progress=interrupting(0.5))
    assert part["status"] == "interrupted" and part["result"].endswith(".running.vtkhdf")
    assert Path(whole["result"]).read_bytes() == before
    with pytest.raises(explicitfe.InputError, match="add `overwrite`"):
        explicitfe.resume(part["result"])
    last = explicitfe.resume(part["result"], overwrite=True)
    assert last["result"] == whole["result"] and len(list(tmp_path.iterdir())) == 1


def test_what_cannot_go_on_says_why(tmp_path: Path) -> None:
    """A run that failed; a file that is no result."""
    _, settings = RUNS["in time"]
    settings = (*settings, "muscle.GGp.force_N=1000")
    failed = explicitfe.run(ROOT / "scenarios/vowel-i-gerard-2005.toml", tmp_path, settings=settings)
    assert failed["status"] not in ("finished", "interrupted")
    with pytest.raises(explicitfe.InputError, match=f'cannot be resumed, because its run failed \\("{failed["status"]}"'):
        explicitfe.resume(failed["result"])
    with pytest.raises(explicitfe.InputError, match="does not exist"):
        explicitfe.resume(tmp_path / "other.vtkhdf")


def test_changed_files_are_noticed(tmp_path: Path) -> None:
    """Fibres, mesh or bone of one's own that are others now: the run that goes on would not be the one that was begun."""
    mesh = box((3, 3, 3), (0.01, 0.01, 0.01))
    pyvista.Box((0.0, 0.01, 0.0, 0.01, 0.011, 0.02)).triangulate().save(tmp_path / "plate.stl")
    nodes = np.flatnonzero(mesh.points[:, 2] == 0.0)
    model = f"""mesh = "block.vtu"
length_unit = "m"
fixed = ["base"]
node_sets = {{ base = {nodes.tolist()} }}
[[muscle]]
name = "M"
max_force_N = 1.0
fibre = [{{ side = "left", points = [[0.005, 0.005, 0.0], [0.005, 0.005, 0.01]] }}]
"""
    meshio.write(tmp_path / "block.vtu", meshio.Mesh(mesh.points, [("hexahedron", mesh.hexes)]))
    (tmp_path / "block.toml").write_text(model)
    scenario = tmp_path / "own.toml"
    scenario.write_text(
        'title = "own"\n[model]\nfile = "block.toml"\n[[bone]]\nname = "plate"\nfile = "plate.stl"\nlength_unit = "m"\n'
        '[[muscle]]\nname = "M"\nforce_N = 0.01\n[analysis]\nduration_ms = 20\nthreads = 1\n[record]\nevery_ms = 1\n'
    )
    path = Path(interrupted(scenario, tmp_path / "out", ())["result"])
    changes = {
        "block.toml": ("[0.005, 0.005, 0.0]", "[0.005, 0.006, 0.0]", "block.toml, which .* refers to, has changed"),
        "block.vtu": (None, meshio.Mesh(1.001 * mesh.points, [("hexahedron", mesh.hexes)]), "the mesh of .* has changed"),
        "plate.stl": (
            None,
            pyvista.Box((0.0, 0.01, 0.0, 0.01, 0.0115, 0.02)).triangulate(),
            "plate.stl, .* has changed",
        ),
    }
    for name, (old, new, sentence) in changes.items():
        before = (tmp_path / name).read_bytes()
        if old is not None:
            (tmp_path / name).write_text(model.replace(old, new))
        elif name.endswith("vtu"):
            meshio.write(tmp_path / name, new)
        else:
            new.save(tmp_path / name)
        with pytest.raises(explicitfe.InputError, match=sentence):
            explicitfe.resume(path)
        (tmp_path / name).write_bytes(before)
    assert explicitfe.resume(path)["status"] == "finished"


def test_a_whole_result_gets_its_name(tmp_path: Path) -> None:
    """A run that was killed after its last sample, before its file was renamed."""
    scenario, settings = RUNS["in time"]
    whole = Path(explicitfe.run(scenario, tmp_path, settings=settings)["result"])
    running = running_path(whole)
    whole.rename(running)
    assert explicitfe.resume(running)["result"] == str(whole)
    assert [*tmp_path.iterdir()] == [whole]


def test_a_run_that_is_stopped_before_its_first_sample_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And says so."""
    scenario, settings = RUNS["in time"]
    with stopping.watching(), pytest.raises(stopping.Stopped):
        explicitfe.run(scenario, tmp_path, settings=settings, progress=_at_once)
    assert not list(tmp_path.iterdir())


def _at_once(stage: str, share: float) -> None:
    signal.raise_signal(signal.SIGTERM)
    stopping.check()
