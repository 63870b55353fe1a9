"""``explicitfe identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import inverse
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following


@command(inverse.identify)
def identify(dataset: Path, *, as_json: bool = False, **options: Any) -> None:
    """Fit the constants of a material law to measured force-displacement or stress-stretch curves.

    The default law is Yeoh with two constants; for homogeneous tests all laws are compared with it. --law fits one law alone.

    Example: [bold]explicitfe identify my-dataset --law all --out fit[/bold]
    """
    with following(console, f"reading {dataset}") as progress:
        from explicitfe.app.view.terminal.identify import identification_notes, identification_tables

        identification = inverse.identify(dataset, **options, progress=progress)
    failed = [name for name, group in identification["groups"].items() if group.get("status") == "failed"]
    print_answer(
        identification,
        as_json,
        lambda: identification_tables(identification),
        list(identification_notes(identification)),
        failure=("simulation", f"no constants were identified for {', '.join(map(repr, failed))}") if failed else None,
    )
