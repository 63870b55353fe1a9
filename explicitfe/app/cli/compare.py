"""``explicitfe compare``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.cli.completion import complete_words
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.result_files import find_result
from explicitfe.platform.host.shipped import MARKER_SUFFIXES, TABLE_SUFFIXES, export_file

if TYPE_CHECKING:
    import numpy as np

    from explicitfe.inverse.measured.coils import Coils
    from explicitfe.inverse.measured.compare_recording import Tracks
    from explicitfe.results.measure.recording import RecordingComparison

REGISTRATIONS = ("rest", "movement", "none")
RECORDING_SUFFIXES = (*TABLE_SUFFIXES, *MARKER_SUFFIXES)


@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """Options that only the comparison with a recording has.

    Parameters
    ----------
    mapping : map a point of the model to a sensor.
    register : rigid registration fitted to: rest (positions at rest) | movement (all positions) | none; by default rest.
    reference_s : interval of the recording in which the speaker rests, in s; by default its first 20 ms.
    offset_s : time of the recording at which the simulation starts; fit minimizes the distance; by default its first row.
    head : sensor on the head or jaw whose motion is removed.
    unit : unit of columns that name none, or in place of that in the file, such as mm, m or 0.2mm (a pixel).
    rate_hz : sampling rate of a recording without a time column.
    axes : directions of x, y and z of a recording with these axes, such as front,left,up.
    picture : draw the paths (.png, .pdf or .svg).
    palate : draw a trace of the speaker's palate (.csv; axes as in the recording) in the picture.
    overwrite : replace existing files.
    """

    mapping: Sequence[str] = ()
    register: str | None = None
    reference_s: str | None = None
    offset_s: str | None = None
    head: Sequence[str] = ()
    unit: str | None = None
    rate_hz: float | None = None
    axes: str | None = None
    picture: Path | None = None
    palate: Path | None = None
    overwrite: bool = False


@command(RecordingOptions, completions={"register": complete_words(REGISTRATIONS)})
def compare(result: Path, other: Path, *, tolerance: float | None = None, as_json: bool = False, **of_recording: Any) -> None:
    """Compare a result with another result or with a recording of sensors.

    Two results: differing keys of the scenarios, and differences of fields, points, energies and measures. Their meshes may
    differ. A recording: distance and correlation of each sensor, after a rigid registration.

    Example: [bold]explicitfe compare vowel-i finer/vowel-i.vtkhdf --tolerance 0.05[/bold]

    Example: [bold]explicitfe compare vowel-i coils.csv --map tip=TT --map dorsum=TD --picture coils.png[/bold]

    Parameters
    ----------
    other : result to compare with it, or a recording of sensors (.csv, .txt, .tsv, .c3d, .trc, .mot, .sto, .pos, .mat).
    tolerance : exit with code 3 if displacements differ by more than this share of the largest displacement.
    """
    options = RecordingOptions(**of_recording)
    given = [name for name in vars(options) if of_recording.get(name)]
    if other.suffix.lower() not in RECORDING_SUFFIXES:
        if given:
            raise InputError(f"`{given[0]}` is for a recording ({', '.join(RECORDING_SUFFIXES)}), and {other} is none; omit it.")
        _compare_results(result, find_result(other), tolerance, as_json)
        return
    if tolerance is not None:
        raise InputError(f"--tolerance is for two results, and {other} is a recording; omit it.")
    if not options.mapping:
        raise InputError("--map is missing; map at least one point of the model to a sensor, such as --map tip=T1.")
    if options.register not in (None, *REGISTRATIONS):
        raise InputError(f'--register "{options.register}" is not possible; {nearest(options.register, REGISTRATIONS)}')
    if options.palate is not None and options.picture is None:
        raise InputError("--palate needs a picture to draw the trace in; add --picture, such as --picture paths.png.")
    with following(console, f"reading {result}, {other}"):
        from explicitfe.app.view.terminal.recording import recording_tables
        from explicitfe.inverse.measured.coils import parse_interval, parse_mapping, read_coils
        from explicitfe.inverse.measured.compare_recording import compare_recording

        coils = read_coils(export_file(other), unit=options.unit, rate_hz=options.rate_hz, axes=options.axes)
        comparison, tracks = compare_recording(
            result,
            coils,
            parse_mapping(options.mapping),
            register=cast("Literal['rest', 'movement', 'none']", options.register or "rest"),
            reference_s=None if options.reference_s is None else parse_interval(options.reference_s, "--reference-s"),
            offset_s=_offset(options.offset_s),
            head=options.head,
        )
        if options.picture is not None:
            _draw(result, options.picture, comparison, tracks, _palate(options, coils, comparison), options.overwrite)
            comparison = comparison.model_copy(update={"picture": str(options.picture)})
    print_answer(comparison.document, as_json, lambda: recording_tables(comparison), comparison.warnings)


def _draw(
    result: Path, file: Path, comparison: RecordingComparison, tracks: Tracks, palate: np.ndarray | None, overwrite: bool
) -> None:
    """Draw the compared paths."""
    from explicitfe.app.view.recording import RecordingPicture, draw_recording

    labels = [f"{point} ({compared.sensor})" for point, compared in comparison.points.items()]
    distance = f"rms {comparison.rms_mm:.2f} mm, centred {comparison.centred_rms_mm:.2f} mm"
    what = f"Recording {Path(comparison.recording).name} from {comparison.offset_s:.3f} s ({distance})"
    draw_recording(result, file, RecordingPicture(tracks.time_s, tracks.model, tracks.recorded, labels, what, palate), overwrite)


def _palate(options: RecordingOptions, coils: Coils, comparison: RecordingComparison) -> np.ndarray | None:
    """Trace of the palate (k, 3) m in the frame of the model; None if none is given."""
    import numpy as np

    from explicitfe.inverse.measured.coils import parse_axes, read_trace

    if options.palate is None:
        return None
    places, axes = read_trace(options.palate, unit=options.unit)
    if options.axes is not None and axes == "cartesian":
        places, axes = places @ parse_axes(options.axes), "anatomical"
    if axes != coils.axes:
        named = {"anatomical": "directions", "cartesian": "x, y, z"}
        raise InputError(
            f"--palate {options.palate}: the trace has {named[axes]} and the recording {named[coils.axes]}; use one frame."
        )
    registration = comparison.registration
    return places @ np.array(registration.rotation).T + 1e-3 * np.array(registration.translation_mm)


def _compare_results(a: Path, b: Path, tolerance: float | None, as_json: bool) -> None:
    with following(console, f"reading {a}, {b}") as progress:
        from explicitfe.app.view.terminal.comparison import comparison_tables, difference_in_words
        from explicitfe.results.measure.compare import compare as compare_results

        comparison = compare_results(a, b, tolerance, progress)
    print_answer(
        comparison.document,
        as_json,
        lambda: comparison_tables(comparison),
        failure=None if comparison.within_tolerance in (None, True) else ("check", difference_in_words(comparison)),
    )


def _offset(words: str | None) -> float | Literal["fit"] | None:
    if words is None:
        return None
    if words == "fit":
        return "fit"
    try:
        return float(words)
    except ValueError:
        raise InputError(f'--offset-s "{words}" is not possible; give a time of the recording in s, or fit.') from None
