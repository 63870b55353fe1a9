"""The compiled entry points for a law, an element and effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from types import ModuleType
from typing import Any

import numpy as np

from explicitfe.fem.elements import full
from explicitfe.fem.elements import hourglass_stiffness as stiffness
from explicitfe.fem.elements import hourglass_strain as assumed_strain
from explicitfe.fem.forces import apart, external, internal, internal_full, surfaces
from explicitfe.fem.forces.response import Layout
from explicitfe.fem.materials import law_of
from explicitfe.fem.solve import course, look, relax_step, step
from explicitfe.platform.compiled.arrays import Addresses, Blocks, Contact, Part, State
from explicitfe.platform.compiled.jit import Dispatcher, bind, kernel
from explicitfe.platform.compiled.pieces import Piece, address_of, compile_pieces, typeof


@dataclass(frozen=True)
class Kernels:
    """The compiled entry points for one material law, element and set of effects; what each is given stands where it is written.

    Only the internal forces, the internal energies and the scan depend on these. The other kernels call them by address, so that
    their machine code is the same for all.

    Attributes
    ----------
    internal_force, internal_energy : of ``forces/internal.py`` or ``forces/internal_full.py``.
    course, gather : of ``solve/course.py``.
    scan, highest_frequency : of ``solve/look.py``.
    forces_at, energy_at : ``forces`` and ``elastic_energy`` of ``solve/step.py``.
    relax_at, press, touch : of ``solve/relax_step.py``.
    known : addresses by the name of the attribute.
    """

    internal_force: Dispatcher
    internal_energy: Dispatcher
    course: Dispatcher
    gather: Dispatcher
    scan: Dispatcher
    highest_frequency: Dispatcher
    forces_at: Dispatcher
    energy_at: Dispatcher
    relax_at: Dispatcher
    press: Callable[[np.ndarray, np.ndarray, Contact, np.ndarray], float]
    touch: Callable[[np.ndarray, Contact, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None]
    known: dict[str, int] = field(default_factory=dict, compare=False)

    def forces(self, u: np.ndarray, force: np.ndarray, blocks: Blocks) -> float:
        """Minus the internal force at displacement u into ``force``, (N, 4) N each; give the smallest J."""
        return self.forces_at(self._address("internal_force", u, force, blocks), u, force, blocks)

    def elastic_energy(
        self, u: np.ndarray, blocks: Blocks, element_J: np.ndarray, element_energy: np.ndarray, element_hourglass: np.ndarray
    ) -> tuple[float, float, float, float]:
        """Strain energy, hourglass energy, energy lost and that of the barrier [J]; J and the former two of elements, (B, W)."""
        sums = np.zeros(4)
        arguments = (u, blocks, element_J, element_energy, element_hourglass, sums)
        self.energy_at(self._address("internal_energy", *arguments), *arguments)
        internal, hourglass, lost, barrier = sums.tolist()
        return internal, hourglass, lost, barrier

    def relax(self, state: State, external: np.ndarray, inner: np.ndarray, part: Part, *others: Any) -> int:
        """Relax towards equilibrium, as ``relax_step.relax``."""
        at = self._address("internal_force", part.u, part.force, part.blocks)
        return self.relax_at(at, state, external, inner, part, *others)

    def prepare(self, calls: Mapping[str, tuple[Any, ...]]) -> None:
        """Compile or load several kernels at the same time, given by the name of the attribute and arguments of a call.

        Only the types of the arguments matter.
        """
        compile_pieces(
            [(getattr(self, name), tuple(typeof(argument) for argument in arguments)) for name, arguments in calls.items()]
        )

    @property
    def is_ready(self) -> bool:
        """Whether all that a course calls is compiled."""
        return set(Addresses._fields) <= set(self.known)

    def addresses(self, arguments: tuple[Any, ...]) -> Addresses:
        """Addresses of the functions that ``course`` calls. Compile or load ``course`` and these at the first call.

        ``arguments`` are those of ``course``; only their types matter.
        """
        if not self.is_ready:
            signature = tuple(typeof(argument) for argument in arguments)
            state, part, looks, looker, shared, actions, samples, whole, _, ledgers = signature
            one, common, rows, number = arguments[1], arguments[4], typeof(arguments[0].u), typeof(0.0)
            lanes, sums = typeof(arguments[6].lanes[0]), typeof(arguments[6].ledger)
            # In the order of the times to compile. One process begins with the forces while another compiles the course.
            pieces: dict[str, Piece] = {
                "internal_force": (self.internal_force, (typeof(one.u), typeof(one.force), typeof(one.blocks))),
                "highest_frequency": (
                    self.highest_frequency,
                    (state, part, looks, looker, actions, whole, whole, number, number, whole),
                ),
                "gather": (self.gather, (state, shared, actions, whole, number, ledgers, samples, whole)),
                "internal_energy": (self.internal_energy, (rows, typeof(common.blocks), lanes, lanes, lanes, sums)),
                "scan": (self.scan, (state, part, looks, looker, typeof(common.nodes), number)),
            }
            compile_pieces([(self.course, signature), *pieces.values()])
            self.known.update({name: address_of(piece) for name, piece in pieces.items()})
        return Addresses(**{name: self.known[name] for name in Addresses._fields})

    def _address(self, name: str, *arguments: Any) -> int:
        if name not in self.known:
            piece: Piece = getattr(self, name), tuple(typeof(argument) for argument in arguments)
            compile_pieces([piece])
            self.known[name] = address_of(piece)
        return self.known[name]


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
    scan = bind(look.scan, apart=True, shape=shape)
    whole = partial(_with_contact(contact), internal_force=force, internal_energy=energy, scan=scan)
    return whole() if step_of is None else whole(course=_course(contact, step_of))


@cache
def _with_contact(contact: ModuleType) -> Callable[..., Kernels]:
    """Kernels but for those that depend on law, element and effects."""
    stiffness = bind(external.add_stiffness, inline=True, add_surfaces_stiffness=contact.add_surfaces_stiffness)
    hold = bind(look.hold_nodes, stored=False, add_stiffness=stiffness)
    evaluate = bind(look.evaluate, stored=False, hold=hold)
    snapshot = bind(step.snapshot, stored=False, **_pressing(contact))
    return partial(
        Kernels,
        course=_course(contact, lambda advance: advance),
        gather=bind(course.gather, apart=True, snapshot=snapshot, add_surface_pressure=contact.add_surface_pressure),
        highest_frequency=bind(look.highest_frequency, apart=True, evaluate=evaluate, hold=hold),
        forces_at=kernel(step.forces),
        energy_at=kernel(step.elastic_energy),
        relax_at=kernel(relax_step.relax),
        press=kernel(relax_step.press),
        touch=kernel(relax_step.touch),
    )


def _course(contact: ModuleType, step_of: Callable[..., Any]) -> Dispatcher:
    return bind(course.course, advance=step_of(bind(step.advance, stored=False, **_pressing(contact))))


def _pressing(contact: ModuleType) -> dict[str, Dispatcher]:
    add_forces = bind(external.add_forces, inline=True, add_surfaces=contact.add_surfaces)
    return {"add_forces": add_forces, "surfaces_loss": contact.surfaces_loss}
