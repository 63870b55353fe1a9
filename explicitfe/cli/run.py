"""``explicitfe run``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import (
    JsonOption,
    OutOption,
    ScenarioArgument,
    SettingsOption,
    TissueGroupOption,
    TissueOption,
    tissue_settings_of,
)
from explicitfe.view.progress import following


def run(
    scenario: ScenarioArgument,
    out: OutOption = Path("outputs"),
    settings: SettingsOption = None,
    tissue: TissueOption = None,
    tissue_group: TissueGroupOption = None,
    plots: Annotated[bool, typer.Option("--plots", help="Draw the run as PNG beside the result.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a result that exists.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Run a scenario and store its result as one .vtkhdf file.

    Example: [bold]explicitfe run scenarios/vowel-i.toml --set muscle.GGp.force_N=1.5 --out outputs --plots[/bold]
    """
    from explicitfe.run.prepare import prepare
    from explicitfe.run.run import result_path

    tissue_settings, notes = tissue_settings_of(scenario, tissue, tissue_group)
    with following(console) as progress:
        analysis = prepare(scenario, [*tissue_settings, *(settings or ())], notes)
        summary = analysis.run(result_path(scenario, out), overwrite=overwrite, progress=progress)
        if plots:
            progress("draw", 0.0)
            summary["plots"] = [str(path) for path in analysis.draw(Path(summary["result"]))]
            progress("draw", 1.0)
    print_answer(summary, as_json, lambda: analysis.table(summary), summary["warnings"])
    if summary["status"] != "finished":
        console.print(f"[red]{summary['status']}[/red]: {escape(summary['message'])}", soft_wrap=True, highlight=False)
        raise typer.Exit(130 if summary["status"] == "interrupted" else 1)
