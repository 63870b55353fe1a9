"""Make the simulated tests that come with the program: a dataset, and the same kind of test as a testing machine exports it.

    python studies/benchmarks/simulated_dataset.py [--out scenarios/datasets]

A cylinder of gel is compressed between lubricated platens at three rates, held, and half released. The simulator computes each
test as a relaxation of a quarter of the specimen, load after load; noise of a load cell is added with a seed. What the tissue has
is written in TRUTH, and not in the dataset: its relaxation is what ``close-loop`` has to find.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from explicitfe.simulate.run.run import run

TRUTH = {"C10_Pa": 900.0, "C20_Pa": 400.0, "g": 0.35, "tau_s": 3.0}
LARGEST_STRAIN, HOLD_S, RELEASED_SHARE = 0.3, 20.0, 0.5
RAMP_LOADS, HOLD_LOADS, RELEASE_LOADS = 30, 25, 20
FORCE_SD_SHARE = 0.005  # of the largest force
SEED = 20261122

SCENARIO = """
title = "A gel cylinder between platens"
[model]
name = "specimen"
symmetry = "quarter"
radius_mm = {radius_mm}
height_mm = {height_mm}
base = "sliding"
edge_size_mm = {edge_size_mm}
material = {{ C10_Pa = {C10_Pa}, C20_Pa = {C20_Pa} }}
[tool]
shape = "platen"
[effects]
viscoelastic = {{ g = [{g}], tau_s = [{tau_s}] }}
[analysis]
type = "relaxation"
displacements_mm = {displacements_mm}
times_s = {times_s}
tolerance = 1e-6
"""


@dataclass(frozen=True)
class Test:
    """A cylinder and the pace at which it is compressed."""

    name: str
    radius_mm: float
    height_mm: float
    rate_mm_per_s: float
    rows_per_s: float

    def programme(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and displacements [mm] of the loads: a ramp, a hold in ever longer steps, a release."""
        depth = LARGEST_STRAIN * self.height_mm
        ramp, release = depth / self.rate_mm_per_s, RELEASED_SHARE * depth / self.rate_mm_per_s
        up, down = np.arange(1, RAMP_LOADS + 1) / RAMP_LOADS, np.arange(1, RELEASE_LOADS + 1) / RELEASE_LOADS
        held = np.geomspace(0.002, 1.0, HOLD_LOADS)
        times = np.concatenate([ramp * up, ramp + HOLD_S * held, ramp + HOLD_S + release * down])
        return times, np.concatenate([depth * up, np.full(HOLD_LOADS, depth), depth * (1.0 - RELEASED_SHARE * down)])


def simulated(test: Test) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], displacements [mm] and forces [N] of a test at the instants of its loads, the first one at rest."""
    times_s, displacements_mm = test.programme()
    text = SCENARIO.format(
        radius_mm=test.radius_mm,
        height_mm=test.height_mm,
        edge_size_mm=0.4 * test.radius_mm,
        displacements_mm=displacements_mm.tolist(),
        times_s=times_s.tolist(),
        **TRUTH,
    )
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / f"{test.name}.toml"
        scenario.write_text(text, encoding="utf-8")
        summary = run(scenario, folder)
    assert summary["status"] == "finished", summary["message"]
    forces_N = np.array([point["force_N"] for point in summary["curve"]])
    return np.append(0.0, times_s), np.append(0.0, displacements_mm), np.append(0.0, forces_N)


def sampled(test: Test, noise: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same as a machine records it: evenly in time, and with the noise of its load cell."""
    instants, depth_mm, force_N = simulated(test)
    time_s = np.arange(0.0, instants[-1], 1.0 / test.rows_per_s)
    between = PchipInterpolator(instants, force_N)(time_s)
    return time_s, np.interp(time_s, instants, depth_mm), between + noise.normal(0.0, FORCE_SD_SHARE * force_N.max(), len(time_s))


def write_dataset(folder: Path, noise: np.random.Generator) -> None:
    """The curves of ``dataset.toml``, which is written by hand and stands there already."""
    for name, rate, rows_per_s in (
        ("slow-a", 0.1, 2.0),
        ("medium-a", 1.0, 10.0),
        ("fast-a", 10.0, 20.0),
        ("medium-b", 1.0, 10.0),
    ):
        time_s, depth_mm, force_N = sampled(Test(name, 10.0, 12.0, rate, rows_per_s), noise)
        rows = [f"{t:.3f},{d:.4f},{f:.5f}" for t, d, f in zip(time_s, depth_mm, force_N, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["time_s,displacement_mm,force_N", *rows]) + "\n", encoding="utf-8")


def write_exports(folder: Path, noise: np.random.Generator) -> None:
    """Compression as machines have it, with a minus sign, in their own columns and units, under some lines on the test."""
    for name, rate, rows_per_s in (("gel-slow", 0.1, 2.0), ("gel-medium", 1.0, 10.0), ("gel-fast", 10.0, 20.0)):
        test = Test(name, 12.5, 15.0, rate, rows_per_s)
        time_s, depth_mm, force_N = sampled(test, noise)
        head = [
            "Simulated by explicitfe (studies/benchmarks/simulated_dataset.py); no specimen was measured",
            f"Specimen diameter;{2.0 * test.radius_mm:g};mm",
            f"Specimen height;{test.height_mm:g};mm",
            f"Rate;{rate:g};mm/s",
            "",
            "Time;Crosshead;Load",
            "(s);(mm);(mN)",
        ]
        columns = zip(time_s, 0.0 - depth_mm, -1e3 * force_N, strict=True)  # 0.0 - 0.0 is no -0.0
        rows = [f"{t:.3f};{z:.4f};{load:.2f}" for t, z, load in columns]
        (folder / f"{name}.csv").write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("scenarios/datasets"))
    out = parser.parse_args().out
    noise = np.random.default_rng(SEED)
    for name, write in (("simulated-compression", write_dataset), ("exports", write_exports)):
        (out / name).mkdir(parents=True, exist_ok=True)
        write(out / name, noise)


if __name__ == "__main__":
    main()
