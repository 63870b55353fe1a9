"""Tables of ``report.json`` on the motion of markers, and what its moving picture is drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.results.documents.report_part import PartOf, ReportPart, Side, TableOf


class VibrationFeatures(ReportPart):
    """Features of a vibrating coordinate y = end + a exp(-decay t) cos(2 pi f t + phase), in the unit of the report.

    Attributes
    ----------
    frequency_Hz, decay_per_s : of the vibration.
    phase_deg : at the start of the motion.
    amplitude, end : of the vibration at the start, and where it comes to rest.
    """

    frequency_Hz: float | None = None
    decay_per_s: float | None = None
    phase_deg: float | None = None
    amplitude: float | None = None
    end: float | None = None


class MarkerMotion(ReportPart):
    """How one marker moves along the axis of its largest motion.

    Attributes
    ----------
    curve, marker, axis : x, y or z of the model.
    measured, before, after : features of the data, the baseline and the final model.
    rms_before, rms_after : rms distance between model and data in three dimensions.
    """

    curve: str = ""
    marker: str = ""
    axis: str = ""
    measured: PartOf[VibrationFeatures] = VibrationFeatures()
    before: PartOf[VibrationFeatures] = VibrationFeatures()
    after: PartOf[VibrationFeatures] = VibrationFeatures()
    rms_before: float | None = None
    rms_after: float | None = None


class ReportedRepeats(ReportPart):
    """How much repeats of one test differ.

    Attributes
    ----------
    pairs : number of pairs of repeats.
    rms : curve -> rms distance of a marker between two such repeats, in the unit of the report.
    """

    pairs: int = 0
    rms: TableOf[float] = {}


@dataclass(frozen=True, eq=False)
class MovingMarkers:
    """Markers of one curve for the moving picture of the report.

    Attributes
    ----------
    curve, split : its name, and whether it was fitted.
    time_s : (k,) since the start of the motion.
    names : of the s markers that move.
    at_rest : (s, 3) positions at rest in the frame of the model, mm.
    measured, before, after : (k, s, 3) displacements from rest, mm; NaN where a value is missing.
    outline : (e, 2, 3) edges of the body at rest, mm.
    """

    curve: str
    split: Side
    time_s: np.ndarray
    names: Sequence[str]
    at_rest: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    outline: np.ndarray
