"""Arguments and options shared by several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from explicitfe.app.cli.completion import complete_dataset, complete_result, complete_scenario
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.result_files import SWEEP_FILE, find_result

ScenarioArgument = Annotated[
    Path,
    typer.Argument(
        help="Scenario file (TOML), or a name from `explicitfe list scenarios`.",
        show_default=False,
        autocompletion=complete_scenario,
    ),
]
DatasetArgument = Annotated[
    Path,
    typer.Argument(
        help="Folder of a dataset, or a name from `explicitfe list datasets`.",
        show_default=False,
        autocompletion=complete_dataset,
    ),
]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set a value of the scenario; repeat for several values."),
]
TissueOption = Annotated[
    Path | None,
    typer.Option(
        "--tissue",
        metavar="MODEL",
        help="Tissue model file whose constants and effects replace those of the scenario.",
        show_default=False,
    ),
]
TissueGroupOption = Annotated[
    str | None,
    typer.Option(
        "--tissue-group", metavar="NAME", help="Group of constants in the model file, if it has several.", show_default=False
    ),
]
OutOption = Annotated[Path, typer.Option("--out", metavar="DIR", help="Output folder.")]
PicturesFolderOption = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Output folder.", show_default="folder of the result")
]
OverwriteFilesOption = Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else.")]


def _find(given: Path | list[Path] | None) -> Path | list[Path] | None:
    """Replace names of results by their paths; a list has several."""
    if given is None:
        return None
    return find_result(given) if isinstance(given, Path) else [find_result(path) for path in given]


def result_argument(help_text: str = "Result file (.vtkhdf), or its name in outputs/.") -> Any:
    """Argument of type Path or list[Path] that takes result files or names of results in the output folder."""
    return typer.Argument(help=help_text, show_default=False, callback=_find, autocompletion=complete_result)


ResultArgument = Annotated[Path, result_argument()]


def is_sweep(path: Path) -> bool:
    """Whether a path is the folder of a sweep."""
    return (path / SWEEP_FILE).is_file()


def tissue_settings_of(scenario: Path, model: Path | None, group: str | None) -> tuple[list[str], list[str]]:
    """Settings that apply the tissue of a model file to a scenario, and notes on what the run does not use of it."""
    if model is None:
        if group is not None:
            raise InputError("--tissue-group selects constants of a model file; add --tissue FILE.")
        return [], []
    from explicitfe.inverse.predict.tissue_in_scenario import stored_tissue_settings

    return stored_tissue_settings(scenario, model, group)
