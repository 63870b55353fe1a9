"""The verdicts of the loop on simulated sensors of a tongue, by hidden effect and noise.

Prints the table of docs/studies/close-loop-trajectories.md.

    OMP_NUM_THREADS=1 python studies/benchmarks/sensor_study.py [--noise 0.05 0.2 0.5] [--hidden "lag 15 ms"] [--processes 2]

The data come from a finer mesh of eight-point elements with a smaller step; the fit has the coarse mesh of one-point elements.
Two gestures are fitted, a third one is held out.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.inverse.close_loop.comparison import compare
from explicitfe.inverse.close_loop.statistics.intervals import intervals
from explicitfe.inverse.close_loop.statistics.system import Hypothesis
from explicitfe.inverse.close_loop.trajectories.lever import Experiment
from explicitfe.inverse.close_loop.trajectories.levers import levers_of
from explicitfe.inverse.close_loop.trajectories.runs import Sites, motion_of
from explicitfe.inverse.close_loop.trajectories.trajectories import Trajectories, trajectory_system
from explicitfe.inverse.close_loop.verdict import Outcome, conclude
from explicitfe.inverse.measured.curve import Dataset, TrajectoryDataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.simulate.anatomy.tongue import anatomy_of
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario

SENSORS = {"TT": "tip", "TB": "front", "TD": "dorsum", "TR": "root"}
# Of the sensors' frame: x_model = scale R x + t.
TURN = Rotation.from_rotvec([0.1, -0.3, 0.2]).as_matrix()
SHIFT_M = np.array([0.05, 0.01, 0.03])

# The first shape of the tongue: the thin tip of the second has a larger numerical error on the coarse meshes that the tests use.
SCENARIO = """title = "Tongue forward, and let go"
[model]
name = "tongue-1"
{mesh}
material = "buchaillard-2009"
damping = {{ alpha_per_s = 40.0 }}
[[muscle]]
name = "GGp"
force_N = 2.0
end_ms = 80.0
distribution = "along"
[[muscle]]
name = "GGa"
force_N = 0.2
end_ms = 80.0
distribution = "along"
[analysis]
duration_ms = {duration_ms}
"""
GESTURES: dict[str, tuple[str, ...]] = {
    "strong": (),
    "weak": ("muscle.GGp.force_N=1.0", "muscle.GGa.force_N=0.1"),
    "body": ("muscle.GGp.force_N=1.5", "muscle.GGa.force_N=0.0"),
}

NUMERICS = ("model.resolution=medium", "model.element=hex8-full", "analysis.step_us=15.0")
HIDDEN: dict[str, tuple[str, float] | None] = {
    "none": None,
    "lag 15 ms": ("activation-lag", 15.0),
    "damping x 3": ("damping", 120.0),
    "gravity": ("gravity", 9.81),
    "force x 0.8": ("force-scale", 0.8),
    "stiffness x 1.3": ("stiffness", 1.3),
    "MH 2.67 N": ("missing-MH", 2.67),
    "MH, 1.2 of all forces": ("missing-MH-share", 1.2),
}
FITTED, HELD, DURATION_MS = ("strong", "weak"), "body", 120.0
COARSE = 'resolution = "coarse"'


def simulate_sensors(
    folder: Path,
    *,
    hidden: Mapping[str, Sequence[str]] = MappingProxyType({}),
    numerics: Sequence[str] = (),
    gestures: Sequence[str] = ("strong", "weak", "body"),
    holdout: str | None = None,
    noise_mm: float = 0.2,
    rate_hz: float = 200.0,
    duration_ms: float = 120.0,
    mesh: str = COARSE,
    registration: str = "fit",
    seed: int = 0,
) -> Dataset:
    """Write a dataset and read it.

    Parameters
    ----------
    hidden : settings of the scenario that the fit does not know, by gesture; "*" stands for all gestures.
    numerics : settings that change the numerics of the data, not the physics.
    mesh : the line of the fit's scenario that chooses its mesh; the sensors sit on points of this mesh.
    registration : "fit", or "given" where sensors are in the model's frame.
    """
    folder.mkdir(parents=True)
    scenario = folder / "scenario.toml"
    scenario.write_text(SCENARIO.format(duration_ms=float(duration_ms), mesh=mesh), encoding="utf-8")
    body = prepare(scenario).model.mesh
    at_rest = np.concatenate([body.named_points[point].position for point in SENSORS.values()])
    times_s = np.arange(0.0, 1e-3 * duration_ms + 1e-9, 1.0 / rate_hz)
    random = np.random.default_rng(seed)
    lines = [
        'format = "explicitfe-dataset/1"',
        'name = "simulated-sensors"',
        'title = "Simulated"',
        'test = "trajectory"',
        'scenario = "scenario.toml"',
        *(f'[[sensor]]\nname = "{name}"\nmodel_point = "{point}"' for name, point in SENSORS.items()),
        f"[noise]\ndisplacement_sd_mm = {noise_mm}",
    ]
    if registration == "fit":
        lines.append('[registration]\nrotation = "fit"\ntranslation = "fit"')
    for name in gestures:
        settings = (*numerics, *GESTURES[name], *hidden.get("*", ()), *hidden.get(name, ()))
        seen = at_rest + _displacements(float(duration_ms), mesh, settings, tuple(times_s))
        if registration == "fit":
            seen = (seen - SHIFT_M) @ TURN
        seen = 1e3 * seen + noise_mm * random.standard_normal(seen.shape)
        head = ["time_s", *(f"{sensor}_{axis}_mm" for sensor in SENSORS for axis in "xyz")]
        rows = np.column_stack([times_s, seen.reshape(len(seen), -1)])
        text = "\n".join([",".join(head), *(",".join(f"{x:.6f}" for x in row) for row in rows)])
        (folder / f"{name}.csv").write_text(text + "\n", encoding="utf-8")
        split = "holdout" if name == holdout else "fit"
        lines.append(f'[[curve]]\nid = "{name}"\nfile = "{name}.csv"\nsplit = "{split}"')
        lines.append(f"conditions = {{ settings = {list(GESTURES[name])!r} }}")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_dataset(folder)


@cache  # other noise needs no other run
def _displacements(duration_ms: float, mesh: str, settings: tuple[str, ...], times_s: tuple[float, ...]) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.toml"
        path.write_text(SCENARIO.format(duration_ms=duration_ms, mesh=mesh), encoding="utf-8")
        body = prepare(path).model.mesh
        at_rest = np.concatenate([body.named_points[point].position for point in SENSORS.values()])
        return motion_of(path, settings, Sites.at(at_rest), times_s).displacement


def experiment(scenario: TransientScenario, scenarios: Sequence[TransientScenario], path: Path) -> Experiment:
    """What levers depend on, of a scenario without recordings."""
    head = dict.fromkeys(("name", "title", "source", "license", "notes"), "")
    empty = TrajectoryDataset(**head, test="trajectory", path=path, curves=())
    return Experiment(scenario, anatomy_of(scenario.model, path.parent), empty, scenarios)


def settings_of(hidden: tuple[str, float] | None, folder: Path) -> Mapping[str, Sequence[str]]:
    """The settings of a hidden effect for each gesture."""
    if hidden is None:
        return {}
    path = folder / "plain.toml"
    path.write_text(SCENARIO.format(duration_ms=DURATION_MS, mesh=COARSE), encoding="utf-8")
    scenarios = {}
    for name, own in GESTURES.items():
        scenario, _ = read_scenario(path, own)
        assert isinstance(scenario, TransientScenario)
        scenarios[name] = scenario
    lever = levers_of(experiment(scenario, list(scenarios.values()), path))[hidden[0]]
    (parameter,) = lever.sought
    return {name: lever.settings(scenario, {parameter: hidden[1]}) for name, scenario in scenarios.items()}


def rms_mm(system: Trajectories, model: Hypothesis) -> float:
    """Rms deviation of a model from the measured displacements [mm]."""
    (answer,) = system.answers([model])
    assert answer is not None
    return float(1e3 * np.sqrt(np.mean([np.mean((y - one.measured) ** 2) for y, one in zip(answer, system.series, strict=True)])))


def row(name: str, noise_mm: float, system: Trajectories, outcome: Outcome, seconds: float) -> str:
    """One line of the table."""
    first, final = outcome.comparison.baseline, outcome.final
    assert first.fit is not None and final.fit is not None and final.covariance is not None
    ranges = [
        f"{p.name} {value:.4g} [{low:.4g}, {high:.4g}]"
        for p, value, (low, high) in zip(
            final.model.parameters, final.model.values, intervals(final.fit, final.covariance), strict=True
        )
        if "." in p.name
    ]
    named = (*outcome.present, *(f"{name}?" for name in outcome.undecided))
    held = system.for_curves(c for c in system.dataset.curves if c.split == "holdout")
    before, after = (rms_mm(held, one.model) for one in (first, final))
    cells = [name, f"{noise_mm:g}", outcome.verdict, f"{outcome.sure:.2f}", ", ".join(named), "; ".join(ranges)]
    return f"| {' | '.join(cells)} | {before:.2f} -> {after:.2f} | {system.runs.count} | {seconds:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.05, 0.2, 0.5], help="sd of a coordinate [mm]")
    parser.add_argument("--hidden", nargs="+", choices=HIDDEN, default=list(HIDDEN))
    parser.add_argument("--processes", type=int, default=1)
    chosen = parser.parse_args()
    print("| hidden | noise mm | verdict | probability | causes | found, 95 % | rms on the held-out gesture, mm | runs | s |")
    print("|---|---|---|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for hidden in chosen.hidden:
            for noise_mm in chosen.noise:
                begin = time.perf_counter()
                dataset = simulate_sensors(
                    folder / f"{hidden} {noise_mm}",
                    hidden=settings_of(HIDDEN[hidden], folder),
                    numerics=NUMERICS,
                    gestures=(*FITTED, HELD),
                    holdout=HELD,
                    noise_mm=noise_mm,
                    duration_ms=DURATION_MS,
                    seed=len(hidden),
                )
                fitted = [c for c in dataset.curves if c.split == "fit"]
                system = trajectory_system(dataset, fitted, chosen.processes)
                outcome = conclude(compare(system, max_effects=2, rows=system.rows))
                print(row(hidden, noise_mm, system, outcome, time.perf_counter() - begin), flush=True)
                system.runs.workers.close()


if __name__ == "__main__":
    main()
