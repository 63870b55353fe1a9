"""Elements, masses and kernels of a model, with their arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from explicitfe.fem.effects.effect import MaterialEffect
from explicitfe.fem.elements import barrier, hex8
from explicitfe.fem.forces import response
from explicitfe.fem.mesh.checked_arrays import number_array
from explicitfe.fem.mesh.order import compute_order
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.contractions import contractions
from explicitfe.fem.solve.kernels import ELEMENTS, kernels
from explicitfe.platform.compiled.arrays import (
    CORNER,
    Blocks,
    Nodes,
    State,
    in_blocks,
    node_rows,
    nodes_of,
    position_rows,
    row_places,
    without_barrier,
    zeros,
)
from explicitfe.platform.compiled.simd import ROW, WIDTH
from explicitfe.platform.errors import InputError, shortened

# In larger meshes the geometry of elements is derived from the positions of their nodes at each step, instead of read: 32 bytes
# a node in place of 256 (hex8-stiffness) or 320 (hex8) an element, for a fifth more operations. That pays where the arrays have
# left the second cache and a vector has 8 lanes. Nanoseconds an element and step on AMD's Zen 4, read and derived: with 1 000
# elements 33 and 39 (hex8), 25 and 30 (hex8-stiffness); with 30 000 between 43 and 60 against 44, and between 33 and 47 against
# 36, as others leave room in the third cache; with 250 000 between 48 and 60 against 52, and between 39 and 80 against 45. Four
# lanes, which take twice the time for operations, lose 4 ns by it at any size in hex8.
DERIVED_ABOVE_ELEMENTS = 16_000 if WIDTH > ROW else math.inf


def memory_of(effects: Sequence[MaterialEffect], count: int) -> dict[str, np.ndarray]:
    """Arrays of ``Blocks`` for the effects of so many elements: their numbers, and what they remember at rest."""
    blocks = -(-count // WIDTH)
    memory = sum(effect.memory for effect in effects) + (response.WORK_MEMORY if effects else 0)
    old, new = (zeros((blocks, max(memory, 1), WIDTH)) for _ in range(2))
    for place, value in response.AT_REST.items() if effects else ():
        old[:, place] = new[:, place] = value
    numbers = sum(effect.numbers for effect in effects)
    return {"effects": zeros((blocks, max(numbers, 1), WIDTH)), "old": old, "new": new}


class Body:
    """Elements, masses and kernels of a model.

    Internal arrays are in computing order; methods and properties return values in the user's numbering.

    Parameters
    ----------
    model : what is computed.
    displacement, velocity : (n, 3) initial values, m and m/s; zero if left out.

    Attributes
    ----------
    guarded : whether a barrier keeps elements from inverting at their corners, where the element has one.

    Raises
    ------
    InputError : no model, an array of another shape, effects that the element cannot compute, or an inverted element at rest.
    """

    guarded: ClassVar[bool] = True

    def __init__(self, model: Model, *, displacement: np.ndarray | None = None, velocity: np.ndarray | None = None) -> None:
        name = type(self).__name__
        if not isinstance(model, Model):
            raise InputError(f"{name}: model must be a Model, not {shortened(repr(model))}.")
        if model.effects and model.element == "hex8-full":
            raise InputError('element = "hex8-full" cannot be combined with effects of the material; use element = "hex8".')
        shape = (model.mesh.node_count, 3)
        if displacement is not None:
            displacement = number_array(f"{name}: displacement", displacement, shape)
        if velocity is not None:
            velocity = number_array(f"{name}: velocity", velocity, shape)
        self.model = model
        mesh = model.mesh
        self.node_order, self.element_order = compute_order(mesh.hexes, mesh.node_count)
        self._place = np.empty(mesh.node_count, dtype=np.int64)
        self._place[self.node_order] = np.arange(mesh.node_count)
        self.points = np.ascontiguousarray(mesh.points[self.node_order])
        self.hexes = self._place[mesh.hexes[self.element_order]]

        law = model.material
        count = mesh.element_count
        self.constants = model.in_elements(lambda tissue: tissue.constants())[self.element_order]
        if model.stiffness is not None:
            self.constants = law.scaled(self.constants, model.stiffness[self.element_order])
        self.density = model.in_elements(lambda tissue: tissue.density_kg_m3)[self.element_order]
        corners = self.points[self.hexes]
        geometry = hex8.geometry(corners)
        self.volumes = np.ascontiguousarray(geometry[:, hex8.VOLUME])
        if not self.volumes.min() > 0.0:
            worst = int(self.element_order[np.argmin(self.volumes)])
            raise InputError(
                f"{name}: element {worst} of the mesh has the volume {self.volumes.min():.3g} m^3; list its nodes in VTK order "
                "(VTK_HEXAHEDRON)."
            )
        treatment = ELEMENTS[model.element][1]
        mass = hex8.lumped_mass(self.hexes, self.volumes * self.density, mesh.node_count)
        guard = without_barrier(-(-count // WIDTH))
        if treatment.HAS_BARRIER:
            share = np.prod([effect.long_term_share for effect in model.effects])
            stiffness = np.ones(count) if model.stiffness is None else model.stiffness[self.element_order]
            modulus_Pa = model.in_elements(lambda tissue: tissue.shear_modulus_Pa)[self.element_order] * share * stiffness
            guard["barrier"] = in_blocks(barrier.constants(corners, modulus_Pa, mass[self.hexes].min(axis=1)))
            guard["barrier"][:, : barrier.WHOLE] *= (
                self.guarded and model.barrier
            )  # no reach, so no suspect; no modulus, so no energy
        for extra in model.masses:
            np.add.at(mass, self._place[extra.nodes], extra.mass_kg)
        derived = count > DERIVED_ABOVE_ELEMENTS and hasattr(treatment, "of_shape")
        hourglass = treatment.constants(corners, geometry)
        self.blocks = Blocks(
            nodes=row_places(self.hexes, mesh.node_count),
            geometry=in_blocks(geometry[:, :0] if derived else geometry),
            constants=in_blocks(self.constants[:1] if model.stiffness is None and not model.inclusions else self.constants),
            hourglass=in_blocks(hourglass[:, :0] if derived else hourglass),
            position=position_rows(self.points, corners[-1]),
            **memory_of(model.effects, count),
            **contractions(model.stresses, self.element_order),
            **guard,
        )
        held = model.held.copy()
        if model.motion is not None:
            held[model.motion.nodes] = True
        self.nodes = self.with_masses(node_rows(np.tile(mass[:, None], 3)), held)
        self._increment_s = np.nan
        self.kernels = kernels(
            law.law, model.element, response.layout_of(model.effects), bool(model.stresses), derived, model.surfaces is not None
        )
        zero = np.zeros((mesh.node_count, 3))
        self.state = State(
            u=self._rows(zero if displacement is None else displacement),
            v=self._rows(zero if velocity is None else velocity),
            force=node_rows(zero),
        )
        self.state.v[self.nodes.inverse_mass == 0.0] = 0.0
        self.set_increment(0.0)
        self._element_J = np.ones((len(self.blocks.nodes), self.blocks.nodes.shape[2]))
        self._element_energy = np.zeros_like(self._element_J)
        self._element_hourglass = np.zeros_like(self._element_J)

    def set_increment(self, increment_s: float) -> None:
        """Set the time between the stored state of a history-dependent material and the state that is evaluated [s]."""
        if increment_s != self._increment_s and self.model.effects:
            values = [value for effect in self.model.effects for value in effect.values(increment_s)]
            self.blocks.effects[:] = np.array(values)[None, :, None]
        self._increment_s = increment_s

    def with_masses(self, rows: np.ndarray, held: np.ndarray) -> Nodes:
        """Nodes with masses (N, 4) kg, of which (n, 3) components, in the user's numbering, are held."""
        free = node_rows(~held[self.node_order])
        return nodes_of(rows, np.divide(free, rows, out=zeros(rows.shape), where=rows > 0.0))

    # ---- in the user's numbering ----

    @property
    def displacement(self) -> np.ndarray:
        """Present displacement of the nodes from their reference positions, (n, 3), m."""
        return self.state.u[self._place, :3]

    @property
    def nodal_mass(self) -> np.ndarray:
        """Lumped mass of each node, (n,), kg."""
        return self.nodes.mass[self._place, 0]

    def internal_force(self, displacement: np.ndarray) -> np.ndarray:
        """Internal force at a displacement; the state does not change.

        Parameters
        ----------
        displacement : (n, 3), m.

        Returns
        -------
        (n, 3), N.
        """
        force = np.zeros_like(self.state.u)
        self.kernels.forces(self._rows(displacement), force, self.blocks)
        return -force[self._place, :3]

    def broken_element(self) -> int:
        """Number of the element whose J is lowest, or not a number, at any integration point.

        If J is above 0 everywhere, it is the element whose corner is nearest to inversion.
        """
        u, scratch = self.state.u, np.empty_like(self.state.u)

        def soundness(first: int, lanes: slice) -> tuple[float, float, float]:
            few = self.blocks.each(lambda array: np.ascontiguousarray(array[first : first + 1, :, lanes]))
            full = few.each(lambda array: np.repeat(array, WIDTH, axis=2) if array.shape[2] == 1 else array)
            J = self.kernels.forces(u, scratch, full)
            corner = full.corner[CORNER]
            # what is not a number counts as lowest
            return (min(J, 0.0) if -np.inf < J else -np.inf), (corner if -np.inf < corner else -np.inf), J

        block = min(range(len(self.blocks.nodes)), key=lambda k: soundness(k, slice(None)))
        count = min(WIDTH, len(self.hexes) - block * WIDTH)
        lane = min(range(count), key=lambda k: soundness(block, slice(k, k + 1)))
        return int(self.element_order[block * WIDTH + lane])

    # ---- inside ----

    def _rows(self, values: np.ndarray) -> np.ndarray:
        return node_rows(np.asarray(values, dtype=float)[self.node_order])

    def _in_elements(self, lanes: np.ndarray) -> np.ndarray:
        """(B, W) lanes as (m,) values in the user's numbering."""
        values = np.empty(self.model.mesh.element_count)
        values[self.element_order] = lanes.ravel()[: len(values)]
        return values
