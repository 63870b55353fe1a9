"""``explicitfe measure``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import measure as api
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command(api.measure, without=("result",))
def measure(results: list[Path], *, as_json: bool = False, **options: Any) -> None:
    """Measure results: displacements, grooves, constriction, contact forces, speeds (definitions: docs/reference/measures.md).

    Example: [bold]explicitfe measure outputs/vowel-i.vtkhdf outputs/sl-alone.vtkhdf --at-ms 100[/bold]

    Parameters
    ----------
    results : result files (.vtkhdf), or their names in outputs/.
    """
    with following(console, f"measuring {', '.join(map(str, results))}"):
        from explicitfe.app.view.terminal.measures import measures_table
        from explicitfe.results.files import open_result
        from explicitfe.results.files.ending import note_on_ending
        from explicitfe.results.measure.measure import measure as measure_result

        measured, notes = [], []
        for path in results:
            measured.append(measure_result(path, **options))
            with open_result(path) as result:
                notes += [note] if (note := note_on_ending(result)) else []
    document = {"results": [measures.document for measures in measured]}
    print_answer(document, as_json, lambda: measures_table(measured), notes)
