"""The key material of a scenario: a name, or the constants of any law."""

from __future__ import annotations

from typing import Annotated, Any, Union

from pydantic import Discriminator, Tag

from explicitfe.materials import LAWS


def law_of(value: Any) -> str:
    if isinstance(value, str):
        return "name"
    return value.get("law", "yeoh") if isinstance(value, dict) else getattr(value, "law", "yeoh")


# A name, or the constants of any law of the table: a new law is possible in scenarios without a word here.
_kinds = [Annotated[str, Tag("name")], *(Annotated[law, Tag(name)] for name, (law, _) in LAWS.items())]


Material = Annotated[Union[tuple(_kinds)], Discriminator(law_of)]  # noqa: UP007
