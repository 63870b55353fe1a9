"""A test with fitted constants: as a scenario that repeats it, and run once more for a picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.inverse.predict.setup import Setup
from explicitfe.platform.errors import RunError

if TYPE_CHECKING:
    from explicitfe.results.documents.fitted_curves import DeformedSpecimen, StatedTool

# A scenario repeats force steps as they are if there are no more than this; else it has so many even loads.
MOST_REPEATED_LOADS = 20
EVEN_LOADS = 8
CONSTANT_DECIMALS = 4  # Constants are written with so many decimals [Pa].


@dataclass(frozen=True)
class FittedTest:
    """A test with fitted constants.

    Attributes
    ----------
    setup : the test, with the fitted law.
    constants : (p,) of this law [Pa].
    loads : (k,) N or m, as measured.
    """

    setup: Setup
    constants: np.ndarray
    by_force: bool
    loads: np.ndarray

    def loads_to_run(self) -> list[float]:
        """Loads, N or m, from above 0 up."""
        loads = self.loads[self.loads > 0.0]
        if self.by_force and len(loads) <= MOST_REPEATED_LOADS and (np.diff(loads) > 0.0).all():
            return [float(x) for x in loads]
        return [float(x) for x in loads.max() * np.arange(1, EVEN_LOADS + 1) / EVEN_LOADS]

    def scenario(self, title: str, method: str) -> str:
        """The text of a scenario that repeats the test; ``explicitfe run`` takes it."""
        rounded = (float(round(c, CONSTANT_DECIMALS)) for c in self.constants)
        constants = ", ".join(f"{key} = {json.dumps(value)}" for key, value in self.setup.material(*rounded).items())
        loads = self.loads_to_run()
        key, values = ("forces_N", loads) if self.by_force else ("displacements_mm", [1e3 * x for x in loads])
        lines = [
            f"title = {json.dumps(title, ensure_ascii=False)}",
            f'question = "Response of the identified tissue ({method}) in the test that identified it"',
            "",
            "[model]",
            'name = "specimen"',
            *(f"{key} = {json.dumps(value)}" for key, value in self.setup.specimen.items()),
            f"material = {{ {constants} }}",
            "",
            "[tool]",
            *(f"{key} = {json.dumps(value)}" for key, value in self.setup.tool.items()),
            "",
            "[analysis]",
            'type = "relaxation"',
            f"{key} = {json.dumps([float(f'{x:.6g}') for x in values])}",
        ]
        return "\n".join(lines) + "\n"

    def deform(self) -> DeformedSpecimen | None:
        """The specimen at the largest load.

        None where the load is not reached: the fit stands without its picture.
        """
        try:
            body = self.setup.relaxation(*map(float, self.constants))
        except RunError:
            return None
        reached = None
        for load in self.loads_to_run():
            reached = body.press(load) if self.by_force else body.move(load)
            if not isinstance(reached, Equilibrium):
                return None
        assert isinstance(reached, Equilibrium)
        height = body.model.tool.height_m - body.touch_m if body.model.tool is not None else 0.0
        tool: StatedTool = {"shape": self.setup.tool["shape"]}
        if "radius_mm" in self.setup.tool:
            tool["radius_mm"] = self.setup.tool["radius_mm"]
        if "edge_radius_mm" in self.setup.tool:
            tool["edge_radius_mm"] = self.setup.tool["edge_radius_mm"]
        return {
            "mesh": body.model.mesh,
            "displacement_m": body.displacement,
            "energy_Pa": body.element_fields()["strain_energy_density"],
            "tool": tool,
            "lowest_mm": 1e3 * (height - reached.displacement_m),
            "load": f"{reached.force_N:.3g} N, {1e3 * reached.displacement_m:.3g} mm",
        }
