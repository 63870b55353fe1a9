"""Constants with which a fit begins: they meet the data of an elastic tissue, and carry the loads of any."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tool_curves import tool_curve

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.specimens.first_constants import (
    C20_RATIOS,
    DEPTH_SHARES,
    LARGEST_SIZE_RATIO,
    RAMP_C10_PA,
    STIFFER_FACTOR,
    TRIED_SIZES,
    Baseline,
    first_constants,
)
from explicitfe.inverse.close_loop.specimens.simulator import Simulator
from explicitfe.inverse.close_loop.specimens.specimens import Specimens
from explicitfe.inverse.measured.curve import Curve, SpecimenDataset, programme_of
from explicitfe.inverse.measured.tables import MeasuredNoise
from explicitfe.inverse.predict.correction import Job, Run
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import EVERY, Constants, Numerics, Tissue
from explicitfe.platform.errors import RunError

FORCE_SD_N, DISPLACEMENT_SD_MM = 0.002, 0.01
NUMERICS = Numerics(refinement=0.3, density=0.5, tolerance=5e-4)
ELASTIC = Tissue(constants={EVERY: Constants(C10_Pa=RAMP_C10_PA)}, numerics=NUMERICS)
DEPTHS_m = np.linspace(0.0, 0.018, 400)
GRID_STEP = LARGEST_SIZE_RATIO ** (1.0 / (TRIED_SIZES - 1))


def curve(force_N: np.ndarray, displacement_m: np.ndarray, control: str = "force", shape: str = "bonded-disc") -> Curve:
    noise = MeasuredNoise(force_sd_N=FORCE_SD_N, displacement_sd_mm=DISPLACEMENT_SD_MM)
    return tool_curve(
        "a", np.arange(len(force_N), dtype=float), displacement_m, force_N, control=control, shape=shape, noise=noise
    )


# ---- a law in closed form in place of the mesh ----


def force_of(depth_m: np.ndarray, C10_Pa: float, C20_Pa: float) -> np.ndarray:
    """A force [N] that is proportional to the constants and stiffens with the depth."""
    return 0.5 * depth_m * C10_Pa + 3e3 * depth_m**3 * C20_Pa


def runner(largest_depth_m: float = np.inf) -> Callable[[list[Job]], list[Run]]:
    """Answers in closed form; a depth beyond the largest one cannot be computed."""

    def answer(job: Job) -> Run:
        (one,), tissue = job
        constants = tissue.constants[EVERY]
        force = force_of(DEPTHS_m, constants.C10_Pa, constants.C20_Pa)
        imposed = programme_of(one)
        by_force = one.imposed == "force_N"
        depth = np.sign(imposed) * np.interp(np.abs(imposed), force, DEPTHS_m, right=np.inf) if by_force else imposed
        if np.abs(depth).max() > largest_depth_m:
            return f'curve "{one.id}": too deep'
        return [depth if by_force else force_of(imposed, constants.C10_Pa, constants.C20_Pa)]

    return lambda jobs: [answer(job) for job in jobs]


def baseline(run: Callable[[list[Job]], list[Run]]) -> Baseline:
    return Baseline(ELASTIC, (), False, run)


def carried(one: Curve, constants: tuple[float, float], run: Callable[[list[Job]], list[Run]]) -> Run:
    (answer,) = run([((one,), baseline(run).tissue(*constants))])
    return answer


@pytest.mark.parametrize("q", C20_RATIOS)
@pytest.mark.parametrize("control", ["force", "displacement"])
@pytest.mark.parametrize("C10_Pa", [31.0, 193.5, 5e4])
def test_an_elastic_tissue_is_met(C10_Pa, control, q):
    """By an imposed displacement in one step; by an imposed force up to a step of the grid of sizes.

    A cubic between 17 depths is read linearly between 129. Of a cubic law that is an error below 1e-3 of the size.
    """
    depth = 0.006 * np.sin(np.linspace(0.0, np.pi, 60))
    one = curve(force_of(depth, C10_Pa, q * C10_Pa), depth, control)
    first, second = first_constants([one], baseline(runner()))
    assert second == q * first
    assert abs(np.log(first / C10_Pa)) < 1e-3 + (np.log(GRID_STEP) if control == "force" else 0.0)


@pytest.mark.parametrize("creep", [0.0, 0.3, 1.0])
def test_the_first_constants_carry_the_imposed_force(creep):
    """The tissue creeps while it is unloaded, so that most rows are deeper than at their force in loading.

    The best multiple of the forces is then too soft: it would reach the largest force deeper than the tool ever was.
    """
    force = np.concatenate([np.linspace(0.0, 0.8, 10), np.linspace(0.8, 0.0, 60)])
    elastic = np.interp(force, force_of(DEPTHS_m, 260.0, 130.0), DEPTHS_m)
    depth = elastic.copy()
    depth[10:] += creep * (elastic.max() - elastic[10:])
    one, run = curve(force, depth), runner(largest_depth_m=1.001 * depth.max())
    constants = first_constants([one], baseline(run))
    assert not isinstance(carried(one, constants, run), str)
    if creep == 1.0:
        ramp = force_of(depth, RAMP_C10_PA, 0.0)
        scaled = RAMP_C10_PA * float(ramp @ force) / float(ramp @ ramp)
        assert isinstance(carried(one, (scaled, 0.0), run), str)


@pytest.mark.parametrize("reach", [0.9, *DEPTH_SHARES[1:]])
def test_a_force_is_carried_where_the_measured_depth_cannot_be_computed(reach):
    depth = np.linspace(0.0, 0.008, 30)
    one, run = curve(force_of(depth, 200.0, 100.0), depth), runner(largest_depth_m=reach * 0.008)
    assert not isinstance(carried(one, first_constants([one], baseline(run)), run), str)


def test_a_displacement_that_cannot_be_computed_is_the_reason():
    depth = np.linspace(0.0, 0.008, 30)
    one = curve(force_of(depth, 200.0, 100.0), depth, "displacement")
    with pytest.raises(RunError, match='curve "a": too deep'):
        first_constants([one], baseline(runner(largest_depth_m=0.007)))


def test_one_curve_that_cannot_be_computed_leaves_the_others():
    depth = np.linspace(0.0, 0.004, 30)
    short = curve(force_of(depth, 200.0, 100.0), depth, "displacement")
    far = replace(curve(5.0 * short.force_N, 3.0 * depth, "displacement", "sphere"), id="b")
    found = first_constants([short, far], baseline(runner(largest_depth_m=0.007)))
    assert found == pytest.approx((200.0, 100.0), rel=1e-3)


def test_stiffer_constants_where_known_effects_soften():
    """A stated effect changes what a test by force needs: the constants grow until it can be computed."""
    depth = np.linspace(0.0, 0.006, 30)
    one, usual = curve(force_of(depth, 200.0, 0.0), depth), runner()

    def run(jobs: Sequence[Job]) -> list[Run]:
        soft = [test[0].imposed == "force_N" and tissue.constants[EVERY].C10_Pa < 400.0 for test, tissue in jobs]
        return ["too soft" if failed else answer for failed, answer in zip(soft, usual(list(jobs)), strict=True)]

    first, _ = first_constants([one], baseline(run))
    assert first == pytest.approx(200.0 * STIFFER_FACTOR**2, rel=GRID_STEP - 1.0)


def test_forces_of_the_wrong_sign_are_named():
    depth = np.linspace(0.0, 0.006, 30)
    with pytest.raises(RunError, match="check the signs"):
        first_constants([curve(-force_of(depth, 200.0, 0.0), depth, "displacement")], baseline(runner()))


# ---- a glued disc on a mesh ----


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [None, "viscoelastic", "softening"])
def test_a_force_history_of_a_glued_disc_can_be_computed_where_the_fit_begins(hidden):
    """Steps of the force with holds and back to none: noise makes the disc pull at the end."""
    corners = [(0.0, 0.0), (2.0, 0.4), (12.0, 0.4), (14.0, 0.8), (34.0, 0.8), (36.0, 0.2), (46.0, 0.2), (47.0, 0.0), (60.0, 0.0)]
    time_s = np.linspace(0.0, 60.0, 61)
    force = np.interp(time_s, *np.array(corners).T)
    one = replace(curve(force, np.linspace(0.0, 0.006, 61)), time_s=time_s)
    tissue = ELASTIC.model_copy(update={"constants": {EVERY: Constants(C10_Pa=170.0, C20_Pa=110.0)}})
    parameters = {"viscoelastic": {"g": [0.35], "tau_s": [8.0]}, "softening": {"inverse_r": 0.45, "m_Pa": 25.0}}
    if hidden is not None:
        tissue = tissue.with_effect(EFFECTS[hidden](**parameters[hidden]))
    (answer,) = predict_test((one,), tissue)
    rng = np.random.default_rng(4)
    noisy_N = force + FORCE_SD_N * rng.standard_normal(61)
    noisy_N[-1] = -0.35 * FORCE_SD_N
    displacement = answer.values + 1e-3 * DISPLACEMENT_SD_MM * rng.standard_normal(61)
    measured = replace(one, columns={"displacement_m": displacement, "force_N": noisy_N})
    dataset = SpecimenDataset(
        name="made", title="made", test="indentation", source="", license="", notes="", path=Path("made"), curves=(measured,)
    )
    system = Specimens(dataset, (measured,), Simulator(1), NUMERICS)
    assert system.failing() == {}
    (answers,) = system.answers([system.start()])
    assert answers is not None
    assert np.abs(answers[0]).max() < 1.1 * displacement.max()
