"""What every kind of analysis can do: be prepared from a scenario, be checked, and run."""

from __future__ import annotations

import shlex
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, NamedTuple, Self, TypeVar

import numpy as np

from explicitfe.fem.mesh.quality import assess
from explicitfe.fem.mesh.validity import certify
from explicitfe.fem.model.model import Model
from explicitfe.fem.solve.body import Body
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import Progress
from explicitfe.results.documents.run_summary import CheckReport, FoldedElements, MeshReport, ModelDescription, RunSummary
from explicitfe.results.files import RestartState, ResultInMemory, ResultWriter
from explicitfe.simulate.run.inputs import sums_of
from explicitfe.simulate.scenario.read import Scenario

# Of the elastic energy: above it the mesh is too coarse to quote numbers without a comparison. In "hex8" it is the energy of
# bending, of an assumed strain, and no artefact: at 6 % points of the tongue lie within 0.2 mm of those of a mesh of twice as
# many hexes and of the fully integrated element (docs/studies/findings.md), so that more of it is borne there.
HOURGLASS_WARNING_SHARE = 0.05
BENDING_WARNING_SHARE = 0.10
TIMED_EVALUATIONS = 5  # of the forces, the best of which predicts the wall time


def how_to_resume(result: Path) -> str:
    """End of the sentence on an interrupted run."""
    return f"all samples so far are stored; resume with 'explicitfe resume {shlex.quote(str(result))}'."


def restart_extras(samples: int, seconds: float) -> dict[str, np.ndarray]:
    """Restart arrays in addition to those of the body: samples and seconds of wall time so far, and lanes of a vector."""
    return {"samples": np.array(samples), "lanes": np.array(WIDTH), "seconds": np.array(seconds)}


ScenarioT = TypeVar("ScenarioT", bound=Scenario)
BodyT = TypeVar("BodyT", bound=Body)


class Begun(NamedTuple):
    """An interrupted run to resume: its file, the newest restart state, and the history of the samples up to that state.

    ``state`` is None if the run was killed before it stored one: it then starts again and skips the stored samples.
    """

    path: Path
    state: RestartState | None
    rows: dict[str, np.ndarray]


@dataclass(frozen=True)
class Analysis(ABC, Generic[ScenarioT, BodyT]):
    """A scenario that has been read and built, ready for its kind of analysis; nothing is compiled or run yet.

    A new kind of analysis is a class like this in a file of its own, with its line in ``run/prepare.py``.

    Attributes
    ----------
    path, scenario, text : the file, what it says, and its text with the settings noted at its head.
    model, name : the physics, and what a user calls it.
    body : elements, masses and kernels, ready to be advanced.
    notes : sentences for the user that a check ends with, and the summary begins its warnings with.
    prepare_s : wall time that reading and building took.
    """

    path: Path
    scenario: ScenarioT
    text: str
    model: Model
    name: str
    body: BodyT
    notes: tuple[str, ...] = ()
    prepare_s: float = 0.0

    @classmethod
    @abstractmethod
    def prepare(cls, path: Path, scenario: ScenarioT, text: str) -> Self:
        """Build what a scenario describes.

        Raises
        ------
        InputError : what is wrong with it, in one sentence.
        """

    @abstractmethod
    def describe(self) -> ModelDescription:
        """The model in words and numbers, as it is stored and shown."""

    @abstractmethod
    def run(
        self, target: Path | ResultInMemory, *, overwrite: bool, progress: Progress, begun: Begun | None = None
    ) -> RunSummary:
        """Run to the end and store the result in ``target``; the summary is what ``explicitfe run --json`` prints.

        A file is written as the run goes on; a result in memory is filled, and nothing is written.

        Where the run ends early, ``status`` and ``message`` say why, and what was computed until then is stored. Where a signal
        asks to stop, while signals are watched, it ends after the sample with what is needed to go on. ``begun``: what an earlier
        process stored of this run, to go on from.

        Raises
        ------
        InputError : nothing was run and nothing written.
        """

    @abstractmethod
    def check(self, progress: Progress) -> CheckReport:
        """Measure what can be known before a run: mesh, step or iterations, wall time, memory."""

    # ---- what all kinds have in common ----

    def write(self, recorded: ResultInMemory, summary: RunSummary, target: Path) -> None:
        """Store a run that was recorded in memory as a file; a present one is replaced.

        Raises
        ------
        MachineError : the disk refuses.
        """
        with self._writer(target, True, len(recorded.times)) as writer:
            recorded.hand_to(writer)
            writer.finish(summary["status"], summary["message"], {**self._completed(summary), "result": str(target)})

    def _completed(self, summary: RunSummary) -> RunSummary:
        """A summary with what only files hold."""
        return summary

    @property
    def built_in(self) -> bool:
        """Whether the program has made the mesh, and not the user."""
        return self.scenario.model.name is not None

    def _description(self) -> ModelDescription:
        model, volumes = self.model, self.body.volumes
        return {
            "name": self.name,
            "nodes": model.mesh.node_count,
            "hexes": model.mesh.element_count,
            "volume_mm3": float(1e9 * volumes.sum()),
            "mass_g": float(1e3 * (self.body.density @ volumes)),
            "element": model.element,
            "material": model.material.model_dump(),
            "fixed_nodes": int(model.held.all(axis=1).sum()),
            "scenario": self.scenario.model_dump(mode="json", exclude_none=True),
        }

    @abstractmethod
    def _writer(self, target: Path | ResultInMemory, overwrite: bool, expected: int) -> ResultWriter | ResultInMemory:
        """A new result with room for so many samples."""

    def _opened(
        self, target: Path | ResultInMemory, overwrite: bool, expected: int, begun: Begun | None
    ) -> ResultWriter | ResultInMemory:
        """A new result, or one that was begun before."""
        return (
            self._writer(target, overwrite, expected) if begun is None else ResultWriter.reopen(begun.path, overwrite=overwrite)
        )

    def _stored_model(self) -> dict[str, object]:
        """What a result holds of the model: its description, and what is needed to build it again and go on."""
        return {
            **self.describe(),
            "scenario_file": str(self.path.absolute()),
            "file_sums": sums_of(self.path, self.scenario),
            "notes": list(self.notes),
        }

    def _mesh_report(self) -> MeshReport:
        quality = assess(self.model.mesh)
        return {
            "smallest_edge_mm": 1e3 * quality.smallest_edge_m,
            "largest_edge_mm": 1e3 * quality.largest_edge_m,
            "smallest_scaled_jacobian": quality.smallest_scaled_jacobian,
            "worst_element": quality.worst_element,
            "folded": self._folded(np.zeros_like(self.model.mesh.points)),
            "warnings": list(self.notes),
        }

    def _folded(self, displacement: np.ndarray) -> FoldedElements:
        """The elements that are folded anywhere at a displacement (n, 3) m."""
        certificate = certify(self.model.mesh.points + displacement, self.model.mesh.hexes)
        return {"elements": certificate.folded_count, "undecided": certificate.undecided_count}

    def _seconds_per_step(self) -> float:
        """Best of a few force evaluations: they are most of a step."""
        displacement = self.body.displacement
        best = np.inf
        for _ in range(TIMED_EVALUATIONS):
            begin = time.perf_counter()
            self.body.internal_force(displacement)
            best = min(best, time.perf_counter() - begin)
        return best

    def _kernel_memory_MB(self) -> float:
        return sum(array.nbytes for array in [*self.body.blocks, *self.body.nodes, *self.body.state]) / 1e6
