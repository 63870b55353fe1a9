"""Nanoseconds per element and step, and how fast vowel [i] runs.

    python benchmarks/kernel.py [--json FILE]

Blocks of distorted 4 mm hexes (15 % at random) of Yeoh tissue at Poisson's ratio 0.499, one thread, float64: the whole step
with forces, update and energy ledger, best of several runs of the compiled loop. Then the scenario vowel-i: simulated time
over wall time of the compiled loop alone, and of the whole run with samples and looks at the stable step.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from pathlib import Path

import numpy as np

from explicitfe.build import Simulation
from explicitfe.materials.yeoh import Yeoh
from explicitfe.mesh.hexmesh import HexMesh
from explicitfe.model.model import Model
from explicitfe.runner import prepare, run
from explicitfe.simd import WIDTH
from explicitfe.timestep import FRACTION

ROOT = Path(__file__).resolve().parents[1]
SIZES = {1000: (10, 10, 10), 30_000: (30, 40, 25), 250_000: (50, 100, 50)}


def block(cells: tuple[int, int, int], edge_m: float = 0.004) -> HexMesh:
    """A block of hexes with every node moved at random by up to 15 % of the edge."""
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), -1).reshape(-1, 3)
    number = np.arange(len(grid)).reshape([n + 1 for n in cells])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    nx, ny, nz = cells
    hexes = np.stack([number[i : i + nx, j : j + ny, k : k + nz].ravel() for i, j, k in corners], axis=1)
    return HexMesh((grid + np.random.default_rng(0).uniform(-0.15, 0.15, grid.shape)) * edge_m, hexes)


def nanoseconds_per_element_step(simulation: Simulation, seconds: float = 1.0) -> float:
    """Best of five runs of the compiled loop, each about a fifth of ``seconds`` long."""
    elements = simulation.model.mesh.element_count
    dt = FRACTION * simulation.stable_limit(20)
    simulation.start(dt)
    simulation.advance(2, dt)
    steps = max(3, int(seconds / 5 / (60e-9 * elements)))
    best = np.inf
    for _ in range(5):
        begin = time.perf_counter()
        simulation.advance(steps, dt)
        best = min(best, time.perf_counter() - begin)
    return 1e9 * best / steps / elements


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    arguments = parser.parse_args()

    figures: dict[str, object] = {"machine": platform.processor() or platform.machine(), "lanes": WIDTH}
    print(f"{figures['machine']}, {WIDTH} lanes, one thread, float64")
    for name, cells in SIZES.items():
        mesh = block(cells)
        tissue = Yeoh(C10_Pa=191.5, C20_Pa=90.6)
        simulation = Simulation(
            Model(mesh, tissue, np.zeros((mesh.node_count, 3), dtype=bool), alpha_per_s=40.0),
            velocity=np.random.default_rng(1).standard_normal((mesh.node_count, 3)) * 1e-3,
        )
        simulation.compile()
        figures[f"ns_{name}"] = nanoseconds_per_element_step(simulation)
        print(f"{name:>8} elements: {figures[f'ns_{name}']:6.1f} ns per element and step")

    for resolution in ("coarse", "medium"):
        settings = [f"model.resolution={resolution}"]
        prepared = prepare(ROOT / "scenarios" / "vowel-i.toml", settings)
        prepared.simulation.compile()
        kernel_ns = nanoseconds_per_element_step(prepared.simulation, seconds=0.1)
        with tempfile.TemporaryDirectory() as folder:
            runs = [run(ROOT / "scenarios" / "vowel-i.toml", folder, settings=settings, overwrite=True) for _ in range(3)]
        summary = min(runs, key=lambda one: one["wall_s"])
        kernel_s = 1e-9 * kernel_ns * summary["steps"] * summary["hexes"]
        figures[f"vowel_i_{resolution}"] = {
            "hexes": summary["hexes"],
            "steps": summary["steps"],
            "kernel_s": kernel_s,
            "kernel_real_time_factor": summary["simulated_s"] / kernel_s,
            "run_s": summary["wall_s"],
            "real_time_factor": summary["real_time_factor"],
            "total_s": summary["total_s"],
        }
        print(
            f"vowel-i {resolution}: {summary['hexes']} hexes, {summary['steps']} steps; loop alone {1e3 * kernel_s:.0f} ms "
            f"({summary['simulated_s'] / kernel_s:.2f} x real time), run with samples {1e3 * summary['wall_s']:.0f} ms "
            f"({summary['real_time_factor']:.2f} x), with building and start {summary['total_s']:.2f} s"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
