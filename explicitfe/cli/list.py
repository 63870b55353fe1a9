"""``explicitfe list``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.cli.answer import print_answer
from explicitfe.cli.completion import complete_words
from explicitfe.cli.options import JsonOption
from explicitfe.errors import InputError, nearest

# Known here too, so that a shell need not wait for what the lists are made from.
LISTED = ("models", "muscles", "scenarios", "datasets", "protocols", "materials", "effects")


def list_(
    what: Annotated[str, typer.Argument(help=" | ".join(LISTED), show_default=False, autocompletion=complete_words(LISTED))],
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
