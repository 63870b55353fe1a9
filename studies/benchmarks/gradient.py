"""What derivatives cost, and what they save: the coarse tongue in vowel [i].

    python studies/benchmarks/gradient.py [DURATION_MS]

Prints the processor time of a run with 8 directions over that of a run, in turns; and how many runs a Gauss-Newton search for
the forces of four muscles takes, from the places of five points in a run with other forces, with derivatives and differences.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.differentiated import Differentiated
from explicitfe.fem.solve.directions import Direction
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.host.shipped import scenario_file
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.read import read_transient

SMOOTH = [f"bone.{name}.smooth=true" for name in ("palate", "jaw", "pharynx")]
MUSCLES = {"GGp": 1.33, "GGh": 0.67, "GGa": 0.2, "SL": 0.3}
START_N = {"GGp": 0.8, "GGh": 1.0, "GGa": 0.1, "SL": 0.1}
CONSTANTS = {"model.material.C10_Pa": 1037.0, "model.material.C20_Pa": 486.0, "model.damping.alpha_per_s": 40.0}
MATERIAL_TABLE = 'model.material={law="yeoh", C10_Pa=1037.0, C20_Pa=486.0, poisson=0.499}'
POINTS = ("tip", "blade", "front", "dorsum", "back")
TURNS = 4
TOLERANCE_MM = 1e-3
DIFFERENCE_SHARE_OF_FORCE = 1e-2  # as large as a difference has to be where the force of bones jumps
MOST_ITERATIONS = 8


def model_with(values: dict[str, float]) -> Model:
    """The coarse tongue with these values of keys."""
    path = scenario_file("vowel-i")
    settings = ["model.resolution=coarse", MATERIAL_TABLE, *SMOOTH, *(f"{key}={value!r}" for key, value in values.items())]
    return assemble(read_transient(path, settings), path.parent).model


def directions_of(values: dict[str, float]) -> list[Direction]:
    """A direction for each key."""

    def at(key: str) -> Callable[[float], Model]:
        return lambda value: model_with({**values, key: value})

    return [Direction(key, value, at(key)) for key, value in values.items()]


def cost(duration_s: float) -> None:
    """Print the processor time of a run with tangents over that of a run, in turns."""
    values = {f"muscle.{name}.force_N": force for name, force in MUSCLES.items()} | CONSTANTS | {"muscle.STY.force_N": 0.1}
    model = model_with(values)
    plain = Simulation(model, threads=1)
    plain.compile()
    begin = time.process_time()
    tangent = Differentiated(model, directions_of(values))
    built_s = time.process_time() - begin
    tangent.compile()
    runs = [Transient(simulation, duration_s) for simulation in (plain, tangent)]
    spent = np.zeros(2)
    for turn in range(1, TURNS + 1):
        for number, run in enumerate(runs):
            begin = time.process_time()
            run.advance_to(duration_s * turn / TURNS)
            spent[number] += time.process_time() - begin
    count, ratio = len(values), spent[1] / spent[0]
    print(
        f"{plain.steps} steps of {model.mesh.element_count} elements: {spent[0]:.2f} s; with {count} directions {spent[1]:.2f} s"
    )
    print(
        f"ratio {ratio:.2f}; of a run, a direction costs {ratio / count:.2f} with the run and {(ratio - 1.0) / count:.2f} without"
    )
    print(f"building the directions: {built_s:.2f} s; same motion: {np.array_equal(plain.displacement, tangent.displacement)}")


def places_mm(simulation: Simulation) -> np.ndarray:
    """Forward and up of the points at the end [mm]."""
    model = simulation.model
    return 1e3 * np.array([model.mesh.at(model.probes[name], simulation.displacement)[0][[0, 2]] for name in POINTS]).ravel()


def search(duration_s: float, derivatives: bool) -> None:
    """Print the iterations of a Gauss-Newton search for the forces, and what it took."""
    keys = [f"muscle.{name}.force_N" for name in MUSCLES]
    goal = Simulation(model_with(dict(zip(keys, MUSCLES.values(), strict=True))), threads=1)
    Transient(goal, duration_s).advance_to(duration_s)
    wanted, forces = places_mm(goal), np.array(list(START_N.values()))
    begin, runs = time.process_time(), 0

    def run(at: np.ndarray, simulation: Simulation | None = None) -> np.ndarray:
        simulation = simulation or Simulation(model_with(dict(zip(keys, at.tolist(), strict=True))), threads=1)
        assert Transient(simulation, duration_s).advance_to(duration_s) is None
        return places_mm(simulation)

    for iteration in range(MOST_ITERATIONS + 1):
        values = dict(zip(keys, map(float, forces), strict=True))
        if derivatives:
            simulation = Differentiated(model_with(values), directions_of(values))
            error = run(forces, simulation) - wanted
            changes, points = simulation.displacement_changes, simulation.model.probes
            moved = [[simulation.model.mesh.at(points[name], change)[0][[0, 2]] for name in POINTS] for change in changes]
            jacobian, runs = 1e3 * np.array(moved).reshape(len(keys), -1).T, runs + 1
        else:
            error = run(forces) - wanted
            step = DIFFERENCE_SHARE_OF_FORCE
            moved = [run(forces + step * unit) - run(forces - step * unit) for unit in np.eye(len(keys))]
            jacobian, runs = np.array(moved).T / (2.0 * step), runs + 1 + 2 * len(keys)
        name = "derivatives" if derivatives else "differences"
        print(f"  {name} {iteration}: largest error {np.abs(error).max():.5f} mm, forces {np.round(forces, 4)} N, {runs} runs")
        if np.abs(error).max() < TOLERANCE_MM:
            break
        forces = np.maximum(forces - np.linalg.lstsq(jacobian, error, rcond=None)[0], 0.0)
    print(f"  {name}: {runs} runs, {time.process_time() - begin:.1f} s of processor time")


def main(duration_s: float) -> None:
    """Print both parts."""
    cost(duration_s)
    for derivatives in (True, False):
        search(duration_s, derivatives)


if __name__ == "__main__":
    main(1e-3 * float(sys.argv[1]) if len(sys.argv) > 1 else 0.1)
