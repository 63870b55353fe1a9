"""``explicitfe view``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import typer

from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.grouped import with_options
from explicitfe.app.cli.options import JsonOption, OverwriteFilesOption, PicturesFolderOption, result_argument
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError

FileKind = Literal["png", "gif", "mp4"]
FILE_KINDS: tuple[FileKind, ...] = get_args(FileKind)

SizeOption = Annotated[str, typer.Option("--size", metavar="WxH", help="Width and height of the picture of each result, pixels.")]


@dataclass(frozen=True)
class ViewOptions:
    """Options of ``explicitfe view``."""

    viewpoint: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="VIEW",
            help="Viewpoint: midsagittal (cut in half), side, oblique, top or front.",
            show_default="midsagittal; specimen: oblique",
        ),
    ] = None
    field: Annotated[str, typer.Option("--field", metavar="NAME", help="Stored field that colours the body, or none.")] = (
        "displacement"
    )
    at_ms: Annotated[
        float | None,
        typer.Option("--at-ms", metavar="T", help="Time of a picture, end of a film, in ms.", show_default="the last time"),
    ] = None
    png: Annotated[bool, typer.Option("--png", help="Write a picture instead of opening a window.")] = False
    gif: Annotated[bool, typer.Option("--gif", help="Write a film as GIF.")] = False
    mp4: Annotated[bool, typer.Option("--mp4", help="Write a film as MP4.")] = False
    out: PicturesFolderOption = None
    size: SizeOption = "960x720"
    seconds: Annotated[float, typer.Option("--seconds", metavar="S", help="Duration of a film in seconds.")] = 4.0
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without",
            metavar="PART",
            help="Hide bones, fibres, rest (the shape at rest) or context (lips, larynx).",
        ),
    ] = None
    overwrite: OverwriteFilesOption = False
    as_json: JsonOption = False


@with_options(ViewOptions)
def view(
    results: Annotated[list[Path], result_argument("Result file (.vtkhdf), its name in outputs/, or several of them.")],
    options: ViewOptions,
) -> None:
    """Show a result in three dimensions in a window, or write pictures and films, with several results side by side.

    Keys of the window: space plays and pauses; left and right go one sample back and forward; m, s, f, t and o change the
    viewpoint; b, x and r show or hide bones, fibres and the shape at rest; q closes the window.

    Examples: [bold]explicitfe view outputs/vowel-i.vtkhdf --gif[/bold]

    [bold]explicitfe view outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf --gif --size 640x480[/bold]
    """
    files: list[FileKind] = [kind for kind in FILE_KINDS if getattr(options, kind)]
    with following(console, f"reading {results[0]}") as progress:
        from explicitfe.app.view.scene.show import show
        from explicitfe.app.view.terminal.drawn import scene_table

        shown = show(
            results,
            options.viewpoint,
            field=options.field,
            without=options.without or (),
            files=files,
            folder=options.out,
            time_s=None if options.at_ms is None else 1e-3 * options.at_ms,
            size_px=_size(options.size),
            film_s=options.seconds,
            overwrite=options.overwrite,
            progress=progress,
        )
    print_answer(shown, options.as_json, lambda: scene_table(shown), shown["warnings"])


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isascii() and width.isdecimal() and height.isascii() and height.isdecimal() and len(text) < 20):
        raise InputError(f'--size "{text}" is not valid; give width and height in pixels, such as 960x720.')
    return int(width), int(height)
