"""``explicitfe blind make`` and ``explicitfe blind score``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.host.extras import require
from explicitfe.view.progress import following

CasesArgument = Annotated[Path, typer.Argument(help="Folder of the test cases.", show_default=False)]


def blind_make(
    folder: CasesArgument,
    seed: Annotated[int, typer.Option("--seed", help="Random seed.")],
    count: Annotated[int, typer.Option("--count", help="Number of cases.")] = 20,
    family: Annotated[str, typer.Option("--family", help="Kind of tests: homogeneous | indentation | foreign.")] = "homogeneous",
    as_json: JsonOption = False,
) -> None:
    """Create blind test cases: datasets in FOLDER/cases, hidden effects in FOLDER/sealed.

    Example: [bold]explicitfe blind make blind --seed 7 --count 20[/bold]
    """
    with following(console, "starting") as progress:
        from explicitfe.blind.make import make

        cases = make(folder, seed=seed, count=count, family=family, progress=progress)
    print_answer(cases, as_json, lambda: Text(f"{cases['count']} cases in {folder}"))


def blind_score(folder: CasesArgument, as_json: JsonOption = False) -> None:
    """Run close-loop on all cases without a report, then compare the verdicts with the hidden effects.

    Example: [bold]explicitfe blind score blind[/bold]
    """
    require("plots", "the picture of the scores")
    with following(console, f"reading {folder}") as progress:
        from explicitfe.blind.score import score

        scores = score(folder, progress=progress)
    print_answer(scores, as_json, lambda: Text((folder / "score.md").read_text(encoding="utf-8")))
