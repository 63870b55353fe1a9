"""``explicitfe check``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_scenario_or_dataset
from explicitfe.app.cli.tissue_settings import tissue_settings_of
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError
from explicitfe.platform.host.shipped import is_dataset


@command(file="SCENARIO|DATASET", completions={"file": complete_scenario_or_dataset})
def check(
    file: Path,
    *,
    settings: Sequence[str] = (),
    tissue: Path | None = None,
    tissue_group: str | None = None,
    as_json: bool = False,
) -> None:
    """Validate a scenario or a dataset without computing it.

    For a scenario, the model is built; mesh quality, stable time step, number of steps, wall time and memory are reported. For a
    dataset, the curves, the fitted and the held-out ones, and the effects that they can show are reported.

    Example: [bold]explicitfe check vowel-i --set model.resolution=fine[/bold]

    Parameters
    ----------
    file : scenario file (TOML), folder of a dataset, or a name from ``explicitfe list``.
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
        analysis = prepare(file, [*tissue_settings, *settings], notes)
        report = analysis.check(progress)
        from explicitfe.app.view.terminal.kinds import KINDS

        tables = KINDS[analysis.scenario.analysis.type]
    print_answer(report, as_json, lambda: tables.check_table(str(analysis.path), report), report["warnings"])
