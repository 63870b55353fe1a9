"""What the barrier against folding costs, and how its two numbers were chosen: tables of docs/studies/elements.md.

    python studies/benchmarks/barrier.py [--only cost choice] [--out docs/studies/elements.md]

*cost*: the whole step of a block of distorted hexes, with the barrier and with an element that differs by nothing else, in turns
in one process: at rest, and with a twentieth of the elements pressed against the barrier, scattered or side by side. *choice*:
blocks, the cantilever and the [i] of 2005 on cadaver tissue with other thresholds and strengths; each pair runs in a copy of the
package.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

os.environ.setdefault("OMP_NUM_THREADS", "1")
import numpy as np

ROOT = Path(__file__).resolve().parents[2]

from explicitfe.app.tools.speed import problem  # noqa: E402
from explicitfe.fem.elements import hourglass_strain  # noqa: E402
from explicitfe.fem.elements.barrier import THRESHOLD  # noqa: E402
from explicitfe.fem.forces import internal  # noqa: E402
from explicitfe.fem.mesh.quality import corner_jacobians  # noqa: E402
from explicitfe.fem.solve.kernels import ELEMENTS  # noqa: E402
from explicitfe.fem.solve.simulation import Simulation  # noqa: E402

CHOICES = ((0.3, 1.0), (0.4, 3.0), (0.4, 10.0), (0.5, 1.0), (0.5, 3.0))
AT_THE_BARRIER = 0.05  # of the elements
SIZES = (1000, 30000)
ROUNDS = 40
ROUND_S = 0.02


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


# ---- cost ----


def pressed(simulation: Simulation, count: int, scattered: bool) -> int:
    """Move single nodes into an element until so many elements are at the barrier; give how many are.

    The volume that the edges of a corner span is linear in the corner's place: it is moved to three quarters of the threshold.
    """
    mesh = simulation.model.mesh
    rest = corner_jacobians(mesh.points, mesh.hexes)
    order = np.random.default_rng(5).permutation(mesh.element_count) if scattered else np.arange(mesh.element_count)
    u = np.zeros(mesh.points.shape)
    moved: set[int] = set()
    at = 0
    for element in order:
        corners = mesh.hexes[element]
        if moved & set(corners.tolist()):
            continue
        moved |= set(corners.tolist())
        way = mesh.points[corners[6]] - mesh.points[corners[0]]
        tried = mesh.points[corners].copy()
        tried[0] += 0.1 * way
        slope = 10.0 * (1.0 - corner_jacobians(tried, np.arange(8)[None])[0, 0] / rest[element, 0])
        u[corners[0]] = (1.0 - 0.75 * THRESHOLD) / slope * way
        if len(moved) % 10 == 0 or at >= 0.9 * count:
            at = int(((corner_jacobians(mesh.points + u, mesh.hexes) / rest).min(axis=1) < THRESHOLD).sum())
        if at >= count:
            break
    simulation.state.u[:] = simulation._rows(u)
    return at


def cost() -> str:
    """Ratio of the step with the barrier to that without."""
    without = SimpleNamespace(
        HAS_BARRIER=False,
        constants=hourglass_strain.constants,
        invariant=hourglass_strain.invariant,
        force=hourglass_strain.force,
    )
    ELEMENTS["without"] = internal, without  # type: ignore[assignment]
    rows = []
    for size in SIZES:
        for state in ("at rest", "scattered", "side by side"):
            bodies = {element: problem(size, element, 1) for element in ("hex8", "without")}
            best = dict.fromkeys(bodies, np.inf)
            elements = bodies["hex8"].model.mesh.element_count
            steps = max(2, int(ROUND_S / (5e-8 * elements)))
            at = 0
            for body in bodies.values():
                body.compile()
                if state != "at rest":
                    at = pressed(body, int(AT_THE_BARRIER * elements), state == "scattered")
                body.start(1e-15)  # so short that nothing moves
            for _ in range(ROUNDS):
                for element, body in bodies.items():
                    begin = time.perf_counter()
                    assert body.advance(steps, 1e-15)
                    best[element] = min(best[element], time.perf_counter() - begin)
            ns = {element: 1e9 * seconds / steps / elements for element, seconds in best.items()}
            rows.append([
                f"{elements:,}".replace(",", " "), state, f"{100 * at / elements:.0f} %",
                f"{ns['without']:.0f}", f"{ns['hex8']:.0f}", f"{ns['hex8'] / ns['without']:.2f}",
            ])  # fmt: skip
            print(rows[-1], flush=True)
    head = ["elements", "state", "at the barrier", "without, ns", "with, ns", "ratio"]
    return table(head, rows)


# ---- choice ----

IN_A_COPY = """
import json, sys, tempfile
sys.path[:0] = [{copy!r}, {copy!r} + "/tests", {copy!r} + "/studies/benchmarks"]
from pathlib import Path
from statics import block_run, cantilever, swing
from explicitfe.results.files import open_result
from explicitfe.simulate.run.run import run
from explicitfe.fem.mesh.validity import certify
answers = {{}}
answers["cantilever"] = 1e3 * swing(*cantilever("hex8", 8, 2.2))[1]
for kind, n in (("compress", 8), ("stretch", 4), ("stretch", 8)):
    block = block_run(kind, "hex8", n)
    answers[f"{{kind}} {{n}}"] = block.status or [1e3 * block.energy, block.folded, block.balance]
with tempfile.TemporaryDirectory() as folder:
    for distribution in ("ends", "along", "volume"):
        settings = ["model.material=gerard-2005", "model.resolution=medium"]
        settings += [f"muscle.{{m}}.distribution={{distribution}}" for m in ("GGp", "GGh", "GGa")]
        summary = run(Path({copy!r}) / "scenarios" / "vowel-i-gerard-2005.toml", folder, settings=settings, overwrite=True)
        dorsum = summary["probes"]["dorsum"]["displacement_mm"]
        answers[distribution] = [summary["status"], -dorsum[0], dorsum[2], summary["energy_balance_error"], summary["steps"]]
print(json.dumps(answers))
"""


def choice() -> str:
    """What changes with the threshold and the strength."""
    rows = []
    for threshold, strength in CHOICES:
        with tempfile.TemporaryDirectory() as copy:
            for name in ("explicitfe", "tests", "studies", "scenarios", "models"):
                shutil.copytree(ROOT / name, Path(copy) / name, ignore=shutil.ignore_patterns("__pycache__"))
            path = Path(copy) / "explicitfe" / "fem" / "elements" / "barrier.py"
            lines = path.read_text(encoding="utf-8").splitlines()
            changed = {"THRESHOLD = ": f"THRESHOLD = {threshold}", "STRENGTH = ": f"STRENGTH = {strength}"}
            lines = [next((new for old, new in changed.items() if line.startswith(old)), line) for line in lines]
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
            out = subprocess.run([sys.executable, "-c", IN_A_COPY.format(copy=copy)], capture_output=True, text=True, check=True)
        answers = json.loads(out.stdout.splitlines()[-1])
        row = [f"{threshold:g}", f"{strength:g}", f"{answers['cantilever']:.2f}"]
        for name in ("compress 8", "stretch 4", "stretch 8"):
            got = answers[name]
            row.append(got if isinstance(got, str) else f"{got[0]:.2f}; {got[1]}; {got[2]:.0e}")
        for name in ("ends", "along", "volume"):
            status, forward, up, balance, steps = answers[name]
            row.append(f"{forward:+.1f}, {up:+.1f}; {balance:.0e}; {steps}" if status == "finished" else f"{status}; {steps}")
        rows.append(row)
        print(row, flush=True)
    head = ["t", "B", "cantilever, mm", "compress n = 8", "stretch n = 4", "stretch n = 8", "ends", "along", "volume"]
    return table(head, rows)


SECTIONS = {"cost": cost, "choice": choice}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="*", choices=list(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "studies" / "elements.md")
    arguments = parser.parse_args()
    for name in arguments.only:
        text = arguments.out.read_text(encoding="utf-8")
        begin, end = f"<!-- barrier {name} -->", f"<!-- end barrier {name} -->"
        before, after = text.split(begin)[0], text.split(end)[1]
        arguments.out.write_text(f"{before}{begin}\n\n{SECTIONS[name]()}\n\n{end}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
