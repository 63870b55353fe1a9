"""Effects of the reading in every kind of test: each against its equation, and undone again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from explicitfe.fem.effects import EFFECTS
from explicitfe.fem.effects.effect import Measurement, readings_of
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.tables import MeasuredNoise, MeasuredSpecimen, MeasuredTool
from explicitfe.inverse.predict.experiment import effects_of
from explicitfe.inverse.predict.homogeneous import HomogeneousTest, predict_homogeneous
from explicitfe.inverse.predict.reading import reading, record_of, true_programme
from explicitfe.inverse.predict.tissue import Tissue
from explicitfe.platform.errors import InputError

LAW = Yeoh(C10_Pa=300.0, C20_Pa=150.0, poisson=0.4999)
TIME_S = np.linspace(0.0, 8.0, 81)
# Up to a strain, back, and up again less far.
COURSE = np.interp(TIME_S, [0.0, 3.0, 5.0, 8.0], [0.0, 1.0, 0.2, 0.7])
KINDS = {"tension": 0.3, "compression": -0.3, "shear": 0.4}


def curve_of(kind: str, motion: np.ndarray | None = None, **conditions) -> Curve:
    """A test without a tool; its measured stress is not looked at."""
    motion = KINDS[kind] * COURSE if motion is None else motion
    shear = kind == "shear"
    columns = {"shear_strain": motion} if shear else {"stretch": 1.0 + motion}
    columns["shear_stress_Pa" if shear else "nominal_stress_Pa"] = np.zeros(len(motion))
    point = MeasuredSpecimen(shape="point")
    columns_kind = "shear" if shear else "uniaxial"
    return Curve("c", "c.csv", columns_kind, "all", "c", None, point, None, MeasuredNoise(), conditions, TIME_S, columns)


def pressed(control: str, **conditions) -> Curve:
    """A test under a tool."""
    columns = {"displacement_m": 2e-3 * COURSE, "force_N": 0.5 * COURSE}
    tool = MeasuredTool(shape="flat-cylinder", radius_mm=5.0, control=control)
    block = MeasuredSpecimen(shape="cylinder", radius_mm=20.0, height_mm=15.0)
    return Curve("c", "c.csv", "force-displacement", "all", "c", None, block, tool, MeasuredNoise(), conditions, TIME_S, columns)


def stress(curve: Curve, **effects: dict[str, float]) -> np.ndarray:
    """Predicted stress [Pa] of a curve with effects, each by its name and its parameters."""
    chosen = [EFFECTS[name.replace("_", "-")](**parameters) for name, parameters in effects.items()]
    ((answer,),) = predict_homogeneous([HomogeneousTest([curve], LAW, chosen)])
    return answer.values


@pytest.mark.parametrize("kind", KINDS)
def test_offset_and_drift_of_stress(kind):
    curve = curve_of(kind)
    read = stress(curve, force_offset={"offset_Pa": 7.0}, force_drift={"rate_Pa_s": -0.25})
    assert read == pytest.approx(stress(curve) + 7.0 - 0.25 * TIME_S, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_scale_of_strain_is_another_programme(kind):
    read = stress(curve_of(kind), gauge_length={"error": 0.1})
    assert read == pytest.approx(stress(curve_of(kind, 1.1 * KINDS[kind] * COURSE)), rel=1e-7, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_offset_of_strain_is_in_the_direction_of_the_test(kind):
    """A pre-strain adds to the strain. A slack takes from it, and nothing is borne until it is taken up."""
    size, side = abs(KINDS[kind]), np.sign(KINDS[kind])
    read = stress(curve_of(kind), contact_offset={"offset_strain": 0.02})
    assert read == pytest.approx(stress(curve_of(kind, side * (size * COURSE + 0.02))), rel=1e-7, abs=1e-6)
    slack = size * COURSE - 0.1
    read = stress(curve_of(kind), contact_offset={"offset_strain": -0.1})
    motion = slack if kind == "shear" else np.maximum(slack, 0.0)
    assert read == pytest.approx(stress(curve_of(kind, side * motion)), rel=1e-7, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_lag_by_two_rows_is_a_shift_by_two_rows(kind):
    plain, late = stress(curve_of(kind)), stress(curve_of(kind), lag={"lag_s": 0.2})
    assert late[2:] == pytest.approx(plain[:-2], abs=1e-9)
    assert late[:2] == pytest.approx(plain[:1].repeat(2), abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_backlash_holds_the_load_after_a_turn(kind):
    """On the way in nothing changes; after the turn the specimen waits for the width of the play."""
    size, side, play = abs(KINDS[kind]), np.sign(KINDS[kind]), 0.05
    read, plain = (stress(curve_of(kind), **effects) for effects in ({"backlash": {"play_strain": play}}, {}))
    way_in, way_back = slice(None, 31), slice(31, 51)
    assert read[way_in] == pytest.approx(plain[way_in], abs=1e-9)
    follows = np.minimum(size, size * COURSE + play)[way_back]
    assert read[way_back] == pytest.approx(
        stress(curve_of(kind, side * np.minimum(size, size * COURSE + play)))[way_back], rel=1e-7
    )
    assert np.ptp(follows) > 0.1  # it does move on


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive_slips_after_each_way(kind):
    """A saw's tooth for each way: at half of the second one half of the drag, in the direction of the motion."""
    size, side = abs(KINDS[kind]), np.sign(KINDS[kind])
    drag = stress(curve_of(kind), stick_slip={"drag_Pa": 8.0, "slip_distance_strain": size / 2.5}) - stress(curve_of(kind))
    ways = 2.5 * COURSE[:31]
    inside = np.abs(ways - np.round(ways)) > 1e-9  # at a slip itself rounding decides
    assert drag[:31][inside] == pytest.approx(8.0 * side * (ways % 1.0)[inside], abs=1e-6)
    assert drag[32] < drag[31] if side > 0.0 else drag[32] > drag[31]  # the way back pulls the other way


@pytest.mark.parametrize("kind", KINDS)
def test_rig_of_a_homogeneous_test_gives_way(kind):
    """The strain that the machine reads is that of the specimen and c times the stress, with a memory too."""
    memory = {"viscoelastic": {"g": (0.4,), "tau_s": (2.0,)}}
    motion, c = KINDS[kind] * COURSE, 0.1  # 1/kPa
    true = stress(curve_of(kind, motion), **memory)
    read = stress(curve_of(kind, motion + 1e-3 * c * true), **memory, compliance={"strain_per_kPa": c})
    assert np.ptp(1e-3 * c * true) > 0.01
    assert read == pytest.approx(true, abs=4e-3 * np.abs(true).max())  # twice the error of the increments


EVERY = {
    "force-offset": ({"offset_N": 0.03}, {"offset_Pa": 3.0}),
    "force-drift": ({"rate_N_s": 0.01}, {"rate_Pa_s": 1.0}),
    "contact-offset": ({"offset_mm": 0.2}, {"offset_strain": 0.01}),
    "cycle-drift": ({"per_cycle": 0.1}, {"per_cycle": 0.1}),
    "gauge-length": ({"error": 0.1}, {"error": 0.1}),
    "lag": ({"lag_s": 0.2}, {"lag_s": 0.2}),
    "stick-slip": ({"drag_N": 0.05, "slip_distance_mm": 0.3}, {"drag_Pa": 5.0, "slip_distance_strain": 0.05}),
    "backlash": ({"play_mm": 0.1}, {"play_strain": 0.02}),
}


def test_no_reading_is_forgotten_here():
    assert set(EVERY) == {name for name, kind in EFFECTS.items() if issubclass(kind, Measurement)}


@pytest.mark.parametrize("name", EVERY)
def test_what_a_machine_reads_can_be_undone(name):
    """Motion and load, on ways that go one way only: a play cannot know what came before, a lag not what came after."""
    for curve, parameters in ((pressed("force", repeat=3), EVERY[name][0]), (curve_of("shear", repeat=3), EVERY[name][1])):
        effect, record = EFFECTS[name](**parameters), record_of(curve)
        assert isinstance(effect, Measurement)
        x = np.linspace(0.1, 0.5, len(TIME_S))
        inner = slice(3, -3)
        assert effect.true_motion(effect.read_motion(x, record), record)[inner] == pytest.approx(x[inner])
        assert effect.true_load(effect.read_load(x, record), record)[inner] == pytest.approx(x[inner])
        changed = effect.read_motion(x, record) - x, effect.true_motion(x, record) - x, effect.read_load(x, record) - x
        assert max(np.abs(change).max() for change in changed) > 1e-3 * 0.1 or name == "backlash"


def test_force_control_undoes_the_force_and_reads_the_displacement():
    curve, effects = pressed("force"), readings_of([EFFECTS["force-offset"](offset_N=0.03), EFFECTS["lag"](lag_s=0.1)])
    true = true_programme(curve.force_N, curve, effects, by_force=True)
    assert true[:-1] == pytest.approx(np.maximum(curve.force_N[1:] - 0.03, 0.0), abs=1e-12)
    (read,) = reading([curve.displacement_m], [curve], effects, by_force=True)
    assert read == pytest.approx(curve.displacement_m)


@pytest.mark.parametrize("lag_s", [0.15, -0.15])
def test_a_lag_crosses_from_one_cycle_to_the_next(lag_s):
    """Two cycles of one test are read as one record; the second begins one step between rows after the first."""
    curve, lag = pressed("displacement"), readings_of([EFFECTS["lag"](lag_s=lag_s)])
    step_s = curve.time_s[1] - curve.time_s[0]
    cycles = [np.linspace(0.2, 1.0, len(curve.time_s)), np.linspace(1.0, 0.1, len(curve.time_s))]
    time_s = np.concatenate([curve.time_s, curve.time_s + curve.time_s[-1] + step_s])
    at = np.clip(time_s - lag_s, 0.0, time_s[-1])
    read = np.concatenate(reading(cycles, [curve, curve], lag, by_force=False))
    assert read == pytest.approx(PchipInterpolator(time_s, np.concatenate(cycles))(at), abs=1e-12)


@pytest.mark.parametrize(
    ("curve", "effect", "message"),
    [
        (curve_of("shear"), {"force-offset": {"offset_N": 0.1}}, "has no offset_Pa, and this is a test of strain and stress"),
        (pressed("force"), {"force-drift": {"rate_Pa_s": 0.1}}, "has no rate_N_s, and this is a test of displacement and force"),
        (curve_of("shear"), {"friction": {"coefficient": 0.1}}, "needs a tool"),
    ],
    ids=["stress", "force", "tool"],
)
def test_keys_of_another_kind_of_test_are_refused(curve, effect, message):
    tissue = Tissue.model_validate({"constants": {"C10_Pa": 200.0}, "effects": effect})
    with pytest.raises(InputError, match=message):
        effects_of(curve, tissue)


def test_a_reading_without_a_key_is_refused():
    with pytest.raises(ValueError, match="give offset_N or offset_Pa"):
        EFFECTS["force-offset"]()
