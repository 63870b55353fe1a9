"""Homogeneous tests: corners of the loading protocol, increments of time, and data of other programs at their true constants."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from outside_data import SHARED_DATA, needs
from support import block_mesh, model_of

from explicitfe.fem.effects import EFFECTS, Effect, with_leaves
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.inverse.close_loop.statistics.protocol import estimate_protocol
from explicitfe.inverse.measured.curve import Curve, programme_of, sd_of
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen
from explicitfe.inverse.predict.experiment import CurveAnswer
from explicitfe.inverse.predict.homogeneous import HomogeneousTest, predict_homogeneous
from explicitfe.platform.errors import RunError

pytestmark = pytest.mark.slow

OTHER_PROGRAMS = SHARED_DATA / "other-programs"
LAW = Yeoh(C10_Pa=300.0, C20_Pa=150.0, poisson=0.49999)
KNOTS_S = np.array([0.0, 1.037, 4.411, 5.5037, 8.0])
KNOTS = np.array([0.0, 0.3, 0.3, -0.1, 0.25])
EDGE_M = 0.01


def effect(name: str, **parameters) -> Effect:
    return EFFECTS[name](**parameters)


RELAXATION = effect("viscoelastic", g=(0.3, 0.2), tau_s=(0.2, 5.0))


def curve_of(time_s: np.ndarray, strain: np.ndarray, kind: str = "uniaxial") -> Curve:
    """A test without a tool; its stress is not measured."""
    columns = {"shear_strain": strain} if kind == "shear" else {"stretch": 1.0 + strain}
    columns["shear_stress_Pa" if kind == "shear" else "nominal_stress_Pa"] = np.zeros(len(time_s))
    return Curve(
        "c", "c.csv", kind, "all", "c", None, MeasuredSpecimen(shape="point"), None, MeasuredNoise(), {}, time_s, columns
    )


def answer_of(curve: Curve, law: Yeoh, effects: list[Effect]) -> CurveAnswer:
    ((answer,),) = predict_homogeneous([HomogeneousTest([curve], law, effects)])
    return answer


def stress(curve: Curve, law: Yeoh, effects: list[Effect]) -> np.ndarray:
    return answer_of(curve, law, effects).values


@pytest.mark.parametrize("kind", ["uniaxial", "shear"])
@pytest.mark.parametrize(
    "reading",
    [
        (),
        (effect("backlash", play_strain=0.02),),
        (effect("lag", lag_s=0.03),),
        (effect("contact-offset", offset_strain=0.01), effect("gauge-length", error=0.05)),
        (effect("stick-slip", drag_Pa=3.0, slip_distance_strain=0.05), effect("force-drift", rate_Pa_s=0.5)),
    ],
    ids=lambda reading: "+".join(type(e).__name__ for e in reading) or "none",
)
def test_a_corner_between_rows_acts_like_a_row(kind, reading):
    """The prediction is that of the same protocol with rows at its corners."""
    rows = np.linspace(0.0, 8.0, 81)
    everywhere = np.union1d(rows, KNOTS_S)
    effects = [RELAXATION, *reading]
    found = stress(curve_of(rows, np.interp(rows, KNOTS_S, KNOTS), kind), LAW, effects)
    given = stress(curve_of(everywhere, np.interp(everywhere, KNOTS_S, KNOTS), kind), LAW, effects)
    assert found == pytest.approx(given[np.searchsorted(everywhere, rows)], abs=1e-6 * np.abs(found).max())


def instants(time_s: np.ndarray, strain: np.ndarray) -> int:
    """Number of states of an elastic prediction: one for each row and each corner."""
    return answer_of(curve_of(time_s, strain), LAW, []).instants


def test_only_straight_parts_have_corners():
    time_s = np.linspace(0.0, 8.0, 201)
    polyline = np.interp(time_s, KNOTS_S, KNOTS)
    assert instants(time_s, polyline) == 201 + 3
    assert instants(time_s, np.round(polyline, 6)) == 201 + 3
    assert instants(time_s, polyline + np.random.default_rng(1).normal(0.0, 2e-4, 201)) == 201
    assert instants(time_s, 0.3 * np.sin(time_s) ** 2) == 201
    assert instants(time_s[:7], polyline[:7]) == 7


@pytest.mark.parametrize(
    "effects",
    [[RELAXATION], [RELAXATION, effect("softening", inverse_r=0.4, m_Pa=5.0, beta=0.15)]],
    ids=["relaxation", "relaxation+softening"],
)
def test_increments_are_extrapolated(effects, record_property):
    """Extrapolation leaves less than a third of what is left without it, which is a third of the last change."""
    rows = np.linspace(0.0, 8.0, 41)
    fine = np.union1d(np.linspace(0.0, 8.0, 40 * 128 + 1), KNOTS_S)

    def at_rows(time_s: np.ndarray) -> np.ndarray:
        time_s = np.union1d(time_s, KNOTS_S)
        return stress(curve_of(time_s, np.interp(time_s, KNOTS_S, KNOTS)), LAW, effects)[np.searchsorted(time_s, rows)]

    exact = at_rows(fine)
    error = np.abs(at_rows(rows) - exact).max() / np.abs(exact).max()
    record_property("error", error)
    assert error < 2e-3 / 9.0


# ---- many tests at once against one after the other, on an element of a body ----


def on_element(law: Yeoh, effects: list[Effect], time_s: np.ndarray, strain: np.ndarray, kind: str) -> np.ndarray:
    """Nominal stress [Pa] of a cube of one hex8 element, without free sides at the stretches that the point has found."""
    materials = with_leaves(effects)
    F = np.tile(np.eye(3), (len(strain), 1, 1))
    entry = (0, 2) if kind == "shear" else (2, 2)
    F[:, *entry] = strain
    _, F = point.path(law, materials, time_s, F, [] if kind == "shear" else [0, 1])
    mesh = block_mesh((1, 1, 1), EDGE_M, distort=0.0)
    body, stress = Simulation(model_of(mesh, law, effects=materials)), []
    for gradient, increment_s in zip(F, np.diff(time_s, prepend=time_s[0]), strict=True):
        body.set_increment(increment_s)
        force = body.internal_force(mesh.points @ (gradient - np.eye(3)).T)
        body.blocks.old[:] = body.blocks.new
        faces = [force[mesh.node_sets[name]].sum(axis=0) / EDGE_M**2 for name in ("x1", "y1", "z1")]
        stress.append([faces[2][entry[0]], *((faces[0][0], faces[1][1]) if kind != "shear" else ())])
    sides = np.array(stress)[:, 1:]
    assert np.abs(sides).max(initial=0.0) < 1e-8 * np.abs(stress).max()
    return np.array(stress)[:, 0]


def halved_on_element(law: Yeoh, effects: list[Effect], curve: Curve) -> np.ndarray:
    """The answer to one curve with its increments halved until the stress changes by less than 0.2 % of its peak."""
    rest, count = (0.0 if curve.kind == "shear" else 1.0), len(curve.time_s)
    answers = []
    for parts in (1, 2, 4, 8, 16, 32):
        times = np.interp(np.arange((count - 1) * parts + 1) / parts, np.arange(count), curve.time_s)
        imposed = np.interp(times, curve.time_s, programme_of(curve))
        assert imposed[0] == rest
        answers.append(on_element(law, effects, times, imposed, curve.kind)[::parts])
        if not any(effect.remembers for effect in effects):
            return answers[0]
        if parts > 1 and np.abs(answers[-1] - answers[-2]).max() <= 2e-3 * np.abs(answers[-1]).max():
            break
    return answers[-1] + (answers[-1] - answers[-2]) / 3.0


@pytest.mark.parametrize("kind", ["uniaxial", "shear"])
@pytest.mark.parametrize(
    "effects",
    [
        [],
        [effect("third-yeoh", C30_Pa=80.0)],
        [effect("viscoelastic", g=(0.3,), tau_s=(0.7,))],
        [RELAXATION, effect("nonlinear-relaxation", exponent=0.8)],
        [effect("fractional", g=0.6, alpha=0.4, tau_s=1.0)],
        [effect("softening", inverse_r=0.4, m_Pa=5.0, beta=0.15), effect("permanent-set", modulus_Pa=60.0)],
        [RELAXATION, effect("payne", modulus_Pa=80.0, yield_shear=0.05), effect("fibres", k1_Pa=100.0)],
    ],
    ids=lambda effects: "+".join(type(e).__name__ for e in effects) or "elastic",
)
def test_tests_together_answer_as_elements_do(kind, effects, record_property):
    """Three tests in one call, with two laws, against elements one after the other; rounding is amplified by the bulk modulus,
    17 000 times the shear modulus at this Poisson's ratio: 1e-9 of the largest stress.
    """
    courses = [(8.0, KNOTS), (2.0, -0.5 * KNOTS), (60.0, 1.2 * KNOTS)]
    curves = []
    for duration_s, knots in courses:
        time_s = np.union1d(np.linspace(0.0, duration_s, 25), duration_s / 8.0 * KNOTS_S)
        curves.append(curve_of(time_s, np.interp(time_s, duration_s / 8.0 * KNOTS_S, knots), kind))
    laws = [LAW, LAW, LAW.model_copy(update={"C10_Pa": 150.0})]
    together = predict_homogeneous([HomogeneousTest([one], law, effects) for one, law in zip(curves, laws, strict=True)])
    worst = 0.0
    for (answer,), curve, law in zip(together, curves, laws, strict=True):
        reference = halved_on_element(law, effects, curve)
        worst = max(worst, np.abs(answer.values - reference).max() / np.abs(reference).max())
    record_property("off by", worst)
    assert worst < 1e-9


def test_a_test_that_fails_leaves_the_others():
    """A stretch that no state of the law has is an error of its own test."""
    time_s = np.array([0.0, 1.0, 2.0])
    curves = [curve_of(time_s, np.array([0.0, strain, 0.0])) for strain in (0.2, -1.5, 0.3)]
    first, error, last = predict_homogeneous([HomogeneousTest([curve], LAW, [RELAXATION]) for curve in curves])
    assert isinstance(error, RunError) and "no state" in str(error)
    assert np.array_equal(first[0].values, stress(curves[0], LAW, [RELAXATION]))
    assert np.array_equal(last[0].values, stress(curves[2], LAW, [RELAXATION]))


def hidden_in(truth: dict) -> list[Effect]:
    """The material effects of a set, as its truth states them."""
    hidden = truth["parameters"]
    effects = []
    if "alpha" in hidden:
        effects.append(effect("fractional", g=1.0 - hidden["ginf"], alpha=hidden["alpha"], tau_s=hidden["tau_s"]))
    if "g" in hidden:
        effects.append(effect("viscoelastic", g=hidden["g"], tau_s=hidden["tau_s"]))
    if "r" in hidden:
        effects.append(effect("softening", inverse_r=1.0 / hidden["r"], m_Pa=hidden["m_Pa"], beta=hidden["beta"]))
    return effects


@needs(OTHER_PROGRAMS)
@pytest.mark.parametrize("case", ["case-08", "case-11", "case-12", "case-17", "case-32"])
def test_other_programs_at_their_true_constants(case, record_property):
    """Nothing but noise is left of homogeneous sets of other programs: chi2 is the number of rows, to four standard deviations.

    The model is driven by the estimated protocol, because the noise of the imposed rows did not act on the specimen: it would
    raise the largest past strain, on which softening depends.
    """
    truth = json.loads((OTHER_PROGRAMS / "truth.json").read_text(encoding="utf-8"))[case]
    law = Yeoh(C10_Pa=truth["C10_Pa"], C20_Pa=truth["C20_Pa"], poisson=0.49999)
    chi2, rows = 0.0, 0
    for curve in read_dataset(OTHER_PROGRAMS / case).curves:
        protocol = estimate_protocol(curve.time_s, programme_of(curve), sd_of(curve, curve.imposed), curve.conditions)
        time_s = np.union1d(curve.time_s, protocol.time_s)
        columns = {curve.imposed: protocol.at(time_s), curve.predicted: np.zeros(len(time_s))}
        driven = replace(curve, time_s=time_s, columns={name: columns[name] for name in curve.columns})
        left = curve.columns[curve.predicted] - stress(driven, law, hidden_in(truth))[np.searchsorted(time_s, curve.time_s)]
        chi2 += float(np.sum((left / sd_of(curve, curve.predicted)) ** 2))
        rows += len(left)
    record_property("chi2 / rows", chi2 / rows)
    assert abs(chi2 - rows) < 4.0 * np.sqrt(2.0 * rows)
