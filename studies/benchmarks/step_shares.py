"""What a step in contact costs: elements, contact with loads and update, stability checks and samples, beside the bare kernel.

    EXPLICITFE_LANES=4 python studies/benchmarks/step_shares.py [--scenarios vowel-i,vowel-i-palatal,velar-k] [--times 3]

One core; nanoseconds for each element and step over the whole scenario, the fastest of some turns. *Bare* is the step of a block
of 1 000 elements `hex8` without effects, bones and loads. *Elements* are the internal forces of the last state, with viscosity,
muscles and the barrier. *Contact* is the rest of the steps: contact, fibres, loads and the update of the nodes.
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np

from explicitfe.app.tools.speed import nanoseconds, problem
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.simulate.run.prepare import prepare

ROOT = Path(__file__).resolve().parents[2]
SAMPLE_EVERY_S, TIMED_FORCES = 2e-3, 300


def forces_ns(body: Simulation) -> float:
    """Of the internal forces alone."""
    force, blocks, begin = np.zeros_like(body.state.u), body.lookers[0].blocks, time.perf_counter()
    for _ in range(TIMED_FORCES):
        body.kernels.forces(body.state.u, force, blocks)
    return 1e9 * (time.perf_counter() - begin) / TIMED_FORCES / len(body.hexes)


def shares(scenario: str, resolution: str, speed: str) -> np.ndarray:
    """Elements, contact, checks, samples [ns], and simulated over wall time."""
    settings = [f"model.resolution={resolution}", f"model.speed={speed}", "analysis.threads=1"]
    prepared = prepare(ROOT / "scenarios" / f"{scenario}.toml", settings)
    body, duration_s = prepared.body, 1e-3 * prepared.scenario.analysis.duration_ms
    body.compile()
    for _ in Transient(body, duration_s).samples(SAMPLE_EVERY_S):
        pass
    each = 1e9 / (body.steps * len(body.hexes))
    elements = forces_ns(body)
    return np.array(
        [elements, each * body.loop_s - elements, each * body.look_s, each * body.sample_s, duration_s / body.course_s]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenarios", default="vowel-i,vowel-i-palatal,velar-k")
    parser.add_argument("--times", type=int, default=3)
    arguments = parser.parse_args()
    block = problem(1000, "hex8", 1)
    block.compile()
    bare = min(nanoseconds(block) for _ in range(arguments.times))
    print(f"{WIDTH} lanes; bare step {bare:.1f} ns\n")
    print("| scenario | mesh | speed | elements | contact, loads, update | checks | samples | full / bare | × real time |")
    print("|---" * 9 + "|")
    for scenario, resolution, speed in product(arguments.scenarios.split(","), ("coarse", "medium"), ("accurate", "interactive")):
        seen = np.array([shares(scenario, resolution, speed) for _ in range(arguments.times)])
        best = seen[np.argmax(seen[:, -1])]
        cells = " | ".join(f"{ns:.1f}" for ns in best[:4])
        print(f"| `{scenario}` | {resolution} | {speed} | {cells} | {best[:4].sum() / bare:.2f} | {best[4]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
