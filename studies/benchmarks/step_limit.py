"""The step that explicitfe takes against the true limit of a run: the table of docs/studies/step.md.

    python studies/benchmarks/step_limit.py [--real FOLDER] [--out docs/studies/step.md]

The true limit is measured, not computed: the longest fixed step with which a body at rest, given a small random velocity, does
not blow up within 2000 steps, by bisection. ``--real FOLDER`` adds the measured tongue (see real_tongue.py).
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from real_tongue import write_model, write_scenario

from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.kernels import ELEMENTS
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import CALMING_ALPHA_PER_S, Transient
from explicitfe.platform.compiled.arrays import SMALLEST_J
from explicitfe.simulate.run.prepare import prepare

ROOT = Path(__file__).resolve().parents[2]
STEPS = 2000
GROWTH = 1e3  # of the largest velocity: an unstable mode grows by exp(2 sqrt(2 e)) a step at 1 + e times the limit
RESOLUTION = 2e-4  # of the limit, where the bisection ends; there it has grown by exp(80)
EDGE = 0.004  # m


# ---- the true limit ----


def blows_up(model: Model, dt: float) -> bool:
    """Whether a small random velocity grows without bound at this step; strains stay below 1e-6 as long as it does not."""
    mesh = model.mesh
    shortest = np.cbrt(Simulation(model).volumes.min())
    speed = 1e-9 * shortest / dt
    velocity = speed * np.random.default_rng(7).standard_normal((mesh.node_count, 3))
    simulation = Simulation(model, velocity=velocity)
    simulation.start(dt)
    for _ in range(10):
        if not simulation.advance(STEPS // 10, dt) or not np.abs(simulation.state.v).max() < GROWTH * speed:
            return True
    return False


def true_limit(model: Model) -> float:
    """The longest stable step [s] of a body at rest, measured by runs; within RESOLUTION."""
    low = high = Simulation(model).stable_limit(60)
    while blows_up(model, low):
        high, low = low, 0.98 * low
    while high == low or not blows_up(model, high):
        low, high = high, 1.02 * high
    while high - low > RESOLUTION * low:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if blows_up(model, middle) else (middle, high)
    return low


def calmed(model: Model) -> Model:
    """The same with damping that calms its fastest vibrations: without, steps are shorter (``undamped.py``)."""
    return replace(model, alpha_per_s=CALMING_ALPHA_PER_S)


def taken(model: Model) -> float:
    """The step [s] with which a run of this model starts."""
    simulation = Simulation(calmed(model))
    return Transient(simulation, 1e4 * simulation.stable_bound()[0]).smallest_dt_s


def ratios(model: Model) -> tuple[float, float]:
    """The bound and the step taken, over the true limit."""
    limit = true_limit(model)
    return Simulation(model).stable_bound()[0] / limit, taken(model) / limit


# ---- bodies ----


def grid(cells: tuple[int, int, int], edges: tuple[float, float, float], distort: float = 0.0, seed: int = 0) -> HexMesh:
    """A block of hexes; each node moves at random by up to ``distort`` of the edges."""
    points = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), -1).reshape(-1, 3)
    number = np.arange(len(points)).reshape([n + 1 for n in cells])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    nx, ny, nz = cells
    hexes = np.stack([number[i : i + nx, j : j + ny, k : k + nz].ravel() for i, j, k in corners], axis=1)
    shift = np.random.default_rng(seed).uniform(-distort, distort, points.shape)
    return HexMesh((points + shift) * np.array(edges), hexes)


def one_sliver() -> HexMesh:
    """4 x 4 x 4 cubes; the top of one in the middle is pressed down to a tenth of its height."""
    mesh = grid((4, 4, 4), (EDGE, EDGE, EDGE))
    points = mesh.points.copy()
    element = mesh.hexes[21]  # the second along each axis
    points[element[4:], 2] = points[element[:4], 2] + 0.1 * EDGE
    return HexMesh(points, mesh.hexes)


def free(mesh: HexMesh, element: str, poisson: float = 0.499) -> Model:
    """A free body of cadaver tissue."""
    tissue = Yeoh(C10_Pa=191.5, C20_Pa=90.6, poisson=poisson)
    return Model(mesh, tissue, np.zeros((mesh.node_count, 3), dtype=bool), element=element)


def unloaded(scenario: Path, settings: list[str]) -> Model:
    """The body of a scenario, held as it says, without what pulls it."""
    return replace(prepare(scenario, settings).model, loads=(), pulls=())


def bodies() -> Iterator[tuple[str, Callable[[str], Model]]]:
    """What is measured: a name, and element -> model."""
    cube, flat, needle = (EDGE, EDGE, EDGE), (EDGE, EDGE, 0.1 * EDGE), (0.1 * EDGE, 0.1 * EDGE, EDGE)
    meshes = {
        "1 cube": grid((1, 1, 1), cube),
        "4³ cubes": grid((4, 4, 4), cube),
        "10³ cubes": grid((10, 10, 10), cube),
        "1 hex, 15 % distorted": grid((1, 1, 1), cube, 0.15, seed=1),
        "4³ hexes, 15 % distorted": grid((4, 4, 4), cube, 0.15),
        "10³ hexes, 15 % distorted": grid((10, 10, 10), cube, 0.15),
        "4³ plates 10 : 10 : 1": grid((4, 4, 4), flat),
        "4³ needles 1 : 1 : 10": grid((4, 4, 4), needle),
        "4³ plates, 15 % distorted": grid((4, 4, 4), flat, 0.15),
        "4³ cubes, one a sliver": one_sliver(),
    }
    for name, mesh in meshes.items():
        yield name, lambda element, mesh=mesh: free(mesh, element)
    for poisson in (0.0, 0.3, 0.49, 0.4999):
        name = f"4³ hexes, 15 % distorted, ν = {poisson:g}"
        yield name, lambda element, poisson=poisson: free(meshes["4³ hexes, 15 % distorted"], element, poisson)


def tongues(real: Path | None, folder: Path) -> dict[str, tuple[Path, list[str]]]:
    """Scenario and settings of vowel [i] by forces on nodes, on each tongue."""
    scenario = ROOT / "scenarios" / "vowel-i-gerard-2005.toml"
    cases = {f"tongue, {r}": (scenario, [f"model.resolution={r}"]) for r in ("coarse", "medium")}
    if real:
        write_model(real, folder)
        cases["measured tongue"] = (write_scenario(folder), [])
    return cases


# ---- deformed states, and a run ----


def deformed_limit(model: Model, u: np.ndarray) -> float:
    """2 / omega_max [s] of the state u, dense: a body that is not in equilibrium does not stay there to be measured."""
    simulation = Simulation(model)
    step = 1e-7 * EDGE
    columns = []
    for entry in range(u.size):
        forces = []
        for sign in (1.0, -1.0):
            moved = u.copy()
            moved.flat[entry] += sign * step
            forces.append(simulation.internal_force(moved).ravel())
        columns.append((forces[0] - forces[1]) / (2.0 * step))
    root = np.sqrt(np.repeat(simulation.nodal_mass, 3))
    matrix = np.array(columns) / root[:, None] / root
    return 2.0 / np.sqrt(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[-1])


# Strongly deformed: a mesh, and by what share of its edges each node moves about the affine field.
DEFORMED = {
    "3³ hexes, 15 % distorted, nodes moved by 10 %": (grid((3, 3, 3), (EDGE, EDGE, EDGE), 0.15), 0.1),
    "1 plate 10 : 10 : 1, nodes moved by 40 %": (grid((1, 1, 1), (EDGE, EDGE, 0.1 * EDGE)), 0.4),
    "1 needle 1 : 1 : 10, nodes moved by 40 %": (grid((1, 1, 1), (0.1 * EDGE, 0.1 * EDGE, EDGE)), 0.4),
}


def deformed_ratios(mesh: HexMesh, noise: float, element: str) -> tuple[float, float]:
    """Largest ratios of the bound and of the step taken to the limit, over ten strongly deformed states."""
    edges = np.ptp(mesh.points, axis=0) / round(mesh.element_count ** (1 / 3))
    model = free(mesh, element)
    rng = np.random.default_rng(5)
    shares = []
    while len(shares) < 10:
        F = np.linalg.qr(rng.standard_normal((3, 3)))[0] * np.exp(rng.uniform(np.log(0.5), np.log(1.8), 3))
        F *= np.sign(np.linalg.det(F))
        u = mesh.points @ (F - np.eye(3)).T + rng.uniform(-noise, noise, mesh.points.shape) * edges
        simulation = Simulation(calmed(model), displacement=u)
        limit = deformed_limit(model, u)
        dt = Transient(simulation, 1e4 * limit).smallest_dt_s
        if not simulation.ledger[SMALLEST_J] > 0.1:
            continue  # as good as inside out
        shares.append((Simulation(model, displacement=u).stable_bound()[0] / limit, dt / limit))
    return tuple(np.max(shares, axis=0))


def run_ratios(scenario: Path, settings: list[str]) -> tuple[str, float, float]:
    """How a run of 120 ms ended, and the largest and the median ratio of its step to the limit of its state at every ms."""
    prepared = prepare(scenario, settings)
    transient = Transient(prepared.body, 0.120)
    shares, status = [], None
    for time_s in np.arange(1, 121) * 1e-3:
        status = transient.advance_to(time_s)
        if status:
            break
        state = Simulation(prepared.model, displacement=prepared.body.displacement)
        shares.append(prepared.body.dt_s / state.stable_limit(100))
    return status.state if status else "finished", max(shares), float(np.median(shares))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--real", type=Path, help="folder of the measured mesh")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "studies" / "step.md")
    arguments = parser.parse_args()
    rows, deformed, runs, all_taken = [], [], [], []
    with tempfile.TemporaryDirectory() as folder:
        places = tongues(arguments.real, Path(folder))
        measured = list(bodies())
        for name, (scenario, settings) in places.items():
            measured.append((name, lambda e, s=scenario, t=settings: unloaded(s, [*t, f"model.element={e}"])))
        for name, model_of in measured:
            for element in ELEMENTS:
                bound, step = ratios(model_of(element))
                all_taken.append(step)
                rows.append(f"| {name} | {element} | {bound:.2f} | {step:.3f} |")
                print(rows[-1], flush=True)
        for (name, (mesh, noise)), element in product(DEFORMED.items(), ELEMENTS):
            bound, step = deformed_ratios(mesh, noise, element)
            deformed.append(f"| {name} | {element} | {bound:.2f} | {step:.3f} |")
            print(deformed[-1], flush=True)
        for name, (scenario, settings) in places.items():
            for element in ELEMENTS:
                end, largest, middle = run_ratios(scenario, [*settings, f"model.element={element}"])
                runs.append(f"| {name} | {element} | {end} | {largest:.3f} | {middle:.3f} |")
                print(runs[-1], flush=True)
    text = f"""# The step against the true limit

Made by `python studies/benchmarks/step_limit.py`. Central differences are stable up to a step of 2 / ω_max.
Here that limit is measured:
the longest fixed step with which a body at rest, given a small random velocity, does not blow up within {STEPS} steps, by
bisection to {RESOLUTION:g}. *bound*: `Simulation.stable_bound()`, the step that is stable for certain, from the elements one by
one. *taken*: the step with which a run starts, 0.9 of the limit that the Lanczos iteration gives. Tissue 191.5/90.6 Pa, Poisson's
ratio 0.499 unless a row says otherwise; blocks are free, tongues held at jaw and hyoid.

Median of taken/true: **{np.median(all_taken):.3f}**; from {min(all_taken):.3f} to {max(all_taken):.3f}. Below 1 is stable.

| mesh | element | bound / true limit | time step / true limit |
|---|---|---|---|
{chr(10).join(rows)}

## Strongly deformed

Stretched by factors between 0.5 and 1.8 along three axes, turned, and each node moved at random by a share of the edges; the
largest ratio of ten states with J above 0.1. A body out of equilibrium does not stay there to be measured, so the limit is that
of the dense matrix. The bound holds here as at rest: it comes from the
forces themselves, differenced element by element. No step is taken from it: it names the element that limits, and what a check of
a scenario predicts at rest.

| mesh | element | bound / true limit | time step / true limit |
|---|---|---|---|
{chr(10).join(deformed)}

## Over a run

Vowel [i] by forces on nodes (`vowel-i-gerard-2005`), 120 ms: the step in use over the limit of the state, by 100 turns of Lanczos
from a fresh start, at every millisecond.

| mesh | element | end | largest | median |
|---|---|---|---|---|
{chr(10).join(runs)}
"""
    arguments.out.write_text(text)
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    main()
