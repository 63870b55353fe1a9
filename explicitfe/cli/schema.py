"""``explicitfe schema``."""

from __future__ import annotations

from typing import Annotated

import typer

from explicitfe.cli.answer import console, print_json
from explicitfe.cli.completion import complete_words
from explicitfe.cli.file_schemas import FILES, file_schema
from explicitfe.errors import InputError
from explicitfe.view.progress import following


def schema(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="[FILE]",
            help="Of which file: scenario | dataset | protocol (of a planned test) | model (a mesh of your own) | "
            "tissue (constants and effects); scenario if left out.",
            show_default=False,
            autocompletion=complete_words(list(FILES)),
        ),
    ] = None,
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
    """Print the JSON schema of a file that you write, for editors that complete and check TOML.

    Example: [bold]explicitfe schema dataset > dataset.schema.json[/bold]
    """
    if answer is None:
        with following(console, f"making the schema of {kind or 'scenario'}"):
            schema_of_file = file_schema(kind or "scenario")
        print_json(schema_of_file)
    elif kind is None:
        with following(console, f"making the schema of {answer}"):
            from explicitfe.cli.answers import answer_schema

            schema_of_answer = answer_schema(answer.replace(" ", "-"))
        print_json(schema_of_answer)
    else:
        raise InputError("give either a kind of file or --answer, not both.")
