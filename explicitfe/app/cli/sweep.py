"""``explicitfe sweep``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.grouped import with_options
from explicitfe.app.cli.options import (
    JsonOption,
    ScenarioArgument,
    SettingsOption,
    TissueGroupOption,
    TissueOption,
    tissue_settings_of,
)
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import stopping

RETRIES = ("failed",)


@dataclass(frozen=True)
class SweepOptions:
    """Options of ``explicitfe sweep``."""

    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary", metavar="KEY=VALUES", help="Values LOW:HIGH:N or a,b,c, or a range LOW:HIGH for random designs; repeatable."
        ),
    ] = None
    random: Annotated[
        int | None, typer.Option("--random", metavar="N", help="Draw N random samples instead of a grid.", show_default=False)
    ] = None
    sobol: Annotated[
        int | None,
        typer.Option("--sobol", metavar="N", help="Sobol indices from N x (factors + 2) runs.", show_default=False),
    ] = None
    morris: Annotated[
        int | None,
        typer.Option(
            "--morris", metavar="N", help="Elementary effects (Morris) from N x (factors + 1) runs.", show_default=False
        ),
    ] = None
    table: Annotated[
        Path | None,
        typer.Option(
            "--table",
            metavar="CSV",
            help="Read the samples from a CSV file with one column per key and one row per run.",
            show_default=False,
        ),
    ] = None
    seed: Annotated[int, typer.Option("--seed", metavar="S", help="Random seed.")] = 0
    settings: SettingsOption = None
    tissue: TissueOption = None
    tissue_group: TissueGroupOption = None
    measures: Annotated[
        list[str] | None,
        typer.Option("--measure", metavar="NAME", help="Tabulate only this group of measures, such as points; repeatable."),
    ] = None
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder of the sweep.", show_default="outputs/sweep-NAME"),
    ] = None
    keep: Annotated[str, typer.Option("--keep", metavar="WHICH", help="Result files to keep: none, all, failed or every:N.")] = (
        "none"
    )
    retry: Annotated[str | None, typer.Option("--retry", metavar="failed", help="Recompute failed runs.", show_default=False)] = (
        None
    )
    only: Annotated[
        str | None,
        typer.Option("--only", metavar="K/N", help="Compute only the K-th of N shares, for parallel jobs.", show_default=False),
    ] = None
    list_runs: Annotated[bool, typer.Option("--list", help="List the runs without a stored row; compute none.")] = False
    processes: Annotated[
        int | None,
        typer.Option("--processes", metavar="P", help="Number of local worker processes.", show_default="number of cores"),
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="ADDRESS",
            help="Address of a Dask scheduler that distributes the runs, such as tcp://HOST:8786.",
        ),
    ] = None
    as_json: JsonOption = False


@with_options(SweepOptions)
def sweep(scenario: ScenarioArgument, options: SweepOptions) -> None:
    """Run a parameter sweep and tabulate the results. Rerun the same command to resume an interrupted sweep.

    Example: [bold]explicitfe sweep vowel-i --vary muscle.GGp.force_N=0:4:9 --set model.resolution=coarse[/bold]
    """
    if options.retry is not None and options.retry not in RETRIES:
        raise InputError(f"--retry {options.retry}: the only valid value is failed.")
    with following(console, f"reading {scenario}") as progress:
        from explicitfe.app.view.terminal.sweep import runs_table, sweep_table
        from explicitfe.simulate.sweep.rows import USUAL_PARTS
        from explicitfe.simulate.sweep.sweep import sweep as sweep_of

        tissue_settings, _ = tissue_settings_of(scenario, options.tissue, options.tissue_group)
        runs = sweep_of(
            scenario,
            options.vary or (),
            out=options.out,
            random=options.random,
            sobol=options.sobol,
            morris=options.morris,
            table=options.table,
            seed=options.seed,
            settings=[*tissue_settings, *(options.settings or ())],
            measures=options.measures or USUAL_PARTS,
            keep=options.keep,
            retry=options.retry is not None,
            only=options.only,
            processes=options.processes,
            scheduler=options.scheduler,
        )
        stopped = ""
        if not options.list_runs:
            try:
                for _ in runs.computed(progress):
                    pass
            except stopping.Stopped as signal:
                stopped = f"{signal}; all finished runs are stored: rerun the same command to resume"
            summary = runs.finish()
    if options.list_runs:
        listed = runs.listed()
        print_answer(listed, options.as_json, lambda: runs_table(listed))
    else:
        print_answer(summary, options.as_json, lambda: sweep_table(summary), failure=("stopped", stopped) if stopped else None)
