"""Helpers of several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.platform.errors import InputError
from explicitfe.platform.host.result_files import SWEEP_FILE

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else.")]


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
