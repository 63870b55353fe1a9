"""Make the simulated EMA recordings that come with the program: a dataset, and a table as an articulograph exports it.

    python studies/benchmarks/simulated_ema.py [--out scenarios/datasets]

The speaker is the tongue model with another mesh, element and time step than the scenario of the dataset, and with an activation
lag (LAG_MS) that the scenario lacks: ``close-loop`` has to find it. Noise of a coordinate is added with a seed.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.inverse.close_loop.trajectories.runs import Sites, motion_of
from explicitfe.platform.host.shipped import scenarios
from explicitfe.simulate.run.prepare import prepare

COILS = {"TT": "tip", "TB": "front", "TD": "dorsum", "TR": "back"}
LAG_MS, NOISE_MM, SEED = 15.0, 0.2, 20261123
NUMERICS = ("model.resolution=medium", "analysis.step_us=15.0")
# Registration of the dataset, x_model = R x + t: a turn of 6 degrees and a shift of 5 mm.
TURN = Rotation.from_rotvec(np.radians(6.0) * np.array([0.0, 0.96, 0.28])).as_matrix()
SHIFT_M = np.array([0.003, 0.0, 0.004])
DATASET_RATE_HZ, DATASET_MS = 200.0, 100.0
GESTURES: dict[str, tuple[str, ...]] = {
    "strong": (),
    "weak": ("muscle.GGp.force_N=1.0", "muscle.GGa.force_N=0.1"),
    "body": ("muscle.GGp.force_N=1.5", "muscle.GGa.force_N=0.0"),
}
HELD_OUT = "body"

# The table of an articulograph: 100 ms of rest, then the movement of vowel [i] by a speaker with stronger muscles and a lag.
EXPORT_RATE_HZ, REST_S, EXPORT_S = 250.0, 0.1, 0.3
EXPORT_SPEAKER = (
    "muscle.GGp.force_N=1.53",
    "muscle.GGh.force_N=0.77",
    "effects.activation-lag.tau_ms=12.0",
    "model.resolution=coarse",
)
# Coils on the head [m]: upper incisors, nasion, right and left mastoid.
HEAD_M = {"UI": (0.045, 0.0, 0.108), "NA": (0.05, 0.0, 0.16), "RM": (0.14, 0.06, 0.12), "LM": (0.14, -0.06, 0.12)}
HEAD_TURN_DEG, HEAD_SHIFT_M, HEAD_PERIOD_S = 1.5, 0.001, 0.6


def write_dataset(folder: Path) -> None:
    """Write dataset.toml and a CSV for each gesture; scenario.toml is there."""
    scenario = folder / "scenario.toml"
    places = _places(scenario)
    times_s = np.arange(0.0, 1e-3 * DATASET_MS + 1e-9, 1.0 / DATASET_RATE_HZ)
    random = np.random.default_rng(SEED)
    for name, settings in GESTURES.items():
        lag = f"effects.activation-lag.tau_ms={LAG_MS}"
        model = places + motion_of(scenario, (*NUMERICS, *settings, lag), Sites.at(places), times_s).displacement
        seen = (model - SHIFT_M) @ TURN
        coils = {coil: seen[:, k] for k, coil in enumerate(COILS)}
        _write(folder / f"{name}.csv", times_s, _with_noise(coils, random), {"x": (0, 1.0), "y": (1, 1.0), "z": (2, 1.0)})


def write_export(file: Path) -> None:
    """Write the table of an articulograph, with coils on the moving head."""
    scenario = scenarios()["vowel-i"]
    places = _places(scenario)
    times_s = np.arange(0.0, EXPORT_S + 1e-9, 1.0 / EXPORT_RATE_HZ)
    moving = times_s >= REST_S
    model = np.repeat(places[None], len(times_s), axis=0)
    model[moving] += motion_of(scenario, EXPORT_SPEAKER, Sites.at(places), times_s[moving] - times_s[moving][0]).displacement
    phase = np.sin(2.0 * np.pi * times_s / HEAD_PERIOD_S)
    turns = Rotation.from_rotvec(np.radians(HEAD_TURN_DEG) * phase[:, None] * np.array([0.0, 1.0, 0.0])).as_matrix()
    shifts = HEAD_SHIFT_M * phase[:, None] * np.array([1.0, 0.0, 1.0])
    head = {name: np.repeat(np.array(place)[None], len(times_s), axis=0) for name, place in HEAD_M.items()}
    coils = {coil: model[:, k] for k, coil in enumerate(COILS)} | head
    seen = {name: (np.einsum("kij,kj->ki", turns, place) + shifts - SHIFT_M) @ TURN for name, place in coils.items()}
    axes = {"forward": (0, -1.0), "left": (1, -1.0), "up": (2, 1.0)}
    _write(file, times_s, _with_noise(seen, np.random.default_rng(SEED + 1)), axes)


def _places(scenario: Path) -> np.ndarray:
    """Positions (s, 3) m of the coils in the body at rest."""
    points = prepare(scenario).model.mesh.named_points
    return np.concatenate([points[point].position for point in COILS.values()])


def _with_noise(coils: Mapping[str, np.ndarray], random: np.random.Generator) -> dict[str, np.ndarray]:
    return {name: place + 1e-3 * NOISE_MM * random.standard_normal(place.shape) for name, place in coils.items()}


def _write(file: Path, times_s: np.ndarray, coils: Mapping[str, np.ndarray], axes: Mapping[str, tuple[int, float]]) -> None:
    """Write a CSV with positions in mm."""
    head = ["time_s", *(f"{name}_{axis}_mm" for name in coils for axis in axes)]
    columns: Sequence[np.ndarray] = [sign * 1e3 * place[:, k] for place in coils.values() for k, sign in axes.values()]
    lines = [",".join(head)]
    lines += [",".join([f"{time:g}", *(f"{value:.3f}" for value in row)]) for time, *row in zip(times_s, *columns, strict=True)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("scenarios/datasets"))
    out = parser.parse_args().out
    write_export(out / "exports" / "ema-vowel-i.csv")
    write_dataset(out / "simulated-ema")


if __name__ == "__main__":
    main()
