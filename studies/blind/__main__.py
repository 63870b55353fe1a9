"""Command line of the blind study.

    python -m studies.blind make FOLDER --seed N [--count N] [--family homogeneous|indentation|foreign]
    python -m studies.blind score FOLDER

``make`` draws datasets with hidden effects; ``score`` closes the loop on each and compares the verdicts with what is hidden.
"""

from __future__ import annotations

import sys
from pathlib import Path

import typer
from rich.console import Console

from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError
from studies.blind.make import make
from studies.blind.score import score

app = typer.Typer(
    help="Test close-loop on simulated data with hidden effects.", add_completion=False, pretty_exceptions_enable=False
)
console = Console()


@app.command("make")
def make_cases(folder: Path, seed: int = typer.Option(...), count: int = 20, family: str = "homogeneous") -> None:
    """Create blind test cases: datasets in FOLDER/cases, hidden effects in FOLDER/sealed."""
    with following(console, "starting") as progress:
        cases = make(folder, seed=seed, count=count, family=family, progress=progress)
    console.print(f"{cases['count']} cases in {folder}")


@app.command("score")
def score_cases(folder: Path) -> None:
    """Run close-loop on all cases without a report, then compare the verdicts with the hidden effects."""
    with following(console, f"reading {folder}") as progress:
        score(folder, progress=progress)
    console.print((folder / "score.md").read_text(encoding="utf-8"))


def main(words: list[str] | None = None) -> int:
    """Run the command; return its exit code, 2 for an input that cannot be used."""
    try:
        app(words, standalone_mode=False)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
