"""``explicitfe inspect``."""

from __future__ import annotations

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.options import JsonOption, ResultArgument
from explicitfe.app.view.progress import following


def inspect(result: ResultArgument, as_json: JsonOption = False) -> None:
    """Show the contents of a result: status, times, fields, energies, probes, provenance.

    Example: [bold]explicitfe inspect vowel-i[/bold]
    """
    with following(console, f"reading {result}"):
        from explicitfe.app.view.terminal.stored import result_table
        from explicitfe.results.files import open_result
        from explicitfe.results.measure.measure import measures_if_any

        with open_result(result) as opened:
            held, measures = opened.contents(), measures_if_any(opened)
    document = {**held, "measures": measures and measures.document}
    print_answer(document, as_json, lambda: result_table(held, measures), held["summary"].get("warnings", []))
