"""``explicitfe sweep``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from explicitfe.app.api import sweep as api
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.tissue_settings import tissue_settings_of
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import stopping


@command(
    api.sweep,
    api.SweepDesign,
    api.SweepExecution,
    without=("design", "execution", "executor"),
    keep="--keep WHICH",
    only="--only K/N",
    retry="--retry failed",
)
def sweep(
    scenario: Path,
    *,
    settings: Sequence[str] = (),
    retry: str | None = None,
    tissue: Path | None = None,
    tissue_group: str | None = None,
    list_runs: bool = False,
    as_json: bool = False,
    **options: Any,
) -> None:
    """Run a parameter sweep and tabulate the results. Rerun the same command to resume an interrupted sweep.

    Example: [bold]explicitfe sweep vowel-i --vary muscle.GGp.force_N=0:4:9 --set model.resolution=coarse[/bold]

    Parameters
    ----------
    vary : values LOW:HIGH:N or a,b,c, or a range LOW:HIGH for random designs.
    measures : tabulate only this group of measures, such as points.
    processes : number of local worker processes; by default the number of cores.
    list_runs : list the runs without a stored row; compute none.
    """
    if retry not in (None, "failed"):
        raise InputError(f"--retry {retry}: the only valid value is failed.")
    with following(console, f"reading {scenario}") as progress:
        from explicitfe.app.view.terminal.sweep import runs_table, sweep_table

        tissue_settings, _ = tissue_settings_of(scenario, tissue, tissue_group)
        runs = api.sweep(scenario, settings=[*tissue_settings, *settings], retry=retry is not None, **options)
        stopped = ""
        if not list_runs:
            try:
                for _ in runs.computed(progress):
                    pass
            except stopping.Stopped as signal:
                stopped = f"{signal}; all finished runs are stored: rerun the same command to resume"
            summary = runs.finish()
    if list_runs:
        listed = runs.listed()
        print_answer(listed, as_json, lambda: runs_table(listed))
    else:
        print_answer(summary, as_json, lambda: sweep_table(summary), failure=("stopped", stopped) if stopped else None)
