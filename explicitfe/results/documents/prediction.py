"""``predict.json``: what ``explicitfe predict`` writes, each curve as it was measured and as a model predicts it.

Only keys that were set are written: a curve that failed has a message and no errors.
"""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

from explicitfe.results.documents.document import Document


class PredictionPart(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class PredictedRows(PredictionPart):
    """Columns of a curve, in the units that the curve names; ``predicted`` is there unless the curve failed."""

    time_s: list[float]
    imposed: list[float]
    measured: list[float]
    predicted: list[float] | None = None


class PredictedCurve(PredictionPart):
    """One curve.

    Attributes
    ----------
    split : side on which the dataset puts the curve; None where it leaves that open.
    constants : group of constants that it has.
    quantity, unit : of the predicted column.
    imposed, imposed_unit : of the imposed column; a strain has no unit.
    message : why the curve could not be computed.
    rmse : root mean square of predicted minus measured, in the unit.
    nrmse : the same as a share of the largest measured value; None where nothing but zeros was measured.
    instants, iterations, seconds : work that the curve took; iterations are those of dynamic relaxation.
    """

    status: Literal["predicted", "failed"]
    split: Literal["fit", "holdout"] | None
    constants: str
    quantity: str
    unit: str
    imposed: str
    imposed_unit: str
    rows: PredictedRows
    message: str = ""
    rmse: float | None = None
    nrmse: float | None = None
    largest_measured: float | None = None
    instants: int | None = None
    iterations: int | None = None
    seconds: float | None = None


class PredictionError(PredictionPart):
    """Mean error of the predicted curves of one side."""

    curves: int
    nrmse: float


class Prediction(Document, PredictionPart):
    """What ``predict.json`` holds.

    Attributes
    ----------
    dataset, model : name of the dataset, path of the model file.
    effects : names of the model's effects.
    refinement, density, tolerance : how tests under a tool were computed.
    section : refinement of the section in which bodies of revolution were solved; 0 if none was.
    finer : refinement to which fine ramps corrected the answers; 0 if none did.
    curves : id -> curve.
    error : "fit", "holdout" or "all" (curves without a side) -> mean error.
    assumed : what was supposed because the dataset does not state it, in words.
    files : all that was written.
    """

    dataset: str
    model: str
    effects: list[str]
    refinement: float
    density: float
    tolerance: float
    section: float = 0.0
    finer: float = 0.0
    curves: dict[str, PredictedCurve]
    error: dict[str, PredictionError]
    assumed: list[str]
    wall_s: float
    files: list[str] = []

    @property
    def failures(self) -> dict[str, str]:
        """Curve that could not be computed -> why."""
        return {name: curve.message for name, curve in self.curves.items() if curve.status != "predicted"}
