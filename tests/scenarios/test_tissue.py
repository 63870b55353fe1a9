"""The tissue of a model file in a scenario: constants, Poisson's ratio and effects, as if they stood there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command import command
from support import ROOT

import explicitfe
from explicitfe.inverse.predict.tissue import parse_tissue
from explicitfe.inverse.predict.tissue_in_scenario import tissue_settings
from explicitfe.simulate.scenario.read import read_scenario

pytestmark = pytest.mark.slow

REAR, BALL, VOWEL = (ROOT / "scenarios" / f"{name}.toml" for name in ("indentation-rear", "indentation-ball", "vowel-i"))
MUSCLE = """format = "explicitfe-model/1"
poisson = 0.49
[constants.fibre]
C10_Pa = 226.1
C20_Pa = 1869.3
[constants.cross-fibre]
C10_Pa = 545.3
C20_Pa = 1849.1
[effects]
viscoelastic = { g = [0.58, 0.22], tau_s = [0.01, 62.0] }
preload = { force_N = 0.01 }
contact-offset = { offset_mm = 0.1 }
friction = { coefficient = 0.3 }
"""
SHORT = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=5"]
QUICK = ["--set", "model.edge_size_mm=1.5", "--set", "analysis.forces_N=[0.1, 0.3]"]


def saved(folder: Path, text: str = MUSCLE) -> Path:
    path = folder / "muscle.toml"
    path.write_text(text, encoding="utf-8")
    return path


def ran(capsys: pytest.CaptureFixture[str], scenario: Path, folder: Path, *options: str) -> dict:
    assert command(["run", str(scenario), "--out", str(folder / "out"), "--overwrite", "--json", *options]) == 0
    return json.loads(capsys.readouterr().out)


def test_muscle_in_the_tongue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same as with the settings written out; what is stored runs again without the model file."""
    path = saved(tmp_path)
    summary = ran(capsys, VOWEL, tmp_path, *SHORT, "--tissue", str(path), "--tissue-group", "fibre")
    assert summary["status"] == "finished"
    assert summary["warnings"][0].endswith("friction, preload, contact-offset.")
    assert "relaxes by itself, so model.damping.beta_s is 0" in summary["warnings"][1]
    with explicitfe.open_result(summary["result"]) as result:
        stated, text = result.model["scenario"], result.scenario_text
    assert stated["model"]["material"] == {
        "law": "yeoh", "C10_Pa": 226.1, "C20_Pa": 1869.3, "C30_Pa": 0.0, "poisson": 0.49, "density_kg_m3": 1040.0, "source": "",
    }  # fmt: skip
    assert stated["effects"] == {"viscoelastic": {"g": [0.58, 0.22], "tau_s": [0.01, 62.0]}}
    assert stated["model"]["damping"]["beta_s"] == 0.0  # the tissue relaxes by itself
    assert "# --set model.material={" in text
    again = tmp_path / "again.json"
    again.write_text(json.dumps(stated))
    assert explicitfe.run(again, tmp_path)["probes"] == summary["probes"]
    path.unlink()
    plain = ran(capsys, VOWEL, tmp_path, *SHORT)
    assert plain["probes"] != summary["probes"] and not any("left out" in note for note in plain["warnings"])


def test_tissue_under_a_tool(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Friction goes with the tissue, the preload of the test it was fitted to does not; the scenario's own effects stay."""
    options = ["--tissue", str(saved(tmp_path)), "--tissue-group", "cross-fibre", "--set", "effects.tilt={angle_deg=0.0}"]
    summary = ran(capsys, REAR, tmp_path, *QUICK, *options)
    assert summary["warnings"][0].endswith("preload, contact-offset.")
    with explicitfe.open_result(summary["result"]) as result:
        stated = result.model["scenario"]
    assert set(stated["effects"]) == {"viscoelastic", "friction", "tilt"}
    same = [
        "model.material={C10_Pa=545.3, C20_Pa=1849.1, poisson=0.49, density_kg_m3=1040.0}",
        "effects={viscoelastic={g=[0.58, 0.22], tau_s=[0.01, 62.0]}, friction={coefficient=0.3}}",
    ]
    written = ran(capsys, REAR, tmp_path, *QUICK, *(word for setting in same for word in ("--set", setting)))
    assert written["curve"] == summary["curve"]


def test_density_and_one_group(tmp_path: Path) -> None:
    """The density is the scenario's own; one table of constants needs no group; numbers come back bit by bit."""
    tissue = parse_tissue('format = "explicitfe-model/1"\nconstants = { C10_Pa = 0.30000000000000004 }\n')
    settings, left_out = tissue_settings(tissue, read_scenario(BALL)[0])
    material = read_scenario(BALL, settings)[0].model.material
    assert (material.C10_Pa, material.C20_Pa, material.density_kg_m3) == (0.30000000000000004, 0.0, 1070.0)
    assert left_out == []


def test_settings_come_after_the_tissue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--tissue", str(saved(tmp_path)), "--tissue-group", "fibre", "--set", "model.material.C10_Pa=300.0"]
    assert command(["check", str(VOWEL), *SHORT, "--json", *options]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["material"]["C10_Pa"], summary["material"]["C20_Pa"]) == (300.0, 1869.3)
    assert any("left out: friction, preload, contact-offset." in warning for warning in summary["warnings"])


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (MUSCLE, ["--tissue", "MODEL"], ["several groups", "fibre, cross-fibre"]),
        (MUSCLE, ["--tissue", "MODEL", "--tissue-group", "fiber"], ['no group of constants "fiber"', 'did you mean "fibre"?']),
        (MUSCLE.replace("cross-fibre", '"*"'), ["--tissue", "MODEL"], ["several groups"]),
        (
            'format = "explicitfe-model/1"\nconstants = { C10_Pa = 1.0 }\n',
            ["--tissue", "MODEL", "--tissue-group", "a"],
            ["for all"],
        ),
        (MUSCLE, ["--tissue", "none.toml"], ["none.toml", "cannot be read"]),
        (MUSCLE, ["--tissue-group", "fibre"], ["add --tissue FILE"]),
    ],
)
def test_what_cannot_be_used(
    text: str, options: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path, text)
    options = [str(path) if word == "MODEL" else word for word in options]
    assert command(["run", str(VOWEL), "--out", str(tmp_path), *options]) == 2
    line = next(line for line in capsys.readouterr().err.splitlines() if line.startswith("error:"))
    for word in words:
        assert word in line, line
    assert not list(tmp_path.rglob("*.vtkhdf"))
