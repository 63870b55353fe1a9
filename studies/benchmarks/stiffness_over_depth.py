"""Verdicts of close-loop on a gradient, a layer and an inclusion at five strengths each, in data of the blind study's solver.

    python studies/benchmarks/stiffness_over_depth.py [--only layer] [--processes 2] [--keep FOLDER]

A specimen of 20 mm is pressed with flat tools of 14 and 8 mm, three times each, to a fifth of its height and back; the noise is
0.3 % of the largest force and 0.002 mm. A row of the table is one dataset. It needs scikit-fem, and minutes for a dataset.
Gradients, 26 November 2026, one core (two runs at a time on two cores):

| hidden | verdict | best set of causes | probability | found | held-out error, % | s |
|---|---|---|---|---|---|---|
| gradient -0.6 | effect-found | stiffness-gradient | 0.89 | -0.566 | 1.50 -> 0.49 | 171 |
| gradient -0.3 | ambiguous | nothing | 0.62 | | 0.89 -> 0.89 | 128 |
| gradient 0.15 | no-missing-effect | nothing | 0.92 | | 0.79 -> 0.79 | 159 |
| gradient 0.4 | effect-found | stiffness-gradient | 0.89 | 0.365 | 1.27 -> 0.61 | 146 |
| gradient 0.75 | effect-found | stiffness-gradient | 0.94 | 0.758 | 2.50 -> 0.65 | 154 |

Layers and inclusions, the same day, one core that was shared, with derivatives over 1 % instead of 3 %:

| hidden | verdict | best set of causes | probability | s |
|---|---|---|---|---|
| layer 0.25 | ambiguous | edge | 0.68 | 157 |
| layer 0.6 | no-missing-effect | nothing | 0.93 | 60 |
| layer 1.6 | no-missing-effect | nothing | 0.95 | 80 |
| layer 3 | no-missing-effect | nothing | 0.96 | 86 |
| layer 6 | ambiguous | nothing | 0.70 | 55 |
| inclusion 0.1 | effect-found | stiffness-gradient | 0.95 | 200 |
| inclusion 0.4 | effect-found | stiffness-gradient | 0.83 | 156 |
| inclusion 2.5 | ambiguous | base-slip | 0.53 | 176 |
| inclusion 6 | effect-found | base-slip (wrong) | 0.92 | 125 |
| inclusion 20 | effect-found | three causes by estimates (mended since) | 0.37 | 157 |

A base that slips fits the inclusion of ratio 6 to the noise (chi2 92 of 100 rows): these two tools do not tell them apart.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from explicitfe import close_loop
from studies.blind.foreign.axisymmetric import RoundSpecimen
from studies.blind.foreign.contact import RigidTool
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.tool_tests import ElasticCurve

SPECIMEN = RoundSpecimen(35.0, 20.0)
TOOL_RADII_MM, EDGE_MM, DEPTH_MM, REPEATS, ROWS = (14.0, 8.0), 1.0, 4.0, 3, 13
FORCE_SD_SHARE, DISPLACEMENT_SD_MM = 0.003, 0.002
LAYER_MM, INCLUSION_RADIUS_MM, INCLUSION_DEPTH_MM = 2.0, 5.0, 8.0
C10_PA, C20_PA = 190.0, 90.0
FINENESS, MINUTES = 0.6, 2.5
HEAD = ("hidden", "verdict", "best set of causes", "probability", "model", "held-out error, %", "s")


def in_a_sphere(ratio: float, r: np.ndarray, z: np.ndarray, height_mm: float) -> np.ndarray:
    """The factor of the moduli of a sphere on the axis."""
    return np.where(r**2 + (height_mm - INCLUSION_DEPTH_MM - z) ** 2 < INCLUSION_RADIUS_MM**2, ratio, 1.0)


tissue = partial(HiddenTissue, C10_PA, C20_PA)
HIDDEN: dict[str, tuple[tuple[float, ...], Callable[[float], HiddenTissue]]] = {
    "stiffness-gradient": ((-0.6, -0.3, 0.15, 0.4, 0.75), lambda g: tissue(gradient=g)),
    "layer": ((0.25, 0.6, 1.6, 3.0, 6.0), lambda ratio: tissue(layer=(LAYER_MM, ratio))),
    "inclusion": ((0.1, 0.4, 2.5, 6.0, 20.0), lambda ratio: tissue(factor=partial(in_a_sphere, ratio))),
}


def write_dataset(folder: Path, hidden: HiddenTissue, rng: np.random.Generator) -> None:
    """One dataset with noise."""
    folder.mkdir(parents=True)
    forces = {}
    depths = DEPTH_MM * np.concatenate([np.linspace(0.0, 1.0, ROWS), np.linspace(1.0, 0.0, ROWS)[1:]])
    for radius in TOOL_RADII_MM:
        curve = ElasticCurve(SPECIMEN, RigidTool("flat-cylinder", radius, EDGE_MM), hidden, DEPTH_MM, FINENESS)
        forces[radius] = curve.force(depths)
    sd = FORCE_SD_SHARE * max(float(force.max()) for force in forces.values())
    text = f"""format = "explicitfe-dataset/1"
name = "{folder.name}"
title = "Two flat tools, loading and unloading"
test = "indentation"
source = "simulated by an independent solver"

[specimen]
shape = "cylinder"
radius_mm = {SPECIMEN.radius_mm}
height_mm = {SPECIMEN.height_mm}
base = "bonded"

[tool]
shape = "flat-cylinder"
radius_mm = {TOOL_RADII_MM[0]}
edge_radius_mm = {EDGE_MM}
control = "displacement"
friction = 0.0

[noise]
force_sd_N = {sd:.3g}
displacement_sd_mm = {DISPLACEMENT_SD_MM}
"""
    for radius, force in forces.items():
        for repeat in range(1, REPEATS + 1):
            name = f"r{radius:g}-{repeat}"
            columns = np.column_stack([2.0 * np.arange(len(depths)), depths, force])
            columns[:, 1] += DISPLACEMENT_SD_MM * rng.standard_normal(len(depths))
            columns[:, 2] += sd * rng.standard_normal(len(depths))
            head = "time_s,displacement_mm,force_N"
            np.savetxt(folder / f"{name}.csv", columns, "%.6g", ",", header=head, comments="")
            text += f'\n[[curve]]\nid = "{name}"\nfile = "{name}.csv"\ntool = {{ radius_mm = {radius} }}\n'
            text += f"conditions = {{ repeat = {repeat} }}\n"
    (folder / "dataset.toml").write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=sorted(HIDDEN), help="one effect")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the datasets")
    options = parser.parse_args()
    print(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        for name, (strengths, tissue_of) in HIDDEN.items():
            for number, strength in enumerate(strengths if options.only in (None, name) else ()):
                folder = (options.keep or Path(temporary)) / f"{name}-{number + 1}"
                if not folder.exists():
                    write_dataset(folder, tissue_of(strength), np.random.default_rng(number))
                begin = time.perf_counter()
                report = close_loop(folder, minutes=MINUTES, processes=options.processes)
                seconds = time.perf_counter() - begin
                best = max(report.posterior.items(), key=lambda entry: entry[1], default=("-", 0.0))
                parameters = report.document["final"]["parameters"].items()
                values = ", ".join(f"{key} {one.get('all', one)['value']:.3g}" for key, one in parameters)
                missed = [model.error.holdout for model in (report.baseline, report.final)]
                error = " -> ".join("-" if one is None else f"{100.0 * (one.nrmse or 0.0):.2f}" for one in missed)
                cells = (f"{name} {strength:g}", report.verdict, best[0], f"{best[1]:.2f}", values, error, f"{seconds:.0f}")
                print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
