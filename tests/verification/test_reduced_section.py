"""Reduced sections under a tool, against the full section."""

from __future__ import annotations

import numpy as np
import pytest

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.reduced.cubature import sparse_shares
from explicitfe.fem.reduced.estimate import estimate
from explicitfe.fem.reduced.section import ReducedSection
from explicitfe.fem.reduced.snapshots import Programme
from explicitfe.fem.solve.revolution import Revolution, ToolState
from explicitfe.platform.errors import InputError

LAW = Yeoh(C10_Pa=200.0, C20_Pa=100.0, poisson=0.499)
SPECIMEN = SpecimenTable(radius_mm=35.0, height_mm=20.0, base="bonded", material=LAW)
PUNCH = ToolTable(shape="flat-cylinder", radius_mm=14.0, edge_radius_mm=1.0)
FINENESS, DEEPEST_M = 0.4, 4e-3
RAMP_M = 1.03 * DEEPEST_M * np.linspace(0.0, 1.0, 26)[1:] ** 1.5
# A ramp, a hold, half way back, a hold, and down again; at first in short steps, because the full section divides long ones.
TIME_S = 40.0 * np.linspace(0.0, 1.0, 61)[1:] ** 1.5
COURSE_M = DEEPEST_M * np.interp(TIME_S, [0.0, 4.0, 14.0, 17.0, 27.0, 32.0, 40.0], [0.0, 0.75, 0.75, 0.35, 0.35, 1.0, 1.0])


def viscoelastic(share: float) -> tuple[Effect, ...]:
    return (EFFECTS["viscoelastic"](g=(share,), tau_s=(4.0,)),)


def law(C10: float, C20: float) -> Yeoh:
    return LAW.model_copy(update={"C10_Pa": C10, "C20_Pa": C20})


def programmes(*effects: Effect) -> list[Programme]:
    """Elastic ramps that span the ratio of the constants, and a run with effects."""
    runs = [Programme(law(200.0, C20), (), np.zeros(len(RAMP_M)), RAMP_M) for C20 in (25.0, 100.0, 400.0)]
    return [*runs, Programme(LAW, effects, TIME_S, COURSE_M)] if effects else runs


def full(
    tissue: Yeoh, effects: tuple[Effect, ...], time_s: np.ndarray, imposed: np.ndarray, by_force: bool = False
) -> np.ndarray:
    """Forces [N] or displacements [m] of the full section."""
    body = Revolution(SPECIMEN, PUNCH, tissue, effects, FINENESS)
    body.settle()
    answers = []
    for at_s, value in zip(time_s, imposed, strict=True):
        reached = (body.press if by_force else body.move)(float(value), at_s=float(at_s))
        assert isinstance(reached, ToolState), reached
        answers.append(reached.displacement_m if by_force else reached.force_N)
    return np.array(answers)


@pytest.fixture(scope="module")
def body() -> ReducedSection:
    return ReducedSection(SPECIMEN, PUNCH, programmes(*viscoelastic(0.5)), FINENESS)


@pytest.mark.parametrize("constants", [(120.0, 180.0), (350.0, 55.0)])
def test_an_elastic_ramp_of_other_constants(body, constants):
    """The mesh is coarse, and the tool's edge passes its elements in steps that few modes smooth away."""
    at_rest, way = np.zeros(20), np.linspace(0.0, DEEPEST_M, 21)[1:]
    exact = full(law(*constants), (), at_rest, way)
    found = body.follow(law(*constants), (), at_rest, way).force_N
    assert np.abs((found - exact) / np.gradient(exact, way)).max() < 3e-6


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_relaxation_of_another_strength(body, share):
    tissue = law(260.0, 70.0)
    exact = full(tissue, viscoelastic(share), TIME_S, COURSE_M)
    found = body.follow(tissue, viscoelastic(share), TIME_S, COURSE_M)
    slope = np.gradient(full(tissue, (), 0.0 * RAMP_M, RAMP_M), RAMP_M)
    off = np.abs((found.force_N - exact) / np.interp(COURSE_M, RAMP_M, slope))[exact > 0.02 * exact.max()]
    assert off.max() < 3e-6
    assert off.max() < estimate(body, tissue, viscoelastic(share), TIME_S, found).stated_m + 2e-6


def test_a_force_is_imposed(body):
    forces = np.array([0.05, 0.1, 0.2, 0.3, 0.3, 0.2, 0.1])
    time_s = np.arange(1.0, 8.0)
    exact = full(LAW, (), time_s, forces, by_force=True)
    found = body.follow(LAW, (), time_s, forces, by_force=True)
    assert found.force_N == pytest.approx(forces)
    assert np.abs(found.displacement_m - exact).max() < 3e-6


def test_the_estimate_follows_the_error():
    """With few modes the error is many times larger, and the estimate tells it at each instant."""
    poor = ReducedSection(SPECIMEN, PUNCH, programmes(), FINENESS, modes=5, pressures=4, tolerance=1e-3)
    at_rest, way = np.zeros(16), np.linspace(0.0, DEEPEST_M, 17)[1:]
    tissue = law(200.0, 50.0)
    exact = full(tissue, (), at_rest, way)
    found = poor.follow(tissue, (), at_rest, way)
    error = (found.force_N - exact) / np.gradient(exact, way)
    told = estimate(poor, tissue, (), at_rest, found)
    assert np.abs(error).max() > 4e-6
    assert told.stated_m > np.abs(error).max()
    assert np.corrcoef(told.displacement_m, error[told.instants])[0, 1] > 0.8


def test_few_shares_are_found_and_none_is_negative():
    rng = np.random.default_rng(3)
    matrix = rng.normal(size=(12, 300)) + 0.5
    shares, error = sparse_shares(matrix, matrix @ np.ones(300), 40, 1e-9)
    assert error < 1e-9
    assert (shares >= 0.0).all()
    assert np.count_nonzero(shares) <= 16


def test_what_a_reduced_section_refuses(body):
    with pytest.raises(InputError, match="glued on"):
        ReducedSection(SPECIMEN, ToolTable(shape="bonded-disc", radius_mm=14.0), programmes(), FINENESS)
    with pytest.raises(InputError, match="keeps its volume"):
        body.follow(LAW, (EFFECTS["drainage"](share=0.3, tau_s=3.0),), np.ones(1), np.array([1e-3]))
