"""``explicitfe close-loop``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import inverse
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.help import with_flags
from explicitfe.app.view.progress import following

USUAL_MINUTES = 20.0  # a safety limit, several times what the usual number of simulations takes on one core


@command(inverse.close_loop, without=("processes",))
def close_loop(
    dataset: Path,
    *,
    out: Path | None = None,
    simulations: int | None = None,
    minutes: float = USUAL_MINUTES,
    as_json: bool = False,
    **options: Any,
) -> None:
    """Find which effect a model lacks, from measured curves.

    Fit the elastic model, test which effects explain the residual, add them, and report the error on held-out curves.

    Example: [bold]explicitfe close-loop my-dataset --out report[/bold]

    Parameters
    ----------
    out : output folder; by default outputs/close-loop-NAME.
    simulations : number of simulations after which the search ends; by default 4000 for homogeneous tests, 200 for others.
    minutes : safety limit on the time; a verdict that it cuts off depends on the machine.
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.app.view.terminal.close_loop import loop_tables
        from explicitfe.inverse.measured.files import folder_name

        report = inverse.close_loop(
            dataset,
            out=out or Path("outputs") / f"close-loop-{folder_name(dataset)}",
            simulations="usual" if simulations is None else simulations,
            minutes=minutes,
            **options,
            progress=progress,
        )
    print_answer(
        report.document,
        as_json,
        lambda: loop_tables(report.model_copy(update={"sentence": with_flags(report.sentence)})),
        [with_flags(warning) for warning in report.warnings],
        failure=("simulation", with_flags(report.message or report.sentence)) if report.verdict == "failed" else None,
    )
