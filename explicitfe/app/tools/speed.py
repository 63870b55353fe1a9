"""How fast this machine computes, beside what was measured elsewhere; and machine code made before it is needed."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.stable_step import STEP_SHARE_OF_LIMIT
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.compiled.threads import cores
from explicitfe.platform.errors import InputError, Progress, Share, counted, silent
from explicitfe.platform.host import shipped
from explicitfe.platform.host.load import load
from explicitfe.results.documents.run_summary import MachineCode, ScenarioSpeed, SpeedReport, SpeedRow
from explicitfe.simulate.run.machine_code import make_ready
from explicitfe.simulate.run.prepare import prepare

# Elements of the block that is timed, and how many there are along x, y and z.
TIMED_SIZES: dict[int, tuple[int, int, int]] = {1000: (10, 10, 10), 30_000: (30, 40, 25), 250_000: (50, 100, 50)}
TIMED_ELEMENTS = ("hex8", "hex8-stiffness")

# Nanoseconds per element and step, one thread: docs/reference/performance.md says where and when.
DOCUMENTED_NS: dict[str, dict[str, dict[int, float]]] = {
    "AVX2, 4 lanes": {
        "hex8": {1000: 48.0, 30_000: 52.0, 250_000: 56.0},
        "hex8-stiffness": {1000: 38.0, 30_000: 40.0, 250_000: 45.0},
    },
    "AVX-512, 8 lanes": {
        "hex8": {1000: 34.0, 30_000: 42.0, 250_000: 49.0},
        "hex8-stiffness": {1000: 23.0, 30_000: 31.0, 250_000: 37.0},
    },
}
TIMED_SCENARIO = "vowel-i"  # whose speed a user asks for first
TIMED_MATERIAL = Yeoh(C10_Pa=191.5, C20_Pa=90.6)
MOST_TIMED_STEPS = 400  # in one run
TIMED_RUNS = 5  # of which the best counts: the others were interrupted
USUAL_SECONDS_PER_ELEMENT = 60e-9  # of a step, about; it says how many steps fill a run

# What a person computes first: name -> scenario, settings.
USUAL_RUNS: dict[str, tuple[str, tuple[str, ...]]] = {
    "the tongue": ("vowel-i", ("model.resolution=coarse",)),
    "a specimen under a punch": ("indentation-rear", ()),
    "a specimen under a ball": ("indentation-ball", ()),
}
# What else comes up: other elements, and tissue without or with time. The fully integrated element knows no tissue that relaxes.
ELASTIC_TONGUE = "vowel-i-gerard-2005"
FURTHER_RUNS: dict[str, tuple[str, tuple[str, ...]]] = {
    "the tongue of hex8-stiffness": ("vowel-i", ("model.resolution=coarse", "model.element=hex8-stiffness")),
    "an elastic tongue": (ELASTIC_TONGUE, ("model.resolution=coarse",)),
    "an elastic tongue of hex8-stiffness": (ELASTIC_TONGUE, ("model.resolution=coarse", "model.element=hex8-stiffness")),
    "an elastic tongue of hex8-full": (ELASTIC_TONGUE, ("model.resolution=coarse", "model.element=hex8-full")),
    "a viscoelastic specimen": ("indentation-rear", ("effects.viscoelastic={g=[0.3],tau_s=[1.0]}",)),
}


def block(cells: tuple[int, int, int], edge_m: float = 0.004) -> HexMesh:
    """A block of hexes with every node moved at random by up to 15 % of the edge."""
    mesh = box(cells, [n * edge_m for n in cells])
    shift = np.random.default_rng(0).uniform(-0.15, 0.15, mesh.points.shape) * edge_m
    return HexMesh(mesh.points + shift, mesh.hexes)


def problem(elements: int, element: str, threads: int | None = None) -> Simulation:
    """The block that is timed: Yeoh tissue at Poisson's ratio 0.499, damped, free, set in motion at random."""
    mesh = block(TIMED_SIZES[elements])
    free = np.zeros((mesh.node_count, 3), dtype=bool)
    velocity = np.random.default_rng(1).standard_normal((mesh.node_count, 3)) * 1e-3
    return Simulation(Model(mesh, TIMED_MATERIAL, free, alpha_per_s=40.0, element=element), velocity=velocity, threads=threads)


def nanoseconds(simulation: Simulation, seconds: float = 1.0) -> float:
    """Of the whole step, per element: best of several runs of the compiled loop, which take about ``seconds`` together."""
    elements = simulation.model.mesh.element_count
    dt = STEP_SHARE_OF_LIMIT * simulation.stable_limit(20)
    simulation.start(dt)
    simulation.advance(2, dt)
    steps = min(MOST_TIMED_STEPS, max(3, int(seconds / TIMED_RUNS / (USUAL_SECONDS_PER_ELEMENT * elements))))
    begun = simulation.restart_state()
    best = np.inf
    for _ in range(TIMED_RUNS):
        begin = time.perf_counter()
        simulation.advance(steps, dt)
        best = min(best, time.perf_counter() - begin)
        simulation.restore(begun)  # without looks a step fits for a while only
    return 1e9 * best / steps / elements


def bench(sizes: Sequence[int] = tuple(TIMED_SIZES), progress: Progress = silent) -> SpeedReport:
    """Time the step of a block of hexes at several sizes, and of the tongue saying [i].

    Raises
    ------
    InputError : a size is none of ``TIMED_SIZES``.
    """
    unknown = [size for size in sizes if size not in TIMED_SIZES]
    if unknown:
        raise InputError(f"there is no block of {unknown[0]} elements to be timed; take {', '.join(map(str, TIMED_SIZES))}.")
    load_before = load()
    reference = next((table for name, table in DOCUMENTED_NS.items() if f" {WIDTH} lanes" in name), {})
    rows: list[SpeedRow] = []
    for done, (size, element) in enumerate([(size, element) for size in sizes for element in TIMED_ELEMENTS]):
        progress("bench", counted(done, len(sizes) * len(TIMED_ELEMENTS) + 1, "measurement"))
        alone = problem(size, element, threads=1)
        make_ready(alone, progress, f"blocks of {element} elements")
        row: SpeedRow = {
            "elements": size,
            "element": element,
            "ns": nanoseconds(alone),
            "reference_ns": reference.get(element, {}).get(size),
            "threads": None,
            "ns_threads": None,
        }
        if cores() > 1:
            shared = problem(size, element, threads=cores())
            row["threads"], row["ns_threads"] = len(shared.parts), nanoseconds(shared)
        rows.append(row)
    scenario = _scenario_speed()
    progress("bench", 1.0)
    return {"lanes": WIDTH, "cores": cores(), "load": load_before, "rows": rows, "scenario": scenario}


def _scenario_speed() -> ScenarioSpeed:
    """The loop alone of vowel [i], at the step that it begins with."""
    prepared = prepare(shipped.scenarios()[TIMED_SCENARIO])
    simulation: Simulation = prepared.body
    simulation.compile()
    steps = int(np.ceil(1e-3 * prepared.scenario.analysis.duration_ms / (STEP_SHARE_OF_LIMIT * simulation.stable_limit(40))))
    hexes = prepared.model.mesh.element_count
    seconds = 1e-9 * nanoseconds(simulation, 0.5) * steps * hexes
    factor = 1e-3 * prepared.scenario.analysis.duration_ms / seconds
    return {"name": TIMED_SCENARIO, "hexes": hexes, "steps": steps, "loop_s": seconds, "real_time_factor": factor}


def warm(everything: bool = False, progress: Progress = silent) -> MachineCode:
    """Make the machine code that runs need and keep it on disk, so that no run has to wait for it.

    Parameters
    ----------
    everything : also for other elements and for tissue that relaxes.

    Returns
    -------
    What it was made for, and seconds that it took, next to nothing where it was there.
    """
    wanted = USUAL_RUNS | (FURTHER_RUNS if everything else {})
    seconds_of: dict[str, float] = {}
    progress("warm", 0.0)
    for number, (name, (scenario, settings)) in enumerate(wanted.items()):
        words = f"group {number + 1} of {len(wanted) + 1}, {name}"

        def report(part: float, number: int = number, words: str = words) -> None:
            progress("warm", Share((number + part) / (len(wanted) + 1), words))

        seconds_of[name] = prepare(shipped.scenarios()[scenario], settings).body.compile(report)
    begin = time.perf_counter()
    point.uniaxial(TIMED_MATERIAL, (), np.array([0.0, 1.0]), np.array([1.0, 0.9]))
    seconds_of["homogeneous states"] = time.perf_counter() - begin
    progress("warm", 1.0)
    return {"seconds": seconds_of}
