"""How a case of homogeneous tests is put together from what was drawn for it: the dataset as it states itself, and the truth.

No physics stands here, so that generators that share none can share it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from studies.blind.case import Case, CaseCurve, CaseRequest, NoiseStatement, Table
from studies.blind.grid import Parameters
from studies.blind.identifiable import Separation
from studies.blind.noise import Noise
from studies.blind.protocols import Protocol
from studies.blind.truth import Truth, WrongLength, common_truth

COLUMNS = {
    "uniaxial": ("stretch", "nominal_stress_Pa"),
    "shear": ("shear_strain", "shear_stress_Pa"),
    "platen": ("displacement_mm", "force_N"),
}
# Keys for the noise of the predicted column and of the imposed one.
NOISE = {
    "uniaxial": ("stress_sd_Pa", "stretch_sd"),
    "shear": ("stress_sd_Pa", None),
    "platen": ("force_sd_N", "displacement_sd_mm"),
}
PLATEN: Table = {"shape": "platen", "control": "displacement", "friction": 0.0}


class StatedSpecimen(NamedTuple):
    """The table [specimen] as the dataset states it, the stated height, and which length is wrong, if any."""

    table: Table
    height_mm: float
    wrong: WrongLength | None


class CaseReadings(NamedTuple):
    """What was measured, and what the dataset states of it.

    Attributes
    ----------
    curves : the predicted column of each curve (k,), with noise.
    group : the specimen of all curves, where the dataset names one.
    """

    curves: list[np.ndarray]
    noise: Noise
    statement: NoiseStatement
    specimen: StatedSpecimen
    group: str | None


def draw_group(rng: np.random.Generator, noise: Noise) -> str | None:
    """Whether the dataset says that all curves are of one specimen; not where they scatter."""
    return "specimen-1" if noise.scale_sd == 0.0 and rng.random() < 0.5 else None


def homogeneous_case(
    request: CaseRequest,
    protocol: Protocol,
    constants: tuple[float, float],
    effects: Mapping[str, Parameters],
    readings: CaseReadings,
    distances: Separation | None,
) -> Case:
    """The case of a test.

    Parameters
    ----------
    constants : the true C10 and C20 [Pa].
    effects : the hidden ones, or the law that is not in the library.
    distances : the separations; None for a control.
    """
    noise, statement, specimen = readings.noise, readings.statement, readings.specimen
    truth: Truth = {
        **common_truth(request.kind, request.subjects[0], effects, constants, statement.truth(noise), distances),
        "protocol": protocol.name,
        "mode": protocol.mode,
        "test": protocol.test,
        "holdout": any(curve.split == "holdout" for curve in protocol.plan),
        "rows": {curve.id: len(curve.time_s) for curve in protocol.plan},
        "wrong": specimen.wrong,
    }
    return Case(
        title=protocol.title,
        test=protocol.test,
        columns=COLUMNS[protocol.mode],
        specimen=specimen.table,
        tool=PLATEN if protocol.mode == "platen" else None,
        noise=statement.table(noise, *NOISE[protocol.mode]),
        curves=[_curve_of(protocol, k, values, specimen, readings.group) for k, values in enumerate(readings.curves)],
        truth=truth,
    )


def specimen_of(rng: np.random.Generator, protocol: Protocol, request: CaseRequest) -> StatedSpecimen:
    if protocol.radius_mm is None:
        return StatedSpecimen({"shape": "point"}, np.nan, None)
    heights = [1e3 * curve.height_m for curve in protocol.plan]
    lengths = {"radius_mm": protocol.radius_mm, "height_mm": round(heights[0], 6)}
    assumed: Table = {}
    wrong: WrongLength | None = None
    if request.subjects == ("wrong-dimension",):
        key = str(rng.choice(["radius_mm", "height_mm"]))
        factor = 1.0 + float(rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.10))
        lengths[key] = round(lengths[key] * factor, 3)
        wrong = {"key": key, "factor": factor}
        assumed = {"assumed": [key]}
    elif rng.random() < 0.3:
        assumed = {"assumed": [str(rng.choice(["radius_mm", "height_mm"]))]}
    return StatedSpecimen({"shape": "cylinder", **lengths, **assumed, "base": "frictionless"}, lengths["height_mm"], wrong)


def _curve_of(protocol: Protocol, number: int, values: np.ndarray, specimen: StatedSpecimen, group: str | None) -> CaseCurve:
    curve, first = protocol.plan[number], protocol.plan[0]
    if sum(other.test == curve.test for other in protocol.plan) > 1:
        group = f"specimen-{curve.test + 1}"
    own: dict[str, Table] = {}
    if curve.height_m != first.height_m:  # a length that is stated wrongly is wrong by the same factor everywhere
        own = {"specimen": {"height_mm": round(specimen.height_mm * curve.height_m / first.height_m, 4)}}
    imposed = 1e3 * curve.imposed if protocol.mode == "platen" else curve.imposed
    rows = np.column_stack([curve.time_s, imposed, values])
    return CaseCurve(curve.id, rows, group, curve.split, curve.conditions, own)
