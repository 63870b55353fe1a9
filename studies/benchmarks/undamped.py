"""Does energy drift where nothing damps it? The coarse tongue, free after a shake and driven by vowel [i], for many steps.

    python studies/benchmarks/undamped.py [STEPS]

Prints how far the energy balance is off, with its sign, at ten instants of so many steps (200 000 if left out), with and without
the barrier against folding, and what the run took.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np

from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.ledger import Ledger, balance
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import BARRIER
from explicitfe.simulate.anatomy.tongue import tongue_model

EVERY_S = 5e-3
LOOKS = 10
ENDLESS_S = 3600.0


def shaken(mesh_points: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Velocities (n, 3) m/s in waves of some 10 cm, zero where the body is held."""
    velocity = 0.3 * np.sin(60.0 * mesh_points[:, [2, 0, 1]])
    velocity[held.any(axis=1)] = 0.0
    return velocity


def bodies() -> dict[str, tuple[Model, np.ndarray | None]]:
    """Name -> model without damping, and its velocity at the start."""
    free = tongue_model({}, resolution="coarse", alpha_per_s=0.0)
    driven = tongue_model({"GGp": 2.0, "GGa": 0.2}, resolution="coarse", alpha_per_s=0.0, distribution="stress")
    return {
        f"{name}, {'with' if barrier else 'without'} barrier": (replace(model, barrier=barrier), velocity)
        for name, model, velocity in (("free", free, shaken(free.mesh.points, free.held)), ("driven", driven, None))
        for barrier in (False, True)
    }


def main(steps: int) -> None:
    """Print a row for each body."""
    for name, (model, velocity) in bodies().items():
        simulation = Simulation(model, velocity=velocity, threads=1)
        simulation.compile()
        begin = time.perf_counter()
        transient, ledger = Transient(simulation, ENDLESS_S), Ledger()
        errors: list[float] = []
        for recording in transient.recordings(EVERY_S):
            ledger.add_until(recording.energies, np.inf)
            if simulation.steps >= (len(errors) + 1) * steps / LOOKS:
                scale = max(e[0] + e[1] for e in ledger.energies)
                errors.append((balance(ledger.energies[-1]) - balance(ledger.energies[0])) / scale)
            if simulation.steps >= steps:
                break
        end = "finished" if transient.status is None else transient.status.state
        barrier = max(e[BARRIER] / (e[0] + e[1] + 1e-300) for e in ledger.energies)
        print(
            f"| {name} | {end} | {simulation.steps} | {simulation.time_s:.2f} s | {time.perf_counter() - begin:.0f} s | "
            f"{barrier:.3f} | {ledger.balance_error:.1e} | {', '.join(f'{1e3 * error:+.1f}' for error in errors)} |",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
