"""The page of the command line, generated from ``explicitfe COMMAND --help``."""

from __future__ import annotations

import re

HEAD = """# The command line

This page is generated from the `--help` text of every command. For exit codes and `--json` see
[Exit codes and JSON](commands.md).

"""
_BOLD = re.compile(r"\[bold\](.*?)\[/bold\]", re.S)
_LIST_OF_COMMANDS = re.compile(r"^\*\*Commands\*\*:\n\n(?:\* .*\n)+\n", re.M)
_HEADING = re.compile(r"^(#+) `explicitfe ?(.*?)`$", re.M)


def command_page() -> str:
    """Markdown of all commands, one heading per command."""
    import typer
    from typer.cli import get_docs_for_click

    from explicitfe.app.cli.app import app

    command = typer.main.get_command(app)
    text = get_docs_for_click(obj=command, ctx=typer.Context(command, info_name="explicitfe"), name="explicitfe")
    text = _BOLD.sub(lambda match: f"`{' '.join(match[1].split())}`", text)
    text = _LIST_OF_COMMANDS.sub("", text)  # its texts are truncated, and the sections follow
    text = _HEADING.sub(lambda match: f"{match[1]} {match[2] or 'explicitfe'}", text)
    return HEAD + text.partition("\n")[2].replace("```console\n$ ", "```text\n").replace("](docs/reference/", "](")
