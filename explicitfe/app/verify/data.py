"""Claims on data: recovered constants, prediction of held-out tests, effects found in blind cases."""

from __future__ import annotations

import json

import numpy as np

from explicitfe.app.verify.claim import ClaimFigure, Workshop
from explicitfe.fem.effects import EFFECTS
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.inverse.close_loop.close import find_causes
from explicitfe.inverse.identify.fit import least_squares_fit
from explicitfe.inverse.identify.forward_models import ForwardModels
from explicitfe.inverse.identify.identify import identify_constants
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.select import select
from explicitfe.inverse.predict.setup import Setup, SpecimenKeys, ToolKeys
from explicitfe.platform.errors import RunError
from explicitfe.platform.host import shipped

# Constants [Pa] of Gérard et al. (2005), front of the tongue with its mucosa, for the simulated test.
CONSTANTS_PA = (190.0, 87.0)
LOADS_N = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
TOOL: ToolKeys = {"shape": "flat-cylinder", "radius_mm": 14.0, "edge_radius_mm": 1.0, "friction": 0.0}
# The data are computed on a quarter model with smaller elements than the sector model of the fit.
REFINEMENT_OF_DATA, REFINEMENT_OF_FIT = 1.25, 0.8
SPECIMEN: SpecimenKeys = {
    "symmetry": "quarter",
    "radius_mm": 35.0,
    "height_mm": 20.0,
    "base": "bonded",
    "refinement": REFINEMENT_OF_DATA,
}
DATASET = """format = "explicitfe-dataset/1"
name = "simulated"
title = "Simulated with known constants"
test = "indentation"
[specimen]
shape = "cylinder"
radius_mm = 35.0
height_mm = 20.0
base = "bonded"
[tool]
shape = "flat-cylinder"
radius_mm = 14.0
edge_radius_mm = 1.0
control = "force"
friction = 0.0
[noise]
force_sd_N = 0.002
displacement_sd_mm = 0.01
[[curve]]
id = "simulated"
file = "simulated.csv"
"""
SILICONE = "ecoflex-compression"
ALARMS = ("ambiguous", "unexplained")  # Verdicts that report a missing effect without naming it.


def constants_come_back(work: Workshop) -> ClaimFigure:
    """Larger one of the relative error of C10 and a quarter of the relative error of C20."""
    body = Setup(SPECIMEN, TOOL, 0.499, 1040.0).relaxation(*CONSTANTS_PA, tolerance=3e-5)
    rows = ["time_s,displacement_mm,force_N"]
    for number, load_N in enumerate(LOADS_N):
        reached = body.press(load_N)
        if not isinstance(reached, Equilibrium):
            raise RunError(f"the equilibrium at {load_N} N was not reached: {reached}")
        rows.append(f"{number},{1e3 * reached.displacement_m:.9g},{load_N}")
    folder = work.folder / "simulated"
    folder.mkdir()
    (folder / "simulated.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (folder / "dataset.toml").write_text(DATASET, encoding="utf-8")
    identification, _ = identify_constants(folder, refinement=REFINEMENT_OF_FIT)
    constants = identification["groups"]["all"]["constants"]
    values = [constants[name]["value"] for name in ("C10_Pa", "C20_Pa")]
    errors = [abs(value / wanted - 1.0) for value, wanted in zip(values, CONSTANTS_PA, strict=True)]
    return ClaimFigure(f"C10 {values[0]:.1f} Pa, C20 {values[1]:.1f} Pa", max(errors[0], errors[1] / 4.0))


def other_casting(_: Workshop) -> ClaimFigure:
    """Rms error of the predicted force of a held-out casting, relative to its maximum; largest value of all mixtures."""
    groups, _held_out = select(read_dataset(shipped.dataset_folder(SILICONE)).specimens("this claim needs"), ["sample=A"])
    models = ForwardModels(groups, 0.499, 1.0)
    errors: dict[str, float] = {}
    for group in groups:
        fit = least_squares_fit([models.observed(curve, group.rows[curve.id]) for curve in group.fitted], profile=False)
        shares = [models.observed(curve, group.rows[curve.id]).errors(fit.constants)["nrmse"] for curve in group.predicted]
        errors[group.name] = float(np.mean(shares))
    text = ", ".join(f"{name} {100.0 * share:.2f} %" for name, share in errors.items())
    return ClaimFigure(f"error of held-out castings: {text} of the largest force", max(errors.values()))


def sealed_cases(_: Workshop) -> ClaimFigure:
    """Number of shipped cases with a named cause that is not in the data, or without an answer.

    ``python -m studies.blind make`` drew them with the seed 20260, which was not used to develop the program.
    """
    folder = shipped.folder_of("scenarios") / "hidden-effects"
    hidden: dict[str, list[str]] = json.loads((folder / "effects.json").read_text(encoding="utf-8"))
    right = silent = wrong = 0
    for case, effects in hidden.items():
        report = find_causes(folder / case).report
        if report.verdict == "effect-found":
            named_right = {_cause(name) for name in report.effects} == {_cause(name) for name in effects}
            right += named_right
            wrong += not named_right
        else:
            silent += not effects and report.verdict == "no-missing-effect"
            wrong += report.verdict == "failed" or (not effects and report.verdict in ALARMS)
    controls = sum(not effects for effects in hidden.values())
    text = (
        f"{wrong} wrong of {len(hidden)}; no effect reported in {silent} of {controls} cases without one, "
        f"the right effect named in {right} of {len(hidden) - controls} cases with one"
    )
    return ClaimFigure(text, float(wrong))


def _cause(effect: str) -> str:
    """The usual form of the mechanism of an effect: relaxation by a power law is the same answer as by a Prony series."""
    return EFFECTS[effect].variant_of or effect
