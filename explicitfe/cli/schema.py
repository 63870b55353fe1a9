"""``explicitfe schema``."""

from __future__ import annotations

from explicitfe.cli.answer import print_json


def schema() -> None:
    """Print the JSON schema of scenario files, for editors that complete and check TOML.

    Example: [bold]explicitfe schema > scenario.schema.json[/bold]
    """
    from explicitfe.scenario.read import json_schema

    print_json(json_schema())
