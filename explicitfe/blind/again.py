"""A further test of the specimen of a blind case: the same truth under another programme, for studies of proposed tests."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np

from explicitfe.blind.case import Case, CaseCurve, NoiseStatement, Table, write
from explicitfe.blind.closed_forms import Bench
from explicitfe.blind.grid import Conditions, HomogeneousRun, Mode
from explicitfe.blind.homogeneous import POISSON_RATIO
from explicitfe.blind.homogeneous_case import COLUMNS, NOISE, PLATEN
from explicitfe.blind.noise import Noise
from explicitfe.blind.truth import Truth
from explicitfe.results.loop_report import NextExperiment

LENGTH_KEYS = ("radius_mm", "height_mm")


def measure_again(rng: np.random.Generator, truth: Truth, proposal: NextExperiment, folder: Path, name: str) -> None:
    """Write the dataset of a proposed test, made of the truth of a homogeneous case; it states what the case's dataset does.

    Parameters
    ----------
    proposal : the test, in the unit of the dataset.
    folder, name : where the dataset is written, and what its curves are called.
    """
    t, x = np.array(proposal.programme).T
    mode = cast(Mode, truth["mode"])
    platen = mode == "platen"
    stated = dict(proposal.specimen or {})
    size: dict[str, float] = {}
    if platen:
        lengths = {key: float(str(stated[key])) / _wrong(truth, key) for key in LENGTH_KEYS}
        size = {"height_m": 1e-3 * lengths["height_mm"], "area_m2": 1e-6 * np.pi * lengths["radius_mm"] ** 2}
    conditions: Conditions = {k: v for k, v in proposal.conditions.items() if isinstance(v, str | int | float)}
    run = HomogeneousRun(name, t, 1e-3 * x if platen else x, conditions, 0, None, **size)
    bench = Bench([run], mode, POISSON_RATIO)
    values = bench.values(truth["C10_Pa"], truth["C20_Pa"], truth["effects"] | truth["outside"])
    noise = Noise(*(truth["noise"][key] for key in ("level", "sd", "rho", "scale_sd", "offset_sd")))
    curves = []
    for number in range(proposal.repeats or 1):
        (measured,) = noise.add_to(rng, [values])
        curves.append(CaseCurve(f"{name}-{number + 1}", np.column_stack([t, x, measured]), None, None, conditions, {}))
    statement = NoiseStatement(truth["noise"]["stated"], truth["noise"]["repeats_stated"])
    specimen = cast(Table, stated)
    case = Case(
        title=str(proposal.protocol),
        test=truth["test"],
        columns=COLUMNS[mode],
        specimen=specimen or {"shape": "point"},
        tool=PLATEN if platen else None,
        noise=statement.table(noise, *NOISE[mode]),
        curves=curves,
        truth=truth,
    )
    write(case, folder, name)


def _wrong(truth: Truth, key: str) -> float:
    """The factor by which a dataset states a length wrongly."""
    wrong = truth["wrong"]
    return wrong["factor"] if wrong is not None and wrong["key"] == key else 1.0
