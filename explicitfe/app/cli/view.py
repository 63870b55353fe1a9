"""``explicitfe view``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from explicitfe.app.api import view as api
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError


@command(api.view, without=("result", "file", "size_px"), folder="--out DIR", film_s="--seconds S")
def view(
    results: list[Path],
    *,
    png: bool = False,
    gif: bool = False,
    mp4: bool = False,
    size: str = "960x720",
    viewpoint: str | None = None,
    as_json: bool = False,
    **options: Any,
) -> None:
    """Show a result in three dimensions in a window, or write pictures and films, with several results side by side.

    Keys of the window: space plays and pauses; left and right go one sample back and forward; m, s, f, t and o change the
    viewpoint; b, x and r show or hide bones, fibres and the shape at rest; q closes the window.

    Examples: [bold]explicitfe view outputs/vowel-i.vtkhdf --gif[/bold]

    [bold]explicitfe view outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf --gif --size 640x480[/bold]

    Parameters
    ----------
    results : result file (.vtkhdf), its name in outputs/, or several of them.
    png : write a picture instead of opening a window.
    gif : write a film as GIF.
    mp4 : write a film as MP4.
    size : width and height of the picture of each result, pixels.
    """
    files: list[Any] = [kind for kind, wanted in (("png", png), ("gif", gif), ("mp4", mp4)) if wanted]
    with following(console, f"reading {results[0]}") as progress:
        from explicitfe.app.view.scene.show import show
        from explicitfe.app.view.terminal.drawn import scene_table

        shown = show(results, viewpoint, files=files, size_px=_size(size), **options, progress=progress)
    print_answer(shown, as_json, lambda: scene_table(shown), shown["warnings"])


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isascii() and width.isdecimal() and height.isascii() and height.isdecimal() and len(text) < 20):
        raise InputError(f'--size "{text}" is not valid; give width and height in pixels, such as 960x720.')
    return int(width), int(height)
