"""``explicitfe list``."""

from __future__ import annotations

from explicitfe.app.cli.answer import print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_words
from explicitfe.platform.errors import InputError, nearest

# Repeated here, so that completion in a shell need not import the lists.
LISTED = ("models", "muscles", "scenarios", "datasets", "protocols", "materials", "effects")


@command(completions={"what": complete_words(LISTED)})
def list_(what: str, *, as_json: bool = False) -> None:
    """List built-in models, muscles, scenarios, datasets, protocols, materials or effects.

    Example: [bold]explicitfe list muscles[/bold]

    Parameters
    ----------
    what : kind of objects: models | muscles | scenarios | datasets | protocols | materials | effects.
    """
    from explicitfe.app.tools.lists import LISTS
    from explicitfe.app.view.terminal.program import ListTable

    if what not in LISTS:
        raise InputError(f'cannot list "{what}"; {nearest(what, LISTS)}')
    rows = LISTS[what]()
    print_answer({what: rows}, as_json, lambda: ListTable(what, rows))
