"""The table [effects] of a scenario: one key an effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import AfterValidator, Field, create_model

from explicitfe.fem.effects import EFFECTS, Effect
from explicitfe.fem.inputs.bounds import check_fields
from explicitfe.fem.inputs.extensions import complete, load_installed
from explicitfe.fem.inputs.table import Table

load_installed()
complete("effects")


class EffectsBase(Table):
    """What the elastic model lacks, each by its name."""

    @property
    def chosen(self) -> tuple[Effect, ...]:
        """The effects that the table states, in its order."""
        return tuple(effect for effect in vars(self).values() if effect is not None)

    def without(self, effects: Sequence[Effect]) -> Self:
        """The table without these effects."""
        names = [name for name in type(self).model_fields if any(getattr(self, name) is effect for effect in effects)]
        return self.model_copy(update=dict.fromkeys(names))


if TYPE_CHECKING:
    EffectsTable = EffectsBase
else:
    # One key an effect: a new effect is possible in scenarios without a line here. Names have dashes, attributes cannot.
    EffectsTable = create_model(
        "EffectsTable",
        __base__=EffectsBase,
        **{
            name.replace("-", "_"): (
                Annotated[kind | None, AfterValidator(check_fields)],
                Field(default=None, alias=name, description=kind.about.title),
            )
            for name, kind in EFFECTS.items()
        },
    )
