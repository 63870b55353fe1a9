"""Results of models that were built in Python: the same file as that of a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from explicitfe.fem.inputs.argument import number_like
from explicitfe.fem.inputs.limits import Positive
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.errors import InputError, Progress, shortened, silent
from explicitfe.platform.host import stopping
from explicitfe.platform.host.result_files import SUFFIX
from explicitfe.results.documents.run_summary import TransientModelDescription, TransientSummary, point_at_rest
from explicitfe.simulate.run.transient import TransientAnalysis
from explicitfe.simulate.scenario.transient import AnalysisTable, ModelTable, RecordTable, TransientScenario

TEXT = "# This model was built in Python.\n"


def save(
    simulation: Simulation,
    path: Path | str,
    *,
    duration_s: float,
    every_s: float = 1e-3,
    step_s: float | None = None,
    title: str = "A model built in Python",
    overwrite: bool = False,
    progress: Progress = silent,
) -> TransientSummary:
    """Run a simulation and store its result; see :func:`explicitfe.save`."""
    if not isinstance(simulation, Simulation):
        raise InputError(f"save: simulation must be a Simulation, not {shortened(repr(simulation))}.")
    if simulation.steps:
        raise InputError("save: the simulation has been advanced already; create a new one from its model.")
    scenario = TransientScenario(
        title=title,
        model=ModelTable(name=Path(path).stem, element=simulation.model.element),
        analysis=AnalysisTable(
            duration_ms=1e3 * number_like("save: duration_s", duration_s, Positive, "duration_ms", 1e3),
            step_us=None if step_s is None else 1e6 * number_like("save: step_s", step_s, Positive, "step_us", 1e6),
        ),
        record=RecordTable(every_ms=1e3 * number_like("save: every_s", every_s, Positive, "every_ms", 1e3)),
    )
    target = Path(path)
    target = target if target.suffix == SUFFIX else target.with_name(target.name + SUFFIX)
    analysis = PythonAnalysis(target, scenario, TEXT, simulation.model, target.stem, simulation)
    with stopping.watching():
        return analysis.run(target, overwrite=overwrite, progress=progress)


@dataclass(frozen=True)
class PythonAnalysis(TransientAnalysis):
    """A run in time of a model that no scenario describes."""

    def describe(self) -> TransientModelDescription:
        """What is known of the model, and how it is run."""
        model = self.model
        return {
            **self._description(),
            "scenario": self.scenario.model_dump(mode="json", include={"title", "analysis", "record"}, exclude_none=True),
            "alpha_per_s": model.alpha_per_s,
            "beta_s": 0.0,
            "muscles": [],
            "bones": [bone.name for bone in model.bones],
            "held_area_mm2": {tie.name: float(1e6 * tie.areas_m2.sum()) for tie in model.attachments},
            "surgery": None,
            "airway": None,
            "probes": {name: point_at_rest(point) for name, point in model.probes.items()},
        }

    def _stored_model(self) -> dict[str, object]:
        return dict(self.describe())
