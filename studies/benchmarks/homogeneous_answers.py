"""CPU time of one answer to three tests without a tool, of 300 rows each, as close-loop asks for it.

    python studies/benchmarks/homogeneous_answers.py [--answers FILE]

Each answer has other constants, so that none is kept from before. --answers writes the answers, to compare those of two versions.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.close_loop.statistics.system import Hypothesis
from explicitfe.inverse.measured.curve import Curve, SpecimenDataset
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen

ROWS, REPEATS = 300, 25
TESTS = {"short": (10.0, 0.4), "pressed": (100.0, -0.3), "long": (1000.0, 0.5)}  # duration [s], largest strain
SINGLES = ("viscoelastic", "softening", "permanent-set", "third-yeoh", "fractional", "compliance")
MODELS = ((), *((name,) for name in SINGLES), ("viscoelastic", "softening"))


def curve_of(name: str, duration_s: float, strain: float) -> Curve:
    """Loading, hold, unloading and hold; the stress is that of the neo-Hooke law, so that a fit can begin there."""
    time_s = np.linspace(0.0, duration_s, ROWS)
    stretch = 1.0 + strain * np.interp(time_s / duration_s, [0.0, 0.3, 0.6, 0.9], [0.0, 1.0, 1.0, 0.2])
    columns = {"stretch": stretch, "nominal_stress_Pa": 400.0 * (stretch - stretch**-2.0)}
    noise = MeasuredNoise(stress_sd_Pa=1.0)
    return Curve(name, "", "uniaxial", "all", name, None, MeasuredSpecimen(shape="point"), None, noise, {}, time_s, columns)


def specimens() -> Specimens:
    curves = tuple(curve_of(name, *test) for name, test in TESTS.items())
    about = {"name": "answers", "title": "", "test": "tension", "source": "", "license": "", "notes": "", "path": Path("answers")}
    return Specimens(SpecimenDataset(**about, curves=curves), curves, Simulator(1))


def model_of(system: Specimens, effects: tuple[str, ...]) -> Hypothesis:
    """The start with the middle trial of each effect."""
    start = system.start()
    candidates = {one.effect: one for one in system.candidates(start)}
    model = start
    for name in effects:
        trials = candidates[name].trials
        model = model.plus(candidates[name].term, trials[len(trials) // 2])
    return model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--answers", type=Path, help="write the answers to this .npz file")
    options = parser.parse_args()
    answers = {}
    for effects in MODELS:
        system = specimens()
        model, times = model_of(system, effects), []
        (first,) = system.answers([model])
        for k in range(REPEATS):
            begin = time.process_time()
            system.answers([model.shifted(0, 1e-3 * (k + 1))])
            times.append(time.process_time() - begin)
        name = " + ".join(effects) or "elastic"
        answers[name] = np.concatenate(first)
        print(f"{name:<26} {1e3 * np.median(times):6.2f} ms an answer of {len(TESTS) * ROWS} rows")
    if options.answers:
        np.savez(options.answers, **answers)


if __name__ == "__main__":
    main()
