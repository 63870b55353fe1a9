"""Runs of the tongue as cases, computed once: what studies/benchmarks/findings.py makes its tables and pictures of.

    laboratory = Laboratory(Path("outputs/findings"))
    laboratory.answer(case({"GGp": 2.0}, tissue=LIVING, mesh="fine")).moved("dorsum")

A case is a scenario in memory, run and measured as ``explicitfe run`` and ``explicitfe measure`` do.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tests"))

import numpy as np  # noqa: E402
from outside_data import SHARED_DATA  # noqa: E402
from real_tongue import write_model  # noqa: E402

from explicitfe.fem.mesh.validity import certify  # noqa: E402
from explicitfe.fem.model.model import Model  # noqa: E402
from explicitfe.results.files import Result, open_result  # noqa: E402
from explicitfe.results.measure.document import Measures  # noqa: E402
from explicitfe.results.measure.measure import measures_of  # noqa: E402
from explicitfe.results.measure.steps import last_step  # noqa: E402
from explicitfe.simulate.anatomy import catalogue  # noqa: E402
from explicitfe.simulate.run.prepare import analysis_of  # noqa: E402
from explicitfe.simulate.scenario.bones import BoneTable, HyoidTable, JawTable  # noqa: E402
from explicitfe.simulate.scenario.transient import AnalysisTable, Damping, ModelTable, MuscleTable, RecordTable, TransientScenario  # noqa: E402

MEASURED_TONGUE = SHARED_DATA / "tongue" / "artisynth-hextongue"
MEASURED = "measured"
CADAVER, LIVING = "gerard-2005", "buchaillard-2009"
BONES = ("palate", "jaw", "pharynx")


@dataclass(frozen=True)
class Case:
    """One run: what pulls, on which tissue and mesh, with which of the effects."""

    pulls: tuple[tuple[str, float], ...]
    tissue: str = CADAVER
    mesh: str | tuple[int, int, int] = "medium"
    element: str = "hex8"
    beta_s: float = 0.03
    bones: tuple[str, ...] = BONES
    attachment: str = "area"
    distribution: str = "stress"
    direction: str = "reference"
    force_length: bool = False
    hyoid_N_mm: float | None = None
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rise_ms: float = 0.0
    duration_ms: float = 200.0
    fibres: tuple[int, ...] | None = None
    stiffening: bool = False
    jaw_mm: float = 0.0  # opening; the measured tongue, whose nodes are held, has a jaw at rest

    @property
    def key(self) -> str:
        """Name of what is kept of it; another case gives another name."""
        return hashlib.sha256(repr(self).encode()).hexdigest()[:16]

    def scenario(self, folder: Path) -> TransientScenario:
        """As a scenario whose files lie in ``folder``."""
        measured = self.mesh == MEASURED
        cells = self.mesh if isinstance(self.mesh, tuple) else None
        source = {"file": "real-tongue.toml"} if measured else {"name": "tongue", "cells": cells}
        if isinstance(self.mesh, str) and not measured:
            source["resolution"] = self.mesh
        return TransientScenario(
            title="Findings",
            model=ModelTable(
                **source,
                material=self.tissue,
                element=self.element,
                damping=Damping(alpha_per_s=40.0, beta_s=self.beta_s),
                attachment="nodes" if measured else self.attachment,
                activation_stiffening=self.stiffening,
            ),
            muscle=[
                MuscleTable(
                    name=name,
                    force_N=force_N,
                    distribution=self.distribution,
                    direction=self.direction,
                    force_length=self.force_length,
                    fibres=self.fibres,
                    profile="ramp" if self.rise_ms else "step",
                    rise_ms=self.rise_ms,
                )
                for name, force_N in self.pulls
            ],
            bone=[
                BoneTable(name=name, shift_mm=self.shift_mm)
                if not measured
                else BoneTable(name=name, shift_mm=self.shift_mm, file=f"{name}.stl", length_unit="mm")
                for name in self.bones
            ],
            jaw=None if measured or not self.jaw_mm else JawTable(opening_mm=self.jaw_mm),
            hyoid=None if self.hyoid_N_mm is None else HyoidTable(stiffness_N_per_mm=self.hyoid_N_mm),
            analysis=AnalysisTable(duration_ms=self.duration_ms, threads=1),
            record=RecordTable(every_ms=2.0, fields=["displacement", "velocity"]),
        )


def case(pulls: dict[str, float], **settings: Any) -> Case:
    return Case(tuple(pulls.items()), **settings)


# ---- running ----


class MissingRunError(LookupError):
    """A run that a table needs has not been made."""


@dataclass
class Laboratory:
    """Runs cases, and keeps what came of them in a folder."""

    folder: Path
    computes: bool = True

    def answer(self, asked: Case) -> Answer:
        """What came of a case; computed if it is not kept yet."""
        path = self.folder / f"{asked.key}.json"
        if not path.is_file():
            if not self.computes:
                raise MissingRunError(repr(asked))
            kept, arrays = self._compute(asked)
            np.savez_compressed(path.with_suffix(".npz"), allow_pickle=False, **arrays)
            path.write_text(json.dumps({"case": repr(asked)} | kept), encoding="utf-8")
        return Answer(asked, path)

    def _compute(self, asked: Case) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        if asked.mesh == MEASURED:
            write_model(MEASURED_TONGUE, self.folder, as_stress=True)
            write_bones(self.folder)
        scenario = asked.scenario(self.folder)
        analysis = analysis_of(self.folder / "findings.toml", scenario, "")
        with tempfile.TemporaryDirectory() as scratch:
            summary = analysis.run(Path(scratch) / "result.vtkhdf", overwrite=True, progress=lambda *_: None)
            with open_result(Path(scratch) / "result.vtkhdf") as result:
                return kept_of(result, analysis.model, summary)


def write_bones(folder: Path) -> None:
    """The bones of the built-in tongue as surface files, in mm."""
    import pyvista

    for name, shape in catalogue.bones("tongue").items():
        triangles = np.insert(shape.surface.triangles, 0, 3, axis=1)
        pyvista.PolyData(1e3 * shape.surface.points, triangles.ravel()).save(folder / f"{name}.stl")


def kept_of(result: Result, model: Model, summary: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What is kept of a run: its measures, what they do not tell, and the shape at the end."""
    step = last_step(result)
    u = result.displacement(step)
    names = list(model.probes)
    kept = {
        "status": summary["status"],
        "message": summary["message"],
        "measures": measures_of(result, step).model_dump(),
        "folded": certify(result.mesh.points + u, result.mesh.hexes).folded_count,
        "hourglass": summary["hourglass_share_end"],
        "balance": float(summary["energy_balance_error"]),
        "deepest_mm": 1e3
        * max((float(np.max(result.history(f"contact_{bone.name}_depth"))) for bone in model.bones), default=0.0),
        "points": names,
    }
    paths = np.stack([result.history(f"probe_{name}_displacement") for name in names], axis=1)
    fastest = int(np.argmax(np.linalg.norm(result.field("velocity", step), axis=1)))
    kept["fastest_at_mm"] = (1e3 * (result.mesh.points + u)[fastest]).tolist()
    kept["fastest_at_rest_mm"] = (1e3 * result.mesh.points[fastest]).tolist()
    arrays = {"displacement": u, "times": result.history("time"), "paths": paths}
    for bone in model.bones:
        arrays[f"pressure_{bone.name}"] = result.field(f"contact_pressure_{bone.name}", step)
    return kept, arrays


@dataclass(frozen=True)
class Answer:
    """What is kept of a run."""

    case: Case
    path: Path

    @property
    def kept(self) -> dict[str, Any]:
        return _read(self.path)

    @property
    def measures(self) -> Measures:
        return Measures.model_validate(self.kept["measures"])

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        with np.load(self.path.with_suffix(".npz")) as stored:
            return dict(stored)

    def moved(self, point: str) -> tuple[float, float]:
        """Forward and up, mm."""
        at = self.measures.points[point]
        return at.forward_mm, at.up_mm


@cache
def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
