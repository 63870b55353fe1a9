"""How good the indentations are, and what they cost: the tables of docs/reference/indentation.md.

    python studies/benchmarks/indentation.py [--refinements 1 1.5 2 3] [--out tables.md]
    python studies/benchmarks/indentation.py --against ANOTHER_CHECKOUT

Case A of the references (tests/verification/test_indentation.py has its figures and their source). About two minutes on one core.
With ``--against``, eight loads of this version and of another one instead, in turns on the same machine: two minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["EXPLICITFE_CORES"] = "1"  # times of one thread can be compared with older ones
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "verification")]

import numpy as np  # noqa: E402
from elements import table  # noqa: E402
from test_indentation import CASES, LOADS, case_a  # noqa: E402

from explicitfe.fem.solve.load_outcome import Equilibrium  # noqa: E402

ASKED_s = {"sector": 1.5, "quarter": 6.0}  # for eight loads on the default mesh
TIGHT_TOLERANCE = 1e-6


TURNS = 3
# Eight loads on one thread; the same text runs with any version of the package.
EIGHT_LOADS = """
import json, sys, time
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.simulate.anatomy.specimen import specimen_model
symmetry, tolerance = sys.argv[1], float(sys.argv[2])
material = {"C10_Pa": 191.5, "C20_Pa": 90.6, "poisson": 0.499, "density_kg_m3": 1040.0}
specimen = SpecimenTable(symmetry=symmetry, radius_mm=35.0, height_mm=20.0, material=material)
tool = ToolTable(shape="flat-cylinder", radius_mm=14.0, edge_radius_mm=1.0)
body = Relaxation(specimen_model(specimen, tool), tolerance, threads=1)
body.compile()
begin = time.process_time()
loads = [body.press(0.1 * k) for k in range(1, 9)]
cpu_s = time.process_time() - begin
print(json.dumps([cpu_s, sum(load.iterations for load in loads), [1e3 * load.displacement_m for load in loads]]))
"""


@dataclass(frozen=True)
class Curve:
    """Eight loads on one mesh."""

    elements: int
    points: list[Equilibrium]
    seconds: list[float]  # of CPU time for each load, compiled before

    @property
    def mm(self) -> np.ndarray:
        return 1e3 * np.array([point.displacement_m for point in self.points])


def run(case: str, friction: float | str = 0.0, tolerance: float = 1e-4, **specimen) -> Curve:
    shape, poisson, *_ = CASES[case]
    body = case_a(shape, poisson, friction=friction, tolerance=tolerance, **specimen)
    body.compile()
    points, seconds = [], []
    for load in LOADS:
        begin = time.process_time()
        state = body.press(float(load))
        seconds.append(time.process_time() - begin)
        if not isinstance(state, Equilibrium):
            raise SystemExit(f"{case}, {specimen}: {load:g} N was not reached: {state}")
        points.append(state)
    return Curve(body.model.mesh.element_count, points, seconds)


def row(label: str, values: Iterable[float], form: str) -> list[str]:
    return [label, *(format(value, form) for value in values)]


def case_table(case: str, refinements: Iterable[float]) -> str:
    """Errors, and what each mesh costs."""
    _, _, wanted, doubt = CASES[case]
    lines = [
        row("reference, mm", wanted, ".4f"),
        row("its +-, %", 100.0 * doubt / wanted, ".2f"),
    ]
    costs = []
    meshes = [("sector", r) for r in refinements] + [("quarter", 1.0)]
    for symmetry, refinement in meshes:
        label = f"{symmetry}, refinement {refinement:g}"
        print(f"{case}: {label}", file=sys.stderr)
        result = run(case, symmetry=symmetry, refinement=refinement)
        tight = run(case, symmetry=symmetry, refinement=refinement, tolerance=TIGHT_TOLERANCE)
        lines.append(row(f"{label}: mm", result.mm, ".4f"))
        lines.append(row(f"{label}: off by %", 100.0 * (result.mm / wanted - 1.0), "+.2f"))
        costs.append(
            [
                label,
                str(result.elements),
                f"{sum(result.seconds):.2f}",
                " ".join(str(p.iterations) for p in result.points),
                f"{100.0 * np.abs(result.mm / tight.mm - 1.0).max():.4f}",
                f"{sum(tight.seconds):.2f}",
                f"{max(p.penetration_m / p.displacement_m for p in result.points):.1e}",
                f"{max(abs(p.reaction_N / p.force_N - 1.0) for p in result.points):.1e}",
                f"{100.0 * max(p.hourglass_J / (p.internal_J + p.hourglass_J) for p in result.points):.1f}",
                f"{min(p.smallest_J for p in result.points):.3f}",
            ]
        )
    head = [
        "mesh",
        "elements",
        "8 loads, s",
        "iterations",
        f"change to {TIGHT_TOLERANCE:g}, %",
        f"at {TIGHT_TOLERANCE:g}, s",
        "penetration / indentation",
        "reaction off by",
        "hourglass, %",
        "smallest J",
    ]
    return f"**{case}**\n\n{table(['N', *(f'{load:.1f}' for load in LOADS)], lines)}\n\n{table(head, costs)}"


def friction_table() -> str:
    """Displacements of a rough tool, mm; they lie between those of the frictionless tool and of the bonded disc."""
    lines = []
    for friction in (0.0, 0.1, 0.3, 0.5, "stick"):
        result = run("punch", friction)
        lost = 100.0 * result.points[-1].friction_loss_J / max(result.points[-1].internal_J, 1e-300)
        lines.append([*row(f"{friction}", result.mm, ".4f"), f"{lost:.1f}", f"{sum(result.seconds):.2f}"])
    disc = run("disc")
    lines.append([*row("bonded disc", disc.mm, ".4f"), "0.0", f"{sum(disc.seconds):.2f}"])
    head = ["friction", *(f"{load:.1f} N" for load in LOADS), "lost, % of internal", "s"]
    return f"**Friction**, default sector, mm\n\n{table(head, lines)}"


def time_table(repeats: int = 3) -> str:
    """CPU seconds of eight loads, the best of some repeats, without compiling."""
    lines = []
    for symmetry, asked in ASKED_s.items():
        for case in CASES:
            runs = [run(case, symmetry=symmetry) for _ in range(repeats)]
            seconds = [sum(one.seconds) for one in runs]
            iterations = sum(p.iterations for p in runs[0].points)
            per = 1e9 * min(seconds) / iterations / runs[0].elements
            lines.append(
                [symmetry, case, str(runs[0].elements), str(iterations), f"{min(seconds):.2f}", f"{max(seconds):.2f}"]
                + [f"{asked:g}", f"{per:.0f}"]
            )
    head = ["part", "case", "elements", "iterations", "best, s", "worst, s", "asked, s", "ns per element and iteration"]
    return f"**Time** of eight loads\n\n{table(head, lines)}"


def eight_loads(checkout: Path, symmetry: str, tolerance: float) -> tuple[float, int, np.ndarray]:
    """CPU seconds, iterations and displacements [mm] of eight loads, by the package in a checkout."""
    answer = subprocess.run(
        [sys.executable, "-c", EIGHT_LOADS, symmetry, str(tolerance)],
        env={**os.environ, "PYTHONPATH": str(checkout)},
        cwd=checkout,
        capture_output=True,
        text=True,
        check=True,
    )
    seconds, iterations, mm = json.loads(answer.stdout)
    return seconds, iterations, np.array(mm)


def versions_table(other: Path) -> str:
    """This version and another one in turns, and how far both are from this one at a tolerance of 1e-6."""
    lines = []
    for symmetry in ASKED_s:
        converged = eight_loads(ROOT, symmetry, TIGHT_TOLERANCE)[2]
        for tolerance in (1e-4, 1e-3):
            runs = [[eight_loads(checkout, symmetry, tolerance) for checkout in (other, ROOT)] for _ in range(TURNS)]
            before, now = runs[0]
            seconds = np.array([[one[0] for one in turn] for turn in runs])
            lines.append(
                [symmetry, f"{tolerance:g}", str(before[1]), str(now[1])]
                + [f"{values.min():.2f} to {values.max():.2f}" for values in seconds.T]
                + [f"{np.median(seconds[:, 1] / seconds[:, 0]):.2f}"]
                + [f"{100.0 * np.abs(one[2] / converged - 1.0).max():.3f}" for one in (before, now)]
                + [f"{1e3 * np.abs(now[2] - before[2]).max():.2f}"]
            )
    head = ["part", "tolerance", "iterations before", "now", "CPU s before", "now", "ratio"]
    head += ["off by before, %", "now, %", "largest difference, um"]
    return f"**Versions** in turns, eight loads, one thread\n\n{table(head, lines)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--refinements", type=float, nargs="+", default=[1.0, 1.5, 2.0, 3.0])
    parser.add_argument("--out", type=Path, help="also write the tables there")
    parser.add_argument("--against", type=Path, help="another checkout, whose version is run in turns with this one")
    arguments = parser.parse_args()
    if arguments.against:
        print(versions_table(arguments.against.resolve()))
        return
    parts = [time_table(), *(case_table(case, arguments.refinements) for case in CASES), friction_table()]
    text = "\n\n".join(parts) + "\n"
    print(text)
    if arguments.out:
        arguments.out.write_text(text)


if __name__ == "__main__":
    main()
