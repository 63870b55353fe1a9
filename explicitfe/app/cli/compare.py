"""``explicitfe compare``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.completion import complete_words
from explicitfe.app.cli.grouped import with_options
from explicitfe.app.cli.options import JsonOption, OverwriteFilesOption, ResultArgument
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
# Options that only recordings have.
OF_RECORDINGS = (
    "mapping",
    "register",
    "reference_s",
    "offset_s",
    "head",
    "unit",
    "rate_hz",
    "axes",
    "picture",
    "palate",
    "overwrite",
)
RECORDING_SUFFIXES = (*TABLE_SUFFIXES, *MARKER_SUFFIXES)


@dataclass(frozen=True)
class CompareOptions:
    """Options of ``explicitfe compare``."""

    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="SHARE",
            help="Exit with code 3 if displacements differ by more than this share of the largest displacement.",
            show_default=False,
        ),
    ] = None
    mapping: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="POINT=SENSOR", help="Map a point of the model to a sensor; repeat for several."),
    ] = None
    register: Annotated[
        str | None,
        typer.Option(
            "--register",
            metavar="METHOD",
            help="Rigid registration fitted to: rest (positions at rest) | movement (all positions) | none.",
            show_default="rest",
            autocompletion=complete_words(REGISTRATIONS),
        ),
    ] = None
    reference_s: Annotated[
        str | None,
        typer.Option(
            "--reference-s",
            metavar="START:END",
            help="Interval of the recording in which the speaker rests, in s.",
            show_default="its first 20 ms",
        ),
    ] = None
    offset_s: Annotated[
        str | None,
        typer.Option(
            "--offset-s",
            metavar="S|fit",
            help="Time of the recording at which the simulation starts; fit minimizes the distance.",
            show_default="first row",
        ),
    ] = None
    head: Annotated[
        list[str] | None,
        typer.Option("--head", metavar="SENSOR", help="Sensor on the head or jaw whose motion is removed; repeat."),
    ] = None
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            help="Unit of columns that name none, or in place of that in the file, such as mm, m or 0.2mm (a pixel).",
            show_default=False,
        ),
    ] = None
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate-hz", metavar="HZ", help="Sampling rate of a recording without a time column.", show_default=False),
    ] = None
    axes: Annotated[
        str | None,
        typer.Option(
            "--axes",
            metavar="X,Y,Z",
            help="Directions of x, y and z of a recording with these axes, such as front,left,up.",
            show_default=False,
        ),
    ] = None
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="FILE", help="Draw the paths (.png, .pdf or .svg).", show_default=False),
    ] = None
    palate: Annotated[
        Path | None,
        typer.Option(
            "--palate",
            metavar="FILE",
            help="Draw a trace of the speaker's palate (.csv; axes as in the recording) in the picture.",
            show_default=False,
        ),
    ] = None
    overwrite: OverwriteFilesOption = False
    as_json: JsonOption = False


@with_options(CompareOptions)
def compare(
    result: ResultArgument,
    other: Annotated[
        Path,
        typer.Argument(
            help=f"Result to compare with it, or a recording of sensors ({', '.join(RECORDING_SUFFIXES)}).", show_default=False
        ),
    ],
    options: CompareOptions,
) -> None:
    """Compare a result with another result or with a recording of sensors.

    Two results: differing keys of the scenarios, and differences of fields, points, energies and measures. Their meshes may
    differ. A recording: distance and correlation of each sensor, after a rigid registration.

    Example: [bold]explicitfe compare vowel-i finer/vowel-i.vtkhdf --tolerance 0.05[/bold]

    Example: [bold]explicitfe compare vowel-i coils.csv --map tip=TT --map dorsum=TD --picture coils.png[/bold]
    """
    given = [name for name in OF_RECORDINGS if getattr(options, name)]
    if other.suffix.lower() not in RECORDING_SUFFIXES:
        if given:
            raise InputError(f"`{given[0]}` is for a recording ({', '.join(RECORDING_SUFFIXES)}), and {other} is none; omit it.")
        _compare_results(result, find_result(other), options.tolerance, options.as_json)
        return
    if options.tolerance is not None:
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
            head=options.head or (),
        )
        if options.picture is not None:
            _draw(result, options.picture, comparison, tracks, _palate(options, coils, comparison), options.overwrite)
            comparison = comparison.model_copy(update={"picture": str(options.picture)})
    print_answer(comparison.document, options.as_json, lambda: recording_tables(comparison), comparison.warnings)


def _draw(
    result: Path, file: Path, comparison: RecordingComparison, tracks: Tracks, palate: np.ndarray | None, overwrite: bool
) -> None:
    """Draw the compared paths."""
    from explicitfe.app.view.recording import RecordingPicture, draw_recording

    labels = [f"{point} ({compared.sensor})" for point, compared in comparison.points.items()]
    distance = f"rms {comparison.rms_mm:.2f} mm, centred {comparison.centred_rms_mm:.2f} mm"
    what = f"Recording {Path(comparison.recording).name} from {comparison.offset_s:.3f} s ({distance})"
    draw_recording(result, file, RecordingPicture(tracks.time_s, tracks.model, tracks.recorded, labels, what, palate), overwrite)


def _palate(options: CompareOptions, coils: Coils, comparison: RecordingComparison) -> np.ndarray | None:
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
