"""``explicitfe list``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.cli.answer import print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.errors import InputError, nearest


def list_(
    what: Annotated[str, typer.Argument(help="models | muscles | scenarios | materials | effects", show_default=False)],
    as_json: JsonOption = False,
) -> None:
    """List what comes with the program.

    Example: [bold]explicitfe list muscles[/bold]
    """
    from explicitfe.run.lists import LISTS
    from explicitfe.view.terminal.program import list_table

    if what not in LISTS:
        raise InputError(f'cannot list "{what}"; {nearest(what, LISTS)}')
    rows = LISTS[what]()
    print_answer({what: rows}, as_json, lambda: list_table(what, rows))
