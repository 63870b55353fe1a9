"""``explicitfe check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.completion import complete_scenario_or_dataset
from explicitfe.app.cli.options import JsonOption, SettingsOption, TissueGroupOption, TissueOption, tissue_settings_of
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.shipped import is_dataset


def check(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="SCENARIO|DATASET",
            help="Scenario file (TOML), folder of a dataset, or a name from `explicitfe list`.",
            show_default=False,
            autocompletion=complete_scenario_or_dataset,
        ),
    ],
    settings: SettingsOption = None,
    tissue: TissueOption = None,
    tissue_group: TissueGroupOption = None,
    as_json: JsonOption = False,
) -> None:
    """Validate a scenario or a dataset without computing it.

    For a scenario, the model is built; mesh quality, stable time step, number of steps, wall time and memory are reported. For a
    dataset, the curves, the fitted and the held-out ones, and the effects that they can show are reported.

    Example: [bold]explicitfe check vowel-i --set model.resolution=fine[/bold]
    """
    if is_dataset(file):
        if settings or tissue is not None or tissue_group is not None:
            raise InputError(f"{file}: --set, --tissue and --tissue-group are for scenarios, and this is a dataset; omit them.")
        with following(console, f"reading {file}"):
            from explicitfe.app.view.terminal.dataset import dataset_check_tables
            from explicitfe.inverse.close_loop.outlook import check_dataset

            checked = check_dataset(file)
        print_answer(checked, as_json, lambda: dataset_check_tables(checked), checked["warnings"])
        return
    with following(console, f"reading {file}") as progress:
        from explicitfe.simulate.run.prepare import prepare

        tissue_settings, notes = tissue_settings_of(file, tissue, tissue_group)
        analysis = prepare(file, [*tissue_settings, *(settings or ())], notes)
        report = analysis.check(progress)
        from explicitfe.app.view.terminal.kinds import KINDS

        tables = KINDS[analysis.scenario.analysis.type]
    print_answer(report, as_json, lambda: tables.check_table(str(analysis.path), report), report["warnings"])
