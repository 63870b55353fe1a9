"""Every --json answer has a JSON schema in docs/json, made from the types of the code, and is what it says.

Answers that take long are checked where they are made: ``check_answer`` in the tests of these commands.
"""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from answers import SCHEMAS, check_answer
from command import command
from identify_cases import write_homogeneous
from jsonschema import ValidationError
from support import ROOT

from explicitfe.app.cli.answers import ANSWERS_OF_COMMANDS, answer_schema
from explicitfe.app.cli.app import COMMANDS, GROUPS
from explicitfe.app.tools import speed
from explicitfe.app.tools.lists import LISTS
from explicitfe.app.view.json_text import json_text
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
from explicitfe.fem.solve.ledger import Ledger
from explicitfe.simulate.run import transient

pytestmark = pytest.mark.slow

TONGUE = [str(ROOT / "scenarios/vowel-i.toml"), "--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=2"]
PUNCH = [str(ROOT / "scenarios/indentation-rear.toml"), "--set", "model.edge_size_mm=3", "--set", "analysis.forces_N=[0.05]"]


def answered(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> dict:
    """What a command answers, checked against its schema."""
    capsys.readouterr()
    assert command([*words, "--json"]) == code
    return check_answer("-".join(words[:2]) if words[0] == "new" else words[0], capsys.readouterr().out)


@pytest.mark.parametrize("name", [*ANSWERS_OF_COMMANDS, "failure"])
def test_the_files_are_what_the_code_makes(name: str) -> None:
    """Written anew by: explicitfe schema --answer NAME > docs/json/NAME.schema.json"""
    text = (SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8")
    assert text == json_text(answer_schema(name)) + "\n", f"explicitfe schema --answer {name} > docs/json/{name}.schema.json"


def test_every_command_that_answers_has_a_schema() -> None:
    names = {name for panel in COMMANDS.values() for name in panel} - {"schema"}
    names |= {f"{group}-{name}" for panel in GROUPS.values() for group, (_, commands) in panel.items() for name in commands}
    assert set(ANSWERS_OF_COMMANDS) == names
    assert {path.name for path in SCHEMAS.iterdir()} == {f"{name}.schema.json" for name in (*names, "failure")}


def test_the_schema_of_an_answer_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["schema", "--answer", "new scenario"]) == 0
    assert capsys.readouterr().out == (SCHEMAS / "new-scenario.schema.json").read_text(encoding="utf-8")
    assert command(["schema", "--answer", "runn"]) == 2
    assert 'there is no answer "runn"; did you mean "run"?' in capsys.readouterr().err


def test_a_key_that_nobody_typed_is_seen() -> None:
    for answer in ({"seconds": {"a": 1.0}, "more": 1}, {"seconds": {"a": "1"}}, {}, {"seconds": {}, "failure": {"kind": "odd"}}):
        with pytest.raises((ValidationError, AssertionError)):
            check_answer("warmup", json.dumps(answer))
    check_answer("warmup", json.dumps({"seconds": {"a": 1.0}}))


@pytest.mark.parametrize("scenario", [TONGUE, PUNCH], ids=["transient", "indentation"])
def test_scenarios_and_results(scenario: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answered(capsys, "check", *scenario)
    summary = answered(capsys, "run", *scenario, "--out", str(tmp_path))
    inspected = answered(capsys, "inspect", summary["result"])
    assert inspected["summary"]["status"] == "finished"
    if scenario is TONGUE:
        assert len(answered(capsys, "measure", summary["result"], summary["result"], "--formants")["results"]) == 2
        assert inspected["measures"] is not None


def test_a_run_that_is_stopped_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def ledger_of_a_stopped_run(**given: float) -> Ledger:  # it is made when the first step is about to be done
        signal.raise_signal(signal.SIGTERM)
        return Ledger(**given)

    monkeypatch.setattr(transient, "Ledger", ledger_of_a_stopped_run)
    stopped = answered(capsys, "run", *TONGUE, "--out", str(tmp_path), code=143)
    assert stopped["status"] == "interrupted"
    assert stopped["failure"] == {
        "kind": "stopped",
        "message": stopped["message"],
        "exit_code": 143,
    }
    monkeypatch.undo()
    assert answered(capsys, "inspect", stopped["result"])["restart"] is not None
    assert answered(capsys, "resume", stopped["result"])["status"] == "finished"


@pytest.mark.parametrize("what", LISTS)
def test_lists(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert answered(capsys, "list", what)[what]


def test_the_machine(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """``bench`` is checked in test_speed.py."""
    monkeypatch.setattr(speed, "USUAL_RUNS", {"the tongue": ("vowel-i", ("model.cells=[8,4,4]",))})
    monkeypatch.setattr(speed.point, "uniaxial", lambda *given: None)
    answered(capsys, "warmup")


def test_measured_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    answered(capsys, "identify", str(data), "--out", str(tmp_path / "fit"))
    answered(capsys, "close-loop", str(data), "--out", str(tmp_path / "loop"), "--max-effects", "0")
    answered(capsys, "predict", str(data), "--model", str(tmp_path / "loop/model.toml"), "--out", str(tmp_path / "predicted"))


def test_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Under the schema of the command that failed too."""
    missing = str(tmp_path / "missing")
    for words in (["run", missing], ["check", missing], ["inspect", missing], ["measure", missing], ["list", "nothing"]):
        assert answered(capsys, *words, code=2)["failure"]["kind"] == "input"
        check_answer("failure", json.dumps(answered(capsys, *words, code=2)))
