"""The identification of Gerard et al. (Med. Eng. Phys. 2005), section 2: one constant after the other, by force steps.

C10 is scaled by u1 / U1, computed over measured displacement at the smallest load, until they agree; then C20 is changed once for
the largest load; and so on until that agrees too. Every step is a run of the simulator at all loads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.predict.setup import Setup
from explicitfe.platform.errors import InputError, RunError

# The smallest and the largest load are met within these. A forward run is converged to 1e-4 of its forces and smooth to 1e-3 of
# its displacements: 1 and 6 micrometres of the paper's 1.1 and 6.2 mm. Closer agreement would be agreement with the mesh.
ALPHA_M = 5e-6
BETA_M = 10e-6
MOST_RUNS = 60  # The iteration is given up after so many runs.
MOST_FORCE_STEPS = 100  # A curve with more rows is a record in time.
# A point agrees within the larger of this share of its displacement and this distance.
AGREEMENT_SHARE = 0.015
AGREEMENT_M = 80e-6
C20_CHANGE_FACTOR = 3.0  # C20 does not change by a larger factor at once.

Displacements = Callable[[float, float], np.ndarray]


@dataclass(frozen=True)
class PaperRound:
    """One forward run: the constants, which of them was changed, and the displacements at all loads (k,) m."""

    C10_Pa: float
    C20_Pa: float
    changed: str
    displacement_m: np.ndarray


@dataclass(frozen=True)
class PaperFit:
    """Where the method ended.

    Attributes
    ----------
    status : "converged", "bound" (C20 = 0 and still too stiff) or "not-converged".
    trace : all forward runs.
    errors_m : computed - measured at all loads (k,).
    within : whether each point lies within the larger of 1.5 % and 80 micrometres.
    """

    status: str
    trace: tuple[PaperRound, ...]
    errors_m: np.ndarray
    within: np.ndarray

    @property
    def constants(self) -> np.ndarray:
        return np.array([self.trace[-1].C10_Pa, self.trace[-1].C20_Pa])


def force_steps(curves: tuple[Curve, ...], rows: dict[str, int]) -> tuple[np.ndarray, np.ndarray]:
    """Loads (k,) N, and the displacements that were measured there (k,) m, averaged over the curves.

    Raises
    ------
    InputError : the curves were not measured by force steps.
    """
    advice = 'the paper\'s method needs force steps (control = "force", one row a load); take `method` least-squares.'
    loads: list[np.ndarray] = []
    depths: list[np.ndarray] = []
    for curve in curves:
        if curve.tool is None or curve.tool.control != "force":
            raise InputError(f'curve "{curve.id}": {advice}')
        count = rows[curve.id]
        load, depth = curve.force_N[:count], curve.displacement_m[:count]
        load, depth = load[load > 0.0], depth[load > 0.0]
        if len(load) > MOST_FORCE_STEPS or len(load) < 2 or (np.diff(load) <= 0.0).any():
            raise InputError(f'curve "{curve.id}" is a record in time or its loads do not rise: {advice}')
        loads.append(load)
        depths.append(depth)
    if any(len(load) != len(loads[0]) or not np.allclose(load, loads[0], rtol=1e-3) for load in loads[1:]):
        raise InputError("the curves have different loads: the paper's method needs the same ones; choose curves by `fit`.")
    measured = np.mean(depths, axis=0)
    if measured[0] <= 0.0:
        raise InputError(f"the displacement at the smallest load is {1e3 * measured[0]:g} mm; the paper's method scales by it.")
    return np.mean(loads, axis=0), measured


def by_simulator(setup: Setup, loads_N: np.ndarray) -> Displacements:
    """The forward model: one run of the simulator gives the displacements at all loads."""

    def displacements(C10_Pa: float, C20_Pa: float) -> np.ndarray:
        body = setup.relaxation(C10_Pa, C20_Pa)
        answers = []
        for load in loads_N:
            reached = body.press(float(load))
            if not isinstance(reached, Equilibrium):
                raise RunError(
                    f"the forward model does not reach {load:g} N (C10 {C10_Pa:.4g} Pa, C20 {C20_Pa:.4g} Pa): "
                    "the tissue gives way; check the specimen's size and the unit of the force."
                )
            answers.append(reached.displacement_m)
        return np.array(answers)

    return displacements


def first_guess(setup: Setup, load_N: float, depth_m: float) -> tuple[float, float]:
    """Constants by which a half space, or a bar between platens, answers so: a thin bonded specimen of them would be stiffer."""
    radius = 1e-3 * setup.tool.get("radius_mm", 0.0)
    if setup.tool["shape"] == "platen":
        C10 = load_N * setup.height_mm * 1e-3 / (6.0 * setup.area_mm2 * 1e-6 * depth_m)
    else:
        touching = np.sqrt(radius * depth_m) if setup.tool["shape"] == "sphere" else radius
        C10 = load_N * (1.0 - setup.poisson**2) / (12.0 * touching * depth_m)
    return float(C10), 0.25 * float(C10)


def identify_by_paper(
    displacements: Displacements,
    measured_m: np.ndarray,
    start: tuple[float, float],
    *,
    alpha_m: float = ALPHA_M,
    beta_m: float = BETA_M,
    progress: Callable[[int], None] = lambda runs: None,
) -> PaperFit:
    """Change one constant after the other until both loads are met.

    Parameters
    ----------
    displacements : forward model, (C10, C20) -> (k,) m.
    measured_m : (k,) at the same loads.
    alpha_m, beta_m : how close the smallest and the largest load have to be met.
    """
    trace: list[PaperRound] = []

    def run(C10: float, C20: float, changed: str) -> np.ndarray:
        trace.append(PaperRound(C10, C20, changed, displacements(C10, C20)))
        progress(len(trace))
        return trace[-1].displacement_m

    def result(status: str) -> PaperFit:
        errors = trace[-1].displacement_m - measured_m
        within = np.abs(errors) <= np.maximum(AGREEMENT_SHARE * np.abs(measured_m), AGREEMENT_M)
        return PaperFit(status, tuple(trace), errors, within)

    C10, C20 = start
    u = run(C10, C20, "start")
    # C20 is too small at low and too large at high, as far as these are known; last is (C20, misfit at the largest load).
    low, high, last = 0.0, np.inf, None
    while True:
        while abs(u[0] - measured_m[0]) >= alpha_m:
            if len(trace) >= MOST_RUNS:
                return result("not-converged")
            C10 *= float(np.clip(u[0] / measured_m[0], 0.2, 5.0))
            u = run(C10, C20, "C10")
        miss = float(u[-1] - measured_m[-1])
        if abs(miss) < beta_m:
            return result("converged")
        if C20 == 0.0 and miss < 0.0:
            return result("bound")
        if len(trace) >= MOST_RUNS or high - low <= 1e-9 * C10:
            return result("not-converged")
        low, high = (max(low, C20), high) if miss > 0.0 else (low, min(high, C20))
        step = None if last is None or last[1] == miss else C20 - miss * (C20 - last[0]) / (miss - last[1])
        last = (C20, miss)
        if step is None:
            step = C20 * float(u[-1] / measured_m[-1]) ** 2
        step = float(np.clip(step, C20 / C20_CHANGE_FACTOR if low > 0.0 else 0.0, C20_CHANGE_FACTOR * max(C20, 0.05 * C10)))
        if not low < step < high:
            step = 0.5 * (low + high) if np.isfinite(high) else C20_CHANGE_FACTOR * max(C20, 0.05 * C10)
        if step < 1e-4 * C10:
            step = 0.0
        C20 = step
        u = run(C10, C20, "C20")
