"""A further test of the specimen of a blind case: the same truth under another programme, for studies of proposed tests.

Whether further tests could show what is hidden is computed as a case's own identifiability is: with the generator's
numerics, from the truth, before a tool sees any of these tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from explicitfe.inverse.measured.curve import Curve, programme_of
from explicitfe.results.documents.loop_report import NextExperiment
from studies.blind.case import Case, CaseCurve, NoiseStatement, Table, write
from studies.blind.closed_forms import Bench
from studies.blind.foreign.closed import REMEMBER as FOREIGN_REMEMBER
from studies.blind.foreign.closed import ForeignBench
from studies.blind.foreign.homogeneous_cases import rivals_of
from studies.blind.grid import Conditions, HomogeneousRun, Mode
from studies.blind.homogeneous import POISSON_RATIO
from studies.blind.homogeneous_case import COLUMNS, NOISE, PLATEN
from studies.blind.identifiable import COARSE_INCREMENTS_PER_ROW, case_sizes, separation
from studies.blind.noise import Noise, Whitener
from studies.blind.truth import Truth

LENGTH_KEYS = ("radius_mm", "height_mm")
FOREIGN = "foreign"  # family of a sealed file
ROWS_TO_A_KEPT_ONE = 4  # Of the rows of a further test one in so many is computed, and counts so many times.


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
    conditions: Conditions = {k: v for k, v in proposal.conditions.items() if isinstance(v, str | int | float)}
    size = {key: float(str(stated[key])) for key in LENGTH_KEYS} if platen else None
    run = HomogeneousRun(name, t, 1e-3 * x if platen else x, conditions, 0, None, **_true_size(truth, size))
    values = _bench(truth, [run]).values(truth["C10_Pa"], truth["C20_Pa"], truth["effects"] | truth["outside"])
    noise = _noise(truth)
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


def distance_with(truth: Truth, curves: Sequence[Curve], tests: Sequence[Curve], repeats: float) -> float:
    """How far the truth stays from the law alone and from every rival, with further tests: the least squared distance.

    At 25 they can show what is hidden, as for the curves of a case by themselves.

    Parameters
    ----------
    curves, tests : those of the case's dataset that are fitted, and those that are made besides, as a dataset has them.
    repeats : of each test: its rows count so many times, which may be no whole number.
    """
    samples = [str(curve.conditions.get("sample", curve.id)) for curve in curves]  # cycles of one sample follow each other
    own = [_run(truth, curve, samples.index(sample)) for curve, sample in zip(curves, samples, strict=True)]
    further = [_run(truth, curve, len(own) + number, ROWS_TO_A_KEPT_ONE) for number, curve in enumerate(tests)]
    bench = _bench(truth, [*own, *further])
    constants = truth["C10_Pa"], truth["C20_Pa"]
    parts = COARSE_INCREMENTS_PER_ROW if set(FOREIGN_REMEMBER) & set(truth["effects"]) else None
    true = bench.values(*constants, truth["effects"], parts, recovers=False)
    values = bench.curves(true)
    whiten = Whitener(_noise(truth), values, [True] * len(values))
    counts = [1.0] * len(own) + [ROWS_TO_A_KEPT_ONE * repeats] * len(further)
    weights = np.sqrt(np.repeat(counts, [len(one) for one in values]))
    free = rivals_of(bench, case_sizes(bench, *constants, true), constants[0]) if isinstance(bench, ForeignBench) else None
    apart = separation(bench, true, lambda gap: weights * whiten(gap), constants, tuple(truth["effects"]), free)
    return min([apart.baseline, *apart.rivals.values()])


def _bench(truth: Truth, runs: Sequence[HomogeneousRun]) -> Bench | ForeignBench:
    mode = cast(Mode, truth["mode"])
    return ForeignBench(runs, mode) if truth.get("family") == FOREIGN else Bench(runs, mode, POISSON_RATIO)


def _run(truth: Truth, curve: Curve, test: int, thinned: int = 1) -> HomogeneousRun:
    """A curve of a dataset as the generator has it, in the test of this number; of its rows one in so many."""
    conditions: Conditions = {k: v for k, v in curve.conditions.items() if isinstance(v, str | int | float)}
    size = None if curve.specimen is None else {key: getattr(curve.specimen, key) for key in LENGTH_KEYS}
    return HomogeneousRun(
        curve.id, curve.time_s[::thinned], programme_of(curve)[::thinned], conditions, test, None, **_true_size(truth, size)
    )


def _true_size(truth: Truth, stated: dict[str, float] | None) -> dict[str, float]:
    """Height [m] and area [m^2] of a specimen between platens, by the lengths that its dataset states [mm]."""
    if truth["mode"] != "platen" or stated is None:
        return {}
    lengths = {key: stated[key] / _wrong(truth, key) for key in LENGTH_KEYS}
    return {"height_m": 1e-3 * lengths["height_mm"], "area_m2": 1e-6 * np.pi * lengths["radius_mm"] ** 2}


def _wrong(truth: Truth, key: str) -> float:
    """The factor by which a dataset states a length wrongly."""
    wrong = truth["wrong"]
    return wrong["factor"] if wrong is not None and wrong["key"] == key else 1.0


def _noise(truth: Truth) -> Noise:
    return Noise(*(truth["noise"][key] for key in ("level", "sd", "rho", "scale_sd", "offset_sd")))
