"""A million hexes: the time to build the model and to take a step, and the time and memory of 100 steps with stored results.

    python studies/benchmarks/million.py [--elements 1000000] [--json FILE]
    python studies/benchmarks/million.py --elements 1000 10000 100000 1000000

Several sizes are measured one after the other, each in a process of its own, and a table shows by what power of the number of
elements each part grows between two sizes.

A block of 1 mm hexes of Yeoh tissue at Poisson's ratio 0.499 stands on its bottom under its own weight. It is a mesh
file of one's own: read, ordered and built as every model, then run with four samples of all fields.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import resource
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import h5py
import meshio

from explicitfe.app.tools.speed import block
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.run import run

STEPS = 100
SCENARIO = """\
title = "A block under its own weight"

[model]
file = "block.toml"
material = "gerard-2005"
damping = {{ alpha_per_s = 40.0 }}
gravity_m_s2 = [0.0, 0.0, -9.81]

[analysis]
type = "transient"
duration_ms = {duration_ms}
[record]
every_ms = {every_ms}
"""
MODEL = """\
title = "A block"
source = "made up for this benchmark"
mesh = "block.vtu"
length_unit = "mm"
fixed = ["bottom"]

[node_sets]
bottom = { point_data = "bottom", value = 1.0 }

[named_points]
top = 0
"""


def peak_bytes() -> int:
    """Largest memory of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


# What the table of several sizes shows: title, figure, factor to the unit of the title.
PARTS = (
    ("build, s", "build_s", 1.0),
    ("step, ms", "step_s", 1e3),
    ("stability check of 3 iterations, ms", "short_check_s", 1e3),
    ("stability check of 12 iterations, ms", "check_s", 1e3),
    ("checks in the run, s", "look_s", 1.0),
    ("samples in the run, s", "sample_s", 1.0),
    ("run, s", "run_s", 1.0),
    ("memory, MB", "peak_bytes", 1e-6),
    ("result, MB", "result_bytes", 1e-6),
)


def compare(sizes: list[int]) -> None:
    """Measure several sizes and print how each part grows."""
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        for size in sizes:
            subprocess.run([sys.executable, __file__, "--elements", str(size), "--json", str(file)], check=True)
            figures.append(json.loads(file.read_text()))
    counts = [one["elements"] for one in figures]
    growth = [f"{small:,} to {large:,}" for small, large in pairwise(counts)]
    print("\n| | " + " | ".join([*(f"{count:,}" for count in counts), *growth]) + " |")
    print("|---" * (1 + len(counts) + len(growth)) + "|")
    for title, name, factor in PARTS:
        values = [one[name] for one in figures]
        powers = [math.log(b / a) / math.log(n / m) for (a, b), (m, n) in zip(pairwise(values), pairwise(counts), strict=True)]
        cells = [*(f"{factor * value:.3g}" for value in values), *(f"{power:.2f}" for power in powers)]
        print(f"| {title} | " + " | ".join(cells) + " |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--elements", type=int, default=[1_000_000], nargs="+")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    arguments = parser.parse_args()
    if len(arguments.elements) > 1:
        compare(arguments.elements)
        return
    side = round(arguments.elements[0] ** (1.0 / 3.0))
    figures: dict[str, object] = {"machine": platform.processor() or platform.machine(), "lanes": WIDTH}

    def say(name: str, value: float, text: str) -> None:
        figures[name] = value
        print(f"{text}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        begin = time.perf_counter()
        mesh = block((side, side, side), edge_m=1e-3)
        points_mm = 1e3 * mesh.points
        bottom = (points_mm[:, 2] < 0.5).astype(float)
        meshio.Mesh(points_mm, [("hexahedron", mesh.hexes)], point_data={"bottom": bottom}).write(home / "block.vtu")
        print(f"{mesh.element_count} hexes, {mesh.node_count} nodes; mesh file written in {time.perf_counter() - begin:.1f} s")
        del mesh
        (home / "block.toml").write_text(MODEL)
        path = home / "block-scenario.toml"
        path.write_text(SCENARIO.format(duration_ms=1.0, every_ms=1.0))

        begin = time.perf_counter()
        prepared = prepare(path)
        build_s = time.perf_counter() - begin
        simulation = prepared.body
        count = len(simulation.hexes)
        say("build_s", build_s, f"reading, building and ordering: {build_s:.1f} s")
        blocks, state = simulation.blocks, simulation.state
        read = (blocks.nodes, blocks.geometry, blocks.constants, blocks.hourglass, blocks.position, simulation.nodes.update)
        each = (sum(array.nbytes for array in read) + 2 * sum(array.nbytes for array in state)) / count
        say("bytes_per_element", each, f"{each:.0f} bytes per element that a step without external forces reads and writes")
        simulation.compile()
        begin = time.perf_counter()
        limit = simulation.stable_limit(20)
        print(f"stable step {1e6 * limit:.2f} us, found in {time.perf_counter() - begin:.1f} s")
        say("elements", count, f"{count} elements")
        for name, turns in (("check_s", 12), ("short_check_s", 3)):
            begin = time.perf_counter()
            simulation.stable_limit(turns)
            say(
                name, (seconds := time.perf_counter() - begin), f"a stability check of {turns} iterations: {1e3 * seconds:.1f} ms"
            )
        dt = 0.9 * limit
        simulation.start(dt)
        simulation.advance(2, dt)
        begin = time.perf_counter()
        simulation.advance(20, dt)
        step_s = (time.perf_counter() - begin) / 20
        ns = 1e9 * step_s / count
        say(
            "steps_per_s",
            1.0 / step_s,
            f"{1 / step_s:.2f} steps a second with {len(simulation.parts)} threads, {ns:.1f} ns a step and element",
        )
        say("build_in_steps", build_s / step_s, f"building takes as long as {build_s / step_s:.0f} steps")
        del prepared, simulation, blocks, state, read

        duration_ms = 1e3 * STEPS * dt
        path.write_text(SCENARIO.format(duration_ms=duration_ms, every_ms=duration_ms / 3))
        begin = time.perf_counter()
        summary = run(path, home, overwrite=True)
        run_s = time.perf_counter() - begin
        say("look_s", summary["look_s"], f"stability checks in the run: {summary['look_s']:.2f} s")
        say("sample_s", summary["sample_s"], f"samples in the run: {summary['sample_s']:.2f} s")
        say("step_s", step_s, f"a step: {1e3 * step_s:.2f} ms")
        say("run_s", run_s, f"run of {summary['steps']} steps: {run_s:.1f} s, {summary['wall_s']:.1f} s of it without building")
        print(f"{summary['status']}, energy balance within {summary['energy_balance_error']:.1e}")
        stored = Path(summary["result"]).stat().st_size
        with h5py.File(summary["result"]) as file:
            samples = int(file["VTKHDF"]["Steps"].attrs["NSteps"])
        say("result_bytes", stored, f"result: {samples} samples, {stored / 1e9:.2f} GB")
        say("peak_bytes", peak_bytes(), f"largest memory: {peak_bytes() / 1e9:.2f} GB")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
