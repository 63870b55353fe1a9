"""A run with the derivatives of its state by muscle forces and constants: tangents are advanced with it, many at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from explicitfe.fem.forces import internal, response
from explicitfe.fem.forces.response import Layout
from explicitfe.fem.materials import first_invariant, law_of
from explicitfe.fem.mesh.hexmesh import shape_functions
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.directions import CENTRAL, Direction, inputs_of
from explicitfe.fem.solve.kernels import ELEMENTS, Kernels, kernels_of
from explicitfe.fem.solve.observe import Recording
from explicitfe.fem.solve.simulation import NO_ADDRESSES, SHORTEST_INCREMENT_S, Simulation
from explicitfe.fem.tangent import element, step
from explicitfe.fem.tangent.arrays import SharedWithTangents, tangents_of
from explicitfe.platform.compiled.arrays import Addresses
from explicitfe.platform.compiled.jit import Dispatcher, bind
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import InputError

RELAXING = {"relax", "branch_energy"}  # slots of effects that the tangents know


class Differentiated(Simulation):
    """A simulation whose state is differentiated by constants and forces while :class:`Transient` advances it.

    The derivatives are those of the computed motion itself, at the steps that it takes: they agree with differences of two runs
    with the same steps to rounding. It uses one thread. Directions are advanced in groups of ``simd.WIDTH``.

    Parameters
    ----------
    model : what is computed; at rest at time 0.
    directions : what it is differentiated by.

    Raises
    ------
    InputError : something in the model has no derivative here, or a direction changes such a thing.
    """

    can_be_restored = False  # tangents are no part of a restart state

    def __init__(self, model: Model, directions: Sequence[Direction]) -> None:
        if not directions:
            raise InputError("gradient: name at least one key in `by`, such as muscle.GGp.force_N.")
        check_differentiable(model)
        super().__init__(model, threads=1)
        self.directions = tuple(directions)
        muscles, derived = bool(model.stresses), self.blocks.geometry.shape[1] == 0
        self.kernels, self._begin = _kernels(model.material.law, model.element, layout_of(model), muscles, derived)
        memory = sum(6 + 6 * dict(place.shape)["TERMS"] for place in layout_of(model))
        groups = -(-len(directions) // WIDTH)
        ties = (len(self.ties.node), len(self.ties.total))
        rows = len(self.state.u)
        inputs = inputs_of(self, directions)
        points = list(model.probes.values())
        element = np.array([point.element[0] for point in points], dtype=np.int64)
        natural = np.array([point.natural[0] for point in points], dtype=float).reshape(-1, 3)
        self._probes = self._place[model.mesh.hexes[element]], shape_functions(natural)
        self.probe_history: list[np.ndarray] = []
        self.tangents = tangents_of(self.blocks, rows, len(self.hexes), groups, memory, ties, inputs)

    def start(self, dt_s: float) -> None:
        """Half-step start of the state and of its tangents; see ``Simulation.start``."""
        super().start(dt_s)
        times = np.array([self.time_s, self.time_s + dt_s])
        actions = self.loads.actions(times, max(dt_s, SHORTEST_INCREMENT_S), self.bones, self.ties, self.surfaces, self._planned)
        self._begin(self.state, self.parts[0].blocks, self._for_all_parts(), actions, float(dt_s))

    def recording(self, room: int) -> Recording:
        """Memory for one sample, so that the tangents can be noted at each."""
        return super().recording(1)

    def go(self, steps: int, dt_s: float, *, recording: Recording | None = None, **more: Any) -> int:
        """``Simulation.go``; the changes of the probes are noted at each sample."""
        before = 0 if recording is None else recording.count
        done = super().go(steps, dt_s, recording=recording, **more)
        if recording is not None and recording.count > before:
            self.probe_history.append(self._probe_changes())
        return done

    def _probe_changes(self) -> np.ndarray:
        """Derivatives of the displacements of the probes, (directions, probes, 3), m per unit."""
        rows, shares = self._probes
        lanes = np.einsum("pa,gpakw->gwpk", shares, self.tangents.u[:, rows])
        return np.ascontiguousarray(lanes.reshape(-1, *lanes.shape[2:])[: len(self.directions)])

    @property
    def displacement_changes(self) -> np.ndarray:
        """Derivatives of the displacements by each direction at the present time, (directions, n, 3), m per unit."""
        lanes = np.moveaxis(self.tangents.u, 3, 1).reshape(-1, *self.tangents.u.shape[1:3])
        return lanes[: len(self.directions), self._place]

    def _for_all_parts(self, addresses: Addresses = NO_ADDRESSES) -> SharedWithTangents:
        return SharedWithTangents._make((*super()._for_all_parts(addresses), self.tangents))


def layout_of(model: Model) -> Layout:
    """Where the effects of a model stand."""
    return response.layout_of(model.effects)


def check_differentiable(model: Model) -> None:
    """Refuse what has no derivative here, in one sentence.

    Raises
    ------
    InputError : the first such thing.
    """
    reasons = {
        f'model.element = "{model.element}"': model.element not in ("hex8", "hex8-stiffness"),
        f'the law "{model.material.law}", which is no function of I1 alone,': law_of(model.material.law).kind
        is not first_invariant,
        "prescribed motion": model.motion is not None,
        "contact of surfaces with each other ([contact])": model.surfaces is not None,
        "a force that follows the body (load.follows)": bool(model.followers),
        "a pressure that follows the body (load.pressure_kPa)": bool(model.pressures),
        "a mass on a string (load.string_slack_mm)": bool(model.weights),
        "an attached mass (load.mass_g)": bool(model.masses),
        "drag ([air])": model.air is not None,
        "friction on bones (bone.friction)": any(bone.friction > 0.0 for bone in model.bones),
    }
    for effect in model.effects:
        known = set(effect.leaves()) == RELAXING and effect.shape.get("NONLINEAR", 0) == 0
        reasons[f"the effect of {effect.about.title}"] = not known
    for reason, holds in reasons.items():
        if holds:
            raise InputError(f"gradient: {reason} has no derivative here; leave it out, or {CENTRAL}.")
    for bone in model.bones:
        if not bone.smooth:
            raise InputError(
                f"gradient: the force of the bone {bone.name} jumps from cell to cell of its distance grid, so that a run has no "
                f"derivative; set bone.{bone.name}.smooth = true."
            )


@cache
def _kernels(law: str, name: str, layout: Layout, muscles: bool, derived: bool) -> tuple[Kernels, Dispatcher]:
    """The kernels of a run with tangents, and what starts the tangents."""
    templates, treatment = ELEMENTS[name]
    force, energy = templates.bound(law_of(law), treatment, layout, muscles, derived)
    change = element.kernel_of(law_of(law), treatment, layout, derived)

    def with_tangents(advance: Dispatcher) -> Dispatcher:
        return bind(step.advance, stored=False, plain_advance=advance, internal_change=change)

    run = kernels_of(force, energy, internal.bound_shape(treatment, derived), step_of=with_tangents)
    return run, bind(step.begin, internal_change=change)
