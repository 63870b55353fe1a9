"""``explicitfe sweep``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import (
    JsonOption,
    ScenarioArgument,
    SettingsOption,
    TissueGroupOption,
    TissueOption,
    tissue_settings_of,
)
from explicitfe.errors import InputError
from explicitfe.host import stopping
from explicitfe.view.progress import following

RETRIES = ("failed",)


def sweep(
    scenario: ScenarioArgument,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="KEY=VALUES", help="LOW:HIGH:N, LOW:HIGH (a range) or a,b,c; repeat for more."),
    ] = None,
    random: Annotated[
        int | None, typer.Option("--random", metavar="N", help="N random draws instead of a grid.", show_default=False)
    ] = None,
    sobol: Annotated[
        int | None,
        typer.Option("--sobol", metavar="N", help="N times (factors + 2) members for Sobol indices.", show_default=False),
    ] = None,
    morris: Annotated[
        int | None,
        typer.Option("--morris", metavar="N", help="N times (factors + 1) members for elementary effects.", show_default=False),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", metavar="CSV", help="Members from a table, a column for each key.", show_default=False),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="S", help="Of what is drawn.")] = 0,
    settings: SettingsOption = None,
    tissue: TissueOption = None,
    tissue_group: TissueGroupOption = None,
    measures: Annotated[
        list[str] | None,
        typer.Option("--measure", metavar="NAME", help="Only these measures, such as points; repeat for more."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder of the sweep; outputs/sweep-NAME if left out.", show_default=False),
    ] = None,
    keep: Annotated[str, typer.Option("--keep", metavar="WHICH", help="Result files: none, all, failed or every:N.")] = "none",
    retry: Annotated[
        str | None, typer.Option("--retry", metavar="failed", help="Compute members again that failed.", show_default=False)
    ] = None,
    only: Annotated[
        str | None,
        typer.Option("--only", metavar="K/N", help="Only the K-th of N shares, for jobs beside each other.", show_default=False),
    ] = None,
    list_members: Annotated[bool, typer.Option("--list", help="List the members that have no row yet; compute none.")] = False,
    processes: Annotated[
        int | None,
        typer.Option("--processes", metavar="P", help="Of this machine; as many as it has cores.", show_default=False),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Compute on a Dask cluster, such as tcp://HOST:8786."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute many members of a scenario, and make one table of their measures; given again, it goes on where it ended.

    Example: [bold]explicitfe sweep vowel-i --vary muscle.GGp.force_N=0:4:9 --set model.resolution=coarse[/bold]
    """
    if retry is not None and retry not in RETRIES:
        raise InputError(f"--retry {retry}: the only choice is failed.")
    with following(console, f"reading {scenario}") as progress:
        from explicitfe.sweep.rows import USUAL_PARTS
        from explicitfe.sweep.sweep import sweep as sweep_of
        from explicitfe.view.terminal.sweep import members_table, sweep_table

        tissue_settings, _ = tissue_settings_of(scenario, tissue, tissue_group)
        members = sweep_of(
            scenario,
            vary or (),
            out=out,
            random=random,
            sobol=sobol,
            morris=morris,
            table=table,
            seed=seed,
            settings=[*tissue_settings, *(settings or ())],
            measures=measures or USUAL_PARTS,
            keep=keep,
            retry=retry is not None,
            only=only,
            processes=processes,
            scheduler=scheduler,
        )
        stopped = ""
        if not list_members:
            try:
                for _ in members.computed(progress):
                    pass
            except stopping.Stopped as signal:
                stopped = f"{signal}; all rows that came back are stored: give the same command again to go on"
            summary = members.finish()
    if list_members:
        listed = members.listed()
        print_answer(listed, as_json, lambda: members_table(listed))
    else:
        print_answer(summary, as_json, lambda: sweep_table(summary), failure=("stopped", stopped) if stopped else None)
