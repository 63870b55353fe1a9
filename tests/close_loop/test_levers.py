"""What the candidates of a moving tongue do to its scenario, and which of them are tried."""

from __future__ import annotations

from pathlib import Path

import pytest

from explicitfe.close_loop.trajectories.levers import LEVERS, levers_of
from explicitfe.errors import InputError
from explicitfe.scenario.read import read_scenario
from explicitfe.scenario.transient import TransientScenario

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
MUSCLES = ["GGp", "GGh", "MH", "SL", "STY"]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "scenario.toml"
    file.write_text(SCENARIO, encoding="utf-8")
    return file


def with_settings(path: Path, *settings: str) -> TransientScenario:
    scenario, _ = read_scenario(path, settings)
    assert isinstance(scenario, TransientScenario)
    return scenario


@pytest.mark.parametrize(("bone", "shift_z_mm"), [("jaw", -1.5), ("palate", 1.5)])
def test_a_bone_is_put_off_the_tongue(path: Path, bone: str, shift_z_mm: float) -> None:
    lever = LEVERS[f"{bone}-contact"]
    changed = with_settings(path, *lever.settings(with_settings(path), 1.5))
    assert [(table.name, table.shift_mm) for table in changed.bone] == [(bone, (0.0, 0.0, shift_z_mm))]
    assert lever.sought(changed) == f"the scenario has the bone {bone}"


def test_a_missing_muscle_has_the_course_of_its_partner_and_its_own_fibres(path: Path) -> None:
    scenario = with_settings(path, "muscle.GGp.force_N=1.6")
    lever = levers_of(MUSCLES)["missing-GGh"]
    *_, partner, added = with_settings(path, "muscle.GGp.force_N=1.6", *lever.settings(scenario, 0.5)).muscle
    assert (added.name, added.force_N, added.fibres) == ("GGh", 0.8, None)
    same = ("profile", "rise_ms", "distribution", "side")
    assert [getattr(added, key) for key in same] == [getattr(partner, key) for key in same]


def test_a_muscle_that_is_asked_for_goes_with_the_strongest(path: Path) -> None:
    lever = levers_of(MUSCLES)["missing-STY"]
    added = with_settings(path, *lever.settings(with_settings(path), 0.5)).muscle[-1]
    assert (added.name, added.force_N, added.profile) == ("STY", 1.5, "step")


def test_what_is_tried_without_being_asked_for(path: Path) -> None:
    scenario = with_settings(path)
    tried = [name for name, lever in levers_of(MUSCLES).items() if lever.usual and not isinstance(lever.sought(scenario), str)]
    assert set(tried) == {*LEVERS, "missing-GGh", "missing-MH"} - {"graft-stiffness"}


def test_all_grafts_are_stiffer(path: Path) -> None:
    own = {"law": "yeoh", "C10_Pa": 500.0, "C20_Pa": 200.0}
    text = "{" + ", ".join(f'{key} = "{value}"' if key == "law" else f"{key} = {value}" for key, value in own.items()) + "}"
    box = "box_mm=[[0, -10, 80], [60, 10, 110]]"
    grafted = f"graft=[{{{box}, stiffness_ratio=3.0}}, {{{box}, material={text}}}]"
    settings = LEVERS["graft-stiffness"].settings(with_settings(path, grafted), 2.0)
    first, second = with_settings(path, grafted, *settings).graft
    assert first.stiffness_ratio == 6.0
    law = second.material
    assert law is not None and not isinstance(law, str)
    assert law.model_dump(include={*own}) == own | {"C10_Pa": 1000.0, "C20_Pa": 400.0}


def test_what_these_scenarios_cannot_have(path: Path) -> None:
    plain = "model.damping={alpha_per_s=40.0}"
    assert isinstance(LEVERS["viscosity"].sought(with_settings(path, "model.element=hex8-full", plain)), str)
    relaxes = with_settings(path, plain, "effects={viscoelastic={g=[0.3], tau_s=[0.1]}}")
    assert isinstance(LEVERS["viscosity"].sought(relaxes), str)
    assert isinstance(LEVERS["palate-contact"].sought(with_settings(path, 'model={file="own.toml"}')), str)
    assert isinstance(levers_of(MUSCLES)["missing-GGh"].sought(with_settings(path, "muscle=[]")), str)


def test_a_table_that_is_added_is_checked(path: Path) -> None:
    with pytest.raises(InputError, match="force_N"):
        read_scenario(path, ['muscle.+={name="GGh"}'])
    with pytest.raises(InputError, match="title is a single value"):
        read_scenario(path, ["title.+=1"])
