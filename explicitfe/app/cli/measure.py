"""``explicitfe measure``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption, result_argument
from explicitfe.app.view.progress import following


def measure(
    results: Annotated[list[Path], result_argument("Result files (.vtkhdf), or their names in outputs/.")],
    at_ms: Annotated[float | None, typer.Option("--at-ms", metavar="T", help="Time in ms.", show_default="the last time")] = None,
    formants: Annotated[bool, typer.Option("--formants", help="Also measure the airway and the formants F1 to F3.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure results: displacements, grooves, constriction, contact forces, speeds (definitions: docs/reference/measures.md).

    Example: [bold]explicitfe measure outputs/vowel-i.vtkhdf outputs/sl-alone.vtkhdf --at-ms 100[/bold]
    """
    with following(console, f"measuring {', '.join(map(str, results))}"):
        from explicitfe.app.view.terminal.measures import measures_table
        from explicitfe.results.files import open_result
        from explicitfe.results.files.ending import note_on_ending
        from explicitfe.results.measure.measure import measure as measures_of_file

        measured, notes = [], []
        for path in results:
            measured.append(measures_of_file(path, None if at_ms is None else 1e-3 * at_ms, formants))
            with open_result(path) as result:
                notes += [note] if (note := note_on_ending(result)) else []
    document = {"results": [measures.document for measures in measured]}
    print_answer(document, as_json, lambda: measures_table(measured), notes)
