"""``explicitfe check``."""

from __future__ import annotations

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import (
    JsonOption,
    ScenarioArgument,
    SettingsOption,
    TissueGroupOption,
    TissueOption,
    tissue_settings_of,
)
from explicitfe.view.progress import following


def check(
    scenario: ScenarioArgument,
    settings: SettingsOption = None,
    tissue: TissueOption = None,
    tissue_group: TissueGroupOption = None,
    as_json: JsonOption = False,
) -> None:
    """Validate and build a scenario without running it: mesh quality, stable step, steps, wall time, memory.

    Example: [bold]explicitfe check scenarios/vowel-i.toml --set model.resolution=fine[/bold]
    """
    with following(console, f"reading {scenario}") as progress:
        from explicitfe.run.prepare import prepare

        tissue_settings, notes = tissue_settings_of(scenario, tissue, tissue_group)
        analysis = prepare(scenario, [*tissue_settings, *(settings or ())], notes)
        report = analysis.check(progress)
    print_answer(report, as_json, lambda: analysis.check_table(report), report["warnings"])
