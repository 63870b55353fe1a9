"""What the candidates of a moving tongue do to its scenario or to its registration, and which of them are tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from explicitfe.inverse.close_loop.trajectories.lever import Experiment, Lever
from explicitfe.inverse.close_loop.trajectories.levers import levers_of, mean_profile
from explicitfe.inverse.measured.curve import TrajectoryDataset
from explicitfe.inverse.measured.registration import Registration
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import InputError
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.scenario.profile import profile_of
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.scenario.transient import MuscleTable, TransientScenario

SCENARIO = """title = "Tongue forward"
[model]
name = "tongue"
damping = { alpha_per_s = 40.0, beta_s = 0.03 }
[[muscle]]
name = "SL"
force_N = 3.0
[[muscle]]
name = "GGp"
force_N = 2.0
profile = "ramp"
rise_ms = 20.0
distribution = "stress"
fibres = [1, 2]
[analysis]
duration_ms = 50.0
"""
TONGUE = catalogue.built_in("tongue", "coarse")
ANATOMY = replace(TONGUE, muscles={name: TONGUE.muscles[name] for name in ("GGp", "GGh", "MH", "SL", "STY")})
JAW = 'bone=[{name="jaw", friction=0.1, shift_mm=[1.0, 0.0, -2.0]}]'


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "scenario.toml"
    file.write_text(SCENARIO, encoding="utf-8")
    return file


def with_settings(path: Path, *settings: str) -> TransientScenario:
    scenario, _ = read_scenario(path, settings)
    assert isinstance(scenario, TransientScenario)
    return scenario


def levers(
    path: Path, *settings: str, totals_N: Sequence[float] = (), registration: RegistrationTable | None = None
) -> dict[str, Lever]:
    """Levers of a tongue with some muscles, in curves with these total forces."""
    scenario = with_settings(path, *settings)
    total_N = sum(muscle.force_N for muscle in scenario.muscle)
    curves = [
        scenario.model_copy(
            update={"muscle": [m.model_copy(update={"force_N": m.force_N * t / total_N}) for m in scenario.muscle]}
        )
        for t in totals_N
    ]
    return levers_of(Experiment(scenario, ANATOMY, dataset_of(path, registration), curves or [scenario]))


def dataset_of(path: Path, registration: RegistrationTable | None = None) -> TrajectoryDataset:
    """A dataset without curves."""
    head = {key: "" for key in ("name", "title", "source", "license", "notes")}
    return TrajectoryDataset(**head, test="trajectory", path=path, curves=(), registration=registration)


def test_every_cause_has_its_forms(path: Path) -> None:
    forms: dict[str, list[str]] = {}
    for name, lever in levers(path, totals_N=[5.0, 2.0]).items():
        if not lever.reason:
            forms.setdefault(lever.cause, []).append(name)
    single = ["activation-lag", "gravity", "force-scale", "force-length", "stiffness", "rest-shape", "registration"]
    single += ["force-GGp", "force-SL"]
    several = {
        "damping": ["damping"],
        "viscoelastic": ["viscosity"],
        **{f"{b}-contact": [f"{b}-contact", f"{b}-contact-shifted", f"{b}-contact-rough"] for b in ("jaw", "palate")},
        **{f"missing-{name}": [f"missing-{name}", f"missing-{name}-share"] for name in ("GGh", "MH", "STY")},
    }
    assert forms == {name: [name] for name in single} | several


@pytest.mark.parametrize(("bone", "shift_z_mm"), [("jaw", -1.5), ("palate", 1.5)])
def test_a_missing_bone_is_put_at_a_distance(path: Path, bone: str, shift_z_mm: float) -> None:
    lever = levers(path)[f"{bone}-contact-shifted"]
    changed = with_settings(path, *lever.settings(with_settings(path), {"clearance_mm": 1.5, "shift_x_mm": -1.0}))
    assert [(table.name, table.shift_mm) for table in changed.bone] == [(bone, (-1.0, 0.0, shift_z_mm))]
    rough = levers(path)[f"{bone}-contact-rough"]
    (table,) = with_settings(path, *rough.settings(with_settings(path), {"clearance_mm": 0.0, "friction": 0.2})).bone
    assert table.friction == 0.2


def test_a_bone_is_shifted_from_its_place(path: Path) -> None:
    scenario, own = with_settings(path, JAW), levers(path, JAW)
    assert "jaw-contact" not in own
    shift = own["jaw-shift"].settings(scenario, {"shift_x_mm": 0.5, "shift_z_mm": -1.0})
    friction = own["jaw-friction"].settings(scenario, {"friction": 0.4})
    (jaw,) = with_settings(path, JAW, *shift, *friction).bone
    assert (jaw.shift_mm, jaw.friction) == ((1.5, 0.0, -3.0), 0.4)
    assert own["jaw-friction"].sought["friction"].none == 0.1


def test_a_missing_muscle_has_the_mean_activation_profile(path: Path) -> None:
    """A step of 3 N and a ramp of 2 N in 20 ms: 0.6 at once, and 1 from 20 ms on."""
    scenario = with_settings(path)
    added = with_settings(path, *levers(path)["missing-MH"].settings(scenario, {"force_N": 1.5})).muscle[-1]
    assert (added.name, added.force_N, added.fibres, added.distribution) == ("MH", 1.5, None, "ends")
    assert added.table == [(0.0, 0.0), (0.0, 0.6), (20.0, 0.6 + 0.4)]
    share = levers(path, totals_N=[5.0, 2.0])["missing-MH-share"]
    assert with_settings(path, *share.settings(scenario, {"share": 0.4})).muscle[-1].force_N == 2.0


def test_the_mean_profile_is_the_weighted_mean_at_every_time() -> None:
    tables = [
        MuscleTable(name="GGp", force_N=2.0, profile="ramp", rise_ms=20.0, end_ms=45.0),
        MuscleTable(name="SL", force_N=1.0, start_ms=10.0, end_ms=30.0),
        MuscleTable(name="MH", force_N=0.5, profile="table", table=[(5.0, 0.2), (40.0, 1.2)]),
    ]
    mean = MuscleTable(name="STY", force_N=1.0, profile="table", table=mean_profile(tables))
    times_s = np.linspace(1e-4, 0.06, 501)
    expected = sum(one.force_N * profile_of(one).at(times_s, tolerance_s=1e-9) for one in tables) / 3.5
    assert np.abs(profile_of(mean).at(times_s, tolerance_s=1e-9) - expected).max() < 1e-12


def test_a_muscle_with_the_profile_of_all_others_keeps_its_keys(path: Path) -> None:
    scenario = with_settings(path, "muscle.1.force_N=0.0")
    added = with_settings(path, *levers(path)["missing-STY"].settings(scenario, {"force_N": 0.5})).muscle[-1]
    assert (added.profile, added.rise_ms, added.distribution) == ("ramp", 20.0, "stress")


def test_the_force_of_one_muscle_is_multiplied(path: Path) -> None:
    changed = with_settings(path, *levers(path)["force-SL"].settings(with_settings(path), {"factor": 1.5}))
    assert [muscle.force_N for muscle in changed.muscle] == [4.5, 2.0]


def test_a_share_of_the_force_falls_off_in_short_fibres(path: Path) -> None:
    """Only forces as a stress can; the sum stays, and so do the fibres."""
    lever = levers(path)["force-length"]
    changed = with_settings(path, *lever.settings(with_settings(path), {"share": 0.25})).muscle
    entries = [(m.name, m.force_N, m.force_length, m.fibres) for m in changed]
    assert entries == [("SL", 3.0, False, None), ("GGp", 1.5, False, [1, 2]), ("GGp", 0.5, True, [1, 2])]
    assert levers(path, "muscle.2.force_length=true")["force-length"].reason


def test_all_grafts_are_stiffer(path: Path) -> None:
    own = {"law": "yeoh", "C10_Pa": 500.0, "C20_Pa": 200.0}
    text = "{" + ", ".join(f'{key} = "{value}"' if key == "law" else f"{key} = {value}" for key, value in own.items()) + "}"
    box = "box_mm=[[0, -10, 80], [60, 10, 110]]"
    grafted = f"graft=[{{{box}, stiffness_ratio=3.0}}, {{{box}, material={text}}}]"
    settings = levers(path, grafted)["graft-stiffness"].settings(with_settings(path, grafted), {"factor": 2.0})
    first, second = with_settings(path, grafted, *settings).graft
    assert first.stiffness_ratio == 6.0
    law = second.material
    assert law is not None and not isinstance(law, str)
    assert law.model_dump(include={*own}) == own | {"C10_Pa": 1000.0, "C20_Pa": 400.0}


def test_readings_move_the_model() -> None:
    """A point of the model is seen where the moved, turned or larger model has it."""
    random = np.random.default_rng(1)
    points, centre = random.standard_normal((5, 3)), np.array([0.08, 0.0, 0.09])
    before = Registration(Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(), np.array([0.01, 0.02, 0.03]), 1.1)
    scenario = TransientScenario.model_validate({"title": "x", "model": {"name": "tongue"}, "analysis": {"duration_ms": 1.0}})
    own = levers_of(Experiment(scenario, ANATOMY, dataset_of(Path()), [scenario]))
    motion, size = own["registration"].reading, own["rest-shape"].reading
    assert motion is not None and size is not None
    turn = Rotation.from_rotvec([0.0, np.radians(5.0), 0.0]).as_matrix()
    moved = centre + (points - centre) @ turn.T + 1e-3 * np.array([2.0, 0.0, -1.0])
    after = motion(before, centre, {"shift_x_mm": 2.0, "shift_z_mm": -1.0, "turn_deg": 5.0})
    assert np.abs(after.to_sensors(points) - before.to_sensors(moved)).max() < 1e-14
    larger = size(before, centre, {"factor": 1.2})
    assert np.abs(larger.to_sensors(points) - before.to_sensors(centre + 1.2 * (points - centre))).max() < 1e-14


def test_what_these_scenarios_cannot_have(path: Path) -> None:
    plain = "model.damping={alpha_per_s=40.0}"
    assert levers(path, "model.element=hex8-full", plain)["viscosity"].reason
    assert levers(path, plain, "effects={viscoelastic={g=[0.3], tau_s=[0.1]}}")["viscosity"].reason
    assert "palate-contact" not in levers(path, 'model={file="own.toml"}')
    assert levers(path, "muscle=[]")["missing-GGh"].reason
    assert levers(path, 'muscle=[{name="SL", force_N=1.0}]')["force-SL"].reason
    fitted = RegistrationTable(rotation="fit", translation="fit")
    assert levers(path, registration=fitted)["registration"].reason
    turned = levers(path, registration=RegistrationTable(translation="fit"))["registration"]
    assert list(turned.sought) == ["turn_deg"]


def test_a_table_that_is_added_is_checked(path: Path) -> None:
    with pytest.raises(InputError, match="force_N"):
        read_scenario(path, ['muscle.+={name="GGh"}'])
    with pytest.raises(InputError, match="title is a single value"):
        read_scenario(path, ["title.+=1"])
