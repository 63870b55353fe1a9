"""What contact of free surfaces costs a step: of the tongue, and of two blocks that are pressed together.

    python studies/benchmarks/surfaces.py

The tongue at medium resolution, living tissue with beta = 0.03 s, one thread, with and without bones and with and without
``[contact]``, at rest and 5 ms after a step of STY to 20 N. That force is far above that of the muscle: at usual forces hardly a
point touches. Then two blocks of 10 x 10 x 10 elements, apart and 0.1 mm into each other over a whole side.

All variants of a state begin with the same displacement and velocity and take turns, so that what else the machine does falls on
all of them; the best of many rounds, each from the same state again. The cost of a point that touches is the increase of the cost
of ``[contact]`` over the points; it includes the search in the faces around them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from explicitfe.fem.materials.neo_hooke import NeoHooke
from explicitfe.fem.mesh.box import box
from explicitfe.fem.mesh.joined import join
from explicitfe.fem.model.model import Model
from explicitfe.fem.model.surface_contact import SurfaceContact
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.bodies import ContactTable
from explicitfe.simulate.scenario.bones import BoneTable
from explicitfe.simulate.scenario.transient import AnalysisTable, Damping, ModelTable, MuscleTable, TransientScenario

ROUNDS, STEPS = 60, 20
POSTURE_S = 0.005
EDGE_M, GAP_M, DEPTH_M = 0.02, 0.005, 1e-4
VARIANTS = ("neither", "bones", "[contact]", "both")
Motion = tuple[np.ndarray, np.ndarray]


def tongue(variant: str) -> Model:
    """The tongue with or without bones and contact of its surface with itself."""
    scenario = TransientScenario(
        title="cost",
        model=ModelTable(
            name="tongue",
            resolution="medium",
            material="buchaillard-2009",
            damping=Damping(alpha_per_s=40.0, beta_s=0.03),
            attachment="area",
        ),
        muscle=[MuscleTable(name="STY", force_N=20.0, distribution="stress")],
        bone=[BoneTable(name=name) for name in ("palate", "jaw", "pharynx")] if variant in ("bones", "both") else [],
        contact=ContactTable() if variant in ("[contact]", "both") else None,
        analysis=AnalysisTable(duration_ms=1000.0),
    )
    return assemble(scenario, Path())[0]


def blocks(variant: str) -> Model:
    """Two blocks one above the other, free."""
    block = box((10, 10, 10), 3 * (EDGE_M,))
    upper = replace(block, points=block.points + np.array([0.3e-3, 0.3e-3, EDGE_M + GAP_M]), named_points={})
    mesh = join({"lower": block, "upper": upper})
    contact = SurfaceContact() if variant == "[contact]" else None
    return Model(mesh, NeoHooke(C10_Pa=2000.0), np.zeros((mesh.node_count, 3), dtype=bool), surfaces=contact)


def at_rest(model: Model) -> Motion:
    return np.zeros((model.mesh.node_count, 3)), np.zeros((model.mesh.node_count, 3))


def posture(model: Model) -> Motion:
    """Displacement and velocity that the muscle leads to."""
    running = Simulation(model, threads=1)
    Transient(running, 1.0).advance_to(POSTURE_S)
    now = running.snapshot()
    return now.displacement.copy(), now.velocity.copy()


def pressed(model: Model) -> Motion:
    """The upper block moved into the lower one."""
    u, v = at_rest(model)
    u[model.mesh.node_sets["upper"], 2] = -GAP_M - DEPTH_M
    return u, v


def microseconds(build: Callable[[str], Model], names: tuple[str, ...], motion: Motion) -> tuple[dict[str, float], int]:
    """Of each variant the time of a step, and how many points touch at first in the last one."""
    running = {name: Simulation(build(name), displacement=motion[0], velocity=motion[1], threads=1) for name in names}
    begun = {}
    for name, one in running.items():
        one.compile()
        Transient(one, 1.0)  # chooses the step
        begun[name] = one.restart_state()
    points = int(running[names[-1]].surfaces.touches[0])
    step_s = min(one.dt_s for one in running.values())
    best = dict.fromkeys(names, np.inf)
    for _ in range(ROUNDS):
        for name, one in running.items():
            one.restore(begun[name])
            before = one.course_s
            if not one.advance(STEPS, step_s):
                raise SystemExit(f"{name}: an element has inverted")
            best[name] = min(best[name], 1e6 * (one.course_s - before) / STEPS)
    return best, points


def main() -> None:
    """Print the table."""
    print("| | points that touch |", " | ".join(f"{name}, µs a step" for name in VARIANTS), "| bones, share | [contact], share |")
    print("|---" * 8 + "|")
    states = {
        "tongue at rest": (tongue, VARIANTS, at_rest),
        "tongue, STY 20 N": (tongue, VARIANTS, posture),
        "two blocks apart": (blocks, ("neither", "[contact]"), at_rest),
        "two blocks pressed": (blocks, ("neither", "[contact]"), pressed),
    }
    costs, touching = [], []
    for state, (build, names, motion) in states.items():
        best, points = microseconds(build, names, motion(build(names[-1])))
        whole = best[names[-1]]
        cells = [f"{best[name]:.1f}" if name in best else "" for name in VARIANTS]
        bones = f"{100.0 * (whole - best['[contact]']) / whole:.1f} %" if "both" in best else ""
        costs.append(whole - best["bones" if "both" in best else "neither"])
        touching.append(points)
        print(f"| {state} | {points} |", " | ".join(cells), f"| {bones} | {100.0 * costs[-1] / whole:.1f} % |")
    for name, first in (("tongue", 0), ("two blocks", 2)):
        if touching[first + 1]:
            print(f"{name}: {1e3 * (costs[first + 1] - costs[first]) / touching[first + 1]:.0f} ns a point that touches")


if __name__ == "__main__":
    main()
