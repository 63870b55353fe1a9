"""The compiled entry points for a law, an element and effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
from explicitfe.platform.compiled.arrays import Blocks, Contact
from explicitfe.platform.compiled.jit import Dispatcher, bind, kernel


@dataclass(frozen=True)
class Kernels:
    """The compiled entry points for one material law, element and set of effects; what each is given stands where it is written.

    Attributes
    ----------
    forces, elastic_energy : of ``solve/step.py``.
    course : of ``solve/course.py``.
    relax, press, touch : of ``solve/relax_step.py``.
    """

    forces: Callable[[np.ndarray, np.ndarray, Blocks], float]
    course: Callable[..., int]
    relax: Callable[..., int]
    elastic_energy: Callable[[np.ndarray, Blocks, np.ndarray, np.ndarray, np.ndarray], tuple[float, float, float, float]]
    press: Callable[[np.ndarray, np.ndarray, Contact, np.ndarray], float]
    touch: Callable[[np.ndarray, Contact, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]


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
        course=bind(
            course.course,
            advance=advance if step_of is None else step_of(advance),
            gather=bind(course.gather, stored=False, snapshot=snapshot, add_surface_pressure=contact.add_surface_pressure),
            scan=bind(look.scan, stored=False, shape=shape),
            highest_frequency=bind(look.highest_frequency, stored=False, evaluate=evaluate, hold=hold),
        ),
        relax=bind(relax_step.relax, internal_force=force),
        elastic_energy=bind(step.elastic_energy, internal_energy=energy),
        press=kernel(relax_step.press),
        touch=kernel(relax_step.touch),
    )
