"""A coarse answer under a tool, corrected by ramps to what a fine mesh answers."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from explicitfe.effects import Effect
from explicitfe.effects.material.viscoelastic import Viscoelastic
from explicitfe.measured.curve import Curve
from explicitfe.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool
from explicitfe.predict.correction import (
    MESH_ORDER,
    MESH_RATIO,
    RIPPLE_IN_MEMORY,
    RIPPLE_ORDER,
    Correction,
    Mesh,
    Run,
    _correction,
    _extrapolated,
    _ladder,
    corrections_of,
    ramp_of,
)
from explicitfe.predict.predict import predict_test
from explicitfe.predict.tissue import EVERY, Constants, Numerics, Tissue, parse_tissue

COARSE = Numerics(refinement=0.4, density=1.0, tolerance=5e-4, finer=0.9)
FINE = Numerics(refinement=1.3, density=1.0, tolerance=2e-4)
RADIUS_MM, DEPTH_MM = 8.0, 2.4
# Down in 4 s, 10 s of waiting, back in 4 s.
TIME_S = np.concatenate([np.linspace(0.0, 4.0, 17), np.linspace(5.0, 14.0, 10), np.linspace(14.5, 17.0, 6)])
WAY_MM = np.interp(TIME_S, [0.0, 4.0, 14.0, 18.0], [0.0, DEPTH_MM, DEPTH_MM, 0.0])


def curve(edge_mm: float = 1.0) -> Curve:
    """A flat cylinder on a specimen of 8 mm."""
    tool = MeasuredTool(shape="flat-cylinder", radius_mm=RADIUS_MM, edge_radius_mm=edge_mm, control="displacement", friction=0.0)
    specimen = MeasuredSpecimen(shape="cylinder", radius_mm=20.0, height_mm=8.0, base="bonded", density_kg_m3=1040.0)
    known = {"displacement_m": 1e-3 * WAY_MM, "force_N": np.linspace(0.0, 0.3, len(TIME_S))}
    return Curve("one", "one.csv", "force-displacement", EVERY, "one", None, specimen, tool, MeasuredNoise(), {}, TIME_S, known)


def tissue(numerics: Numerics, *effects: Effect, C20_Pa: float = 80.0) -> Tissue:
    made = Tissue(constants={EVERY: Constants(C10_Pa=200.0, C20_Pa=C20_Pa)}, numerics=numerics)
    for effect in effects:
        made = made.with_effect(effect)
    return made


def run(jobs) -> list[Run]:
    return [[answer.values for answer in predict_test(test, parse_tissue(text))] for test, text in jobs]


def answer(test: Curve, of: Tissue, correction: Correction | None = None) -> np.ndarray:
    (only,) = predict_test((test,), of, corrections={} if correction is None else {test.id: correction})
    return only.values


@cache
def corrected(effects: tuple[Effect, ...] = (), edge_mm: float = 1.0) -> Correction:
    return corrections_of(tissue(COARSE, *effects), [curve(edge_mm)], run)["one"]


PRONY = Viscoelastic(g=(0.4,), tau_s=(3.0,))


@pytest.mark.slow
def test_a_ramp_corrects_any_course():
    """One ramp on fine meshes corrects the way in, a wait and the way out, at other constants too."""
    test = curve()
    fine = answer(test, tissue(FINE, C20_Pa=120.0))
    coarse = answer(test, tissue(COARSE, C20_Pa=120.0))
    better = answer(test, tissue(COARSE, C20_Pa=120.0), corrected())
    before, after = (float(np.sqrt(np.mean((y - fine) ** 2))) / fine.max() for y in (coarse, better))
    assert before > 0.015 and after < 0.4 * before, (before, after)


@pytest.mark.slow
def test_a_sharp_edge_is_extrapolated():
    """The force is linear in a small rounding, so that the last half of it takes as much as the first.

    A projection that is weighted by the answers keeps the mean that is weighted by their squares.
    """
    ramp = ramp_of(curve(0.0), [curve(0.0)], ())
    ladder = _ladder(ramp, tissue(COARSE))
    answers = dict(zip(ladder, (values for (values,) in run(list(ladder.values()))), strict=True))
    fine, rounder = answers["fine"][1:], answers["rounder"][1:]
    sharp = _correction(ramp, answers, COARSE, remembers=False)
    rounded = _correction(ramp, {name: answers[name] for name in ("usual", "fine", "between")}, COARSE, remembers=False)
    change = np.average((fine - rounder) / fine, weights=fine**2)
    assert change > 0.005
    assert np.average(sharp.factor / rounded.factor - 1.0, weights=fine**2) == pytest.approx(change, rel=1e-9)
    assert "the sharp edge" in sharp.errors and "the sharp edge" not in rounded.errors


@pytest.mark.slow
def test_the_error_of_a_correction():
    """It is a small part of what is corrected; the ripple that a tissue remembers counts only where one remembers."""
    correction, remembering = corrected(), corrected((PRONY,))
    bound = np.sqrt(sum(column**2 for column in correction.errors.values()))
    assert 0.0 < np.median(bound) < 0.25 * np.median(np.abs(correction.factor - 1.0))
    assert set(remembering.errors) - set(correction.errors) == {RIPPLE_IN_MEMORY}
    assert np.array_equal(remembering.factor, correction.factor)
    assert corrections_of(tissue(Numerics(refinement=0.4)), [curve()], run) == {}


@pytest.mark.slow
def test_what_a_tissue_remembers_of_the_ripple_is_followed():
    """The coarse mesh's ripple of earlier depths stays in the memory, while the factor of the depth of now undoes all of it at
    once. The history on a finer mesh knows better, at another strength of the memory too.
    """
    test, other = curve(), Viscoelastic(g=(0.35,), tau_s=(3.5,))
    fine, coarse = (answer(test, tissue(numerics, other)) for numerics in (FINE, COARSE))
    correction = corrected((PRONY,))
    pressed = fine > 0.3 * fine.max()
    by_depth, by_history = (
        correction.applied(coarse, 1e-3 * WAY_MM, False, followed)[pressed] / fine[pressed] - 1.0 for followed in ((), (test,))
    )
    assert np.sqrt(np.mean(by_history**2)) < 0.5 * np.sqrt(np.mean(by_depth**2)), (by_history, by_depth)
    assert correction.remembered["one"][TIME_S < 0.1] == pytest.approx(1.0) and not corrected().remembered


# ---- the extrapolation of several meshes ----

SHARE = np.arange(1, 49) / 48.0
# Sizes of the elements over those of the finest mesh, density of instants, and ripple of the logarithm on the finest mesh.
MESHES = ((1.0, 1.5), (1.5, 1.5), (2.5, 1.0))
RIPPLE = 4e-4


def exact_level(share: np.ndarray) -> np.ndarray:
    """Logarithm of a compliance that falls by a third over the ramp."""
    return -0.2 * share - 0.15 * share**2


def ramps(seed: int, ripple: float) -> list[Mesh]:
    """Three meshes with an error of the assumed order and a ripple that is independent between instants."""
    random = np.random.default_rng(seed)
    made = []
    for size, density in MESHES:
        instants = np.linspace(0.0, 1.0, round(16 * density) + 1)
        noise = np.interp(SHARE, instants, random.normal(size=len(instants))) * ripple * size**RIPPLE_ORDER / SHARE
        made.append(Mesh(size, density, exact_level(SHARE) + (2e-3 + 1e-3 * SHARE) * size**MESH_ORDER + noise))
    return made


def test_meshes_without_ripple_are_extrapolated_exactly():
    fit = _extrapolated(SHARE, ramps(0, 0.0), SHARE * np.exp(exact_level(SHARE)))
    assert fit.level == pytest.approx(exact_level(SHARE), abs=1e-12)
    assert -fit.step == pytest.approx(2e-3 + 1e-3 * SHARE, abs=1e-12)


def test_the_stated_error_of_an_extrapolation_is_a_standard_deviation():
    """Over 200 draws the mean square error over the stated variance is 1 within what interpolation between instants changes.

    The mean of squares at four loads of 200 draws has a standard deviation of at most sqrt(2 / 200) = 0.1; interpolated noise has
    between 2/3 and 1 of the variance of that at instants.
    """
    rows = np.array([11, 23, 35, 47])
    squares = []
    for seed in range(200):
        fit = _extrapolated(SHARE, ramps(seed, RIPPLE), SHARE * np.exp(exact_level(SHARE)))
        variance = np.sum(fit.modes**2, axis=1)
        squares.append(((fit.level - exact_level(SHARE)) ** 2 / variance)[rows])
    assert 2.0 / 3.0 - 0.2 < np.mean(squares) < 1.0 / (2.0 / 3.0) + 0.2, np.mean(squares, axis=0)


def test_smooth_ramps_have_less_error_than_a_single_mesh():
    """The ripple at a row of the finest mesh is reduced by the fit of all rows: fewer unknowns than instants."""
    off, raw = [], []
    for seed in range(50):
        made = ramps(seed, RIPPLE)
        fit = _extrapolated(SHARE, made, SHARE * np.exp(exact_level(SHARE)))
        off.append(SHARE * (fit.level - exact_level(SHARE)))
        finest, coarser = made[0].rows, made[1].rows
        raw.append(SHARE * (finest + (finest - coarser) / (MESH_RATIO**MESH_ORDER - 1.0) - exact_level(SHARE)))
    assert np.std(off) < 0.5 * np.std(raw)
