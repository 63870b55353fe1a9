"""``explicitfe inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption
from explicitfe.view.progress import following


def inspect(result: Annotated[Path, typer.Argument(help="Result file (.vtkhdf).")], as_json: JsonOption = False) -> None:
    """Show what a result holds: status, times, fields, energies, probes, provenance.

    Example: [bold]explicitfe inspect outputs/vowel-i.vtkhdf[/bold]
    """
    with following(console, f"reading {result}"):
        from explicitfe.measure.measure import measures_if_any
        from explicitfe.results import open_result
        from explicitfe.view.terminal.stored import result_table

        with open_result(result) as opened:
            held, measures = opened.contents(), measures_if_any(opened)
    document = {**held, "measures": measures and measures.document}
    print_answer(document, as_json, lambda: result_table(held, measures), held["summary"].get("warnings", []))
