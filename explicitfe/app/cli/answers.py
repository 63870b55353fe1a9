"""What each command prints with ``--json``, as JSON schemas made from the types that the rooms write.

``docs/json`` holds them as files: ``explicitfe schema --answer run > docs/json/run.schema.json``. A later version may add keys.
"""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import Any, cast, get_type_hints

from pydantic import JsonValue, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from typing_extensions import TypedDict

from explicitfe.app.cli.ending import FailureAnswer
from explicitfe.app.tools.lists import LISTS
from explicitfe.app.tools.new_model import NewModel
from explicitfe.app.tools.new_scenario import NewScenario
from explicitfe.app.view.page.run.write import ReportAnswer
from explicitfe.inverse.measured.new_dataset import NewDataset
from explicitfe.platform.errors import InputError, nearest
from explicitfe.results.documents.dataset_check import DatasetCheckReport
from explicitfe.results.documents.drawn import DrawnPictures, ShownScene
from explicitfe.results.documents.examination import Examination
from explicitfe.results.documents.identification import Identification
from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.mesh_contents import MeshContents
from explicitfe.results.documents.planned_test import PlannedTest, ProposedTests
from explicitfe.results.documents.prediction import Prediction
from explicitfe.results.documents.run_summary import (
    IndentationCheckReport,
    IndentationSummary,
    MachineCode,
    SpeedReport,
    TransientCheckReport,
    TransientSummary,
)
from explicitfe.results.documents.sweep_summary import SweepMembers, SweepReport, SweepSummary
from explicitfe.results.documents.verification import Verification
from explicitfe.results.files.contents import ResultContents
from explicitfe.results.files.export.export import ExportedResult
from explicitfe.results.measure.comparison import Comparison
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.recording import RecordingComparison


class _PlainSchema(GenerateJsonSchema):
    """Without a title for every key, which says nothing but the key."""

    def field_title_should_be_set(self, schema: object) -> bool:
        return False


class InspectedResult(ResultContents):
    """What a result file holds, and what was measured at its end; ``measures`` is None where there is nothing to measure."""

    measures: Measures | None


class MeasuredResults(TypedDict):
    """The measures of each file that was named, in that order."""

    results: list[Measures]


def _list_of(what: str, rows: object) -> object:
    """The type of ``explicitfe list WHAT``."""
    make: Any = TypedDict
    kind = make(f"ListOf{what.title()}", {what: rows})
    kind.__doc__ = f"``explicitfe list {what}``."
    return kind


# Command, with hyphens for spaces -> the types that its answer can have.
ANSWERS_OF_COMMANDS: dict[str, tuple[Any, ...]] = {
    "run": (TransientSummary, IndentationSummary),
    "sweep": (SweepSummary, SweepMembers),
    "resume": (TransientSummary, IndentationSummary),
    "check": (TransientCheckReport, IndentationCheckReport, DatasetCheckReport),
    "inspect": (InspectedResult, MeshContents),
    "measure": (MeasuredResults,),
    "compare": (Comparison, RecordingComparison),
    "report": (ReportAnswer, SweepReport),
    "export": (ExportedResult,),
    "view": (ShownScene,),
    "plot": (DrawnPictures,),
    "identify": (Identification,),
    "predict": (Prediction,),
    "close-loop": (LoopReport,),
    "design-test": (PlannedTest, ProposedTests),
    "new-scenario": (NewScenario,),
    "new-dataset": (NewDataset,),
    "new-model": (NewModel,),
    "list": tuple(_list_of(what, get_type_hints(make)["return"]) for what, make in LISTS.items()),
    "doctor": (Examination,),
    "warmup": (MachineCode,),
    "verify": (Verification,),
    "bench": (SpeedReport,),
}


def answer_schema(name: str) -> dict[str, JsonValue]:
    """The JSON schema of what a command prints; of a failure, where nothing else is printed, under the name "failure".

    Raises
    ------
    InputError : there is no such command, or it has no ``--json``.
    """
    if name not in ANSWERS_OF_COMMANDS and name != "failure":
        raise InputError(f'there is no answer "{name}"; {nearest(name, [*ANSWERS_OF_COMMANDS, "failure"])}')
    kinds = (FailureAnswer,) if name == "failure" else (*ANSWERS_OF_COMMANDS[name], FailureAnswer)
    schema = TypeAdapter(reduce(or_, kinds)).json_schema(schema_generator=_PlainSchema)
    if name != "failure":  # an answer beside which something went wrong says so as well
        schema["properties"] = {"failure": {"$ref": "#/$defs/CommandFailure"}}
    command = "any command that fails" if name == "failure" else f"explicitfe {name.replace('new-', 'new ')}"
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"What {command} prints with --json"}
    return cast("dict[str, JsonValue]", {**schema, **head})
