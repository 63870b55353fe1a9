"""``explicitfe list``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.app.cli.answer import print_answer
from explicitfe.app.cli.completion import complete_words
from explicitfe.app.cli.options import JsonOption
from explicitfe.platform.errors import InputError, nearest

# Repeated here, so that completion in a shell need not import the lists.
LISTED = ("models", "muscles", "scenarios", "datasets", "protocols", "materials", "effects")


def list_(
    what: Annotated[
        str,
        typer.Argument(
            help="Kind of objects: " + " | ".join(LISTED) + ".", show_default=False, autocompletion=complete_words(LISTED)
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """List built-in models, muscles, scenarios, datasets, protocols, materials or effects.

    Example: [bold]explicitfe list muscles[/bold]
    """
    from explicitfe.app.tools.lists import LISTS
    from explicitfe.app.view.terminal.program import ListTable

    if what not in LISTS:
        raise InputError(f'cannot list "{what}"; {nearest(what, LISTS)}')
    rows = LISTS[what]()
    print_answer({what: rows}, as_json, lambda: ListTable(what, rows))
