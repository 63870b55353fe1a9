"""Settings of a scenario that several commands take from a tissue model."""

from __future__ import annotations

from pathlib import Path

from explicitfe.platform.errors import InputError


def tissue_settings_of(scenario: Path, model: Path | None, group: str | None) -> tuple[list[str], list[str]]:
    """Settings that apply the tissue of a model file to a scenario, and notes on what the run does not use of it."""
    if model is None:
        if group is not None:
            raise InputError("--tissue-group selects constants of a model file; add --tissue FILE.")
        return [], []
    from explicitfe.inverse.predict.tissue_in_scenario import stored_tissue_settings

    return stored_tissue_settings(scenario, model, group)
