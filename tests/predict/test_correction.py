"""A coarse answer under a tool, corrected by ramps to what a fine mesh answers."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from explicitfe.fem.effects import Effect
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool
from explicitfe.inverse.predict.correction import Correction, Run, _correction, _ladder, corrections_of, ramp_of, smoothed
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import EVERY, Constants, Numerics, Tissue

COARSE = Numerics(section=0.4, finer=1.2)
FINE = Numerics(section=1.8)
RADIUS_MM, DEPTH_MM = 8.0, 2.4
# Down in 4 s, 10 s of waiting, back in 4 s.
TIME_S = np.concatenate([np.linspace(0.0, 4.0, 17), np.linspace(5.0, 14.0, 10), np.linspace(14.5, 17.0, 6)])
WAY_MM = np.interp(TIME_S, [0.0, 4.0, 14.0, 18.0], [0.0, DEPTH_MM, DEPTH_MM, 0.0])


def curve(edge_mm: float = 1.0, *, block: bool = False) -> Curve:
    """A flat cylinder on a specimen of 8 mm."""
    tool = MeasuredTool(shape="flat-cylinder", radius_mm=RADIUS_MM, edge_radius_mm=edge_mm, control="displacement", friction=0.0)
    if block:
        specimen = MeasuredSpecimen(shape="block", size_mm=(32.0, 32.0, 8.0), base="bonded", density_kg_m3=1040.0)
    else:
        specimen = MeasuredSpecimen(shape="cylinder", radius_mm=20.0, height_mm=8.0, base="bonded", density_kg_m3=1040.0)
    known = {"displacement_m": 1e-3 * WAY_MM, "force_N": np.linspace(0.0, 0.3, len(TIME_S))}
    return Curve("one", "one.csv", "force-displacement", EVERY, "one", None, specimen, tool, MeasuredNoise(), {}, TIME_S, known)


def tissue(numerics: Numerics, *effects: Effect, C20_Pa: float = 80.0) -> Tissue:
    made = Tissue(constants={EVERY: Constants(C10_Pa=200.0, C20_Pa=C20_Pa)}, numerics=numerics)
    for effect in effects:
        made = made.with_effect(effect)
    return made


def run(jobs) -> list[Run]:
    return [[answer.values for answer in predict_test(test, tissue)] for test, tissue in jobs]


def answer(test: Curve, of: Tissue, correction: Correction | None = None) -> np.ndarray:
    (only,) = predict_test((test,), of, corrections={} if correction is None else {test.id: correction})
    return only.values


@cache
def corrected(effects: tuple[Effect, ...] = (), edge_mm: float = 1.0) -> Correction:
    return corrections_of(tissue(COARSE, *effects), [curve(edge_mm)], run)["one"]


PRONY = Viscoelastic(g=(0.4,), tau_s=(3.0,))


def errors(coarse: Numerics, correction: Correction, *effects: Effect) -> tuple[float, float]:
    """Rms error of a run with and without a correction, as shares of the largest force; constants are not those of the ramps."""
    fine, usual = (answer(curve(), tissue(n, *effects, C20_Pa=120.0)) for n in (FINE, coarse))
    better = answer(curve(), tissue(coarse, *effects, C20_Pa=120.0), correction)
    before, after = (float(np.sqrt(np.mean((y - fine) ** 2))) / fine.max() for y in (usual, better))
    return before, after


@pytest.mark.slow
def test_a_ramp_corrects_any_course():
    """One ramp on a fine mesh serves the way in, a wait and the way out, at other constants and with a memory too.

    The section is right to 0.1 % by itself, so that its error is ripple, which no ramp removes: the correction must not add to it
    more than the ripple of the ramps, which is as large.
    """
    for effects in ((), (PRONY,)):
        before, after = errors(COARSE, corrected(), *effects)
        assert max(before, after) < 2e-3, (before, after)


@pytest.mark.slow
def test_hexahedra_are_corrected_by_the_section():
    """What a leaning tool needs is computed with hexahedra, 3 % too stiff, and corrected by the section without it."""
    hexahedra = Numerics(refinement=0.5, density=1.0, tolerance=5e-4, finer=1.2)
    correction = corrections_of(tissue(hexahedra), [curve()], run)["one"]
    before, after = errors(hexahedra, correction)
    assert before > 0.01 and after < 0.4 * before, (before, after)


@pytest.mark.slow
def test_a_block_is_corrected_to_its_own_shape():
    """The usual run is that of a cylinder of the same face, the ramps are those of the block."""
    test = curve(block=True)
    correction = corrections_of(tissue(COARSE), [test], run)["one"]
    block = answer(test, tissue(Numerics(refinement=1.0, tolerance=2e-4)))
    corrected_answer = answer(test, tissue(COARSE), correction)
    assert np.sqrt(np.mean((corrected_answer - block) ** 2)) < 0.02 * block.max()


@pytest.mark.slow
def test_a_sharp_edge_is_extrapolated():
    """The force is linear in a small rounding, so that the last half of it takes as much as the first."""
    ramp = ramp_of(curve(0.0), [curve(0.0)], ())
    ladder = _ladder(ramp, tissue(COARSE))
    answers = dict(zip(ladder, (values for (values,) in run(list(ladder.values()))), strict=True))
    fine, rounder = answers["fine"][1:], answers["rounder"][1:]
    sharp = _correction(ramp, answers)
    rounded = _correction(ramp, {name: answers[name] for name in ("usual", "fine", "between")})
    change = np.average((fine - rounder) / fine, weights=fine**2)
    assert change > 0.005
    assert np.average(sharp.factor / rounded.factor - 1.0, weights=fine**2) == pytest.approx(change, rel=1e-6)
    assert "the sharp edge" in sharp.errors and "the sharp edge" not in rounded.errors


def test_without_a_finer_mesh_nothing_is_corrected():
    assert corrections_of(tissue(Numerics(refinement=0.4)), [curve()], run) == {}


def test_a_ramp_without_ripple():
    """A smooth ramp stays as it is to 1e-4, and a ripple of the mesh loses most of its size."""
    load = np.linspace(0.0, 0.5, 49)
    exact = 4e-3 * load**0.9
    ripple = 1e-2 * exact * np.sin(200.0 * load)  # sixteen periods
    assert smoothed(exact, load) == pytest.approx(exact, abs=1e-4 * exact.max())
    assert np.std(smoothed(exact + ripple, load) - exact) < 0.3 * np.std(ripple)
