"""What contact with bones, ties and muscle stress cost a step of the tongue.

    python studies/benchmarks/bones.py

1 000 hexes ([25, 4, 10]), living tissue with beta = 0.03 s, one thread, in the vowel [i] at 60 ms, when the tongue rests on the
jaw and touches the palate. All variants take turns, so that what else the machine does falls on all of them; the best of many.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.bones import BoneTable
from explicitfe.simulate.scenario.transient import AnalysisTable, Damping, ModelTable, MuscleTable, TransientScenario

ROUNDS, STEPS = 40, 100
VARIANTS = {
    "neither": (False, False, False),
    "muscle stress": (True, False, False),
    "ties by area": (False, True, False),
    "contact": (False, False, True),
    "all three": (True, True, True),
}


def simulation(stress: bool, area: bool, contact: bool) -> Simulation:
    """The tongue at 60 ms; without stress the muscles pull along their fibres, as dead loads."""
    muscles = {"GGp": 2.0, "GGa": 0.2}
    scenario = TransientScenario(
        title="cost",
        model=ModelTable(
            name="tongue",
            cells=(25, 4, 10),
            material="buchaillard-2009",
            damping=Damping(alpha_per_s=40.0, beta_s=0.03),
            attachment="area" if area else "nodes",
        ),
        muscle=[MuscleTable(name=n, force_N=f, distribution="stress" if stress else "along") for n, f in muscles.items()],
        bone=[BoneTable(name=name) for name in ("palate", "jaw")] if contact else [],
        analysis=AnalysisTable(duration_ms=1000.0),
    )
    running = Simulation(assemble(scenario, Path())[0], threads=1)
    running.compile()
    Transient(running, 1.0).advance_to(0.06)
    return running


def main() -> None:
    """Print the table."""
    running = {name: simulation(*parts) for name, parts in VARIANTS.items()}
    times: dict[str, list[float]] = {name: [] for name in running}
    for _ in range(ROUNDS):
        for name, one in running.items():
            before = one.loop_s
            one.advance(STEPS, one.dt_s)
            times[name].append((one.loop_s - before) / STEPS)
    plain = min(times["neither"])
    touching = int(np.sum(running["all three"].snapshot().contact_pressure > 0.0))
    print(f"{touching} nodes touch bone")
    print("| | µs a step | of the plain step |\n|---|---|---|")
    for name, values in times.items():
        print(f"| {name} | {1e6 * min(values):.1f} | {min(values) / plain:.2f} |")


if __name__ == "__main__":
    main()
