"""A body under dead loads and a rigid tool: forces, energies and errors of its present state."""

from __future__ import annotations

import numpy as np

from explicitfe.fem.elements.stress_measures import symmetric
from explicitfe.fem.inputs.argument import finite_number
from explicitfe.fem.mesh.validity import certify
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.body import Body
from explicitfe.fem.solve.contact_points import ToolContact
from explicitfe.fem.solve.detached import detach
from explicitfe.fem.solve.load_outcome import Equilibrium, Stuck
from explicitfe.fem.solve.sector import SectorTie
from explicitfe.platform.compiled.arrays import KINETIC_RATIO, MONITOR, RESIDUAL, REST_J
from explicitfe.platform.errors import InputError

# What a model may have that only a run in time computes.
ONLY_IN_TIME = ("pulls", "stresses", "bones", "attachments", "motion", "followers", "pressures", "weights", "surfaces", "air")


class LoadedBody(Body):
    """A body with dead loads and a tool.

    Attributes
    ----------
    contact : the tool and the points of the surface that it may touch.
    touch_m : depth of the tool from which its displacement counts.
    time_s : time of the last equilibrium, s.
    friction_loss_J : energy lost to friction so far, of what is meshed.
    """

    # At the edge of a bonded disc the stress has no bound and elements fold; kept from that they are 2 % too stiff
    # (docs/studies/elements.md).
    guarded = False

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        self.friction_loss_J = 0.0
        self.touch_m = 0.0
        self.time_s = 0.0
        self._tie = SectorTie(self.model.sector, self._place)
        self.contact = ToolContact(self.model, self._place, self.points, self.kernels)
        self._external = self._dead_forces()
        self._monitor = np.zeros(MONITOR)
        self._monitor[REST_J] = 1.0

    def equilibrium(self, iterations: int) -> Equilibrium:
        """Forces, energies and errors of the present state."""
        copies = self.model.copies
        gap, push, _ = self.contact.touch(self.state.u)
        internal, hourglass, lost, _ = self._energies()
        pressed = push > 0.0
        place = self.contact.places(self.state.u)
        return Equilibrium(
            force_N=copies * self.contact.force(self.state.u),
            displacement_m=self.contact.driven_m(self.state.u) - self.touch_m,
            iterations=iterations,
            residual=float(self._monitor[RESIDUAL]),
            kinetic_ratio=float(self._monitor[KINETIC_RATIO]),
            reaction_N=copies * self._reaction(),
            penetration_m=float(max(0.0, -gap.min(initial=0.0))),
            contact_radius_m=float(np.hypot(place[pressed, 0], place[pressed, 1]).max(initial=0.0)),
            internal_J=copies * float(internal),
            hourglass_J=copies * float(hourglass),
            contact_J=copies * 0.5 * float(np.sum(push * -gap * (push > 0.0))),
            dead_work_J=copies * float(np.sum(self._external * self.state.u)),
            friction_loss_J=copies * self.friction_loss_J,
            material_loss_J=copies * float(lost),
            smallest_J=float(self._monitor[REST_J]),
            folded=certify(self.model.mesh.points + self.displacement, self.model.mesh.hexes).folded_count,
        )

    def contact_pressure(self) -> tuple[np.ndarray, np.ndarray]:
        """Present positions (k, 3) m of the contact points, and the pressure of the tool there (k,) Pa.

        Raises
        ------
        InputError : the model has no tool.
        """
        if self.model.tool is None:
            raise InputError("contact_pressure: the model has no tool.")
        return self.contact.places(self.state.u), self.contact.touch(self.state.u).push / self.model.tool.areas_m2

    def element_fields(self) -> dict[str, np.ndarray]:
        """J, strain energy density [Pa] with that of hourglass control, and hourglass energy [J] of each element, (m,)."""
        self._energies()
        volume = np.empty(len(self.volumes))
        volume[self.element_order] = self.volumes
        hourglass = self._in_elements(self._element_hourglass)
        density = (self._in_elements(self._element_energy) + hourglass) / volume
        return {"J": self._in_elements(self._element_J), "strain_energy_density": density, "hourglass_energy": hourglass}

    def element_stress(self) -> np.ndarray:
        """Mean Cauchy stress of each element, xx, yy, zz, xy, yz, xz, (m, 6) Pa; see forces/element_stress.py."""
        increment_s = self._increment_s
        self.set_increment(0.0)
        detached = detach(self.blocks, self.blocks.effects.copy(), self.hexes, self.points, self.volumes)
        self.set_increment(increment_s)
        detached.u[: self.hexes.size] = self.state.u[self.hexes.ravel()]
        self.kernels.forces(detached.u, detached.force, detached.blocks)
        x = self.points[self.hexes] + self.state.u[self.hexes, :3]
        moments = np.einsum("mai,maj->mij", -detached.force[: self.hexes.size, :3].reshape(-1, 8, 3), x - x[:, :1])
        stress = np.empty((len(self.hexes), 6))
        stress[self.element_order] = symmetric(0.5 * (moments + moments.transpose(0, 2, 1))) / self.volumes[:, None]
        return stress / self.element_fields()["J"][:, None]

    # ---- inside ----

    def _checked_load(self, name: str, value: float, largest: float) -> float:
        load = finite_number(name, value)
        if abs(load) > largest:
            raise InputError(f"{name} = {load:g} is out of range: the largest magnitude is {largest:g}.")
        if self.model.tool is None:
            raise InputError(f"{name.partition(':')[0]}: the model has no tool; use settle() for dead loads, or give it a tool.")
        return load

    def _checked_time(self, name: str, at_s: float | None) -> float:
        if at_s is None:
            return self.time_s
        if finite_number(name, at_s) < self.time_s:
            raise InputError(f"{name} = {at_s:g} is before the last load, at {self.time_s:g} s; times must not decrease.")
        return float(at_s)

    def _dead_forces(self) -> np.ndarray:
        """Dead loads on the node rows; those on the sector's far side act on its near one."""
        forces = np.zeros((self.model.mesh.node_count, 3))
        for load in self.model.loads:
            np.add.at(forces, load.nodes, load.force_N)
        rows = self._rows(forces)
        self._tie.gather_on_near_side(rows)
        return rows

    def _energies(self) -> tuple[float, float, float, float]:
        return self.kernels.elastic_energy(
            self.state.u, self.blocks, self._element_J, self._element_energy, self._element_hourglass
        )

    def _reaction(self) -> float:
        """Force of what holds the body along +z [N], less the weight that rests on it."""
        force = np.zeros_like(self.state.u)
        self.kernels.forces(self.state.u, force, self.blocks)
        held = self.model.held[self.node_order][:, 2]  # of the sector both sides: a turn leaves z as it is
        return float(self._external[:, 2].sum() - (force + self._external)[: len(held), 2][held].sum())

    def _stuck(self, failure: str, goal: float, reached: float) -> Stuck:
        force_N = self.model.copies * self.contact.force(self.state.u)
        return Stuck(failure, goal, reached, float(self._monitor[RESIDUAL]), force_N, self._worst(failure))

    def _worst(self, failure: str) -> np.ndarray:
        """Where the broken element, or the largest unbalanced force is, in the reference shape (3,) m."""
        if failure == "inverted":
            return self.model.mesh.points[self.model.mesh.hexes[self.broken_element()]].mean(axis=0)
        unbalanced = np.where(self.nodes.inverse_mass > 0.0, self.state.force + self._external, 0.0)
        return self.points[int(np.argmax(np.linalg.norm(unbalanced[: len(self.points)], axis=1)))]
