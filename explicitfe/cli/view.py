"""``explicitfe view``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from explicitfe.cli.answer import console, print_answer
from explicitfe.cli.options import JsonOption, OverwriteFilesOption, PicturesFolderOption, ResultArgument
from explicitfe.errors import InputError
from explicitfe.view.progress import following

if TYPE_CHECKING:
    from explicitfe.view.scene.show import FileKind

SizeOption = Annotated[str, typer.Option("--size", metavar="WxH", help="Width and height of a picture, in dots.")]


def view(
    result: ResultArgument,
    viewpoint: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="VIEW",
            help="midsagittal (half cut away), side, front, top or oblique; as it suits the result if left out.",
            show_default=False,
        ),
    ] = None,
    field: Annotated[
        str, typer.Option("--field", metavar="NAME", help="What colours the body: a stored field, or none.")
    ] = "displacement",
    at_ms: Annotated[
        float | None, typer.Option("--at-ms", metavar="T", help="When; a film goes up to there. The end if left out.")
    ] = None,
    png: Annotated[bool, typer.Option("--png", help="Draw a picture instead of a window.")] = False,
    gif: Annotated[bool, typer.Option("--gif", help="Draw a film as GIF.")] = False,
    mp4: Annotated[bool, typer.Option("--mp4", help="Draw a film as MP4.")] = False,
    out: PicturesFolderOption = None,
    size: SizeOption = "960x720",
    seconds: Annotated[float, typer.Option("--seconds", metavar="S", help="How long a film takes.")] = 4.0,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="WHAT", help="Leave out bones, fibres or rest (the shape at rest); repeat for more."),
    ] = None,
    overwrite: OverwriteFilesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show a result in three dimensions: in a window, or as a picture or a film in files.

    In the window: space plays and stops, left and right go a step, m s f t o change the view, b x r show bones, fibres, the shape
    at rest, q ends.

    Example: [bold]explicitfe view outputs/vowel-i.vtkhdf --gif[/bold]
    """
    left_out = set(without or ())
    if wrong := left_out - {"bones", "fibres", "rest"}:
        raise InputError(f'--without "{wrong.pop()}": name bones, fibres or rest')
    kinds: list[FileKind] = [kind for kind, wanted in (("png", png), ("gif", gif), ("mp4", mp4)) if wanted]  # type: ignore[misc]
    with following(console, f"showing {result}") as progress:
        from explicitfe.view.scene.show import show
        from explicitfe.view.terminal.drawn import scene_table

        shown = show(
            result,
            viewpoint,
            field=field,
            bones="bones" not in left_out,
            fibres="fibres" not in left_out,
            at_rest="rest" not in left_out,
            files=kinds,
            folder=out,
            time_s=None if at_ms is None else 1e-3 * at_ms,
            size_px=_size(size),
            film_s=seconds,
            overwrite=overwrite,
            progress=progress,
        )
    print_answer(shown, as_json, lambda: scene_table(shown), shown["warnings"])


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isascii() and width.isdecimal() and height.isascii() and height.isdecimal() and len(text) < 20):
        raise InputError(f'--size "{text}": give width and height in dots, such as 960x720')
    return int(width), int(height)
