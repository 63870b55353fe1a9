"""The key material of a scenario: a name, or the constants of any law that elements support."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag

from explicitfe.fem.inputs.bounds import check_fields
from explicitfe.fem.inputs.extensions import complete, load_installed
from explicitfe.fem.materials import LAWS, Law, law_of
from explicitfe.fem.materials.ogden import Ogden
from explicitfe.platform.errors import InputError

load_installed()
complete("laws")


def _law_of(value: object) -> str:
    """The alternative of the key ``material`` that a value selects: "name", or the name of a law."""
    if isinstance(value, str):
        return "name"
    law = value.get("law", "yeoh") if isinstance(value, dict) else getattr(value, "law", "yeoh")
    return law if isinstance(law, str) else str(type(law))


def _refuse_ogden(value: object) -> object:
    """Refuse the law that exists but not in elements, with its reason."""
    law = Ogden.model_fields["law"].default
    if _law_of(value) == law:
        try:
            law_of(law)
        except InputError as error:
            raise ValueError(str(error)) from None
    return value


if TYPE_CHECKING:
    Material = str | Law
else:
    # A name, or the constants of any law of the table: a new law is possible in scenarios without a line here.
    _alternatives = [Annotated[str, Tag("name")], *(Annotated[law, Tag(name)] for name, (law, _) in LAWS.items())]
    _of_law = Annotated[Union[tuple(_alternatives)], Discriminator(_law_of), AfterValidator(check_fields)]  # noqa: UP007
    Material = Annotated[_of_law, BeforeValidator(_refuse_ogden)]
