"""``explicitfe verify``."""

from __future__ import annotations

from collections.abc import Sequence

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command(only="--only NAME")
def verify(*, only: Sequence[str] = (), as_json: bool = False) -> None:
    """Compute the validation claims on this machine and compare them with their references (several minutes).

    The claims are those of the page "Is it true?" of the documentation. The exit code is 3 if a claim does not hold.

    Example: [bold]explicitfe verify --only febio --only tubes[/bold]

    Parameters
    ----------
    only : compute only this claim.
    """
    with following(console, "starting") as progress:
        from explicitfe.app.verify.verify import verify as compute_claims
        from explicitfe.app.view.terminal.verify import verification_tables

        verification = compute_claims(only, progress=progress)
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
