"""The key material of a scenario: a name, or the constants of any law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import AfterValidator, Discriminator, Tag

from explicitfe.materials import LAWS, Law
from explicitfe.scenario.bounds import check_fields


def _law_of(value: object) -> str:
    """Which of the alternatives of the key ``material`` a value is meant for: "name", or the name of a law."""
    if isinstance(value, str):
        return "name"
    law = value.get("law", "yeoh") if isinstance(value, dict) else getattr(value, "law", "yeoh")
    return law if isinstance(law, str) else str(type(law))


if TYPE_CHECKING:
    Material = str | Law
else:
    # A name, or the constants of any law of the table: a new law is possible in scenarios without a line here.
    _alternatives = [Annotated[str, Tag("name")], *(Annotated[law, Tag(name)] for name, (law, _) in LAWS.items())]
    Material = Annotated[Union[tuple(_alternatives)], Discriminator(_law_of), AfterValidator(check_fields)]  # noqa: UP007
