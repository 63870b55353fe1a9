"""Scenarios, datasets and protocols that come with the program go by their names; so does what a shell completes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command import command
from jsonschema import Draft202012Validator
from support import ROOT

from explicitfe.app.cli.completion import complete_scenario, complete_scenario_or_dataset
from explicitfe.app.cli.file_schemas import FILES, file_schema
from explicitfe.app.cli.list import LISTED
from explicitfe.app.tools.lists import LISTS
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import shipped
from explicitfe.platform.host.text import toml_of
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.run.run import result_path

EXAMPLES = {
    "scenario": sorted(shipped.folder_of("scenarios").glob("*.toml")),
    "dataset": [folder / shipped.DATASET_FILE for folder in shipped.datasets().values()],
    "protocol": list(shipped.protocols().values()),
}


def test_a_scenario_runs_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert prepare("sl-alone", ["model.cells=[8,4,4]"]).path == ROOT / "scenarios" / "sl-alone.toml"
    assert result_path("vowel-i") == Path("outputs/vowel-i.vtkhdf")
    assert shipped.protocol_file("gerard-2005") == ROOT / "scenarios" / "protocols" / "gerard-2005.toml"


def test_a_file_of_the_user_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert shipped.scenario_file("vowel-i.toml") == ROOT / "scenarios" / "vowel-i.toml"
    (tmp_path / "vowel-i.toml").touch()
    assert shipped.scenario_file("vowel-i.toml") == Path("vowel-i.toml")
    # A folder without a dataset, such as one of results, is no dataset.
    (tmp_path / "ecoflex-compression").mkdir()
    assert shipped.dataset_folder("ecoflex-compression") == ROOT / "scenarios" / "datasets" / "ecoflex-compression"
    (tmp_path / "ecoflex-compression" / "dataset.toml").touch()
    assert shipped.dataset_folder("ecoflex-compression") == Path("ecoflex-compression")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["run", "vowl-i"], 'no scenario of that name comes with the program; did you mean "vowel-i"?'),
        (["run", "scenarios/vowel-i.toml"], 'scenarios/vowel-i.toml: this cannot be read; "vowel-i" alone names the scenario'),
        (["identify", "ecoflex"], 'did you mean "ecoflex-compression"?'),
        (["design-test", "gerard-2006"], 'no protocol of that name comes with the program; did you mean "gerard-2005"?'),
        (["schema", "datasets"], 'there is no schema of "datasets"; did you mean "dataset"?'),
        (["schema", "dataset", "--answer", "run"], "cannot be combined"),
    ],
)
def test_a_name_that_is_none(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(words) == 2
    assert sentence in capsys.readouterr().err


def test_a_name_that_no_file_can_have_is_read_as_a_file() -> None:
    for name in ("x" * 400 + ".toml", "a\0.toml"):
        assert shipped.scenario_file(name) == Path(name)
    with pytest.raises(InputError):
        prepare("a\0")


@pytest.mark.parametrize("name", shipped.datasets())
def test_a_shipped_dataset_is_whole(name: str) -> None:
    dataset = read_dataset(name)
    assert dataset.name == name
    assert dataset.license
    assert (dataset.path.parent / "ATTRIBUTION.md").is_file()


def test_what_is_listed_is_known_to_the_shell() -> None:
    assert list(LISTS) == list(LISTED)


@pytest.mark.parametrize("kind", FILES)
def test_a_schema_fits_the_files_that_come_with_the_program(kind: str) -> None:
    schema = file_schema(kind)
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    for path in EXAMPLES.get(kind, []):
        validator.validate(toml_of(path.read_text(encoding="utf-8"), path))
    assert not validator.is_valid({"title": 1, "nothing": 2})


def test_the_schema_of_a_dataset_knows_the_keys_of_its_tables() -> None:
    tables = json.loads(json.dumps(file_schema("dataset")))
    stated = toml_of((shipped.datasets()["ecoflex-compression"] / shipped.DATASET_FILE).read_text(encoding="utf-8"), "")
    stated["tool"]["radius"] = 3.0
    assert not Draft202012Validator(tables).is_valid(stated)
    assert tables["$defs"]["MeasuredTool"]["properties"]["radius_mm"]["description"]


def test_tab_offers_names_and_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vowels").mkdir()
    (tmp_path / "vowels" / "o.toml").touch()
    (tmp_path / "vowel-of-mine.TOML").touch()
    (tmp_path / "vowel.txt").touch()
    assert complete_scenario("vowel-i-g") == ["vowel-i-gerard-2005"]
    assert complete_scenario("vowel-of") == ["vowel-of-mine.TOML"]
    assert complete_scenario("vowels") == ["vowels/"]
    assert complete_scenario("vowels/") == ["vowels/o.toml"]
    assert complete_scenario("nowhere/a") == []
    assert complete_scenario_or_dataset("ec") == ["ecoflex-compression"]


def test_a_shell_is_answered(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("_EXPLICITFE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "explicitfe design-test ger")
    monkeypatch.setenv("COMP_CWORD", "2")
    assert command([]) == 0
    assert capsys.readouterr().out.split() == ["gerard-2005"]
