"""Identification of the constants of Gerard et al. (2005) from indentations that other numerics made.

    python studies/benchmarks/identify_table1.py [--out FILE] [--seeds 100]

Four pairs: front and rear of the tongue, with and without its mucosa. The data come from a quarter of the specimen with another
mesh, element order and tolerance than the sector that is fitted.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from explicitfe.app.api.inverse import identify
from explicitfe.inverse.identify.fit import NAMES, Fit, Problem, least_squares_fit
from explicitfe.inverse.identify.forward import FIRST_Q, CurveModel, ToolResponse, depths, ratio, smoothest
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.identify.paper import PaperFit, by_simulator, first_guess, identify_by_paper
from explicitfe.inverse.predict.setup import Setup

PAIRS = {
    "front, mucosa on": (190.0, 87.0),
    "rear, mucosa on": (199.0, 89.0),
    "rear, mucosa off": (193.0, 92.0),
    "front, mucosa off": (184.0, 95.0),
}
LOADS_N = 0.1 * np.arange(1, 9)
FORCE_SD_N, DISPLACEMENT_SD_M = 0.002, 10e-6
BODY = {"radius_mm": 35.0, "height_mm": 20.0, "base": "bonded"}
TOOL = {"shape": "flat-cylinder", "radius_mm": 14.0, "edge_radius_mm": 1.0, "friction": 0.0}
DATA_SETUP = Setup(BODY | {"symmetry": "quarter", "refinement": 2.0}, TOOL, 0.499, 1040.0)
FIT_SETUP = Setup(BODY | {"symmetry": "sector", "refinement": 1.5}, TOOL, 0.499, 1040.0)
MADE_TOLERANCE = 1e-5
DEEPEST_M = 6.6e-3

DATASET = """format = "explicitfe-dataset/1"
name = "made"
title = "Made by the simulator with a quarter mesh"
test = "indentation"
specimen = {{ shape = "cylinder", radius_mm = 35.0, height_mm = 20.0, base = "bonded" }}
tool = {{ shape = "flat-cylinder", radius_mm = 14.0, edge_radius_mm = 1.0, control = "force", friction = 0.0 }}
noise = {{ force_sd_N = {force}, displacement_sd_mm = {displacement} }}

[[curve]]
id = "loading"
file = "loading.csv"
"""


def made_data(constants: tuple[float, float]) -> np.ndarray:
    """Displacements [m] at all loads, smoothed over the loads: contact on a mesh is rough, a specimen is not."""
    depths_m = depths(DEEPEST_M, 16)
    body = DATA_SETUP.relaxation(*constants, tolerance=MADE_TOLERANCE)
    run = np.array([body.move(float(depth)).force_N for depth in depths_m])
    smooth = smoothest(depths_m, [run])
    return smooth.inverse(smooth.coefficients(depths_m, run)[0], LOADS_N)[0]


def noisy(exact_m: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Loads with noise, and the displacements at the true loads, with noise too."""
    rng = np.random.default_rng([2026, seed])
    loads = LOADS_N + FORCE_SD_N * rng.standard_normal(len(LOADS_N))
    return loads, exact_m + DISPLACEMENT_SD_M * rng.standard_normal(len(LOADS_N))


def observed(loads_N: np.ndarray, measured_m: np.ndarray, response: ToolResponse) -> Observed:
    return Observed("made", loads_N, measured_m, FORCE_SD_N, DISPLACEMENT_SD_M, CurveModel(response, True))


def fisher_sd(truth: tuple[float, float], response: ToolResponse) -> np.ndarray:
    """Standard errors that data with this noise can give at best (2,) [Pa]."""
    seen = observed(LOADS_N, response.at_force(LOADS_N, *truth)[0], response)
    J = Problem([seen], [seen.sd(truth)]).jacobian(np.array(truth))
    return np.sqrt(np.diag(np.linalg.inv(J.T @ J)))


def covers(limits: tuple[float, float], value: float) -> bool:
    return limits[0] <= value <= limits[1]


def largest(fit: PaperFit, measured_m: np.ndarray) -> str:
    errors = np.abs(fit.errors_m)
    return f"{1e6 * errors.max():.0f} µm, {100.0 * (errors / measured_m).max():.2f} %"


def timed(exact_m: np.ndarray) -> tuple[float, dict]:
    """Seconds of one identification through the public function, and its result."""
    loads, measured = noisy(exact_m, 0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "made"
        folder.mkdir()
        text = DATASET.format(force=FORCE_SD_N, displacement=1e3 * DISPLACEMENT_SD_M)
        (folder / "dataset.toml").write_text(text, encoding="utf-8")
        rows = "".join(f"{k},{1e3 * d:.9g},{f:.9g}\n" for k, (d, f) in enumerate(zip(measured, loads, strict=True)))
        (folder / "loading.csv").write_text(f"time_s,displacement_mm,force_N\n{rows}", encoding="utf-8")
        begin = time.perf_counter()
        result = identify(folder, out=Path(name) / "out")
        return time.perf_counter() - begin, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seeds", type=int, default=100)
    options = parser.parse_args()
    response = ToolResponse(FIT_SETUP, 7.3e-3)
    response.add([*FIRST_Q, 0.2, 0.25, 0.325, 0.36, 0.4])
    exact = {name: made_data(truth) for name, truth in PAIRS.items()}
    paper_rows, fit_rows = [], []
    for name, truth in PAIRS.items():
        loads, measured = LOADS_N, exact[name]
        paper = identify_by_paper(by_simulator(FIT_SETUP, loads), measured, first_guess(FIT_SETUP, loads[0], measured[0]))
        fits: list[Fit] = []
        passed = converged = 0
        for seed in range(options.seeds):
            loads, measured_noisy = noisy(measured, seed)
            again = identify_by_paper(
                lambda C10, C20, loads=loads: response.at_force(loads, C10, C20)[0],
                measured_noisy,
                first_guess(FIT_SETUP, loads[0], measured_noisy[0]),
            )
            converged += again.status == "converged"
            passed += again.status == "converged" and bool(again.within.all())
            fits.append(least_squares_fit([observed(loads, measured_noisy, response)]))
        paper_rows.append(
            f"| {name} | {truth[0]:g} / {truth[1]:g} | {paper.constants[0]:.1f} / {paper.constants[1]:.1f} | {paper.status}, "
            f"{len(paper.trace)} | {largest(paper, measured)} | {int(paper.within.sum())} of {len(LOADS_N)} "
            f"| {passed} of {options.seeds} |"
        )
        exact_fit = least_squares_fit([observed(LOADS_N, measured, response)])
        best = fisher_sd(truth, response)
        for k, key in enumerate(NAMES):
            half = np.median([0.5 * (f.profile[key][1] - f.profile[key][0]) for f in fits]) / (1.96 * best[k])
            values = np.array([f.constants[k] for f in fits])
            fit_rows.append(
                f"| {name} | {key.removesuffix('_Pa')} | {truth[k]:g} | {exact_fit.constants[k]:.1f} | "
                f"{values.mean():.1f} ± {values.std(ddof=1):.2f} | {best[k]:.2f} | "
                f"{sum(covers(f.curvature[key], truth[k]) for f in fits)} | "
                f"{sum(covers(f.profile[key], truth[k]) for f in fits)} | {half:.3f} |"
            )
        print(paper_rows[-1], *fit_rows[-2:], sep="\n", flush=True)
    seconds, result = timed(next(iter(exact.values())))
    lines = [
        "| specimen | C10 / C20 (Pa) | paper's method | status, runs | largest error | points within | with noise, all within |",
        "|---|---|---|---|---|---|---|",
        *paper_rows,
        "",
        f"| specimen | constant | true (Pa) | from exact data | mean ± sd of {options.seeds} | sd at best (Fisher) | "
        "covered, curvature | covered, profile | half width / Fisher's |",
        "|---|---|---|---|---|---|---|---|---|",
        *fit_rows,
        "",
        f"One identification with pictures and the table of what it hides: {result['forward_runs']} forward runs, "
        f"{seconds:.0f} s. "
        f"Numerical noise of the response: {100.0 * response.roughness:.2f} % of the force. "
        f"Ratios of the response: {', '.join(f'{q:.3g}' for q in response.ratios)}; of the pairs: "
        f"{', '.join(f'{ratio(*pair):.3f}' for pair in PAIRS.values())}.",
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
