"""Error of the depths that a search computes for a tissue with an effect under a flat tool, against the axisymmetric solver.

    python studies/benchmarks/forward_error.py [--only NAME ...] [--references FILE] [--convergence]

A cylinder of radius 35 mm with a bonded base under a flat cylinder of radius 14 mm with an edge of 1 mm, force 0.05 to 0.8 N,
without friction; C10 200, C20 100 Pa. The simulator runs as a search does: ramps on the mesh of ``CORRECTED``, corrected by the
ladder of ramps for the same tissue. The reference is the implicit solver of the blind study, with another element and another
contact. Its contact is a penalty of finite stiffness, which makes it too deep by an amount that is inversely proportional to the
penalty: two penalties are extrapolated to a rigid contact. Both programs have the same Poisson's ratio, 0.499 where the tissue is
not compressible.

The table gives the largest and the root mean square difference over 31 forces, the standard deviation that the correction states
for itself, and the differences with the quadratic volumetric energy of the reference replaced by that of the laws (s = 1).
References take about a minute a case and are kept in FILE. ``--convergence`` computes them on a finer mesh as well.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.interpolate import CubicSpline

from explicitfe.fem.effects import Effect
from explicitfe.fem.effects.material.compressible import Compressible
from explicitfe.fem.effects.specimen.base_slip import BaseSlip
from explicitfe.fem.effects.specimen.layer import Layer
from explicitfe.fem.effects.specimen.stiffness_gradient import StiffnessGradient
from explicitfe.inverse.close_loop.specimens.plan import plan_of
from explicitfe.inverse.close_loop.specimens.specimens import CORRECTED, MESH_POISSON_RATIO
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool
from explicitfe.inverse.predict.correction import Correction, Job, Run, corrections_of
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import EVERY, Constants, Tissue
from studies.blind.foreign import axisymmetric
from studies.blind.foreign.axisymmetric import Drive, Press, RoundSpecimen
from studies.blind.foreign.contact import RigidTool
from studies.blind.foreign.law import HiddenTissue

C10_PA, C20_PA = 200.0, 100.0
RADIUS_MM, TOOL_MM, EDGE_MM = 35.0, 14.0, 1.0
NOISE_MM = 0.01
FORCE_N = np.linspace(0.05, 0.8, 31)
# Forces of the reference: the depth is smooth in the force, and a spline between them is right to 0.2 micrometres.
REFERENCE_N = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
# Elements of the reference's edge per rounding, and penalties over the shear modulus of the surface [1/mm].
EDGE_ELEMENTS, FINER_EDGE_ELEMENTS = 6.4, 9.6
PENALTIES = (500.0, 1000.0)
FIRST_DEPTH_MM = 0.02


@dataclass(frozen=True)
class Case:
    """A tissue with an effect: for the simulator, and as keys of the reference's tissue."""

    name: str
    effects: tuple[Effect, ...] = ()
    hidden: dict[str, object] = field(default_factory=dict)
    height_mm: float = 20.0


def compressible(poisson: float, height_mm: float = 20.0) -> Case:
    effect = Compressible(poisson=poisson, volume_stiffening=0.0)
    return Case(f"compressible {poisson:g}, {height_mm:g} mm", (effect,), {"poisson": poisson}, height_mm)


def gradient(g: float, height_mm: float = 20.0) -> Case:
    return Case(f"gradient {g:+g}, {height_mm:g} mm", (StiffnessGradient(g=g),), {"gradient": g}, height_mm)


def layer(ratio: float) -> Case:
    return Case(f"layer of 3 mm, x {ratio:g}", (Layer(thickness_mm=3.0, ratio=ratio),), {"layer": (3.0, ratio)})


def slip(give: float) -> Case:
    return Case(f"base slip {give:g} mm/kPa", (BaseSlip(compliance_mm_kPa=give),), {"base_compliance_mm_kPa": give})


CASES = (
    compressible(0.45),
    Case("nothing, 20 mm"),
    gradient(0.774),
    layer(0.4),
    compressible(0.40),
    slip(10.0),
    compressible(0.48),
    layer(4.0),
    gradient(0.5),
    gradient(-0.5),
    compressible(0.45, 30.0),
    Case("nothing, 30 mm", height_mm=30.0),
    gradient(0.774, 30.0),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="*", default=[], help="cases whose name contains one of these")
    parser.add_argument("--references", type=Path, help="file that keeps the depths of the reference")
    parser.add_argument("--convergence", action="store_true", help="compute references on a finer mesh too")
    arguments = parser.parse_args()
    kept = json.loads(arguments.references.read_text()) if arguments.references and arguments.references.exists() else {}
    print("| case | largest, um | root mean square, um | stated sd, um | s = 1: largest, um | s | reference's mesh, um |")
    print("|---|---|---|---|---|---|---|")
    for case in CASES:
        if arguments.only and not any(word in case.name for word in arguments.only):
            continue
        for elements in (EDGE_ELEMENTS, FINER_EDGE_ELEMENTS)[: 1 + arguments.convergence]:
            key = f"{case.name} {elements:g}"
            if key not in kept:
                kept[key] = list(reference(case, elements))
            if arguments.references:
                arguments.references.write_text(json.dumps(kept, indent=1))
        print(row(case, *(kept.get(f"{case.name} {n:g}") for n in (EDGE_ELEMENTS, FINER_EDGE_ELEMENTS))), flush=True)


def row(case: Case, depths: Sequence[float] | None, finer: Sequence[float] | None) -> str:
    """One line of the table."""
    assert depths is not None
    wanted = _line(depths)(FORCE_N)
    begin = time.perf_counter()
    found, sd = depths_of(case.effects, case.height_mm)
    seconds = time.perf_counter() - begin
    off = 1e3 * (found - wanted)
    usual = "-"
    if "poisson" in case.hidden:
        (effect,) = case.effects
        other, _ = depths_of((effect.model_copy(update={"volume_stiffening": 1.0}),), case.height_mm)
        usual = f"{1e3 * np.abs(other - wanted).max():.1f}"
    mesh = "-" if finer is None else f"{1e3 * np.abs(_line(finer)(FORCE_N) - wanted).max():.2f}"
    stated = f"{1e3 * sd.max():.1f}"
    name, root = case.name, np.sqrt(np.mean(off**2))
    return f"| {name} | {np.abs(off).max():.2f} | {root:.2f} | {stated} | {usual} | {seconds:.1f} | {mesh} |"


def _line(depths: Sequence[float]) -> CubicSpline:
    return CubicSpline(np.concatenate([[0.0], REFERENCE_N]), np.concatenate([[0.0], depths]))


def reference(case: Case, edge_elements: float) -> np.ndarray:
    """Depths [mm] at ``REFERENCE_N`` under a tool that nothing penetrates."""
    hidden = HiddenTissue(C10_PA, C20_PA, **{"poisson": MESH_POISSON_RATIO, **case.hidden})
    soft, stiff = (_pressed(case.height_mm, hidden, edge_elements, penalty) for penalty in PENALTIES)
    ratio = PENALTIES[1] / PENALTIES[0]
    return (ratio * stiff - soft) / (ratio - 1.0)


def _pressed(height_mm: float, hidden: HiddenTissue, edge_elements: float, penalty: float) -> np.ndarray:
    axisymmetric.EDGE_ELEMENTS_PER_ROUNDING = edge_elements
    press = Press(RoundSpecimen(RADIUS_MM, height_mm), RigidTool("flat-cylinder", TOOL_MM, EDGE_MM), hidden)
    # The simulator multiplies all moduli of a place by one factor, the reference those of the shape only.
    stiffer = press.material.moduli[0] / (1e-6 * C10_PA)
    surface = float(hidden.moduli_factor(np.zeros(1), np.array([height_mm]), height_mm)[0])
    press.penalty *= surface * penalty / axisymmetric.PENALTY_OVER_MODULUS
    press.mass = np.einsum("eqi,eqj,eq->eij", press.Np, press.Np, press.weight / stiffer)
    press.mass_inverse = np.linalg.inv(press.mass)
    press.advance(0.0, Drive(True, FIRST_DEPTH_MM))  # Without contact a force has no equilibrium to start from.
    return np.array([press.advance(0.0, Drive(False, float(force)))[0] for force in REFERENCE_N])


def curve_of(height_mm: float) -> Curve:
    """The test, with forces as they are imposed."""
    specimen = MeasuredSpecimen(shape="cylinder", radius_mm=RADIUS_MM, height_mm=height_mm, base="bonded", density_kg_m3=1040.0)
    tool = MeasuredTool(shape="flat-cylinder", radius_mm=TOOL_MM, edge_radius_mm=EDGE_MM, control="force", friction=0.0)
    columns = {"displacement_m": 6e-3 * FORCE_N / FORCE_N[-1], "force_N": FORCE_N}
    noise = MeasuredNoise(force_sd_N=0.002, displacement_sd_mm=NOISE_MM)
    return Curve("one", "one.csv", "force-displacement", EVERY, "one", None, specimen, tool, noise, {}, FORCE_N.copy(), columns)


def depths_of(effects: Sequence[Effect], height_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [mm] at ``FORCE_N`` as a search computes them, and their stated standard deviation [mm]."""
    tissue = Tissue(poisson=MESH_POISSON_RATIO, constants={EVERY: Constants(C10_Pa=C10_PA, C20_Pa=C20_PA)}, numerics=CORRECTED)
    for effect in effects:
        tissue = tissue.with_effect(effect)
    curve = curve_of(height_mm)
    corrections = corrections_of(tissue, [curve], run)
    plan = plan_of(tissue, (curve,), [curve], False)
    (answer,) = run([plan.job])
    assert not isinstance(answer, str)
    depth = plan.read(answer, corrections)[curve.id]
    return 1e3 * depth, 1e3 * stated_sd(corrections[curve.id], depth)


def stated_sd(correction: Correction, depth_m: np.ndarray) -> np.ndarray:
    """Standard deviation [m] of corrected depths by all errors that a correction states."""
    shares = [correction.error_of(name, depth_m, FORCE_N, True) for name in correction.errors]
    return depth_m * np.sqrt(np.sum(np.square(shares), axis=0))


def run(jobs: list[Job]) -> list[Run]:
    """Compute tests one after the other."""
    return [[answer.values for answer in predict_test(test, tissue)] for test, tissue in jobs]


if __name__ == "__main__":
    main()
