"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.completion import complete_dataset, complete_scenario
from explicitfe.errors import InputError

ScenarioArgument = Annotated[
    Path,
    typer.Argument(
        help="Scenario file (TOML), or the name of one that `explicitfe list scenarios` shows.",
        show_default=False,
        autocompletion=complete_scenario,
    ),
]
DatasetArgument = Annotated[
    Path,
    typer.Argument(
        help="Folder of a dataset, or the name of one that `explicitfe list datasets` shows.",
        show_default=False,
        autocompletion=complete_dataset,
    ),
]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value of the scenario; repeat for more."),
]
TissueOption = Annotated[
    Path | None,
    typer.Option(
        "--tissue", metavar="MODEL", help="Model file whose constants and effects replace the scenario's.", show_default=False
    ),
]
TissueGroupOption = Annotated[
    str | None,
    typer.Option("--tissue-group", metavar="NAME", help="Group of its constants, if there are several.", show_default=False),
]
SWEEP_FILE = "sweep.json"  # a folder that holds it is a sweep
OutOption = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the result.")]
ResultArgument = Annotated[Path, typer.Argument(help="Result file (.vtkhdf).", show_default=False)]
PicturesFolderOption = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder of the files; beside the result if left out.")
]
OverwriteFilesOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, nothing else there.")]


def is_sweep(path: Path) -> bool:
    """Whether a path is the folder of a sweep, and no result."""
    return (path / SWEEP_FILE).is_file()


def tissue_settings_of(scenario: Path, model: Path | None, group: str | None) -> tuple[list[str], list[str]]:
    """Settings that put the tissue of a model file into a scenario, and notes of what it has and the run does not."""
    if model is None:
        if group is not None:
            raise InputError("--tissue-group names constants of a model file; give it with --tissue.")
        return [], []
    from explicitfe.predict.tissue_in_scenario import stored_tissue_settings

    return stored_tissue_settings(scenario, model, group)
