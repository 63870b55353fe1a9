"""``explicitfe schema``."""

from __future__ import annotations

from explicitfe.app.cli.answer import console, print_json
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_words
from explicitfe.app.cli.file_schemas import FILES, file_schema
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError


@command(kind="[FILE]", completions={"kind": complete_words(FILES)})
def schema(kind: str | None = None, *, answer: str | None = None) -> None:
    """Print the JSON schema of an input file, for editors that complete and validate TOML.

    Example: [bold]explicitfe schema dataset > dataset.schema.json[/bold]

    Parameters
    ----------
    kind : kind of file: scenario | dataset | protocol (of a planned test) | model (of a custom mesh) | tissue (constants and
        effects); by default scenario.
    answer : print the JSON schema of the output of this command, or that of an error with the value failure.
    """
    if answer is None:
        with following(console, f"generating the schema of {kind or 'scenario'}"):
            schema_of_file = file_schema(kind or "scenario")
        print_json(schema_of_file)
    elif kind is None:
        with following(console, f"generating the schema of {answer}"):
            from explicitfe.app.cli.answers import answer_schema

            schema_of_answer = answer_schema(answer.replace(" ", "-"))
        print_json(schema_of_answer)
    else:
        raise InputError("--answer: cannot be combined with a kind of file; give one of them.")
