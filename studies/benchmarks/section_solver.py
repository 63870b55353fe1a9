"""Time and error of one ramp under a flat tool: the section of a body of revolution, and hexahedra.

    python studies/benchmarks/section_solver.py

The tool has a radius of 14 mm and an edge of 1 mm, the specimen 35 x 20 mm and C10 = 200, C20 = 100 Pa; 16 loads up to 0.6 N.
Errors are differences of the depth from a section of refinement 2.0. Hexahedra have Poisson's ratio 0.499, which makes the tool
sink in deeper by some 18 micrometres at 0.8 N. All runs use one thread, after their kernels have been compiled. Two cores, busy:

| | time, s | largest error, um | rms error, um |
|---|---|---|---|
| section, refinement 0.6, with 4 variants | 0.59 | 6.9 | 2.2 |
| section, refinement 1.0 | 0.77 | 1.1 | 0.4 |
| section, refinement 1.5 | 1.31 | 0.9 | 0.3 |
| hexahedra, refinement 0.6 | 0.31 | 48.2 | 24.8 |
| hexahedra, refinement 1.0 | 0.69 | 12.1 | 6.0 |
| hexahedra, refinement 1.5 | 1.52 | 7.0 | 2.4 |
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.fem.solve.revolution import Revolution, ToolState
from explicitfe.simulate.anatomy.specimen import specimen_model

LAW = Yeoh(C10_Pa=200.0, C20_Pa=100.0, poisson=0.499)
SPECIMEN = SpecimenTable(radius_mm=35.0, height_mm=20.0, base="bonded", material=LAW)
TOOL = ToolTable(shape="flat-cylinder", radius_mm=14.0, edge_radius_mm=1.0)
FORCES_N = np.linspace(0.0, 0.6, 17)[1:]
REPEATS = 3


def section(refinement: float, variants: int = 0) -> Revolution:
    """A section with so many variants."""
    others = [(LAW.model_copy(update={"C10_Pa": 200.0 * (1.0 + 1e-3 * k)}), ()) for k in range(1, variants + 1)]
    return Revolution(SPECIMEN, TOOL, LAW, (), refinement, variants=others)


def hexahedra(refinement: float) -> Relaxation:
    """A sector of hexahedra."""
    table = SPECIMEN.model_copy(update={"refinement": refinement})
    return Relaxation(specimen_model(table, TOOL), 5e-4, threads=1)


def ramp(make: Callable[[], Revolution | Relaxation]) -> tuple[np.ndarray, float]:
    """Depths [mm] and the best time [s] of some runs."""
    best = np.inf
    for _ in range(REPEATS):
        body = make()
        body.compile()
        begin = time.perf_counter()
        body.settle()
        depths = []
        for force in FORCES_N:
            reached = body.press(float(force))
            assert isinstance(reached, ToolState | Equilibrium), reached
            depths.append(1e3 * reached.displacement_m)
        best = min(best, time.perf_counter() - begin)
    return np.array(depths), best


def main() -> None:
    """Print the table."""
    exact, _ = ramp(lambda: section(2.0))
    cases: dict[str, Callable[[], Revolution | Relaxation]] = {
        "section, refinement 0.6": lambda: section(0.6),
        "section, refinement 0.6, with 4 variants": lambda: section(0.6, 4),
        "section, refinement 1.0": lambda: section(1.0),
        "section, refinement 1.5": lambda: section(1.5),
        "hexahedra, refinement 0.6": lambda: hexahedra(0.6),
        "hexahedra, refinement 1.0": lambda: hexahedra(1.0),
        "hexahedra, refinement 1.5": lambda: hexahedra(1.5),
    }
    print("| | time, s | largest error, um | rms error, um |\n|---|---|---|---|")
    for name, make in cases.items():
        depths, seconds = ramp(make)
        off = 1e3 * (depths - exact)
        print(f"| {name} | {seconds:.2f} | {np.abs(off).max():.1f} | {np.sqrt(np.mean(off**2)):.1f} |")


if __name__ == "__main__":
    main()
