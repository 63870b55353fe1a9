"""From a scenario file to a body that is built, not yet compiled or run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from explicitfe.errors import InputError
from explicitfe.model.model import Model
from explicitfe.model.specimen import specimen_model
from explicitfe.model.tongue import assemble
from explicitfe.scenario.indentation import IndentationScenario
from explicitfe.scenario.read import Scenario, read_scenario
from explicitfe.solve.body import Body
from explicitfe.solve.equilibrium import Relaxation
from explicitfe.solve.simulation import Simulation


@dataclass(frozen=True)
class Prepared:
    """A scenario that has been read and built.

    Attributes
    ----------
    path, scenario, text : the file, what it says, and its text with the settings noted at its head.
    model, name : the physics, and what a user calls it.
    body : a Simulation of a transient analysis, a Relaxation of an indentation.
    notes : sentences for the user that the summary begins its warnings with.
    """

    path: Path
    scenario: Scenario
    text: str
    model: Model
    name: str
    body: Body
    notes: tuple[str, ...] = ()

    @property
    def simulation(self) -> Simulation:
        """The body of a transient analysis."""
        assert isinstance(self.body, Simulation)
        return self.body

    @property
    def relaxation(self) -> Relaxation:
        """The body of an indentation."""
        assert isinstance(self.body, Relaxation)
        return self.body


def prepare(path: Path | str, settings: Sequence[str] = ()) -> Prepared:
    """Read, check and build a scenario.

    Raises
    ------
    InputError : what is wrong with it, in one sentence.
    """
    path = Path(path)
    scenario, text = read_scenario(path, settings)
    try:
        if isinstance(scenario, IndentationScenario):
            model = specimen_model(scenario.model, scenario.tool, scenario.effects.chosen)
            body = Relaxation(model, scenario.analysis.tolerance, scenario.analysis.threads)
            return Prepared(path, scenario, text, model, scenario.model.name, body)
        model, anatomy = assemble(scenario, path.parent)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(str(path.parent)) else f"{path}: {error}") from None
    return Prepared(path, scenario, text, model, anatomy.name, Simulation(model, threads=scenario.analysis.threads))


def describe(prepared: Prepared) -> dict[str, Any]:
    """The model in words and numbers, as it is stored and shown."""
    model, volume = prepared.model, prepared.body.volumes.sum()
    described = {
        "name": prepared.name,
        "nodes": model.mesh.node_count,
        "hexes": model.mesh.element_count,
        "volume_mm3": float(1e9 * volume),
        "mass_g": float(1e3 * model.material.density_kg_m3 * volume),
        "element": model.element,
        "material": model.material.model_dump(),
        "fixed_nodes": int(model.held.all(axis=1).sum()),
        # With --set and all defaults: what was run, ready to be run again.
        "scenario": prepared.scenario.model_dump(mode="json", exclude_none=True),
    }
    if isinstance(prepared.scenario, IndentationScenario):
        return described | {"copies": model.copies, "tool": prepared.scenario.tool.model_dump(exclude_none=True)}
    return described | {
        "alpha_per_s": model.alpha_per_s,
        "muscles": [muscle.model_dump() for muscle in prepared.scenario.muscle],
        "probes": {name: int(node) for name, node in model.probes.items()},
    }
