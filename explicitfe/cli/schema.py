"""``explicitfe schema``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.cli.answer import print_json


def schema(
    answer: Annotated[
        str | None,
        typer.Option(
            "--answer",
            metavar="COMMAND",
            help="Of what this command prints with --json; or: failure.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Print the JSON schema of scenario files, for editors that complete and check TOML.

    Example: [bold]explicitfe schema > scenario.schema.json[/bold]
    """
    if answer is None:
        from explicitfe.scenario.read import json_schema

        print_json(json_schema())
    else:
        from explicitfe.cli.answers import answer_schema

        print_json(answer_schema(answer.replace(" ", "-")))
