"""What a fit hides: full refits of exact data that were made with one assumption broken, beside the table that `identify` gives.

    python studies/benchmarks/what_a_fit_hides.py [--out FILE]

The constants are those of Gerard et al. (2005), 191.5 and 90.6 Pa; a flat cylinder presses a specimen of 35 x 20 mm.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from explicitfe.inverse.identify.assumptions import Alternative, what_a_fit_hides
from explicitfe.inverse.identify.fit import Fit, least_squares_fit
from explicitfe.inverse.identify.forward import FIRST_Q, CurveModel, ToolResponse, depths, forces, ratio, smoothest
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.predict.setup import Setup
from explicitfe.platform.errors import RunError

TRUTH = (191.5, 90.6)
LOADS_N = 0.1 * np.arange(1, 9)
DEEPEST_M = 7.1e-3
REFINEMENT = 1.5
SD_M = 10e-6
BASE_SETUP = Setup(
    {"symmetry": "sector", "radius_mm": 35.0, "height_mm": 20.0, "base": "bonded", "refinement": REFINEMENT},
    {"shape": "flat-cylinder", "radius_mm": 14.0, "edge_radius_mm": 1.0, "friction": 0.0},
    0.499,
    1040.0,
)


def changed(body: dict[str, Any] | None = None, hand: dict[str, Any] | None = None, **more: Any) -> Setup:
    return replace(BASE_SETUP, specimen=BASE_SETUP.specimen | (body or {}), tool=BASE_SETUP.tool | (hand or {}), **more)


CASES = [
    Alternative("sticking contact", changed(hand={"friction": "stick"})),
    Alternative("a surface layer of 1 mm, 3 times as stiff", changed({"layer_mm": 1.0, "layer_stiffness_ratio": 3.0})),
    Alternative("Poisson's ratio 0.49", changed(poisson=0.49)),
    Alternative("a specimen of 25 x 30 mm", changed({"radius_mm": 25.0, "height_mm": 30.0})),
    Alternative("an edge rounded by 0.5 mm", changed(hand={"edge_radius_mm": 0.5})),
    Alternative("gravity", changed({"gravity_m_s2": [0.0, 0.0, -9.81]})),
]


def response(setup: Setup, constants: tuple[float, float]) -> ToolResponse:
    """The response of the tool near these constants, good enough to refit them."""
    tool_response = ToolResponse(setup, DEEPEST_M)
    tool_response.add([*FIRST_Q, ratio(*constants), 0.15])
    return tool_response


def displacements(setup: Setup) -> np.ndarray:
    """Exact data, smoothed, as the roughness of contact on a mesh is not physics."""
    deepest = 1.3 * DEEPEST_M
    while True:
        try:
            depths_m = depths(deepest, 20)
            run = forces(setup, TRUTH, depths_m)
            break
        except RunError:  # A soft tissue does not reach the largest depth, and does not need it.
            deepest *= 0.93
    smooth = smoothest(depths_m, [run])
    return smooth.inverse(smooth.coefficients(depths_m, run)[0], LOADS_N)[0]


def refit(model: CurveModel, measured_m: np.ndarray) -> tuple[Fit, np.ndarray]:
    observed = Observed("made", LOADS_N, measured_m, 0.0, SD_M, model)
    fit = least_squares_fit([observed], profile=False)
    return fit, 1e6 * (observed.predicted(fit.constants) - measured_m)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    base = response(BASE_SETUP, TRUTH)
    truth_m = base.at_force(LOADS_N, *TRUTH)[0]
    observed = Observed("paper", LOADS_N, truth_m, 0.0, SD_M, CurveModel(base, True))
    fit = least_squares_fit([observed], profile=False)
    hidden, _ = what_a_fit_hides(BASE_SETUP, [observed], fit, CASES)
    lines = [
        "| wrong | data with it, fitted without: C10, C20 | left (rms, max) | data without it, fitted with: C10, C20 | left "
        "(rms, max) | `identify` says | left (rms) |",
        "|---|---|---|---|---|---|---|",
    ]
    for case, shift in zip(CASES, hidden, strict=True):
        without, left_without = refit(CurveModel(base, True), displacements(case.setup))
        row = [case.name, _factors(without), _left(left_without)]
        if case.name == "gravity":  # With gravity the size of the constants is no mere scale.
            row += ["", ""]
        else:
            guess = (TRUTH[0] * (1.0 + float(shift.change[0])), max(TRUTH[1] * (1.0 + float(shift.change[1])), 0.0))
            corrected, left_made = refit(CurveModel(response(case.setup, guess), True), truth_m)
            row += [_factors(corrected), _left(left_made)]
        row += [f"× {1.0 + shift.change[0]:.2f}, × {1.0 + shift.change[1]:.2f}", f"{1e6 * shift.left:.1f} µm"]
        lines.append(f"| {' | '.join(row)} |")
        print(lines[-1], flush=True)
    text = "\n".join(lines) + "\n"
    print(text)
    if out is not None:
        out.write_text(text, encoding="utf-8")


def _factors(fit: Fit) -> str:
    return f"× {fit.constants[0] / TRUTH[0]:.2f}, × {fit.constants[1] / TRUTH[1]:.2f}"


def _left(micrometres: np.ndarray) -> str:
    return f"{np.sqrt(np.mean(micrometres**2)):.1f}, {np.abs(micrometres).max():.1f} µm"


if __name__ == "__main__":
    main()
