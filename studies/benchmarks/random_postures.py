"""Random postures of the built-in tongue: how deep it goes into palate, jaw and pharynx.

    python studies/benchmarks/random_postures.py [--count 1000] [--mesh medium] [--share 0.25] [--seed 1]

Each muscle is active with probability 0.4, with a force that is uniform up to a share of its maximum; the jaw
opens by -4 to 12 mm. 200 ms, ramps of 50 ms. The depths are those of nodes and of 5 by 5 points of each face behind the surface
as drawn, beyond that at rest, at the sample (every 20 ms) where contact with the bone is deepest.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache, partial

import numpy as np
from mouth import SAMPLE_EVERY_S, Mouth, Posture

from explicitfe.fem.mesh.validity import certify
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.compiled.arrays import BONE_DEPTH
from explicitfe.platform.errors import RunError
from explicitfe.simulate.run.crossings import behind_surface

ACTIVE_PROBABILITY = 0.4
JAW_MM = (-4.0, 12.0)
DEEPEST_MM = {"nodes": (2, 0.3), "points of faces": (5, 0.5)}  # points along an edge, and what counts as a crossing


@lru_cache(maxsize=1)
def mouth_of(mesh: str) -> Mouth:
    """The mouth of a resolution, once in each process."""
    return Mouth(mesh)


def deepest_mm(mesh: str, share: float, seed: int, number: int) -> tuple[dict[tuple[str, str], float], str, int]:
    """Bone and kind of point -> largest depth of one posture; how its run ended; how many elements are inverted at the end."""
    mouth, generator = mouth_of(mesh), np.random.default_rng([seed, number])
    forces_N = {
        name: float(share * most * generator.random())
        for name, most in mouth.maxima_N.items()
        if generator.random() < ACTIVE_PROBABILITY
    }
    posture = Posture(forces_N, float(generator.uniform(*JAW_MM)))
    model = mouth.model(posture)
    transient = Transient(Simulation(model, threads=1), 1e-3 * posture.duration_ms)
    deepest, ended = {}, "finished"
    try:
        for sample in transient.samples(SAMPLE_EVERY_S):
            for at, depth_m in enumerate(sample.contact[:, BONE_DEPTH]):
                if depth_m > (deepest[at].contact[at, BONE_DEPTH] if at in deepest else 0.0):
                    deepest[at] = sample
    except RunError as error:
        ended = str(error)
    depths = {(bone.name, kind): 0.0 for bone in model.bones for kind in DEEPEST_MM}
    for at, one in deepest.items():
        bone = model.bones[at]
        for kind, (along_edge, _) in DEEPEST_MM.items():
            crossing = behind_surface(model.mesh, bone, one.displacement, one.time_s, along_edge)
            depths[bone.name, kind] = 1e3 * crossing.depth_m
    folded = certify(model.mesh.points + sample.displacement, model.mesh.hexes).folded_count
    return depths, ended, folded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--mesh", default="medium")
    parser.add_argument("--share", type=float, default=0.25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    run = partial(deepest_mm, arguments.mesh, arguments.share, arguments.seed)
    with ProcessPoolExecutor(arguments.processes) as pool:
        done = list(pool.map(run, range(arguments.count), chunksize=5))
    print(f"{arguments.count} postures, {arguments.mesh} mesh, up to {arguments.share:.0%} of the maximum forces")
    for bone, kind in done[0][0]:
        depth, most = np.array([one[0][bone, kind] for one in done]), DEEPEST_MM[kind][1]
        print(f"  {bone}, {kind}: deepest {depth.max():.2f} mm, above {most} mm in {int((depth > most).sum())}")
    print(
        f"  not finished: {sum(one[1] != 'finished' for one in done)}, with inverted elements: {sum(one[2] > 0 for one in done)}"
    )


if __name__ == "__main__":
    main()
