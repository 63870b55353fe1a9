"""Answer of ``explicitfe compare`` for a result and a recording of sensors."""

from __future__ import annotations

from typing import Literal

from explicitfe.results.documents.document import Computed, Document
from explicitfe.results.measure.comparison import ComparedResult
from explicitfe.results.measure.document import MeasuredPart

RegisterBy = Literal["rest", "movement", "none"]


class ComparedAxis(MeasuredPart):
    """One coordinate of a point and its sensor.

    Attributes
    ----------
    rms_mm : root mean square of the difference.
    correlation : Pearson's coefficient; None if one of the two does not move.
    model_range_mm, recorded_range_mm : largest less smallest coordinate.
    """

    rms_mm: Computed
    correlation: float | None
    model_range_mm: Computed
    recorded_range_mm: Computed


class ComparedSensor(MeasuredPart):
    """A point of the model and the sensor that is mapped to it.

    Attributes
    ----------
    rms_mm, largest_mm, largest_at_ms : distance between the two: root mean square, largest value, and its time in the model.
    centred_rms_mm : root mean square distance after both paths are shifted to their means. It is not affected by a sensor that
        sits elsewhere than the point, or by another shape at rest.
    forward, up, right : the coordinates; right is None for a planar recording.
    """

    sensor: str
    rms_mm: Computed
    largest_mm: Computed
    largest_at_ms: float
    centred_rms_mm: Computed
    forward: ComparedAxis
    up: ComparedAxis
    right: ComparedAxis | None


class FittedRegistration(MeasuredPart):
    """How the recording was brought into the frame of the model: x_model = R x + t.

    Attributes
    ----------
    method : what R and t were fitted to: positions at rest, positions during the whole movement, or nothing.
    what : the same as a sentence.
    rotation : R, three rows.
    rotation_deg : angle of R.
    translation_mm : t.
    residual_mm : root mean square distance of the points that were used, after the fit; None if nothing was fitted.
    head_sensors : sensors whose rigid motion was removed before.
    """

    method: RegisterBy
    what: str
    rotation: list[list[float]]
    rotation_deg: float
    translation_mm: list[float]
    residual_mm: float | None
    head_sensors: list[str]


class RecordingComparison(Document, MeasuredPart):
    """How a result differs from a recording.

    Attributes
    ----------
    offset_s : time of the recording at which the simulation starts; ``offset_fitted`` says whether it was fitted.
    rows, first_ms, last_ms : rows of the recording that were compared, and their times in the simulation.
    rms_mm, centred_rms_mm : root mean square distance over all sensors and rows, as for each sensor.
    movement_rms_mm : root mean square distance of the recorded positions from their means: the size of the movement.
    points : point of the model -> comparison with its sensor.
    picture : the file, or None if none was drawn.
    """

    result: ComparedResult
    recording: str
    registration: FittedRegistration
    offset_s: float
    offset_fitted: bool
    rows: int
    first_ms: float
    last_ms: float
    rms_mm: Computed
    centred_rms_mm: Computed
    movement_rms_mm: Computed
    points: dict[str, ComparedSensor]
    picture: str | None = None
    warnings: list[str]
