"""Nanoseconds per element and step, and how fast vowel [i] runs.

    python benchmarks/kernel.py [--json FILE]

Blocks of distorted 4 mm hexes (15 % at random) of Yeoh tissue at Poisson's ratio 0.499, one and two threads, float64: the whole
step with forces, update and energy ledger, best of several runs of the compiled loop. Then the scenario vowel-i: simulated time
over wall time of the compiled loop alone, and of the whole run with samples and looks at the stable step.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
from pathlib import Path

from explicitfe.runner import prepare, run
from explicitfe.simd import WIDTH
from explicitfe.speed import ELEMENTS, SIZES, nanoseconds, problem

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    arguments = parser.parse_args()

    figures: dict[str, object] = {"machine": platform.processor() or platform.machine(), "lanes": WIDTH}
    print(f"{figures['machine']}, {WIDTH} lanes, float64")
    for size in SIZES:
        for element in ELEMENTS:
            for threads in (1, 2):
                simulation = problem(size, element, threads)
                simulation.compile()
                ns = figures[f"ns_{element}_{size}_{threads}"] = nanoseconds(simulation)
                print(f"{size:>8} elements, {element:<14}, {threads} thread(s): {ns:6.1f} ns per element and step")

    for resolution in ("coarse", "medium"):
        settings = [f"model.resolution={resolution}"]
        prepared = prepare(ROOT / "scenarios" / "vowel-i.toml", settings)
        prepared.simulation.compile()
        kernel_ns = nanoseconds(prepared.simulation, seconds=0.1)
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
