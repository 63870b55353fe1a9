"""Tables of the motion of markers: features of the vibration, and errors next to the scatter of repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from explicitfe.app.view.page.close_loop.reading import has_changed
from explicitfe.app.view.page.tables import PageTable, bars, table
from explicitfe.app.view.page.words import DASH, finite, number
from explicitfe.results.documents.loop_report import LoopReport
from explicitfe.results.documents.motion_report import MarkerMotion, VibrationFeatures

# Frequencies of models differ by less than a per cent.
FREQUENCY_DIGITS = 4
SIDE_NAMES = {True: "held out", False: "fitted"}


@dataclass(frozen=True)
class MotionError:
    """The rms distance between model and data over the markers of one curve, mm.

    Attributes
    ----------
    before, after : of the baseline and of the final model; None if not known.
    repeats : rms distance of a marker between two repeats of the test; None without repeats.
    """

    curve: str
    held_out: bool
    before: float | None
    after: float | None
    repeats: float | None


def motion_errors(report: LoopReport) -> list[MotionError]:
    """The errors of each curve with markers, held-out ones first."""
    held_out, repeats = set(report.split.holdout), report.repeats.rms if report.repeats else {}
    curves = sorted(dict.fromkeys(row.curve for row in report.motion), key=lambda curve: curve not in held_out)
    return [
        MotionError(
            curve,
            curve in held_out,
            _root_mean_square([row.rms_before for row in report.motion if row.curve == curve]),
            _root_mean_square([row.rms_after for row in report.motion if row.curve == curve]),
            repeats.get(curve),
        )
        for curve in curves
    ]


def _root_mean_square(values: Sequence[float | None]) -> float | None:
    """Over the values that are known; None without any."""
    known = [value for value in values if finite(value)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def repeats_note(report: LoopReport) -> str:
    """What the scatter of repeats is; "" without repeats."""
    pairs = report.repeats.pairs if report.repeats else 0
    number_of_pairs = f"{pairs} pair{'s' if pairs > 1 else ''}"
    return f"Repeats: rms distance of a marker between two repeats of the test, from {number_of_pairs}." if pairs else ""


def error_table(report: LoopReport) -> PageTable | None:
    """The errors of curves with markers, next to the scatter of repeats."""
    changed, errors = has_changed(report), motion_errors(report)
    largest = max((x for row in errors for x in (row.before, row.after, row.repeats) if finite(x)), default=0.0)
    rows = [
        (
            row.curve,
            SIDE_NAMES[row.held_out],
            number(row.before),
            number(row.after) if changed else None,
            number(row.repeats),
            bars([row.before, row.after] if changed else [row.before], row.repeats, largest),
        )
        for row in errors
    ]
    first = "before (mm)" if changed else "rms distance (mm)"
    head = ("curve", "", first, "after (mm)", "repeats (mm)", "before, after; line: repeats" if changed else "line: repeats")
    return table(head, rows, "ttnnnb")


def feature_table(report: LoopReport) -> PageTable | None:
    """Three rows for each marker, so that the numbers of data and models stand below each other."""
    held_out = set(report.split.holdout)
    rows = []
    for motion in sorted(report.motion, key=lambda one: one.curve not in held_out):
        models = [("before", motion.before), ("after", motion.after)] if has_changed(report) else [("model", motion.before)]
        for position, (name, features) in enumerate([("measured", motion.measured), *models]):
            named = position == 0
            rows.append(
                (
                    f"{motion.curve}{', held out' if motion.curve in held_out else ''}" if named else "",
                    f"{motion.marker}, {motion.axis}" if named else "",
                    name,
                    number(features.frequency_Hz, FREQUENCY_DIGITS),
                    number(features.decay_per_s),
                    number(features.end),
                    _phase_text(motion, features),
                )
            )
    return table(
        ("curve", "marker, axis", "", "frequency (Hz)", "decay (1/s)", "rest position (mm)", "phase (°)"), rows, "tttnnnn"
    )


def _phase_text(motion: MarkerMotion, features: VibrationFeatures) -> str:
    """A phase between -180 and 180 degrees; that of a model within 180 degrees of the measured one, for comparison."""
    phase, measured = features.phase_deg, motion.measured.phase_deg
    if not finite(phase):
        return DASH
    reference = _wrap_deg(measured) if finite(measured) else 0.0
    return f"{round(reference + _wrap_deg(phase - reference), 1) + 0.0:.1f}"


def _wrap_deg(angle: float) -> float:
    return (angle + 180.0) % 360.0 - 180.0
