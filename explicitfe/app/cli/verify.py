"""``explicitfe verify``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption
from explicitfe.app.view.progress import following


def verify(
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="NAME", help="Compute only this claim; can be repeated.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the validation claims on this machine and compare them with their references (several minutes).

    The claims are those of the page "Is it true?" of the documentation. The exit code is 3 if a claim does not hold.

    Example: [bold]explicitfe verify --only febio --only tubes[/bold]
    """
    with following(console, "starting") as progress:
        from explicitfe.app.verify.verify import verify as compute_claims
        from explicitfe.app.view.terminal.verify import verification_tables

        verification = compute_claims(only or (), progress=progress)
    broken = [row["name"] for row in verification["claims"] if not row["holds"]]
    count = f"{len(broken)} of {len(verification['claims'])} claims"
    print_answer(
        verification,
        as_json,
        lambda: verification_tables(verification),
        failure=("check", f"{count} do not hold on this machine: {', '.join(broken)}. See the table for the deviations.")
        if broken
        else None,
    )
