"""Random postures of the built-in tongue: how deep it goes into palate, jaw and pharynx.

    python studies/benchmarks/random_postures.py [--count 1000] [--mesh medium] [--share 0.25] [--seed 1]

Each muscle is active with probability 0.4, with a force that is uniform up to a share of its maximum; the jaw
opens by -4 to 12 mm. 200 ms, ramps of 50 ms. The depth is that beyond the depth at rest, the largest at any sample (every 20 ms).
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

ACTIVE_PROBABILITY = 0.4
JAW_MM = (-4.0, 12.0)
DEEPEST_MM = 0.3  # what counts as a crossing


@lru_cache(maxsize=1)
def mouth_of(mesh: str) -> Mouth:
    """The mouth of a resolution, once in each process."""
    return Mouth(mesh)


def deepest_mm(mesh: str, share: float, seed: int, number: int) -> tuple[dict[str, float], str, int]:
    """Bone -> largest depth of one posture; how its run ended; how many elements are inverted at the end."""
    mouth, generator = mouth_of(mesh), np.random.default_rng([seed, number])
    forces_N = {
        name: float(share * most * generator.random())
        for name, most in mouth.maxima_N.items()
        if generator.random() < ACTIVE_PROBABILITY
    }
    posture = Posture(forces_N, float(generator.uniform(*JAW_MM)))
    model = mouth.model(posture)
    transient = Transient(Simulation(model, threads=1), 1e-3 * posture.duration_ms)
    depth, ended = np.zeros(len(model.bones)), "finished"
    try:
        for sample in transient.samples(SAMPLE_EVERY_S):
            depth = np.maximum(depth, sample.contact[:, BONE_DEPTH])
    except RunError as error:
        ended = str(error)
    folded = certify(model.mesh.points + sample.displacement, model.mesh.hexes).folded_count
    return {bone.name: 1e3 * float(d) for bone, d in zip(model.bones, depth, strict=True)}, ended, folded


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
    for bone in done[0][0]:
        depth = np.array([one[0][bone] for one in done])
        print(f"  {bone}: deepest {depth.max():.2f} mm, above {DEEPEST_MM} mm in {int((depth > DEEPEST_MM).sum())}")
    print(
        f"  not finished: {sum(one[1] != 'finished' for one in done)}, with inverted elements: {sum(one[2] > 0 for one in done)}"
    )


if __name__ == "__main__":
    main()
