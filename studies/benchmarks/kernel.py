"""Nanoseconds per element and step, and how fast vowel [i] runs.

    python studies/benchmarks/kernel.py [--json FILE]

Blocks of distorted 4 mm hexes (15 % at random) of Yeoh tissue at Poisson's ratio 0.499, one and two threads, float64: the whole
step with forces, update and energy ledger, best of several runs of the compiled loop. Then vowel [i], in its two scenarios:
simulated time over wall time of the steps, many at a time and as the run cuts them, and of the run with samples and looks at the
stable step.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
from itertools import product
from pathlib import Path

from explicitfe.app.tools.speed import TIMED_ELEMENTS, TIMED_SIZES, nanoseconds, problem
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.run import run

ROOT = Path(__file__).resolve().parents[2]
# With bones and a branch that damps, and without: the elements and the forces on nodes alone.
SCENARIOS = ("vowel-i", "vowel-i-gerard-2005")
# The default, and one of about as many hexes with the fewest steps: the tongue's tip has half the layers.
MESHES = ("model.resolution=medium", "model.cells=[25,4,10]")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    arguments = parser.parse_args()

    figures: dict[str, object] = {"machine": platform.processor() or platform.machine(), "lanes": WIDTH}
    print(f"{figures['machine']}, {WIDTH} lanes, float64")
    for size in TIMED_SIZES:
        for element in TIMED_ELEMENTS:
            for threads in (1, 2):
                simulation = problem(size, element, threads)
                simulation.compile()
                ns = figures[f"ns_{element}_{size}_{threads}"] = nanoseconds(simulation)
                print(f"{size:>8} elements, {element:<14}, {threads} thread(s): {ns:6.1f} ns per element and step")

    for name, mesh, threads in product(SCENARIOS, MESHES, (1, 2)):
        path, settings = ROOT / "scenarios" / f"{name}.toml", [mesh, f"analysis.threads={threads}"]
        simulation = prepare(path, settings).body
        simulation.compile()
        ns = nanoseconds(simulation)
        with tempfile.TemporaryDirectory() as folder:
            runs = [run(path, folder, settings=settings, overwrite=True) for _ in range(5)]
        fastest = min(runs, key=lambda one: one["loop_s"])
        wall_s = min(one["wall_s"] for one in runs)
        kernel_s = 1e-9 * ns * fastest["steps"] * fastest["hexes"]
        keys = ("hexes", "steps", "threads", "loop_s", "total_s")
        figures[f"{name} {mesh} {threads}"] = {key: fastest[key] for key in keys} | {"wall_s": wall_s, "kernel_s": kernel_s}
        print(
            f"{name}, {mesh}: {fastest['hexes']} hexes, {fastest['steps']} steps, {fastest['threads']} thread(s): steps "
            f"without interruption {1e3 * kernel_s:.0f} ms ({fastest['simulated_s'] / kernel_s:.2f} x real time), in the run "
            f"{1e3 * fastest['loop_s']:.0f} ms ({fastest['simulated_s'] / fastest['loop_s']:.2f} x), "
            f"with samples {1e3 * wall_s:.0f} ms, with building {fastest['total_s']:.2f} s"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
