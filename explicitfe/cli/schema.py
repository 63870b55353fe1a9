"""``explicitfe schema``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_json
from explicitfe.view.progress import following


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
        with following(console, f"making the schema of {answer}"):
            from explicitfe.cli.answers import answer_schema

            schema_of_answer = answer_schema(answer.replace(" ", "-"))
        print_json(schema_of_answer)
