"""The compiled entry points for a law, an element and effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType

from explicitfe.compiled.jit import bind, kernel
from explicitfe.effects.effect import MaterialEffect
from explicitfe.elements import full
from explicitfe.elements import hourglass_stiffness as stiffness
from explicitfe.elements import hourglass_strain as assumed_strain
from explicitfe.forces import internal, internal_full, response
from explicitfe.materials import law_of
from explicitfe.solve import relax_step, step


@dataclass(frozen=True)
class Kernels:
    """The compiled entry points for one material law."""

    forces: object
    advance: object
    snapshot: object
    largest_strain_rate: object
    relax: object
    elastic_energy: object
    press: object
    touch: object


# An element: the templates of its forces, and its hourglass treatment or Gauss points. The first is the default.
ELEMENTS: dict[str, tuple[ModuleType, ModuleType]] = {
    "hex8": (internal, assumed_strain),
    "hex8-stiffness": (internal, stiffness),
    "hex8-full": (internal_full, full),
}


def kernels(law: str, element: str, effects: tuple[tuple[str, tuple[int, ...], int, int], ...] = ()) -> Kernels:
    """Kernels with the leaves of a law, an element and effects bound in (``response.bound`` says how the latter are given).

    Compiled at the first call, kept on disk for the next process.
    """
    return _kernels(law, element, effects)


@cache  # which would tell a default from the same value given
def _kernels(law: str, element: str, effects: tuple[tuple[str, tuple[int, ...], int, int], ...]) -> Kernels:
    templates, treatment = ELEMENTS[element]
    force, energy = templates.bound(law_of(law), treatment, effects)
    return Kernels(
        forces=bind(step.forces, internal_force=force),
        advance=bind(step.advance, internal_force=force),
        snapshot=bind(step.snapshot, internal_energy=energy),
        largest_strain_rate=kernel(internal.largest_strain_rate),
        relax=bind(relax_step.relax, internal_force=force),
        elastic_energy=bind(step.elastic_energy, internal_energy=energy),
        press=kernel(relax_step.press),
        touch=kernel(relax_step.touch),
    )


def layout_of(effects: Sequence[MaterialEffect]) -> tuple[tuple[str, tuple[int, ...], int, int], ...]:
    """Where the numbers and the memory of each effect begin; before them, where there are any, the work of the stress.

    Raises
    ------
    ValueError : an effect is there twice.
    """
    if len({type(effect) for effect in effects}) < len(effects):
        raise ValueError("an effect of the material can be there once only")
    layout: list[tuple[str, tuple[int, ...], int, int]] = []
    at, memory = 0, response.WORK_MEMORY
    for effect in effects:
        layout.append((type(effect).__name__, effect.shape, at, memory))
        at, memory = at + effect.numbers, memory + effect.memory
    return (("work", (), 0, 0), *layout) if layout else ()
