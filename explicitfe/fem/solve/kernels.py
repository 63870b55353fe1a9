"""The compiled entry points for a law, an element and effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from explicitfe.fem.elements import full
from explicitfe.fem.elements import hourglass_stiffness as stiffness
from explicitfe.fem.elements import hourglass_strain as assumed_strain
from explicitfe.fem.forces import apart, internal, internal_full, surfaces
from explicitfe.fem.forces.response import Layout
from explicitfe.fem.materials import law_of
from explicitfe.fem.solve import course, look, relax_step, restraint, step
from explicitfe.platform.compiled.arrays import Addresses, Blocks, Contact
from explicitfe.platform.compiled.jit import Dispatcher, bind, kernel
from explicitfe.platform.compiled.pieces import Piece, address_of, compile_pieces, typeof


@dataclass(frozen=True)
class Kernels:
    """The compiled entry points for one material law, element and set of effects; what each is given stands where it is written.

    Attributes
    ----------
    forces, elastic_energy : of ``solve/step.py``.
    course, gather : of ``solve/course.py``.
    scan, highest_frequency : of ``solve/look.py``.
    relax, press, touch : of ``solve/relax_step.py``.
    """

    forces: Dispatcher
    course: Dispatcher
    gather: Dispatcher
    scan: Dispatcher
    highest_frequency: Dispatcher
    relax: Callable[..., int]
    elastic_energy: Callable[[np.ndarray, Blocks, np.ndarray, np.ndarray, np.ndarray], tuple[float, float, float, float]]
    press: Callable[[np.ndarray, np.ndarray, Contact, np.ndarray], float]
    touch: Callable[[np.ndarray, Contact, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]
    known: list[Addresses] = field(default_factory=list, compare=False)

    def addresses(self, arguments: tuple[Any, ...]) -> Addresses:
        """Addresses of the pieces that a course with these arguments calls, whose span may have any.

        They are compiled with it, and with ``forces``, where that has not been done.
        """
        if not self.known:
            signature = tuple(typeof(argument) for argument in arguments)
            state, part, looks, looker, shared, actions, samples, whole, _, ledgers = signature
            nodes, number = typeof(arguments[4].nodes), typeof(0.0)
            pieces: dict[str, Piece] = {
                "highest_frequency": (
                    self.highest_frequency,
                    (state, part, looks, looker, actions, whole, whole, number, number),
                ),
                "gather": (self.gather, (state, shared, actions, whole, number, ledgers, samples, whole)),
                "scan": (self.scan, (state, part, looks, looker, nodes, number)),
            }
            forces = self.forces, (typeof(arguments[0].u), typeof(arguments[0].force), typeof(arguments[4].blocks))
            # Those that take long first. The parts of ``forces`` are those that a course calls last, so that one process lowers
            # parts that the other one loads.
            compile_pieces([(self.course, signature), forces, *pieces.values()])
            self.known.append(Addresses(**{name: address_of(piece) for name, piece in pieces.items()}))
        return self.known[0]


# An element: the templates of its forces, and its hourglass treatment or Gauss points. The first is the default.
ELEMENTS: dict[str, tuple[ModuleType, ModuleType]] = {
    "hex8": (internal, assumed_strain),
    "hex8-stiffness": (internal, stiffness),
    "hex8-full": (internal_full, full),
}


def kernels(
    law: str, element: str, layout: Layout = (), muscles: bool = False, derived: bool = False, contact: bool = False
) -> Kernels:
    """Kernels with the leaves of a law, an element and effects bound in (``response.layout_of`` gives the places of the latter).

    ``muscles`` says whether muscles pull by a stress along their fibres, ``derived`` whether the geometry of the elements is
    derived from the positions of their nodes instead of read, ``contact`` whether surfaces touch each other.

    Compiled at the first call, kept on disk for the next process.
    """
    return _kernels(law, element, layout, muscles, derived, contact)


@cache  # which would tell a default from the same value given
def _kernels(law: str, element: str, layout: Layout, muscles: bool, derived: bool, contact: bool) -> Kernels:
    templates, treatment = ELEMENTS[element]
    force, energy = templates.bound(law_of(law), treatment, layout, muscles, derived)
    return kernels_of(force, energy, internal.bound_shape(treatment, derived), surfaces if contact else apart)


def kernels_of(
    force: Dispatcher,
    energy: Dispatcher,
    shape: Dispatcher,
    contact: ModuleType = apart,
    step_of: Callable[..., Any] | None = None,
) -> Kernels:
    """Kernels from those of an element's forces and energies, and the leaf that gives its geometry.

    ``contact`` is the module for contact of surfaces with each other; ``step_of`` makes another step from the usual one.
    """
    pressing = {"add_surfaces": contact.add_surfaces, "surfaces_loss": contact.surfaces_loss}
    hold = bind(restraint.hold, stored=False, add_surfaces_stiffness=contact.add_surfaces_stiffness)
    evaluate = bind(look.evaluate, stored=False, internal_force=force, hold=hold)
    snapshot = bind(step.snapshot, stored=False, internal_energy=energy, **pressing)
    advance = bind(step.advance, stored=False, internal_force=force, **pressing)
    return Kernels(
        forces=bind(step.forces, internal_force=force),
        course=bind(course.course, advance=advance if step_of is None else step_of(advance)),
        gather=bind(course.gather, apart=True, snapshot=snapshot, add_surface_pressure=contact.add_surface_pressure),
        scan=bind(look.scan, apart=True, shape=shape),
        highest_frequency=bind(look.highest_frequency, apart=True, evaluate=evaluate, hold=hold),
        relax=bind(relax_step.relax, internal_force=force),
        elastic_energy=bind(step.elastic_energy, internal_energy=energy),
        press=kernel(relax_step.press),
        touch=kernel(relax_step.touch),
    )
