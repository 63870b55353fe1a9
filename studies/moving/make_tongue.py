"""Sealed cases of a soft tongue phantom that is released, made on a finer mesh, most of them with another element.

    python -m studies.moving.make_tongue OUT --count 22 --seed 2

makes folders OUT/tongue-NN: four markers on a tongue of gel that swings under its own weight and two loads at the tip. Every case
hides one effect that its scenario lacks, or none. The truth is in OUT/truth.json, beside that of other cases there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from explicitfe.fem.mesh.muscle_lines import locate_in_mesh
from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever
from explicitfe.inverse.close_loop.trajectories.levers import levers_of
from explicitfe.inverse.close_loop.trajectories.runs import Sites, motion_of
from explicitfe.inverse.measured.curve import TrajectoryDataset
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.simulate.anatomy.tongue import anatomy_of
from explicitfe.simulate.scenario.read import read_transient
from studies.moving.make import Moved, write_dataset

DATA_MESH = "model.cells=[16, 8, 8]"
# Effects of the material need the usual element; other data are made with another one.
DATA_ELEMENT, OF_THE_MATERIAL = "model.element=hex8-full", ("viscoelastic", "viscosity")
DURATION_S = 0.6
# Loads are spread over the tip, such as by a thread around it: below a point load, displacements have no limit under refinement.
LOADED_RADIUS_MM = 10.0
# Feet of the markers as named points, and the way from there to their centres.
MARKERS = {"tip": (-1.0, 0.0, 0.0), "blade": (-0.5, 0.0, 0.87), "front": (0.0, 0.0, 1.0), "dorsum": (0.0, 0.0, 1.0)}
CLAMP_MM = [[90.0, 25.0, 45.0], [90.0, -25.0, 45.0], [125.0, 0.0, 45.0]]
# Hidden effect -> smallest and largest strength, then values of its further parameters.
STRENGTHS: dict[str, tuple[float, ...]] = {
    "none": (0.0, 0.0),
    "viscoelastic": (0.1, 0.35, 0.04),
    "viscosity": (0.002, 0.008),
    "damping": (10.0, 18.0),
    "load-mass": (0.6, 1.0),
    "release": (15.0, 50.0),
    "load-delay": (20.0, 60.0),
    "gravity-direction-x": (4.0, 10.0),
    "camera-lag": (6.0, 20.0),
    "stand-off": (2.0, 5.0),
    "nonlinear-law": (1.5, 5.0),
}


def scenario_text(C10_Pa: float, alpha_per_s: float) -> str:
    return f"""title = "Tongue phantom of gel"

[model]
name = "tongue"
resolution = "coarse"
material = {{ law = "neo-hooke", C10_Pa = {C10_Pa!r}, poisson = 0.495, density_kg_m3 = 1040.0 }}
gravity_m_s2 = [0.0, 0.0, -9.81]
damping = {{ alpha_per_s = {alpha_per_s!r} }}

[analysis]
duration_ms = 1000.0
"""


def move(
    path: Path, settings: Sequence[str], lever: Lever | None, values: dict[str, float], sites: Sites, since_s: np.ndarray
) -> np.ndarray:
    """Displacements (k, s + 3, 3) m of the markers; the last three are fixed."""
    t = since_s - (lever.lag_s(values) if lever else 0.0)
    moving = np.flatnonzero(t > 0.0)
    hidden = lever.settings(read_transient(path, settings), values) if lever else []
    other = () if lever is not None and lever.cause in OF_THE_MATERIAL else (DATA_ELEMENT,)
    run = motion_of(path, (*settings, *hidden, DATA_MESH, *other), sites, tuple(t[moving].tolist()))
    size = np.linalg.norm(sites.stand_off, axis=1, keepdims=True)
    stand_off = sites.stand_off * (1.0 + (lever.stand_off_m(values) if lever else 0.0) / size)
    out = np.zeros((len(t), len(size) + 3, 3))
    out[moving, : len(size)] = run.displacement + np.einsum("ksij,sj->ksi", run.rotation - np.eye(3), stand_off)
    return out


def write_case(folder: Path, kind: str, strength: float, seed: int) -> str:
    """The dataset of one tongue; returns the cause that is hidden."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scenario.toml"
    C10 = rng.uniform(2000.0, 4000.0)
    scenario = scenario_text(C10, rng.uniform(4.0, 9.0))
    path.write_text(scenario, encoding="utf-8")
    mesh = anatomy_of(read_transient(path).model, folder).mesh
    feet = np.array([mesh.named_points[name].position[0] for name in MARKERS])
    at = feet + rng.uniform(0.002, 0.004) * np.array(list(MARKERS.values()))
    foot = locate_in_mesh(mesh, at, np.inf).position
    tip = [float(round(x, 3)) for x in 1e3 * feet[0]]
    loads = [0.0, rng.uniform(0.02, 0.04), rng.uniform(0.05, 0.08)]
    at_tip = f"at_mm={tip}, radius_mm={LOADED_RADIUS_MM}"
    stated = [[f"load.+={{{at_tip}, force_N=[0.0, 0.0, -{load!r}]}}"] if load else [] for load in loads]
    noise = float(rng.choice([1e-5, 2e-5, 5e-5]))
    clamp = 1e-3 * np.array(CLAMP_MM)
    everything = np.concatenate([at, clamp])

    def write(curves: Sequence[Moved]) -> None:
        write_dataset(
            folder, scenario, everything, curves,
            duration_s=DURATION_S, noise_m=noise, stated=kind in ("camera-lag", "none"), rng=np.random.default_rng(seed + 1),
        )  # fmt: skip

    lever: Lever | None = None
    values: dict[str, float] = {}
    if kind != "none":
        # a dataset without motion tells which effects there are
        write(
            [Moved(load, own, lambda t: np.zeros((len(t), len(everything), 3))) for load, own in zip(loads, stated, strict=True)]
        )
        dataset = read_dataset(folder)
        assert isinstance(dataset, TrajectoryDataset)
        scenarios = [read_transient(path, own) for own in stated]
        levers = levers_of(Experiment(scenarios[0], anatomy_of(scenarios[0].model, folder), dataset, scenarios))
        lever = levers[kind]
        assert not lever.reason, f"{kind}: {lever.reason}"
        values = dict(zip(lever.sought, (strength, *STRENGTHS[kind][2:]), strict=True))
    sites = Sites(foot, at - foot)
    write(
        [
            Moved(load, own, partial(move, path, own, lever, values, sites))
            for load, own in zip(loads, stated, strict=True)
        ]
    )  # fmt: skip
    return lever.cause if lever else "none"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=22)
    parser.add_argument("--seed", type=int, default=2)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    kinds = [kind for kind in STRENGTHS if kind != "none"]
    controls = max(options.count // 5, 1)
    chosen = ["none"] * controls + [kinds[k % len(kinds)] for k in range(options.count - controls)]
    path = options.out / "truth.json"
    options.out.mkdir(parents=True, exist_ok=True)
    truth = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    for number, k in enumerate(rng.permutation(options.count)):
        low, high = STRENGTHS[chosen[k]][:2]
        strength, seed = float(rng.uniform(low, high)), int(rng.integers(1 << 30))
        name = f"tongue-{number:02d}"
        cause = write_case(options.out / name, chosen[k], strength, seed)
        truth[name] = {"kind": chosen[k], "strength": strength, "seed": seed, "cause": cause}
        path.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
